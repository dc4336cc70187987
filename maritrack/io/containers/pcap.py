"""Datagrams out of pcap files: times in micro- or nanoseconds, either order of octets, Kuznetzov's long headers.

A file is a header and a chain of records. Where the chain breaks, the next place is searched from which several
plausible records follow each other. Files that were put one behind the other are read as one.
Written from draft-ietf-opsawg-pcap.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from maritrack.io.containers.packets import Packets, Stretch, Tally
from maritrack.io.containers.pcap_records import (
    FILE_HEADER,
    LATEST,
    MAX_PACKET,
    NEAR_S,
    PLAIN,
    Format,
    Search,
    even_records,
    format_at,
    leads_on,
)
from maritrack.io.containers.udp import WINDOW, UdpReader, read_capture
from maritrack.io.datagrams import Datagrams, Stream

EVEN_LEAST, EVEN_MOST = 8, 1024  # records of one size after which it is tried whether many are
ENOUGH = 64  # of them to have been worth it
END, PART, MORE, BAD, GOOD = range(5)  # why records end: no header, no whole packet, not known, no record
TRIAL = 4  # records that show whether a file contradicts itself


@dataclass(slots=True)
class _Found:
    """Records of a stretch."""

    formats: list[tuple[int, Format]]  # each with the number of records before it
    places: list[int] = field(default_factory=list)
    ends: dict[int, int] = field(default_factory=dict)  # of records that have fewer octets than they say


class PcapReader:
    """Reads a pcap file once. Memory: some MiB, and what waits for fragments."""

    def __init__(self, chunks: Iterable[bytes], *, window: int = WINDOW, fast: bool = True) -> None:
        self.streams: list[Stream] = []
        self._chunks, self._window = chunks, window
        self._udp = UdpReader(self.streams, fast=fast)
        self._format = PLAIN
        self._begun = False
        self._lost = -1  # octet of the file where the chain broke, -1 = in step
        self._time_s = -1  # of the last record, -1 = none yet
        self._led_to = -1  # octet of the file up to which the chain of records was followed
        self._search = Search()

    def datagrams(self) -> Iterator[Datagrams]:
        return read_capture(self._chunks, self._walk, self._udp, self._window)

    def _walk(self, w: Stretch, tally: Tally) -> tuple[Packets, int]:
        at = 0
        if not self._begun:
            at = self._begin(w, tally)
        found = _Found([(0, self._format)])
        if self._begun:
            at = self._records(w, at, found, tally)
        return _packets(w, found), at

    def _begin(self, w: Stretch, tally: Tally) -> int:
        """Read the file's header; where its records begin."""
        if w.size < FILE_HEADER:
            if w.final:
                tally.add_one("pcap-cut", 0, "the file ends in its header")
            return w.size if w.final else 0
        self._begun = True
        of = format_at(w.data, 0)
        if of is None:
            tally.add_one("pcap-header", 0, "no pcap header: little-endian, microseconds and Ethernet are assumed")
            self._lost = w.base
            return 0
        self._format = _lax_or_not(w, of, FILE_HEADER)
        return FILE_HEADER

    def _records(self, w: Stretch, at: int, found: _Found, tally: Tally) -> int:
        """Find the records from a place on; where to go on with more of the file."""
        while True:
            if self._lost >= 0:
                at, sure = self._search.next(w, at, self._format, self._time_s)
                if not sure and not w.final:
                    return at
                after = f"the next one {w.base + at - self._lost} octets on" if sure else "none follows"
                tally.add_one("pcap-lost", self._lost - w.base, f"no packet begins here, {after}")
                self._lost = -1
                if not sure:
                    return w.size
                self._time_s = self._format.words.unpack_from(w.data, at)[0]
            n = len(found.places)
            at, why = self._run(w, at, found.places)
            last = found.places[-1] if len(found.places) > n else -1
            if why in (END, MORE) and not w.final:  # it is not yet sure that the last record ends where it says
                return at if last < 0 else found.places.pop()
            if why == END:
                if at < w.size:
                    tally.add_one("pcap-cut", at, "the file ends in the header of a packet")
                return w.size
            if why == PART and not w.final:
                return at
            at = self._cut(w, at, found, tally) if why == PART else self._broken(w, at, last, found, tally)
            if at == last:
                return at

    def _run(self, w: Stretch, at: int, places: list[int]) -> tuple[int, int]:
        """Put in the places of the whole records that follow each other; the place where they end, and why."""
        of, last = self._format, -1
        head, per_s, unpack_from = of.head, of.per_s, of.words.unpack_from
        data, size, append = w.data, w.size, places.append
        same, even, wait = -1, 0, EVEN_LEAST
        early, late = self._near
        while at <= size - head:
            second, fraction, length, full = unpack_from(data, at)
            if length > full or length > MAX_PACKET or fraction >= per_s or not early <= second < late:
                why = self._judge(w, at, last)
                if why != GOOD:
                    return at, why
                early, late = self._near
            after = at + head + length
            if after > size:
                return at, PART
            append(at)
            last, at = at, after
            if length != same:
                same, even = length, 0
                continue
            even += 1
            if even == wait:
                n = even_records(w, at, length, of, early, late)
                if n:
                    places += range(at, at + n * (head + length), head + length)
                    at += n * (head + length)
                    last = at - head - length
                even, wait = 0, EVEN_LEAST if n >= ENOUGH else min(2 * wait, EVEN_MOST)
        return at, END

    @property
    def _near(self) -> tuple[int, int]:
        """Seconds that are about the time of the last record, and no file header; none where no time is known."""
        if self._time_s < 0:
            return 0, 0
        return max(self._time_s - NEAR_S, 1), min(self._time_s + NEAR_S, LATEST)

    def _judge(self, w: Stretch, at: int, last: int) -> int:
        """Whether a record is at a place where the one at `last` (-1 = none) ends, though it looks unlikely."""
        of = self._format
        second = of.words.unpack_from(w.data, at)[0]
        if second >= LATEST and w.size - at < FILE_HEADER and not w.final:
            return MORE
        if not of.plausible(w.data, at) or format_at(w.data, at) is not None:
            return BAD
        jumps = self._time_s >= 0 and abs(second - self._time_s) >= NEAR_S
        if jumps and w.base + at >= self._led_to:
            # The clock was set; or this is no header, and the record before is shorter than it says.
            place, sure = self._inside(w, last, at)
            on = leads_on(w, at, of) if place == at else 0
            if on < 0 or not sure:
                return MORE
            if not on:
                return BAD
            self._led_to = w.base + on
        self._time_s = second
        return GOOD

    def _broken(self, w: Stretch, at: int, last: int, found: _Found, tally: Tally) -> int:
        """Where to go on after a place where a record should be and none is; at `last`, if that needs more octets."""
        other = format_at(w.data, at) if w.size - at >= FILE_HEADER else None
        if other is not None:
            self._format = _lax_or_not(w, other, at + FILE_HEADER)
            self._time_s = self._led_to = -1
            if found.formats[-1][0] == len(found.places):
                found.formats.pop()
            found.formats.append((len(found.places), self._format))
            return at + FILE_HEADER
        place, sure = self._inside(w, last, at)
        if not sure:
            return found.places.pop()
        if place == at:
            self._lost = w.base + at
            return at + 1
        self._shorten(w, last, place, found, tally)
        return place

    def _inside(self, w: Stretch, last: int, at: int) -> tuple[int, bool]:
        """Where the first record inside of the one at `last` begins, `at` if none does; and whether that is sure."""
        if last < 0:
            return at, True
        return self._search.inside(w, last + self._format.head, at, self._format, self._time_s)

    def _cut(self, w: Stretch, at: int, found: _Found, tally: Tally) -> int:
        """The last packet of the file, of which the end is missing, unless its length is wrong."""
        found.places.append(at)
        place, _ = self._inside(w, at, w.size)
        if place < w.size:
            self._shorten(w, at, place, found, tally)
            return place
        found.ends[at] = w.size
        tally.add_one("pcap-cut", at, "the file ends in a packet")
        return w.size

    def _shorten(self, w: Stretch, at: int, end: int, found: _Found, tally: Tally) -> None:
        found.ends[at] = end
        length = self._format.words.unpack_from(w.data, at)[2]
        message = f"a packet of {length} octets, but the next one begins {end - at - self._format.head} octets on"
        tally.add_one("pcap-lost", at, message)


def _lax_or_not(w: Stretch, of: Format, at: int) -> Format:
    """The format, lax where the first records from a place on contradict themselves and follow each other yet."""
    if w.size - at < of.head or of.plausible(w.data, at) or format_at(w.data, at) is not None:
        return of
    lax = replace(of, lax=True)
    for _ in range(TRIAL):
        if at == w.size:
            break
        if w.size - at < of.head or of.plausible(w.data, at) or not lax.plausible(w.data, at):
            return of
        at += of.head + of.words.unpack_from(w.data, at)[2]
    return lax


def _packets(w: Stretch, found: _Found) -> Packets:
    """The records as packets."""
    place = np.array(found.places, dtype=np.int64)
    firsts = [*(n for n, _ in found.formats), len(place)]
    which = np.repeat(np.arange(len(found.formats)), np.diff(firsts))
    big, head, per_s, link = (
        np.array([getattr(of, name) for _, of in found.formats])[which] for name in ("order", "head", "per_s", "link")
    )
    words = w.rows(place, 16).view("<u4")
    big = big == ">"
    words[big] = words[big].byteswap()
    second, fraction, length, full = (words[:, i].astype(np.int64) for i in range(4))
    start = place + head
    end = start + length
    told = np.zeros(len(place), dtype=np.bool_)
    if found.ends:
        rows = np.searchsorted(place, list(found.ends))
        end[rows], told[rows] = np.maximum(list(found.ends.values()), start[rows]), True
    t_ns = second * 10**9 + fraction * (10**9 // per_s)
    return Packets(start, end, np.maximum(full, length), link, t_ns, told)
