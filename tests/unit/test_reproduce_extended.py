"""The extended experiment in small: its claims can be wrong, its numbers are those of the scores of a run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from maritrack.fanout import fan_out
from maritrack.reproduce import extended, extended_claims, extended_runs
from maritrack.reproduce.claims import Case, Plan
from maritrack.reproduce.extended_claims import PAPER, bound, claims_of, interval, ratio
from maritrack.reproduce.extended_runs import GP, JIPDA, SCENES, SCORES, SHIPS, TEST_1, TEST_2, TRACKERS, Run

SCANS = 250
Level = dict[tuple[str, str], dict[str, float]]


def fake(scene: str, tracker: str, seed: int, level: dict[str, float], ms: float) -> Run:
    """A run with the same scores in every scan, jipda's localisation larger at the end."""
    scores = {name: np.full(SCANS, level[name] * (1.0 + 0.01 * (seed % 3))) for name in SCORES}
    if tracker == JIPDA:
        scores["gospa_localisation"][150:] *= 1.2
    return Run(Case(scene, seed), tracker, scores, np.full(SCANS, ms), ())


def holding(change: Level | None = None, ms: dict[str, float] | None = None) -> dict[str, bool]:
    """Which statements hold where the numbers are the paper's, but for what is changed."""
    levels = {key: {**row, **(change or {}).get(key, {})} for key, row in PAPER.items()}
    ms = ms or {GP: 100.0, JIPDA: 2.0}
    runs = [fake(*key, seed, row, ms[key[1]]) for key, row in levels.items() for seed in range(1, 6)]
    return {claim.name: claim.holds for claim in claims_of(runs)}


def test_all_statements_hold_with_the_papers_numbers_but_that_they_fulfil_the_definition() -> None:
    found = holding()
    assert len(found) == 16
    assert [name for name, holds in found.items() if not holds] == [
        "the paper's means of GOSPA are possible with its means of the parts, c = 10 and p = 2"
    ]


@pytest.mark.parametrize(
    ("key", "score", "value", "part"),
    [
        ((SHIPS, GP), "gospa_localisation", 6.0, "at most 1/1.5"),
        ((SHIPS, GP), "iou", 0.55, "IoU is at least 0.60"),
        ((SHIPS, JIPDA), "iou", 0.65, "simulation: gp-pmbm's hulls cover"),
        ((SHIPS, JIPDA), "gospa_false", 0.4, "fewer false targets"),
        ((SHIPS, GP), "gospa", 5.0, "simulation: gp-pmbm has the lower GOSPA"),
        ((TEST_1, GP), "gospa", 5.0, "test 1: gp-pmbm has the lower GOSPA"),
        ((TEST_1, GP), "gospa_localisation", 5.0, "test 1: gp-pmbm has the lower localisation"),
        ((TEST_1, GP), "iou", 0.01, "test 1: gp-pmbm's hulls cover"),
        ((TEST_2, GP), "gospa", 4.0, "the order turns"),
        ((TEST_2, GP), "gospa_localisation", 4.0, "with much wake jipda has the lower localisation"),
        ((TEST_2, GP), "iou", 0.9, "lead in IoU is least"),
    ],
)
def test_each_statement_can_be_wrong(key: tuple[str, str], score: str, value: float, part: str) -> None:
    before, after = holding(), holding({key: {score: value}})
    assert [before[name] and not after[name] for name in before if part in name] == [True]


def test_statements_on_cpu_can_be_wrong() -> None:
    slow = holding(ms={GP: 151.0, JIPDA: 20.0})
    wrong = {name for name, holds in slow.items() if not holds and "possible with" not in name}
    assert len(wrong) == 3 and all("CPU" in name or "fast" in name for name in wrong)


def test_without_a_rise_at_the_end_jipda_does_not_struggle() -> None:
    runs = [fake(*key, seed, row, 1.0) for key, row in PAPER.items() for seed in (1, 2, 3)]
    flat = [replace(r, scores={**r.scores, "gospa_localisation": np.full(SCANS, 3.0 + r.case.seed)}) for r in runs]
    assert [c.holds for c in claims_of(flat) if "after scan 150" in c.name] == [False]


def test_half_of_the_papers_columns_do_not_fulfil_the_definition() -> None:
    impossible = {key for key, row in PAPER.items() if row["gospa"] > bound(row) + 0.01}
    assert impossible == {(SHIPS, JIPDA), (TEST_2, GP), (TEST_2, JIPDA)}


def test_intervals_hold_what_they_say() -> None:
    rng = np.random.default_rng(1)
    draws = rng.normal(3.0, 2.0, (2000, 8))
    inside = [(told := interval(x))["low"] <= 3.0 <= told["high"] for x in draws]
    assert np.mean(inside) == pytest.approx(0.95, abs=0.015)
    assert interval(np.array([2.0])) == {"mean": 2.0, "low": 2.0, "high": 2.0, "runs": 1}
    b = rng.normal(10.0, 1.0, (2000, 8))
    a = 0.5 * b + rng.normal(0.0, 0.5, b.shape)
    covered = [(told := ratio(x, y))["low"] <= 0.5 <= told["high"] for x, y in zip(a, b, strict=True)]
    assert np.mean(covered) == pytest.approx(0.95, abs=0.02)
    exact = ratio(0.25 * b[0], b[0])
    assert exact["low"] == pytest.approx(0.25) and exact["high"] == pytest.approx(0.25)


def test_quick_is_a_part_of_the_whole_and_seeds_can_be_chosen() -> None:
    whole, quick, few = (extended.cases(plan) for plan in (Plan(), Plan(quick=True), Plan(seeds=3)))
    assert sum(case.scene == SHIPS for case in whole) == 100
    assert {(c.scene, c.seed) for c in quick} < {(c.scene, c.seed) for c in whole}
    assert {case.scene for case in quick} == set(SCENES)
    assert {case.scans for case in whole} == {0} and {c.scans for c in quick if c.scene == TEST_2} == {600}
    assert sorted((case.scene, case.seed) for case in few) == [(s, i) for s in sorted(SCENES) for i in (1, 2, 3)]


@pytest.fixture(name="points_only")
def jipda_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extended_runs, "TRACKERS", (JIPDA,))


def run_short(case: Case) -> tuple[Run, ...]:
    """The first scans of a case with jipda alone."""
    scene = extended_runs.the_scene(case.scene)
    reference = extended_runs.reference_of(scene, 45)
    scans = [extended_runs.one_scan(extended_runs.scans_of(scene, k, seed=case.seed)) for k in range(45)]
    frames = [
        extended_runs.Frame(k, scan, extended_runs.truth_of(scene, reference, scan)) for k, scan in enumerate(scans)
    ]
    return (extended_runs.run_tracker(case, scene, JIPDA, frames),)


def test_results_are_the_same_whatever_the_number_of_workers() -> None:
    cases = [Case(SHIPS, 1), Case(TEST_1, 2)]
    one, two = (dict(fan_out(run_short, cases, workers=n)) for n in (1, 2))
    for i in range(2):
        for a, b in zip(one[i], two[i], strict=True):
            assert all(np.array_equal(a.scores[s], b.scores[s], equal_nan=True) for s in SCORES)


@pytest.mark.usefixtures("points_only")
def test_a_case_runs_through_the_chain_with_its_truth() -> None:
    (run,) = extended_runs.run_case(Case(TEST_2, 1, scans=80))
    assert run.tracker == JIPDA and len(run.cpu_ms) == 80
    gospa, parts = run.scores["gospa"], [run.scores[s] for s in ("gospa_localisation", "gospa_missed", "gospa_false")]
    assert np.allclose(gospa**2, parts[0] + 50.0 * (parts[1] + parts[2]))
    assert run.scores["gospa_missed"][0] == 1.0 and run.scores["gospa_missed"][-1] == 0.0
    assert 0.0 < run.scores["iou"][-1] < 1.0 and len(run.shapes) == 2


def test_what_the_paper_changes_is_for_gp_pmbm_alone() -> None:
    scene = extended_runs.the_scene(TEST_1)
    points = extended_runs.settings(scene, JIPDA)
    assert points.model.p_gate == 0.99 and points.input.sector_deg == scene.lidar[0].step_deg
    assert points.model.p_survive**scene.period_s == pytest.approx(0.99)


def test_the_report_has_tables_claims_and_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extended, "cases", lambda plan: [Case(s, 1, scans=60 if s == SHIPS else 8) for s in SCENES])
    monkeypatch.setattr(extended_claims, "LATE", 50)
    report = extended.reproduce(Plan(quick=True, out=tmp_path))
    assert sorted(report.figures) == ["figure_1", "figure_2", "figure_4", "figure_5"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in report.figures.values())
    assert len(report.tables["scores"].rows) == 2 * len(SCENES) * len(TRACKERS) and len(report.claims) == 16


def test_on_recordings_gp_pmbm_has_the_papers_other_numbers() -> None:
    for name, clutter in ((TEST_1, 60.0), (TEST_2, 100.0)):
        config = extended_runs.settings(extended_runs.the_scene(name), GP)
        assert config.model.p_gate == 0.95
        assert config.model.clutter_density_per_m2 * np.pi * 100.0**2 == pytest.approx(clutter, rel=1e-3)
