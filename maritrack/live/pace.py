"""When the datagrams of a recording are due: by their receive times, by the time of day of their records, or, where
there is neither, by the turning of the antenna.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from maritrack.io.datagrams import NO_TIME, Datagrams
from maritrack.io.turns.spokes import DayCount, Winding
from maritrack.io.turns.spoketime import SpokeClock
from maritrack.live.heads import read_head
from maritrack.types import IntArray

BACK_NS = 1_000_000_000  # a clock that steps back by more was set; by less, datagrams are out of order
RECEIVED, TIME_OF_DAY, ANTENNA = "receive time", "time of day", "antenna"


@dataclass(slots=True)
class Timeline:
    """Times from zero on, out of a clock that may be set back or stand still.

    Pauses of more than `max_gap_ns` are cut to that; steps back of more than BACK_NS take no time.
    """

    max_gap_ns: int
    last_ns: int | None = None  # of the clock
    at_ns: int = 0  # where that is on the line
    cuts: int = 0
    cut_ns: int = 0

    def place(self, t_ns: IntArray) -> IntArray:
        """Places (n,) of clock times (n,), n > 0."""
        step = np.diff(t_ns, prepend=t_ns[0] if self.last_ns is None else self.last_ns)
        pause = step > self.max_gap_ns
        self.cuts += int(pause.sum())
        self.cut_ns += int((step[pause] - self.max_gap_ns).sum())
        step = np.where(pause, self.max_gap_ns, np.where(step < -BACK_NS, 0, step))
        at = self.at_ns + np.cumsum(step)
        self.last_ns, self.at_ns = int(t_ns[-1]), int(at[-1])
        return np.asarray(at, dtype=np.int64)


@dataclass(slots=True)
class _Antenna:
    """One sensor's clock: its time of day where it has one, else its turning."""

    line: Timeline
    winding: Winding = field(default_factory=Winding)
    days: DayCount = field(default_factory=DayCount)
    clock: SpokeClock = field(default_factory=SpokeClock)

    def times(self, azimuth: IntArray, tod: IntArray) -> IntArray:
        never = np.zeros(len(azimuth), dtype=np.bool_)
        tick, _, _ = self.days.unwrap(tod, never)
        return self.clock.times(tick, self.winding.unwrap(azimuth, never), np.full(len(azimuth), -1))


class Pace:
    """The times at which the datagrams of a recording are due, in ns from its first on, never decreasing."""

    def __init__(self, *, max_gap_ns: int) -> None:
        self._max_gap_ns = max_gap_ns
        self.kind = ""
        self.at_ns = 0  # of the last datagram
        self._cuts = self._cut_ns = 0  # of the passes before
        self._assumed = False
        self._begin_pass(0)

    def _begin_pass(self, at_ns: int) -> None:
        self._line = Timeline(self._max_gap_ns, at_ns=at_ns)
        self._antennas: dict[int, _Antenna] = {}
        self._pass = (at_ns, 0)  # where it begins, datagrams so far

    def again(self) -> None:
        """The recording is played once more: it goes on as it went on the average."""
        begin, n = self._pass
        self._cuts, self._cut_ns, self._assumed = self.cuts, self.cut_ns, self.assumed
        self.at_ns += (self.at_ns - begin) // max(n - 1, 1)
        self._begin_pass(self.at_ns)

    @property
    def cuts(self) -> int:
        """Pauses that were cut."""
        return self._cuts + sum(line.cuts for line in self._lines())

    @property
    def cut_ns(self) -> int:
        """By how much."""
        return self._cut_ns + sum(line.cut_ns for line in self._lines())

    @property
    def assumed(self) -> bool:
        """The speed of the antenna was never told."""
        return self._assumed or any(antenna.clock.guessed for antenna in self._antennas.values())

    def due(self, d: Datagrams) -> IntArray:
        """When these datagrams (n,) are due."""
        if len(d) == 0:
            return np.zeros(0, dtype=np.int64)
        if not self.kind:
            self.kind = RECEIVED if (d.t_ns != NO_TIME).any() else ANTENNA
        at = self._received(d) if self.kind == RECEIVED else self._by_records(d)
        due = np.maximum.accumulate(np.maximum(at, self.at_ns))
        self.at_ns = int(due[-1])
        self._pass = (self._pass[0], self._pass[1] + len(d))
        return np.asarray(due)

    def _lines(self) -> list[Timeline]:
        return [self._line, *(antenna.line for antenna in self._antennas.values())]

    def _received(self, d: Datagrams) -> IntArray:
        known = d.t_ns != NO_TIME
        at = np.full(len(d), self.at_ns)
        if known.any():
            at[known] = self._line.place(d.t_ns[known])
        return at

    def _by_records(self, d: Datagrams) -> IntArray:
        """By the clock of each sensor; what has none goes with the datagram before it."""
        bounds = d.bounds.tolist()
        heads = np.array([read_head(d.data, begin, end) for begin, end in pairwise(bounds)], dtype=np.int64).reshape(
            -1, 3
        )
        at = np.full(len(d), self.at_ns)
        spokes = heads[:, 1] >= 0
        if (heads[spokes, 2] >= 0).any():
            self.kind = TIME_OF_DAY
        anchor: tuple[int | None, int] = (None, self.at_ns)  # where a sensor that is new begins
        for sensor in dict.fromkeys(heads[spokes, 0].tolist()):
            rows = np.flatnonzero(spokes & (heads[:, 0] == sensor))
            antenna = self._antennas.get(sensor)
            if antenna is None:
                antenna = _Antenna(Timeline(self._max_gap_ns, last_ns=anchor[0], at_ns=anchor[1]))
                self._antennas[sensor] = antenna
            antenna.line.at_ns = max(antenna.line.at_ns, self.at_ns - BACK_NS)  # it was silent for long
            t_ns = antenna.times(heads[rows, 1], heads[rows, 2])
            at[rows] = antenna.line.place(t_ns)
            anchor = anchor if anchor[0] is not None else (int(t_ns[0]), int(at[rows[0]]))
        return at
