"""The simulated radar obeys geometry: where an echo lies, what a shadow hides, what a rotation changes."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from maritrack.geo import TWO_PI, wrap
from maritrack.simulate.antenna import RadarSettings
from maritrack.simulate.echoes import Echo, Mover, echoes, fades, movers
from maritrack.simulate.radar import turn, video
from maritrack.simulate.rays import BEAM_REACH, beam, inside_length, returned, through
from maritrack.simulate.record import pass_times_s
from maritrack.simulate.scenery import Land, Scenery, Sea, scenery
from maritrack.simulate.vessels import Vessel

RADAR = RadarSettings(
    turn_s=2.5, spokes=720, beam_deg=0.8, cells=400, cell_m=10.0, pulse_m=20.0, unit_range_m=6000.0,
    floor_db=0.0, full_db=40.0,
)  # fmt: skip
OPEN_SEA = scenery(RADAR, (), Sea(), seed=0)


def vessel(**settings: object) -> Vessel:
    basic = {"id": "v", "length_m": 60.0, "width_m": 12.0, "rcs_m2": 1000.0, "waypoints_m": ((0.0, 2000.0),)}
    return Vessel(**(basic | settings))  # type: ignore[arg-type]


def at(range_m: float, azimuth_deg: float) -> tuple[tuple[float, float]]:
    a = math.radians(azimuth_deg)
    return ((range_m * math.sin(a), range_m * math.cos(a)),)


def image(*fleet: Vessel, still: Scenery = OPEN_SEA, k: int = 0) -> np.ndarray:
    """Mean power of all vessels, (spokes, cells)."""
    power = np.zeros((RADAR.spokes, RADAR.cells))
    for echo in echoes(RADAR, movers(RADAR, fleet), still, k):
        power[echo.spokes, echo.first_cell : echo.first_cell + echo.power.shape[1]] += echo.power
    return power


def star(radii_m: list[float], centre_m: tuple[float, float]) -> np.ndarray:
    a = TWO_PI * np.arange(len(radii_m)) / len(radii_m)
    return np.array(centre_m) + np.array(radii_m)[:, None] * np.stack([np.cos(a), np.sin(a)], 1)


@settings(derandomize=True, deadline=None, max_examples=60)
@given(
    st.lists(st.floats(20, 400), min_size=5, max_size=12),
    st.tuples(st.floats(-300, 300), st.floats(-300, 300)),
    st.floats(0, 6.28),
    st.booleans(),
)
def test_length_inside_a_polygon_is_that_of_the_clipped_ray(
    radii_m: list[float], centre_m: tuple[float, float], azimuth_rad: float, clockwise: bool
) -> None:
    polygon_m = star(radii_m, centre_m)[:: -1 if clockwise else 1]
    ranges_m = np.array([50.0, 200.0, 1000.0])
    ours = inside_length(polygon_m, np.array([azimuth_rad]), ranges_m)[0]
    ends_m = ranges_m[:, None] * [math.sin(azimuth_rad), math.cos(azimuth_rad)]
    oracle = [shapely.Polygon(polygon_m).intersection(shapely.LineString([(0, 0), end])).length for end in ends_m]
    assert_allclose(ours, oracle, atol=1e-6)


def test_what_does_not_pass_a_body_comes_back_from_it() -> None:
    polygon_m, azimuth_rad = star([60.0] * 8, (0.0, 500.0)), np.linspace(-0.2, 0.2, 41)
    share = returned(polygon_m, azimuth_rad, np.arange(0.0, 1001.0, 10.0), reach_m=20.0, pulse_m=15.0)
    passed = through(inside_length(polygon_m, azimuth_rad, np.array([1000.0]))[:, 0] / 20.0)
    assert_allclose(share.sum(axis=1) + passed, 1.0, atol=1e-12)


def test_the_two_way_pattern_falls_to_a_quarter_half_a_beam_width_off_the_axis() -> None:
    assert_allclose(beam(np.array([0.0, 0.005, -0.005]), beam_rad=0.01), [1.0, 0.25, 0.25], rtol=1e-12)


@pytest.mark.parametrize("azimuth_deg", [0.0, 33.0, 180.0, 359.9])
def test_an_echo_lies_within_the_hull_smeared_by_beam_and_pulse(azimuth_deg: float) -> None:
    one = vessel(waypoints_m=at(1500.0, azimuth_deg), heading_deg=70.0)
    power = image(one)
    mover = movers(RADAR, [one])[0]
    outline_m = mover.hull_m(mover.course.at(np.zeros(1)))[0]
    range_m, bearing_rad = np.hypot(*outline_m.T), np.arctan2(outline_m[:, 0], outline_m[:, 1])
    nearest_m = -shapely.Polygon(outline_m).distance(shapely.Point(0, 0))
    spokes, cells = np.nonzero(power > 0.0)
    assert RADAR.edges_m[cells + 1].min() >= -nearest_m - 0.5 * RADAR.pulse_m
    assert RADAR.edges_m[cells].max() <= range_m.max() + 0.5 * RADAR.pulse_m
    off_rad = wrap(RADAR.azimuths_rad()[spokes] - math.radians(azimuth_deg))
    hull_rad = wrap(bearing_rad - math.radians(azimuth_deg))
    audible = power[spokes, cells] > 1e-6 * power.max()  # within one and a half beam widths: -54 dB
    assert np.all(off_rad[audible] <= hull_rad.max() + 1.5 * RADAR.beam_rad)
    assert np.all(off_rad[audible] >= hull_rad.min() - 1.5 * RADAR.beam_rad)
    assert power.max() > 0.0


def test_the_face_towards_the_radar_is_brighter_than_the_far_side() -> None:
    power = image(vessel(length_m=200.0, width_m=40.0, waypoints_m=((0.0, 2000.0),), heading_deg=90.0)).sum(axis=0)
    face = power[197:199].sum()  # the hull spans 1980..2020 m
    far = power[201:203].sum()
    assert face > 5.0 * far > 0.0


def test_echo_power_falls_with_the_fourth_power_of_range() -> None:
    near = image(vessel(length_m=4.0, width_m=4.0, waypoints_m=((0.0, 1005.0),)))
    far = image(vessel(length_m=4.0, width_m=4.0, waypoints_m=((0.0, 2005.0),)))
    ratio = near.max() / far.max()
    assert_allclose(ratio, (2005 / 1005) ** 4, rtol=0.02)


def test_a_hull_hides_what_lies_behind_it_and_not_what_lies_before_it() -> None:
    ship = vessel(id="ship", length_m=200.0, width_m=30.0, waypoints_m=((0.0, 1500.0),))  # end on
    behind = vessel(id="b", length_m=8.0, width_m=3.0, waypoints_m=((0.0, 2000.0),))
    before = vessel(id="a", length_m=8.0, width_m=3.0, waypoints_m=((0.0, 1000.0),))
    fleet = movers(RADAR, [ship, behind, before])
    _, hidden, clear_ = echoes(RADAR, fleet, OPEN_SEA, 0)
    alone = echoes(RADAR, fleet[1:], OPEN_SEA, 0)
    assert hidden.power.max() < 1e-6 * alone[0].power.max()
    assert_array_equal(clear_.power, alone[1].power)


def test_land_hides_a_vessel_and_is_dark_inland() -> None:
    wall = Land(outline_m=((-200.0, 1000.0), (200.0, 1000.0), (200.0, 1100.0), (-200.0, 1100.0)), reach_m=5.0)
    still = scenery(RADAR, [wall], Sea(), seed=3)
    boat = vessel(waypoints_m=((0.0, 2000.0),))
    assert image(boat, still=still).max() < 1e-6 * image(boat).max()
    beside = vessel(waypoints_m=((1500.0, 2000.0),))
    assert_array_equal(image(beside, still=still), image(beside))
    ahead = still.land[[0, -1]]
    assert ahead[:, 99:102].sum() > 1e3 * ahead[:, 105:108].sum()


def test_high_land_is_seen_over_the_land_before_it() -> None:
    outline = ((-200.0, 1000.0), (200.0, 1000.0), (200.0, 1100.0), (-200.0, 1100.0))
    hill = tuple((e, n + 1000.0) for e, n in outline)
    low = scenery(RADAR, [Land(outline_m=outline, reach_m=5.0), Land(outline_m=hill)], Sea(), seed=3)
    high = scenery(RADAR, [Land(outline_m=outline, reach_m=5.0), Land(outline_m=hill, high=True)], Sea(), seed=3)
    assert low.land[0, 195:].max() < 1e-6 * high.land[0, 195:].max()


@settings(derandomize=True, deadline=None, max_examples=20)
@given(st.integers(1, 719), st.floats(300, 3500), st.floats(0, 360), st.floats(0, 360))
def test_turning_the_world_turns_the_echoes(step: int, range_m: float, azimuth_deg: float, heading_deg: float) -> None:
    turn_deg = 360.0 * step / RADAR.spokes
    still = image(vessel(waypoints_m=at(range_m, azimuth_deg), heading_deg=heading_deg))
    turned = image(vessel(waypoints_m=at(range_m, azimuth_deg + turn_deg), heading_deg=heading_deg + turn_deg))
    assert_allclose(np.roll(still, step, axis=0), turned, atol=1e-7 * still.max())


@pytest.mark.parametrize("azimuth_deg", [0.0, 0.3, 45.0, 91.0, 200.0, 359.8])
@pytest.mark.parametrize("heading_deg", [20.0, 110.0, 290.0])
def test_the_centroid_of_the_echo_is_the_truth_at_the_time_of_the_beam(azimuth_deg: float, heading_deg: float) -> None:
    """A small fast vessel, in spokes counted on from turn to turn so that North is no seam."""
    (start,), h = at(1800.0, azimuth_deg), math.radians(heading_deg)
    end = (start[0] + 1000.0 * math.sin(h), start[1] + 1000.0 * math.cos(h))
    boat = vessel(length_m=4.0, width_m=4.0, waypoints_m=(start, end), speed_mps=20.0)
    mover = movers(RADAR, [boat])[0]
    power = np.concatenate([image(boat, k=k) for k in range(5)])
    azimuth_rad = np.concatenate([RADAR.azimuths_rad()] * 5)
    range_m = RADAR.centres_m
    passes_s = pass_times_s(RADAR, mover, 5)
    inner_s = passes_s[(passes_s > 0.1) & (passes_s < 12.4)]
    assert len(inner_s) >= 4
    for t_s in inner_s:
        spokes = round(t_s / RADAR.turn_s * RADAR.spokes) + np.arange(-20, 20)
        w = power[spokes] / power[spokes].sum()
        east_m = (w * range_m * np.sin(azimuth_rad[spokes])[:, None]).sum()
        north_m = (w * range_m * np.cos(azimuth_rad[spokes])[:, None]).sum()
        assert_allclose([east_m, north_m], mover.course.at(np.array([t_s])).position_m[0], atol=2.0)


@settings(derandomize=True, deadline=None, max_examples=25)
@given(st.floats(-800, 800), st.floats(300, 2000), st.floats(0, 6.28))
def test_the_beam_passes_a_vessel_when_it_points_at_it(east_m: float, north_m: float, heading_rad: float) -> None:
    end = (east_m + 900 * math.sin(heading_rad), north_m + 900 * math.cos(heading_rad))
    mover = movers(RADAR, [vessel(waypoints_m=((east_m, north_m), end), speed_mps=12.0)])[0]
    t_s = pass_times_s(RADAR, mover, 20)
    position_m = mover.course.at(t_s).position_m
    assert_allclose(wrap(TWO_PI * t_s / 2.5 - np.arctan2(position_m[:, 0], position_m[:, 1])), 0.0, atol=1e-9)
    assert 19 <= len(t_s) <= 21
    assert np.all((np.diff(t_s) > 2.0) & (np.diff(t_s) < 3.0))


@pytest.mark.parametrize(("heading_deg", "expected"), [(90.0, 19), (270.0, 21)])
def test_a_vessel_over_north_is_passed_once_less_or_once_more(heading_deg: float, expected: int) -> None:
    side = -1.0 if heading_deg == 90.0 else 1.0
    line = ((side * 250.0, 900.0), (-side * 250.0, 900.0))
    mover = movers(RADAR, [vessel(waypoints_m=line, speed_mps=10.0)])[0]
    assert len(pass_times_s(RADAR, mover, 20)) == expected


def test_an_echo_over_north_fades_as_one() -> None:
    fleet = movers(RADAR, [vessel(waypoints_m=((0.0, 1500.0),), fade=1.0)])

    def drawn(k: int) -> tuple[np.ndarray, np.ndarray]:
        echo = echoes(RADAR, fleet, OPEN_SEA, k)[0]
        east = echo.spokes < 360
        fade = fades(RADAR, fleet, 0, echo, k, seed=5)
        return np.unique(fade[east]), np.unique(fade[~east])

    (after_0, before_1), (after_1, _) = drawn(0), drawn(1)
    assert_array_equal(before_1, after_1)
    assert len(after_0) == len(after_1) == 1
    assert after_0[0] != after_1[0]


def test_noise_alone_passes_the_threshold_as_often_as_its_law_says() -> None:
    radar = dataclasses.replace(RADAR, full_db=25.5, threshold=50)  # 0.1 dB a level: 49.5 levels and more pass
    cells = turn(radar, (), OPEN_SEA, Sea(), 0, seed=11)
    p = math.exp(-(10.0**0.495))
    n = cells.size
    assert abs(np.count_nonzero(cells) - n * p) < 4.0 * math.sqrt(n * p * (1 - p))


def test_clutter_is_strongest_towards_the_wind_and_near() -> None:
    sea = Sea(level_db=20.0, decay=4.0, wind_deg=90.0, wind_db=10.0)
    mean = scenery(RADAR, (), sea, seed=0).sea
    east, west = len(mean) // 4, 3 * len(mean) // 4
    assert_allclose(mean[east, 100] / mean[west, 100], 10.0, rtol=0.01)
    assert_allclose(mean[east, 50] / mean[east, 101], (101.5 / 50.5) ** 4, rtol=1e-9)


def test_turns_are_equal_for_equal_seeds_only_and_do_not_depend_on_earlier_ones() -> None:
    fleet, sea = movers(RADAR, [vessel()]), Sea(level_db=15.0)
    still = scenery(RADAR, (), sea, seed=0)
    later = turn(RADAR, fleet, still, sea, 2, seed=1)
    turn(RADAR, fleet, still, sea, 0, seed=1)
    assert_array_equal(turn(RADAR, fleet, still, sea, 2, seed=1), later)
    assert np.any(turn(RADAR, fleet, still, sea, 2, seed=2) != later)
    assert np.any(turn(RADAR, fleet, still, sea, 3, seed=1) != later)


def test_video_is_the_logarithm_of_power_less_the_gain_cut_near_the_antenna() -> None:
    radar = dataclasses.replace(RADAR, stc_range_m=1005.0, stc_power=2.0, full_db=51.0, threshold=10)
    power = np.zeros((radar.spokes, radar.cells))
    power[:, 200], power[:, 100], power[:, 10], power[:, 300] = 1e3, 1e3, 1e3, 1e9
    row = video(radar, power)[0]
    near_db = 30.0 + 20.0 * math.log10(105.0 / 1005.0)
    assert [row[200], row[100], row[10], row[300], row[0]] == [150, 150, round(5 * near_db), 255, 0]


def test_a_vessel_beyond_the_range_gives_no_echo() -> None:
    echo = echoes(RADAR, movers(RADAR, [vessel(waypoints_m=((0.0, 9000.0),))]), OPEN_SEA, 0)[0]
    assert isinstance(echo, Echo)
    assert echo.power.size == 0


def test_the_beam_is_cut_where_it_no_longer_matters() -> None:
    assert beam(np.array([BEAM_REACH]), beam_rad=1.0)[0] < 1e-9


def test_positions_are_relative_to_the_antenna() -> None:
    moved = dataclasses.replace(RADAR, east_m=300.0, north_m=-400.0)
    there = vessel(waypoints_m=((300.0, 1600.0),))
    mover: Mover = movers(moved, [there])[0]
    assert_allclose(mover.course.at(np.zeros(1)).position_m, [[0.0, 2000.0]])
