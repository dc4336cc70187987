"""Clusters from labelled points: weights, noise at the sensor's bearing, order."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from maritrack import geo
from maritrack.cluster.statistics import cluster_statistics
from maritrack.types import Points, Scan, Sensor


def points(z: np.ndarray, at: np.ndarray, intensity: np.ndarray) -> Points:
    n = len(z)
    range_m, azimuth = geo.en_to_polar(z - at)
    return Points(
        range_m=range_m, azimuth_rad=azimuth, position_m=z, intensity=intensity, t_ns=np.arange(n) * 1000,
        range_width_m=np.zeros(n), azimuth_width_rad=np.zeros(n),
    )  # fmt: skip


@pytest.mark.eq("polar-5")
def test_noise_lies_along_the_bearing_from_the_sensor_wherever_the_sensor_is() -> None:
    at = np.array([5000.0, -3000.0])
    z = at + np.array([[0.0, 1000.0], [0.0, 1010.0]])  # due north of the sensor
    scan = Scan(Sensor("s", 10.0, 0.01, 1e4), 0, 0, at, np.nan)
    c = cluster_statistics(
        points(z, at, np.ones(2)), np.zeros(2, int), scan, intensity_weighting=True, noise=(3.0, 0.02, 0)
    )
    assert_allclose(c.noise_m2[0], np.diag([(0.02 * 1005) ** 2, 9.0]), rtol=1e-6, atol=1e-9)
    assert_allclose([c.range_m[0], c.azimuth_rad[0]], [1005.0, 0.0], atol=1e-9)


def test_negative_intensities_weigh_nothing() -> None:
    z = np.array([[0.0, 100.0], [10.0, 100.0], [900.0, 100.0]])
    scan = Scan(Sensor("s", 10.0, 0.01, 1e4), 0, 0, np.zeros(2), np.nan)
    c = cluster_statistics(
        points(z, np.zeros(2), np.array([1.0, 1.0, -5.0])),
        np.zeros(3, int),
        scan,
        intensity_weighting=True,
        noise=(1, 0.01, 0),
    )
    assert_allclose(c.mean_m[0], [5.0, 100.0])
    assert_allclose(c.weight_sq, 0.5)
