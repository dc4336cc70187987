"""What trackers with a list of tracks share: clutter with its map, and what the background covers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from maritrack import geo
from maritrack.objects.giw import Giw
from maritrack.trackers import stationary, steps, tracklist
from maritrack.trackers.cluttermap import map_density
from maritrack.tracksettings import ClutterMapConfig
from maritrack.types import Clusters, Mask
from tests.unit.scans import clusters_of, plain_config, scan_of
from tests.unit.test_tracklist import tracks

PLACES = np.array([[100.0, 900.0], [2000.0, -400.0]])
CONFIG = replace(
    plain_config("jipda"),
    clutter_map=ClutterMapConfig(method="cells", least_rate=0.0, counts="not-moving", memory_s=5.0),
)


def seen() -> Clusters:
    """One cluster in each place."""
    clusters = clusters_of(CONFIG, PLACES, 1.0)
    assert len(clusters) == 2
    return clusters


def test_the_map_adds_to_the_clutter_density_of_its_sensor() -> None:
    clusters, (scan, _) = seen(), scan_of(PLACES, 1.0)
    scan = replace(scan, t_start_ns=0)
    learned = steps.with_clutter(tracklist.empty(), clusters, np.ones(2), scan, CONFIG)
    added = map_density(learned.clutter_map[scan.sensor.id], clusters.mean_m, CONFIG.clutter_map)
    fixed = CONFIG.model.clutter_density_per_m2
    assert (added > fixed).all()
    assert_allclose(steps.clutter_density(learned, clusters, scan, CONFIG), fixed + added)
    other, _ = scan_of(PLACES, 1.0, sensor="q")
    assert_allclose(steps.clutter_density(learned, clusters, other, CONFIG), fixed)


def test_clusters_of_tracks_that_move_are_no_clutter_those_of_others_are() -> None:
    clusters, (scan, _) = seen(), scan_of(PLACES, 1.0)
    scan = replace(scan, t_start_ns=0)
    held = tracks(2, cluster=np.array([0, 1]), moving=np.array([True, False]))
    learned = steps.with_clutter(held, clusters, np.zeros(2), scan, CONFIG)
    added = map_density(learned.clutter_map[scan.sensor.id], clusters.mean_m, CONFIG.clutter_map)
    assert added[0] == 0.0 and added[1] > 0.0


def test_none_is_covered_that_is_confirmed_and_moves_where_such_are_spared() -> None:
    config = plain_config("jipda", "subtract.method=abs", "subtract.spare=moving")
    here = Mask(geo.pixel_key(np.zeros((1, 2)), 100.0, (-50.0, -50.0)), 100.0, (-50.0, -50.0))
    scan = replace(scan_of(PLACES, 1.0)[0], covered=here)
    four = tracks(4, confirmed=np.array([True, True, False, False]), moving=np.array([True, False, True, False]))
    assert stationary.covered(four, scan, config).tolist() == [0.0, 1.0, 1.0, 1.0]
    unspared = replace(config, subtract=replace(config.subtract, spare="none"))
    assert stationary.covered(four, scan, unspared).tolist() == [1.0] * 4


@pytest.mark.parametrize(("pixel_m", "share"), [(80.0, 0.2), (120.0, 1.0), (240.0, 1.0)])
def test_covered_are_the_centre_and_the_middles_of_the_semi_axes(pixel_m: float, share: float) -> None:
    """Of semi-axes of 100 m the middles lie at 50 m: in a pixel of 120 m, not in one of 80 m."""
    corner = (-pixel_m / 2, -pixel_m / 2)
    mask = Mask(geo.pixel_key(np.zeros((1, 2)), pixel_m, corner), pixel_m, corner)
    one = tracks(1)
    one = replace(one, density=replace(one.density, X=100.0**2 * np.eye(2)[None]))
    assert_allclose(stationary.covered_share(one, mask), share)


def test_each_of_two_stations_hides_its_side_of_a_vessel_and_sees_less_of_that_side_alone() -> None:
    """Of a hull from west to east one hides the west end and the other the rest; only the two together hide it."""
    config = plain_config("jipda", "subtract.method=abs", "tracker.covered_detect=0.1")
    one = tracks(1)
    one = replace(one, density=replace(one.density, X=np.diag([100.0**2, 4.0])[None]))
    at, corner = np.array([[-50.0, 0.0], [0.0, 0.0], [50.0, 0.0]]), (-15.0, -15.0)
    west, rest = (Mask(np.sort(geo.pixel_key(x, 30.0, corner)), 30.0, corner) for x in (at[:1], at[1:]))
    scan = replace(scan_of(PLACES, 1.0)[0], covered=west)
    assert stationary.hidden(one, scan, config).tolist() == stationary.covered(one, scan, config).tolist() == [0.2]
    both = replace(scan, also_covered=(rest,))
    assert stationary.hidden(one, both, config).tolist() == [1.0]
    (p_alone, _, alone), (p, share, own) = (steps.chances(one, s, config) for s in (scan, both))
    assert p_alone.tolist() == p.tolist() == [config.model.p_detect * 0.8]
    assert share.tolist() == [1.0]
    assert alone.tolist() == own.tolist() == [0.2]


@pytest.mark.parametrize("several", [True, False])
def test_what_shows_of_one_that_is_held_moves_it_until_a_step_shows_nothing(several: bool) -> None:
    """A held vessel; a scan that sees some of it, one of another sensor that doesn't, and two steps of nothing."""
    rules, mask, no = replace(CONFIG.tracker, stationary_s=60.0), Mask(np.zeros(0, np.int64), 100.0), np.zeros(1, bool)
    scan = replace(scan_of(PLACES, 1.0)[0], covered=mask, also_covered=(mask,) if several else ())
    before = tracks(1, confirmed=~no, held_s=np.array([20.0]))
    moves = replace(before.density, x=np.array([[5.0, 0.0, 1.0, 0.0]]))

    def after(last: tracklist.TrackList, hit: np.ndarray, sensor: str) -> tracklist.TrackList:
        now = replace(tracklist.count(last, hit, sensor), t_ns=last.t_ns + 10**9, density=moves)
        return stationary.hold_covered(now, last, hit, np.ones(1), scan, rules)

    told, speed, held = before, [], []
    for hit, sensor in ((~no, "a"), (no, "b"), (no, "a"), (no, "b"), (no, "a")):
        told = after(told, hit, sensor)
        speed.append(float(told.density.x[0, 2]))
        held.append(float(told.held_s[0]))
    assert speed == [1.0, 1.0, 1.0, 1.0, 0.0]
    assert all(0.0 < s < 1e-6 for s in held[:4]) and held[4] > 0.9
    pixel_m2 = 0.0 if several else 100.0**2 * np.eye(2)  # of several sensors it costs no certainty again
    assert_allclose(told.density.P[0, :2, :2], moves.P[0, :2, :2] + pixel_m2, rtol=0)
    first = stationary.hold_covered(replace(before, held_s=np.zeros(1)), before, no, np.ones(1), scan, rules)
    assert first.density.x[0, 2] == 0.0


@pytest.mark.parametrize(("share", "held"), [(0.4, False), (0.6, True), (1.0, True)])
def test_a_track_is_held_that_is_covered_by_half(share: float, held: bool) -> None:
    rules = replace(CONFIG.tracker, stationary_s=60.0)
    before = tracks(1, confirmed=np.ones(1, bool))
    after = replace(before, t_ns=before.t_ns + 10**9, misses=before.misses + 1)
    scan = replace(scan_of(PLACES, 1.0)[0], covered=Mask(np.zeros(0, np.int64), 100.0))
    found = stationary.hold_covered(after, before, np.zeros(1, bool), np.array([share]), scan, rules)
    assert (found.held_s[0] > 0) == held and found.misses[0] == (0 if held else 1)
    assert isinstance(found.density, Giw)
