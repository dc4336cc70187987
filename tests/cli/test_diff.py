"""`maritrack diff`: equal, different, and wrong use."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.calling import call, spawn
from tests.cli.conftest import SCANS


@pytest.fixture(scope="module")
def other(finished_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same recording with another probability of detection."""
    folder = tmp_path_factory.mktemp("other") / "run"
    call("replay", finished_run, "--set", "model.p_detect=0.6", "-o", folder, "--no-rrd", "-q")
    return folder


def test_a_run_equals_itself(finished_run: Path) -> None:
    done = call("diff", finished_run, finished_run / "run.mcap")
    assert (done.code, done.out) == (0, f"equal, {SCANS} scans\n")
    assert call("diff", finished_run / "summary.json", finished_run).code == 0


def test_different_runs_show_the_first_difference_on_top(finished_run: Path, other: Path) -> None:
    done = spawn("diff", finished_run, other)
    assert done.code == 1 and done.err == ""
    lines = done.out.splitlines()
    assert lines[0].startswith("first: scan 0, tracks ")
    assert any(line.split()[:1] == ["gospa"] for line in lines)
    assert any("config.model.p_detect" in line for line in lines)


def test_json_is_one_document_and_all_means_all(finished_run: Path, other: Path) -> None:
    few, many = (call("diff", finished_run, other, "--json", *more).json for more in ((), ("--all",)))
    assert not few["equal"] and few["first"] == few["differences"][0] and len(few["differences"]) == 10
    assert few["count"] == many["count"] == len(many["differences"])
    assert few["metrics"]["gospa"]["delta"] == pytest.approx(
        few["metrics"]["gospa"]["b"] - few["metrics"]["gospa"]["a"]
    )


def test_markdown_is_tables(finished_run: Path, other: Path) -> None:
    lines = call("diff", finished_run, other, "--md").out.splitlines()
    assert "| metric | a | b | change |" in lines and "| --- | --- | --- | --- |" in lines


def test_only_metrics_leaves_tracks_out_and_the_other_way_round(finished_run: Path, other: Path) -> None:
    metrics = call("diff", finished_run, other, "--only", "metrics", "--json").json
    tracks = call("diff", finished_run, other, "--only", "tracks", "--json").json
    assert {d["where"] for d in metrics["differences"]} == {"metrics"}
    assert {d["where"] for d in tracks["differences"]} == {"tracks"} and tracks["metrics"] == {}


def test_within_the_tolerance_is_equal(finished_run: Path, tmp_path: Path) -> None:
    summary = json.loads((finished_run / "summary.json").read_text())
    summary["metrics"]["gospa"] *= 1 + 1e-9
    near = tmp_path / "near.json"
    near.write_text(json.dumps(summary))
    assert call("diff", finished_run, near, "--only", "metrics").code == 1
    assert call("diff", finished_run, near, "--only", "metrics", "--rtol", "1e-6").code == 0


def test_timing_and_outputs_do_not_count(finished_run: Path, tmp_path: Path) -> None:
    summary = json.loads((finished_run / "summary.json").read_text())
    moved = tmp_path / "moved.json"
    moved.write_text(json.dumps(summary | {"timing": {}, "outputs": {}}))
    assert call("diff", finished_run, moved).code == 0


def test_wrong_use_is_not_a_difference(finished_run: Path, sample: Path, tmp_path: Path) -> None:
    for path in (tmp_path / "nowhere", tmp_path, sample):
        done = call("diff", finished_run, path)
        assert done.code == 2 and str(path) in done.error
    assert call("diff", finished_run, finished_run, "--only", "nothing").code == 2
    assert call("diff", finished_run, finished_run, "--rtol", "-1").code == 2
    done = call("diff", finished_run / "summary.json", finished_run, "--only", "tracks")
    assert done.code == 2 and "summary" in done.error


def test_tolerances_and_junit(finished_run: Path, other: Path, tmp_path: Path) -> None:
    rules, report = tmp_path / "tol.toml", tmp_path / "out.xml"
    rules.write_text("rtol = 1e-9\n[metrics]\n'*' = 10.0\n[counts]\n'*' = 10.0\n")
    summary = finished_run / "summary.json"
    assert call("diff", summary, other, "--tolerances", rules, "--junit", report).code == 0
    assert (
        b'failures="0"' in report.read_bytes() and b'classname="maritrack.metrics" name="gospa"' in report.read_bytes()
    )
    assert call("diff", finished_run, other, "--tolerances", rules, "--junit", report).code == 1
    assert b"<failure" in report.read_bytes()
    rules.write_text("[metrics]\ngopsa = 1.0")
    done = call("diff", summary, other, "--tolerances", rules, "--md")
    assert done.code == 1 and done.err == f"note: {rules}: neither run has metrics.gopsa\n"
    assert "runs of another" not in done.out  # a summary says nothing of it
    rules.write_text("[nix]\na = 1")
    assert "unknown key 'nix'" in call("diff", summary, other, "--tolerances", rules).error
