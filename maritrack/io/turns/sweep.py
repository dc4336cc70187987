"""The spokes of one antenna judged from their headers alone, as `stream` judges them, thousands at a time.

Most stretches of a recording are calm: every spoke a small step from the one before, on one range scale, with a clock
that goes on. The others are judged spoke by spoke.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from maritrack.io.cat240.radials import Radials
from maritrack.io.datagrams import NO_TIME
from maritrack.io.times import DAY_NS
from maritrack.io.turns.spokes import (
    DAY,
    HISTORY,
    NO_TICK,
    SILENCE,
    SPOKE,
    STRAY,
    TICK_NS,
    TURN,
    DayCount,
    Outliers,
    Spokes,
    Winding,
    lost_records,
    near_azimuth,
    near_clock,
    same_setting,
    spoke_table,
)
from maritrack.io.turns.stitch import IDX_CYCLE, continues
from maritrack.io.turns.turnclock import exact_ns
from maritrack.types import BoolArray, IntArray, take

NONE = np.zeros(0, dtype=SPOKE)


class Setting(NamedTuple):
    """A range scale, as sent."""

    cell_dur: int
    start_rg: int
    bits: int
    femto: bool


@dataclass(frozen=True, slots=True, eq=False)
class Swept:
    """Spokes (n,) in order, and what they and their neighbours tell. None instead of an array: nowhere."""

    offset: IntArray
    start_az: IntArray
    end_az: IntArray
    n_cells: IntArray
    turn: IntArray  # azimuth that does not wrap
    tick: IntArray  # time of day that does not wrap, NO_TICK where unknown
    silence: IntArray  # ticks before each
    came_ns: IntArray | None  # receive time since midnight where the ticks are made of it, else -1
    rising: bool  # every spoke is clockwise of the one before
    setting: Setting  # of the first
    changes: tuple[tuple[int, Setting], ...] = ()  # rows from which on the range scale is another
    lost: IntArray | None = None  # records missing before each
    stray: BoolArray | None = None  # azimuth fits neither neighbour
    odd: BoolArray | None = None  # range scale of its own
    set_back: IntArray | None = None  # ticks by which the clock went back

    def t_ns(self, row: int) -> int | None:
        """Time of a spoke since midnight of the first day, None where unknown."""
        if self.tick[row] == NO_TICK:
            return None
        at = slice(row, row + 1)
        return int(exact_ns(self.tick[at], None if self.came_ns is None else self.came_ns[at])[0])

    def __len__(self) -> int:
        return len(self.offset)


class Judge:
    """Judges the spokes of one sensor. Memory: the stretch being read."""

    def __init__(self, days: DayCount) -> None:
        self._days, self._winding = days, Winding()
        self._azimuths, self._settings = Outliers(near_azimuth), Outliers(same_setting)
        self._clocks = Outliers(near_clock)
        self._setting: Setting | None = None
        self._last: Radials | Spokes = NONE  # ends with the last spoke that was judged
        self._held = NONE  # the spoke after it, where only the next one can tell what it is
        self._idx: int | None = None  # of the last record
        self._split = False  # some spoke came in parts
        self._part: tuple[int, ...] = ()  # what the next record has to be if it is a part of the same spoke

    def push(self, radials: Radials) -> Swept | None:
        """The next radials of the sensor, at least one; None where nothing is certain yet."""
        lost = self._lost(radials.idx)
        swept = self._calm(radials, lost)
        if swept is None:
            table, split = self._table(radials, lost)
            self._split |= split
            swept = self._judged(table, hold=self._split or not self._is_certain(table))
        self._part = _next_part(radials)
        return swept

    def finish(self) -> Swept | None:
        """The spoke that was held back, now that none follows."""
        return self._judged(self._held, hold=False) if len(self._held) else None

    def _lost(self, idx: IntArray) -> IntArray | None:
        before, self._idx = self._idx, int(idx[-1])
        if before is not None and before + 1 == idx[0] and (np.diff(idx) == 1).all():
            return None
        lost = lost_records(idx, before)
        return lost if lost.any() else None

    def _calm(self, r: Radials, lost: IntArray | None) -> Swept | None:
        """The radials if there is nothing to judge."""
        s = self._setting or Setting(int(r.cell_dur[0]), int(r.start_rg[0]), int(r.bits[0]), bool(r.femto[0]))
        first = self._winding.azimuth is None
        one_grid = (r.bits == s.bits).all() and (r.cell_dur == s.cell_dur).all() and (r.start_rg == s.start_rg).all()
        one_grid = one_grid and (r.femto == s.femto).all() and r.n_cells.min() > 0
        if not one_grid or len(self._held) or (first and len(r) == 1):
            return None
        azimuth = np.concatenate([r.start_az[:1] if first else [self._winding.azimuth], r.start_az])
        step = (np.diff(azimuth) + TURN // 2 & TURN - 1) - TURN // 2
        least, most = int(step[int(first) :].min()), int(step.max())
        if most > STRAY or least < -STRAY:
            return None
        tod, came_ns = _clock(r)
        time = self._ticks(tod)
        if time is None:
            return None
        turn = self._rise(r.start_az, step) if least > 0 else self._winding.unwrap(r.start_az, np.zeros(len(r), bool))
        self._setting, self._last = s, r
        return Swept(r.offset, r.start_az, r.end_az, r.n_cells, turn, *time, came_ns, least > 0, s, lost=lost)

    def _rise(self, start_az: IntArray, step: IntArray) -> IntArray:
        """Unwrapped azimuths of spokes that follow each other clockwise in small steps."""
        w = self._winding
        turn: IntArray = w.turn + np.cumsum(step)
        w.azimuth, w.turn = int(start_az[-1]), int(turn[-1])
        w.signs = np.concatenate([w.signs, np.sign(step[-HISTORY:])])[-HISTORY:]
        return turn

    def _ticks(self, tod: IntArray) -> tuple[IntArray, IntArray] | None:
        """Ticks that don't wrap and the silence before each, where the clock does nothing odd."""
        days = self._days
        if tod.max() < 0:
            return np.full(len(tod), NO_TICK), np.zeros(len(tod), dtype=np.int64)
        if tod.min() < 0:
            return None
        step = np.diff(tod, prepend=tod[0] if days.tod is None else days.tod)
        calm = step.min() >= 0 and step.max() <= SILENCE
        if not calm and (np.abs((step + DAY // 2) % DAY - DAY // 2) > SILENCE).any():
            return None
        if days.tod is None:
            days.unwrap(tod[:1], np.zeros(1, dtype=np.bool_))
        if calm and days.tod is not None:
            tick: IntArray = tod + (days.tick - days.tod)
            days.tod, days.tick = int(tod[-1]), int(tick[-1])
            return tick, step
        tick, _, silence = days.unwrap(tod, np.zeros(len(tod), dtype=np.bool_))
        return tick, silence

    def _table(self, r: Radials, lost: IntArray | None) -> tuple[Spokes, bool]:
        """The spoke held back and those of the radials, parts put together; and whether there are any parts."""
        missing = np.zeros(len(r), dtype=np.int64) if lost is None else lost
        goes_on = continues(r)
        goes_on[0] = len(self._held) > 0 and self._part == _as_part(r)
        split = bool(goes_on.any())
        if split:
            first = np.flatnonzero(~goes_on)
            self._held["n_cells"] += r.n_cells[: first[0] if len(first) else len(r)].sum()
            if len(first) == 0:
                return self._held, split
            n_cells = np.add.reduceat(r.n_cells, first)
            r, missing = replace(take(r, first), n_cells=n_cells), missing[first]
        return spoke_table(r, None, before=self._held, seq=np.zeros(len(r), dtype=np.int64), lost=missing), split

    def _is_certain(self, table: Spokes) -> bool:
        """Whether the last spoke agrees with the one before it, so that it is right whatever follows."""
        last = table[-1:]
        before = table[-2:-1] if len(table) > 1 else self._before()
        near = (near_azimuth, same_setting, near_clock)
        return len(before) > 0 and all(bool(agree(before, last)[0]) for agree in near)

    def _before(self) -> Spokes:
        """The last spoke that was judged."""
        if not isinstance(self._last, Radials):
            return self._last[-1:]
        zero = np.zeros(1, dtype=np.int64)
        return spoke_table(self._last, np.array([len(self._last) - 1]), before=NONE, seq=zero, lost=zero)

    def _judged(self, table: Spokes, *, hold: bool) -> Swept | None:
        """The spokes of a table, judged as `SensorStream` does it; the last may have to wait."""
        before, n = self._before(), len(table) - hold
        rows, after = table[:n].copy(), table[n:].copy()
        self._held = after
        if n == 0:
            return None
        stray, _ = self._azimuths.find(before, rows, after)
        odd, _ = self._settings.find(before, rows, after)
        spike, _ = self._clocks.find(before, rows, after)
        turn = self._winding.unwrap(rows["start_az"], stray)
        tick, set_back, silence = self._days.unwrap(rows["tod"], spike)
        setting, changes = self._changes(rows, odd)
        self._last = rows[-1:]
        column = {name: np.ascontiguousarray(rows[name]) for name in ("offset", "start_az", "end_az", "n_cells")}
        return Swept(
            **column, turn=turn, tick=tick, silence=silence, came_ns=np.ascontiguousarray(rows["came_ns"]),
            rising=False, setting=setting, changes=changes, lost=np.ascontiguousarray(rows["lost"]), stray=stray,
            odd=odd, set_back=set_back,
        )  # fmt: skip

    def _changes(self, rows: Spokes, odd: BoolArray) -> tuple[Setting, tuple[tuple[int, Setting], ...]]:
        """The range scale before these rows (of the first where there is none), and where it is another."""
        index = np.flatnonzero(~odd)
        if len(index) == 0:
            return self._setting or _setting_of(rows[0]), ()
        grid = rows[index]
        starts = np.flatnonzero(~same_setting(grid[:-1], grid[1:])) + 1
        starts = np.concatenate([[0], starts])
        columns = [grid[name][starts].tolist() for name in Setting._fields]
        found = list(zip(index[starts].tolist(), map(Setting, *columns), strict=True))
        before = self._setting or found[0][1]
        self._setting = found[-1][1]
        return before, tuple(found if found[0][1] != before else found[1:])


def _setting_of(row: np.void) -> Setting:
    return Setting(int(row["cell_dur"]), int(row["start_rg"]), int(row["bits"]), bool(row["femto"]))


def _clock(r: Radials) -> tuple[IntArray, IntArray | None]:
    """Times of day, of the receive time where none was sent; and these in ns since midnight, None where not needed."""
    came = (r.tod < 0) & (r.t_ns != NO_TIME)
    if not came.any():
        return r.tod, None
    came_ns = np.where(came, r.t_ns % DAY_NS, -1)
    return np.where(came, came_ns // TICK_NS, r.tod), came_ns


def _as_part(r: Radials) -> tuple[int, ...]:
    """What tells that the first record is a part of the spoke that the record before is of."""
    return (int(r.idx[0]), int(r.start_rg[0]), int(r.start_az[0]), int(r.end_az[0]), int(r.cell_dur[0]),
            int(r.femto[0]), int(r.bits[0]))  # fmt: skip


def _next_part(r: Radials) -> tuple[int, ...]:
    """What the next record has to be to go on with the spoke of the last one."""
    if r.n_cells[-1] == 0:
        return ()
    return (int(r.idx[-1] + 1) % IDX_CYCLE, int(r.start_rg[-1] + r.n_cells[-1]), int(r.start_az[-1]),
            int(r.end_az[-1]), int(r.cell_dur[-1]), int(r.femto[-1]), int(r.bits[-1]))  # fmt: skip
