"""The data blocks in the packets of a capture file, for `headers`: captures as they should be.

That is one interface, whole IPv4 packets without options and fragments, and datagrams that are filled with data
blocks of category 240, or belong to streams that never have any. Everything else is for the general reader.
"""

from __future__ import annotations

from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maritrack.io.cat240.blockstarts import NONE, U8, Frames
from maritrack.io.cat240.framing import CAT240, HEADER
from maritrack.io.cat240.headers import Blocks, Columns, gather, picked
from maritrack.io.containers.packets import FRAMED, KIND, RAW_IP, UDP, UDP_HEADER
from maritrack.io.containers.pcap_records import FILE_HEADER, LATEST, MAX_PACKET, NEAR_S, format_at
from maritrack.io.containers.pcapng_blocks import INTERFACE, MAGIC, PACKET, SECTION, interface_at
from maritrack.io.datagrams import Stream
from maritrack.types import BoolArray, IntArray

IP_HEADER = 20
PLAIN_IP = 0x45  # version 4, no options
FRAGMENT = 0x3FFF  # bits that are 0 in a whole packet
MAX_STREAMS = 64
MAX_LEVELS = 64  # data blocks of a datagram
UNIT_NS = {6: 1000, 9: 1}  # of a pcapng interface's resolution
LATEST_UNITS = 1 << 31  # times 2**32 ns: no later times
QUIET = (4, 5)  # pcapng blocks of names and of statistics
PCAP_HEAD, PCAPNG_HEAD = 16, 28  # octets before a packet
PCAP = {"second": 0, "fraction": 4, "length": 8, "full": 12}
PCAPNG = {"kind": 0, "total": 4, "interface": 8, "high": 12, "low": 16, "length": 20, "full": 24}


def packet_make(head: bytes) -> tuple[PacketMake, int] | None:
    """What reads the capture that begins so, and where its packets begin; None where nothing here can."""
    if head[:4] == SECTION.to_bytes(4, "big"):
        return _pcapng(head)
    of = format_at(head, 0) if len(head) >= FILE_HEADER else None
    if of is None or of.head != PCAP_HEAD or not _is_known(of.link):
        return None
    return PacketMake(of.order, of.link, unit_ns=10**9 // of.per_s, ng=False), FILE_HEADER


def _pcapng(head: bytes) -> tuple[PacketMake, int] | None:
    """The same for pcapng: a section with one interface, then packets."""
    order, at, interface = MAGIC.get(head[8:12], ""), 0, None
    while order and at + 12 <= len(head):
        kind, length = Struct(order + "II").unpack_from(head, at)
        if kind == PACKET:
            break
        if length < 12 or length % 4 or at + length > len(head) or (kind == SECTION) != (at == 0):
            return None
        if head[at + length - 4 : at + length] != head[at + 4 : at + 8] or kind not in (SECTION, INTERFACE, *QUIET):
            return None
        if kind == INTERFACE and (interface is not None or length < 20):
            return None
        interface = interface_at(head, at, length, order) if kind == INTERFACE else interface
        at += length
    if interface is None or not _is_known(interface.link):
        return None
    if interface.resolution not in UNIT_NS or interface.offset_s or at + 12 > len(head):
        return None
    return PacketMake(order, interface.link, unit_ns=UNIT_NS[interface.resolution], ng=True), at


def _is_known(link: int) -> bool:
    return link in FRAMED or link in RAW_IP


class PacketMake:
    """The packets of a capture of one interface. Its streams are those that have appeared."""

    def __init__(self, order: str, link: int, *, unit_ns: int, ng: bool) -> None:
        self.streams: list[Stream] = []
        self.counts: list[int] = []  # datagrams of each
        self.holds: list[bool] = []  # its datagrams are data blocks
        self._numbers: dict[bytes, int] = {}
        self._order, self._unit_ns, self._ng = order, unit_ns, ng
        self._near = -1  # second of the first packet
        self._looked_at = NONE, NONE  # the last datagrams: frames and streams
        self._again: list[int] = []  # datagrams of each stream that may be read again
        where, behind = FRAMED.get(link, (-1, 0))
        head = PCAPNG_HEAD if ng else PCAP_HEAD
        self._ip = head + behind
        self._head = _head(order, PCAPNG if ng else PCAP, self._ip, head + where if where >= 0 else -1)
        marks = (self._ip, self._ip + 9)  # version and protocol of IP
        self.frames = Frames(f"{order}u4", *((4, 0, 12) if ng else (8, PCAP_HEAD, PCAP_HEAD)), marks)

    def holding(self) -> frozenset[Stream]:
        """Streams whose datagrams were data blocks."""
        return frozenset(s for s, n, holds in zip(self.streams, self.counts, self.holds, strict=True) if holds and n)

    def others(self, *, whole: bool) -> list[tuple[Stream, int]]:
        """Streams without CAT240, and how many datagrams each had in the whole file, or before what is read again."""
        again = [*([] if whole else self._again), *[0] * len(self.streams)]
        return [
            (stream, n - again[i])
            for i, (stream, n, holds) in enumerate(zip(self.streams, self.counts, self.holds, strict=True))
            if n and not holds
        ]

    def blocks(self, octets: U8, size: int, starts: IntArray) -> Blocks:
        """The data blocks of the packets that begin at `starts`."""
        head = gather(octets, starts[:-1], self._head)
        h: Columns = {name: head[name].astype(np.int64) for name in head.dtype.names or () if name != "key"}
        udp, passed = self._udp(h)
        good = udp | passed
        good &= self._sound_ng(h, octets, starts) if self._ng else self._sound(h)
        if self._ng and (h["kind"] != PACKET).any():
            quiet = np.isin(h["kind"], QUIET) & self._is_block(h, octets, starts)
            good, udp = np.where(h["kind"] == PACKET, good, quiet), udp & (h["kind"] == PACKET)
        frames = len(good) if good.all() else int(np.argmin(good))
        rows = np.flatnonzero(udp[:frames])
        begin = picked(starts[:-1], rows) + (self._ip + IP_HEADER + UDP_HEADER)
        end = begin + picked(h["udp_length"], rows) - UDP_HEADER
        stream = self._number(picked(head["key"], rows))
        kept = self._of_one_kind(octets, begin, end, stream)
        frames = frames if kept == len(rows) else int(rows[kept])
        self._looked_at = rows, stream
        held = np.flatnonzero(np.array(self.holds, dtype=np.bool_)[stream[:kept]])
        row, begin, end, bad = _data_blocks(octets, picked(begin, held), picked(end, held))
        frame = picked(picked(rows, held), row)
        if bad >= 0:
            frames = int(rows[held[bad]])
            inside = frame < frames
            row, frame, begin, end = row[inside], frame[inside], begin[inside], end[inside]
        return Blocks(frames, frame, begin, end, picked(self._t_ns(h), frame), picked(picked(stream, held), row))

    def told(self, frames: int, again: int) -> None:
        """Of the frames that were looked at last so many are done with; some, from `again` on, may be read again."""
        rows, stream = self._looked_at
        first, last = np.searchsorted(rows, [again, frames]).tolist()
        for one, n in enumerate(np.bincount(stream[:last]).tolist()):
            self.counts[one] += n
        self._again = np.bincount(stream[first:last], minlength=len(self.streams)).tolist()

    def _sound(self, h: Columns) -> BoolArray:
        """Which records of a pcap file say nothing strange."""
        second = h["second"]
        if self._near < 0 and len(second):
            self._near = int(second[0])
        low, high = max(self._near - NEAR_S, 1), min(self._near + NEAR_S, LATEST)
        good = (h["length"] == h["full"]) & (h["length"] <= MAX_PACKET) & (second >= low) & (second < high)
        return np.asarray(good & (h["fraction"] < 10**9 // self._unit_ns))

    def _sound_ng(self, h: Columns, octets: U8, starts: IntArray) -> BoolArray:
        """Which packet blocks of a pcapng file say nothing strange."""
        good = self._is_block(h, octets, starts) & (h["interface"] == 0) & (h["length"] == h["full"])
        good &= PCAPNG_HEAD + (h["length"] + 3 & ~3) + 4 <= h["total"]
        return np.asarray(good & (h["high"] < LATEST_UNITS // self._unit_ns))

    def _is_block(self, h: Columns, octets: U8, starts: IntArray) -> BoolArray:
        """Which blocks of a pcapng file say their length twice."""
        again = gather(octets, starts[1:] - 4, np.dtype([("total", f"{self._order}u4")]))["total"]
        return np.asarray((h["total"] == again) & (h["total"] & 3 == 0))

    def _udp(self, h: Columns) -> tuple[BoolArray, BoolArray]:
        """Which packets are whole UDP datagrams, and which of the others are whole and neither UDP nor IPv6."""
        there = h["length"] - (self._ip - (PCAPNG_HEAD if self._ng else PCAP_HEAD))
        version, ip_length = h["first"] >> 24, h["first"] & 0xFFFF
        plain = (version == PLAIN_IP) & (h["flow"] >> 16 & FRAGMENT == 0) & (ip_length <= there)
        if "type" in h:
            plain &= h["type"] == 0x0800
        is_udp = h["flow"] & 0xFF == UDP
        udp = plain & is_udp & (ip_length == h["udp_length"] + IP_HEADER) & (ip_length >= IP_HEADER + UDP_HEADER)
        if udp.all():
            return udp, udp
        passed = plain & ~is_udp & (ip_length >= IP_HEADER)
        if "type" in h:
            passed |= (KIND[h["type"]] == 0) & (there >= 0)
        return udp, passed

    def _t_ns(self, h: Columns) -> IntArray:
        """Receive times."""
        if self._ng:
            return np.asarray((h["high"] << 32 | h["low"]) * self._unit_ns)
        return np.asarray(h["second"] * 10**9 + h["fraction"] * self._unit_ns)

    def _number(self, key: NDArray[np.void]) -> IntArray:
        """Index of the stream of each datagram, -1 = too many."""
        words = np.ascontiguousarray(key).view("<u4").reshape(-1, 3)
        index, left = np.full(len(key), -1, dtype=np.int64), np.arange(len(key))
        while len(left):
            first = words[left[0]]
            same = (words[left, 0] == first[0]) & (words[left, 1] == first[1]) & (words[left, 2] == first[2])
            name = first.tobytes()
            if name not in self._numbers:
                if len(self.streams) == MAX_STREAMS:
                    break
                self._numbers[name] = len(self.streams)
                self.streams.append(Stream(_endpoint(name[:4], name[8:10]), _endpoint(name[4:8], name[10:12])))
                self.counts.append(0)
            index[left[same]] = self._numbers[name]
            left = left[~same]
        return index

    def _of_one_kind(self, octets: U8, begin: IntArray, end: IntArray, stream: IntArray) -> int:
        """How many datagrams there are before the first that isn't of the kind of its stream."""
        cat240 = (end - begin >= HEADER) & (octets[begin] == CAT240)
        for number in range(len(self.holds), len(self.streams)):
            self.holds.append(bool(cat240[np.argmax(stream == number)]))
        odd = stream < 0
        odd |= cat240 != np.array([*self.holds, False], dtype=np.bool_)[stream]
        if not cat240.all():  # data blocks may stand behind those of other categories
            after = begin + (octets[begin + 1].astype(np.int64) << 8 | octets[begin + 2])
            odd |= ~cat240 & (octets[begin] > 0) & (after > begin + HEADER) & (after + HEADER <= end)
        return int(np.argmax(odd)) if odd.any() else len(odd)


def _endpoint(address: bytes, port: bytes) -> str:
    return f"{'.'.join(map(str, address))}:{int.from_bytes(port, 'big')}"


def _head(order: str, where: dict[str, int], ip: int, ethertype: int) -> np.dtype[Any]:
    """The headers of a packet as a row: the capture's numbers, then those of Ethernet, IPv4 and UDP."""
    fields: dict[str, tuple[Any, int]] = {name: (np.dtype(f"{order}u4"), at) for name, at in where.items()}
    if ethertype >= 0:
        fields["type"] = (np.dtype(">u2"), ethertype)
    for name, kind, at in (
        ("first", ">u4", 0), ("flow", ">u4", 6), ("key", "V12", 12), ("udp_length", ">u2", 24),
    ):  # fmt: skip
        fields[name] = (np.dtype(kind), ip + at)
    return np.dtype({
        "names": list(fields), "formats": [kind for kind, _ in fields.values()],
        "offsets": [at for _, at in fields.values()], "itemsize": ip + IP_HEADER + UDP_HEADER,
    })  # fmt: skip


def _data_blocks(octets: U8, begin: IntArray, end: IntArray) -> tuple[IntArray, IntArray, IntArray, int]:
    """The data blocks that fill datagrams: row of the datagram, begin and end of each, in order; and the first row
    that isn't filled with them, -1 = all are.
    """
    found, bad = list[tuple[IntArray, IntArray, IntArray]](), len(begin)
    row, at, stop = np.arange(len(begin)), begin, end
    length = np.ndarray((len(octets) - 2,), dtype=">u2", buffer=octets, offset=1, strides=(1,))
    for _ in range(MAX_LEVELS):
        if len(row) == 0:
            break
        after = at + length[at]
        sound = (octets[at] == CAT240) & (after > at + HEADER) & (after <= stop)
        if not sound.all():
            bad = min(bad, int(row[np.argmin(sound)]))
            row, at, after, stop = row[sound], at[sound], after[sound], stop[sound]
        found.append((row, at, after))
        more = np.flatnonzero(after < stop)
        row, at, stop = row[more], after[more], stop[more]
    bad = min(bad, int(row.min(initial=bad)))
    if len(found) == 1:
        return *found[0], bad if bad < len(begin) else -1
    rows, firsts, ends = (np.concatenate(column) for column in zip(*found, strict=True)) if found else (row, at, stop)
    order = np.argsort(firsts, kind="stable")
    return rows[order], firsts[order], ends[order], bad if bad < len(begin) else -1
