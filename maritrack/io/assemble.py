"""Radials to turns, for all sensors of an input at once.

Each sensor (SAC, SIC) has a stream of its own (`stream`), which says where its turns end.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from operator import attrgetter

import numpy as np

from maritrack.io.radials import Radials
from maritrack.io.spokes import DayCount
from maritrack.io.stream import Cut, SensorStream
from maritrack.types import Damage, IntArray

MAX_SENSORS = 64


class Assembler:
    """Turns of all sensors of one input, or of one of them."""

    def __init__(self, *, sensor: str = "") -> None:
        self.seen: dict[str, None] = {}  # ids of the sensors in the input, in order of appearance
        self._only = sensor
        self._streams: dict[str, SensorStream] = {}
        self._days: list[DayCount] = []
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
        for rows in _rows_by_sensor(radials.sac * 256 + radials.sic):
            row = 0 if rows is None else int(rows[0])
            name = f"{radials.sac[row]}-{radials.sic[row]}"
            new = name not in self.seen
            if new and len(self.seen) >= MAX_SENSORS:
                yield iter([_refusal(name, self._seq + row, int(radials.offset[row]))])
                continue
            self.seen.setdefault(name)
            if self._only in ("", name):
                yield self._stream(name).push(radials, rows, self._seq)

    def _stream(self, name: str) -> SensorStream:
        if name not in self._streams:
            self._days.append(DayCount(others=self._days[:]))
            self._streams[name] = SensorStream(name, self._days[-1])
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
