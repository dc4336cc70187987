"""The judgement of motion, births, ends, beam times and coverage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

from maritrack import geo
from maritrack.chain import build_chain, process
from maritrack.detect.cells import empty_points
from maritrack.objects import giw
from maritrack.objects.giw import Giw
from maritrack.settings import Config
from maritrack.trackers import tracklist
from maritrack.trackers.tracklist import TrackList
from maritrack.tracksettings import ModelConfig, TrackerConfig
from maritrack.types import COASTED, CONFIRMED, TENTATIVE, Frame, Points, Scan, Sensor, Video

RULES = TrackerConfig()


def tracks(n: int, **changes: object) -> TrackList:
    d = Giw(np.zeros((n, 4)), np.tile(np.eye(4), (n, 1, 1)), np.tile(np.eye(2), (n, 1, 1)), np.full(n, 4.0))
    base = TrackList(
        d, np.zeros(n, np.int64), np.full(n, 0.9), np.arange(1, n + 1), np.full(n, 9), np.zeros(n, np.int64),
        np.zeros(n, bool), np.zeros((n, 2)), np.zeros(n, bool), np.zeros(n), np.full(n, -1),
        np.zeros(n, np.int64), np.zeros(n), n + 1,
    )  # fmt: skip
    return replace(base, **changes)  # type: ignore[arg-type]


def turning_scan(*, start: float, spokes: int = 360, backwards_at: int = -1) -> Scan:
    azimuth = (start + np.arange(spokes) * 2 * np.pi / spokes) % (2 * np.pi)
    if backwards_at >= 0:
        azimuth[backwards_at] = azimuth[backwards_at - 3]
    t = np.arange(spokes) * 10**7
    video = Video(
        azimuth_rad=azimuth, width_rad=np.full(spokes, 2 * np.pi / spokes), t_ns=t, first_range_m=5.0, cell_m=10.0,
        intensity=np.zeros((spokes, 4), np.uint8), cells_used=np.full(spokes, 4),
    )  # fmt: skip
    return Scan(Sensor("r", 10.0, 0.017, 5000.0), int(t[-1]), 0, np.zeros(2), np.nan, video=video)


def test_beam_time_is_the_time_of_the_spoke_at_that_azimuth_wherever_the_turn_begins() -> None:
    for start in (0.0, 1.0, 3.5, 6.2):
        for at in (5, 90, 180, 300):
            scan = turning_scan(start=start, backwards_at=50)
            assert scan.video is not None
            azimuth = scan.video.azimuth_rad[at]
            position = 1000.0 * np.array([[np.sin(azimuth), np.cos(azimuth)]])
            assert_allclose(tracklist.beam_time(scan, empty_points(), position), [at * 10**7], atol=2)


def test_beam_time_without_video_is_the_common_time_of_the_points() -> None:
    scan = Scan(Sensor("r", 0, 0, np.inf), 77, 77, np.zeros(2), np.nan)
    assert tracklist.beam_time(scan, empty_points(), np.ones((3, 2))).tolist() == [77, 77, 77]


def test_beam_time_of_plots_counts_from_the_first_plot() -> None:
    azimuth = np.array([0.5, 2.0, 4.0])
    xy = np.stack([np.sin(azimuth), np.cos(azimuth)], 1) * 900
    t = (1e9 * (azimuth - 0.5) / (2 * np.pi)).astype(np.int64)
    points = Points(
        range_m=np.full(3, 900.0), azimuth_rad=azimuth, position_m=xy, intensity=np.ones(3), t_ns=t,
        range_width_m=np.zeros(3), azimuth_width_rad=np.zeros(3),
    )  # fmt: skip
    scan = Scan(Sensor("r", 0, 0, np.inf), 10**9, 0, np.zeros(2), np.nan)
    assert_allclose(tracklist.beam_time(scan, points, xy), t, atol=2)


def test_nothing_is_visible_beyond_the_range_or_in_a_sector_that_was_not_swept() -> None:
    swept = np.ones(720, bool)
    swept[:180] = False  # the first quarter, North to East
    scan = replace(turning_scan(start=0.0), swept=swept)
    at = np.array([[100.0, 100.0], [100.0, -100.0], [0.0, -6000.0]])
    assert geo.visible(scan, at, 0.0, np.inf).tolist() == [False, True, False]
    assert geo.visible(scan, at, 200.0, np.inf).tolist() == [False, False, False]


def test_a_steady_mover_is_moving_and_an_echo_that_jumps_to_and_fro_is_not() -> None:
    steady, jumpy = tracks(1), tracks(1)
    for k in range(40):
        d = replace(steady.density, x=np.array([[3.0 * 2.5 * k, 0, 3.0, 0]]), P=0.01 * np.eye(4)[None])
        steady = tracklist.follow(replace(steady, density=d), np.array([2.5]), RULES)
        d = replace(steady.density, x=np.array([[20.0 * (-1) ** k, 0, 3.0, 0]]), P=0.01 * np.eye(4)[None])
        jumpy = tracklist.follow(replace(jumpy, density=d), np.array([2.5]), replace(RULES, moving_displacement_m=30.0))
    assert tracklist.moving(steady, RULES).all()
    assert not tracklist.moving(jumpy, replace(RULES, moving_displacement_m=30.0)).any()


def test_confirmation_needs_existence_and_hits() -> None:
    config = Config(tracker=replace(RULES, confirm_existence=0.95, confirm_hits=3))
    t = tracks(3, existence=np.array([0.99, 0.99, 0.5]), hits=np.array([3, 2, 9]))
    assert tracklist.manage(t, config).confirmed.tolist() == [True, False, False]


def test_a_track_ends_by_existence_misses_uncertainty_or_speed() -> None:
    config = Config()
    d = tracks(5).density
    x, P = d.x.copy(), d.P.copy()
    x[3, 2], P[2, 0, 0] = 99.0, 1e9
    t = tracks(
        5,
        density=replace(d, x=x, P=P),
        existence=np.array([0.01, 0.9, 0.9, 0.9, 0.9]),
        misses=np.array([0, 99, 0, 0, 0]),
    )
    assert tracklist.manage(t, config).id.tolist() == [5]


def test_a_track_ends_by_an_extent_that_nothing_has_told_for_long_or_that_is_too_long() -> None:
    d = replace(
        tracks(4).density,
        alpha=np.array([2.04, 2.04, 2.06, 30.0]),
        X=np.array([[1.0, 1.0], [1.0, 1.0], [1.0, 1.0], [99.0**2, 4.0]])[:, :, None] * np.eye(2),
    )
    t = tracks(4, density=d, misses=np.array([1, 0, 1, 0]))
    assert tracklist.manage(t, Config()).id.tolist() == [1, 2, 3, 4]
    assert tracklist.manage(t, Config(tracker=replace(RULES, delete_alpha=2.05))).id.tolist() == [2, 3, 4]
    assert tracklist.manage(t, Config(tracker=replace(RULES, delete_axis_m=98.0))).id.tolist() == [1, 2, 3]
    assert tracklist.manage(t, Config(tracker=replace(RULES, delete_axis_m=100.0))).id.tolist() == [1, 2, 3, 4]
    points = Config(tracker=replace(RULES, delete_alpha=2.05), model=ModelConfig(extent="point"))
    assert tracklist.manage(t, points).id.tolist() == [1, 2, 3, 4]


def test_of_two_tracks_on_one_object_the_confirmed_one_stays_then_the_one_with_more_hits_then_the_older() -> None:
    rules = replace(RULES, duplicate_distance_m=10.0)
    assert tracklist.duplicates(tracks(2), rules).tolist() == [False, True]
    assert tracklist.duplicates(tracks(2, confirmed=np.array([False, True])), rules).tolist() == [True, False]
    sure = tracks(3, confirmed=np.array([True, True, False]), hits=np.array([40, 460, 900]))
    assert tracklist.duplicates(sure, rules).tolist() == [True, False, True]
    even = replace(sure, hits=np.array([40, 40, 900]))
    assert tracklist.duplicates(even, rules).tolist() == [False, True, True]
    apart = replace(tracks(2).density, x=np.array([[0.0, 0, 5, 0], [0.0, 0, -5, 0]]))
    assert not tracklist.duplicates(tracks(2, density=apart), rules).any()


def test_each_limit_ends_a_track_just_beyond_it_and_not_just_within() -> None:
    """Combined pruning: existence, misses in a row, position, speed. Rows: one just within, one just beyond."""
    rules = replace(RULES, delete_existence=0.05, delete_misses=3, delete_sigma_m=200.0)
    config = Config(model=ModelConfig(max_speed_mps=30.0), tracker=rules)
    pair = tracks(2)
    assert tracklist.manage(replace(pair, existence=np.array([0.051, 0.049])), config).id.tolist() == [1]
    assert tracklist.manage(replace(pair, misses=np.array([3, 4])), config).id.tolist() == [1]
    for axis in (0, 1):
        P = pair.density.P.copy()
        P[:, axis, axis] = [199.0**2, 201.0**2]
        assert tracklist.manage(replace(pair, density=replace(pair.density, P=P)), config).id.tolist() == [1]
    x = pair.density.x.copy()
    x[:, 2:] = [[20.9, 20.9], [21.4, 21.4]]  # 29.6 and 30.3 m/s
    assert tracklist.manage(replace(pair, density=replace(pair.density, x=x)), config).id.tolist() == [1]


def test_a_place_is_known_as_long_as_the_predicted_covariance_says() -> None:
    """Rows: moments at which the larger of the two variances, that of north, is just within and just beyond."""
    config = Config(tracker=replace(RULES, delete_sigma_m=200.0))
    P = np.diag([1.0, 4.0, 9.0, 16.0])
    P[1, 3] = P[3, 1] = 5.0
    d = replace(tracks(1).density, P=P[None])
    dt_s = np.arange(0.0, 100.0, 0.5)
    sigma_m = np.array([np.sqrt(giw.predict(d, np.array([dt]), config.model).P[0, 1, 1]) for dt in dt_s])
    got = [bool(tracklist.known(tracks(1, density=d), round(dt * 1e9), config)[0]) for dt in dt_s]
    assert got == (sigma_m <= 200.0).tolist() and 0 < sum(got) < len(got)
    assert tracklist.known(tracks(1, density=d), -(10**12), config).all()  # a clock that stepped back


def test_a_new_track_far_away_may_be_looked_for_after_a_turn_but_not_after_a_gap() -> None:
    config = Config(tracker=replace(RULES, delete_sigma_m=200.0))
    far = tracks(1, density=replace(tracks(1).density, P=np.diag([250.0**2, 10.0, 100.0, 100.0])[None]))
    assert [bool(tracklist.known(far, t * 10**9, config)[0]) for t in (0, 3, 19, 21)] == [True, True, True, False]


def test_what_is_new_in_the_hull_of_a_confirmed_track_is_a_part_of_it() -> None:
    """A hull 200 m long; the others are 60 m and 115 m from its middle, along and across."""
    t = tracks(4, confirmed=np.array([False, True, False, False]))
    x = np.zeros((4, 4))
    x[:, 0], x[:, 1] = [60.0, 0.0, 115.0, 0.0], [0.0, 0.0, 0.0, 60.0]
    X = np.tile(np.diag([100.0**2, 10.0**2]), (4, 1, 1))
    d = replace(t.density, x=x, P=np.tile(np.diag([25.0, 25.0, 1.0, 1.0]), (4, 1, 1)), X=X)
    assert tracklist.parts(replace(t, density=d), 4.0, 0.25).tolist() == [True, False, False, False]
    both = replace(t, density=d, confirmed=np.array([True, True, False, False]))
    assert tracklist.parts(both, 4.0, 0.25).tolist() == [False, False, True, False]  # in the hull of the first
    faster = replace(d, x=x + np.array([0.0, 0.0, 0.0, 5.0]) * (np.arange(4) == 0)[:, None])
    assert not tracklist.parts(replace(t, density=faster), 4.0, 0.25).any()


def test_status_tells_tentative_confirmed_and_coasted() -> None:
    t = tracks(3, confirmed=np.array([False, True, True]), misses=np.array([0, 0, 2]))
    assert tracklist.estimate(t, RULES).status.tolist() == [TENTATIVE, CONFIRMED, COASTED]


def test_birth_existence_follows_the_birth_density_where_none_is_given() -> None:
    """The figures of extended, sec. 4.1."""
    config = Config(
        model=ModelConfig(p_detect=0.9), tracker=replace(RULES, birth_existence=0.0, birth_density_per_m2=1e-6)
    )
    assert_allclose(tracklist.birth_existence(config, np.array([6.4e-4])), 1.4e-3, rtol=0.01)


def test_way_made_good_of_a_steady_mover_does_not_depend_on_the_interval() -> None:
    """v tau at a steady v, whatever the time between scans."""
    for dt in (1.0, 10.0, 60.0, 300.0):
        t = tracks(1)
        for k in range(1, 400):
            d = replace(t.density, x=np.array([[5.0 * dt * k, 0, 5.0, 0]]))
            t = tracklist.follow(replace(t, density=d), np.array([dt]), RULES)
        assert_allclose(t.density.x[0, 0] - t.lag_m[0, 0], 5.0 * RULES.moving_time_constant_s, rtol=1e-4)


def test_beam_time_of_an_antenna_that_turns_the_other_way() -> None:
    scan = turning_scan(start=0.0)
    assert scan.video is not None
    back = replace(scan, video=replace(scan.video, azimuth_rad=(-scan.video.azimuth_rad) % (2 * np.pi)))
    position = 900.0 * np.array([[np.sin(-1.0), np.cos(-1.0)]])
    assert_allclose(tracklist.beam_time(back, empty_points(), position), [1.0 / (2 * np.pi) * 3.6e9], rtol=0.01)


def test_each_sensor_learns_its_own_clutter() -> None:
    config = Config(model=ModelConfig(clutter="estimated"))
    chain = build_chain(config)
    state = chain.init()
    for k, (name, reach) in enumerate([("a", 20_000.0), ("b", 8_000.0)] * 3):
        scan = replace(
            turning_scan(start=0.0), sensor=Sensor(name, 10.0, 0.017, reach), t_ns=k * 10**9, t_start_ns=k * 10**9
        )
        state, _ = process(chain, state, Frame(k, scan))
    assert {n: c.ring_m for n, c in state.tracker.clutter.items()} == {"a": 1250.0, "b": 500.0}


def test_hits_and_misses_count_once_a_step_whichever_sensors_see_it() -> None:
    state = tracks(2, hits=np.zeros(2, np.int64))
    told = [("a", 1, 0), ("b", 0, 0), ("c", 1, 0), ("a", 0, 0), ("b", 0, 1), ("a", 0, 0)]
    counts = []
    for sensor, *hit in told:
        state = tracklist.count(state, np.array(hit, bool), sensor)
        counts.append((*state.hits.tolist(), *state.misses.tolist()))
    assert counts == [(1, 0, 0, 1), (1, 0, 0, 1), (1, 0, 0, 1), (1, 0, 1, 2), (1, 1, 1, 0), (1, 1, 2, 1)]


def test_beside_a_slow_sensor_the_steps_are_those_of_the_fast_one() -> None:
    state = tracks(1, hits=np.zeros(1, np.int64))
    misses = []
    for sensor in ("fast", "fast", "fast", "slow") * 2:
        state = tracklist.count(state, np.array([sensor == "slow" and len(misses) > 4]), sensor)
        misses.append(int(state.misses[0]))
    assert misses == [1, 2, 3, 3, 4, 5, 6, 0] and state.hits.tolist() == [1]


def test_with_one_sensor_each_scan_is_a_step() -> None:
    rng, state, hits, misses = np.random.default_rng(0), tracks(5, hits=np.zeros(5, np.int64)), 0, np.zeros(5, int)
    for _ in range(20):
        hit = rng.random(5) < 0.6
        state, hits, misses = tracklist.count(state, hit, "a"), hits + hit, np.where(hit, 0, misses + 1)
    assert state.hits.tolist() == hits.tolist() and state.misses.tolist() == misses.tolist()
