"""DBSCAN on a plane that may be a cylinder, with a k-d tree and connected components.

Ester, Kriegel, Sander, Xu 1996. The partition is that of scikit-learn's; points of a border between two
clusters go to the one whose core point is nearest, so that the order of the points does not matter.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from maritrack.types import BoolArray, FloatArray, IntArray

MAX_PAIRS = 1_500_000  # of neighbours held at once, 80 bytes each while they are looked at
CROWD = 256  # neighbours of a point, in the mean, beyond which points may be gathered on a grid ...
THIN = 8  # ... of so many steps an eps, on which they are 201 at most
SLACK = 1.0 + 1e-9  # the tree may round otherwise than `Pairs.squared_m2`, which decides


class Pairs(NamedTuple):
    """Pairs of points that are near one another, each once."""

    a: IntArray  # (m,)
    b: IntArray  # (m,)
    squared_m2: FloatArray  # (m,) squared distance


def dbscan(xy_m: FloatArray, *, eps_m: float, min_points: int, period_m: float = 0.0) -> IntArray:
    """Cluster of each point (n,), -1 = noise. `period_m` closes the first axis to a circle.

    A point is core when at least `min_points` points, itself included, are within `eps_m`. Of more than 1.5
    million pairs of neighbours a part is held at a time, so that memory is bounded but for the points' own. Of more
    than 6 million, where points have more than 256 neighbours in the mean, they are first gathered on a grid of eps/8.
    """
    n = len(xy_m)
    if n == 0:
        return np.zeros(0, np.int64)
    xy_m = on_cylinder(xy_m, period_m)
    tree = tree_of(xy_m, period_m)
    if not crowded(tree, eps_m):
        return _labels(xy_m, np.ones(n, np.int64), eps_m, min_points, [near_pairs(tree, eps_m, period_m)])
    if int(tree.count_neighbors(tree, eps_m)) > max(CROWD * n, 8 * MAX_PAIRS):
        step = eps_m / THIN
        cell, back, weight = np.unique(np.floor(xy_m / step), axis=0, return_inverse=True, return_counts=True)
        xy_m = on_cylinder((cell + 0.5) * step, period_m)
        slabs = Slabs(tree_of(xy_m, period_m), eps_m, period_m)
        return _labels(xy_m, weight, eps_m, min_points, slabs)[back.reshape(-1)]
    return _labels(xy_m, np.ones(n, np.int64), eps_m, min_points, Slabs(tree, eps_m, period_m))


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
    return _measured(tree, pairs[:, 0], pairs[:, 1], eps_m, period_m)


def _measured(tree: cKDTree, a: IntArray, b: IntArray, eps_m: float, period_m: float) -> Pairs:
    """Those of the pairs that are not farther apart than `eps_m`."""
    x, y = tree.data.T
    across = x[a] - x[b]
    if period_m > 0:
        across -= period_m * np.rint(across / period_m)
    squared = across**2 + (y[a] - y[b]) ** 2
    near = squared <= eps_m**2
    return Pairs(a, b, squared) if near.all() else Pairs(a[near], b[near], squared[near])


@dataclass(frozen=True, slots=True)
class Slabs:
    """All pairs of the tree's points not farther apart than `eps_m`, a bounded number of them at a time."""

    tree: cKDTree
    eps_m: float
    period_m: float

    def __iter__(self) -> Iterator[Pairs]:
        """Points that are neighbours in the tree, with all that is near them; each pair comes once."""
        tree, reach_m = self.tree, self.eps_m * SLACK
        xy_m, order = np.asarray(tree.data), np.asarray(tree.indices)
        ends = np.cumsum(tree.query_ball_point(xy_m[order], reach_m, return_length=True))
        first = 0
        while first < len(order):
            held = ends[first - 1] if first else 0
            last = max(int(np.searchsorted(ends, held + MAX_PAIRS, side="right")), first + 1)
            mine = order[first:last]
            both = tree_of(xy_m[mine], self.period_m).sparse_distance_matrix(tree, reach_m, output_type="ndarray")
            a, b = mine[both["i"]], both["j"]
            once = a < b
            yield _measured(tree, a[once], b[once], self.eps_m, self.period_m)
            first = last


def tree_of(xy_m: FloatArray, period_m: float) -> cKDTree:
    boxsize = [period_m, 0.0] if period_m > 0 else None
    return cKDTree(xy_m, boxsize=boxsize, balanced_tree=False, compact_nodes=False)


def _labels(xy_m: FloatArray, weight: IntArray, eps_m: float, min_points: int, slabs: Iterable[Pairs]) -> IntArray:
    n = len(xy_m)
    near = weight.copy()
    for a, b, _ in slabs:
        near += np.bincount(a, weight[b], n).astype(int) + np.bincount(b, weight[a], n).astype(int)
    core = near >= min_points
    component, owner_of, nearest_m2 = np.arange(n), np.full(n, -1, np.int64), np.full(n, np.inf)
    for a, b, squared in slabs:
        both = core[a] & core[b]
        component = joined(component, a[both], b[both])
        border, owner, at = border_pairs(a, b, core[b] & ~core[a], core[a] & ~core[b])
        old = np.unique(border[owner_of[border] >= 0])  # what earlier slabs have found is one of the candidates
        border, owner = np.concatenate([border, old]), np.concatenate([owner, owner_of[old]])
        distance_m2 = np.concatenate([squared[at], nearest_m2[old]])
        far_first = nearest_last(xy_m, owner, distance_m2)
        owner_of[border[far_first]] = owner[far_first]  # the last to write is the nearest
        nearest_m2[border[far_first]] = distance_m2[far_first]
    label = np.where(core, component, -1)
    beside = owner_of >= 0
    label[beside] = component[owner_of[beside]]
    return dense(label)


def joined(component: IntArray, a: IntArray, b: IntArray) -> IntArray:
    """Components (n,) once the points a and b of each pair are in one; numbered by their first points, as before."""
    ends = component[a], component[b]
    apart = ends[0] != ends[1]
    if not apart.any():
        return component
    n = len(component)
    graph = coo_matrix((np.ones(int(apart.sum()), bool), (ends[0][apart], ends[1][apart])), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1][component], dtype=np.int64)


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
