"""Which tracks of a radar are of one ship: pieces that go on from one another, and two ends of one hull.

A track breaks where a ship is hidden, and a long hull may have one at its bow and one at its stern. To a fit each
would be a ship of its own, which tells of the same echo twice as surely as it does.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from maritrack.retrospect import History
from maritrack.types import BoolArray, FloatArray, IntArray, Tracks

GAP_S, APART_M = 180.0, 100.0  # between the end of a piece and the start of the next; where they meet half-way
OVERLAP_S, HULL_M = 15.0, 300.0  # of two tracks at two ends of a hull, and between them
UNLIKE = 0.25  # difference of their velocities, of the greater speed
COURSE_S = 120.0  # way by which a velocity is told: at its ends that of a track is of how a hull begins to show


def whole_ships(history: History) -> History:
    """The rows of one track at a time of each ship, under the id of its first piece, ordered by id and time."""
    if len(history) == 0:
        return history
    alone = history.rows(~_doubled(history))
    tracks = alone.tracks
    ids, first, group = np.unique(tracks.id, return_index=True, return_inverse=True)
    ship = ids[_first_piece(tracks, first)][group]
    return replace(alone, tracks=replace(tracks, id=ship)).rows(np.lexsort((tracks.t_ns, ship)))


def _doubled(history: History) -> BoolArray:
    """Rows (m,) of tracks that go along with a longer one, or before or behind it, as the other end of its hull."""
    tracks, scan = history.tracks, history.scan
    ids, first, n = np.unique(tracks.id, return_index=True, return_counts=True)
    gap_s, apart_m, alike = _meetings(tracks, first)
    ends = alike & (gap_s > -OVERLAP_S) & (gap_s <= GAP_S) & (apart_m <= HULL_M)
    ends &= (gap_s <= 0.0) | (apart_m > APART_M)
    ends |= ends.T
    drop = np.zeros(len(ids), bool)
    order = np.lexsort((ids, -n)).tolist()  # the longest first
    for k, b in enumerate(order):
        for a in [a for a in order[:k] if not drop[a]]:
            _, i, j = np.intersect1d(
                scan[first[a] : first[a] + n[a]], scan[first[b] : first[b] + n[b]], return_indices=True
            )
            i, j = first[a] + i, first[b] + j
            near = np.hypot(*(tracks.position_m[i] - tracks.position_m[j]).T) <= HULL_M
            along = int((near & _alike(tracks.velocity_mps[i], tracks.velocity_mps[j])).sum())
            drop[b] |= ends[a, b] or 2 * along > n[b]
    return np.asarray(np.repeat(drop, n))


def _first_piece(tracks: Tracks, first: IntArray) -> IntArray:
    """Number of the first piece (g,) of the ship of each track; their rows begin at `first` (g,)."""
    gap_s, apart_m, alike = _meetings(tracks, first)
    a_of, b_of = np.nonzero(alike & (gap_s > 0.0) & (gap_s <= GAP_S) & (apart_m <= APART_M))
    before, goes_on = np.full(len(first), -1), np.zeros(len(first), bool)
    for k in np.lexsort((b_of, a_of, apart_m[a_of, b_of])).tolist():  # nearest first
        if not goes_on[a_of[k]] and before[b_of[k]] < 0:
            goes_on[a_of[k]], before[b_of[k]] = True, a_of[k]
    owner = np.arange(len(first))
    for b in np.argsort(tracks.t_ns[first], kind="stable").tolist():
        owner[b] = owner[before[b]] if before[b] >= 0 else b
    return owner


def _meetings(tracks: Tracks, first: IntArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """From the end of track a to the start of b (g, g): seconds, metres where both go on half-way, and if alike."""
    last = np.append(first[1:], len(tracks.id)) - 1
    t_s = (tracks.t_ns - tracks.t_ns.min()) * 1e-9
    n = np.maximum(last - first, 1)
    turn_s = np.maximum((t_s[last] - t_s[first]) / n, 1e-9)
    steps = np.minimum(np.ceil(COURSE_S / turn_s).astype(np.int64), last - first)

    def made_good(a: IntArray, b: IntArray) -> FloatArray:
        way_m = tracks.position_m[b] - tracks.position_m[a]
        return np.asarray(way_m / np.maximum(t_s[b] - t_s[a], 1e-9)[:, None])

    v_end, v_start = made_good(last - steps, last)[:, None], made_good(first, first + steps)[None]
    gap_s = t_s[first] - t_s[last][:, None]
    half_s = np.clip(gap_s, -OVERLAP_S, GAP_S)[..., None] / 2
    apart = tracks.position_m[last][:, None] + half_s * v_end - (tracks.position_m[first][None] - half_s * v_start)
    return gap_s, np.hypot(apart[..., 0], apart[..., 1]), _alike(v_end, v_start)


def _alike(a_mps: FloatArray, b_mps: FloatArray) -> BoolArray:
    """Whether velocities (..., 2) are the same, within what those of a hull's two ends differ."""
    speed = np.maximum(np.hypot(a_mps[..., 0], a_mps[..., 1]), np.hypot(b_mps[..., 0], b_mps[..., 1]))
    apart = a_mps - b_mps
    return np.asarray(np.hypot(apart[..., 0], apart[..., 1]) <= UNLIKE * speed)
