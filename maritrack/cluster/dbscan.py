"""DBSCAN on a plane that may be a cylinder, with a k-d tree and connected components.

Ester, Kriegel, Sander, Xu 1996. The partition is that of scikit-learn's; points of a border between two
clusters go to the one whose core point is nearest, so that the order of the points does not matter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from maritrack.types import BoolArray, FloatArray, IntArray

MAX_PAIRS = 6_000_000  # of neighbours held at once, 100 MB
THIN = 8  # grid steps an eps when a scan is denser than that
SLACK = 1.0 + 1e-9  # the tree may round otherwise than `Pairs.squared_m2`, which decides


class Pairs(NamedTuple):
    """Pairs of points that are near one another, each once."""

    a: IntArray  # (m,)
    b: IntArray  # (m,)
    squared_m2: FloatArray  # (m,) squared distance


def dbscan(xy_m: FloatArray, *, eps_m: float, min_points: int, period_m: float = 0.0) -> IntArray:
    """Cluster of each point (n,), -1 = noise. `period_m` closes the first axis to a circle.

    A point is core when at least `min_points` points, itself included, are within `eps_m`. Input with more
    than 6 million pairs of neighbours is first gathered on a grid of eps/8: memory stays bounded.
    """
    n = len(xy_m)
    if n == 0:
        return np.zeros(0, np.int64)
    xy_m = on_cylinder(xy_m, period_m)
    tree = tree_of(xy_m, period_m)
    if crowded(tree, eps_m):
        step = eps_m / THIN
        cell, back, weight = np.unique(np.floor(xy_m / step), axis=0, return_inverse=True, return_counts=True)
        xy_m = on_cylinder((cell + 0.5) * step, period_m)
        return _labels(xy_m, weight, eps_m, min_points, period_m, tree_of(xy_m, period_m))[back.reshape(-1)]
    return _labels(xy_m, np.ones(n, np.int64), eps_m, min_points, period_m, tree)


def on_cylinder(xy_m: FloatArray, period_m: float) -> FloatArray:
    """The points with the first axis within [0, period); untouched where the plane is no cylinder."""
    if period_m <= 0:
        return xy_m
    turned = np.stack([xy_m[:, 0] % period_m, xy_m[:, 1]], axis=1)
    turned[:, 0][turned[:, 0] >= period_m] = 0.0
    return turned


def crowded(tree: cKDTree, eps_m: float) -> bool:
    """Whether the pairs of neighbours are too many to hold."""
    n = int(tree.n)
    return n * (n - 1) // 2 > MAX_PAIRS and int(tree.count_neighbors(tree, eps_m)) > 2 * MAX_PAIRS


def near_pairs(tree: cKDTree, eps_m: float, period_m: float) -> Pairs:
    """All pairs of the tree's points not farther apart than `eps_m`."""
    pairs = tree.query_pairs(eps_m * SLACK, output_type="ndarray")
    a, b = pairs[:, 0], pairs[:, 1]
    x, y = tree.data.T
    across = x[a] - x[b]
    if period_m > 0:
        across -= period_m * np.rint(across / period_m)
    squared = across**2 + (y[a] - y[b]) ** 2
    near = squared <= eps_m**2
    return Pairs(a, b, squared) if near.all() else Pairs(a[near], b[near], squared[near])


def tree_of(xy_m: FloatArray, period_m: float) -> cKDTree:
    boxsize = [period_m, 0.0] if period_m > 0 else None
    return cKDTree(xy_m, boxsize=boxsize, balanced_tree=False, compact_nodes=False)


def _labels(
    xy_m: FloatArray, weight: IntArray, eps_m: float, min_points: int, period_m: float, tree: cKDTree
) -> IntArray:
    n = len(xy_m)
    a, b, squared = near_pairs(tree, eps_m, period_m)
    near = weight + np.bincount(a, weight[b], n).astype(int) + np.bincount(b, weight[a], n).astype(int)
    core = near >= min_points
    both = core[a] & core[b]
    graph = coo_matrix((np.ones(both.sum(), bool), (a[both], b[both])), shape=(n, n))
    _, component = connected_components(graph, directed=False)
    label = np.where(core, component, -1)
    border, owner, at = border_pairs(a, b, core[b] & ~core[a], core[a] & ~core[b])
    far_first = nearest_last(xy_m, owner, squared[at])
    label[border[far_first]] = component[owner[far_first]]  # the last to write is the nearest
    return dense(label)


def border_pairs(a: IntArray, b: IntArray, to_b: BoolArray, to_a: BoolArray) -> tuple[IntArray, IntArray, IntArray]:
    """Border points, core points beside them, and the numbers of the pairs they are: a is the border of core b where
    `to_b` (m,) says so, b that of core a where `to_a` does.
    """
    at_b, at_a = np.flatnonzero(to_b), np.flatnonzero(to_a)
    return np.concatenate([a[at_b], b[at_a]]), np.concatenate([b[at_b], a[at_a]]), np.concatenate([at_b, at_a])


def nearest_last(xy_m: FloatArray, owner: IntArray, squared_m2: FloatArray) -> IntArray:
    """Order by distance, the nearest last; between equal ones the place of the owner decides, not its number."""
    return np.lexsort((xy_m[owner, 1], xy_m[owner, 0], squared_m2))[::-1]


def dense(label: IntArray) -> IntArray:
    """Labels (n,) from 0 to n - 1 numbered without gaps in their order, -1 stays."""
    used = np.zeros(len(label) + 1, np.int64)
    used[label + 1] = 1
    number = np.cumsum(used) - used[0] - 1
    number[0] = -1
    return np.asarray(number[label + 1], dtype=np.int64)
