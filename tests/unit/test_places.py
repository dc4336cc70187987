"""Reading a recording from one of its scans on gives the scans that reading all of it gives."""

from __future__ import annotations

import gzip
import itertools
from dataclasses import replace
from pathlib import Path

import pytest

from maritrack.sweep.places import Index, Place, index, place_of, positioned
from maritrack.sweep.plan import Run, Settings, plan
from maritrack.sweep.sources import named, opened
from maritrack.types import Frame
from tests import runs
from tests.cli.calling import call

SCANS, AT = 6, 4


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The harbour with few spokes."""
    return runs.harbour(tmp_path_factory.mktemp("rec"), spokes=360, cells=60, scans=SCANS)


def packed(recording: Path, folder: Path, kind: str) -> Path:
    """The recording in a container, by the end of its name."""
    path = folder / f"rec.{kind}"
    if kind == "cat240.gz":
        path.write_bytes(gzip.compress(recording.read_bytes(), mtime=0))
    elif kind == "two.cat240":
        path.write_bytes(two_sensors(recording.read_bytes()))
    elif kind == "cat240":
        path.write_bytes(recording.read_bytes())
    else:
        assert call("convert", recording, path).code == 0
    return path


def two_sensors(octets: bytes) -> bytes:
    """Each data block, and the same of another sensor two blocks later."""
    blocks, at = [], 0
    while at < len(octets):
        size = int.from_bytes(octets[at + 1 : at + 3], "big")
        blocks.append(octets[at : at + size])
        at += size
    others = [block[:6] + bytes([block[6] ^ 1]) + block[7:] for block in blocks]  # SIC, behind two octets of FSPEC
    return b"".join(itertools.chain.from_iterable(zip(blocks[2:], others, strict=False)))


def planned(path: Path) -> Run:
    (run,) = plan(named([str(path)]), axes={}, seeds=(), settings=Settings(over={}))
    return run


def indexed(run: Run) -> Index:
    found = index(run)
    assert isinstance(found, Index), found
    return found


def read(run: Run, place: Place) -> tuple[list[Frame], int]:
    with opened(run.source, seed=run.seed) as found:
        recording, shift = positioned(run, found, place)
        return list(recording.frames), shift


@pytest.mark.parametrize(
    ("kind", "seeks"),
    [("cat240", True), ("pcap", True), ("final", True), ("mcap", False), ("pcap.gz", False), ("cat240.gz", False),
     ("two.cat240", False)],
)  # fmt: skip
def test_a_scan_is_the_same_from_wherever_it_is_read(recording: Path, tmp_path: Path, kind: str, seeks: bool) -> None:
    run = planned(packed(recording, tmp_path, kind))
    found = indexed(run)
    whole, none = read(run, place_of(found, 0))
    assert none == 0 and found.t_ns.tolist() == [frame.t_ns for frame in whole]
    assert len(whole) == (2 * SCANS - 1 if kind == "two.cat240" else SCANS)
    for at in range(1, len(whole)):
        behind, shift = read(run, place_of(found, at))
        assert (shift > 0) == (seeks and at > 1) and len(behind) == len(whole) - at
        for ours, theirs in zip(behind, whole[at:], strict=True):
            a, b = ours.scan, theirs.scan
            assert (a.t_ns, a.t_start_ns, a.sensor) == (b.t_ns, b.t_start_ns, b.sensor)
            assert a.video is not None and b.video is not None and runs.differences(a.video, b.video) == []


@pytest.mark.parametrize("kind", ["cat240", "pcap", "final"])
def test_damage_is_told_where_it_is(recording: Path, tmp_path: Path, kind: str) -> None:
    path = packed(recording, tmp_path, kind)
    run = planned(path)
    found = indexed(run)
    octets = bytearray(path.read_bytes())
    middle = (int(found.begin[AT + 1]) + len(octets)) // 2  # of the scan behind
    octets[middle : middle + 64] = bytes(64)
    path.write_bytes(octets)
    told = [[(d.code, d.offset) for frame in read(run, place)[0] for d in frame.damage] for place in
            (place_of(found, 0), place_of(found, AT))]  # fmt: skip
    shift = read(run, place_of(found, AT))[1]
    assert shift > 0 and told[0] and told[0] == [(code, offset + shift) for code, offset in told[1]]


def test_a_place_that_is_none_is_read_from_the_beginning(recording: Path) -> None:
    run = planned(recording)
    found = indexed(run)
    for octet in (int(found.begin[AT]) + 7, int(found.begin[AT]), recording.stat().st_size - 3):
        frames, shift = read(run, replace(place_of(found, AT), octet=octet))
        assert shift == 0 and [frame.t_ns for frame in frames] == found.t_ns[AT:].tolist()
