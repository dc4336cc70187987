"""Rays from the antenna through solid things: how far they go inside, what comes back, what goes on.

Everything solid is a polygon without height that lets exp(-depth / reach) of the power through, there and
back. What does not go through comes back, so the near face is bright, the far side weak, and a shadow lies
behind. Rows of all arrays are rays; polygons are relative to the antenna.
"""

from __future__ import annotations

import numpy as np

from maritrack.types import FloatArray

BEAM_REACH = 2.0  # beam widths off the axis beyond which nothing is heard (-96 dB)
FAINTEST = 80.0  # depths in units of reach beyond this are all the same: black


def inside_length(polygon_m: FloatArray, azimuth_rad: FloatArray, range_m: FloatArray) -> FloatArray:
    """Metres of each ray (n,) inside a polygon, from the antenna out to each range (r,): (n, r).

    The polygon is (v, 2) or one for each ray (n, v, 2), in any sense, not crossing itself; the antenna may be
    inside. Each edge that the line of a ray crosses adds or takes away what lies beyond the crossing.
    """
    polygon_m = np.broadcast_to(polygon_m, (len(azimuth_rad), *polygon_m.shape[-2:]))
    s, c = np.sin(azimuth_rad)[:, None], np.cos(azimuth_rad)[:, None]
    along_m = polygon_m[..., 0] * s + polygon_m[..., 1] * c
    left_m = polygon_m[..., 1] * s - polygon_m[..., 0] * c  # of the ray
    sense = np.sign(_area_m2(polygon_m))
    length_m = np.zeros((len(azimuth_rad), len(range_m)))
    for i in range(polygon_m.shape[1]):
        p, q = left_m[:, i - 1], left_m[:, i]
        rows = np.nonzero((p >= 0.0) != (q >= 0.0))[0]
        if not len(rows):
            continue
        p, q = p[rows], q[rows]
        crossing_m = along_m[rows, i - 1] + (along_m[rows, i] - along_m[rows, i - 1]) * p / (p - q)
        enters = np.where(p >= 0.0, 1.0, -1.0) * sense[rows]
        beyond_m = np.maximum(range_m - np.maximum(crossing_m, 0.0)[:, None], 0.0)
        length_m[rows] += enters[:, None] * beyond_m
    return np.maximum(length_m, 0.0)


def _area_m2(polygon_m: FloatArray) -> FloatArray:
    """Signed area, counter-clockwise positive, (n,)."""
    x, y = polygon_m[..., 0], polygon_m[..., 1]
    return np.asarray(0.5 * np.sum(np.roll(x, 1, -1) * y - x * np.roll(y, 1, -1), axis=-1), dtype=np.float64)


def through(depth: FloatArray) -> FloatArray:
    """Share of the power that passes a depth in units of reach, there and back."""
    return np.asarray(np.exp(-np.minimum(depth, FAINTEST)), dtype=np.float64)


def returned(
    polygon_m: FloatArray, azimuth_rad: FloatArray, edges_m: FloatArray, *, reach_m: float, pulse_m: float
) -> FloatArray:
    """Share of the power of each ray (n,) that comes back out of each cell between edges (b + 1,): (n, b).

    Blurred by a pulse of that length, centred: an echo lies in the cells within half a pulse.
    """
    steps = max(4, int(np.ceil(pulse_m / 2.0)))
    within_m = pulse_m * ((np.arange(steps) + 0.5) / steps - 0.5)
    fine_m = (edges_m[:, None] + within_m).ravel()
    passed = through(inside_length(polygon_m, azimuth_rad, fine_m) / reach_m)
    at_edge = passed.reshape(len(azimuth_rad), len(edges_m), steps).mean(axis=2)
    return np.asarray(at_edge[:, :-1] - at_edge[:, 1:], dtype=np.float64)


def beam(off_rad: FloatArray, *, beam_rad: float) -> FloatArray:
    """Two-way power pattern of the antenna off its axis: Gaussian, one-way half-power width `beam_rad`."""
    squared = (np.asarray(off_rad) / beam_rad) ** 2
    return through(8.0 * np.log(2.0) * squared)
