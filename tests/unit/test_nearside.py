"""The hull behind its near side: moments against rays cast by hand, hulls found again, and what must not matter."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from numpy.testing import assert_allclose

from maritrack.chain import build_chain
from maritrack.config import load_config
from maritrack.errors import ConfigError
from maritrack.objects import matrix2, nearside
from maritrack.types import FloatArray, Tracks

MODEL = load_config(preset="radar").model
SHIPS = nearside.build(5.0)
CASES = [(120.0, 20.0, aspect, 900.0) for aspect in (4.0, 12.0, -12.0, 40.0, -75.0, 89.0)]
CASES += [(300.0, 45.0, 10.0, 500.0), (300.0, 45.0, 60.0, 500.0), (40.0, 10.0, 25.0, 3000.0)]


def rotation(angle_rad: float) -> FloatArray:
    """Columns ahead and right of a direction clockwise from north."""
    s, c = math.sin(angle_rad), math.cos(angle_rad)
    return np.array([[s, c], [c, -s]])


def cast(
    length: float, width: float, aspect_deg: float, distance: float, power: float
) -> tuple[FloatArray, FloatArray]:
    """Mean (2,) and covariance (2, 2), ahead and right of the sensor, of 400 rays that fade within W/4 in a hull."""
    a, unit = math.radians(aspect_deg), nearside.outline(power)
    body = unit * [length, width]
    keel, beam = np.array([math.cos(a), math.sin(a)]), np.array([-math.sin(a), math.cos(a)])
    hull = [distance, 0.0] + body[:, :1] * keel + body[:, 1:] * beam
    bearing = np.arctan2(hull[:, 1], hull[:, 0])
    at, weight = [], []
    for ray in bearing.min() + np.ptp(bearing) * (np.arange(400) + 0.5) / 400:
        along = np.array([math.cos(ray), math.sin(ray)])
        chord = shapely.LineString([[0.0, 0.0], 3.0 * distance * along]).intersection(shapely.Polygon(hull))
        near, far = np.sort(np.hypot(*np.array(chord.coords).T))
        depth = (far - near) * (np.arange(200) + 0.5) / 200
        at.append((near + depth)[:, None] * along)
        weight.append(near * (far - near) * np.exp(-4.0 * depth / width))
    z, w = np.concatenate(at), np.concatenate(weight)
    mean = w @ z / w.sum()
    return mean, ((w / w.sum())[:, None] * (z - mean)).T @ (z - mean)


def tracks_of(
    cases: list[tuple[float, float, float, float]], *, power: float, dof: float, bearing_deg: float
) -> Tracks:
    """Tracks that say what is seen of hulls round a sensor at the origin, ten degrees apart."""
    position, extent = [], []
    for i, (length, width, aspect_deg, distance) in enumerate(cases):
        turn = rotation(math.radians(bearing_deg + 10.0 * i))
        mean, cov = cast(length, width, aspect_deg, distance, power)
        position.append(turn @ mean)
        extent.append(turn @ cov @ turn.T / MODEL.rho)
    n, none = len(cases), np.zeros(len(cases))
    return Tracks(
        id=np.arange(n), t_ns=np.zeros(n, np.int64), position_m=np.array(position), velocity_mps=np.zeros((n, 2)),
        cov=np.zeros((n, 4, 4)), extent_m2=np.array(extent), existence=none, status=np.zeros(n, np.int64),
        moving=none > 0, cluster=np.zeros(n, np.int64), extent_dof=np.full(n, dof),
    )  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_moments_of_a_hull_are_those_of_rays_cast_one_by_one(case: tuple[float, float, float, float]) -> None:
    length, width, aspect_deg, distance = case
    mean, cov = cast(*case, 5.0)
    away, turned = np.hypot(*mean), math.atan2(mean[1], mean[0])
    axes = np.array([[math.cos(turned), math.sin(turned)], [-math.sin(turned), math.cos(turned)]])
    unit = nearside.outline(5.0) * [length / width, 1.0]
    moments, centroid, keel = nearside.seen(unit, np.radians([aspect_deg]), distance / width)
    cov = axes @ cov @ axes.T / width**2
    scale = math.sqrt(cov[0, 0] * cov[1, 1])
    assert_allclose(moments[0, [0, 2]], np.diag(cov), rtol=0.02)
    assert abs(moments[0, 1] - cov[0, 1]) < 0.02 * scale
    assert_allclose(keel, math.radians(aspect_deg) - turned, atol=0.002)
    middle = axes @ [distance, 0.0]
    assert_allclose(centroid[0], ([away, 0.0] - middle) / width, atol=0.01 * length / width)


@pytest.mark.parametrize("power", [2.0, 5.0])
@pytest.mark.parametrize("bearing_deg", [0.0, 200.0])
def test_hulls_are_found_behind_what_is_seen_of_them(power: float, bearing_deg: float) -> None:
    seen = tracks_of(CASES, power=power, dof=1000.0, bearing_deg=bearing_deg)
    whole = nearside.complete(seen, np.zeros(2), nearside.build(power), MODEL)
    values, major = matrix2.eigen(whole.extent_m2)
    length, width, aspect_deg, distance = np.array(CASES).T
    assert_allclose(2.0 * np.sqrt(values), np.column_stack([length, width]), rtol=0.06)
    bearing = np.radians(bearing_deg + 10.0 * np.arange(len(CASES)))
    off_deg = np.degrees(np.arctan2(major[:, 0], major[:, 1]) - bearing) - aspect_deg
    assert (np.abs((off_deg + 90.0) % 180.0 - 90.0) < 1.5).all()
    middle = distance[:, None] * np.column_stack([np.sin(bearing), np.cos(bearing)])
    assert (np.hypot(*(whole.position_m - middle).T) < 0.05 * length).all()


def test_what_is_seen_itself_is_short_and_off_the_keel_near_end_on() -> None:
    """What the table is for: without it 12 degrees off end on are read as 4 to 8 off the keel."""
    seen = tracks_of([(120.0, 20.0, 12.0, 900.0)], power=5.0, dof=60.0, bearing_deg=0.0)
    major = matrix2.eigen(seen.extent_m2)[1][0]
    assert 4.0 < abs(math.degrees(math.atan2(major[0], major[1])) - 12.0) < 12.0


def test_twice_as_far_and_twice_as_large_is_twice_the_hull_and_order_does_not_matter() -> None:
    seen = tracks_of(CASES, power=5.0, dof=40.0, bearing_deg=30.0)
    whole = nearside.complete(seen, np.zeros(2), SHIPS, MODEL)
    order = np.arange(len(CASES))[::-1]
    twice = Tracks(
        **{name: getattr(seen, name)[order] for name in ("id", "t_ns", "velocity_mps", "cov", "existence", "status",
                                                         "moving", "cluster", "extent_dof")},
        position_m=2.0 * seen.position_m[order], extent_m2=4.0 * seen.extent_m2[order],
    )  # fmt: skip
    larger = nearside.complete(twice, np.zeros(2), SHIPS, MODEL)
    assert_allclose(larger.position_m[order], 2.0 * whole.position_m, rtol=1e-9)
    assert_allclose(larger.extent_m2[order], 4.0 * whole.extent_m2, rtol=1e-9)


def test_the_answer_goes_with_the_sensor_and_mirrors_with_the_world() -> None:
    seen = tracks_of(CASES, power=5.0, dof=40.0, bearing_deg=30.0)
    whole = nearside.complete(seen, np.zeros(2), SHIPS, MODEL)
    mirror = np.array([-1.0, 1.0])
    flipped = Tracks(
        **{name: getattr(seen, name) for name in ("id", "t_ns", "velocity_mps", "cov", "existence", "status", "moving",
                                                  "cluster", "extent_dof")},
        position_m=seen.position_m * mirror + [5000.0, -300.0], extent_m2=seen.extent_m2 * np.outer(mirror, mirror),
    )  # fmt: skip
    other = nearside.complete(flipped, np.array([5000.0, -300.0]), SHIPS, MODEL)
    assert_allclose((other.position_m - [5000.0, -300.0]) * mirror, whole.position_m, atol=1e-6)
    assert_allclose(other.extent_m2 * np.outer(mirror, mirror), whole.extent_m2, atol=1e-6)


def test_points_contours_and_tracks_without_a_table_stay_what_they_are() -> None:
    seen = tracks_of(CASES[:2], power=5.0, dof=40.0, bearing_deg=30.0)
    drawn = replace(seen, contour_m=(np.zeros((8, 2)), np.zeros((8, 2))))
    assert nearside.complete(drawn, np.zeros(2), SHIPS, MODEL) is drawn
    assert nearside.complete(seen, np.zeros(2), (), MODEL) is seen
    points = Tracks(
        **{name: getattr(seen, name) for name in ("id", "t_ns", "position_m", "velocity_mps", "cov", "existence",
                                                  "status", "moving", "cluster", "extent_dof")},
        extent_m2=np.zeros((2, 2, 2)),
    )  # fmt: skip
    assert nearside.complete(points, np.zeros(2), SHIPS, MODEL) is points


@pytest.mark.parametrize("power", [-1.0, 1.0, 51.0])
def test_an_outline_that_is_no_hull_is_an_error(power: float) -> None:
    with pytest.raises(ConfigError, match="outline_power"):
        load_config(preset="radar", sets=[f"model.outline_power={power}"])


def test_hulls_are_looked_for_where_the_decibels_of_the_video_are_known() -> None:
    known = load_config(preset="radar", sets=["input.scale_db=90.0"])
    assert len(build_chain(known).hulls) == nearside.NEARNESS
    assert build_chain(load_config(preset="radar")).hulls == ()
    assert build_chain(load_config(preset="radar", sets=["input.scale_db=90.0", "model.outline_power=0"])).hulls == ()
    assert build_chain(load_config(preset="polar-near", sets=["input.scale_db=90.0"])).hulls == ()
