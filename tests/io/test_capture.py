"""Recordings in containers: the same radials as from bare blocks, with places, times and senders."""

from __future__ import annotations

import gzip
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from maritrack.errors import InputError, UsageError
from maritrack.io.cat240.encode import encode_video
from maritrack.io.cat240.reader import read_batches
from maritrack.io.cat240_source import Cat240Source
from maritrack.io.containers.capture import open_cat240
from maritrack.io.containers.kinds import container_of, open_container, unpacked_head
from maritrack.io.containers.ledger import Ledger
from maritrack.io.containers.select import Selection, matches, whole_blocks
from maritrack.io.containers.writers import open_writer
from maritrack.io.datagrams import NO_TIME, Datagrams, Stream
from maritrack.io.source import Octets
from maritrack.settings import InputConfig
from maritrack.types import Frame
from tests.io.spins import spin

RADAR, OTHER = Stream("192.0.2.7:5000", "239.0.1.2:8600"), Stream("192.0.2.8:5000", "239.0.1.3:8600")
GPS = Stream("192.0.2.9:4000", "239.0.1.2:4000")
NOON_NS = 1_700_006_400_000_000_000 + 12 * 3600 * 10**9 - 1_700_006_400_000_000_000 % (86_400 * 10**9)
KINDS = ("final", "pcap", "mcap")

Sent = tuple[bytes, int, Stream]


def video(i: int, *, tod: int | None = 1000, sic: int = 42, az: int = 1024) -> bytes:
    """The data block of spoke `i`."""
    cells = np.arange(i, i + 20, dtype=np.uint8) if i < 200 else np.arange(20, dtype=np.uint8)
    return encode_video(
        sac=7, sic=sic, idx=i, start_az=i * az % 65_536, end_az=(i + 1) * az % 65_536, start_rg=0,
        cell_dur=66_712_819, cells=cells, tod=tod,
    )  # fmt: skip


def packed(kind: str, sent: Sequence[Sent], folder: Path) -> bytes:
    """A container with these datagrams."""
    path = folder / f"made.{kind}"
    writer = open_writer(path)
    for payload, t_ns, stream in sent:
        assert writer.write(payload, t_ns=t_ns, stream=stream)
    writer.close()
    return path.read_bytes()


def octets(data: bytes, *, size: int = 1 << 20) -> Octets:
    chunks = [data[at : at + size] for at in range(0, len(data), size)]
    return Octets("rec", "/input/cat240", chunks, data[:65_536], len(data))


def read(data: bytes, **options: Any) -> tuple[dict[str, np.ndarray], list[tuple[str, int]], bytes]:
    """Columns of all radials, damage, and the octets of all batches."""
    size = options.pop("size", 1 << 20)
    batches = list(open_cat240(octets(data, size=size), **options).batches())
    found = [batch.radials for batch in batches if batch.radials is not None]
    names = ("offset", "idx", "start_az", "tod", "t_ns", "stream", "n_cells", "cells")
    columns = {name: np.concatenate([getattr(r, name) for r in found]) for name in names} if found else {}
    damage = [(one.code, one.offset) for batch in batches for one in batch.damage]
    assert [batch.end for batch in batches[:-1]] == [batch.start for batch in batches[1:]]
    return columns, damage, b"".join(batch.octets for batch in batches)


@pytest.mark.parametrize("zipped", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_the_radials_are_those_of_the_bare_blocks(kind: str, zipped: bool, tmp_path: Path) -> None:
    sent = [(video(i), NOON_NS + i * 10**7, RADAR) for i in range(150)]
    data = packed(kind, sent, tmp_path)
    stored = gzip.compress(data) if zipped else data
    bare = [b.radials for b in read_batches([b"".join(one[0] for one in sent)]) if b.radials is not None]
    columns, damage, joined = read(stored)
    assert joined == stored and damage == []
    assert_array_equal(columns["cells"], bare[0].cells)
    assert_array_equal(columns["idx"], np.arange(150))
    day = 0 if kind == "final" else NOON_NS - 12 * 3600 * 10**9
    assert_array_equal(columns["t_ns"], day + 12 * 3600 * 10**9 + np.arange(150) * 10**7)
    if kind != "mcap":  # there the offset is that of the chunk, which is compressed
        assert [data[at] for at in columns["offset"].tolist()] == [0xF0] * 150


@pytest.mark.parametrize("kind", KINDS)
@given(size=st.integers(1, 4000), noise=st.lists(st.integers(0, 2**63 - 1), max_size=6))
@settings(derandomize=True, deadline=None, max_examples=15)
def test_chunks_and_damage_never_lose_octets(
    kind: str, tmp_path_factory: pytest.TempPathFactory, size: int, noise: list[int]
) -> None:
    sent = [(video(i), NOON_NS + i * 10**7, RADAR) for i in range(40)]
    data = bytearray(packed(kind, sent, tmp_path_factory.mktemp("made")))
    for one in noise:
        data[8 + one % (len(data) - 8)] ^= 1 + one % 255
    first, second = read(bytes(data)), read(bytes(data), size=size)
    assert first[2] == second[2] == bytes(data)
    assert first[1] == second[1]
    for name, column in first[0].items():
        assert_array_equal(column, second[0][name])


def test_headers_alone_have_no_cells_and_no_octets(tmp_path: Path) -> None:
    data = packed("pcap", [(video(i), NOON_NS, RADAR) for i in range(30)], tmp_path)
    columns, _, joined = read(data, cells=False)
    assert joined == b"" and columns["cells"].shape == (30, 0)
    assert_array_equal(columns["n_cells"], 20)


def test_streams_are_told_apart_and_what_is_no_radar_is_left_out(tmp_path: Path) -> None:
    sent: list[Sent] = []
    for i in range(64):
        sent += [(video(i), NOON_NS + i * 10**7, RADAR), (video(i), NOON_NS + i * 10**7, OTHER)]
        sent += [(b"$GPGGA,123519,4807.038,N*47\r\n", NOON_NS, GPS)]
    data = packed("pcap", sent, tmp_path)
    columns, damage, joined = read(data)
    assert damage == [] and joined == data
    assert np.bincount(columns["stream"]).tolist() == [64, 64]
    for wanted in ("239.0.1.3:8600", "239.0.1.3", "192.0.2.8", "192.0.2.8:5000"):
        assert set(read(data, stream=wanted)[0]["stream"].tolist()) == {1}
    assert read(data, stream=":4000")[0] == {} and len(read(data, stream=":8600")[0]["idx"]) == 128
    with pytest.raises(UsageError, match="ADDRESS"):
        open_cat240(octets(data), stream="a:b")


def frames(data: bytes, **config: Any) -> list[Frame]:
    return list(Cat240Source(octets(data), InputConfig(**config)).frames())


@pytest.mark.parametrize("tod", [12 * 3600 * 128, None])
def test_the_receive_time_gives_the_date_and_the_clock_where_none_was_sent(tmp_path: Path, tod: int | None) -> None:
    step_ns = 2_500_000_000 // 64
    sent = [
        (video(i, tod=None if tod is None else tod + i * 5), NOON_NS + i * step_ns, RADAR) for i in range(64 * 3)
    ]  # fmt: skip
    found = frames(packed("pcap", sent, tmp_path))
    assert len(found) == 3
    assert abs(found[0].scan.t_start_ns - NOON_NS) < 10_000_000
    assert abs(found[2].t_ns - (NOON_NS + 191 * step_ns)) < 10_000_000
    if tod is None:
        video_of = found[1].scan.video
        assert video_of is not None
        assert_array_equal(video_of.t_ns, NOON_NS + np.arange(64, 128) * step_ns)
    dated = frames(packed("pcap", sent, tmp_path), date="2001-02-03")
    assert dated[0].t_ns % (86_400 * 10**9) == found[0].t_ns % (86_400 * 10**9)
    assert np.datetime64(dated[0].t_ns, "ns").astype("datetime64[D]") == np.datetime64("2001-02-03")


def test_a_clock_of_receive_times_goes_on_after_midnight(tmp_path: Path) -> None:
    midnight = NOON_NS + 12 * 3600 * 10**9
    sent = [(video(i, tod=None), midnight + (i - 96) * 40_000_000, RADAR) for i in range(192)]
    found = frames(packed("pcap", sent, tmp_path))
    times = np.concatenate([f.scan.video.t_ns for f in found if f.scan.video is not None])
    assert_array_equal(times, midnight + (np.arange(192) - 96) * 40_000_000)


def test_one_sac_sic_in_two_streams_is_two_sensors(tmp_path: Path) -> None:
    sent: list[Sent] = []
    for i in range(130):
        t_ns = NOON_NS + i * 40_000_000
        sent += [(video(i, tod=None), t_ns, RADAR), (video(i, tod=None), t_ns, OTHER)]
    data = packed("pcap", sent, tmp_path)
    ids = {frame.scan.sensor.id for frame in frames(data)}
    assert ids == {"7-42", "7-42@239.0.1.3:8600"}
    assert {f.scan.sensor.id for f in frames(data, sensor="7-42@239.0.1.3:8600")} == {"7-42@239.0.1.3:8600"}
    assert {f.scan.sensor.id for f in frames(data, sensor="7-42")} == ids
    assert {f.scan.sensor.id for f in frames(data, stream="239.0.1.3")} == {"7-42"}


def datagrams(*payloads: bytes) -> Datagrams:
    n = len(payloads)
    bounds = np.concatenate([[0], np.cumsum([len(p) for p in payloads])]).astype(np.int64)
    zeros = np.zeros(n, np.int64)
    return Datagrams(1000, b"".join(payloads), bounds, 100 * np.arange(n), zeros + NO_TIME, zeros)


A, B = video(1), video(2)


@pytest.mark.parametrize(
    ("payload", "kept", "codes"),
    [
        (A, A, []),
        (A + B, A + B, []),
        (A + b"rest", A, ["lost-sync"]),
        (b"junk" + A + B, A + B, ["lost-sync"]),
        (A + B[:-3], A, ["truncated-block"]),
        (A + b"\xf0\x00\x02" + B, A + B, ["block-length<3"]),
        (A + b"\xf0\xff\xff" + B[3:], A, ["truncated-block"]),
        (b"\x30\x00\x05ab" + A, b"\x30\x00\x05ab" + A, []),
        (b"\xf0", b"", ["truncated-block"]),
        (b"", b"", []),
        (A + b"\xf0\x00\x01" + B + b"\xf0", A + B, ["block-length<3", "truncated-block"]),
    ],
)
def test_a_datagram_keeps_its_whole_blocks(payload: bytes, kept: bytes, codes: list[str]) -> None:
    found = whole_blocks(datagrams(B, payload, A))
    assert found.data == B + kept + A
    assert [one.code for one in found.damage] == codes
    for i in range(len(found)):
        at, end = int(found.bounds[i]), int(found.bounds[i + 1])
        whole = (B, payload, A)[int(found.offset[i]) // 100]
        begin = int(found.offset[i]) % 100 if int(found.offset[i]) < 200 else int(found.offset[i]) - 200
        assert whole[begin : begin + end - at] == found.data[at:end]


def test_a_stream_counts_from_the_first_block_it_shows() -> None:
    selection = Selection([RADAR])
    found = selection.take(datagrams(b"noise", A, b"noise again"))
    assert found.data == A + b"noise again" and selection.holding() == [0] and selection.counts == [3]
    assert Selection([RADAR]).take(datagrams(b"\xf0 is a letter too")).data == b""


def test_addresses_match_with_and_without_port() -> None:
    six = Stream("[fe80::1]:5000", "[ff02::1]:8600")
    assert all(matches(six, wanted) for wanted in ("fe80::1", "[fe80::1]", "[ff02::1]:8600", ":8600", ":5000"))
    assert not any(matches(six, wanted) for wanted in ("fe80::2", ":860", "8600", "[ff02::1]:1"))
    assert not matches(Stream(), ":1")


def test_bare_blocks_are_datagrams_of_their_own() -> None:
    data = b"junk" + A + B + b"\x30\x00\x05ab" + A[:-4]
    found = list(open_container(octets(data)).datagrams())
    payloads = [
        d.data[a:b] for d in found for a, b in zip(d.bounds[:-1].tolist(), d.bounds[1:].tolist(), strict=True)
    ]  # fmt: skip
    assert payloads == [A, B, b"\x30\x00\x05ab"]
    assert [int(at) for d in found for at in d.offset] == [4, 4 + len(A), 4 + len(A) + len(B)]
    assert [one.code for d in found for one in d.damage] == ["lost-sync", "truncated-block"]


def test_strict_names_the_place_in_the_container(tmp_path: Path) -> None:
    sent = [(video(i), NOON_NS, RADAR) for i in range(5)] + [(video(9)[:-1], NOON_NS, RADAR)]
    data = packed("pcap", sent, tmp_path)
    at = data.index(video(9)[:-1])
    assert read(data)[1] == [("truncated-block", at)]
    with pytest.raises(InputError, match=f"rec: .* at byte {at} \\(truncated-block\\)"):
        read(data, strict=True)


def test_the_head_tells_the_container(tmp_path: Path) -> None:
    sent = [(video(i), NOON_NS, RADAR) for i in range(3)]
    found = {kind: container_of(packed(kind, sent, tmp_path)) for kind in ("raw", *KINDS)}
    assert found == {"raw": "raw", "final": "FINAL", "pcap": "pcap", "mcap": "MCAP"}
    assert unpacked_head(gzip.compress(b"abc")) == b"abc" and unpacked_head(b"\x1f\x8b\x08?") == b""


@given(
    parts=st.lists(st.tuples(st.binary(max_size=8), st.integers(-1, 8)), max_size=8),
    cuts=st.lists(st.integers(0, 60), max_size=6),
)
@settings(derandomize=True, deadline=None)
def test_a_ledger_gives_every_octet_once(parts: list[tuple[bytes, int]], cuts: list[int]) -> None:
    ledger, taken = Ledger(), io.BytesIO()
    for part, span in parts:
        ledger.add(part, span)
    for cut in sorted(cuts):
        taken.write(ledger.cut(cut))
    taken.write(ledger.rest())
    assert taken.getvalue() == b"".join(part for part, _ in parts) and ledger.size == 0


def test_a_spin_without_any_time_still_turns() -> None:
    of = spin(3.0, tod=0)
    assert (of.t_ns == NO_TIME).all()


def test_workers_change_nothing(tmp_path: Path) -> None:
    cells = np.arange(64, dtype=np.uint8)
    sent = [
        (encode_video(sac=7, sic=42, idx=i, start_az=i % 65_536, end_az=i % 65_536, start_rg=0, cell_dur=66_712_819,
                      cells=cells + i % 7, tod=1000, compress=True), NOON_NS + i, RADAR)
        for i in range(9000)
    ]  # fmt: skip
    data = packed("pcap", sent, tmp_path)
    alone, together = read(data), read(data, workers=2)
    assert alone[1:] == together[1:]
    for name, column in alone[0].items():
        assert_array_equal(column, together[0][name])
