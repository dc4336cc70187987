"""Headers of one sensor's spokes as a table, and what a spoke and its neighbours tell.

Turns of the antenna are counted in integers, modulo 65536; days of the clock modulo 86400 * 128.
Each function takes the rows of a stretch and the state that the stretch before left, so that the
result does not depend on where a recording is cut into stretches.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maritrack.io.cat240.radials import Radials
from maritrack.io.datagrams import NO_TIME
from maritrack.io.times import DAY_NS
from maritrack.types import BoolArray, IntArray

TURN = 65_536  # azimuth units of a turn
TICKS_PER_S = 128
DAY = 86_400 * TICKS_PER_S
TICK_NS = 1_000_000_000 // TICKS_PER_S
SILENCE = 10 * TICKS_PER_S  # clocks that differ by more do not belong together
NO_TICK = int(np.iinfo(np.int64).min)  # a spoke without a time
STRAY = 2_048  # 11 deg: an azimuth that is further from both neighbours, while they agree, is wrong
BACK = 8_192  # 45 deg: a larger step back is a step forward over a blanked sector
HISTORY = 64  # steps that say which way the antenna turns

Spokes = NDArray[np.void]
SPOKE = np.dtype(
    [
        ("seq", "i8"),  # number of the record in the input
        ("offset", "i8"),
        ("start_az", "i8"),
        ("end_az", "i8"),
        ("start_rg", "i8"),
        ("cell_dur", "i8"),
        ("femto", "?"),
        ("bits", "i8"),
        ("cell_m", "f8"),
        ("n_cells", "i8"),
        ("tod", "i8"),  # where none was sent: of the receive time
        ("came_ns", "i8"),  # receive time since midnight, where it stands for the time of day; else -1
        ("lost", "i8"),  # records that are missing before it
        ("turn", "i8"),  # azimuth that does not wrap
        ("tick", "i8"),  # time of day that does not wrap, 1/128 s
        ("stray", "?"),  # azimuth fits neither neighbour
        ("odd", "?"),  # range scale of its own
        ("set_back", "i8"),  # ticks by which the clock went back here
    ]
)
_COPIED = ("offset", "start_az", "end_az", "start_rg", "cell_dur", "femto", "bits", "cell_m", "n_cells", "tod")
_SETTING = ("cell_dur", "start_rg", "bits", "femto")


def spoke_table(radials: Radials, rows: IntArray | None, *, before: Spokes, seq: IntArray, lost: IntArray) -> Spokes:
    """The rows `before`, then the headers of these rows (None = all) of the radials."""
    whole = np.zeros(len(before) + len(seq), dtype=SPOKE)
    whole[: len(before)] = before
    table = whole[len(before) :]
    for name in _COPIED:
        column = getattr(radials, name)
        table[name] = column if rows is None else column[rows]
    t_ns = radials.t_ns if rows is None else radials.t_ns[rows]
    came = (table["tod"] < 0) & (t_ns != NO_TIME)
    table["came_ns"] = np.where(came, t_ns % DAY_NS, -1)
    table["tod"] = np.where(came, table["came_ns"] // TICK_NS, table["tod"])
    table["seq"], table["lost"] = seq, lost
    return whole


def near_azimuth(a: Spokes, b: Spokes) -> BoolArray:
    """Whether two azimuths are within the reach of a normal step."""
    return np.asarray(np.abs(_short(b["start_az"] - a["start_az"])) <= STRAY)


def same_setting(a: Spokes, b: Spokes) -> BoolArray:
    """Whether the cells of two spokes lie on the same grid."""
    same = np.ones(len(a), dtype=bool)
    for name in _SETTING:
        same &= a[name] == b[name]
    return same


def near_clock(a: Spokes, b: Spokes) -> BoolArray:
    """Whether two times of day are within a silence of each other; True where one is unknown."""
    apart = np.abs((b["tod"] - a["tod"] + DAY // 2) % DAY - DAY // 2) > SILENCE
    return np.asarray(~(apart & (a["tod"] >= 0) & (b["tod"] >= 0)))


@dataclass(slots=True)
class Outliers:
    """Finds single spokes that agree with neither neighbour while the neighbours agree.

    Where every second spoke is like that, one of the two kinds counts as right.
    """

    agree: Callable[[Spokes, Spokes], BoolArray]
    was: bool = False  # the row before this stretch was one

    def find(self, before: Spokes, rows: Spokes, after: Spokes) -> tuple[BoolArray, bool]:
        """Which rows are outliers, given the row before and the row after (0 or 1); and whether all rows agree."""
        parts = [self.agree(before, rows[:1])] if len(before) else []
        parts.append(self.agree(rows[:-1], rows[1:]))
        parts += [self.agree(rows[-1:], after)] if len(after) else []
        step_ok = np.concatenate(parts)
        if step_ok.all():
            self.was = False
            return np.zeros(len(rows), dtype=bool), True
        inner = slice(len(before), len(before) + len(rows))
        chain = np.concatenate([before, rows, after])
        found = _every_other(self._candidates(chain, step_ok, first=len(before) == 0)[inner], self.was)
        self.was = bool(found[-1])
        return found, False

    def _candidates(self, chain: Spokes, step_ok: BoolArray, *, first: bool) -> BoolArray:
        candidate = np.zeros(len(chain), dtype=bool)
        candidate[1:-1] = ~step_ok[:-1] & ~step_ok[1:] & self.agree(chain[:-2], chain[2:])
        candidate[0] = first and not step_ok[0]  # the first spoke of all has only one neighbour
        return candidate


def _every_other(candidate: BoolArray, was: bool) -> BoolArray:
    """Of each run of candidates the first, the third, ...; a run may have begun before."""
    row = np.arange(len(candidate))
    last_good = np.maximum.accumulate(np.where(candidate, -1, row))
    place = row - last_good - 1 + (was & (last_good < 0))
    return np.asarray(candidate & (place % 2 == 0))


@dataclass(slots=True)
class Winding:
    """The azimuth that does not wrap: clockwise from that of the first good spoke of the recording."""

    azimuth: int | None = None  # of the last good spoke
    turn: int = 0
    signs: NDArray[Any] = field(default_factory=lambda: np.zeros(HISTORY, dtype=np.int64))

    def unwrap(self, start_az: IntArray, stray: BoolArray) -> IntArray:
        """Unwrapped azimuths (n,). A stray spoke is where the good one before it was."""
        good = ~stray
        azimuth = start_az if good.all() else start_az[good]
        if len(azimuth) == 0:
            return np.full(len(start_az), self.turn)
        if self.azimuth is None:
            self.azimuth = int(azimuth[0])
        step = _short(np.diff(azimuth, prepend=self.azimuth))
        turn = self.turn + np.cumsum(self._forward(step))
        before = self.turn
        self.azimuth, self.turn = int(azimuth[-1]), int(turn[-1])
        if len(azimuth) == len(start_az):
            return np.asarray(turn)
        return np.concatenate([[before], turn])[np.cumsum(good)]

    def _forward(self, step: IntArray) -> IntArray:
        """Steps, those that lead far back turned into steps forward over a blanked sector."""
        small = np.abs(step) <= BACK
        signs = np.concatenate([self.signs, np.where(small, np.sign(step), 0)])
        self.signs = signs[-HISTORY:]
        if small.all():
            return step
        total = np.concatenate([[0], np.cumsum(signs)])
        lead = total[HISTORY:-1] - total[: -HISTORY - 1]  # of the steps before this one
        way = np.where(lead < 0, -1, 1)
        return np.asarray(np.where(step * way < -BACK, step + TURN * way, step))


@dataclass(slots=True)
class DayCount:
    """The time of day that goes on after midnight. A sensor that joins others is on their day."""

    others: list[DayCount] = field(default_factory=list)
    tod: int | None = None  # last good one, as sent
    tick: int = NO_TICK

    def unwrap(self, tod: IntArray, bad: BoolArray) -> tuple[IntArray, IntArray, IntArray]:
        """Ticks (n,), NO_TICK where unknown; ticks the clock was set back by; silence before each spoke.

        A step below -12 h is midnight. Small steps back stay (records out of order). A clock that is
        set back by more than the silence goes on from where it was.
        """
        tick, set_back, silence = np.full(len(tod), NO_TICK), np.zeros(len(tod), np.int64), np.zeros(len(tod), np.int64)
        good = (tod >= 0) & ~bad
        known = tod if good.all() else tod[good]
        if len(known) == 0:
            return tick, set_back, silence
        if self.tod is None:
            self.tod = int(known[0])
            self.tick = self.tod + DAY * self._days_gone(self.tod)
        step = np.diff(known, prepend=self.tod)
        step += np.where(step < -DAY // 2, DAY, 0) - np.where(step > DAY - SILENCE, DAY, 0)
        back = np.where(step < -SILENCE, -step, 0)
        step += back
        tick[good] = self.tick + np.cumsum(step)
        set_back[good], silence[good] = back, step
        self.tod, self.tick = int(known[-1]), int(self.tick + step.sum())
        return tick, set_back, silence

    def _days_gone(self, tod: int) -> int:
        ticks = [other.tick for other in self.others if other.tick != NO_TICK]
        return (max(ticks) - tod + DAY // 2) // DAY if ticks else 0


def _short(step: IntArray) -> IntArray:
    """The step in [-half a turn, half a turn)."""
    return np.asarray((step + TURN // 2) % TURN - TURN // 2, dtype=np.int64)


def lost_records(idx: IntArray, previous: int | None) -> IntArray:
    """Records that are missing before each, by MSG_INDEX (-1 = absent); 0 after a restart or out of order."""
    before = np.concatenate([[-1 if previous is None else previous], idx[:-1]])
    missing = (idx - before - 1) % (1 << 32)
    return np.where((missing > 1 << 31) | (idx < 0) | (before < 0), 0, missing)
