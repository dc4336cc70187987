"""Connected groups of tracks and measurements: what must be associated together, and nothing more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maritrack.types import IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Groups:
    """Pairs (k,) sorted into g groups that share neither a track nor a measurement."""

    group: IntArray  # (k,) group of each pair, numbered by smallest track
    track: IntArray  # (k,) place of the pair's track among those of its group, from 0
    measurement: IntArray  # (k,) place of its measurement likewise
    n_tracks: IntArray  # (g,)
    n_measurements: IntArray  # (g,)

    def __len__(self) -> int:
        return len(self.n_tracks)


def connected_groups(track: IntArray, measurement: IntArray) -> Groups:
    """Groups of a pair list; order of the pairs does not matter, places follow the indices."""
    if len(track) == 0:
        none = np.empty(0, dtype=np.int64)
        return Groups(none, none, none, none, none)
    group = _components(track, measurement)
    place_t, n_tracks = _places(track, group)
    place_m, n_measurements = _places(measurement, group)
    return Groups(group, place_t, place_m, n_tracks, n_measurements)


def _components(track: IntArray, measurement: IntArray) -> IntArray:
    """Group of each pair by union-find; for the few hundred pairs of a scan faster than a sparse matrix."""
    offset = int(track.max()) + 1
    parent = list(range(offset + int(measurement.max()) + 1))
    for t, m in zip(track.tolist(), measurement.tolist(), strict=True):
        a, b = t, offset + m
        while parent[a] != a:
            parent[a] = a = parent[parent[a]]
        while parent[b] != b:
            parent[b] = b = parent[parent[b]]
        parent[max(a, b)] = min(a, b)  # the root is the smallest track
    for node, above in enumerate(parent[:offset]):
        parent[node] = parent[above]  # parents come first, so one pass reaches the roots
    roots = np.array(parent, dtype=np.int64)[track]
    is_root = np.zeros(offset, dtype=np.int64)
    is_root[roots] = 1
    return (np.cumsum(is_root) - 1)[roots]


def _places(node: IntArray, group: IntArray) -> tuple[IntArray, IntArray]:
    """Rank of each pair's node among the nodes of its group (k,), and the number of those (g,)."""
    group_of = np.full(int(node.max()) + 1, -1, dtype=np.int64)
    group_of[node] = group
    nodes = np.flatnonzero(group_of >= 0)
    nodes = nodes[np.argsort(group_of[nodes], kind="stable")]
    count = np.bincount(group_of[nodes])
    start = np.cumsum(count) - count
    place = np.empty_like(group_of)
    place[nodes] = np.arange(len(nodes)) - start[group_of[nodes]]
    return place[node], count
