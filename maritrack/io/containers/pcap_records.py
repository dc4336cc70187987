"""The records of a pcap file: what their headers look like, and where a chain of them begins.

A record is the time (seconds and a fraction, 4 octets each), the octets captured (4), the octets that were on the
wire (4) and the packet. In Kuznetzov's variant 8 more octets stand before the packet.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field
from functools import lru_cache
from struct import Struct

import numpy as np

from maritrack.io.containers.packets import Stretch
from maritrack.types import IntArray

FILE_HEADER = 24
MICRO, NANO, LONG = 0xA1B2C3D4, 0xA1B23C4D, 0xA1B2CD34
WORDS = {order: Struct(order + "4I") for order in "<>"}
FILE_WORDS = {order: Struct(order + "I2H4I") for order in "<>"}
MAGIC = {Struct(order + "I").pack(magic): order for order in "<>" for magic in (MICRO, NANO, LONG)}
MAX_PACKET = 262_144  # octets captured: what libpcap allows
MAX_FULL = 1 << 20  # octets on the wire of a packet that is searched for
LATEST = 0xA1B20000  # second from which on a record may be the header of another file
CHAIN, LONG_CHAIN = 4, 8  # records that must follow each other, the latter where their time is far away
NEAR_S = 366 * 86_400
NONE, MAYBE, NEAR, FAR = range(4)  # whether a chain begins: no, not known, yes, yes at another time
SPAN = 32_768  # places that are searched at once


@dataclass(frozen=True, slots=True)
class Format:
    """What the header of a file says."""

    order: str  # "<" or ">"
    head: int  # octets of a record's header
    per_s: int  # units of the fraction of a second
    link: int
    lax: bool = False  # its records contradict themselves: only their lengths are looked at

    @property
    def words(self) -> Struct:
        """The four numbers of a record's header."""
        return WORDS[self.order]

    def plausible(self, data: bytes, at: int) -> bool:
        """Whether the header of a record may be at a place."""
        second, fraction, length, full = self.words.unpack_from(data, at)
        if length > MAX_PACKET or not (full or second):
            return False
        return self.lax or (length <= full and fraction < self.per_s)


PLAIN = Format("<", 16, 10**6, 1)


def format_at(data: bytes, at: int) -> Format | None:
    """The format of the file whose header is at a place, None where none is."""
    return _format(data[at : at + FILE_HEADER]) if data[at : at + 4] in MAGIC else None


@lru_cache(maxsize=64)
def _format(header: bytes) -> Format | None:
    order = MAGIC[header[:4]]
    magic, major, _, _, _, _, link = FILE_WORDS[order].unpack(header)
    if major != 2:
        return None
    return Format(order, 24 if magic == LONG else 16, 10**9 if magic == NANO else 10**6, link & 0xFFFF)


def even_records(w: Stretch, at: int, length: int, of: Format, early: int, late: int) -> int:
    """How many whole plausible records of `length` octets and seconds in [early, late) follow each other."""
    step = of.head + length
    n = (w.size - at) // step
    if n <= 0 or of.lax:
        return 0
    heads = np.ndarray((n,), dtype="V16", buffer=w.data, offset=at, strides=(step,)).copy()
    words = heads.view(of.order + "u4").reshape(n, 4)
    good = (words[:, 2] == length) & (words[:, 3] >= length) & (words[:, 1] < of.per_s)
    good &= (words[:, 0] >= early) & (words[:, 0] < late)
    return n if good.all() else int(np.argmin(good))


def leads_on(w: Stretch, at: int, of: Format) -> int:
    """Where the last of a few plausible records ends that follow each other from a place on, or up to the end.

    0 = they don't, -1 = more must tell.
    """
    unpack_from, head, per_s = of.words.unpack_from, of.head, 1 << 32 if of.lax else of.per_s
    for _ in range(LONG_CHAIN):
        if at > w.size - head:
            return at if w.final else -1
        second, fraction, length, full = unpack_from(w.data, at)
        if length > MAX_PACKET or not (full or second) or fraction >= per_s or (length > full and not of.lax):
            return 0
        at += head + length
    return at


@dataclass(slots=True)
class Search:
    """Looks for places where a chain of records begins, and keeps what it found for the next question."""

    _of: tuple[Stretch | None, Format] = (None, PLAIN)
    _low: int = 0  # places between these have been looked at
    _high: int = 0
    _places: list[int] = field(default_factory=list)
    _verdicts: list[int] = field(default_factory=list)

    def next(self, w: Stretch, at: int, of: Format, time_s: int) -> tuple[int, bool]:
        """The first place from `at` on where a chain begins, and True; or False, where more octets must tell.

        Records are likelier at about the time `time_s` (-1 = not known).
        """
        place, verdict = self._find(w, at, w.size, of, time_s, worst=FAR)
        return place, verdict > MAYBE

    def inside(self, w: Stretch, at: int, end: int, of: Format, time_s: int) -> tuple[int, bool]:
        """The same for chains at about that time that begin before `end`; `end` where none does."""
        place, verdict = self._find(w, at, end, of, time_s, worst=NEAR)
        return (place, verdict > MAYBE) if verdict and place < end else (end, True)

    def _find(self, w: Stretch, at: int, end: int, of: Format, time_s: int, *, worst: int) -> tuple[int, int]:
        limit = w.size - of.head + 1
        if self._of[0] is not w or self._of[1] is not of:
            self._of, self._low, self._high = (w, of), 0, 0
        end = min(end, limit)
        while at < end:
            if not self._low <= at < self._high:
                self._look(w, at, min(at + SPAN, limit), of, time_s)
            for i in range(bisect_left(self._places, at), len(self._places)):
                if self._verdicts[i] <= worst:
                    return self._places[i], self._verdicts[i]
            at = self._high
        return at, NONE

    def _look(self, w: Stretch, low: int, high: int, of: Format, time_s: int) -> None:
        start, end, verdict = _chains(w, low, min(high + SPAN, w.size - of.head + 1), of, time_s)
        near = np.append(start[verdict == NEAR], w.size)
        inside = near[np.searchsorted(near[:-1], start, side="right")] < end
        keep = (start < high) & ~(inside & (verdict == FAR))
        self._low, self._high = low, high
        self._places, self._verdicts = start[keep].tolist(), verdict[keep].tolist()


def _chains(w: Stretch, low: int, high: int, of: Format, time_s: int) -> tuple[IntArray, IntArray, IntArray]:
    """The places of [low, high) where chains of records begin, the ends of these chains, and a verdict on each.

    Far chains need not be believed where a near one begins inside: in a header that is read 4 octets too late a
    fraction passes for a second and a length for a fraction, and the next record is 4 octets late again.
    """
    u8 = np.frombuffer(w.data, dtype=np.uint8)
    first = 11 if of.order == "<" else 8  # octet of the length that is 0 at any rate
    start = low + np.flatnonzero((u8[low + first : high + first] | u8[low + first + 4 : high + first + 4]) == 0)
    verdict, end = np.zeros(len(start), dtype=np.int64), start.copy()
    left = np.arange(len(start))
    need = np.full(len(start), LONG_CHAIN)
    for n in range(1, LONG_CHAIN + 1):
        here = end[left]
        words = w.rows(here, 16).view(of.order + "u4").astype(np.int64)
        second, length, full = words[:, 0], words[:, 2], words[:, 3]
        good = (length <= MAX_PACKET) & (full <= MAX_FULL) & (full + second > 0)
        if not of.lax:
            good &= (length <= full) & (words[:, 1] < of.per_s)
            near = (np.abs(second - time_s) < NEAR_S) | (time_s < 0)
            good &= near | (second > NEAR_S)  # small numbers are everywhere
            need[left[near]] = CHAIN
        left, here = left[good], (here + of.head + length)[good]
        end[left] = here
        beyond = here > w.size - of.head
        if w.final:
            verdict[left[((here == w.size) if n == 1 else beyond) & (need[left] == CHAIN)]] = NEAR
        else:
            verdict[left[beyond]] = MAYBE
        done = left[(need[left] <= n) & (verdict[left] != NEAR)]
        verdict[done] = np.where(need[done] == CHAIN, NEAR, FAR)
        left = left[(verdict[left] == 0) & ~beyond]
        if len(left) == 0:
            break
    found = np.flatnonzero(verdict)
    return start[found], end[found], verdict[found]
