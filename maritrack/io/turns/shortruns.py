"""Turns that are cut off after a few spokes, again and again: gone over many at a time."""

from __future__ import annotations

import numpy as np

from maritrack.io.turns.spokes import NO_TICK, TICKS_PER_S
from maritrack.io.turns.turn import LEAST_ADVANCE
from maritrack.types import IntArray

MAX_TICKS = 120 * TICKS_PER_S  # what takes longer is no turn
MANY_RUNS = 8  # fewer are not worth it


class ShortRuns:
    """Which stretches of spokes between two cuts are too short for a scan, found for all of them at once."""

    def __init__(self, turn: IntArray, tick: IntArray, changes: IntArray, silences: IntArray) -> None:
        self._bounds = bounds = np.unique(np.concatenate([[0], changes, silences]))
        self._changes = changes
        if len(bounds) <= MANY_RUNS:
            return
        advance = np.maximum.reduceat(turn, bounds) - np.minimum.reduceat(turn, bounds)
        known = np.where(tick == NO_TICK, tick.max(), tick)
        took = np.maximum.reduceat(known, bounds) - np.minimum.reduceat(known, bounds)
        self._long = (took > MAX_TICKS)[:-1]  # the last goes on
        self._wide, self._spokes = (advance >= LEAST_ADVANCE)[:-1], np.diff(bounds)

    def end(self, start: int, least: int) -> int:
        """Where many of them in a row that begin at `start` end; scans have at least so many spokes."""
        i = int(np.searchsorted(self._bounds, start))
        if len(self._bounds) - 1 - i < MANY_RUNS or self._bounds[i] != start:
            return start
        worth = self._long[i:] | (self._wide[i:] & (self._spokes[i:] >= least))
        n = int(np.argmax(worth)) if worth.any() else len(worth)
        return int(self._bounds[i + n]) if n >= MANY_RUNS else start

    def within(self, start: int, end: int) -> tuple[int, int]:
        """Changes and other cuts after `start` up to `end`."""
        cuts = np.searchsorted(self._bounds, end) - np.searchsorted(self._bounds, start)
        changes = np.searchsorted(self._changes, [start, end], side="right")
        return int(changes[1] - changes[0]), int(cuts - (changes[1] - changes[0]))
