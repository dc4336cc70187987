"""Background subtraction in the line: who waits for it, what it spares, and vessels that stop and leave again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from maritrack.chain import ChainState, build_chain, process
from maritrack.config import load_config
from maritrack.detect.background import Background, no_background, under
from maritrack.remarks import looked_at, remarks, untracked, unused_background
from maritrack.settings import Config
from maritrack.types import CONFIRMED, STATIONARY, Damage, FloatArray, Frame, Result
from tests.runs import tracks
from tests.unit.scans import OF_CLUSTERS, scan_of

ABS = ("subtract.method=abs", "subtract.threshold=0", "subtract.start=empty", "subtract.decision=tail",
       "subtract.pixel_m=100.0", "subtract.half_life_scans=15.0")  # fmt: skip
TURN_S = 2.5
VESSEL = np.array([[-30.0, 0.0], [0.0, 0.0], [30.0, 0.0]])  # three points, one cluster
NORTH_M = 1030.0  # not on the edge of a pixel


def config(tracker: str, *sets: str) -> Config:
    clustered = ["cluster.method=cartesian-dbscan", "cluster.eps_m=60.0", "cluster.min_points=2"]
    clustered += ["model.clutter=fixed", "model.clutter_density_per_m2=1e-7"]
    return load_config(preset="points", sets=[f"tracker_name={tracker}", *clustered, *ABS, *sets])


def run(settings: Config, scans: list[FloatArray]) -> list[Result]:
    chain, results = build_chain(settings), []
    state: ChainState = chain.init()
    for k, at in enumerate(scans):
        scan, _ = scan_of(at, TURN_S * k)
        state, result = process(chain, state, Frame(k, scan))
        results.append(result)
    return results


def along(east_m: Any) -> list[FloatArray]:
    return [VESSEL + np.array([east, NORTH_M]) for east in np.atleast_1d(east_m).tolist()]


def a_call_at_a_berth() -> list[FloatArray]:
    """In at 5 m/s and slower, three minutes and a half at the berth, out at up to 5 m/s."""
    leave = np.cumsum(np.minimum(np.arange(1, 61) * 0.25, 5.0) * TURN_S)
    return along(np.concatenate([-leave[::-1], np.zeros(84), leave]))


@pytest.mark.parametrize("tracker", OF_CLUSTERS)
def test_a_vessel_that_stops_is_stationary_in_the_background_and_leaves_under_its_id(tracker: str) -> None:
    results = run(config(tracker), a_call_at_a_berth())
    arrives, leaves = 60, 144
    name = results[arrives - 12].tracks.id[results[arrives - 12].tracks.moving]
    assert len(name) == 1
    status = [int(r.tracks.status[r.tracks.id == name[0]][0]) for r in results[arrives:]]
    assert set(status[12 : leaves - arrives]) == {STATIONARY}
    hidden = results[leaves - 1]
    assert not hidden.keep.any() and len(hidden.clusters) == 0
    at = hidden.tracks.position_m[hidden.tracks.id == name[0]][0]
    assert np.hypot(*(at - [0.0, NORTH_M])) < 100.0
    last = results[-1].tracks
    mine = last.id == name[0]
    assert last.moving[mine].all() and last.status[mine].tolist() != [STATIONARY]
    assert np.hypot(*(last.position_m[mine][0] - results[-1].points.position_m[1])) < 100.0


@pytest.mark.parametrize("tracker", OF_CLUSTERS)
def test_what_stays_longer_than_the_stated_time_ends(tracker: str) -> None:
    results = run(config(tracker, "tracker.stationary_s=60.0"), a_call_at_a_berth()[:144])
    stationary = [STATIONARY in r.tracks.status for r in results]
    began = max(k for k in range(1, 144) if stationary[k] and not stationary[k - 1])
    assert sum(stationary[began:]) == round(60.0 / TURN_S)
    assert all(len(r.tracks) == 0 for r in results[began + round(60.0 / TURN_S) :])
    gone = run(config(tracker, "tracker.stationary_s=0.0"), a_call_at_a_berth())[120:144]
    assert all((r.tracks.status < CONFIRMED).all() for r in gone)


def test_tracking_waits_for_the_background_where_it_is_told_to() -> None:
    rng = np.random.default_rng(0)
    land = np.stack([rng.uniform(500, 900, 60), rng.uniform(500, 900, 60)], axis=-1)
    scans = [np.concatenate([land, vessel]) for vessel in along(np.arange(-1200.0, 1200.0, 12 * TURN_S))]
    case1, case2 = (
        run(config("jipda", f"subtract.track_from={how}", "subtract.half_life_scans=10.0"), scans)
        for how in ("converged", "start")
    )
    told = [[e.message for e in r.events if e.stage == "subtract"] for r in case1]
    when = next(k for k, messages in enumerate(told) if messages)
    assert told[when][0] == f"background converged after {when + 1} scans: tracking starts"
    assert sum(map(len, told)) == 1 and 5 < when < 70
    assert all(len(r.tracks) == 0 for r in case1[:when]) and len(case1[when].tracks)
    assert any(len(r.tracks) for r in case2[:when])
    assert len(case1[-1].tracks) == 1


def test_a_run_that_never_tracked_says_so_and_names_the_settings() -> None:
    def told(*sets: str, scans: int = 12) -> list[Damage]:
        chain = build_chain(config("jipda", *sets))
        state: ChainState = chain.init()
        for k in range(scans):
            for sensor, at in (("a", np.array([[500.0, 500.0]])), ("b", VESSEL + 20.0 * k)):
                state, _ = process(chain, state, Frame(k, scan_of(at, TURN_S * k, sensor=sensor)[0]))
        return list(untracked(chain, state))

    waits = "subtract.track_from=converged"
    first, second = told(waits)
    assert (first.code, first.sensor, second.sensor) == ("tracking-not-started", "a", "b")
    assert "for 'a': its background did not converge within 12 scans" in first.message
    assert 'subtract.track_from = "start"' in first.message and "subtract.half_life_scans" in first.message
    assert "subtract.learning_rate" in told(waits, "subtract.half_life_scans=0")[0].message
    assert len(told(waits, "subtract.masks=joint", scans=6)) == 1
    assert told() == told(waits, "subtract.method=none") == told(waits, "subtract.half_life_scans=1.0", scans=20) == []


def test_a_background_of_another_sensor_or_place_is_told_and_one_of_this_place_is_not() -> None:
    settings = config("jipda", "subtract.half_life_scans=2.0")
    land = np.array([[500.0, 500.0], [900.0, 500.0]])

    def learned(chain: Any, at: FloatArray, scans: int = 12) -> ChainState:
        state: ChainState = chain.init()
        for k in range(scans):
            scan, _ = scan_of(at, TURN_S * k)
            scan = replace(scan, sensor=replace(scan.sensor, max_range_m=1e4))
            state, _ = process(chain, state, Frame(k, scan))
        return state

    def told(known: Background, name: str) -> list[Damage]:
        chain = build_chain(settings, background={name: known})
        return list(remarks(chain, learned(chain, land), sensors={"a"}, calibrated=()))

    here = learned(build_chain(settings), land).background
    (name,) = here
    assert told(here[name], name) == []
    (other,) = told(here[name], "9-99\n")
    assert other.code == "background-unused" and "'9-99\\n' was of no use: those of this run are of" in other.message
    (away,) = told(replace(here[name], corner_m=(5e6, 0.0)), name)
    assert away.code == "background-elsewhere" and "no scan looked at one of its 2 pixels" in away.message
    assert [d.code for d in told(no_background(), "b")] == ["background-unused"]
    assert unused_background(build_chain(settings), learned(build_chain(settings), land)) == ()


def test_a_pixel_has_been_looked_at_when_its_own_time_went_on() -> None:
    chain = build_chain(config("jipda", "subtract.half_life_scans=20.0"))
    near, far = np.array([[500.0, 500.0]]), np.array([[9000.0, 500.0]])
    states = [chain.init()]
    for k, at in enumerate([np.concatenate([near, far]), near, near]):
        scan, _ = scan_of(at, TURN_S * k)
        reach = replace(scan, sensor=replace(scan.sensor, max_range_m=1e5 if k == 0 else 2e3))
        states.append(process(chain, states[-1], Frame(k, reach))[0])
    (before,), (after,) = (tuple(state.background.values()) for state in (states[1], states[-1]))
    assert looked_at(before, after).tolist() == [True, False]


def test_a_slow_ship_is_not_the_background_of_its_own_wake_where_moving_tracks_are_spared() -> None:
    slow = along(np.arange(-400.0, 0.0, 2.0 * TURN_S))
    eaten, spared = (run(config("jipda", f"subtract.spare={how}"), slow) for how in ("none", "moving"))
    assert not all(r.keep.all() for r in eaten[40:])
    assert all(r.keep.all() for r in spared[40:])


def test_a_run_without_subtraction_is_as_it_was() -> None:
    results = run(config("jipda", "subtract.method=none"), a_call_at_a_berth()[:70])
    assert all(r.mask is None and r.keep.all() for r in results)


def test_each_sensor_has_its_mask_or_all_have_one() -> None:
    land, sea = np.array([[500.0, 500.0]]), np.zeros((0, 2))
    for masks, names in (("sensor", {"a", "b"}), ("joint", {""})):
        chain = build_chain(config("jipda", f"subtract.masks={masks}", "subtract.half_life_scans=2.0"))
        state: ChainState = chain.init()
        for k in range(20):
            for sensor, at in (("a", land), ("b", sea)):
                scan, _ = scan_of(at, TURN_S * k, sensor=sensor)
                state, result = process(chain, state, Frame(k, scan))
                assert result.mask is not None
        assert set(state.background) == names
        assert len(result.mask.key) == 0  # b sees nothing there, and its look counts where there is one mask


def test_under_a_track_is_in_its_ellipse_grown_by_the_margin_where_it_is_by_then() -> None:
    rng = np.random.default_rng(0)
    A = rng.normal(size=(20, 2, 2)) * 60.0
    held = replace(tracks(0, rng, 20), extent_m2=A @ A.transpose(0, 2, 1))
    position_m = held.position_m[rng.integers(0, 20, 500)] + rng.normal(size=(500, 2)) * 100.0
    expected = np.zeros(500, bool)
    for centre, v, t_ns, X in zip(held.position_m, held.velocity_mps, held.t_ns, held.extent_m2, strict=True):
        off = position_m - centre - (7.0 - t_ns * 1e-9) * v
        expected |= np.sum(off * np.linalg.solve(X + 50.0**2 * np.eye(2), off.T).T, axis=1) <= 1.0
    assert 20 < expected.sum() < 480
    assert np.array_equal(under(held, position_m, 7_000_000_000, 50.0), expected)
