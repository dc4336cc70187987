"""DBSCAN for many eps and many min_points at once: the neighbours are looked for once, at the largest eps.

For one min_points a point is core from some eps on and stays so, and clusters only grow together. Each pair of
neighbours is therefore looked at once, at the eps at which it begins to join two cores.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from maritrack.cluster.dbscan import (
    Pairs,
    border_pairs,
    crowded,
    dbscan,
    dense,
    joined,
    near_pairs,
    nearest_last,
    on_cylinder,
    tree_of,
)
from maritrack.types import FloatArray, IntArray


def dbscan_grid(
    xy_m: FloatArray, *, eps_m: Sequence[float], min_points: Sequence[int], period_m: float = 0.0
) -> Iterator[IntArray]:
    """For each of `min_points` the labels (e, n) for every eps (ascending): what `dbscan` gives, row by row.

    An eps at which the points are too crowded for their pairs to be held is left to `dbscan` itself.
    """
    eps = np.asarray(eps_m, dtype=np.float64)
    if np.any(np.diff(eps) <= 0):
        raise ValueError("eps_m is not ascending")
    n = len(xy_m)
    if n == 0:
        yield from (np.zeros((len(eps), 0), np.int64) for _ in min_points)
        return
    xy = on_cylinder(xy_m, period_m)
    tree = tree_of(xy, period_m)
    easy = next((i for i, e in enumerate(eps_m) if crowded(tree, e)), len(eps))  # so many are not crowded
    pairs = near_pairs(tree, eps[easy - 1], period_m) if easy else Pairs(*np.zeros((3, 0), np.int64))
    level = np.searchsorted(eps[:easy] ** 2, pairs.squared_m2)  # the first eps within which the pair is
    near = 1 + _neighbours(pairs, level, n, easy)
    for least in min_points:
        label = np.empty((len(eps), n), np.int64)
        label[:easy] = _labels(xy, pairs, level, (near < least).sum(axis=1), easy)
        for i in range(easy, len(eps)):
            label[i] = dbscan(xy_m, eps_m=float(eps[i]), min_points=least, period_m=period_m)
        yield label


def _neighbours(pairs: Pairs, level: IntArray, n: int, n_eps: int) -> IntArray:
    """Neighbours (n, e) of each point within each eps."""
    size = n * n_eps
    new = np.bincount(pairs.a * n_eps + level, minlength=size) + np.bincount(pairs.b * n_eps + level, minlength=size)
    return np.cumsum(new.reshape(n, n_eps), axis=1)


def _labels(xy_m: FloatArray, pairs: Pairs, level: IntArray, core_from: IntArray, n_eps: int) -> IntArray:
    """Labels (e, n) where points are core from the eps number `core_from` (n,) on."""
    from_a, from_b = core_from[pairs.a], core_from[pairs.b]
    joins = np.maximum(level, np.maximum(from_a, from_b)).astype(np.int16)  # a pair of cores from this eps on
    order = np.argsort(joins, kind="stable")
    bounds = np.searchsorted(joins[order], np.arange(n_eps + 1))
    reached = np.maximum(level, np.minimum(from_a, from_b))  # a border point has a core beside it from here ...
    border, owner, at = border_pairs(
        pairs.a, pairs.b, (reached < from_a) & (from_b < from_a), (reached < from_b) & (from_a < from_b)
    )  # ... until it is core itself
    far_first = nearest_last(xy_m, owner, pairs.squared_m2[at])
    border, owner, begins = border[far_first], owner[far_first], reached[at[far_first]]
    component = np.arange(len(xy_m))
    label = np.empty((n_eps, len(xy_m)), np.int64)
    for i in range(n_eps):
        new = order[bounds[i] : bounds[i + 1]]
        component = joined(component, pairs.a[new], pairs.b[new])
        now = (begins <= i) & (core_from[border] > i)
        label[i] = np.where(core_from <= i, component, -1)
        label[i, border[now]] = component[owner[now]]  # the last to write is the nearest
        label[i] = dense(label[i])
    return label
