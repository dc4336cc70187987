"""Recordings that are read from the middle: what they tell is what is told of the whole."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from maritrack.simulate.record import simulate
from maritrack.simulate.scenes import load_scene
from maritrack.sweep.batch import Cut
from maritrack.sweep.places import index, place_of, positioned
from maritrack.sweep.sources import opened
from tests.unit.test_runon import in_one_piece, joined, planned

SCANS = 36


@pytest.fixture(scope="module")
def blocks(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    """The data blocks of the harbour with few spokes, one each, a minute and a half long."""
    scene = load_scene("harbour")
    scene = replace(scene, radar=replace(scene.radar, spokes=128, cells=200))
    path = tmp_path_factory.mktemp("rec") / "harbour.cat240"
    simulate(scene, path, seed=3, scans=SCANS, ais=False, labels=False)
    octets, at, found = path.read_bytes(), 0, list[bytes]()
    while at < len(octets):
        found.append(octets[at : at + int.from_bytes(octets[at + 1 : at + 3], "big")])
        at += len(found[-1])
    return found


def test_behind_a_silence_scans_are_those_of_the_whole(blocks: list[bytes], tmp_path: Path) -> None:
    """Their segments are counted from the beginning of the recording."""
    turn, path = len(blocks) // SCANS, tmp_path / "silent.cat240"
    path.write_bytes(b"".join(blocks[: 8 * turn] + blocks[24 * turn :]))
    (run,) = planned(path)
    found = index(run)
    assert not isinstance(found, str) and set(found.part.tolist()) == {0, 1}
    scans = [scan for scan in range(len(found)) if found.part[scan] == 1][2:]
    for scan in (scans[0], scans[-1]):
        place = place_of(found, scan)
        assert place.octet > 0
        with opened(run.source, seed=0) as once, opened(run.source, seed=0) as again:
            ours, theirs = (next(positioned(run, o, p)[0].frames).scan
                            for o, p in ((once, place), (again, replace(place, octet=0))))  # fmt: skip
        assert (ours.t_ns, ours.segment) == (theirs.t_ns, theirs.segment) == (place.t_ns, 1)


@pytest.mark.parametrize("run_on_s", [0.0, 10.0])
def test_damage_is_told_once_and_where_it_is_in_the_recording(
    run_on_s: float, blocks: list[bytes], tmp_path: Path
) -> None:
    turn, path = len(blocks) // SCANS, tmp_path / "damaged.cat240"
    some = list(blocks)
    for scan in (18, 19, 32):  # both sides of a seam, and behind it
        some[scan * turn - 2] = some[scan * turn - 2][:30]
    path.write_bytes(b"".join(some))
    found = joined(path, tmp_path / "joined", Cut(segment_s=46.0, overlap_s=15.0, run_on_s=run_on_s))
    ours, theirs = (json.loads(archive.with_name("summary.json").read_text())
                    for archive in (found, in_one_piece(path, tmp_path / "whole")))  # fmt: skip
    assert len(ours["segments"]["seams"]) == 1 and len(ours["warnings"]) > 0
    assert (ours["warnings"], ours["counts"]["warnings"]) == (theirs["warnings"], theirs["counts"]["warnings"])
