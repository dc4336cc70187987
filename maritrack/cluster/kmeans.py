"""k-means with the number of clusters by an index of how well they are apart, and a rule for what no index can tell.

Fowdur, Baum, Heymann 2021, section 3.2; two of the indices are scikit-learn's. All three indices are undefined for
one cluster, and the paper has no rule for it. `gap` (the default): there are no more clusters than groups of points
that a gap wider than `eps_m` parts (single linkage), so that one vessel is one cluster however long it is, and
Calinski-Harabasz doesn't cut long echoes in two. `spread`: one cluster where the root mean square distance from the
centroid is below `one_spread_m`, else any number: nearer to the paper, which says that long echoes come in two.

An index weighs points: where most of them are land it finds parts of the land, and vessels near each other are one.
Land is for the mask of the pictures or the background, or `single-linkage` for the clusters.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from maritrack.cluster.chained import groups
from maritrack.cluster.lloyd import lloyd, plus_plus
from maritrack.settings import ClusterConfig
from maritrack.types import FloatArray, IntArray

MOST_POINTS = 4000  # take part in the search; of more a sample, and all then go to their nearest centroid


def kmeans(position_m: FloatArray, config: ClusterConfig) -> IntArray:
    """Cluster of each point (n,), from 0 on; the order of the points makes no difference to who is with whom.

    Of several numbers of clusters that are equally good the smallest counts.   Source: dataset, sec. 3.2
    """
    n = len(position_m)
    label = np.zeros(n, np.int64)
    group = groups(position_m, config.eps_m) if config.k_rule == "gap" else label
    most = most_clusters(position_m, group, config) if n > 1 else 1
    if most == 1:
        return label
    order = np.lexsort((position_m[:, 1], position_m[:, 0]))
    z = position_m[order] - position_m[order[0]]
    sample = z[sampled(group[order], MOST_POINTS)]
    distinct = len(np.unique(sample, axis=0))
    if distinct <= 2:  # an index needs more points than clusters
        label[order] = nearest(z, np.unique(sample, axis=0))
        return label
    best, chosen = -np.inf, sample.mean(axis=0, keepdims=True)
    most = min(most, distinct - 1)
    start = plus_plus(sample, most, seed=config.kmeans_seed)
    for k in range(2, most + 1):
        centre, mine = lloyd(sample, start[:, :k])
        value = INDEX[config.k_index](sample, mine)
        if value > best:
            best, chosen = value, centre
    label[order] = nearest(z, chosen)
    return np.unique(label, return_inverse=True)[1].astype(np.int64)


def most_clusters(position_m: FloatArray, group: IntArray, config: ClusterConfig) -> int:
    """How many clusters the points (n, 2) of these groups (n,) may have, by the rule of the settings."""
    if config.k_rule == "spread":
        away = position_m - position_m.mean(axis=0)
        return 1 if np.sqrt((away**2).sum(axis=1).mean()) < config.one_spread_m else config.k_max
    return min(config.k_max, int(group.max()) + 1)


def sampled(group: IntArray, most: int) -> IntArray:
    """Which points (s,) of groups (n,) take part where at most so many may: of the largest groups every n-th.

    A boat before a coast of a thousand times its points keeps its own.
    """
    if len(group) <= most:
        return np.arange(len(group))
    size = np.bincount(group)
    small = np.sort(size)
    room = (most - (np.cumsum(small) - small)) // np.arange(len(small), 0, -1)  # for each, once the smaller are whole
    each = max(int(room[np.argmax(room < small)]), 1)
    step = -(-size // each)
    order = np.argsort(group, kind="stable")
    rank = np.empty(len(group), np.int64)
    rank[order] = np.arange(len(group)) - np.repeat(np.cumsum(size) - size, size)
    chosen = np.flatnonzero(rank % step[group] == 0)
    return chosen[:: -(-len(chosen) // most)]


def nearest(z: FloatArray, centre: FloatArray) -> IntArray:
    """The nearest centroid of each point (n,)."""
    square = ((z[:, None, :] - centre[None, :, :]) ** 2).sum(axis=-1)
    return np.asarray(square.argmin(axis=1), np.int64)


def calinski_harabasz(z: FloatArray, label: IntArray) -> float:
    """Spread of the centroids over that of the points about them, each by its degrees of freedom."""
    n, count = len(z), np.bincount(label)
    k = int((count > 0).sum())
    sums = np.stack([np.bincount(label, z[:, axis]) for axis in (0, 1)], axis=1)
    within = float(((z - (sums / np.maximum(count, 1)[:, None])[label]) ** 2).sum())
    between = float(((z - z.mean(axis=0)) ** 2).sum()) - within
    return between * (n - k) / (within * (k - 1)) if within > 0.0 else 1.0


def _davies_bouldin(z: FloatArray, label: IntArray) -> float:
    from sklearn.metrics import davies_bouldin_score

    with _controller().limit(limits=1):
        return -float(davies_bouldin_score(z, label))  # the smaller the better


def _silhouette(z: FloatArray, label: IntArray) -> float:
    from sklearn.metrics import silhouette_score

    with _controller().limit(limits=1):
        return float(silhouette_score(z, label))


@cache
def _controller() -> Any:
    """Of the library's threads: sums by several depend on who comes first."""
    import sklearn.metrics  # noqa: F401 - its library of threads has to be there to be found
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


INDEX: dict[str, Callable[[FloatArray, IntArray], float]] = {
    "calinski-harabasz": calinski_harabasz,
    "davies-bouldin": _davies_bouldin,
    "silhouette": _silhouette,
}
