"""How well clusters agree with labelled objects: the adjusted Rand index, and the difference in their number.

Hubert, Arabie 1985. Every pair of points of a scan is either of one object or not, and either in one cluster or not.
A point of no object and a point of no cluster are -1 (noise); `UNKNOWN` is a point that nobody knows the object of,
such as a piece of land: it is no other object's, but of two such points nothing is known, and their pairs don't count.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from maritrack.types import IntArray

NOISE, UNKNOWN = -1, -2  # labels that are no object
Noise = Literal["single", "class"]  # points of noise are each for themselves, or one more object and one more cluster


class PairCounts(NamedTuple):
    """Pairs of points, by whether they share an object and whether they share a cluster."""

    both: int
    object_only: int
    cluster_only: int
    neither: int


def pair_counts(truth: IntArray, label: IntArray, *, noise: Noise = "single") -> PairCounts:
    """Pairs of points with these objects (n,) and clusters (n,)."""
    unknown = truth == UNKNOWN
    if noise == "single":
        truth, label = _alone(truth), _alone(label)
    objects, cluster = _numbered(truth[~unknown]), _numbered(label)
    n_objects, n_clusters = int(objects.max(initial=-1)) + 1, int(cluster.max(initial=-1)) + 1
    known = cluster[~unknown]
    shared = _pairs(np.unique(objects * n_clusters + known, return_counts=True)[1])
    same_object = _pairs(np.bincount(objects, minlength=n_objects))
    unknown_pairs = _pairs(np.bincount(cluster[unknown], minlength=n_clusters))
    same_cluster = _pairs(np.bincount(cluster, minlength=n_clusters)) - unknown_pairs
    n, n_unknown = len(truth), int(unknown.sum())
    total = (n * (n - 1) - n_unknown * (n_unknown - 1)) // 2
    return PairCounts(shared, same_object - shared, same_cluster - shared, total - same_object - same_cluster + shared)


def adjusted_rand(counts: PairCounts) -> float:
    """Agreement beyond chance: 1 = the same partition, 0 = as chance has it, less = worse than that.

    Without unknown points the index of Hubert and Arabie; 1 where no pair disagrees, even if there is no pair at all.
    """
    both, object_only, cluster_only, neither = counts
    if object_only == 0 and cluster_only == 0:
        return 1.0
    share = (both + object_only) * (object_only + neither) + (both + cluster_only) * (cluster_only + neither)
    return 2.0 * (both * neither - object_only * cluster_only) / share


def adjusted_rand_index(truth: IntArray, label: IntArray, *, noise: Noise = "single") -> float:
    """The adjusted Rand index of clusters (n,) against objects (n,); -1 = noise, -2 in `truth` = unknown."""
    return adjusted_rand(pair_counts(np.asarray(truth), np.asarray(label), noise=noise))


def count_difference(truth: IntArray, label: IntArray) -> int:
    """Clusters less objects of one scan. Objects count that have a point; clusters that are not mostly unknown."""
    n_objects = len(np.unique(truth[truth >= 0]))
    inside = label >= 0
    size = np.bincount(label[inside])
    unknown = np.bincount(label[inside & (truth == UNKNOWN)], minlength=len(size))
    return int(np.count_nonzero((size > 0) & (2 * unknown <= size))) - n_objects


def _alone(label: IntArray) -> IntArray:
    """Labels with a number of its own for every point of noise."""
    free = int(label.max(initial=-1)) + 1
    return np.where(label == NOISE, free + np.arange(len(label)), label)


def _numbered(label: IntArray) -> IntArray:
    return np.asarray(np.unique(label, return_inverse=True)[1].reshape(-1), dtype=np.int64)


def _pairs(count: IntArray) -> int:
    return int((count * (count - 1)).sum()) // 2
