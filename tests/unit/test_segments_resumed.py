"""Segments whose runs are interrupted, damaged or lost: nothing is told twice, in vain, or otherwise than without."""

from __future__ import annotations

from pathlib import Path

import pytest

from maritrack.io.archive import iter_results
from maritrack.sweep import batch as batches
from maritrack.sweep.batch import Cut, batch
from tests.unit.test_runon import document, joined, planned, told


def test_however_short_it_is_run_on_no_scan_is_told_twice(tmp_path: Path) -> None:
    path = tmp_path / "sea.json"
    path.write_text(document(30))
    found = joined(path, tmp_path / "out", Cut(segment_s=40.0, overlap_s=12.5, run_on_s=1e-12))
    assert [scan.k for scan in iter_results(found)] == list(range(30))


@pytest.mark.parametrize("part", ["0000.state", "0001.mcap", "0001-on.mcap", "0001.json", "0001-on.json"])
@pytest.mark.parametrize("how", ["cut", "altered", "gone"])
def test_what_is_damaged_before_it_is_joined_is_run_again(
    part: str, how: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, cut = tmp_path / "sea.json", Cut(segment_s=40.0, overlap_s=12.5)
    path.write_text(document(30))
    one = joined(path, tmp_path / "one", cut).read_bytes()
    monkeypatch.setattr(batches, "join", lambda _: interrupted())
    with pytest.raises(KeyboardInterrupt):
        joined(path, tmp_path / "two", cut)
    monkeypatch.undo()
    (file,) = tmp_path.glob(f"two/segments/*/{part}")
    damage(file, how)
    if part == "0000.state":
        file.with_name("0001-on.json").unlink()  # or it would not be read any more
    assert joined(path, tmp_path / "two", cut).read_bytes() == one


def damage(file: Path, how: str) -> None:
    octets = file.read_bytes()
    if how == "gone":
        file.unlink()
    else:
        file.write_bytes(octets[: len(octets) // 2] if how == "cut" else octets.replace(b'"end": ', b'"end": -') + b" ")


def test_what_was_run_on_in_vain_is_no_more_than_once_each(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, numbers, run_segment = tmp_path / "sea.json", list[tuple[int, bool]](), batches.run_segment
    path.write_text(document(40))
    monkeypatch.setattr(
        batches,
        "run_segment",
        lambda task: (numbers.append((task.segment.number, task.state != "")), run_segment(task))[1],
    )
    found = joined(path, tmp_path / "out", Cut(segment_s=12.5, overlap_s=2.5))  # too short to tell the same
    n = 1 + int(str(told(found)["run_again"]))
    assert n == 8 and sorted(set(numbers)) == sorted([(i, on) for i in range(n) for on in (False, True) if i or not on])
    assert len(numbers) == n + (n - 1) + (n - 2) and max(map(numbers.count, numbers)) == 2


def test_what_a_worker_writes_elsewhere_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "sea.json"
    path.write_text(document(30))
    monkeypatch.setattr(batches, "run_segment", lambda _: "")
    sizes, cut = {str(path): 1 << 30}, Cut(segment_s=40.0, overlap_s=12.5)
    (row,) = batch(planned(path), tmp_path / "out", cut, sizes=sizes).rows
    assert "all must see this folder under the same path" in row["error"]


def test_workers_and_interruptions_change_no_octet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, cut = tmp_path / "sea.json", Cut(segment_s=25.0, overlap_s=12.5)
    path.write_text(document(30))
    one = joined(path, tmp_path / "one", cut).read_bytes()
    run_segment = batches.run_segment
    monkeypatch.setattr(batches, "run_segment", lambda task: interrupted() if task.state else run_segment(task))
    with pytest.raises(KeyboardInterrupt):
        joined(path, tmp_path / "two", cut)
    monkeypatch.setattr(batches, "run_segment", lambda task: run_segment(task) if task.state else interrupted())
    assert joined(path, tmp_path / "two", cut).read_bytes() == one  # what is finished is not run again
    monkeypatch.undo()
    assert joined(path, tmp_path / "three", cut, workers=2).read_bytes() == one


def interrupted() -> str:
    raise KeyboardInterrupt
