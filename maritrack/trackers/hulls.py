"""The convex hull of the cluster that is likeliest a track's, as the extent of a point tracker (extended, sec. 3.2)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from maritrack.trackers.tracklist import TrackList
from maritrack.types import Clusters, FloatArray, Points


def followed(tracks: TrackList, points: Points, clusters: Clusters) -> Mapping[int, FloatArray]:
    """Hulls (v, 2) by id, from the place of their track: of its cluster, or without one the hull that it had.

    So a track that is missed takes its last hull along.
    """
    order = np.argsort(clusters.label, kind="stable")
    ends = np.searchsorted(clusters.label[order], np.arange(len(clusters) + 1))
    z, found = points.position_m, {}
    rows = zip(tracks.id.tolist(), tracks.cluster.tolist(), tracks.density.x[:, :2], strict=True)
    for track, cluster, at_m in rows:
        if cluster >= 0:
            found[track] = convex(z[order[ends[cluster] : ends[cluster + 1]]]) - at_m
        else:
            found[track] = tracks.hulls.get(track, np.zeros((0, 2)))
    return found


def convex(z_m: FloatArray) -> FloatArray:
    """Corners (v, 2) of the convex hull of points (n, 2), counter-clockwise; of points on a line its two ends."""
    if len(z_m) < 3:
        return z_m.copy()
    try:
        return np.asarray(z_m[ConvexHull(z_m).vertices])
    except QhullError:  # on a line
        offset = z_m - z_m[0]
        along = offset @ offset[np.argmax(np.hypot(*offset.T))]
        return z_m[[int(along.argmin()), int(along.argmax())]]
