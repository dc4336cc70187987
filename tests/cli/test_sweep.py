"""`maritrack sweep` and `maritrack table` as from a shell."""

from __future__ import annotations

import io
import sys
import time
from pathlib import Path

import pyarrow as pa  # type: ignore[import-untyped]
import pytest
from maritrack_cli import render
from pyarrow import parquet

from tests.cli.calling import call, start
from tests.shared import ROOT

FERRY = ROOT / "data" / "samples" / "autoferry13_detections.json"
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study")
    done = call("sweep", FERRY, "--grid", "tracker=sprt,jipda", "--limit", "4", "-o", folder, "--workers", "1")
    assert done.code == 0 and done.err == "", done.err
    assert "2 runs, 0 of them finished before, 0 failed" in done.out and f"maritrack table {folder}" in done.out
    return folder


def test_a_sweep_goes_on_where_it_was(study: Path) -> None:
    again = call(
        "sweep", FERRY, "--grid", "tracker=sprt,jipda", "--limit", "4", "-o", study, "--workers", "1", "--json"
    ).json
    assert (again["runs"], again["reused"], again["failed"]) == (2, 2, 0)
    assert [row["tracker"] for row in again["rows"]] == ["sprt", "jipda"]
    assert "limit = 4" in again["rows"][0]["config"]


@pytest.mark.parametrize(("option", "told"), [((), "false"), (("--moving",), "true")])
def test_moving_tracks_only_are_scored_where_that_is_asked_for(
    option: tuple[str, ...], told: str, tmp_path: Path
) -> None:
    command = ("sweep", FERRY.with_name("harbour.cat240"), "--limit", "1", "-o", tmp_path, "--workers", "1", "--json")
    (row,) = call(*command, *option).json["rows"]
    assert f"moving_only = {told}" in row["config"]


def test_chosen_ships_are_all_the_truth_of_a_sweep(tmp_path: Path) -> None:
    def n_truth(*more: str) -> float:
        done = call("sweep", FERRY, "--limit", "4", "-o", tmp_path / str(len(more)), "--workers", "1", "--json", *more)
        (row,) = done.json["rows"]
        return float(row["metrics"]["n_truth"])

    assert (n_truth(), n_truth("--truth-match", "1")) == (2.0, 1.0)


def test_a_scene_of_points_is_swept_as_points(tmp_path: Path) -> None:
    done = call("sweep", "daan", "--scans", "3", "-o", tmp_path, "--workers", "1", "--json")
    assert [(row["kind"], row["preset"]) for row in done.json["rows"]] == [("points", "points")]


def test_a_table_tells_groups_and_differences(study: Path, tmp_path: Path) -> None:
    picture = tmp_path / "study.png"
    done = call("table", study, "--by", "tracker", "--metric", "gospa", "--against", "sprt", "--plot", picture)
    assert done.code == 0 and "gospa: mean over inputs" in done.out and "gospa: minus that of sprt" in done.out
    assert "p can't be below 1 here" in done.out  # of one input
    assert picture.read_bytes()[:8] == PNG
    told = call("table", study, "--metric", "gospa", "--metric", "switches", "--json").json
    assert [group["values"] for group in told["groups"]] == [["sprt"], ["jipda"]] and len(told["paired"]) == 2
    assert "| tracker | runs | inputs | mean | from | to |" in call("table", study, "--md").out


def test_a_table_over_a_number_is_drawn_along_it(tmp_path: Path) -> None:
    folder, picture = tmp_path / "s", tmp_path / "p.png"
    call("sweep", FERRY, "--grid", "model.p_detect=0.6:0.8:0.2", "--limit", "2", "-o", folder, "--workers", "1")
    assert call("table", folder, "--by", "model.p_detect", "--plot", picture).code == 0
    assert picture.read_bytes()[:8] == PNG


def test_wrong_use_is_one_line(study: Path, tmp_path: Path) -> None:
    assert "no such file" in call("sweep", tmp_path / "none.cat240", "-o", tmp_path / "o").error
    assert "no column 'nix'" in call("table", study, "--metric", "nix").error
    assert "no table of runs" in call("table", tmp_path).error
    parquet.write_table(pa.table({"run_id": ["1"]}), str(tmp_path / "results.parquet"))
    assert "a table, but not of runs" in call("table", tmp_path).error
    assert call("sweep", FERRY, "--grid", "tracker=nix", "-o", tmp_path / "o").code == 2
    assert call("sweep", FERRY).code == 2  # nowhere to write to
    assert "--seeds" in call("sweep", FERRY, "--seeds", "x", "-o", tmp_path / "o").error


def test_seeds_of_a_recording_are_said_to_change_nothing(tmp_path: Path) -> None:
    done = call("sweep", FERRY, "--seeds", "0:2", "--limit", "2", "-o", tmp_path, "--workers", "1")
    assert done.code == 0 and "no tracker draws random numbers" in done.err


def test_a_sweep_that_was_killed_goes_on(tmp_path: Path) -> None:
    command = ("sweep", FERRY, "--grid", "model.p_detect=0.5:0.9:0.02", "-o", tmp_path, "--workers", "1", "--json")
    with start(*command) as process:
        while len(list(tmp_path.glob("rows/*.json"))) < 2 and process.poll() is None:
            time.sleep(0.02)
        process.kill()
        process.wait()
    before = {path.name: path.stat().st_mtime_ns for path in tmp_path.glob("rows/*.json")}
    assert 2 <= len(before) < 21
    again = call(*command).json
    assert (again["runs"], again["reused"], again["failed"]) == (21, len(before), 0)
    assert all((tmp_path / "rows" / name).stat().st_mtime_ns == at for name, at in before.items())


def test_what_failed_is_tried_again_when_asked_and_that_is_said(tmp_path: Path) -> None:
    missing, out = tmp_path / "rec.json", tmp_path / "o"
    command = ("sweep", missing, FERRY, "--limit", "2", "-o", out, "--workers", "1")
    assert "--retry-failed" in call(*command).out and "--retry-failed" in call(*command).out
    missing.write_text(FERRY.read_text().replace('"sensorID":', '"sensorID": '))
    done = call(*command, "--retry-failed").out
    assert "2 runs, 1 of them finished before, 0 failed" in done and "--retry-failed" not in done


class Terminal(io.StringIO):
    """Standard error of somebody who looks at it."""

    def isatty(self) -> bool:
        return True


def test_progress_tells_done_failed_rate_and_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = Terminal()
    monkeypatch.setattr(sys, "stderr", shown)
    now = iter([100.0, 100.0, 104.0])
    monkeypatch.setattr(time, "monotonic", lambda: next(now))
    with render.runs(quiet=False) as tick:
        tick(24, 1, 40)  # finished before
        tick(32, 1, 40)  # the first piece is of eight runs
    first, second = shown.getvalue().split("\r\x1b[2K")[1:3]
    assert first == "runs 24 of 40  1 failed" and second == "runs 32 of 40  1 failed  2/s  4 s left"
    with render.runs(quiet=True) as tick:
        assert tick is None
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with render.runs(quiet=False) as tick:
        assert tick is None
