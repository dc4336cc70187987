"""`maritrack score`: the same numbers, other settings, other truth, limits."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.cli.calling import call, spawn
from tests.cli.conftest import SCANS


@pytest.fixture
def summary(finished_run: Path) -> Any:
    return json.loads((finished_run / "summary.json").read_text())


def test_equal_settings_give_the_numbers_of_the_summary(finished_run: Path, summary: Any) -> None:
    document = spawn("score", finished_run, "--json").json
    assert document["metrics"] == summary["metrics"]
    assert document["objects"] == summary["objects"]
    assert document["scans"] == SCANS


def test_what_points_scored_is_told_where_they_are_not_archived(sample: Path, tmp_path: Path) -> None:
    told = ("--limit", "4", "--no-rrd", "-q", "--json", "-o", tmp_path, "--set", "output.archive_points=false")
    metrics = call("process", sample, *told).json["metrics"]
    assert 0.0 < metrics["npv"] < 1.0
    assert call("score", tmp_path, "--json").json["metrics"] == metrics
    wider = call("score", tmp_path, "--set", "score.box_margin_m=50.0", "--json").json["metrics"]
    assert {"fpr", "npv"} <= metrics.keys() - wider.keys()


def test_the_archived_truth_document_gives_the_numbers_of_the_summary(
    finished_run: Path, sample: Path, summary: Any
) -> None:
    truth = sample.with_name("harbour.truth.json")
    assert call("score", finished_run, "--truth", truth, "--json").json["metrics"] == summary["metrics"]


def test_a_setting_that_changes_truth_without_effect_changes_no_number(finished_run: Path, summary: Any) -> None:
    document = call("score", finished_run, "--set", "score.truth_max_m=1e6", "--json").json
    assert document["score"]["truth_max_m"] == 1e6 and document["metrics"] == summary["metrics"]


@pytest.mark.parametrize("reach", [(), ("--set", "score.truth_max_m=20000")])
def test_only_ships_in_the_region_of_interest_count(sample: Path, tmp_path: Path, reach: tuple[str, ...]) -> None:
    """Of the harbour the ferry is nearer than 1 km, yacht, coaster, container and tug are beyond 2.1 km."""
    region = ("--set", "input.roi_min_m=1000", "--set", "input.roi_max_m=2100", *reach)
    done = call("process", sample, "--limit", "4", *region, "-o", tmp_path / "run", "--no-rrd", "--json", "-q").json
    inside = ["boat-1", "boat-2", "buoy-1", "buoy-2", "trawler"]
    assert sorted(row["id"] for row in done["objects"]) == inside and done["metrics"]["n_truth"] == 5.0
    again = call("score", tmp_path / "run", "--truth", sample.with_name("harbour.truth.json"), "--json").json
    assert again["metrics"] == done["metrics"] and again["objects"] == done["objects"]


def test_other_settings_equal_a_replay_with_them(finished_run: Path, tmp_path: Path) -> None:
    sets = ("--set", "score.c_m=40", "--set", "score.hold_m=30")
    scored = call("score", finished_run, *sets, "--json").json
    replayed = call("replay", finished_run, *sets, "-o", tmp_path, "--no-rrd", "--no-mcap", "--json", "-q").json
    assert scored["metrics"] == replayed["metrics"] and scored["objects"] == replayed["objects"]


def test_reports_that_are_late_move_the_truth(finished_run: Path, summary: Any) -> None:
    document = call("score", finished_run, "--truth-lag", "boat-1=-9", "--truth-lag", "boat-2=-9", "--json").json
    assert document["score"]["truth_lag_s"] == "boat-1=-9,boat-2=-9"
    assert document["metrics"] != summary["metrics"]


def test_moving_scores_only_what_moves(finished_run: Path, summary: Any) -> None:
    document = call("score", finished_run, "--moving", "--json").json
    assert document["metrics"]["n_tracks"] < summary["metrics"]["n_tracks"]


@pytest.mark.parametrize(("limit", "code"), [("gospa=1", 1), ("gospa.mean=1", 1), ("gospa=1e9", 0)])
def test_a_limit_that_is_exceeded_fails(finished_run: Path, limit: str, code: int) -> None:
    done = call("score", finished_run, "--fail-over", limit, "--json")
    assert done.code == code
    assert done.json["limits"][0]["exceeded"] is bool(code)


def test_objects_are_listed_where_asked_for(finished_run: Path) -> None:
    assert "MARIE GALANTE" in call("score", finished_run, "--objects").out
    assert "MARIE GALANTE" not in call("score", finished_run).out


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--fail-over", "nonsense=1"), "nonsense"),
        (("--fail-over", "gospa"), "METRIC=NUMBER"),
        (("--set", "model.p_detect=0.5"), "score."),
        (("--set", "score.c_n=5"), "c_m"),
        (("--truth", "nowhere.csv"), "nowhere.csv"),
        (("--truth-lag", "boat-1"), "boat-1"),
    ],
)
def test_wrong_use_is_told_in_one_line(finished_run: Path, arguments: tuple[str, ...], told: str) -> None:
    done = call("score", finished_run, *arguments)
    assert done.code == 2 and told in done.error


def test_points_taken_away_are_counted_again_as_in_the_run(sample: Path, tmp_path: Path) -> None:
    sets = ("--set", "subtract.method=abs", "--set", "subtract.threshold=0", "--set", "subtract.start=empty")
    done = call("process", sample, *sets, "--limit", "12", "--no-rrd", "-o", tmp_path, "--json", "-q").json
    assert 0.0 < done["metrics"]["npv"] < 1.0 and 0.0 <= done["metrics"]["fpr"] < 1.0
    assert call("score", tmp_path, "--json").json["metrics"] == done["metrics"]
    wide = call("score", tmp_path, "--set", "score.box_margin_m=30", "--json").json["metrics"]
    assert wide["npv"] > done["metrics"]["npv"]
