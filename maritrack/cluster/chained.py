"""Groups of points that a gap parts, of however many points: single linkage without the pairs of a crowd.

Points in a square whose diagonal is the gap are of one group. Of squares near each other first the outermost points
are compared, then all points of those squares that are not in one group yet: few of a coast, whatever lies behind it.
"""

from __future__ import annotations

import math

import numpy as np

from maritrack.cluster.dbscan import Slabs, dbscan, dense, joined, tree_of
from maritrack.types import FloatArray, IntArray

NEAR = [(0, 1), (0, 2), *((across, along) for across in (1, 2) for along in range(-2, 3))]  # half of what is near
CROWD = 1000  # points, below which their pairs are few
MOST_SQUARES = 2**30  # along an axis
SHRUNK = 1.0 - 1e-9  # so that the diagonal is within the gap, however it is rounded


def groups(xy_m: FloatArray, gap_m: float) -> IntArray:
    """Group of each point (n,), from 0 on in the order of their first points: `dbscan` with one point a cluster."""
    n = len(xy_m)
    scaled = (xy_m - xy_m.min(axis=0, initial=math.inf)) / (gap_m * SHRUNK / math.sqrt(2.0))
    if n < CROWD or scaled.max() > MOST_SQUARES:
        return dbscan(xy_m, eps_m=gap_m, min_points=1)
    square = np.floor(scaled).astype(np.int64)
    wide = int(square[:, 1].max()) + 5  # so that what is near never runs into the next column
    key, cell = np.unique(square[:, 0] * wide + square[:, 1], return_inverse=True)
    of_cell = np.arange(len(key))
    outer = xy_m[_outermost(xy_m, cell)]
    a, b = _near(key, wide)
    touch = ((outer[a][:, :, None] - outer[b][:, None]) ** 2).sum(axis=-1).min(axis=(1, 2)) <= gap_m**2
    of_cell = joined(of_cell, a[touch], b[touch])
    open_ = of_cell[a] != of_cell[b]
    left = np.zeros(len(key), bool)
    left[a[open_]] = left[b[open_]] = True
    some = np.flatnonzero(left[cell])
    if len(some):
        for i, j, _ in Slabs(tree_of(xy_m[some], 0.0), gap_m, 0.0):
            of_cell = joined(of_cell, cell[some[i]], cell[some[j]])
    _, first, label = np.unique(of_cell[cell], return_index=True, return_inverse=True)
    return dense(first[label])


def _outermost(xy_m: FloatArray, cell: IntArray) -> IntArray:
    """The points (c, 4) of each cell that lie farthest west, east, south and north."""
    found = []
    for axis in (0, 1):
        order = np.lexsort((xy_m[:, axis], cell))
        begins = np.append(True, np.diff(cell[order]) != 0)
        found += [order[begins], order[np.append(begins[1:], True)]]
    return np.stack(found, axis=1)


def _near(key: IntArray, wide: int) -> tuple[IntArray, IntArray]:
    """Pairs of the squares (c,) that are at most two apart along each axis, each pair once."""
    pairs = []
    for across, along in NEAR:
        at = np.searchsorted(key, key + across * wide + along).clip(max=len(key) - 1)
        there = np.flatnonzero(key[at] == key + across * wide + along)
        pairs.append((there, at[there]))
    return np.concatenate([a for a, _ in pairs]), np.concatenate([b for _, b in pairs])
