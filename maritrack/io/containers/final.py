"""EUROCONTROL FINAL, also called IOSS: radar data with the time and the line they came in on.

A record is LEN (2, all of the record), board (1), line (1), recording day (1), time (3, 1/100 s since midnight), the
data blocks and A5 A5 A5 A5; numbers are big-endian. The variant ioss_seq has a sequence number (4) after LEN.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from itertools import count
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from maritrack.io.containers.final_walk import (
    FOOTER,
    HEAD,
    LEAP_CS,
    MAX_RECORD,
    NO_TIME_CS,
    PLAIN,
    Found,
    layout_of,
    walk,
)
from maritrack.io.containers.pull import even_pieces
from maritrack.io.datagrams import NO_TIME, Datagrams, Stream
from maritrack.io.times import DAY_NS
from maritrack.types import Damage, IntArray

HALF_DAY_CS = 4_320_000
OUT_OF_ORDER_CS = 8_280_000  # 23 hours: a record of just before midnight after one of just after it
CS_NS = 10**7
NAME = re.compile(r"board-(\d{1,3})-line-(\d{1,3})")
LINES = 1 << 16  # boards times lines


def looks_final(head: bytes) -> bool:
    """Whether the first octets of a file (64 KiB are enough) are FINAL's, maybe damaged."""
    return layout_of(head[:HEAD]) != 0


class FinalReader:
    """Reads FINAL, one stream for each board and line: Stream("board-1-line-2", "").

    Times count from the midnight before the first record, because a recording day has no date: a step of the day
    counts as that many days (modulo 256, less than 128 either way), and within an unchanged day a step back of more
    than 12 hours is the next midnight. A record that tells no time of day has NO_TIME. Records that are in no
    order of time stay in the order of the file; sequence numbers are not looked at.
    """

    def __init__(self, chunks: Iterable[bytes]) -> None:
        self.streams: list[Stream] = []
        self._chunks = chunks
        self._index = np.full(LINES, -1, dtype=np.int64)  # of the stream, by board and line
        self._days = _Days()
        self._layout = 0
        self._lost: int | None = None  # octet of the file where the chain of records broke

    def datagrams(self) -> Iterator[Datagrams]:
        rest, base = b"", 0
        for piece in even_pieces(self._chunks):
            data = rest + piece
            found = self._walk(data, base, final=False)
            yield self._deliver(data, base, found)
            rest, base = data[found.end :], base + found.end
        yield self._deliver(rest, base, self._walk(rest, base, final=True))

    def _walk(self, data: bytes, base: int, *, final: bool) -> Found:
        self._layout = self._layout or layout_of(data[:HEAD]) or PLAIN
        lost = None if self._lost is None else self._lost - base
        found = walk(data, self._layout, final=final, lost=lost)
        self._lost = None if found.lost is None else base + found.lost
        return found

    def _deliver(self, data: bytes, base: int, found: Found) -> Datagrams:
        u8 = np.frombuffer(data, dtype=np.uint8)
        begin = np.array(found.starts, dtype=np.int64) + self._layout
        end = np.array(found.ends, dtype=np.int64) - len(FOOTER)
        view = memoryview(data)
        time_cs = _number(u8, begin - 3, 3)
        odd = np.flatnonzero((time_cs >= LEAP_CS) & (time_cs != NO_TIME_CS))
        if len(odd):
            found.tell("final-time", int(begin[odd[0]]) - 3, "a time of day beyond 24 hours", count=len(odd))
        return Datagrams(
            end=base + found.end,
            data=b"".join(view[a:b] for a, b in zip(begin.tolist(), end.tolist(), strict=True)),
            bounds=np.concatenate([[0], np.cumsum(end - begin)]), offset=base + begin,
            t_ns=self._days.times(_number(u8, begin - 4, 1), time_cs), stream=self._streams(_number(u8, begin - 6, 2)),
            damage=tuple(Damage(one.code, base + one.at, one.message, count=one.count) for one in found.troubles()),
        )  # fmt: skip

    def headers(self, line_day: IntArray, time_cs: IntArray) -> tuple[IntArray, IntArray]:
        """Receive times and streams of the next records, of board, line and day as one number and the time of day."""
        return self._days.times(line_day & 255, time_cs), self._streams(line_day >> 8)

    def _streams(self, line: IntArray) -> IntArray:
        """Index of the stream of each record, of its board and line as one number."""
        new = line[self._index[line] < 0]
        _, where = np.unique(new, return_index=True)
        for one in new[np.sort(where)].tolist():
            self._index[one] = len(self.streams)
            self.streams.append(Stream(f"board-{one >> 8}-line-{one & 255}"))
        return self._index[line]


class FinalWriter:
    """Writes FINAL to an open file, without sequence numbers.

    A stream that FinalReader named keeps its board and line, others get those that are free, from board 0 line 1
    on. Times are cut to 1/100 s; the days since the first time are counted modulo 256, from 1 on. NO_TIME is
    written as FF FF FF, later than any time of day. Doesn't fit: a payload of more than 65,523 octets.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._lines: dict[Stream, bytes] = {}
        self._taken: set[bytes] = set()
        self._numbers = count(1)
        self._first_day: int | None = None
        self._day = 1

    def write(self, payload: bytes, *, t_ns: int, stream: Stream) -> bool:
        length = PLAIN + len(payload) + len(FOOTER)
        line = self._lines.get(stream) or self._line(stream)
        if length > MAX_RECORD or not line:
            return False
        time_cs = NO_TIME_CS
        if t_ns != NO_TIME:
            day, rest_ns = divmod(t_ns, DAY_NS)
            self._first_day = day if self._first_day is None else self._first_day
            self._day, time_cs = (day - self._first_day + 1) % 256, rest_ns // CS_NS
        head = (((length << 16 | int.from_bytes(line, "big")) << 8 | self._day) << 24 | time_cs).to_bytes(8, "big")
        self._file.write(b"".join((head, payload, FOOTER)))
        return True

    def flush(self) -> None:
        self._file.flush()

    def finish(self) -> None:
        """Nothing: FINAL ends where the file does."""

    def _line(self, stream: Stream) -> bytes:
        """Board and line of a new stream; none where all are taken."""
        if len(self._taken) == LINES - 1:
            return b""
        told = NAME.fullmatch(stream.source)
        line = bytes(min(int(number), 255) for number in told.groups()) if told else b"\0\0"
        while line in self._taken or line == b"\0\0":
            line = (next(self._numbers) % LINES).to_bytes(2, "big")
        self._taken.add(line)
        self._lines[stream] = line
        return line


class _Days:
    """Counts the midnights between records from their recording day and time of day."""

    def __init__(self) -> None:
        self._last: tuple[int, int] | None = None  # day and time of the record before
        self._count = 0  # of midnights since the first record
        self._unsaid = 0  # of these: those that the recording day doesn't tell

    def times(self, day: IntArray, time_cs: IntArray) -> IntArray:
        """Nanoseconds since the midnight before the first record, NO_TIME where there is no time of day."""
        t_ns = np.full(len(day), NO_TIME, dtype=np.int64)
        rows = np.flatnonzero(time_cs < LEAP_CS)
        if len(rows) == 0:
            return t_ns
        day, time_cs = day[rows], time_cs[rows]
        before = self._last or (int(day[0]), int(time_cs[0]))
        step = (np.diff(day, prepend=before[0]) + 128) % 256 - 128
        jump = np.diff(time_cs, prepend=before[1])
        for i in np.flatnonzero((step == 0) & (np.abs(jump) > HALF_DAY_CS)).tolist():
            if jump[i] < 0 or (jump[i] > OUT_OF_ORDER_CS and self._unsaid):
                step[i] = 1 if jump[i] < 0 else -1
                self._unsaid += int(step[i])
        midnights = self._count + np.cumsum(step)
        self._last, self._count = (int(day[-1]), int(time_cs[-1])), int(midnights[-1])
        t_ns[rows] = midnights * DAY_NS + time_cs * CS_NS
        return t_ns


def _number(u8: NDArray[np.uint8], at: IntArray, octets: int) -> IntArray:
    """Big-endian numbers at the places."""
    number = u8[at].astype(np.int64)
    for i in range(1, octets):
        number = number << 8 | u8[at + i]
    return number
