"""The study of trackers: the scores of ordinary runs, in any number of workers, whatever fails."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from maritrack.errors import ConfigError, UsageError
from maritrack.job import Job, run_silently
from maritrack.recording import open_inputs
from maritrack.settings import Config
from maritrack.tune import tracking
from maritrack.tune.tracking import Row, configurations, run_piece, study, subjects
from tests.shared import ROOT

SAMPLES = ROOT / "data" / "samples"
HARBOUR, FERRY = SAMPLES / "harbour.cat240", SAMPLES / "autoferry13_detections.json"


def grid(axes: Mapping[str, Any], *sets: str, preset: str = "radar") -> list[tuple[dict[str, Any], Config | str]]:
    return configurations(axes, preset=preset, file=None, sets=["input.limit=4", *sets], over={})


def test_scores_are_those_of_ordinary_runs() -> None:
    """Points are detected once for several runs; nothing else may notice that the video is gone."""
    tried = grid({"tracker_name": ("jipda", "sprt"), "detect.threshold": (0.0, 0.3)})
    (harbour,) = subjects([HARBOUR])
    for row in study([harbour], tried, by="gospa"):
        config = tried[row.number][1]
        assert isinstance(config, Config)
        job = Job(
            octets=open_inputs([HARBOUR]), kinds=["cat240"], input_sha256=[""], side=harbour.side, config=config,
            name="harbour",
        )  # fmt: skip
        summary, _ = run_silently(job, ())
        assert {name: row.metrics[name] for name in summary["metrics"]} == summary["metrics"]
        assert row.metrics["switches"] == sum(o["switches"] for o in summary["objects"])


def test_the_answer_is_the_same_for_any_number_of_workers() -> None:
    ferry = subjects([FERRY])
    tried = grid({"model.p_detect": (0.5, 0.7, 0.9), "tracker.delete_misses": (4, 8)}, preset="autoferry")
    one, two = (study(ferry, tried, by="ospa", workers=workers) for workers in (1, 2))
    assert one == two
    ospa = [row.metrics["ospa"] for row in one]
    assert ospa == sorted(ospa) and len({row.number for row in one}) == 6


def test_a_run_that_fails_is_a_row_and_stops_nothing() -> None:
    """At reading, in the run, and in settings that don't go together."""
    harbour = subjects([HARBOUR])
    rows = study(harbour, grid({"input.sensor": ("9-9", "")}), by="gospa")
    assert [bool(row.error) for row in rows] == [False, True] and "no sensor '9-9'" in rows[1].error
    rows = study(harbour, grid({"input.from_s": (1e6, 0.0)}), by="gospa")
    assert [bool(row.error) for row in rows] == [False, True] and "no scan in it" in rows[1].error
    rows = study(harbour, grid({"model.min_axis_m": (2.0, 60.0), "model.max_axis_m": (50.0, 90.0)}), by="gospa")
    assert [row.error for row in rows] == ["", "", "", "model: 0 < min_axis_m < max_axis_m"]
    assert rows[3].values == {"model.min_axis_m": 60.0, "model.max_axis_m": 50.0} and rows[3].metrics == {}


def test_a_bug_in_one_run_is_a_row_that_names_its_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(job: Job, *_: Any, **__: Any) -> Any:
        if job.config.model.p_detect < 0.8:
            raise ZeroDivisionError("of nothing")
        return run_silently(job, *_, **__)

    monkeypatch.setattr(tracking, "run_silently", broken)
    rows = study(subjects([HARBOUR]), grid({"model.p_detect": (0.7, 0.9)}), by="gospa")
    assert [row.error for row in rows] == ["", "ZeroDivisionError: of nothing"]


def test_an_interruption_ends_the_study(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracking, "run_silently", lambda *_, **__: ({"interrupted": True}, None))
    with pytest.raises(KeyboardInterrupt):
        study(subjects([HARBOUR]), grid({"model.p_detect": (0.7,)}), by="gospa")


@pytest.mark.parametrize(
    ("axes", "told"),
    [
        ({"model.p_detec": (0.7,)}, "^--grid model.p_detec=0.7: .*p_detec"),
        ({"nosuch.key": (1, 2)}, "^--grid nosuch.key=1: unknown key 'nosuch'"),
        ({"model.p_detect": (0.7, 1.5)}, "^--grid model.p_detect=1.5: .*p_detect = 1.5"),
        ({"model.p_detect": ("high",)}, "high"),
        ({"tracker_name": ("jipda", "jida")}, "^--tracker jida: no tracker 'jida'"),
    ],
)
def test_what_is_wrong_by_itself_is_told_before_any_run(axes: dict[str, Any], told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        grid(axes)


def test_recordings_weigh_the_same_and_switches_add_up(tmp_path: Path) -> None:
    twice = subjects([HARBOUR, HARBOUR])
    (row,) = study(twice, grid({"model.p_detect": (0.9,)}), by="gospa")
    (once,) = study(twice[:1], grid({"model.p_detect": (0.9,)}), by="gospa")
    assert len(row.by_recording) == 2 and row.metrics["gospa"] == once.metrics["gospa"]
    assert row.metrics["switches"] == 2 * once.metrics["switches"]
    mixed = Row(0, {}, tracking._mean([{"gospa": 1.0, "switches": 2.0, "a": 0.0}, {"gospa": 3.0, "switches": 3.0}]), ())
    assert mixed.metrics == {"gospa": 2.0, "switches": 5.0}


def test_one_truth_for_each_recording_or_none(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="1 --truth for 2 recordings"):
        subjects([HARBOUR, HARBOUR], truth=[SAMPLES / "harbour.truth.json"])
    with pytest.raises(UsageError, match="different kinds"):
        subjects([HARBOUR, FERRY])
    with pytest.raises(UsageError, match="standard input"):
        subjects([Path("-")])
    alone = tmp_path / "alone.cat240"
    alone.write_bytes(HARBOUR.read_bytes()[:200_000])
    with pytest.raises(UsageError, match="no truth"):
        study(subjects([alone]), grid({"model.p_detect": (0.7,)}), by="gospa")
    with pytest.raises(UsageError, match="no such metric"):
        study(subjects([HARBOUR]), grid({"model.p_detect": (0.7,)}), by="gosspa")


def test_a_recording_is_read_once_for_several_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    opened = []
    reading = tracking.open_recording
    monkeypatch.setattr(tracking, "open_recording", lambda *a, **k: opened.append(a) or reading(*a, **k))
    (harbour,) = subjects([HARBOUR])
    configs = {i: c for i, (_, c) in enumerate(grid({"model.p_detect": (0.7, 0.8, 0.9)})) if isinstance(c, Config)}
    (piece,) = tracking._pieces(0, harbour, configs, 1)
    assert [i for i, _ in run_piece(piece)] == [0, 1, 2] and len(opened) == 1
    assert [len(p.runs) for p in tracking._pieces(0, harbour, configs, 2)] == [2, 1]
