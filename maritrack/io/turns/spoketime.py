"""Times of spokes from a clock of 1/128 s, or from the turning of the antenna where there is none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maritrack.io.times import DAY_NS
from maritrack.io.turns.spokes import NO_TICK, TICK_NS, TURN
from maritrack.types import FloatArray, IntArray

ASSUMED_PERIOD_NS = 2_500_000_000.0  # 24 turns a minute, the usual speed of ships' radars


@dataclass(slots=True)
class SpokeClock:
    """Times that never decrease, turn after turn.

    Spokes that share a tick are spread evenly up to the next tick. A turn's last run of equal ticks
    is spread as the runs before it were, because the next tick is not known when the turn ends.
    """

    period_ns: float = ASSUMED_PERIOD_NS  # of a turn
    assumed: bool = True  # the period was never measured
    guessed: bool = False  # times were made with an assumed period
    last_ns: int | None = None
    last_turn: int = 0
    run_tick: int = NO_TICK  # tick of the last run
    run_length: int = 0  # spokes of it in the turns before
    spacing: float = 0.0  # ticks from spoke to spoke

    def times(self, tick: IntArray, turn: IntArray, came_ns: IntArray) -> IntArray:
        """Nanoseconds since midnight of the first day (n,) of the spokes of a turn, n > 0.

        `came_ns` are receive times since midnight where the ticks are made of them, else -1.
        """
        known = np.flatnonzero(tick != NO_TICK)
        t_ns = self._by_clock(tick, turn, known) if len(known) else self._by_azimuth(turn)
        if len(known) == len(tick) and (came_ns >= 0).all():
            t_ns = came_ns + (tick * TICK_NS - came_ns + DAY_NS // 2) // DAY_NS * DAY_NS
        if self.last_ns is not None:
            t_ns = np.maximum(t_ns, self.last_ns)
        t_ns = np.maximum.accumulate(t_ns)
        self.last_ns, self.last_turn = int(t_ns[-1]), int(turn[-1])
        return np.asarray(t_ns)

    def _by_clock(self, tick: IntArray, turn: IntArray, known: IntArray) -> IntArray:
        rows, ticks = self._run_starts(np.maximum.accumulate(tick[known]), known)
        spacing = np.diff(ticks) / np.diff(rows)
        typical = float(np.median(spacing)) if len(spacing) else self._spacing_by_azimuth(turn)
        spread = np.append(np.minimum(spacing, 2 * typical), typical)  # a pause is not spread over spokes
        place = np.arange(len(tick))
        run = np.maximum(np.searchsorted(rows, place, side="right") - 1, 0)
        t_ns = np.rint((ticks[run] + (place - rows[run]) * spread[run]) * TICK_NS).astype(np.int64)
        self.run_tick, self.run_length, self.spacing = int(ticks[-1]), len(tick) - int(rows[-1]), typical
        if len(spacing):
            self._measure(t_ns, turn)
        return np.asarray(t_ns)

    def _run_starts(self, ticks: IntArray, known: IntArray) -> tuple[IntArray, IntArray]:
        """Row and tick of each run of equal ticks; the first may have begun in the turn before."""
        ticks = np.maximum(ticks, self.run_tick)
        starts = np.append(True, np.diff(ticks) > 0)
        rows, values = known[starts], ticks[starts]
        if values[0] == self.run_tick:
            rows[0] = -self.run_length
        return rows, values

    def _spacing_by_azimuth(self, turn: IntArray) -> float:
        """Ticks from spoke to spoke where the clock stood still for the whole turn."""
        if self.spacing > 0.0:
            return self.spacing
        self.guessed |= self.assumed and len(turn) > 1
        steps = max(len(turn) - 1, 1)
        return abs(int(turn[-1]) - int(turn[0])) / TURN / steps * self.period_ns / TICK_NS

    def _measure(self, t_ns: IntArray, turn: IntArray) -> None:
        turned = abs(int(turn[-1]) - int(turn[0]))
        took_ns = int(t_ns[-1]) - int(t_ns[0])
        if turned >= TURN // 2 and took_ns > 0:
            self.period_ns, self.assumed = took_ns * TURN / turned, False

    def _by_azimuth(self, turn: IntArray) -> IntArray:
        self.guessed |= self.assumed
        base_ns, base_turn = (0, int(turn[0])) if self.last_ns is None else (self.last_ns, self.last_turn)
        way = -1 if turn[-1] < base_turn else 1
        progress: FloatArray = np.maximum(way * (turn - base_turn), 0) / TURN
        self.run_length += len(turn)
        return np.asarray(base_ns + np.rint(progress * self.period_ns).astype(np.int64))
