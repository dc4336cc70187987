"""The polar paper's experiment: its statements can fail, its runs are those of the chain, its report is whole."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from maritrack.chain import build_chain, process
from maritrack.metrics.scores import ScoreSums
from maritrack.metrics.trajectories import trajectories, truth_states
from maritrack.reproduce import polar, polar_runs
from maritrack.reproduce.claims import Claim, Plan
from maritrack.reproduce.polar_claims import (
    COARSE,
    FINE,
    OWN_PAIR,
    PAPER,
    STEADY,
    VARIANT_CLAIMS,
    claims_of,
    ratio,
    table_one,
    table_runs,
)  # fmt: skip
from maritrack.reproduce.polar_runs import (
    DOMAINS,
    TRACKERS,
    Case,
    Run,
    config_of,
    frames_of,
    near_land,
    run_case,
    run_frames,
    scene_of,
)  # fmt: skip
from maritrack.simulate.record import simulate
from maritrack.simulate.scenery import Land
from maritrack.types import CONFIRMED, Tracks, Truth

VARIANTS = (*STEADY, FINE, COARSE, OWN_PAIR)


def run_of(area: str, domain: str, tracker: str, *, seed: int = 1, name: str = "", switches: float, held: float) -> Run:
    """A run with these numbers; OSPA is worse the more it switches."""
    case = Case(area=area, seed=seed, scans=2, name=name, pairs={"polar": (75.0, 2)})
    ospa = np.full((3, 2), 20.0 + 0.1 * switches)
    return Run(
        case=case, domain=domain, tracker=tracker, switches=switches, switches_strict=switches,
        id_changes=round(switches), held=held, held_least=held, seen=held, clusters=1.0, tracks=1.0, objects=1.0,
        ids=1, ospa=ospa,
    )  # fmt: skip


def runs_of(table: Mapping[tuple[str, str, str], float], *, held: float = 0.95) -> list[Run]:
    """Runs of two seeds with the switches of a table, and variants of the far field that show no effect."""
    plain = [run_of(*key, seed=seed, switches=n, held=held) for seed in (1, 2) for key, n in table.items()]
    others = [
        run_of("far", domain, tracker, name=name, switches=5.0, held=held)
        for name in VARIANTS
        for domain in DOMAINS
        for tracker in TRACKERS
    ]
    return plain + others


def by_name(claims: tuple[Claim, ...], *words: str) -> list[bool]:
    """Whether the claims hold whose name has all of the words."""
    found = [claim.holds for claim in claims if all(word in claim.name for word in words)]
    assert found
    return found


def test_the_numbers_of_the_paper_fulfil_its_own_statements() -> None:
    claims = claims_of(runs_of(PAPER))
    assert all(claim.holds for claim in claims if "echoes" not in claim.name), [c.name for c in claims if not c.holds]
    assert by_name(claims, "echoes") == [False, False]  # these runs show no effect there
    assert len({claim.name for claim in claims}) == len(claims) == 4 + 4 + 5 + len(VARIANTS)


def test_numbers_the_other_way_round_fulfil_none_of_those_on_the_far_field() -> None:
    turned = {(a, "polar" if d == "cartesian" else "cartesian", t): n for (a, d, t), n in PAPER.items()}
    claims = claims_of(runs_of(turned, held=0.5))
    assert not any(by_name(claims, "at least 15 switches"))
    assert by_name(claims, "for a share of at least 0.9") == [False]
    assert by_name(claims, "mean OSPA with polar clusters below") == [False]


@pytest.mark.parametrize("tracker", TRACKERS)
def test_each_trackers_statement_is_its_own(tracker: str) -> None:
    worse = {**PAPER, ("far", "polar", tracker): PAPER["far", "cartesian", tracker], ("near", "polar", tracker): 99.0}
    claims = claims_of(runs_of(worse))
    others = [t for t in TRACKERS if t != tracker]
    for field in ("far field", "near field"):
        assert by_name(claims, f"{field}, {tracker}:") == [False]
        assert all(by_name(claims, f"{field}, {other}:") == [True] for other in others)


def test_a_tracker_that_switches_seldom_because_it_holds_nothing_fails() -> None:
    assert by_name(claims_of(runs_of(PAPER, held=0.1)), "for a share of at least 0.9") == [False]


def test_few_cartesian_switches_are_too_few_even_beside_none() -> None:
    few = {**PAPER, ("far", "cartesian", "jipda"): 14.0, ("far", "polar", "jipda"): 0.0}
    assert by_name(claims_of(runs_of(few)), "far field, jipda:") == [False]


def test_the_paper_s_table_of_switching_costs() -> None:
    """Polar, Table I: SPRT, IPDA, JIPDA, CB-GIW-PHD."""
    rows = {key: [PAPER[(*key, t)] for t in ("sprt", "ipda", "jipda", "cb-giw-phd")] for key in
            [("near", "cartesian"), ("near", "polar"), ("far", "cartesian"), ("far", "polar")]}  # fmt: skip
    near = [9.0, 5.5, 9.0, 3.5]
    assert list(rows.values()) == [near, near, [141.0, 17.0, 23.0, 175.0], [5.0, 3.5, 4.0, 3.0]]


def test_far_away_polar_clusters_may_switch_a_third_as_often_and_no_more() -> None:
    for polar_switches, holds in ((10.0, True), (11.0, False)):
        table = {**PAPER, ("far", "cartesian", "ipda"): 30.0, ("far", "polar", "ipda"): polar_switches}
        assert by_name(claims_of(runs_of(table)), "far field, ipda:") == [holds]


def test_a_switch_that_spares_three_metres_is_counted_at_one_metre_and_not_at_twenty() -> None:
    """Two tracks that change places: each is exact in the scans in which the other is 1.5 m off."""
    config, tally = config_of(SMALL, "polar", "sprt"), polar_runs.Tally(ScoreSums())
    unknown, yes = np.full(1, np.nan), np.ones(1, bool)
    objects = []
    for k in range(8):
        truth = Truth(("a",), ("",), k, np.zeros((1, 2)), np.zeros((1, 2)), unknown, unknown, unknown)
        east_m = np.array([0.0, 1.5]) if k < 4 else np.array([1.5, 0.0])
        tracks = Tracks(
            np.array([1, 2]), np.full(2, k), np.stack([east_m, np.zeros(2)], axis=-1), np.zeros((2, 2)),
            np.zeros((2, 4, 4)), np.zeros((2, 2, 2)), np.ones(2), np.full(2, CONFIRMED), np.ones(2, bool),
            np.zeros(2, np.int64),
        )  # fmt: skip
        objects.append(truth_states(truth))
        both = np.ones(2, bool)
        tally = polar_runs.tallied(tally, truth, tracks, covered=yes, which=both, config=config, seen=1, clusters=2)
    run = polar_runs.finish(SMALL, ("polar", "sprt"), tally, trajectories(objects), config)
    assert (run.switches, run.switches_strict, run.id_changes) == (1.0, 0.0, 0)


def test_gains_over_sprt_are_judged_both_ways() -> None:
    no_gain = {**PAPER, ("far", "polar", "jipda"): 20.0}
    too_much = {**PAPER, ("far", "polar", "jipda"): 0.5}
    assert by_name(claims_of(runs_of(no_gain)), "gain over sprt") == [False]
    assert by_name(claims_of(runs_of(no_gain)), "gain at most") == [True]
    assert by_name(claims_of(runs_of(too_much)), "gain at most") == [False]
    assert ratio(0.0, 0.0) == 1.0 and ratio(1.0, 0.0) == np.inf


@pytest.mark.parametrize("name", VARIANTS)
def test_a_variant_with_the_effect_turns_its_statement(name: str) -> None:
    flat = [run_of("far", d, t, name=name, switches=20.0, held=1.0) for d in DOMAINS for t in TRACKERS]
    strong = [replace(run, switches=500.0) if run.domain == "cartesian" else run for run in flat]
    reverse = [replace(run, switches=500.0) if run.domain == "polar" else run for run in flat]
    told = [VARIANT_CLAIMS[name](runs, name).holds for runs in (flat, strong, reverse)]
    assert told == {
        OWN_PAIR: [True, True, False], FINE: [True, False, True], COARSE: [True, False, True],
    }.get(name, [False, True, False])  # fmt: skip


def test_tables_have_the_papers_numbers_beside_ours_and_every_run() -> None:
    runs = runs_of({key: 2.0 * n for key, n in PAPER.items()})
    table = table_one([run for run in runs if not run.case.name])
    assert table.rows[4] == ("far", "cartesian", "ours", 282.0, 34.0, 46.0, 350.0)
    assert table.rows[5] == ("far", "cartesian", "paper", 141.0, 17.0, 23.0, 175.0)
    assert len(table_runs(runs).rows) == len(runs)


def test_a_scene_changes_in_what_the_case_says_and_covers_the_same_ranges() -> None:
    scene = scene_of(Case(area="far", seed=1, scans=1))
    coarse = scene_of(Case(area="far", seed=1, scans=1, cell_m=30.0, spokes=4096, fade=6.0))
    assert coarse.radar.spokes == 4096 and {vessel.fade for vessel in coarse.vessel} == {6.0}
    assert_array_equal(coarse.radar.edges_m[[0, -1]], scene.radar.edges_m[[0, -1]])
    assert (
        config_of(Case(area="far", seed=1, scans=1, pairs={"polar": (75.0, 2)}), "polar", "ipda").cluster.eps_m == 75.0
    )
    assert config_of(Case(area="far", seed=1, scans=1), "cartesian", "ipda").cluster.method == "cartesian-dbscan"


def test_near_land_is_on_it_or_within_the_margin_of_its_shore() -> None:
    from shapely import Point, Polygon

    outline = ((0.0, 0.0), (400.0, 50.0), (300.0, 400.0), (200.0, 150.0), (50.0, 300.0))
    land = Land(name="a", rcs_m2_per_m=1.0, reach_m=1.0, outline_m=outline)
    at = np.random.default_rng(1).uniform(-200, 600, (500, 2))
    expected = [Polygon(outline).distance(Point(*p)) <= 60.0 for p in at]
    assert_array_equal(near_land(at, (land,), 60.0), expected)
    assert not near_land(at, (), 60.0).any()


@pytest.fixture(scope="module")
def small_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six turns of the far field."""
    path = tmp_path_factory.mktemp("far") / "rec.cat240"
    simulate(scene_of(SMALL), path, seed=SMALL.seed, scans=SMALL.scans, ais=False, labels=False)
    return path


SMALL = Case(area="far", seed=3, scans=6)


def test_the_runs_are_those_of_the_chain(small_recording: Path) -> None:
    frames = list(frames_of(small_recording, config_of(SMALL, "polar", "sprt")))
    runs = {(run.domain, run.tracker): run for run in run_frames(SMALL, scene_of(SMALL), iter(frames))}
    for key, run in runs.items():
        config = config_of(SMALL, *key)
        chain = build_chain(config)
        state, ospa, n_tracks = chain.init(), [], []
        for frame in frames:
            state, result = process(chain, state, frame)
            ospa.append(result.scores["ospa"])
            n_tracks.append(result.scores["n_tracks"])
        assert_array_equal(run.ospa[0], ospa)
        assert run.tracks == np.mean(n_tracks)
    assert runs["polar", "sprt"].held > runs["cartesian", "jipda"].held


def test_a_small_report_is_whole_and_the_same_for_any_number_of_workers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = [Case(area=area, seed=1, scans=4) for area in ("near", "far")]
    monkeypatch.setattr(polar, "cases_of", lambda plan, pairs: [*few, replace(few[1], name=OWN_PAIR, pairs=pairs)])
    monkeypatch.setattr(polar, "GRID_SCANS", 2)
    seen: list[int] = []
    one = polar.reproduce(Plan(quick=True, out=tmp_path), tick=lambda done, of: seen.append(done))
    two = polar.reproduce(Plan(quick=True, workers=2))
    assert one.claims == two.claims and one.tables == two.tables and seen == [1, 2, 3]
    assert set(one.tables) == {"table_1", "runs", "pairs"} and len(one.tables["runs"].rows) == 24
    for name, path in one.figures.items():
        assert path.stat().st_size > 10_000, name
    assert {path.suffix for path in one.figures.values()} == {".png", ".rrd"} and not two.figures


@pytest.mark.parametrize(("gap_m", "out"), [(-100.0, 1), (50.0, 1), (150.0, 0)])
def test_what_is_within_a_hundred_metres_of_a_shore_does_not_count(
    small_recording: Path, gap_m: float, out: int
) -> None:
    """A rock of 50 m beside one vessel: around it, 50 m and 150 m east of it."""
    (frame, *_) = frames_of(small_recording, config_of(SMALL, "polar", "sprt"))
    assert frame.truth is not None
    (east, north), edge = frame.truth.position_m[0], 50.0
    west = east + gap_m
    corners = ((west, north - edge), (west + 2 * edge, north - edge), (west + 2 * edge, north + edge),
               (west, north + edge))  # fmt: skip
    rock = Land(name="rock", rcs_m2_per_m=1.0, reach_m=1.0, outline_m=corners)
    others_m = np.hypot(*(frame.truth.position_m[1:] - frame.truth.position_m[0]).T)
    assert others_m.min() > 500.0
    runs = run_frames(SMALL, replace(scene_of(SMALL), land=(rock,)), iter([frame]))
    assert {run.objects for run in runs} == {len(frame.truth.id) - out}


def test_truth_outside_of_the_region_of_interest_does_not_count(small_recording: Path) -> None:
    config = config_of(SMALL, "polar", "sprt")
    least, most = 22_000.0, 26_000.0
    region = replace(config, input=replace(config.input, roi_min_m=least, roi_max_m=most))
    every, some = (list(frames_of(small_recording, c)) for c in (config, region))
    for a, b in zip(every, some, strict=True):
        assert a.truth is not None and b.truth is not None
        r = np.hypot(*(a.truth.position_m - a.scan.position_m).T)
        assert (r < least).any() and (r > most).any()
        assert b.truth.id == tuple(np.array(a.truth.id)[(r >= least) & (r <= most)])


def test_quick_and_full_runs_make_the_same_statements() -> None:
    pairs = dict.fromkeys(DOMAINS, (75.0, 2))
    quick, full = (polar.cases_of(Plan(quick=quick), pairs) for quick in (True, False))
    assert {(case.area, case.name) for case in quick} == {(case.area, case.name) for case in full}
    assert {case.name for case in quick} == {"", *VARIANTS}
    seeds = {case.seed for case in full if not case.name}
    assert seeds == {1, 2, 3, 4, 5} and all(case.scans >= 240 for case in quick + full)


@pytest.mark.slow
def test_polar_clusters_are_as_good_near_and_better_far_away() -> None:
    """Ten minutes of both fields, one seed; the whole of it is `maritrack reproduce polar`."""
    runs = [run for area in polar.AREAS for run in run_case(Case(area=area, seed=1, scans=240))]
    told = {claim.name: claim.holds for claim in claims_of(runs)}
    assert all(holds for name, holds in told.items() if "gain over sprt" not in name), told


def test_the_trackers_and_domains_are_the_papers() -> None:
    assert len(PAPER) == 2 * len(polar_runs.DOMAINS) * len(polar_runs.TRACKERS) == 16
