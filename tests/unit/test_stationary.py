"""Tracks that the background takes, of every tracker: all at once, side by side, passed by, out of sight, in gaps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from maritrack import geo
from maritrack.cluster.stage import cluster_points
from maritrack.config import load_config
from maritrack.settings import Config
from maritrack.trackers import TRACKERS, stationary
from maritrack.types import CONFIRMED, STATIONARY, FloatArray, Mask, Tracks
from tests.unit.scans import OF_CLUSTERS, plain_config, scan_of, step
from tests.unit.test_tracklist import tracks

PIXEL_M, CORNER_M = 50.0, (-25.0, -25.0)
NOTHING = np.zeros((0, 2))
EVERYWHERE = np.stack(np.meshgrid(np.arange(-3000, 3001, 50.0), np.arange(-3000, 3001, 50.0)), axis=-1).reshape(-1, 2)
HARBOUR = np.stack(np.meshgrid([-1200.0, -400.0, 400.0, 1200.0], [300.0, 1000.0, 1700.0]), axis=-1).reshape(-1, 2)
CONFIG = plain_config("jipda")
OF_HULLS = ("sprt", "ipda", "jipda", "pakf-jpda", "cb-giw-phd", "giw-pmbm")
every_tracker = pytest.mark.parametrize("name", OF_CLUSTERS)


def mask_at(*places: Any) -> Mask:
    """The pixels at places (n, 2)."""
    return Mask(np.unique(geo.pixel_key(np.concatenate(places), PIXEL_M, CORNER_M)), PIXEL_M, CORNER_M)


def settings(name: str, *sets: str) -> Config:
    clutter = ("model.clutter=fixed", "model.clutter_density_per_m2=1e-7")
    return plain_config(name, "tracker.stationary_s=100.0", *clutter, *sets)


def run(
    config: Config, scans: list[tuple[FloatArray, Mask | None]], *, period_s: float = 2.0, times_s: Any = None
) -> Iterator[Tracks]:
    """The tracks after each of the scans: what is seen, and what is covered."""
    tracker = TRACKERS[config.tracker_name](config)
    state = tracker.init()
    for k, (at, mask) in enumerate(scans):
        scan, points = scan_of(at, times_s[k] if times_s is not None else period_s * k)
        clusters = cluster_points(points, scan, config.cluster, config.input)
        state, _ = tracker.update(state, replace(scan, covered=mask), points, clusters)
        yield tracker.estimate(state)


def confirmed(t: Tracks) -> dict[int, tuple[int, FloatArray]]:
    """Status and place of the tracks that are confirmed in any way, by id."""
    return {int(i): (int(s), p) for i, s, p in zip(t.id, t.status, t.position_m, strict=True) if s >= CONFIRMED}


@every_tracker
def test_a_mask_that_covers_all_holds_all_and_gives_all_back(name: str) -> None:
    all_ = mask_at(EVERYWHERE)
    scans = [(HARBOUR, None)] * 12 + [(NOTHING, all_)] * 20 + [(HARBOUR, None)] * 4
    told = [confirmed(t) for t in run(settings(name), scans)]
    assert len(told[11]) == len(HARBOUR)
    for k in range(12, 32):
        assert told[k].keys() == told[11].keys()
        assert {status for status, _ in told[k].values()} == {STATIONARY}
    lay = np.array([told[31][i][1] - told[11][i][1] for i in told[11]])
    assert np.abs(lay).max() < 1.0
    assert told[-1].keys() == told[11].keys()
    assert {status for status, _ in told[-1].values()} == {CONFIRMED}


@every_tracker
def test_what_stays_covered_ends_after_the_stated_time_and_not_before(name: str) -> None:
    scans = [(HARBOUR, None)] * 12 + [(NOTHING, mask_at(EVERYWHERE))] * 60
    held = [len(confirmed(t)) for t in run(settings(name), scans)][12:]
    assert held == [len(HARBOUR)] * 50 + [0] * 10
    none = [confirmed(t) for t in run(settings(name, "tracker.stationary_s=0.0"), scans)]
    assert not any(status == STATIONARY for one in none for status, _ in one.values())


@pytest.mark.parametrize("name", [name for name in OF_CLUSTERS if name != "ec-jpda"])  # its gate takes in both
def test_two_at_one_berth_stay_two_and_leave_as_two(name: str) -> None:
    berth = np.array([[0.0, 1000.0], [80.0, 1000.0]])
    away = [berth + np.array([[-1.0, 0.0], [1.0, 0.0]]) * 5.0 * s for s in range(16)]
    hidden = mask_at(berth)
    scans = [(berth, None)] * 12 + [(NOTHING, hidden)] * 20
    scans += [(at[~geo.in_mask(hidden, at)], hidden) for at in away]
    told = [confirmed(t) for t in run(settings(name), scans)]
    assert len(told[11]) == 2
    assert told[31].keys() == told[11].keys()
    west, east = sorted(told[11], key=lambda i: float(told[11][i][1][0]))
    assert told[-1].keys() >= {west, east}
    found = np.array([told[-1][west][1], told[-1][east][1]])
    assert np.abs(found - away[-1]).max() < 20.0


@every_tracker
def test_what_passes_a_berth_does_not_take_its_vessel_along(name: str) -> None:
    berth, passing = np.array([[0.0, 1000.0]]), [np.array([[-300.0 + 10.0 * k, 1060.0]]) for k in range(60)]
    scans = [(np.concatenate([berth, at]), None) for at in passing[:12]]
    scans += [(at, mask_at(berth)) for at in passing[12:]]
    told = [confirmed(t) for t in run(settings(name), scans)]
    lies, goes = sorted(told[11], key=lambda i: -float(told[11][i][1][0]))
    assert told[-1].keys() == {lies, goes}
    assert told[-1][lies][0] == STATIONARY
    assert np.abs(told[-1][lies][1] - berth[0]).max() < 5.0
    assert np.abs(told[-1][goes][1] - passing[-1][0]).max() < 20.0


@every_tracker
def test_a_mask_of_nothing_changes_nothing(name: str) -> None:
    empty = Mask(np.zeros(0, np.int64), PIXEL_M, CORNER_M)
    ways = [HARBOUR + np.array([4.0 * k, 0.0]) for k in range(10)] + [NOTHING] * 4
    without, with_ = (list(run(settings(name), [(at, mask) for at in ways])) for mask in (None, empty))
    for a, b in zip(without, with_, strict=True):
        for field in ("id", "position_m", "velocity_mps", "cov", "existence", "status"):
            assert_array_equal(getattr(a, field), getattr(b, field))


@every_tracker
def test_what_is_held_does_not_end_for_a_pixel_that_is_wider_than_what_may_be_uncertain(name: str) -> None:
    berth = np.array([[0.0, 1000.0]])
    scans = [(berth, None)] * 12 + [(NOTHING, mask_at(berth))] * 12
    told = [confirmed(t) for t in run(settings(name, "tracker.delete_sigma_m=40.0"), scans)]
    assert {status for one in told[12:] for status, _ in one.values()} == {STATIONARY}
    assert all(one.keys() == told[11].keys() and len(one) == 1 for one in told[12:])


def test_a_hull_of_points_is_held_with_its_outline_and_leaves_under_its_id() -> None:
    u = np.linspace(-1.0, 1.0, 9)
    sides = np.concatenate([np.stack([3.0 * u, np.full(9, y)], axis=-1) for y in (-1.5, 1.5)])
    hull = np.concatenate([sides, [[3.0, 0.0], [-3.0, 0.0]]]) + np.array([0.0, 40.0])
    hidden, config = mask_at(np.array([[0.0, 40.0]])), load_config(preset="extended", sets=["tracker_name=gp-pmbm"])
    away = [(hull + np.array([0.025 * k**2, 0.0]), None) for k in range(12)]  # 0.2 m/s^2
    scans = [(hull, None)] * 10 + [(NOTHING, hidden)] * 10 + away
    told = list(run(config, scans, period_s=0.5))
    (mine,) = confirmed(told[9])
    assert all(confirmed(t).keys() == {mine} for t in told[10:])
    assert [confirmed(t)[mine][0] for t in told[10:20]] == [STATIONARY] * 10
    assert confirmed(told[-1])[mine][0] == CONFIRMED
    first, last = (t.contour_m[int(np.flatnonzero(t.id == mine)[0])] for t in (told[9], told[19]))
    assert np.abs(first - last).max() < 0.2


@every_tracker
@pytest.mark.parametrize(("gap_s", "lasts"), [(150.0, True), (260.0, False)])
def test_what_is_held_is_lost_in_a_gap_for_its_time_alone(name: str, gap_s: float, lasts: bool) -> None:
    """What is not held is lost after 90 s: sigma^2 = q t^3 / 3 at least, and 110 m is too much.

    In the first scan after the gap something is seen 300 m away, or, after too long a gap, at the berth.
    """
    sets = ("tracker.stationary_s=240.0", "tracker.delete_sigma_m=110.0", "model.accel_psd_m2ps3=0.05")
    config = settings(name, *sets, "model.clutter_density_per_m2=1e-9")
    berth, aside = np.array([[0.0, 1000.0]]), np.array([[300.0, 1000.0]])
    hidden = mask_at(berth)
    after = [(aside if lasts else berth + 60.0, hidden)] + [(NOTHING, hidden)] * 4 + [(berth + 60.0, hidden)] * 6
    scans = [(berth, None)] * 12 + [(NOTHING, hidden)] * 8 + after
    times_s = 2.0 * np.arange(31) + gap_s * (np.arange(31) >= 20)
    told = [confirmed(t) for t in run(config, scans, times_s=times_s)]
    (mine,) = told[19]
    if not lasts:
        assert not any(mine in one for one in told[20:])
        return
    assert [told[k][mine][0] for k in range(20, 25)] == [STATIONARY] * 5
    assert np.abs(told[20][mine][1] - told[19][mine][1]).max() == 0.0
    assert told[-1][mine][0] == CONFIRMED


@every_tracker
def test_a_scan_that_does_not_look_at_a_berth_leaves_it_as_it_is(name: str) -> None:
    """A second station sees nothing there, and its mask is of elsewhere."""
    berth = np.array([[0.0, 1000.0]])
    tracker, told = TRACKERS[name](settings(name)), []
    state = tracker.init()
    for k in range(60):
        scan, points = scan_of(berth if k < 12 else NOTHING, 2.0 * k)
        if k >= 12:
            scan = replace(scan, covered=mask_at(berth))
        if k > 20 and k % 2:
            far = replace(scan.sensor, id="q", max_range_m=500.0)
            scan = replace(scan, sensor=far, covered=mask_at(berth * 0.3))
        clusters = cluster_points(points, scan, CONFIG.cluster, CONFIG.input)
        state, _ = tracker.update(state, scan, points, clusters)
        told.append(tracker.estimate(state))
    assert {int(s) for t in told[13:] for s in t.status[t.id == told[12].id[0]]} == {STATIONARY}
    assert len({t.cov[0].tobytes() for t in told[13:]}) == 1


@every_tracker
@pytest.mark.parametrize("hidden", [True, False])
def test_what_one_station_hides_is_not_gone_for_another_that_neither_sees_nor_hides_it(name: str, hidden: bool) -> None:
    """A second station looks there from behind a shed: held where it lies, but not when nobody hides it any more."""
    berth = np.array([[0.0, 1000.0]])
    tracker, told = TRACKERS[name](settings(name)), []
    state = tracker.init()
    for k in range(60):
        scan, points = scan_of(berth if k < 12 else NOTHING, 2.0 * k)
        masks = mask_at(berth), mask_at(berth * 0.3)
        if k > 20:
            masks = (masks if hidden else masks[1:] * 2)[:: 1 if k % 2 else -1]
            scan = replace(scan, sensor=replace(scan.sensor, id="pq"[k % 2]))
        if k >= 12:
            scan = replace(scan, covered=masks[0], also_covered=masks[1:])
        clusters = cluster_points(points, scan, CONFIG.cluster, CONFIG.input)
        state, _ = tracker.update(state, scan, points, clusters)
        told.append(tracker.estimate(state))
    mine = told[12].id[0]
    if not hidden:
        assert mine not in told[-1].id[told[-1].status == STATIONARY]
        return
    assert all(t.status[t.id == mine].tolist() == [STATIONARY] for t in told[13:])
    assert len({t.cov[t.id == mine].tobytes() for t in told[13:]}) == 1


@pytest.mark.parametrize("name", OF_HULLS)
def test_fragments_of_a_hull_at_her_berth_do_not_make_it_small(name: str) -> None:
    """Each second scan shows five points of one end of a hull that the background hides as a whole."""
    east, north = np.meshgrid(np.linspace(-60.0, 60.0, 13), np.linspace(990.0, 1010.0, 3))
    hull = np.stack([east.ravel(), north.ravel()], axis=-1)
    end = hull[hull[:, 0] > 55.0]
    config = settings(name, "cluster.method=cartesian-dbscan", "cluster.eps_m=15.0", "cluster.min_points=2",
                      "model.extent=random-matrix", "model.max_axis_m=300.0")  # fmt: skip
    scans = [(hull, None)] * 16 + [(end if k % 2 else NOTHING, mask_at(EVERYWHERE)) for k in range(24)]
    told = list(run(config, scans))
    (mine,) = confirmed(told[15])

    def length_m(t: Tracks) -> float:
        return 2.0 * float(np.sqrt(np.linalg.eigvalsh(t.extent_m2[t.id == mine][0])[1]))

    assert confirmed(told[-2])[mine][0] == STATIONARY
    assert length_m(told[15]) > 100.0
    assert length_m(told[-1]) > 0.95 * length_m(told[15])


def test_a_measurement_goes_to_one_and_an_object_has_one() -> None:
    i, j = np.array([0, 0, 1, 1, 2]), np.array([0, 1, 0, 1, 2])
    log_w = np.log([0.4, 0.3, 0.5, 0.6, 0.4])
    assert stationary.winners(i, j, log_w, np.array([0.9, 0.9, 0.4])).tolist() == [3]
    assert stationary.winners(i, j, log_w, np.array([0.9, 0.4, 0.6])).tolist() == [2, 4]
    log_w = np.log([0.6, 0.3, 0.3, 0.6, 0.4])
    assert stationary.winners(i, j, log_w, np.array([0.9, 0.9, 0.5])).tolist() == [0, 3]
    assert len(stationary.winners(i[:0], j[:0], log_w[:0], np.zeros(3))) == 0


def test_what_lies_is_less_certain_by_a_pixel_once_and_has_no_velocity_in_any_number_of_axes() -> None:
    for axes in (2, 3):
        x, P = np.ones((2, 2 * axes)), np.tile(np.ones((2 * axes, 2 * axes)), (2, 1, 1))
        still, spread = stationary.lying(x, P, np.array([False, True]), 10.0)
        assert_array_equal(still, [[1.0] * axes + [0.0] * axes] * 2)
        assert_array_equal(np.diagonal(spread[0]), [101.0, 101.0, *[1.0] * (2 * axes - 2)])
        assert_array_equal(np.diagonal(spread[1]), np.ones(2 * axes))
        assert_array_equal(spread[:, :axes, axes:], np.zeros((2, axes, axes)))
        assert_array_equal(P, np.ones((2, 2 * axes, 2 * axes)))


def test_only_confirmed_ones_that_were_missed_are_taken_and_none_where_none_is_to_be_kept() -> None:
    rules = settings("jipda").tracker
    three = tracks(3, confirmed=np.array([True, True, False]))
    hit, share = np.array([False, True, False]), np.full(3, 0.5)
    assert stationary.takes(three, hit, share, rules).tolist() == [True, False, False]
    assert not stationary.takes(three, hit, share - 0.1, rules).any()
    assert not stationary.takes(three, hit, share, replace(rules, stationary_s=0.0)).any()


@every_tracker
def test_what_is_seen_under_cover_is_not_held_and_leaves_nothing_behind(name: str) -> None:
    """P_D is less there; a vessel that is seen in each scan is one track, as it was."""
    berth, hidden = np.array([[0.0, 1000.0]]), mask_at(np.array([[0.0, 1000.0]]))
    told = list(run(settings(name), [(berth, None)] * 8 + [(berth, hidden)] * 6 + [(NOTHING, hidden)] * 2))
    assert [next(iter(confirmed(t).values()))[0] for t in told[8:]] == [CONFIRMED] * 6 + [STATIONARY] * 2
    assert len({i for t in told[8:] for i in confirmed(t)}) == 1


@pytest.mark.parametrize(("weight", "held"), [(1.4, 1.0), (0.3, 0.3), (0.005, None)])
@pytest.mark.parametrize("name", ["cb-giw-phd", "gm-phd"])
def test_one_vessel_is_held_of_a_weight_above_one_and_none_of_next_to_nothing(
    name: str, weight: float, held: float | None
) -> None:
    config = settings(name)
    tracker, state, at = TRACKERS[name](config), None, np.array([[0.0, 1000.0]])
    for k in range(8):
        state = step(config, state, at, 2.0 * k)
    tracks_of = getattr(state, "tracks", state)
    light = replace(tracks_of, existence=np.full(len(tracks_of), weight))
    scan, points = scan_of(NOTHING, 16.0)
    clusters = cluster_points(points, scan, config.cluster, config.input)
    changed = (
        light if state is tracks_of else replace(state, tracks=light, found=replace(state.found, w=light.existence))
    )
    after, _ = tracker.update(changed, replace(scan, covered=mask_at(at)), points, clusters)
    lies = getattr(after, "tracks", after)
    found = lies.existence[lies.held_s > 0]
    assert found.tolist() == ([] if held is None else [held])
