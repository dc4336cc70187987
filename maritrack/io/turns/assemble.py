"""Radials to turns, for all sensors of an input at once.

Each sensor has a `SensorStream` of its own, which says where its turns end. A sensor is a SAC and SIC in a stream of
the recording. Its id is "SAC-SIC" ("7-42"); where several streams have the same, those that come later have the
address behind it ("7-42@239.0.1.3:8600").
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from operator import attrgetter

import numpy as np

from maritrack.io.cat240.radials import Radials
from maritrack.io.datagrams import Stream
from maritrack.io.turns.spokes import DayCount
from maritrack.io.turns.stream import SensorStream
from maritrack.io.turns.turn import Cut
from maritrack.io.turns.turnbounds import FREE_SCANS, TurnBudget
from maritrack.types import Damage, IntArray

MAX_SENSORS = 64


class Assembler:
    """Turns of all sensors of one input, or of one of them: "7-42" is that sensor in any stream."""

    def __init__(self, *, sensor: str = "", streams: Sequence[Stream] = ()) -> None:
        self.seen: dict[str, None] = {}  # ids of the sensors in the input, in order of appearance
        self._only = sensor
        self._recorded = streams
        self._names: dict[int, str] = {}  # by stream, SAC and SIC
        self._streams: dict[str, SensorStream] = {}
        self._days: list[DayCount] = []
        self._budget = TurnBudget()
        self._seq = 0

    def push(self, radials: Radials) -> Iterator[Cut]:
        """Ends of turns in the order in which they become certain. Use it up before the next push."""
        parts = list(self._by_sensor(radials))
        self._seq += len(radials)
        return heapq.merge(*parts, key=attrgetter("found"))

    def finish(self) -> Iterator[Cut]:
        """What is left at the end of the input, in the order of the input."""
        cuts = [cut for stream in self._streams.values() for cut in stream.finish()]
        return iter(sorted(cuts, key=attrgetter("offset")))

    @property
    def sure(self) -> bool:
        """Whether one of the open turns will be delivered, whatever comes."""
        return any(stream.worth_a_scan for stream in self._streams.values())

    def _by_sensor(self, radials: Radials) -> Iterator[Iterator[Cut]]:
        for rows in _rows_by_sensor(radials.stream << 16 | radials.sac << 8 | radials.sic):
            row = 0 if rows is None else int(rows[0])
            name = self._name(int(radials.stream[row]), int(radials.sac[row]), int(radials.sic[row]))
            new = name not in self.seen
            if new and len(self.seen) >= MAX_SENSORS:
                yield iter([_refusal(name, self._seq + row, int(radials.offset[row]))])
                continue
            self.seen.setdefault(name)
            if self._only in ("", name, name.partition("@")[0]):
                yield self._stream(name).push(radials, rows, self._seq)

    def _name(self, stream: int, sac: int, sic: int) -> str:
        """The id of a sensor, the same whenever it is asked for."""
        key = stream << 16 | sac << 8 | sic
        if key not in self._names and len(self._names) <= MAX_SENSORS:
            taken = set(self._names.values())
            plain, ends = f"{sac}-{sic}", self._recorded[stream] if stream < len(self._recorded) else Stream()
            there = ends.destination or ends.source or stream
            names = (plain, f"{plain}@{there}", f"{plain}@{ends.source}>{there}")
            self._names[key] = next((one for one in names if one not in taken), f"{plain}@{stream}")
        return self._names.get(key, f"{sac}-{sic}@{stream}")

    def _stream(self, name: str) -> SensorStream:
        if name not in self._streams:
            self._days.append(DayCount(others=self._days[:]))
            free = FREE_SCANS // len(self._days)
            self._streams[name] = SensorStream(name, self._days[-1], free_scans=free, budget=self._budget)
        return self._streams[name]


def _refusal(sensor: str, seq: int, offset: int) -> Cut:
    message = f"more than {MAX_SENSORS} sensors: {sensor} is left out"
    return Cut(seq, offset, None, (Damage("too-many-sensors", offset, message, sensor),))


def _rows_by_sensor(key: IntArray) -> list[IntArray | None]:
    """Rows of each sensor, in order of appearance; None = all rows are of one sensor."""
    if (key == key[0]).all():
        return [None]
    order = np.argsort(key, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(key[order])) + 1)
    groups.sort(key=lambda rows: int(rows[0]))
    return [*groups]
