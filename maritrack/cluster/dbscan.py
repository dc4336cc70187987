"""DBSCAN on a plane that may be a cylinder, with a k-d tree and connected components.

Ester, Kriegel, Sander, Xu 1996. The partition is that of scikit-learn's; points of a border between two
clusters go to the one whose core point is nearest, so that the order of the points does not matter.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from maritrack.types import FloatArray, IntArray

MAX_PAIRS = 6_000_000  # of neighbours held at once, 100 MB
THIN = 8  # grid steps an eps when a scan is denser than that


def dbscan(xy_m: FloatArray, *, eps_m: float, min_points: int, period_m: float = 0.0) -> IntArray:
    """Cluster of each point (n,), -1 = noise. `period_m` closes the first axis to a circle.

    A point is core when at least `min_points` points, itself included, are within `eps_m`. Input with more
    than 6 million pairs of neighbours is first gathered on a grid of eps/8: memory stays bounded.
    """
    n = len(xy_m)
    if n == 0:
        return np.zeros(0, np.int64)
    if period_m > 0:
        xy_m = np.stack([xy_m[:, 0] % period_m, xy_m[:, 1]], axis=1)
        xy_m[:, 0][xy_m[:, 0] >= period_m] = 0.0
    tree = _tree(xy_m, period_m)
    if n * (n - 1) // 2 > MAX_PAIRS and tree.count_neighbors(tree, eps_m) > 2 * MAX_PAIRS:
        step = eps_m / THIN
        cell, back, weight = np.unique(np.floor(xy_m / step), axis=0, return_inverse=True, return_counts=True)
        label = _labels((cell + 0.5) * step, weight, eps_m, min_points, period_m)
        return np.asarray(label[back.reshape(-1)])
    return _labels(xy_m, np.ones(n, np.int64), eps_m, min_points, period_m, tree)


def _tree(xy_m: FloatArray, period_m: float) -> cKDTree:
    if period_m > 0:
        xy_m = np.stack([xy_m[:, 0] % period_m, xy_m[:, 1]], axis=1)
        return cKDTree(xy_m, boxsize=[period_m, 0.0], balanced_tree=False, compact_nodes=False)
    return cKDTree(xy_m, balanced_tree=False, compact_nodes=False)


def _labels(
    xy_m: FloatArray, weight: IntArray, eps_m: float, min_points: int, period_m: float, tree: cKDTree | None = None
) -> IntArray:
    n = len(xy_m)
    pairs = (tree or _tree(xy_m, period_m)).query_pairs(eps_m, output_type="ndarray")
    a, b = pairs[:, 0], pairs[:, 1]
    near = weight + np.bincount(a, weight[b], n).astype(int) + np.bincount(b, weight[a], n).astype(int)
    core = near >= min_points
    both = core[a] & core[b]
    graph = coo_matrix((np.ones(both.sum(), bool), (a[both], b[both])), shape=(n, n))
    _, component = connected_components(graph, directed=False)
    label = np.where(core, component, -1)
    border, owner = (
        np.concatenate([a[core[b] & ~core[a]], b[core[a] & ~core[b]]]),
        np.concatenate([b[core[b] & ~core[a]], a[core[a] & ~core[b]]]),
    )
    if len(border):
        step = xy_m[border] - xy_m[owner]
        if period_m > 0:
            step[:, 0] = (step[:, 0] + period_m / 2) % period_m - period_m / 2
        far_first = np.lexsort((xy_m[owner, 1], xy_m[owner, 0], np.einsum("nd,nd->n", step, step)))[::-1]
        label[border[far_first]] = component[owner[far_first]]  # the last to write is the nearest
    used, dense = np.unique(label, return_inverse=True)
    return np.asarray(dense.reshape(-1) - (1 if used[0] == -1 else 0), dtype=np.int64)
