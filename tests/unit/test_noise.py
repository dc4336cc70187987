"""Noise of points: directions, floors and units."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.geo import polar_to_en
from maritrack.io.noise import en_cov_to_plot, plot_cov_to_en, point_noise, turn_cov, usable_cov
from maritrack.settings import InputConfig

angles = st.floats(0.0, 6.28)


def test_without_sigmas_there_is_no_noise():
    assert point_noise(np.array([100.0]), np.array([1.0]), InputConfig()) is None


def test_noise_to_the_east_lies_along_east_in_range_and_along_north_in_azimuth():
    config = InputConfig(sigma_range_m=3.0, sigma_azimuth_deg=1.0)
    cov = point_noise(np.array([1000.0]), np.array([np.pi / 2]), config)
    assert cov is not None
    np.testing.assert_allclose(cov, [[[9.0, 0.0], [0.0, (1000.0 * np.deg2rad(1.0)) ** 2]]], atol=1e-9)


def test_the_least_noise_is_a_floor_and_not_an_addition():
    config = InputConfig(sigma_range_m=2.0, sigma_azimuth_deg=2.0, sigma_m=4.0)
    cov = point_noise(np.array([50.0, 1000.0]), np.zeros(2), config)
    assert cov is not None
    np.testing.assert_allclose(cov[0], 16.0 * np.eye(2), atol=1e-9)
    np.testing.assert_allclose(cov[1], np.diag([(1000.0 * np.deg2rad(2.0)) ** 2, 16.0]), atol=1e-9)


@settings(derandomize=True, deadline=None)
@given(st.floats(10.0, 1e4), angles, st.floats(-0.9, 0.9))
def test_polar_covariance_is_carried_over_by_the_jacobian(range_m, azimuth_rad, correlation):
    sigma_r, sigma_a = 30.0, 0.02
    cross = correlation * sigma_r * sigma_a
    polar = np.array([[sigma_r**2, cross], [cross, sigma_a**2]])
    step = 1e-6
    columns = [
        polar_to_en(np.array(range_m + dr), np.array(azimuth_rad + da))
        - polar_to_en(np.array(range_m - dr), np.array(azimuth_rad - da))
        for dr, da in ((step, 0.0), (0.0, step))
    ]
    jacobian = np.stack(columns, axis=-1) / (2 * step)
    rows = np.array([[sigma_r**2, cross, sigma_a**2]])
    cov = plot_cov_to_en(np.array([range_m]), np.array([azimuth_rad]), rows)
    np.testing.assert_allclose(cov[0], jacobian @ polar @ jacobian.T, rtol=1e-4, atol=1e-2)
    back = en_cov_to_plot(np.array([range_m]), np.array([azimuth_rad]), cov)
    np.testing.assert_allclose(back, rows, rtol=1e-9, atol=1e-12)


@settings(derandomize=True, deadline=None)
@given(angles, angles)
def test_turning_the_noise_is_turning_the_azimuth(azimuth_rad, turn_rad):
    rows, range_m = np.array([[9.0, 0.01, 1e-4]]), np.array([500.0])
    turned = turn_cov(plot_cov_to_en(range_m, np.array([azimuth_rad]), rows), turn_rad)
    np.testing.assert_allclose(turned, plot_cov_to_en(range_m, np.array([azimuth_rad + turn_rad]), rows), atol=1e-9)


def test_a_covariance_is_finite_and_not_negative():
    rows = [[1, 0, 1], [0, 0, 0], [1, 2, 1], [-1, 0, 1], [np.nan, 0, 1], [np.inf, 0, 1], [1e300, 0, 1], [4, 2, 1]]
    assert usable_cov(np.array(rows, dtype=float)).tolist() == [True, True, False, False, False, False, False, True]
