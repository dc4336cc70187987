"""What a sensor at a place measures of a position: the position itself, range and azimuth, elevation too.

Azimuth is clockwise from north. Elevation is the angle above the sensor's horizon, range then the slant range.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from maritrack import geo
from maritrack.types import FloatArray

Measurement = Literal["clusters", "range-azimuth", "range-azimuth-elevation"]
AXES = {"clusters": 2, "range-azimuth": 2, "range-azimuth-elevation": 3}  # of space
LEAST_M = 1e-6  # nearer than this to the sensor, or to its vertical, nothing has a direction


def measure(kind: Measurement, offset_m: FloatArray) -> FloatArray:
    """h(x) (n, z) of positions (n, axes) relative to the sensor."""
    if kind == "clusters":
        return offset_m
    level, r = _distances(offset_m)
    azimuth = np.arctan2(offset_m[:, 0], offset_m[:, 1])
    if kind == "range-azimuth":
        return np.stack([r, azimuth], axis=-1)
    return np.stack([r, azimuth, np.arctan2(offset_m[:, 2], level)], axis=-1)


def jacobian(kind: Measurement, offset_m: FloatArray) -> FloatArray:
    """dh/dposition (n, z, axes)."""
    n, axes = offset_m.shape
    if kind == "clusters":
        return np.broadcast_to(np.eye(axes), (n, axes, axes))
    level, r = _distances(offset_m)
    J = np.zeros((n, axes, axes))
    J[:, 0] = offset_m / r[:, None]
    J[:, 1, 0], J[:, 1, 1] = offset_m[:, 1] / level**2, -offset_m[:, 0] / level**2
    if kind == "range-azimuth-elevation":
        J[:, 2, :2] = -offset_m[:, :2] * (offset_m[:, 2] / (r**2 * level))[:, None]
        J[:, 2, 2] = level / r**2
    return J


def locate(kind: Measurement, z: FloatArray) -> FloatArray:
    """The position (n, axes) relative to the sensor that measures z (n, z)."""
    if kind == "clusters":
        return z
    if kind == "range-azimuth":
        return geo.polar_to_en(z[:, 0], z[:, 1])
    level = z[:, 0] * np.cos(z[:, 2])
    return np.concatenate([geo.polar_to_en(level, z[:, 1]), (z[:, 0] * np.sin(z[:, 2]))[:, None]], axis=1)


def innovation(kind: Measurement, z: FloatArray, expected: FloatArray) -> FloatArray:
    """z - expected (n, z), azimuths the short way round."""
    nu = z - expected
    if kind != "clusters":
        nu[:, 1] = geo.wrap(nu[:, 1])
    return nu


def volume(kind: Measurement, z: FloatArray) -> FloatArray:
    """|d position / d z| (n,): r in the plane, r^2 cos(elevation) in space, 1 for positions."""
    if kind == "clusters":
        return np.ones(len(z))
    r = np.maximum(z[:, 0], LEAST_M)
    return r if kind == "range-azimuth" else np.maximum(r**2 * np.cos(z[:, 2]), LEAST_M**2)


def _distances(offset_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """In the plane, and in all."""
    level = np.maximum(np.hypot(offset_m[:, 0], offset_m[:, 1]), LEAST_M)
    return level, level if offset_m.shape[1] == 2 else np.hypot(level, offset_m[:, 2])
