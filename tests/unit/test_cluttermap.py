"""The clutter map: what it learns, what it forgets, and what it adds to the clutter density."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from maritrack.trackers.cluttermap import ClutterMap, learn_map, map_density
from maritrack.tracksettings import ClutterMapConfig
from maritrack.types import Clusters, FloatArray, Scan, Sensor

RULES = ClutterMapConfig(method="cells", least_rate=0.0)
TURN_S = 2.5


def scan(k: int) -> Scan:
    t_ns = round(TURN_S * 1e9) * (k + 1)
    return Scan(Sensor("r", 10.0, 0.01, 1e4), t_ns, t_ns - round(TURN_S * 1e9), np.zeros(2), math.nan)


def clusters(at: FloatArray) -> Clusters:
    n = len(at)
    whole, real, shapes = np.zeros(n, np.int64), np.zeros(n), np.zeros((n, 2, 2))
    return Clusters(np.asarray(at, float), shapes, whole, real, shapes, whole, real, real, real, whole[:0])


def learned(at: FloatArray, scans: int, rules: ClutterMapConfig = RULES, *, untaken: float = 1.0) -> ClutterMap:
    clutter = None
    for k in range(scans):
        clutter = learn_map(clutter, clusters(at), np.full(len(at), untaken), scan(k), rules)
    assert clutter is not None
    return clutter


def test_a_cell_follows_its_rate_with_the_time_constant() -> None:
    at = np.array([[1010.0, 20.0], [1020.0, 30.0]])  # two a scan in one cell, each half taken
    clutter = learned(at, 48, untaken=0.5)
    assert clutter.rate == pytest.approx([1.0 - math.exp(-48 * TURN_S / RULES.memory_s)], rel=1e-12)
    density = map_density(clutter, at, RULES)
    assert density == pytest.approx(clutter.rate[0] / (9 * RULES.cell_m**2), rel=1e-12)


def test_the_density_of_even_clutter_is_that_of_the_clutter() -> None:
    rng, rules, side = np.random.default_rng(0), replace(RULES, memory_s=300.0), 3000.0
    clutter = None
    for k in range(1000):
        at = rng.uniform(0, side, (90, 2))
        clutter = learn_map(clutter, clusters(at), np.ones(90), scan(k), rules)
    inside = rng.uniform(500, side - 500, (400, 2))
    assert map_density(clutter, inside, rules).mean() == pytest.approx(90 / side**2, rel=0.05)


def test_what_passes_leaves_no_clutter() -> None:
    rules, clutter = replace(RULES, cell_m=50.0, least_rate=0.3), None
    for k in range(60):
        ship = np.array([[5.0 * TURN_S * k, 0.0]])
        clutter = learn_map(clutter, clusters(ship), np.ones(1), scan(k), rules)
        assert map_density(clutter, ship, rules).tolist() == [0.0]
    buoy = np.array([[40.0, 500.0]])
    assert map_density(learned(buoy, 60, rules), buoy, rules)[0] > 1e-5


def test_the_map_of_a_radar_that_travels_stays_small() -> None:
    rng, clutter, size = np.random.default_rng(0), None, []
    for k in range(2000):
        at = rng.uniform(-3000, 3000, (20, 2)) + np.array([12.0 * TURN_S * k, 0.0])
        clutter = learn_map(clutter, clusters(at), np.ones(20), scan(k), RULES)
        assert clutter is not None
        size.append(len(clutter.key))
    assert max(size[1000:]) <= 1.1 * max(size[:1000])
    capped = learn_map(clutter, clusters(at), np.ones(20), scan(2000), replace(RULES, max_cells=50))
    assert capped is not None and len(capped.key) == 50
    assert capped.rate.min() >= np.sort(clutter.rate)[-100]  # the highest stayed


def test_without_a_map_nothing_is_added() -> None:
    assert learn_map(None, clusters(np.zeros((1, 2))), np.ones(1), scan(0), ClutterMapConfig()) is None
    assert map_density(None, np.zeros((3, 2)), RULES).tolist() == [0.0, 0.0, 0.0]
    assert learn_map(None, clusters(np.zeros((0, 2))), np.ones(0), scan(0), RULES) is not None


def test_a_map_with_a_long_memory_learns_though_little_a_scan() -> None:
    buoy, rules = np.array([[40.0, 500.0]]), replace(RULES, memory_s=10_000.0)
    clutter = learned(buoy, 40, rules)
    assert clutter.rate == pytest.approx([1.0 - math.exp(-40 * TURN_S / rules.memory_s)], rel=1e-12)
