"""Vessels go where and how fast they are told to."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from maritrack.errors import ConfigError
from maritrack.geo import wrap
from maritrack.simulate.vessels import Vessel, depart, hull, moored, straight, through

TIMES_S = np.linspace(0.0, 400.0, 4001)
LEGS = st.lists(st.tuples(st.floats(800, 1500), st.integers(-110, 110)), min_size=2, max_size=4)


def waypoints(legs: list[tuple[float, int]]) -> np.ndarray:
    heading_rad = np.radians(np.cumsum([turn_deg for _, turn_deg in legs]))
    steps_m = np.array([length for length, _ in legs])[:, None] * np.stack(
        [np.sin(heading_rad), np.cos(heading_rad)], 1
    )
    return np.cumsum(np.concatenate([[[100.0, -50.0]], steps_m]), axis=0)


def test_a_straight_course_is_a_straight_line() -> None:
    state = straight([10.0, 20.0], heading_rad=math.radians(120), speed_mps=8.0).at(np.array([0.0, 100.0]))
    assert_allclose(state.position_m, [[10, 20], [10 + 800 * math.sin(2 * math.pi / 3), 20 - 400]], atol=1e-9)
    assert_allclose(state.velocity_mps[0], [8 * math.sin(2 * math.pi / 3), -4.0], atol=1e-12)


def test_a_moored_vessel_rests_and_keeps_its_heading() -> None:
    state = moored([5.0, 6.0], heading_rad=1.0).at(TIMES_S)
    assert np.all(state.position_m == [5.0, 6.0])
    assert np.all(state.velocity_mps == 0.0)
    assert np.all(state.heading_rad == 1.0)


@settings(derandomize=True, deadline=None, max_examples=30)
@given(LEGS)
def test_velocity_is_the_slope_of_position_and_points_ahead(legs: list[tuple[float, int]]) -> None:
    state = through(waypoints(legs), speed_mps=9.0, turn_rad_per_s=math.radians(3)).at(TIMES_S)
    slope_mps = np.gradient(state.position_m, TIMES_S, axis=0)
    assert_allclose(slope_mps[1:-1], state.velocity_mps[1:-1], atol=0.05)
    ahead = np.stack([np.sin(state.heading_rad), np.cos(state.heading_rad)], 1)
    assert_allclose(state.velocity_mps, 9.0 * ahead, atol=1e-9)


@settings(derandomize=True, deadline=None, max_examples=30)
@given(LEGS)
def test_a_vessel_turns_at_the_stated_rate_or_not_at_all(legs: list[tuple[float, int]]) -> None:
    state = through(waypoints(legs), speed_mps=9.0, turn_rad_per_s=math.radians(3)).at(TIMES_S)
    rate = np.degrees(np.abs(wrap(np.diff(state.heading_rad)))) / np.diff(TIMES_S)
    edges = np.count_nonzero((rate > 1e-6) & (rate < 3.0 - 1e-6))  # steps in which a turn begins or ends
    assert rate.max() <= 3.0 + 1e-6
    assert edges <= 2 * (len(legs) - 1)


def test_a_vessel_goes_on_along_the_line_of_the_last_leg() -> None:
    points_m = np.array([[0.0, 0.0], [0.0, 1000.0], [1000.0, 1000.0]])
    state = through(points_m, speed_mps=10.0, turn_rad_per_s=math.radians(2)).at(np.array([500.0]))
    assert_allclose(state.position_m[0, 1], 1000.0, atol=1e-6)
    assert_allclose(state.heading_rad[0], math.pi / 2, atol=1e-9)


def test_departure_is_rest_then_constant_acceleration_then_steady_speed() -> None:
    course = depart(straight([0.0, 0.0], heading_rad=0.0, speed_mps=5.0), at_s=30.0, accel_mps2=0.1)
    state = course.at(np.array([29.9, 40.0, 80.0, 130.0]))
    assert_allclose(state.velocity_mps[:, 1], [0.0, 1.0, 5.0, 5.0], atol=1e-12)
    assert_allclose(state.position_m[:, 1], [0.0, 5.0, 125.0, 375.0], atol=1e-9)


@pytest.mark.parametrize("outline", ["hull", "ellipse"])
def test_a_hull_is_as_long_and_wide_as_stated_with_its_bow_ahead(outline: str) -> None:
    heading_rad = np.radians([0.0, 90.0, 215.0])
    states = [moored([50.0, 70.0], heading_rad=h).at(np.zeros(1)) for h in heading_rad]
    for h, state in zip(heading_rad, states, strict=True):
        outline_m = hull(state, length_m=100.0, width_m=20.0, outline=outline)[0]
        offset_m = outline_m - [50.0, 70.0]
        forward_m, starboard_m = offset_m @ [np.sin(h), np.cos(h)], offset_m @ [np.cos(h), -np.sin(h)]
        assert_allclose([np.ptp(forward_m), np.ptp(starboard_m)], [100.0, 20.0], atol=1e-9)
        assert_allclose(starboard_m[np.argmax(forward_m)], 0.0, atol=1e-9)  # pointed
        assert shapely.Polygon(outline_m).is_valid
        assert shapely.LinearRing(outline_m).is_ccw


def test_legs_too_short_for_their_turns_are_an_error_that_names_the_vessel() -> None:
    vessel = Vessel(
        id="barge", length_m=90, width_m=10, rcs_m2=1000, speed_mps=8.0, turn_deg_per_s=0.2,
        waypoints_m=((0.0, 0.0), (0.0, 500.0), (500.0, 500.0)),
    )  # fmt: skip
    with pytest.raises(ConfigError, match=r"vessel 'barge': leg . of 500 m is too short"):
        vessel.course()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"length_m": 0.0}, "length_m must be greater than 0"),
        ({"waypoints_m": ()}, "list of"),
        ({"waypoints_m": ((0.0,),)}, "list of"),
        ({"speed_mps": 4.0}, "belong together"),
        ({"depart_s": -1.0}, "depart_s"),
    ],
)
def test_settings_that_make_no_vessel_are_errors(change: dict[str, object], message: str) -> None:
    good = {"id": "x", "length_m": 10.0, "width_m": 3.0, "rcs_m2": 10.0, "waypoints_m": ((0.0, 0.0),)}
    with pytest.raises(ConfigError, match=message):
        Vessel(**(good | change))  # type: ignore[arg-type]
