"""Hierarchical clustering of points, cut at a distance: the pre-processing of extended, sec. 3.2."""

from __future__ import annotations

from typing import Literal

import numpy as np

from maritrack.cluster.dbscan import dbscan
from maritrack.types import FloatArray, IntArray

MAX_WHOLE = 3000  # points that one table of distances holds
Linkage = Literal["single-linkage", "complete-linkage"]


def linkage_labels(xy_m: FloatArray, *, distance_m: float, how: Linkage) -> IntArray:
    """Cluster of each point (n,) from 0; every point is in one.

    "single-linkage" joins what is nearer than the distance, and so chains to any length; it is what the paper's
    `fclusterdata` does. "complete-linkage" is what the paper's text says: no two points of a cluster are farther apart.
    Of more than 3000 points in a chain the latter takes those of squares whose diagonal is the distance together.

    Reading: extended sec. 3.2 "the distance between each measurement in a cluster is no more than 5 meters" is complete
    linkage, the function named there single linkage; both are options, and the preset has what the function does.
    """
    label = dbscan(xy_m, eps_m=distance_m, min_points=1)
    if how == "single-linkage" or len(xy_m) == 0:
        return label
    parts = np.zeros(len(xy_m), np.int64)
    order = np.argsort(label, kind="stable")
    for mine in np.split(order, np.flatnonzero(np.diff(label[order])) + 1):
        parts[mine] = _complete(xy_m[mine], distance_m)
    return np.asarray(np.unique(np.stack([label, parts], axis=1), axis=0, return_inverse=True)[1].reshape(-1), np.int64)


def _complete(xy_m: FloatArray, distance_m: float) -> IntArray:
    """Parts (n,) of one chain."""
    if len(xy_m) == 1 or np.hypot(*np.ptp(xy_m, axis=0)) <= distance_m:
        return np.zeros(len(xy_m), np.int64)
    if len(xy_m) > MAX_WHOLE:
        square = np.floor(xy_m / (distance_m / np.sqrt(2.0)))
        return np.asarray(np.unique(square, axis=0, return_inverse=True)[1].reshape(-1), np.int64)
    from scipy.cluster.hierarchy import fcluster, linkage  # not at the top: not every run has it

    return np.asarray(fcluster(linkage(xy_m, "complete"), distance_m, "distance"), np.int64)
