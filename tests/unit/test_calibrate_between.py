"""Fits between two radars: echoes at the end of a hull that is turned to each, and tracks that stand for ships."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from maritrack import geo
from maritrack.calibrate.estimate import steady
from maritrack.calibrate.fit import CHANGES, FIXED, Fit, first_guess, fit
from maritrack.calibrate.sightings import MOST_VALUES, Sightings, Way, as_seen, thinned
from maritrack.calibrate.wander import MOST_KNOTS, knots, spacing_s, wander_prior
from maritrack.retrospect import gather
from maritrack.types import CONFIRMED, FloatArray, Tracks

TURN_S, SCANS = 3.0, 100
THERE_M, HERE_M = np.array([-1500.0, 0.0]), np.array([1400.0, 150.0])
START_M, VELOCITY_MPS = np.array([-700.0, 300.0]), np.array([2.0, -1.5])
TRUE = (math.radians(0.8), 12.0, 1.5)  # azimuth, range, latency


def echo(centre_m: FloatArray, course: FloatArray, radar_m: FloatArray, end_m: float) -> FloatArray:
    """Where a radar sees a hull (n, 2): off its centre, by so much where it looks along it."""
    ray = (centre_m - radar_m) / np.hypot(*(centre_m - radar_m).T)[:, None]
    return np.asarray(centre_m - end_m * (ray @ course)[:, None] * course)


def scene(seed: int, half_m: list[float], *, uneven: float, slide_m: float = 0.0) -> tuple[Sightings, list[Way]]:
    """What the radar here sees of ships that pass between both, and their tracks by the radar there.

    Each shows the one radar up to `uneven` more, the other as much less, of its half length. Where echoes slide here,
    the ships go twice as fast from then on.
    """

    def gone(since_s: FloatArray) -> FloatArray:
        return np.asarray(since_s + (np.maximum(since_s, 0.0) if slide_m else 0.0))

    rng = np.random.default_rng(seed)
    t_s, ways, rows = TURN_S * np.arange(SCANS), [], []
    for i, half in enumerate(half_m):
        angle, speed = rng.uniform(-0.5, 0.5) + math.pi * rng.integers(2), rng.uniform(3.0, 7.0)
        course = np.array([math.cos(angle), math.sin(angle)])
        middle = np.array([rng.uniform(-300, 300), (300.0 + 150.0 * i) * rng.choice([-1, 1])])
        more = rng.uniform(-uneven, uneven)
        slides_m = slide_m * np.tanh((t_s - TRUE[2] - t_s[-1] / 2) / 20.0)
        told_s = np.arange(-60.0, t_s[-1] + 60.0, TURN_S)
        ends = [
            echo(middle + np.outer(speed * gone(at - t_s[-1] / 2), course), course, radar, half * share)
            for at, radar, share in ((told_s, THERE_M, 1 + more), (t_s - TRUE[2], HERE_M, 1 - more))
        ]
        ways.append(
            Way(f"T{i}", "", math.nan, math.nan, 5.0, told_s, ends[0], 10.0, np.tile(THERE_M, (len(told_s), 1)))
        )
        rows.append(ends[1] + np.outer(slides_m, course) + rng.normal(0.0, 4.0, (SCANS, 2)))
    place = np.stack(rows, axis=1).reshape(-1, 2)
    range_m, azimuth_rad = geo.en_to_polar(place - HERE_M)
    scan = np.repeat(np.arange(SCANS), len(half_m))
    seen = Sightings(
        scan, t_s[scan], range_m - TRUE[1], geo.wrap_positive(azimuth_rad - TRUE[0]), t_s, np.tile(HERE_M, (SCANS, 1)),
        0, 5000.0, 0.0, 0.0,
    )  # fmt: skip
    return seen, ways


def fitted(seen: Sightings, ways: list[Way]) -> Fit:
    guess = first_guess(TRUE[0], TRUE[1], np.zeros(len(ways)))
    return fit(seen, tuple(as_seen(way, seen) for way in ways), guess, lags=False)


def normalised(found: Fit) -> FloatArray:
    """Errors of azimuth, range and latency in standard deviations."""
    return np.array([(found.value[i] - TRUE[i]) / found.sigma(i) for i in range(3)])


def test_how_long_hulls_are_comes_out_where_both_radars_see_the_end_that_is_turned_to_them() -> None:
    half_m = [10.0, 40.0, 70.0, 110.0, 25.0]
    found = fitted(*scene(1, half_m, uneven=0.0))
    assert_allclose(found.value[FIXED + 3 * len(half_m) :], half_m, atol=20.0)  # they start from 25
    assert (np.abs(normalised(found)) < 3.0).all()


def test_deviations_between_radars_are_what_the_errors_of_many_scenes_are() -> None:
    """Though the bow may show one radar more than the stern shows the other: errors of about one, not of many."""
    told = []
    for seed in range(12):
        half_m = np.random.default_rng(seed).uniform(10.0, 100.0, 4).tolist()
        told.append(normalised(fitted(*scene(seed, half_m, uneven=0.6))))
    rms = np.sqrt(np.mean(np.square(told), axis=0))
    assert (rms < 1.7).all() and (np.abs(told) < 4.0).all(), (rms, np.abs(told).max(axis=0))


@pytest.mark.parametrize("slide_m", [10.0, -10.0])
def test_echoes_that_slide_as_ships_gather_way_do_not_tell_surely_how_late_a_radar_is(slide_m: float) -> None:
    """All four alike, the worst case: with one place for each echo the error would be five standard deviations."""
    told = [
        normalised(fitted(*scene(seed, [60.0, 40.0, 70.0, 50.0], uneven=0.0, slide_m=slide_m)))[2] for seed in (0, 1)
    ]
    assert (np.abs(told) < 3.0).all(), told


def test_a_way_loses_what_is_of_the_hull_and_keeps_the_course() -> None:
    t_s = np.append(np.arange(0.0, 600.0, 3.0), np.arange(700.0, 900.0, 3.0))
    straight = START_M + np.outer(t_s, VELOCITY_MPS)
    slid = straight + np.outer(20.0 * np.tanh((t_s - 300.0) / 8.0), VELOCITY_MPS / 2.5)
    seen, _ = scene(1, [50.0], uneven=0.0)
    way = Way("T1", "", math.nan, math.nan, 60.0, t_s, straight, 10.0, np.tile(THERE_M, (len(t_s), 1)))
    assert_allclose(as_seen(way, seen).position_m, straight, atol=1e-6)
    speeds = [
        np.hypot(*np.diff(one.position_m, axis=0).T)[:190] / 3.0
        for one in (way, replace(way, position_m=slid), as_seen(replace(way, position_m=slid), seen))
    ]
    off_mps = [float(np.abs(one - speeds[0]).max()) for one in speeds]
    assert off_mps[1] > 2.0 and off_mps[2] < 0.5
    assert_allclose(as_seen(replace(way, position_m=slid), seen).position_m[200:], slid[200:], atol=0.1)  # beyond a gap


def test_a_range_between_radars_is_no_surer_than_how_much_of_a_hull_shows() -> None:
    seen, ways = scene(1, [50.0, 20.0, 30.0], uneven=0.0)
    least_m = CHANGES * min(as_seen(way, seen).bias_m for way in ways) / math.sqrt(3)
    assert fitted(seen, ways).sigma(1) > least_m > 4.0


def test_an_echo_may_lie_farther_off_the_more_the_views_of_two_radars_differ() -> None:
    seen, (way, *_) = scene(3, [50.0, 20.0], uneven=0.0)
    same = replace(way, seen_from_m=np.tile(HERE_M, (len(way.t_s), 1)))
    assert as_seen(same, seen).bias_m == way.bias_m == 5.0
    assert 30.0 < as_seen(way, seen).bias_m <= math.hypot(50.0, 5.0)
    told = replace(way, seen_from_m=None)
    assert as_seen(told, seen) is told


def test_tracks_that_stand_for_ships_are_long_lived_often_hit_and_steady() -> None:
    def track(
        id_: int, n: int, *, missed: int = 0, speeds: tuple[float, float] = (5.0, 5.0)
    ) -> list[tuple[int, int, float]]:
        return [(k, -1 if k < missed else 0, speeds[k % 2]) for k in range(n) for _ in [id_]]

    under_way = [(k, 0, min(0.5 * k, 5.0)) for k in range(40)]
    tracks = {1: track(1, 30), 2: track(2, 12), 3: track(3, 40, missed=20), 4: track(4, 30, speeds=(2.0, 8.0)),
              5: track(5, 40, missed=15, speeds=(4.6, 5.4)), 6: under_way}  # fmt: skip
    scans = []
    for k in range(40):
        here = [(id_, *rows[k][1:]) for id_, rows in tracks.items() if k < len(rows)]
        n, (ids, cluster, speed) = len(here), zip(*here, strict=True)
        scans.append((k, Tracks(
            np.array(ids), np.full(n, k * 10**9), np.zeros((n, 2)), np.outer(speed, [0.6, 0.8]),
            np.tile(np.eye(4), (n, 1, 1)), np.tile(np.eye(2), (n, 1, 1)), np.ones(n),
            np.full(n, CONFIRMED), np.ones(n, bool), np.array(cluster), (),
            np.full(n, 9.0),
        )))  # fmt: skip
    history = gather(scans)
    assert np.unique(history.tracks.id[steady(history)]).tolist() == [1, 5, 6]


def test_of_long_recordings_some_scans_and_few_knots_are_enough() -> None:
    seen, ways = scene(1, [60.0, 80.0, 40.0, 70.0], uneven=0.0)
    known = tuple(as_seen(way, seen) for way in ways)
    columns = 4 + 4 * len(ways) + len(wander_prior(known))
    assert thinned(seen, known, columns=columns) is seen
    few = thinned(seen, known, columns=2 * MOST_VALUES // (2 * SCANS * len(ways)))
    assert 0 < len(few) < len(seen) and set(few.scan) < set(seen.scan)
    found = fitted(few, ways)
    assert np.abs(normalised(found)).max() < 3.0 and found.sigma(0) > 0.9 * fitted(seen, ways).sigma(0)
    t_s = np.arange(0.0, 86_400.0, 600.0)
    days = tuple(replace(known[0], t_s=t_s) for _ in range(100))
    assert 2 * sum(knots(way, spacing_s(days)) for way in days) < 2 * (MOST_KNOTS + 3 * len(days))
