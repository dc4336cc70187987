"""Measurements of range and azimuth as places, with the bias of the conversion taken off, and their covariance.

Lerro, Bar-Shalom 1993: the averages of true bias and covariance, given what was measured; the errors of range and
azimuth are Gaussian and independent. Consistent also where the beam is wide and the range long.
"""

from __future__ import annotations

import numpy as np

from maritrack import geo
from maritrack.types import FloatArray


def converted(
    range_m: FloatArray, azimuth_rad: FloatArray, *, sigma_range_m: float, sigma_azimuth_rad: float
) -> tuple[FloatArray, FloatArray]:
    """Unbiased offsets (n, 2), east-north, of measured ranges and azimuths (n,), and their covariances (n, 2, 2).

    R of eq. 2 of the dataset paper.   Eq: dataset-2
    """
    r2, v, s2 = range_m**2, sigma_range_m**2, sigma_azimuth_rad**2
    sin2, cos2 = np.sin(azimuth_rad) ** 2, np.cos(azimuth_rad) ** 2
    less = np.exp(-2.0 * s2)
    by_cos = r2 * _less(np.cosh, s2) + v * (np.cosh(2 * s2) + _less(np.cosh, s2))
    by_sin = r2 * _less(np.sinh, s2) + v * (np.sinh(2 * s2) + _less(np.sinh, s2))
    nn = less * (cos2 * by_cos + sin2 * by_sin)
    ee = less * (sin2 * by_cos + cos2 * by_sin)
    en = np.sin(azimuth_rad) * np.cos(azimuth_rad) * np.exp(-4.0 * s2) * (v + (r2 + v) * -np.expm1(s2))
    bias = np.exp(-s2) - np.exp(-s2 / 2.0)
    offset_m = geo.polar_to_en(range_m, azimuth_rad)
    return offset_m * (1.0 - bias), np.stack([np.stack([ee, en], -1), np.stack([en, nn], -1)], -2)


def _less(hyperbolic: np.ufunc, s2: float) -> float:
    """f(2 s^2) - f(s^2)."""
    return float(hyperbolic(2.0 * s2) - hyperbolic(s2))
