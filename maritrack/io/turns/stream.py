"""The spokes of one antenna, cut into turns.

A turn ends with the first spoke whose unwrapped azimuth is a full turn away from that of the turn's
first spoke, either way round; steps back, repeats, jitter and blanked sectors don't end it. It also ends
where the range scale changes, after a silence, and when it grows too large. A spoke is judged when the
next one has come, because a single wrong azimuth, time or range scale shows only then. Of spokes with
the same START and END azimuths in a turn the last one counts.

No antenna turns within a few spokes: after FREE_SCANS such turns, one has at least LEAST_SPOKES. All spokes of a turn
are filled up to the widest: where the turns of an input get too large for its size, they are left out (`turn-budget`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from maritrack.io.cat240.cells import cell_type
from maritrack.io.cat240.radials import Radials
from maritrack.io.turns.shortruns import MAX_TICKS, ShortRuns
from maritrack.io.turns.spokes import (
    NO_TICK,
    SILENCE,
    SPOKE,
    TICK_NS,
    TICKS_PER_S,
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
from maritrack.io.turns.spoketime import ASSUMED_PERIOD_NS, SpokeClock
from maritrack.io.turns.stitch import continues, extends, join, stitch
from maritrack.io.turns.turn import Cut, OpenTurn, Turn, findings, last_of_repeats
from maritrack.io.turns.turnbounds import FREE_SCANS, LEAST_SPOKES, MAX_CELLS, MAX_SPOKES, SILENT_TURNS, TurnBudget
from maritrack.types import Damage, IntArray, take

WIDER = 2  # a turn with cells this much further out, or less far, than the last is a new segment
END_OF_INPUT = int(np.iinfo(np.int64).max)
HELD = -1  # in place of a row: the spoke that was held back


class SensorStream:
    """The spokes of one sensor, cut into turns. Memory: one turn and the block being read."""

    def __init__(
        self, sensor: str, days: DayCount, *, free_scans: int = FREE_SCANS, budget: TurnBudget | None = None
    ) -> None:
        self.sensor = sensor
        self.segment = 0
        self._free = free_scans
        self._budget = TurnBudget() if budget is None else budget
        self._idx: int | None = None
        self._held: Radials | None = None  # the last spoke: judged when the next one has come
        self._held_row = np.zeros(0, SPOKE)
        self._before = np.zeros(0, SPOKE)  # the spoke before that
        self._setting = np.zeros(0, SPOKE)  # the last spoke on the grid of the turn
        self._azimuths, self._settings = Outliers(near_azimuth), Outliers(same_setting)
        self._clocks = Outliers(near_clock)
        self._winding, self._days, self._clock = Winding(), days, SpokeClock()
        self._no_time_told = False
        self._widest = 0  # cells of the last turn
        self._open = OpenTurn()

    @property
    def worth_a_scan(self) -> bool:
        return self._open.worth_a_scan

    def push(self, radials: Radials, rows: IntArray | None, seq: int) -> Iterator[Cut]:
        """Ends of turns among these rows (None = all) of the radials, whose first record has number `seq`."""
        radials, table, where = self._whole_spokes(radials, rows, seq)
        self._held_row = table[-1:]
        yield from self._split(table[:-1], where[:-1], radials, after=table[-1:])
        self._open.let_go(radials.cells)
        self._held = replace(take(radials, where[-1:]), idx=np.array([self._idx]))  # the last part's, of a split one

    def finish(self) -> Iterator[Cut]:
        """Ends of turns, now that no spoke follows."""
        if self._held is not None:
            rows = np.zeros(1, np.int64)
            yield from self._split(self._held_row, rows, self._held, after=np.zeros(0, SPOKE))
            yield self._close("end", END_OF_INPUT, int(self._held_row["offset"][0]), None)
            self._held = None

    def _whole_spokes(self, radials: Radials, rows: IntArray | None, seq: int) -> tuple[Radials, Spokes, IntArray]:
        """The spoke held back and the new ones, parts put together: radials, headers, row of each."""
        number = np.arange(seq, seq + len(radials)) if rows is None else seq + rows
        idx = radials.idx if rows is None else radials.idx[rows]
        lost = lost_records(idx, self._idx)
        self._idx = int(idx[-1])
        held, goes_on = self._held, continues(radials, rows)
        held_goes_on = held is not None and extends(held, radials, 0 if rows is None else int(rows[0]))
        if held_goes_on or goes_on.any():
            radials = radials if rows is None else take(radials, rows)
            if held is not None and held_goes_on:
                radials, goes_on = join(held, radials), np.concatenate([[False, True], goes_on[1:]])
                number = np.concatenate([self._held_row["seq"], number])
                lost = np.concatenate([self._held_row["lost"], lost])
            radials, first = stitch(radials, goes_on)
            rows, number, lost = None, number[first], lost[first]
        before = self._held_row[:0] if held_goes_on else self._held_row
        table = spoke_table(radials, rows, before=before, seq=number, lost=lost)
        where = np.arange(len(radials)) if rows is None else rows
        return radials, table, np.concatenate([np.full(len(before), HELD), where])

    def _split(self, table: Spokes, where: IntArray, radials: Radials, *, after: Spokes) -> Iterator[Cut]:
        if len(table) == 0:
            return
        changes, silence = self._judge(table, after)
        found = np.append(table["seq"], after["seq"] if len(after) else END_OF_INPUT)[1:]
        runs = ShortRuns(table["turn"], table["tick"], changes, np.flatnonzero(silence > self._silence))
        start = 0
        while start < len(table):
            if self._open.n == 0 and (end := runs.end(start, self._least_spokes)) > start:
                yield self._drop(table[start:end], runs.within(start, end), int(found[end]), table[end : end + 1])
                start = end
                continue
            end, why = self._end(table, start, changes, silence)
            if end > start:
                self._extend(table[start:end], where[start:end], radials)
            if end < len(table):
                reason = self._reason(why, table[end], float(silence[end]) / TICKS_PER_S)
                yield self._close(why, int(found[end]), int(table["offset"][end]), reason)
            start = end

    def _judge(self, table: Spokes, after: Spokes) -> tuple[IntArray, IntArray]:
        """Fill in what only neighbours tell; rows where the range scale changes, silence before each row."""
        table["stray"], _ = self._azimuths.find(self._before, table, after)
        table["odd"], one_grid = self._settings.find(self._before, table, after)
        spike, _ = self._clocks.find(self._before, table, after)
        table["turn"] = self._winding.unwrap(table["start_az"], table["stray"])
        table["tick"], table["set_back"], silence = self._days.unwrap(table["tod"], spike)
        changes = np.zeros(0, np.int64) if one_grid else self._changes(table)
        self._before = table[-1:].copy()
        return changes, silence

    def _changes(self, table: Spokes) -> IntArray:
        """Rows where the range scale is another than in the last row that was not odd."""
        rows = np.flatnonzero(~table["odd"])
        grid = np.concatenate([self._setting, table[rows]])
        changed = ~same_setting(grid[:-1], grid[1:])
        self._setting = grid[-1:].copy()  # not needed where all agree: then the next row agrees with these
        return rows[len(rows) - len(changed) :][changed]

    def _end(self, table: Spokes, start: int, changes: IntArray, silence: IntArray) -> tuple[int, str]:
        """The row at which the turn that is open, or begins at `start`, ends, and why; (n, "") if it goes on."""
        opened = self._open
        lo = start if opened.n else start + 1
        turn = opened.turn if opened.n else int(table["turn"][start])
        end, why = _full_turn(table["turn"], max(lo, start + self._least_spokes - opened.n), turn), "turn"
        overlong = self._overlong(table, start, end)
        if overlong < end:
            end, why = max(overlong, lo), "scan-overlong"
        last = min(end + 1, len(table))
        quiet = lo + np.flatnonzero(silence[lo:last] > self._silence)
        if len(quiet):
            end, why = int(quiet[0]), "gap"
        change = np.searchsorted(changes, lo)
        if change < len(changes) and changes[change] <= end:
            end, why = int(changes[change]), "range-change"
        return end, why

    def _overlong(self, table: Spokes, start: int, end: int) -> int:
        """The first row from `start` on that the open turn has no room for, or `end`."""
        opened, rows = self._open, table[start:end]
        first = min(end, start + MAX_SPOKES - opened.n)
        most = MAX_CELLS // max(int(rows["bits"].max(initial=0)) >> 3, 1)
        if (opened.n + len(rows)) * max(opened.widest, int(rows["n_cells"].max(initial=0))) > most:
            widest = np.maximum(np.maximum.accumulate(rows["n_cells"]), opened.widest)
            full = np.arange(opened.n + 1, opened.n + 1 + len(rows)) * widest > most
            first = min(first, start + int(np.argmax(full)))
        known = rows["tick"] != NO_TICK
        begin = opened.tick if opened.tick != NO_TICK else int(rows["tick"][np.argmax(known)]) if known.any() else 0
        late = known & (rows["tick"] - begin > MAX_TICKS)
        return min(first, start + int(np.argmax(late))) if late.any() else first

    def _extend(self, table: Spokes, where: IntArray, radials: Radials) -> None:
        self._open.add(table)
        rows = where[~table["odd"]]
        if len(rows) and rows[0] == HELD:
            assert self._held is not None
            self._open.pieces.append((self._held.cells, np.zeros(1, np.int64)))
            rows = rows[1:]
        if len(rows):
            self._open.pieces.append((radials.cells, rows))

    def _reason(self, why: str, row: np.void, silence_s: float) -> Damage | None:
        if why == "turn":
            return None
        message = {
            "range-change": f"range scale is now {row['cell_m']:g} m from cell {row['start_rg']}, {row['bits']} bit",
            "gap": f"{silence_s:g} s without a spoke",
            "scan-overlong": f"no full turn within {self._open.n} spokes: cut here",
        }[why]
        return Damage(why, int(row["offset"]), message, self.sensor)

    @property
    def _silence(self) -> float:
        """Ticks without a spoke that end a turn."""
        return max(SILENCE, SILENT_TURNS * self._clock.period_ns / TICK_NS)

    @property
    def _least_spokes(self) -> int:
        """Of a turn."""
        return LEAST_SPOKES if self._free <= 0 else 0

    def _drop(self, spokes: Spokes, cuts: tuple[int, int], found: int, after: Spokes) -> Cut:
        """The end of many turns that were cut off, by so many changes of the range scale and silences, too early."""
        changes, gaps = cuts
        offset, n = int(spokes["offset"][0]), changes + gaps
        damage = [*findings(spokes, self.sensor)]
        message = f"{n} times a few spokes, {len(spokes)} in all: no scan"
        damage.append(Damage("short-scan", offset, message, self.sensor, len(spokes)))
        if changes:
            message = f"the range scale changes {changes} times within {len(spokes)} spokes"
            damage.append(Damage("range-change", offset, message, self.sensor, changes))
        if gaps:
            message = f"{gaps} silences within {len(spokes)} spokes"
            damage.append(Damage("gap", offset, message, self.sensor, gaps))
        self.segment += n
        self._widest = 0
        return Cut(found, int(after["offset"][0]), None, tuple(damage))

    def _close(self, why: str, found: int, offset: int, reason: Damage | None) -> Cut:
        opened, self._open = self._open, OpenTurn()
        spokes = opened.spokes()
        damage = [*findings(spokes, self.sensor)]
        turn = None
        long_enough = opened.worth_a_scan or why in ("turn", "scan-overlong")
        if opened.pieces and long_enough and len(spokes) >= self._least_spokes:
            t_ns = self._clock.times(spokes["tick"], spokes["turn"], spokes["came_ns"])
            damage += self._no_time(spokes)
            self._free -= len(spokes) < LEAST_SPOKES
            turn, more = self._turn(opened, spokes, t_ns)
            damage += more
        else:
            share = 100 * (opened.high - opened.low) / TURN
            message = f"{len(spokes)} spokes, {share:.1f} % of a turn: no scan"
            damage.append(Damage("short-scan", int(spokes["offset"][0]), message, self.sensor, len(spokes)))
        if reason is not None:
            damage.append(reason)
        if why in ("range-change", "gap"):
            self.segment += 1
            self._widest = 0
        return Cut(found, offset, turn, tuple(damage))

    def _turn(self, opened: OpenTurn, spokes: Spokes, t_ns: IntArray) -> tuple[Turn | None, list[Damage]]:
        """The turn without odd spokes and repeats, and what is to say about it."""
        if spokes["odd"].any():
            spokes, t_ns = spokes[~spokes["odd"]], t_ns[~spokes["odd"]]
        widest = int(spokes["n_cells"].max())
        octets = len(spokes) * widest * cell_type(int(spokes["bits"][0])).itemsize
        if not self._budget.allows(octets, int(spokes["offset"][-1])):
            message = f"a turn of {len(spokes)} spokes of {widest} cells: more than an input of this size may have"
            return None, [Damage("turn-budget", int(spokes["offset"][0]), message, self.sensor, len(spokes))]
        damage = self._resized(widest, spokes)
        cells, last = opened.cells(widest, int(spokes["bits"][0])), last_of_repeats(spokes)
        opened.pieces.clear()  # they are as large again
        if not last.all():
            first = int(spokes["offset"][np.argmin(last)])
            message = f"{int((~last).sum())} spokes came again in the same turn: the last ones count"
            damage.append(Damage("repeated-spoke", first, message, self.sensor, int((~last).sum())))
            spokes, t_ns, cells = spokes[last], t_ns[last], cells[last]
        return Turn(self.sensor, self.segment, spokes, t_ns, cells), damage

    def _resized(self, widest: int, spokes: Spokes) -> list[Damage]:
        """A new segment where the number of cells is another; one spoke more or less does not make it."""
        before, self._widest = self._widest, widest
        if before == 0 or (before <= WIDER * widest and widest <= WIDER * before):
            return []
        self.segment += 1
        message = f"{widest} cells instead of {before}"
        return [Damage("range-change", int(spokes["offset"][0]), message, self.sensor)]

    def _no_time(self, spokes: Spokes) -> list[Damage]:
        if self._no_time_told or not self._clock.guessed:
            return []
        self._no_time_told = True
        message = f"no time of day: {ASSUMED_PERIOD_NS * 1e-9:g} s per turn is assumed"
        return [Damage("no-time", int(spokes["offset"][0]), message, self.sensor)]


def _full_turn(turn: IntArray, lo: int, begin: int) -> int:
    """The first row from `lo` on whose azimuth is a full turn away from `begin`, or the number of rows."""
    size = 1024
    while lo < len(turn):
        there = np.abs(turn[lo : lo + size] - begin) >= TURN
        if there.any():
            return lo + int(np.argmax(there))
        lo, size = lo + size, 2 * size
    return len(turn)
