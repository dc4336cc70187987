"""The turns of one antenna counted from headers alone, as `stream` cuts them, and what they tell of the radar."""

from __future__ import annotations

from array import array
from collections import Counter, deque
from collections.abc import Sized

import numpy as np

from maritrack.io.cat240.radials import Radials
from maritrack.io.turns.counted import Change, Grid, Loss, Opened, Pause
from maritrack.io.turns.sectors import Sectors
from maritrack.io.turns.shortruns import MAX_TICKS, ShortRuns
from maritrack.io.turns.spokes import NO_TICK, SILENCE, TICK_NS, TURN, DayCount
from maritrack.io.turns.spoketime import ASSUMED_PERIOD_NS
from maritrack.io.turns.sweep import Judge, Setting, Swept
from maritrack.io.turns.turn import LEAST_ADVANCE
from maritrack.io.turns.turnbounds import (
    FREE_SCANS,
    LEAST_SPOKES,
    MAX_CELLS,
    MAX_SPOKES,
    SILENT_TURNS,
    Limits,
    TurnBudget,
    limits_of,
)
from maritrack.io.turns.turnclock import TurnClock, exact_ns, middle
from maritrack.types import IntArray

MOST_KEPT = 2000  # silences, losses and changes; more are only counted
SHORT_PAUSE = 26  # ticks: shorter silences are of no interest
LOOK = 4096  # spokes that are looked at at once
WIDER = 1.05  # times as many cells: another range


class TurnCount:
    """Counts the turns of one sensor. Memory: the stretch being read and a few numbers for each turn.

    Times are ns since midnight of the first day, None where unknown.
    """

    def __init__(self, days: DayCount, *, free_scans: int = FREE_SCANS, budget: TurnBudget | None = None) -> None:
        self._free, self._budget = free_scans, TurnBudget() if budget is None else budget
        self.spokes = self.scans = self.repeated = self.stray = self.odd = self.set_back = 0
        self.forward = self.backward = 0  # steps of azimuth
        self.lost = self.n_losses = self.n_changes = 0
        self.first_ns: int | None = None
        self.last_ns: int | None = None
        self.losses: list[Loss] = []
        self.changes: list[Change] = []
        self.grids: Counter[Grid] = Counter()  # spokes
        self.full_turns = array("q")  # spokes of each
        self.clock, self.sectors = TurnClock(), Sectors()
        self._judge, self._open = Judge(days), Opened()
        self._setting = Setting(0, 0, 0, False)  # of the last spoke
        self._grid: Grid | None = None  # of the last scan
        self._cells = 0  # of the last spoke
        self._pauses = np.zeros((0, 3), dtype=np.int64)  # as in Pause
        self._widths: list[IntArray] = []  # of the first spokes
        self._full: list[tuple[IntArray, IntArray, IntArray]] = []  # turns for `Sectors`
        self._joins = False  # the last turn was a full one
        self._period = 0.0  # ticks of the last turn, 0 = not yet known

    def push(self, radials: Radials) -> None:
        """The next radials of the sensor, at least one."""
        swept = self._judge.push(radials)
        if swept is not None:
            self._take(swept)

    def finish(self) -> None:
        """No radials follow."""
        swept = self._judge.finish()
        if swept is not None:
            self._take(swept)
        if self._open.n:
            self._close("end", self._setting)

    def _take(self, s: Swept) -> None:
        """Cut the spokes into turns, and count."""
        self._note(s)
        setting, changes, limits = s.setting, deque(s.changes), limits_of(s, self._open.tick)
        begins: list[tuple[int, int, bool]] = []
        rows = np.array([row for row, _ in changes], dtype=np.int64)
        runs = ShortRuns(s.turn, s.tick, rows, np.flatnonzero(s.silence > self._silence))
        start = 0
        while start < len(s):
            if self._open.n == 0 and (end := runs.end(start, self._least_spokes)) > start:
                setting, start = self._drop(s, (start, end), setting, changes), end
                continue
            if self._open.n == 0:
                setting = changes.popleft()[1] if changes and changes[0][0] == start else setting
                begins.append((start, int(s.turn[start]), self._joins))
            most = MAX_CELLS // max(setting.bits >> 3, 1)
            end, why = self._end(s, start, changes[0][0] if changes else len(s), limits._replace(most_cells=most))
            if end > start:
                self._extend(s, start, end)
            if end < len(s):
                self._close(why, setting)
            start = end
        self._setting, self._cells = setting, int(s.n_cells[-1])
        self.clock.add(s.tick, begins, s.came_ns)
        self.sectors.add(self._full)
        self._full = []

    def _note(self, s: Swept) -> None:
        """What needs no turns."""
        known = np.flatnonzero(s.tick != NO_TICK)
        if len(known):
            self.first_ns = s.t_ns(int(known[0])) if self.first_ns is None else self.first_ns
            self.last_ns = s.t_ns(int(known[-1]))
        if s.rising and self.spokes:
            self.forward += len(s)
        else:
            step = np.diff(s.turn, prepend=self._open.last if self._open.n else s.turn[0])
            self.forward, self.backward = self.forward + int((step > 0).sum()), self.backward + int((step < 0).sum())
        self.spokes += len(s)
        self.stray += 0 if s.stray is None else int(s.stray.sum())
        self.odd += 0 if s.odd is None else int(s.odd.sum())
        self.set_back += 0 if s.set_back is None else int((s.set_back > 0).sum())
        if s.lost is not None:
            rows = np.flatnonzero(s.lost)
            self.lost, self.n_losses = self.lost + int(s.lost.sum()), self.n_losses + len(rows)
            rows = rows[: _room(self.losses)]
            self.losses += [Loss(s.t_ns(i), int(s.offset[i]), int(s.lost[i])) for i in rows.tolist()]
        if s.silence.max() > SHORT_PAUSE:
            self._add_pauses(s)
        if sum(map(len, self._widths)) < LOOK:
            self._widths.append((s.end_az - s.start_az)[:LOOK] & TURN - 1)
        old = s.setting
        self.n_changes += len(s.changes)
        for row, new in s.changes[: _room(self.changes)]:
            n_cells = int(s.n_cells[row - 1]) if row else self._cells
            new_grid = Grid(new, int(s.n_cells[row]))
            self.changes.append(Change(s.t_ns(row), int(s.offset[row]), Grid(old, n_cells), new_grid))
            old = new

    def _add_pauses(self, s: Swept) -> None:
        rows = np.flatnonzero(s.silence > SHORT_PAUSE)
        came_ns = None if s.came_ns is None else s.came_ns[rows]
        before_ns = exact_ns(s.tick[rows], came_ns) - s.silence[rows] * TICK_NS
        new = np.stack([s.silence[rows], before_ns, s.offset[rows]], axis=1)
        self._pauses = np.concatenate([self._pauses, new])
        if len(self._pauses) > MOST_KEPT:
            self._pauses = self._pauses[np.argsort(-self._pauses[:, 0], kind="stable")[:MOST_KEPT]]

    @property
    def width(self) -> int:
        """Of a spoke, 0 = only its azimuth is told."""
        return int(middle(np.concatenate(self._widths)[:LOOK])) if self._widths else 0

    def _change(self, change: Change) -> None:
        self.n_changes += 1
        if _room(self.changes):
            self.changes.append(change)

    def _end(self, s: Swept, start: int, change: int, limits: Limits) -> tuple[int, str]:
        """The row at which the turn that is open, or begins at `start`, ends, and why; (n, "") if it goes on.

        `change` is the next row with another range scale, n where there is none.
        """
        o = self._open
        lo = start if o.n else start + 1
        least = max(lo, start + self._least_spokes - o.n)
        end, why = _full_turn(s, least, o.turn if o.n else int(s.turn[start])), "turn"
        overlong = self._overlong(s, start, end, limits)
        if overlong < end:
            end, why = max(overlong, lo), "scan-overlong"
        if limits.silence > SILENCE:
            quiet = np.flatnonzero(s.silence[lo : end + 1] > self._silence)
            if len(quiet):
                end, why = lo + int(quiet[0]), "gap"
        if change <= end and change < len(s):
            end, why = change, "range-change"
        return end, why

    def _overlong(self, s: Swept, start: int, end: int, limits: Limits) -> int:
        """The first row from `start` on that the open turn has no room for, or `end`."""
        o, n = self._open, end - start
        first = min(end, start + MAX_SPOKES - o.n)
        if (o.n + n) * max(o.widest, limits.n_cells) > limits.most_cells:
            widest = np.maximum(np.maximum.accumulate(s.n_cells[start:end]), o.widest)
            full = np.append(np.arange(o.n + 1, o.n + 1 + n) * widest > limits.most_cells, True)
            first = min(first, start + int(np.argmax(full)))
        tick = s.tick[start:end]
        known = tick != NO_TICK
        if n == 0 or not limits.long or not known.any():
            return first
        begin = o.tick if o.tick != NO_TICK else int(tick[np.argmax(known)])
        late = np.append(known & (tick - begin > MAX_TICKS), True)
        return min(first, start + int(np.argmax(late)))

    def _extend(self, s: Swept, start: int, end: int) -> None:
        """Add spokes to the open turn."""
        o, turn, tick = self._open, s.turn[start:end], s.tick[start:end]
        first, last = int(turn[0]), int(turn[-1])
        low, high = (first, last) if s.rising else (int(turn.min()), int(turn.max()))
        if o.n == 0:
            o.turn, o.low, o.high = first, low, high
            o.t_ns, o.offset = s.t_ns(start), int(s.offset[start])
        o.low, o.high, o.last = min(o.low, low), max(o.high, high), last
        o.last_offset = int(s.offset[end - 1])
        known = tick if tick[0] != NO_TICK and tick[-1] != NO_TICK else tick[tick != NO_TICK]
        if len(known):
            o.tick, o.until = int(known[0]) if o.tick == NO_TICK else o.tick, int(known[-1])
        good = slice(start, end) if s.odd is None else start + np.flatnonzero(~s.odd[start:end])
        azimuths = s.start_az[good] << 16 | s.end_az[good]
        o.azimuths.append(azimuths)
        shown = good if s.stray is None or s.odd is None else start + np.flatnonzero(~(s.odd | s.stray)[start:end])
        o.shown.append((s.start_az[shown], s.end_az[shown], s.turn[shown]))
        o.rising &= s.rising
        o.widest = max(o.widest, int(s.n_cells[start:end].max()))
        o.n, o.kept = o.n + end - start, o.kept + len(azimuths)

    @property
    def _silence(self) -> float:
        """Ticks without a spoke that end a turn."""
        return max(SILENCE, SILENT_TURNS * (self._period or ASSUMED_PERIOD_NS / TICK_NS))

    @property
    def _least_spokes(self) -> int:
        """Of a turn, as `stream` has it."""
        return LEAST_SPOKES if self._free <= 0 else 0

    def _drop(self, s: Swept, span: tuple[int, int], setting: Setting, changes: deque[tuple[int, Setting]]) -> Setting:
        """Pass over spokes [first, end) whose turns were all cut off too early; the range scale of the last of them."""
        at, end = span
        widest = int(s.n_cells[at:end].max())
        while changes and changes[0][0] < end:
            row, new = changes.popleft()
            self.grids[Grid(setting, widest)] += row - at
            at, setting = row, new
        self.grids[Grid(setting, widest)] += end - at
        self._joins = False
        return setting

    def _close(self, why: str, setting: Setting) -> None:
        o, self._open = self._open, Opened()
        self._joins = why == "turn"
        repeated = 0 if o.rising else o.kept - len(np.unique(np.concatenate(o.azimuths)))
        self.repeated += repeated
        long_enough = why in ("turn", "scan-overlong") or o.high - o.low >= LEAST_ADVANCE
        if o.kept and long_enough and o.n >= self._least_spokes:
            octets = o.kept * o.widest * max(setting.bits >> 3, 1)
            self.scans += self._budget.allows(octets, o.last_offset)
            self._free -= o.n < LEAST_SPOKES
        grid, turned = Grid(setting, o.widest), abs(o.last - o.turn)
        self.grids[grid] += o.kept
        if turned >= TURN // 2 and o.until > o.tick:
            self._period = (o.until - o.tick) * TURN / turned
        if why != "turn":
            return
        self.full_turns.append(o.kept - repeated)
        shown = [np.concatenate(column) if len(column) > 1 else column[0] for column in zip(*o.shown, strict=True)]
        if len(shown[0]):
            self._full.append((shown[0], shown[1], shown[2]))
        before, self._grid = self._grid, grid
        if before is not None and before.setting == setting and not _alike(before.n_cells, grid.n_cells):
            self._change(Change(o.t_ns, o.offset, before, grid))

    def pauses(self) -> list[Pause]:
        """The longest silences of more than SHORT_PAUSE, in order."""
        return [Pause(*row) for row in self._pauses[np.argsort(self._pauses[:, 2], kind="stable")].tolist()]


def _room(kept: Sized) -> int:
    """How many more may be kept."""
    return max(MOST_KEPT - len(kept), 0)


def _alike(a: int, b: int) -> bool:
    """Whether two numbers of cells may belong to one range."""
    return max(a, b) <= WIDER * min(a, b)


def _full_turn(s: Swept, lo: int, begin: int) -> int:
    """The first row from `lo` on whose azimuth is a full turn away from `begin`, or the number of rows."""
    if s.rising:
        return min(max(lo, int(np.searchsorted(s.turn, begin + TURN))), len(s))
    for at in range(lo, len(s), LOOK):
        there = np.abs(s.turn[at : at + LOOK] - begin) >= TURN
        if there.any():
            return at + int(np.argmax(there))
    return len(s)
