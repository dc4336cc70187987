"""When each turn of an antenna began, finer than the clock's 1/128 s, and from that the period of rotation."""

from __future__ import annotations

from array import array
from math import nan

import numpy as np

from maritrack.io.times import DAY_NS
from maritrack.io.turns.spokes import NO_TICK, TICK_NS, TURN
from maritrack.types import FloatArray, IntArray


class TurnClock:
    """Times of the first spokes of turns. Spokes that share a tick are spread evenly up to the next tick."""

    def __init__(self) -> None:
        self._spoke = 0  # number of the next one
        self._runs = np.zeros((0, 2), dtype=np.int64)  # first spoke and tick of the last runs of equal ticks
        self._begun = False  # the first of them is not the first of all
        self._waiting: list[tuple[int, int]] = []  # turns whose time is not known yet, and their first spokes
        self._begin_ns = array("d")  # nan = unknown
        self._azimuth = array("q")  # unwrapped
        self._joins = array("b")  # a full turn lies between this and the one before

    def add(self, tick: IntArray, begins: list[tuple[int, int, bool]], came_ns: IntArray | None) -> None:
        """The next spokes (n,) by their ticks, and where turns begin: row, azimuth, whether a full one ended there."""
        for row, azimuth, joins in begins:
            received = came_ns is not None and came_ns[row] >= 0
            if not received:
                self._waiting.append((len(self._azimuth), self._spoke + row))
            at = slice(row, row + 1)
            self._begin_ns.append(
                float(exact_ns(tick[at], came_ns[at])[0]) if came_ns is not None and received else nan
            )
            self._azimuth.append(azimuth)
            self._joins.append(joins)
        self._add_runs(tick)
        self._spoke += len(tick)

    def _add_runs(self, tick: IntArray) -> None:
        """Go on to the last run of equal ticks; turns that begin before it get their times."""
        rows = np.arange(len(tick)) if tick.min() != NO_TICK else np.flatnonzero(tick != NO_TICK)
        if len(rows) == 0:
            return
        known = np.maximum.accumulate(tick[rows])
        before = int(self._runs[-1, 1]) if len(self._runs) else int(known[0]) - 1
        starts = np.flatnonzero(np.diff(np.maximum(known, before), prepend=before))
        runs = np.concatenate([self._runs, np.stack([self._spoke + rows[starts], known[starts]], axis=1)])
        self._runs = runs
        if len(runs) < 3:
            return
        began, spokes, ticks = runs[:-1, 1].astype(np.float64), np.diff(runs[:, 0]), np.diff(runs[:, 1])
        spacing = np.minimum(ticks, np.concatenate([ticks[:1], ticks[:-1]])) / spokes  # a pause isn't spread
        if not self._begun:  # the recording begins in the middle of the first run
            spacing[0] = ticks[1] / spokes[1]
            began[0] = runs[1, 1] - spokes[0] * spacing[0]
        waiting = np.array(self._waiting, dtype=np.int64).reshape(-1, 2)
        ready = waiting[waiting[:, 1] < runs[-1, 0]]
        run = np.maximum(np.searchsorted(runs[:, 0], ready[:, 1], side="right") - 1, 0)
        begin_ns = (began[run] + (ready[:, 1] - runs[run, 0]) * spacing[run]) * TICK_NS
        for turn, time_ns in zip(ready[:, 0].tolist(), begin_ns.tolist(), strict=True):
            self._begin_ns[turn] = time_ns
        self._waiting = self._waiting[len(ready) :]
        self._runs, self._begun = runs[-2:], True

    def periods_s(self) -> FloatArray:
        """Seconds of each full turn (n,) whose beginning and end have a time; no spokes follow."""
        runs = self._runs
        spacing = (runs[-1, 1] - runs[-2, 1]) / (runs[-1, 0] - runs[-2, 0]) if len(runs) > 1 else 0.0
        begin_ns = np.array(self._begin_ns)
        for turn, spoke in self._waiting:
            if len(runs) and spoke >= runs[-1, 0]:
                begin_ns[turn] = (runs[-1, 1] + (spoke - runs[-1, 0]) * spacing) * TICK_NS
        turned = np.abs(np.diff(np.array(self._azimuth, dtype=np.int64)))
        joins = np.array(self._joins, dtype=np.bool_)[1:]
        period_s = np.diff(begin_ns)[joins] * 1e-9 * TURN / np.maximum(turned, 1)[joins]
        return np.asarray(period_s[np.isfinite(period_s) & (period_s > 0)])


def middle(values: IntArray | FloatArray) -> float:
    """The median of values, at least one. numpy's own loads its masked arrays: a fiftieth of a second."""
    ordered, n = np.sort(values), len(values)
    return float(ordered[(n - 1) // 2] + ordered[n // 2]) / 2


def exact_ns(tick: IntArray, came_ns: IntArray | None) -> IntArray:
    """Nanoseconds since midnight of the first day, of the receive time where the ticks are made of it."""
    t_ns = tick * TICK_NS
    if came_ns is None:
        return t_ns
    return np.where(came_ns < 0, t_ns, came_ns + (t_ns - came_ns + DAY_NS // 2) // DAY_NS * DAY_NS)
