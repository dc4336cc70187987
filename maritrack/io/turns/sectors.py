"""Which sectors an antenna didn't show, turn by turn."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from maritrack.io.turns.spokes import TURN
from maritrack.io.turns.turnclock import middle
from maritrack.types import BoolArray, IntArray

BINS = 720  # half degrees
SHRINK = TURN // 20  # a spoke doesn't count for a bin of which it covers less than this (in 1/65536 of a bin)
MOST_TURNS = 128  # that are looked at together
_WIDTH = 2 * BINS + 1  # of a row in which spokes go on beyond North


@dataclass(slots=True)
class Sectors:
    """Counts of the full turns in which each half degree was empty."""

    turns: int = 0
    empty: IntArray = field(default_factory=lambda: np.zeros(BINS, dtype=np.int64))  # (720,)

    def add(self, turns: list[tuple[IntArray, IntArray, IntArray]]) -> None:
        """Full turns: START azimuths, END azimuths and unwrapped azimuths of their spokes."""
        for at in range(0, len(turns), MOST_TURNS):
            some = turns[at : at + MOST_TURNS]
            number = np.repeat(np.arange(len(some)) * _WIDTH, [len(start_az) for start_az, _, _ in some])
            first, last = _bins(some)
            # Spokes that cover a bin: +1 where one begins, -1 behind its end, added up.
            size = len(some) * _WIDTH
            change = np.bincount(number + first, minlength=size) - np.bincount(number + last + 1, minlength=size)
            covered = np.cumsum(change.reshape(-1, _WIDTH)[:, :-1], axis=1).reshape(-1, 2, BINS).any(axis=1)
            self.turns += len(some)
            self.empty += len(some) - covered.sum(axis=0)

    def missing(self, share: float) -> list[tuple[float, float, float]]:
        """Sectors that are empty in more than this share of the turns: from, to (degrees), and in how many at least."""
        if self.turns == 0:
            return []
        there: BoolArray = self.empty > share * self.turns
        if there.all():
            return [(0.0, 360.0, float(self.empty.min()) / self.turns)]
        shift = int(np.argmin(there))  # begin outside of a sector, so that one over North stays one
        edges = np.flatnonzero(np.diff(np.concatenate([[0], np.roll(there, -shift), [0]]))) + shift
        return [
            (lo / 2 % 360.0, (hi - 1) / 2 % 360.0 + 0.5, float(self.empty[np.arange(lo, hi) % BINS].min()) / self.turns)
            for lo, hi in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
        ]


def _bins(turns: list[tuple[IntArray, IntArray, IntArray]]) -> tuple[IntArray, IntArray]:
    """First and last half degree (n,) that the spokes of turns cover, going on beyond North.

    A spoke is at least as wide as the usual step in its turn, and reaches half of that to either side where only its
    azimuth is told.
    """
    begin, end = (np.concatenate([turn[i] for turn in turns]) for i in (0, 1))
    counts = [len(start_az) for start_az, _, _ in turns]
    width = (end - begin) & TURN - 1
    told = (width > 0) & (width <= TURN // 2)
    narrow = np.minimum.reduceat(np.where(told, width, 0), np.cumsum([0, *counts[:-1]])) * np.array(counts) < TURN
    if narrow.any():
        steps = [_usual_step(turn) if few else 0 for (_, _, turn), few in zip(turns, narrow.tolist(), strict=True)]
        step = np.repeat(np.array(steps, dtype=np.int64), counts)
        begin = np.where(told, begin, begin - step // 2 & TURN - 1)
        width = np.maximum(np.where(told, width, 0), step)
    inside = np.minimum(SHRINK, width * (BINS // 4))
    first = begin * BINS + inside >> 16
    return first, np.maximum((begin + width) * BINS - inside - 1 >> 16, first)


def _usual_step(turn: IntArray) -> int:
    """The usual step between unwrapped azimuths, 0 where there is none."""
    step = np.abs(np.diff(turn))
    step = step[step > 0]
    return min(int(middle(step)), TURN // 4) if len(step) else 0
