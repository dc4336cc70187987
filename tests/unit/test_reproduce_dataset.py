"""The dataset experiment in small: its claims can be wrong, its errors are distances from AIS."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from maritrack.fanout import fan_out
from maritrack.reproduce import dataset, dataset_images, dataset_runs
from maritrack.reproduce.claims import Case, Plan
from maritrack.reproduce.dataset_claims import KEPT, LESS, at_most, both, by_seed, claims_of, lost, table_of
from maritrack.reproduce.dataset_images import Found
from maritrack.reproduce.dataset_runs import (
    EC,
    GATE,
    SCENES,
    STANDARD,
    TARGETS,
    TRACKERS,
    Run,
    run_case,
    without_dispersion,
)

Level = dict[tuple[str, str, str], float]
EASY = {("daan", "target-2"): 9.5, ("daan", "target-3"): 7.0, ("darc", "target-2"): 8.0,
        ("manv", "target-2"): 9.5, ("manv", "target-3"): 9.5}  # fmt: skip
GOOD = {(*of, tracker): 10.0 if tracker == STANDARD else level for of, level in EASY.items() for tracker in TRACKERS}


def holding(change: Level | None = None, *, zero: float = 0.0, found: int = 10, false: int = 0) -> dict[str, bool]:
    """Which statements hold with these mean errors, the same in every scan but for the seed."""
    level = GOOD | (change or {})
    runs = []
    for scene in SCENES:
        for tracker in TRACKERS:
            for seed in range(1, 6):
                error = {key: np.full(50, level[scene, key, tracker] + 0.1 * seed) for key in TARGETS[scene]}
                way = {key: np.zeros((50, 2)) for key in TARGETS[scene]}
                runs.append(Run(Case(scene, seed), tracker, np.arange(50.0), error, way))
    told = claims_of(runs, {"daan": 0.0, "darc": zero}, [Found(10, found, false)])
    return {claim.name: claim.holds for claim in told}


def test_statements_hold_where_their_numbers_do() -> None:
    found = holding()
    assert len(found) == 11 and all(found.values())


@pytest.mark.parametrize(
    ("change", "more", "part"),
    [
        ({("daan", "target-2", EC): 20.0}, {}, "daan: ec-jpda's mean"),
        ({("manv", "target-3", EC): 20.0}, {}, "manv: ec-jpda's mean"),
        ({("darc", "target-2", EC): 10.5}, {}, "darc: ec-jpda's mean position error is at most jpda's"),
        ({("darc", "target-2", EC): 9.5}, {}, "clearly lower"),
        ({("manv", "target-2", GATE): 15.0}, {}, "all points in the gate"),
        ({("manv", "target-2", EC): 8.5}, {}, "differ by at most"),
        ({("daan", "target-3", EC): 9.8}, {}, "hardly seen"),
        ({("daan", "target-2", EC): 400.0}, {}, "loses no target"),
        ({}, {"zero": 1e-3}, "zero dispersion"),
        ({}, {"found": 9}, "at least 95%"),
        ({}, {"false": 1}, "false blob"),
    ],
)
def test_each_statement_can_be_wrong(change: Level, more: dict[str, float], part: str) -> None:
    found = holding(change, **more)  # type: ignore[arg-type]
    assert [holds for name, holds in found.items() if part in name] == [False]


def test_errors_are_distances_from_ais_on_the_same_clusters() -> None:
    runs = run_case(Case("daan", 1, 40))
    assert [run.tracker for run in runs] == [*TRACKERS]
    for run in runs:
        way = run.way_m["target-2"]
        true = dataset_runs.the_scene("daan").others[0].course().at(run.time_s).position_m
        assert np.isfinite(run.error_m["target-2"][2:]).all()  # the first report comes in the second second
        assert (
            np.nanmax(np.abs(np.hypot(*(way - true).T) - run.error_m["target-2"])) < 2.0
        )  # AIS rounds and interpolates
        assert run.error_m["target-2"][10:].mean() < 30.0
    again = run_case(Case("daan", 1, 40))
    assert np.array_equal(again[0].way_m["target-3"], runs[0].way_m["target-3"], equal_nan=True)


def test_zero_dispersion_is_jpda_and_some_is_not() -> None:
    assert without_dispersion(Case("daan", 1, 20)) == 0.0
    a, b, c = run_case(Case("daan", 1, 20))
    assert np.nanmax(np.abs(a.way_m["target-2"] - b.way_m["target-2"])) > 0.01
    assert np.nanmax(np.abs(a.way_m["target-2"] - c.way_m["target-2"])) > 0.01


def test_a_target_that_one_tracker_loses_does_not_decide_for_the_other_seeds() -> None:
    level, runs = 10.0, []
    for tracker in TRACKERS:
        for seed in range(2, 8):
            far = 500.0 if (tracker, seed) == (STANDARD, 5) else 0.0
            error = {"target-2": np.full(50, level + far + 0.1 * seed + 0.2 * (tracker == EC))}
            runs.append(Run(Case("darc", seed), tracker, np.arange(50.0), error, {}))
    found = both(runs, "darc")
    assert found[LESS]["mean"] < -80.0 and found[KEPT][LESS]["runs"] == 5
    assert found[KEPT][LESS]["mean"] == pytest.approx(0.2) and not at_most(found)
    assert lost(runs, "darc", STANDARD).sum() == 1 and not lost(runs, "darc", EC).any()


def test_a_screenshot_is_judged_by_who_is_in_it() -> None:
    seen = [dataset_images.judged(frame) for frame in (("daan", 100, 1), ("manv", 300, 1))]
    assert sum(s.vessels for s in seen) >= 3
    assert sum(s.found for s in seen) <= sum(s.vessels for s in seen)
    assert len(dataset_images.frames(4)) == 12


def test_a_report_has_claims_table_and_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def short(case: Case) -> tuple[Run, ...]:
        return run_case(Case(case.scene, case.seed, 12))

    monkeypatch.setattr(dataset, "run_case", short)
    monkeypatch.setattr(dataset, "ZERO_SCANS", 5)
    monkeypatch.setattr(dataset, "QUICK_SCREENSHOTS", 1)
    monkeypatch.setattr(dataset, "fan_out", lambda run, work, **_: fan_out(run, work, workers=1))
    report = dataset.reproduce(Plan(quick=True, seeds=1, out=tmp_path))
    assert len(report.claims) == 11 and len(report.tables["errors"].rows) == 15
    assert sorted(report.figures) == ["figure_6", "figure_7", "figure_8", "figure_9"]
    assert all(path.stat().st_size > 5000 for path in report.figures.values())
    runs = [run for scene in SCENES for run in short(Case(scene, dataset.FIRST))]
    assert table_of(runs).rows[0][3] == pytest.approx(by_seed(runs, "daan", EC, "target-2")[0])
