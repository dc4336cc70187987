"""What must hold for the clusters of any scan: they turn with the world, wherever the turn of the radar begins."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from maritrack import geo
from maritrack.cluster.stage import cluster_points
from maritrack.settings import ClusterConfig, InputConfig
from maritrack.types import Clusters, FloatArray, Points, Scan, Sensor

CELL_M, CELL_RAD = 7.5, 2 * np.pi / 2048
law = settings(derandomize=True, deadline=None, max_examples=40)


def clusters_at(range_m: FloatArray, azimuth: FloatArray, intensity: FloatArray, input_: InputConfig) -> Clusters:
    azimuth, n = geo.wrap_positive(azimuth), len(range_m)
    points = Points(
        range_m=range_m, azimuth_rad=azimuth, position_m=geo.polar_to_en(range_m, azimuth), intensity=intensity,
        t_ns=np.zeros(n, np.int64), range_width_m=np.full(n, CELL_M), azimuth_width_rad=np.full(n, CELL_RAD),
    )  # fmt: skip
    scan = Scan(Sensor("r", CELL_M, CELL_RAD, 9000.0), 0, 0, np.zeros(2), np.nan, points=points)
    return cluster_points(points, scan, ClusterConfig(eps_m=55.0, min_points=3), input_)


@pytest.mark.parametrize(
    "input_", [InputConfig(), InputConfig(beam_width_deg=0.6, scale_db=60.0)], ids=["cell", "beam"]
)
@law
@given(seed=st.integers(0, 10_000), angle=st.floats(0.0, 6.28))
def test_clusters_turn_with_the_world(input_: InputConfig, seed: int, angle: float) -> None:
    """Some lie across North before, others after: partition, ranges and counts stay, all else turns."""
    rng = np.random.default_rng(seed)
    middle = np.stack([rng.uniform(500, 8000, 12), rng.choice([0.0, 2 * np.pi - angle, 3.0], 12)], 1)
    at = np.repeat(middle, 12, axis=0)
    range_m, azimuth = at[:, 0] + rng.normal(0, 15, 144), at[:, 1] + rng.normal(0, 3 * CELL_RAD, 144)
    intensity = rng.integers(100, 255, 144).astype(np.float64)
    a, b = (clusters_at(range_m, azimuth + turn, intensity, input_) for turn in (0.0, angle))
    assert len(a) == len(b)
    first = [np.flatnonzero(c.label >= 0) for c in (a, b)]
    assert_array_equal(*first)
    twin = np.full(len(a), -1)
    twin[a.label[first[0]]] = b.label[first[0]]  # of each cluster: what its points are called after the turn
    assert_array_equal(twin[a.label[first[0]]], b.label[first[0]])
    assert len(set(twin.tolist())) == len(a)
    c, s = np.cos(angle), np.sin(angle)
    T = np.array([[c, s], [-s, c]])  # clockwise, as azimuth counts
    assert_allclose(b.mean_m[twin], a.mean_m @ T.T, rtol=1e-9, atol=1e-6)
    assert_allclose(b.range_m[twin], a.range_m, rtol=1e-9)
    assert_array_equal(b.count[twin], a.count)
    assert_allclose(b.scatter_m2[twin], T @ a.scatter_m2 @ T.T, rtol=1e-6, atol=1e-3)
    assert_allclose(b.noise_m2[twin], T @ a.noise_m2 @ T.T, rtol=1e-6, atol=1e-6)
    assert_allclose(b.weight_sq[twin], a.weight_sq, rtol=1e-9)
