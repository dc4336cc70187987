"""`--background` and `--save-background`: a known harbour starts with its mask, also in a replay."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from maritrack.io.archive import iter_results
from tests.cli.calling import call
from tests.shared import ROOT

HARBOUR = ROOT / "data" / "samples" / "harbour.cat240"


def kept(run: Path) -> list[float]:
    """Share of the points that background subtraction left, scan by scan."""
    return [float(scan.keep.mean()) for scan in iter_results(run / "run.mcap") if scan.keep is not None]


@pytest.fixture(scope="module")
def snapshot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("first")
    path = folder / "harbour.npz"
    done = call(
        "process", HARBOUR, "--limit", "16", "--save-background", path, "-o", folder, "--no-rrd", "-q", "--json"
    )
    assert done.code == 0 and done.json["outputs"]["background"] == str(path)
    assert min(kept(folder)[:9]) == 1.0 and kept(folder)[15] < 0.5  # ten scans in a row are background
    return path


def test_a_known_harbour_starts_with_its_mask_and_replays(snapshot: Path, tmp_path: Path) -> None:
    told = ("--limit", "4", "--no-rrd", "-q", "--json", "-o", tmp_path)
    done = call("process", HARBOUR, "--background", snapshot, *told)
    assert done.code == 0 and max(kept(tmp_path)) < 0.5
    assert call("replay", tmp_path, "--verify", "-q").code == 0
    without = call("process", HARBOUR, *told)
    assert without.json["run_id"] != done.json["run_id"]


def test_a_background_of_another_sensor_is_warned_of(snapshot: Path, tmp_path: Path) -> None:
    told = ("process", HARBOUR, "--limit", "3", "--no-rrd", "-q", "-o", tmp_path)
    done = call(*told, "--background", snapshot, "--set", "subtract.masks=joint")
    assert done.code == 0 and "the background of '7-42' was of no use" in done.out
    assert "background-unused" not in call(*told, "--background", snapshot).out


def test_what_is_no_snapshot_is_one_line(snapshot: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.npz"
    bad.write_bytes(snapshot.read_bytes()[:300])
    told = ("--limit", "2", "--no-rrd", "--no-mcap", "-q", "-o", tmp_path)
    assert call("process", HARBOUR, "--background", bad, *told).error.startswith(f"{bad}: no snapshot of a background")
    assert "no such file" in call("process", HARBOUR, "--background", tmp_path / "none.npz", *told).error.lower()
    grid = call("process", HARBOUR, "--background", snapshot, "--set", "subtract.pixel_m=30.0", *told)
    assert grid.code == 2 and "pixels of 100.0 m" in grid.error
    nothing = call("process", HARBOUR, "--background", snapshot, "--set", "subtract.method=none", *told)
    assert nothing.code == 2 and "nothing is subtracted" in nothing.error
    nowhere = call("process", HARBOUR, "--save-background", tmp_path / "no" / "b.npz", *told)
    assert nowhere.code == 2 and nowhere.error
    wrong = call("process", HARBOUR, "--background", bad, "--no-mcap", "-q", "-o", tmp_path / "fresh")
    assert wrong.code == 2 and not (tmp_path / "fresh").exists()


def test_a_run_that_saves_is_not_skipped_for_an_equal_one(snapshot: Path, tmp_path: Path) -> None:
    told = ("process", HARBOUR, "--limit", "3", "--no-rrd", "-q", "--json", "-o", tmp_path)
    first = call(*told)
    assert call(*told, "--save-background", tmp_path / "b.npz").code == 0 and (tmp_path / "b.npz").is_file()
    assert json.loads((tmp_path / "summary.json").read_text())["run_id"] == first.json["run_id"]


def test_a_run_whose_tracking_never_starts_says_so(tmp_path: Path) -> None:
    told = ("process", HARBOUR, "--limit", "3", "--no-rrd", "-q", "--set", "subtract.track_from=converged")
    done = call(*told, "-o", tmp_path / "a")
    assert done.code == 0 and "tracking-not-started" in done.out and "subtract.half_life_scans" in done.out
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert summary["counts"]["tracks"] == 0 and summary["counts"]["warnings"]["tracking-not-started"] == 1
    assert 'subtract.track_from = "start"' in summary["warnings"]["tracking-not-started"]["message"]
    assert call("replay", tmp_path / "a", "--verify", "-q").code == 0
