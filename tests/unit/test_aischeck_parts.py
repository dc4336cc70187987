"""The parts of the check of AIS: assignments, beams, land, chains of tracks, and whether its probabilities are true."""

from __future__ import annotations

import itertools
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial import cKDTree

from maritrack.aischeck.chains import linked
from maritrack.aischeck.coast import hidden, read_coast
from maritrack.aischeck.judge import MISFIT, _misfit
from maritrack.aischeck.looks import Looks, _beside, beam_s
from maritrack.aischeck.match import GATE, Matching, Noise, TrackRows, around, best_pairs, position_noise
from maritrack.aischeck.seeing import alike, p_so_few, p_so_many, seeing_of
from maritrack.aischeck.ships import Ship, comes_near, jumps, steps_m
from maritrack.aischeck.strangers import side_lobe_of
from maritrack.errors import InputError
from maritrack.geo import en_to_geodetic
from maritrack.io.ais import none_implausible
from maritrack.retrospect import History
from maritrack.types import CONFIRMED, Origin, Tracks

HERE = Origin(54.0, 10.0)


def ship(t_s, position_m, velocity_mps=None, **more) -> Ship:
    position_m = np.asarray(position_m, float)
    velocity = np.full(position_m.shape, np.nan) if velocity_mps is None else np.asarray(velocity_mps, float)
    told = {"length_m": 40.0, "width_m": 8.0, "max_gap_moving_s": 30.0, "max_gap_rest_s": 360.0, **more}
    return Ship("1", "S", t_s=np.asarray(t_s, float), position_m=position_m, velocity_mps=velocity, **told)


def test_a_ship_is_known_between_reports_that_are_near_enough_and_a_lag_shifts_them():
    one = ship([0, 10, 60], [[0, 0], [50, 0], [300, 0]])
    at, velocity, known = one.at(np.array([-1.0, 5.0, 30.0, 60.5]))
    assert known.tolist() == [False, True, False, False]
    assert_allclose(at[1], [25.0, 0.0])
    assert_allclose(velocity[1], [5.0, 0.0])
    assert_allclose(one.at(np.array([1.0]), lag_s=4.0)[0], [[25.0, 0.0]])
    still = ship([0, 300], [[0, 0], [3, 0]])
    assert still.at(np.array([150.0]))[2].tolist() == [True]
    assert ship([0], [[0, 0]]).at(np.array([0.0]))[2].tolist() == [False]


def test_a_step_off_the_way_that_course_and_speed_tell_is_a_leap_and_a_turn_is_none():
    t_s = np.arange(0.0, 60.0, 5.0)
    straight = np.stack([8.0 * t_s, np.zeros(len(t_s))], axis=-1)
    told = np.tile([8.0, 0.0], (len(t_s), 1))
    assert (steps_m(ship(t_s, straight, told)) == 0).all()
    leapt = straight + np.where(t_s[:, None] >= 30, [0.0, 300.0], 0.0)
    (jump,) = jumps([ship(t_s, leapt, told)], none_implausible(), 0)
    assert (jump.what, jump.t_ns) == ("step", 30 * 10**9)
    assert jump.off_m == pytest.approx(300.0, abs=1.0)
    angle = t_s * 0.05  # a turn of 3 degrees a second
    circle = 160.0 * np.stack([np.sin(angle), 1 - np.cos(angle)], axis=-1)
    turning = 8.0 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    assert (steps_m(ship(t_s, circle, turning)) == 0).all()
    assert (steps_m(ship(t_s, straight)) == 0).all()
    assert steps_m(ship([0, 5], [[0, 0], [5000, 0]]))[0] > 0


def test_ships_that_never_come_near_are_left_out():
    sensor_m = np.zeros((3, 2))
    assert comes_near(ship([0, 9], [[90_000, 0], [9000, 0]]), sensor_m, 10_000.0)
    assert not comes_near(ship([0, 9], [[90_000, 0], [19_000, 0]]), sensor_m, 10_000.0)


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.integers(1, 4), st.integers(1, 4), st.integers(0, 10_000))
def test_the_pairs_of_a_scan_are_the_best_of_all(n_rows, n_ships, seed):
    rng = np.random.default_rng(seed)
    table = rng.uniform(0, GATE, (n_rows, n_ships))
    row, which = (index.ravel() for index in np.indices(table.shape))
    chosen = best_pairs(np.zeros(table.size, int), row, which, table.ravel())
    ours = sum(table.ravel()[chosen]) - GATE * len(chosen)
    best = 0.0
    for k in range(1, min(n_rows, n_ships) + 1):
        for a, b in itertools.product(
            itertools.combinations(range(n_rows), k), itertools.permutations(range(n_ships), k)
        ):
            best = min(best, sum(table[i, j] - GATE for i, j in zip(a, b, strict=True)))
    assert ours == pytest.approx(best)
    assert len(set(row[chosen].tolist())) == len(set(which[chosen].tolist())) == len(chosen)


def test_costs_are_means_over_the_known_rows_around():
    value = np.array([1.0, 99.0, 3.0])
    known = np.array([True, False, True])
    assert_allclose(around(value, known), [2.0, 2.0, 2.0])
    assert np.isinf(around(value, np.zeros(3, bool))).all()


def test_the_beam_passes_at_the_time_of_the_point_next_to_it_over_north_too():
    azimuth = np.radians([10.0, 100.0, 350.0])
    assert_allclose(beam_s(np.radians([20.0, 359.0, 5.0]), azimuth, np.array([1.0, 2.0, 3.0]), 9.0), [1.0, 3.0, 1.0])
    assert_allclose(beam_s(np.array([1.0]), np.zeros(0), np.zeros(0), 9.0), [9.0])


def test_land_hides_what_is_behind_it_and_nothing_else():
    square = np.array([[1000.0, -100], [1100, -100], [1100, 100], [1000, 100], [1000, -100]])
    places = np.array([[900.0, 0], [2000, 0], [2000, 1000], [-2000, 0], [1050, 0]])
    sensor = np.zeros((5, 2))
    assert hidden(sensor, places, [square]).tolist() == [False, True, False, False, True]
    assert not hidden(sensor, places, []).any()
    assert hidden(np.zeros((0, 2)), np.zeros((0, 2)), [square]).tolist() == []


def test_coasts_are_read_from_every_kind_of_geojson():
    lat, lon = en_to_geodetic(HERE, np.array([[0.0, 0], [100, 0], [100, 100], [0, 0]]))
    ring = np.stack([lon, lat], axis=-1).tolist()
    polygon = {"type": "Polygon", "coordinates": [ring]}
    shapes = [
        polygon, {"type": "MultiPolygon", "coordinates": [[ring]]}, {"type": "LineString", "coordinates": ring},
        {"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": polygon, "properties": {}}]},
        {"type": "GeometryCollection", "geometries": [polygon, {"type": "Point", "coordinates": [0, 0]}]},
    ]  # fmt: skip
    for shape in shapes:
        (found,) = read_coast(json.dumps(shape).encode(), name="x", origin=HERE)
        assert_allclose(found[2], [100.0, 100.0], atol=1e-3)
    bad = [b"", b"[]", b"{", b'{"type":"Polygon"}', b'{"type":"Point","coordinates":[0,0]}', b"\xff",
           b'{"type":"Polygon","coordinates":[["a"]]}', b"[" * 5000]  # fmt: skip
    for data in bad:
        with pytest.raises(InputError, match=r"^x: "):
            read_coast(data, name="x", origin=HERE)


def history(pieces: list[tuple[int, int, int, tuple[float, float], tuple[float, float]]]) -> History:
    """Pieces of tracks: id, first scan, rows, place, velocity; scans are 2.5 s apart."""
    scan = np.concatenate([np.arange(first, first + n) for _, first, n, _, _ in pieces])
    id_ = np.concatenate([np.full(n, i) for i, _, n, _, _ in pieces])
    place = np.concatenate([np.array(p) + 2.5 * np.outer(np.arange(n), v) for _, _, n, p, v in pieces])
    velocity = np.concatenate([np.tile(v, (n, 1)) for _, _, n, _, v in pieces])
    n = len(scan)
    cov = np.tile(np.diag([100.0, 100, 1, 1]), (n, 1, 1))
    tracks = Tracks(
        id_, (scan * 2.5e9).astype(np.int64), place, velocity, cov, np.zeros((n, 2, 2)), np.ones(n),
        np.full(n, CONFIRMED), np.ones(n, bool), np.zeros(n, np.int64), (), np.full(n, np.nan),
    )  # fmt: skip
    return History(scan, tracks)


def test_pieces_that_go_on_are_one_and_others_are_not():
    first = (3, 0, 10, (0.0, 0.0), (8.0, 0.0))
    after = (7, 14, 10, (8.0 * 2.5 * 14, 10.0), (8.0, 0.5))
    elsewhere = (8, 14, 5, (280.0, 900.0), (8.0, 0.0))
    back = (9, 14, 5, (8.0 * 2.5 * 14, 0.0), (-8.0, 0.0))
    late = (10, 40, 5, (800.0, 0.0), (8.0, 0.0))
    chained, members = linked(history([first, after, elsewhere, back, late]))
    assert members == {3: (3, 7), 8: (8,), 9: (9,), 10: (10,)}
    assert chained.scan[chained.tracks.id == 3].tolist() == [*range(10), *range(14, 24)]
    assert len(chained) == 10 + 10 + 5 + 5 + 5


def looks_of(hits: np.ndarray, *, range_m: float = 2500.0) -> Looks:
    """Looks at ships (s, k)."""
    n_ships, n = hits.shape
    which, scan = (index.ravel() for index in np.indices(hits.shape))
    size = n_ships * n
    return Looks(
        which, scan, scan * 2.5, np.full(size, range_m), np.zeros(size), np.zeros((size, 2)), np.full(size, 5.0),
        np.full(size, 50.0), hits.ravel(), np.zeros(size), np.zeros(size, bool),
    )  # fmt: skip


@pytest.mark.parametrize("strength", [2.0, 8.0, 50.0])
def test_ships_that_are_there_are_called_unseen_no_oftener_than_said(strength):
    rng = np.random.default_rng(5)
    limit, wrong, trials = 0.01, 0, 400
    for _ in range(trials):
        p = rng.beta(0.8 * strength, 0.2 * strength, 9)
        hits = rng.random((9, 60)) < p[:, None]
        looks = looks_of(hits)
        seeing = seeing_of(looks, np.arange(9) > 0)  # the first is the one in question
        mean = float(np.nanmean(seeing.p_detect(without=0)))
        scale = 1.0 / seeing.independent
        wrong += p_so_few(hits[0].sum() * scale, 60 * scale, mean, seeing.spread_of_another(without=0)) < limit
    assert wrong <= limit * trials + 3.0 * math.sqrt(limit * trials) + 1.0


def test_fades_that_last_make_looks_count_for_less():
    rng = np.random.default_rng(2)
    quick = rng.random((6, 400)) < 0.5
    slow = np.repeat(rng.random((6, 50)) < 0.5, 8, axis=1)
    use = np.ones(2400, bool)
    assert alike(looks_of(quick), use) < 1.5
    assert alike(looks_of(slow), use) > 4.0
    assert alike(looks_of(np.ones((2, 5), bool)), np.ones(10, bool)) == 1.0
    assert alike(looks_of(quick), np.zeros(2400, bool)) == 1.0


def test_more_misses_are_less_likely_and_ships_that_differ_make_them_likelier():
    few = [p_so_few(0, n, 0.9, 0.1) for n in (1, 3, 10, 40)]
    assert few == sorted(few, reverse=True)
    assert p_so_few(0, 1, 0.9, 0.1) == pytest.approx(0.1)
    assert p_so_few(0, 10, 0.9, 0.3) > p_so_few(0, 10, 0.9, 0.1) > p_so_few(0, 10, 0.9, 1e-6)
    assert p_so_few(0, 10, 0.9, 1e-6) == pytest.approx(1e-10, rel=1e-2)
    assert p_so_few(10, 10, 0.9, 0.1) == pytest.approx(1.0)
    assert p_so_many(0, 10, 0.2, 0.1) == pytest.approx(1.0)
    assert p_so_many(6.4, 6.4, 0.6, 0.2) > 0.01  # parts of looks never make it impossible


def test_ranges_without_other_ships_tell_nothing():
    seeing = seeing_of(looks_of(np.ones((2, 40), bool)), np.array([True, False]))
    assert np.isnan(seeing.p_detect(without=0)).all()
    assert np.isfinite(seeing.p_detect()).sum() == 1
    assert seeing.spread == 0.3


def rows_at(position_m: np.ndarray, velocity_mps: tuple[float, float], *, step_s: float = 2.5) -> TrackRows:
    """A track of a radar at the origin, known to a metre and to a tenth of a metre a second."""
    n = len(position_m)
    return TrackRows(
        np.arange(n), np.full(n, 7), step_s * np.arange(n), position_m, np.tile(velocity_mps, (n, 1)),
        np.tile(np.diag([1.0, 1.0, 0.01, 0.01]), (n, 1, 1)), np.ones(n, bool), np.hypot(*position_m.T),
        np.arctan2(position_m[:, 0], position_m[:, 1]),
    )  # fmt: skip


def test_what_a_radar_is_off_in_azimuth_is_across_the_range_and_in_range_along_it():
    rows = rows_at(np.array([[0.0, 4000.0]]), (0.0, 0.0))
    P = position_noise(rows, np.array([0]), ship([0, 9], [[0, 0], [0, 0]]), np.zeros((1, 2)), Noise(0.01, 20.0))[0]
    every = 1.0 + 10.0**2 + 10.0**2  # the track, GNSS, a quarter of the hull
    assert_allclose(P, np.diag([every + 40.0**2, every + 20.0**2]), atol=1e-9)
    fast = position_noise(rows, np.array([0]), ship([0, 9], [[0, 0], [0, 0]]), np.array([[7.0, 0.0]]), Noise(0.0, 0.0))
    assert_allclose(fast[0], np.diag([every + 7.0**2, every]))  # a second of its way


@pytest.mark.parametrize(("off_mps", "wrong"), [(0.5, False), (1.3, False), (2.5, True)])
def test_courses_disagree_where_velocities_do_beyond_three_sigma(off_mps, wrong):
    t_s = np.arange(0.0, 40.0, 2.5)
    way = np.stack([6.0 * t_s, np.full(len(t_s), 3000.0)], axis=-1)
    rows, told = rows_at(way, (6.0, off_mps)), ship([-5, 50], [[-30, 3000], [300, 3000]], max_gap_moving_s=60.0)
    matching = Matching(np.zeros(len(way), int), np.zeros((len(way), 2)), np.zeros(len(way)))
    _, off, velocity, sigmas = _misfit(told, np.arange(len(way)), rows, matching, Noise(0.01, 20.0))
    assert off == 0.0
    assert_allclose(velocity, [0.0, off_mps], atol=1e-9)
    assert (sigmas**2 > MISFIT) == wrong


def test_echoes_of_other_ships_are_none_that_come_by_chance():
    at, radius = np.array([[0.0, 2000.0], [5 * 50.0, 1984.0]]), np.full(2, 50.0)
    range_m, azimuth = np.hypot(*at.T), np.arctan2(*at.T)
    sensor = np.zeros(2)
    assert_allclose(_beside(cKDTree(at), sensor, at, range_m, azimuth, radius), [0.0, 0.0])
    one = (at[:1], range_m[:1], azimuth[:1], radius[:1])
    assert_allclose(_beside(cKDTree(at), sensor, *one), [1 / 8])  # the same echo, when no ship tells that it is there
    assert_allclose(_beside(None, sensor, *one), [0.0])


@pytest.mark.parametrize(
    ("turned_deg", "farther_m", "lobe"),
    [(25.0, 0.0, "1"), (-40.0, 20.0, "1"), (100.0, 0.0, ""), (25.0, 150.0, ""), (4.0, 0.0, "")],
)
def test_a_track_that_keeps_the_range_of_a_ship_is_its_side_lobe(turned_deg, farther_m, lobe):
    t_s = np.arange(0.0, 150.0, 2.5)
    way = np.stack([6.0 * t_s - 400.0, np.full(len(t_s), 300.0)], axis=-1)
    told_s = np.arange(-10.0, 200.0, 10.0)
    loud = ship(told_s, np.stack([6.0 * told_s - 400.0, np.full(21, 300.0)], axis=-1))
    range_m, azimuth = np.hypot(*way.T) + farther_m, np.arctan2(way[:, 0], way[:, 1]) + np.radians(turned_deg)
    n = len(t_s)
    rows = TrackRows(
        np.arange(n), np.full(n, 7), t_s, np.stack([range_m * np.sin(azimuth), range_m * np.cos(azimuth)], -1),
        np.zeros((n, 2)), np.zeros((n, 4, 4)), np.ones(n, bool), range_m, azimuth,
    )  # fmt: skip
    noise = Noise(0.01, 22.0)
    assert side_lobe_of(rows, np.arange(n), [loud], noise) == lobe
    assert side_lobe_of(rows, np.arange(n), [], noise) == ""
    assert side_lobe_of(rows, np.arange(3), [loud], noise) == ""  # so short a way shows nothing
