"""Hard association on lists of possible pairs (track, measurement, cost): who takes what, nothing shared.

Each function returns which pairs (k,) stay; the order of the list does not matter. Pairs of equal cost are taken
in the order of track, then measurement.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.optimize import linear_sum_assignment

from maritrack.associate.groups import connected_groups
from maritrack.types import BoolArray, FloatArray, IntArray

Assignment = Literal["greedy", "optimal"]


def assign(track: IntArray, measurement: IntArray, cost: FloatArray, *, how: Assignment) -> BoolArray:
    """1:1, greedy or optimal."""
    return (greedy if how == "greedy" else optimal)(track, measurement, cost)


def greedy(track: IntArray, measurement: IntArray, cost: FloatArray) -> BoolArray:
    """1:1 in ascending order of cost: a pair is taken where both are still free.

    In rounds: a pair that is first for both its track and its measurement is taken whatever the rest do.
    """
    taken = np.zeros(len(cost), bool)
    left = np.lexsort((measurement, track, cost))
    n_tracks, n_measurements = _size(track), _size(measurement)
    while len(left):
        t, m = track[left], measurement[left]
        first = _is_first(t, n_tracks) & _is_first(m, n_measurements)
        taken[left[first]] = True
        busy_t, busy_m = np.zeros(n_tracks, bool), np.zeros(n_measurements, bool)
        busy_t[t[first]] = busy_m[m[first]] = True
        left = left[~(busy_t[t] | busy_m[m])]
    return taken


def optimal(track: IntArray, measurement: IntArray, cost: FloatArray) -> BoolArray:
    """1:1 with as many pairs as possible and, of these assignments, the least sum of costs."""
    taken = np.zeros(len(cost), bool)
    groups = connected_groups(track, measurement)
    order = np.argsort(groups.group, kind="stable")
    ends = np.cumsum(np.bincount(groups.group, minlength=len(groups)))
    for g, (begin, end) in enumerate(zip(ends - np.diff(ends, prepend=0), ends, strict=True)):
        mine = order[begin:end]
        if len(mine) == 1:
            taken[mine] = True
            continue
        shape = int(groups.n_tracks[g]), int(groups.n_measurements[g])
        above = cost[mine] - cost[mine].min()
        forbidden = (above.max() + 1.0) * (min(shape) + 1)  # more than any number of pairs that are possible
        table, pair = np.full(shape, forbidden), np.full(shape, -1, np.int64)
        place = groups.track[mine], groups.measurement[mine]
        table[place], pair[place] = above, mine
        chosen = pair[linear_sum_assignment(table)]
        taken[chosen[chosen >= 0]] = True
    return taken


def nearest_track(track: IntArray, measurement: IntArray, cost: FloatArray) -> BoolArray:
    """1:N: every measurement goes to its nearest track, a track may get many (local nearest neighbour)."""
    order = np.lexsort((track, cost))
    taken = np.zeros(len(cost), bool)
    taken[order[_is_first(measurement[order], _size(measurement))]] = True
    return taken


def best_per_track(track: IntArray, cost: FloatArray, most: int) -> BoolArray:
    """M:N with a limit: the `most` cheapest pairs of each track."""
    order = np.lexsort((cost, track))
    rank = np.arange(len(order)) - np.searchsorted(track[order], track[order])
    taken = np.zeros(len(cost), bool)
    taken[order[rank < most]] = True
    return taken


def _size(index: IntArray) -> int:
    return int(index.max(initial=-1)) + 1


def _is_first(index: IntArray, size: int) -> BoolArray:
    """Whether each place (k,) is the first with its index."""
    at = np.full(size, len(index), np.int64)
    np.minimum.at(at, index, np.arange(len(index)))
    return np.asarray(at[index] == np.arange(len(index)))
