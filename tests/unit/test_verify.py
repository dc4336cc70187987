"""A replay is compared with the run octet by octet."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from maritrack.types import Event, Result
from maritrack.verify import verify
from tests import runs


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return runs.archive(tmp_path_factory.mktemp("base") / "run.mcap", [runs.result(k) for k in range(4)])


def changed(path: Path, result: Result) -> Path:
    return runs.archive(path, [result if result.frame.k == k else runs.result(k) for k in range(4)])


def test_a_true_replay_is_equal_whatever_inputs_chunks_and_summary_are(base: Path, tmp_path: Path) -> None:
    results = [runs.result(k) for k in range(4)]
    replayed = runs.archive(tmp_path / "run.mcap", results, full=False, chunk_scans=1, summary={})
    found = verify(base, replayed)
    assert (found.equal, found.count, found.differences, found.n_scans) == (True, 0, (), 4)
    assert found.n_messages == 4 * 5 + 2 + 3  # truth in two scans, three log lines


def test_the_smallest_change_of_a_number_is_named(base: Path, tmp_path: Path) -> None:
    result = runs.result(2)
    velocity = result.tracks.velocity_mps.copy()
    velocity[1, 0] = np.nextafter(velocity[1, 0], np.inf)
    replayed = changed(tmp_path / "run.mcap", replace(result, tracks=replace(result.tracks, velocity_mps=velocity)))
    (only,) = verify(base, replayed).differences
    assert (only.where, only.k, only.what) == ("/tracks", 2, "id 7: velocity_mps")


def test_the_sign_of_a_zero_is_a_change(tmp_path: Path) -> None:
    paths: list[Path] = []
    for zero in (0.0, -0.0):
        scores = {**runs.result(0).scores, "ospa": zero}
        paths.append(runs.archive(tmp_path / f"{len(paths)}.mcap", [replace(runs.result(0), scores=scores)]))
    (only,) = verify(paths[0], paths[1]).differences
    assert (only.where, only.k, only.what) == ("/scores", 0, "message")


def test_another_line_of_the_log_is_a_change(base: Path, tmp_path: Path) -> None:
    events = (Event("info", "track", "scan 2"), Event("warning", "ingest", "another gap"))
    (only,) = verify(base, changed(tmp_path / "run.mcap", replace(runs.result(2), events=events))).differences
    assert tuple(only) == ("/log", 2, "message", "a gap", "another gap")


def test_a_missing_scan_is_named_and_the_rest_compared(base: Path, tmp_path: Path) -> None:
    replayed = runs.archive(tmp_path / "run.mcap", [runs.result(k) for k in (0, 2, 3)])
    assert [tuple(d) for d in verify(base, replayed).differences] == [("/scan", 1, "present", True, False)]


def test_a_replay_from_a_later_scan_is_compared_from_there(base: Path, tmp_path: Path) -> None:
    replayed = runs.archive(tmp_path / "run.mcap", [runs.result(k) for k in (2, 3)])
    assert verify(base, replayed, first_scan=2).equal
    assert verify(base, replayed, first_scan=2).n_scans == 2


def test_one_changed_octet_of_a_chunk_is_found(base: Path, tmp_path: Path) -> None:
    octets = bytearray(base.read_bytes())
    octets[len(octets) // 2] ^= 1
    (tmp_path / "run.mcap").write_bytes(octets)
    found = verify(tmp_path / "run.mcap", base)
    assert not found.equal
    assert found.differences[0].where == "archive"


def test_the_list_ends_and_the_count_does_not(base: Path, tmp_path: Path) -> None:
    replayed = runs.archive(tmp_path / "run.mcap", [runs.result(k, seed=1) for k in range(4)])
    found = verify(base, replayed, limit=3)
    assert len(found.differences) == 3
    assert found.count > 20
