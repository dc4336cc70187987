"""Tracks under way that no known ship explains."""

from __future__ import annotations

from typing import Any

import numpy as np

from maritrack.metrics.unexplained import moving_tracks
from maritrack.types import COASTED, CONFIRMED, STATIONARY, TENTATIVE, Tracks, Truth


def tracks(rows: list[tuple[int, float, int, bool]]) -> Tracks:
    """Tracks of (id, east, status, moving) on the parallel north = 0, at time 0."""
    n = len(rows)
    name, east, status, moving = (np.array(column) for column in zip(*rows, strict=True)) if rows else [np.zeros(0)] * 4
    zero: Any = np.zeros((n, 2))
    at = np.stack([east.astype(float), np.zeros(n)], axis=-1)
    return Tracks(
        name.astype(np.int64), np.zeros(n, np.int64), at, zero, np.zeros((n, 4, 4)), np.zeros((n, 2, 2)), np.ones(n),
        status.astype(np.int64), moving.astype(bool), np.zeros(n, np.int64),
    )  # fmt: skip


def truth(*east_m: float) -> Truth:
    n = len(east_m)
    at, unknown = np.stack([np.array(east_m), np.zeros(n)], axis=-1), np.full(n, np.nan)
    return Truth(tuple(map(str, range(n))), ("",) * n, 0, at, np.zeros((n, 2)), unknown, unknown, unknown)


def test_a_ship_near_in_half_of_the_scans_explains_a_track() -> None:
    scans = [
        (tracks([(1, 0.0, CONFIRMED, True), (2, 5000.0, CONFIRMED, True)]), truth(240.0)),
        (tracks([(1, 0.0, COASTED, True), (2, 5000.0, CONFIRMED, True)]), truth(260.0)),
        (tracks([(2, 5100.0, CONFIRMED, True)]), None),
        (tracks([(2, 5200.0, CONFIRMED, True)]), truth(5200.0, 0.0)),
    ]
    found = moving_tracks(scans)
    assert [(t.id, len(t.position_m), t.near, t.explained()) for t in found] == [(1, 2, 1, True), (2, 4, 1, False)]
    assert found[1].position_m[:, 0].tolist() == [5000.0, 5000.0, 5100.0, 5200.0]
    assert [t.near for t in moving_tracks(scans, near_m=100.0)] == [0, 1]


def test_only_scans_in_which_a_track_is_confirmed_and_moving_count() -> None:
    scans = [
        (tracks([(1, 0.0, TENTATIVE, True), (2, 0.0, CONFIRMED, False)]), truth(0.0)),
        (tracks([(1, 9e3, CONFIRMED, True), (2, 0.0, STATIONARY, False)]), truth(0.0)),
        (tracks([]), truth()),
    ]
    assert [(t.id, t.near, len(t.position_m)) for t in moving_tracks(scans)] == [(1, 0, 1)]
    assert moving_tracks([]) == []
