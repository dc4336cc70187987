"""Datagrams out of pcapng files: several sections and interfaces, either order of octets, any resolution of times.

Where a length can't be, the next block is searched that says its length twice. Written from
draft-ietf-opsawg-pcapng.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from maritrack.io.containers.packets import Packets, Stretch, Tally
from maritrack.io.containers.pcapng_blocks import (
    ASSUMED,
    HEADS,
    INTERFACE,
    LEAST,
    MAGIC,
    MAX_BLOCK,
    OLD_PACKET,
    PACKET,
    PACKET_BLOCKS,
    SECTION,
    SIMPLE_PACKET,
    WORDS,
    Interface,
    Search,
    even_packets,
    interface_at,
    order_at,
)
from maritrack.io.containers.udp import WINDOW, UdpReader, read_capture
from maritrack.io.datagrams import NO_TIME, Datagrams, Stream
from maritrack.types import IntArray

EVEN_LEAST, EVEN_MOST = 8, 1024  # blocks of one size after which it is tried whether many are
ENOUGH = 64  # of them to have been worth it
MAX_INTERFACES = 65_536  # of a section
LATEST_S = (1 << 63) // 10**9  # first second that doesn't fit into nanoseconds
MOST_OFFSET_S = 1 << 40
NANO = 9  # the resolution of nanoseconds
HEADER = 28  # octets before the packet, and before the interface's times end
ORDERS = "<>"


@dataclass(slots=True)
class _Found:
    """Packet blocks of a stretch, and what their sections say."""

    places: list[int] = field(default_factory=list)
    cut: bool = False  # the last is cut by the end of the file
    table: list[Interface] = field(default_factory=list)
    scopes: list[tuple[int, int, int, int]] = field(default_factory=list)
    # Each with the number of blocks before it: first interface of the section in the table, how many, order.


class PcapngReader:
    """Reads a pcapng file once. Memory: some MiB, and what waits for fragments."""

    def __init__(self, chunks: Iterable[bytes], *, window: int = WINDOW, fast: bool = True) -> None:
        self.streams: list[Stream] = []
        self._chunks, self._window = chunks, window
        self._udp = UdpReader(self.streams, fast=fast)
        self._order = ""  # of octets in the section, "" = no section yet
        self._interfaces: list[Interface] = []  # of the section
        self._lost = -1  # octet of the file where the chain of blocks broke, -1 = in step
        self._search = Search()

    def datagrams(self) -> Iterator[Datagrams]:
        return read_capture(self._chunks, self._walk, self._udp, self._window)

    def _walk(self, w: Stretch, tally: Tally) -> tuple[Packets, int]:
        found = _Found(table=list(self._interfaces))
        self._scope(found, 0)
        end = self._blocks(w, found, tally)
        self._interfaces = found.table[found.scopes[-1][1] :]
        return _packets(w, found, tally), end

    def _scope(self, found: _Found, first: int) -> None:
        found.scopes.append((len(found.places), first, len(found.table) - first, ORDERS.find(self._order)))

    def _blocks(self, w: Stretch, found: _Found, tally: Tally) -> int:
        """Find the blocks; where to go on with more of the file."""
        at = 0
        while True:
            if self._lost >= 0:
                at, sure = self._search.next(w, at, self._order)
                if not sure and not w.final:
                    return at
                after = f"the next one {w.base + at - self._lost} octets on" if sure else "none follows"
                tally.add_one("pcap-lost", self._lost - w.base, f"no block begins here, {after}")
                self._lost = -1
                if not sure:
                    return w.size
                if not self._order:
                    self._order = order_at(w, at)
                    self._scope(found, found.scopes[-1][1])
            at = self._run(w, at, found, tally)
            if w.size - at < LEAST:
                if w.final and at < w.size:
                    tally.add_one("pcap-cut", at, "the file ends in the header of a block")
                return w.size if w.final else at
            kind, length = self._head(w, at)
            if LEAST <= length <= MAX_BLOCK and length % 4 == 0 and at + length > w.size:
                if not w.final:
                    return at
                if not self._search.next(w, at + LEAST, self._order)[1]:
                    self._cut(at, kind, length, found, tally)
                    return w.size
            self._lost, at = w.base + at, at + 1

    def _run(self, w: Stretch, at: int, found: _Found, tally: Tally) -> int:
        """Take the whole blocks that follow each other; the place where they end."""
        places, data, size = found.places, w.data, w.size
        head, word = HEADS[self._order or "<"], WORDS[self._order or "<"]
        same, even, wait = -1, 0, EVEN_LEAST
        while at <= size - LEAST:
            kind, length = head.unpack_from(data, at)
            if kind == SECTION:
                order = MAGIC.get(data[at + 8 : at + 12], "")
                if not order:
                    break
                head, word = HEADS[order], WORDS[order]
                length = head.unpack_from(data, at)[1]
            after = at + length
            if length & 3 or length < LEAST or length > MAX_BLOCK or after > size:
                break
            if word.unpack_from(data, after - 4)[0] != length or (not self._order and kind != SECTION):
                break
            if kind != PACKET:
                self._take_other(w, at, kind, length, found, tally)
                at = after
                continue
            places.append(at)
            at = after
            if length != same:
                same, even = length, 0
                continue
            even += 1
            if even == wait:
                n = even_packets(w, at, length, self._order)
                places += range(at, at + n * length, length)
                at += n * length
                even, wait = 0, EVEN_LEAST if n >= ENOUGH else min(2 * wait, EVEN_MOST)
        return at

    def _head(self, w: Stretch, at: int) -> tuple[int, int]:
        """Type and length of the block at a place, in the order of octets that holds there."""
        order = self._order or "<"
        kind, length = HEADS[order].unpack_from(w.data, at)
        if kind == SECTION:
            order = MAGIC.get(w.data[at + 8 : at + 12], order)
            length = WORDS[order].unpack_from(w.data, at + 4)[0]
        return kind, length

    def _take_other(self, w: Stretch, at: int, kind: int, length: int, found: _Found, tally: Tally) -> None:
        """A block that is no usual packet."""
        if kind == SECTION:
            self._order = MAGIC[w.data[at + 8 : at + 12]]
            self._scope(found, len(found.table))
        elif kind == INTERFACE and length >= 20:
            first = found.scopes[-1][1]
            if len(found.table) - first < MAX_INTERFACES:
                found.table.append(interface_at(w.data, at, length, self._order))
                self._scope(found, first)
            else:
                tally.add_one("too-many-interfaces", at, f"more than {MAX_INTERFACES} interfaces")
        elif kind in PACKET_BLOCKS:
            found.places.append(at)

    def _cut(self, at: int, kind: int, length: int, found: _Found, tally: Tally) -> None:
        """The last block of the file, of which the end is missing."""
        tally.add_one("pcap-cut", at, f"the file ends in a block of {length} octets")
        if kind in PACKET_BLOCKS and self._order:
            found.places.append(at)
            found.cut = True


def _packets(w: Stretch, found: _Found, tally: Tally) -> Packets:
    """The packet blocks as packets."""
    place = np.array(found.places, dtype=np.int64)
    scopes = np.array(found.scopes, dtype=np.int64)
    scope = np.repeat(np.arange(len(scopes)), np.diff(scopes[:, 0], append=len(place)))
    words = w.rows(place, HEADER).view("<u4")
    big = scopes[scope, 3] == ORDERS.index(">")
    if big.any():
        words[big] = words[big].byteswap()
    kind, length, number, high, low, held, full = (words[:, i].astype(np.int64) for i in range(7))
    start, timed = place + HEADER, np.ones(len(place), dtype=np.bool_)
    old, simple = kind == OLD_PACKET, kind == SIMPLE_PACKET
    number[old] = np.where(big[old], number[old] >> 16, number[old] & 0xFFFF)
    if simple.any():
        full[simple], number[simple], timed[simple] = number[simple], 0, False
        start[simple] = place[simple] + 12
    interface, table = _interfaces(place, number, scopes[scope], found.table, tally)
    if simple.any():
        snaplen = np.array([one.snaplen or MAX_BLOCK for one in table])[interface[simple]]
        held[simple] = np.minimum(np.minimum(full[simple], snaplen), np.maximum(length[simple] - 16, 0))
    end = place + length - 4
    told = start + held > end
    tally.add("packet-length", place[told], "a packet longer than its block")
    if found.cut:
        end[-1], told[-1] = w.size, start[-1] + held[-1] > w.size
    end = np.minimum(start + held, end)
    short = end < start
    end[short] = start[short] = np.minimum(start[short], w.size)
    t_ns = _times(high, low, table, interface)
    t_ns[~timed] = NO_TIME
    tally.add("packet-time", place[timed & (t_ns == NO_TIME)], "a time that can't be")
    link = np.array([one.link for one in table], dtype=np.int64)[interface]
    return Packets(start, end, np.maximum(full, held), link, t_ns, told)


def _interfaces(
    place: IntArray, number: IntArray, scope: IntArray, table: list[Interface], tally: Tally
) -> tuple[IntArray, list[Interface]]:
    """The interface of each packet as an index into the table that is returned too.

    A packet whose interface is not known is taken for one of the first of its section, or of Ethernet.
    """
    first, count = scope[:, 1], scope[:, 2]
    unknown = number >= count
    tally.add("no-interface", place[unknown], "a packet of an interface that was not described: the first is assumed")
    index = first + np.where(unknown, 0, number)
    index[count == 0] = len(table)
    return index, [*table, ASSUMED]


def _times(high: IntArray, low: IntArray, table: list[Interface], interface: IntArray) -> IntArray:
    """Time of each packet in nanoseconds, NO_TIME where it can't be told."""
    units = high.astype(np.uint64) << np.uint64(32) | low.astype(np.uint64)
    second, rest_ns = np.zeros(len(units), dtype=np.int64), np.zeros(len(units), dtype=np.int64)
    used, which = np.unique(interface, return_inverse=True)
    resolution = np.array([table[i].resolution for i in used.tolist()], dtype=np.int64)[which]
    for one in np.unique(resolution).tolist():
        rows = np.flatnonzero(resolution == one)
        second[rows], rest_ns[rows] = _seconds(units[rows], one)
    shift = [max(-MOST_OFFSET_S, min(table[i].offset_s, MOST_OFFSET_S)) for i in used.tolist()]
    fits = second < LATEST_S
    second += np.array(shift, dtype=np.int64)[which]
    fits &= np.abs(second) < LATEST_S
    t_ns: IntArray = np.where(fits, second, 0) * 10**9 + rest_ns
    t_ns[~fits] = NO_TIME
    return t_ns


def _seconds(units: NDArray[np.uint64], resolution: int) -> tuple[IntArray, IntArray]:
    """Whole seconds, at most LATEST_S, and nanoseconds beyond them, of times in units of a resolution."""
    if resolution <= NANO:
        per_s = np.uint64(10**resolution)
        second, rest = units // per_s, units % per_s * np.uint64(10 ** (NANO - resolution))
        return np.minimum(second, LATEST_S).astype(np.int64), rest.astype(np.int64)
    per_s_exact = 1 << (resolution - 128) if resolution >= 128 else 10**resolution
    pairs = [divmod(one, per_s_exact) for one in units.tolist()]
    seconds = np.array([min(second, LATEST_S) for second, _ in pairs], dtype=np.int64)
    return seconds, np.array([rest * 10**9 // per_s_exact for _, rest in pairs], dtype=np.int64)
