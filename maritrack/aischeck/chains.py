"""Pieces of tracks that are one: where one ends, another begins soon after where the first would be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from maritrack.aischeck.match import square
from maritrack.retrospect import History
from maritrack.types import FloatArray, IntArray

MOST_GAP_S = 30.0  # between the end of one piece and the begin of the next
GATE = 18.5  # of position and velocity, 99.9 %
TURN_MPS2 = 0.2  # standard deviation of accelerations in between


def linked(history: History) -> tuple[History, dict[int, tuple[int, ...]]]:
    """The history with each chain of pieces under the id of its first, and which ids each is made of.

    Rows are those while tracks are confirmed, ordered by id, then scan; ends are at the last hit.
    """
    tracks = history.tracks
    ids = np.unique(tracks.id)
    hit = np.flatnonzero(tracks.cluster >= 0)
    if len(hit) == 0:
        return history, {int(i): (int(i),) for i in ids.tolist()}
    known, first = np.unique(tracks.id[hit], return_index=True)
    last = np.append(first[1:], len(hit)) - 1
    begin, end = hit[first], hit[last]
    next_of = _links(history, begin, end)
    chain: dict[int, int] = {}
    for a in np.argsort(tracks.t_ns[begin], kind="stable").tolist():
        chain.setdefault(int(known[a]), int(known[a]))
        if next_of[a] >= 0:
            chain[int(known[next_of[a]])] = chain[int(known[a])]
    members: dict[int, tuple[int, ...]] = {}
    for i in ids.tolist():
        members[chain.get(i, i)] = (*members.get(chain.get(i, i), ()), i)
    label = np.array([chain.get(i, i) for i in tracks.id.tolist()], np.int64)
    order = np.lexsort((tracks.id, history.scan, label))
    of_chain = history.rows(order)
    of_chain = replace(of_chain, tracks=replace(of_chain.tracks, id=label[order]))
    again = (np.diff(of_chain.tracks.id, prepend=-1) == 0) & (np.diff(of_chain.scan, prepend=-1) == 0)
    return of_chain.rows(np.flatnonzero(~again)), members


def _links(history: History, begin: IntArray, end: IntArray) -> IntArray:
    """For each piece (n,) the one that goes on with it, -1 = none."""
    tracks, n = history.tracks, len(begin)
    gap_s = (tracks.t_ns[begin][None, :] - tracks.t_ns[end][:, None]) * 1e-9
    a, b = np.nonzero((gap_s > 0) & (gap_s <= MOST_GAP_S))
    cost = np.full(len(a), np.inf)
    if len(a):
        cost = _cost(history, end[a], begin[b], np.asarray(gap_s[a, b], float))
    near = cost < GATE
    a, b, cost = a[near], b[near], cost[near]
    next_of = np.full(n, -1)
    if len(a):
        rows, i = np.unique(a, return_inverse=True)
        columns, j = np.unique(b, return_inverse=True)
        table = np.full((len(rows), len(columns)), GATE)
        table[i, j] = cost
        for r, c in zip(*linear_sum_assignment(table), strict=True):
            if table[r, c] < GATE:
                next_of[rows[r]] = columns[c]
    return next_of


def _cost(history: History, end: IntArray, begin: IntArray, gap_s: FloatArray) -> FloatArray:
    """Normalised squares (n,) of position and velocity between what the end predicts and the begin."""
    tracks = history.tracks
    ahead = tracks.position_m[end] + tracks.velocity_mps[end] * gap_s[:, None]
    P, Q = tracks.cov[end], tracks.cov[begin]
    grown = P[:, :2, :2] + gap_s[:, None, None] ** 2 * P[:, 2:, 2:] + Q[:, :2, :2]
    grown = grown + (TURN_MPS2 * gap_s**2 / 2)[:, None, None] ** 2 * np.eye(2)
    turned = P[:, 2:, 2:] + Q[:, 2:, 2:] + (TURN_MPS2 * gap_s)[:, None, None] ** 2 * np.eye(2)
    place = square(tracks.position_m[begin] - ahead, grown)
    return np.asarray(place + square(tracks.velocity_mps[begin] - tracks.velocity_mps[end], turned))
