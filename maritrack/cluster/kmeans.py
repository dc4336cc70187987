"""k-means with the number of clusters by an index of how well they are apart, and a rule for what no index can tell.

Fowdur, Baum, Heymann 2021, section 3.2, with scikit-learn's k-means++ and indices. All three indices are undefined for
one cluster, and the paper has no rule for it. `gap` (the default): there are no more clusters than groups of points
that a gap wider than `eps_m` parts (single linkage), so that one vessel is one cluster however long it is, and
Calinski-Harabasz doesn't cut long echoes in two. `spread`: one cluster where the root mean square distance from the
centroid is below `one_spread_m`, else any number: nearer to the paper, which says that long echoes come in two.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from maritrack.cluster.dbscan import dbscan
from maritrack.settings import ClusterConfig
from maritrack.types import FloatArray, IntArray

MOST_POINTS = 4000  # take part in the search; of more every n-th, and all then go to their nearest centroid
STARTS = 10


def kmeans(position_m: FloatArray, config: ClusterConfig) -> IntArray:
    """Cluster of each point (n,), from 0 on; the order of the points makes no difference to who is with whom.

    Of several numbers of clusters that are equally good the smallest counts.   Source: dataset, sec. 3.2
    """
    n = len(position_m)
    label = np.zeros(n, np.int64)
    most = most_clusters(position_m, config) if n > 1 else 1
    if most == 1:
        return label
    order = np.lexsort((position_m[:, 1], position_m[:, 0]))
    z = position_m[order] - position_m[order[0]]
    sample = z[:: -(-n // MOST_POINTS)]
    distinct = len(np.unique(sample, axis=0))
    if distinct <= 2:  # an index needs more points than clusters
        label[order] = nearest(z, np.unique(sample, axis=0))
        return label
    best, chosen = -np.inf, sample.mean(axis=0, keepdims=True)
    with _controller().limit(limits=1):  # sums by several threads depend on who comes first
        for k in range(2, min(most, distinct - 1) + 1):
            centre, mine = fit(sample, k, seed=config.kmeans_seed)
            value = INDEX[config.k_index](sample, mine)
            if value > best:
                best, chosen = value, centre
    label[order] = nearest(z, chosen)
    return np.unique(label, return_inverse=True)[1].astype(np.int64)


def most_clusters(position_m: FloatArray, config: ClusterConfig) -> int:
    """How many clusters the points (n, 2) may have, by the rule of the settings."""
    if config.k_rule == "spread":
        away = position_m - position_m.mean(axis=0)
        return 1 if np.sqrt((away**2).sum(axis=1).mean()) < config.one_spread_m else config.k_max
    groups = int(dbscan(position_m, eps_m=config.eps_m, min_points=1, period_m=0.0).max()) + 1
    return min(config.k_max, groups)


def fit(z: FloatArray, k: int, *, seed: int) -> tuple[FloatArray, IntArray]:
    """Centroids (k, 2) and the cluster of each point (n,), the best of some starts by k-means++."""
    from sklearn.cluster import KMeans

    found = KMeans(k, n_init=STARTS, random_state=seed, copy_x=True).fit(z)
    return np.asarray(found.cluster_centers_), np.asarray(found.labels_, np.int64)


def nearest(z: FloatArray, centre: FloatArray) -> IntArray:
    """The nearest centroid of each point (n,)."""
    square = ((z[:, None, :] - centre[None, :, :]) ** 2).sum(axis=-1)
    return np.asarray(square.argmin(axis=1), np.int64)


def _calinski_harabasz(z: FloatArray, label: IntArray) -> float:
    from sklearn.metrics import calinski_harabasz_score

    return float(calinski_harabasz_score(z, label))


def _davies_bouldin(z: FloatArray, label: IntArray) -> float:
    from sklearn.metrics import davies_bouldin_score

    return -float(davies_bouldin_score(z, label))  # the smaller the better


def _silhouette(z: FloatArray, label: IntArray) -> float:
    from sklearn.metrics import silhouette_score

    return float(silhouette_score(z, label))


INDEX: dict[str, Callable[[FloatArray, IntArray], float]] = {
    "calinski-harabasz": _calinski_harabasz,
    "davies-bouldin": _davies_bouldin,
    "silhouette": _silhouette,
}


@cache
def _controller() -> Any:
    import sklearn.cluster  # noqa: F401 - its library of threads has to be there to be found
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
