"""Lloyd's algorithm from several starts at once, each by k-means++ with the best of a few draws.

Arthur, Vassilvitskii 2007. A scan has a hundred points: a library that is called for each start takes ten times as
long for its calls as for its sums. No sum depends on threads.
"""

from __future__ import annotations

import math

import numpy as np

from maritrack.types import FloatArray, IntArray

STARTS = 10
MOST_STEPS = 300


def lloyd(z: FloatArray, start: FloatArray) -> tuple[FloatArray, IntArray]:
    """Centroids (k, 2) of points z (n, 2) and the cluster of each (n,), from first centroids (starts, k, 2).

    Of all starts those with the least squares.
    """
    centre = start.copy()
    label = np.full((len(start), len(z)), -1)
    open_ = np.arange(len(start))
    for _ in range(MOST_STEPS):
        now = squares(z, centre[open_]).argmin(axis=2)
        moved = (now != label[open_]).any(axis=1)
        open_, now = open_[moved], now[moved]
        if not len(open_):
            break
        label[open_] = now
        centre[open_] = means(z, now, centre[open_])
    away = ((z - np.take_along_axis(centre, label[:, :, None], axis=1)) ** 2).sum(axis=(1, 2))
    best = int(away.argmin())
    return centre[best], label[best]


def plus_plus(z: FloatArray, k: int, *, seed: int) -> FloatArray:
    """First centroids (starts, k, 2): each next one drawn by the squared distance from those before.

    The first of them are a start for fewer clusters.
    """
    rng = np.random.default_rng(seed)
    draws = 2 + int(math.log(k))
    start = np.arange(STARTS)
    centre = np.empty((STARTS, k, 2))
    centre[:, 0] = z[rng.integers(len(z), size=STARTS)]
    away = squares(z, centre[:, :1])[..., 0]
    for nth in range(1, k):
        total = away.cumsum(axis=1)
        drawn = rng.random((STARTS, draws)) * total[:, -1:]
        tried = np.minimum((total[:, None, :] <= drawn[:, :, None]).sum(axis=2), len(z) - 1)
        left = np.minimum(away[:, None, :], squares(z, z[tried]).transpose(0, 2, 1))
        best = left.sum(axis=2).argmin(axis=1)
        centre[:, nth], away = z[tried[start, best]], left[start, best]
    return centre


def squares(z: FloatArray, centre: FloatArray) -> FloatArray:
    """Squared distances (s, n, k) of points (n, 2) from centroids (s, k, 2)."""
    return np.asarray(
        (z[None, :, None, 0] - centre[:, None, :, 0]) ** 2 + (z[None, :, None, 1] - centre[:, None, :, 1]) ** 2
    )


def means(z: FloatArray, label: IntArray, before: FloatArray) -> FloatArray:
    """Means (s, k, 2) of the clusters of labels (s, n); of an empty one the centroid before."""
    s, k = before.shape[:2]
    flat = (label + k * np.arange(s)[:, None]).ravel()
    count = np.bincount(flat, minlength=s * k)
    sums = np.stack([np.bincount(flat, np.tile(z[:, axis], s), minlength=s * k) for axis in (0, 1)], axis=1)
    found = (sums / np.maximum(count, 1)[:, None]).reshape(s, k, 2)
    return np.where((count > 0).reshape(s, k)[..., None], found, before)
