"""The extent of a track is that of the ellipse or the hull: axes within 20 %, orientation within 5 degrees, near."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pytest
from numpy.testing import assert_allclose

from maritrack import geo
from maritrack.cluster.stage import cluster_points
from maritrack.config import load_config
from maritrack.objects import matrix2
from maritrack.settings import ClusterConfig
from maritrack.types import Points, Scan, Sensor
from tests.bench.bench_extent import ASPECTS_DEG, SIZES_M, Found, Setup, all_ships, recover
from tests.unit.scans import step

SHIPS = all_ships(((100.0, 20.0), (200.0, 32.0)), (6.0, 15.0, 40.0, 90.0))


def assert_close(found: list[Found], length: float, width: float, turned_deg: float) -> None:
    for f in found:
        assert f.held > 0.9
        assert abs(f.length - 1.0) < length and abs(f.width - 1.0) < width and f.turned_deg < turned_deg, f


@pytest.mark.parametrize("range_m", [500.0, 2000.0])
@pytest.mark.parametrize("outline", ["hull", "ellipse"])
def test_hulls_are_found_within_a_fifth_and_five_degrees_near(
    range_m: float, outline: Literal["hull", "ellipse"]
) -> None:
    """From nearly end on to broadside, where the outline is told."""
    setup = Setup(scans=18, outline=outline, power=5.0 if outline == "hull" else 2.0)
    assert_close(recover(range_m, SHIPS, setup), 0.2, 0.2, 5.0)


def test_what_is_seen_is_not_the_hull_near_end_on() -> None:
    """With `outline_power` = 0 extents are what is seen: near end on their axis is off the keel."""
    found = recover(1000.0, SHIPS[:2], Setup(scans=18, power=0.0))
    assert all(f.turned_deg > 5.0 for f in found)


def test_without_the_decibels_of_the_video_hulls_are_too_wide() -> None:
    """Amplitudes of a logarithmic video weigh the skirts of the beam as much as the hull."""
    ships = all_ships(((100.0, 20.0),), (30.0, 60.0, 90.0))
    for way in ("cell", "beam"):
        assert all(f.width > 1.25 for f in recover(2000.0, ships, Setup(way=way, scans=18)))


@pytest.mark.slow
@pytest.mark.parametrize("range_m", [500.0, 1000.0, 2000.0])
def test_nine_hulls_in_ten_of_any_size_are_found_to_two_kilometres(range_m: float) -> None:
    """Hulls under all aspects from 3 degrees off end on, of sizes that beam and pulse resolve; few are far off."""
    sizes = [size for size in SIZES_M if size[0] > (30.0 if range_m > 500.0 else 0.0)]
    found = recover(range_m, all_ships(sizes, [aspect for aspect in ASPECTS_DEG if aspect > 3.0]))
    held = [f for f in found if f.held > 0.0]
    off = np.array([(abs(f.length - 1.0), abs(f.width - 1.0), f.turned_deg) for f in held])
    assert len(held) >= 0.95 * len(found)
    assert np.mean([f.good for f in held]) >= 0.9
    assert (off < [0.3, 0.3, 7.0]).all(axis=1).mean() >= 0.97


@pytest.mark.parametrize("axes_m", [(40.0, 16.0), (100.0, 20.0), (300.0, 45.0)])
@pytest.mark.parametrize("angle_deg", [0.0, 35.0, 90.0, 160.0])
def test_an_evenly_filled_ellipse_is_found(axes_m: tuple[float, float], angle_deg: float) -> None:
    """Points of 5 m noise, which is taken off; length and width are its axes, 4 standard deviations."""
    config = load_config(preset="radar", sets=["cluster.method=cartesian-dbscan", "cluster.eps_m=40.0"])
    rng, state = np.random.default_rng(5), None
    angle = math.radians(angle_deg)
    turn = np.array([[math.sin(angle), math.cos(angle)], [math.cos(angle), -math.sin(angle)]])  # along, across
    for k in range(12):
        u = rng.normal(size=(80, 2))
        u *= (np.sqrt(rng.random(80)) / np.hypot(*u.T))[:, None]
        z = [800.0, 1500.0] + (u * np.array(axes_m) / 2.0) @ turn + rng.normal(0, 5.0, (80, 2))
        state = step(config, state, z, 2.5 * k)
    values, major = matrix2.eigen(state.density.X[:1])
    assert_allclose(2.0 * np.sqrt(values[0]), axes_m, rtol=0.2)
    off_deg = math.degrees(math.atan2(major[0, 0], major[0, 1])) - angle_deg
    assert abs((off_deg + 90.0) % 180.0 - 90.0) < 5.0


def test_power_takes_the_beam_of_a_point_echo_for_what_it_is_however_strong() -> None:
    """A Gaussian beam on a logarithmic video: variance B^2 / (16 log 2). Amplitudes give more, the stronger."""
    beam, cell, full_db = math.radians(0.6), math.radians(0.05), 60.0
    off = np.arange(-60, 61) * cell
    for peak in (140.0, 200.0, 250.0):
        level = peak - 8.0 * math.log(2.0) * (off / beam) ** 2 * 10.0 / math.log(10.0) * 255.0 / full_db
        seen = level > 90.0
        azimuth, n = (1.0 + off)[seen], int(seen.sum())
        points = Points(
            range_m=np.full(n, 3000.0), azimuth_rad=azimuth, position_m=geo.polar_to_en(np.full(n, 3000.0), azimuth),
            intensity=np.rint(level[seen]), t_ns=np.zeros(n, np.int64), range_width_m=np.full(n, 10.0),
            azimuth_width_rad=np.full(n, cell),
        )  # fmt: skip
        scan = Scan(Sensor("r", 10.0, cell, 6000.0, 8), 0, 0, np.zeros(2), np.nan, points=points)
        spread, taken_off = {}, {}
        for scale_db in (0.0, full_db):
            config = load_config(preset="radar", sets=["input.beam_width_deg=0.6", f"input.scale_db={scale_db}"])
            c = cluster_points(points, scan, ClusterConfig(eps_m=60.0), config.input)
            assert len(c) == 1
            across = np.array([math.cos(1.0), -math.sin(1.0)])
            spread[scale_db] = float(across @ c.scatter_m2[0] @ across / c.count[0] / 3000.0**2)
            taken_off[scale_db] = float(across @ c.noise_m2[0] @ across / 3000.0**2)
        assert_allclose(taken_off[0.0], beam**2 / 12.0, rtol=1e-3)
        assert_allclose(taken_off[full_db], beam**2 / (16.0 * math.log(2.0)), rtol=1e-3)
        weak = peak < 150.0  # the threshold hides its skirts
        assert_allclose(spread[full_db], taken_off[full_db], rtol=0.15 if weak else 0.01)
        assert spread[0.0] > (1.0 if weak else 2.0) * taken_off[full_db]
