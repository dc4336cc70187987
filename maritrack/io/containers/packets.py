"""UDP out of captured packets, many at a time: link layer, VLAN tags, IPv4 and IPv6.

What isn't UDP over IP is passed over in silence; what claims to be and can't be read is counted. Checksums are not
looked at: network cards fill them in after the capture. Written from RFC 791, 8200, 768 and the pages of tcpdump.org
about link types.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maritrack.types import BoolArray, Damage, IntArray

PAD = 128  # zero octets behind a stretch: a header may be looked at before it is known whether it is whole
UDP = 17
UDP_HEADER = 8
TAG = 1
MAX_TAGS = 8  # VLAN tags, or extension headers, of a packet
ETHERTYPES = {0x0800: 4, 0x86DD: 6, 0x8100: TAG, 0x88A8: TAG, 0x9100: TAG, 0x9200: TAG, 0x9300: TAG}
FRAMED = {1: (12, 14), 113: (14, 16), 276: (0, 20)}  # link type: where the EtherType is, and what follows it
RAW_IP = (12, 14, 101, 228, 229)
LOOPBACK = (0, 108)
FAMILIES = {2: 4, 10: 6, 23: 6, 24: 6, 28: 6, 30: 6}  # of addresses, as the systems number them
FRAGMENT, AUTHENTICATION = 44, 51
EXTENSIONS = (0, 43, FRAGMENT, AUTHENTICATION, 60, 135, 139, 140)

U8Array = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """A stretch of a capture file in memory. Places are counted from its first octet."""

    base: int  # octet of the file where it starts
    data: bytes  # PAD zero octets stand behind it
    size: int
    final: bool  # the file ends with it

    def rows(self, at: IntArray, n: int) -> U8Array:
        """The `n` octets (at most PAD) at each place, (len(at), n)."""
        every = np.ndarray((len(self.data) - n + 1,), dtype=f"V{n}", buffer=self.data, strides=(1,))
        found: U8Array = every[at].view(np.uint8).reshape(-1, n)
        return found

    def u16(self, at: IntArray) -> IntArray:
        """The big-endian numbers at the places."""
        return self.rows(at, 2).view(">u2").ravel().astype(np.int64)


def stretch(base: int, *octets: bytes, final: bool) -> Stretch:
    """The octets, joined, as a stretch that starts at octet `base` of the file."""
    data = b"".join((*octets, bytes(PAD)))
    return Stretch(base, data, len(data) - PAD, final)


@dataclass(frozen=True, slots=True, eq=False)
class Packets:
    """Where the packets of a stretch are."""

    start: IntArray  # (n,)
    end: IntArray  # (n,) of what was captured
    full: IntArray  # (n,) octets that were on the wire
    link: IntArray  # (n,) type of the link layer
    t_ns: IntArray  # (n,) or NO_TIME
    told: BoolArray  # (n,) that they are short was told already

    def __len__(self) -> int:
        return len(self.start)


@dataclass(frozen=True, slots=True, eq=False)
class Bodies:
    """UDP in IP packets, whole or in fragments."""

    row: IntArray  # (n,) of the packet
    at: IntArray  # (n,) where what follows the IP headers starts
    stop: IntArray  # (n,) where it ends, going by IP: maybe beyond what was captured
    addresses: U8Array  # (n, 8) or (n, 32) source and destination
    place: IntArray  # (n,) of the fragment in the datagram
    more: BoolArray  # (n,) not the last fragment
    ident: IntArray  # (n,)

    def take(self, index: Any) -> Bodies:
        return Bodies(
            self.row[index], self.at[index], self.stop[index], self.addresses[index], self.place[index],
            self.more[index], self.ident[index],
        )  # fmt: skip

    @property
    def whole(self) -> BoolArray:
        """Which are no fragments."""
        whole: BoolArray = (self.place == 0) & ~self.more
        return whole


@dataclass(frozen=True, slots=True, eq=False)
class Payloads:
    """Payloads of UDP datagrams that came in one packet each."""

    row: IntArray  # (n,) of the packet
    start: IntArray  # (n,)
    end: IntArray  # (n,) what was captured of it
    key: U8Array  # (n, 12) or (n, 36) source and destination address, source and destination port


class Tally:
    """What was wrong in a stretch: by code how often, and the first place."""

    def __init__(self, base: int) -> None:
        self.base = base  # octet of the file where the stretch starts
        self._told: dict[str, tuple[int, str]] = {}
        self._counts: dict[str, int] = {}

    def add(self, code: str, places: IntArray, message: str) -> None:
        """The same trouble at all these places of the stretch."""
        if len(places):
            self.add_one(code, int(places.min()), message, count=len(places))

    def add_one(self, code: str, place: int, message: str, *, count: int = 1) -> None:
        before = self._counts.get(code, 0)
        self._counts[code] = before + count
        if not before or place < self._told[code][0]:
            self._told[code] = place, message

    def told(self) -> tuple[Damage, ...]:
        found = [
            Damage(code, self.base + at, text, count=self._counts[code]) for code, (at, text) in self._told.items()
        ]
        return tuple(sorted(found, key=lambda one: (one.offset, one.code)))


def udp_bodies(w: Stretch, p: Packets, tally: Tally) -> tuple[Bodies, Bodies]:
    """What packets carry of UDP over IPv4, and over IPv6."""
    version, at = _ip_headers(w, p, tally)
    four = np.flatnonzero(version == 4)
    six = np.flatnonzero(version == 6)
    return _ipv4(w, p, four, at[four], tally), _ipv6(w, p, six, at[six], tally)


def udp_payloads(w: Stretch, p: Packets, b: Bodies, tally: Tally) -> Payloads:
    """The payloads of whole datagrams, as far as they were captured."""
    room, there = b.stop - b.at, p.end[b.row] - b.at
    header = w.rows(np.minimum(b.at, w.size), UDP_HEADER)
    lengths = header.view(">u2")[:, 2].astype(np.int64)
    good = (there >= UDP_HEADER) & (room >= UDP_HEADER)
    if not good.all():
        tally.add("bad-packet", b.at[room < UDP_HEADER], "a UDP datagram of less than 8 octets")
        tell_short(p, b.row[~good & (room >= UDP_HEADER)], tally)
        b, room, header, lengths = b.take(good), room[good], header[good], lengths[good]
    odd = (lengths < UDP_HEADER) | (lengths > room)
    if odd.any():
        tally.add("udp-length", b.at[odd], "a UDP length that can't be: the IP packet's is taken")
        lengths = np.where(odd, room, lengths)
    last, end = b.at + lengths, p.end[b.row]
    cut = last > end
    if cut.any():
        tell_short(p, b.row[cut], tally)
        last = np.minimum(last, end)
    return Payloads(b.row, b.at + UDP_HEADER, last, np.concatenate([b.addresses, header[:, :4]], axis=1))


def tell_short(p: Packets, rows: IntArray, tally: Tally) -> None:
    """Say of packets that they have fewer octets than they should: by the capture, or by themselves."""
    rows = rows[~p.told[rows]]
    cut = p.end[rows] - p.start[rows] < p.full[rows]
    tally.add("snaplen-cut", p.start[rows[cut]], "a packet was captured in part")
    tally.add("packet-short", p.start[rows[~cut]], "a packet is shorter than its headers say")


def _ip_headers(w: Stretch, p: Packets, tally: Tally) -> tuple[NDArray[np.uint8], IntArray]:
    """Version of IP of each packet, 0 = none, and where its header starts."""
    version, at = np.zeros(len(p), dtype=np.uint8), p.start.copy()
    links = p.link[:1] if (p.link == p.link[:1]).all() else np.unique(p.link)
    for link in links.tolist():
        rows = np.flatnonzero(p.link == link)
        if link in FRAMED:
            version[rows], at[rows] = _framed(w, p, rows, tally, *FRAMED[link])
        elif link in RAW_IP:
            first = w.rows(p.start[rows], 1)[:, 0] >> 4
            bad = (first != 4) & (first != 6)
            tally.add("bad-packet", p.start[rows[bad]], "neither IPv4 nor IPv6")
            version[rows] = np.where(bad, 0, first)
        elif link in LOOPBACK:
            octets = w.rows(p.start[rows], 4)
            version[rows] = np.maximum(FAMILY[octets.view("<u4")[:, 0] % 256], FAMILY[octets.view(">u4")[:, 0] % 256])
            version[rows[(octets > 0).sum(axis=1) != 1]] = 0
            at[rows] += 4
        else:
            tally.add("unknown-link", p.start[rows], f"packets of link type {link} are not read")
    return version, at


def _framed(
    w: Stretch, p: Packets, rows: IntArray, tally: Tally, ethertype: int, length: int
) -> tuple[NDArray[np.uint8], IntArray]:
    """The same for packets with an EtherType, behind any VLAN tags."""
    at, end = p.start[rows] + length, p.end[rows]
    kind = KIND[w.u16(p.start[rows] + ethertype)]
    short = at > end
    tagged = np.flatnonzero((kind == TAG) & ~short)
    for _ in range(MAX_TAGS):
        if len(tagged) == 0:
            break
        kind[tagged] = KIND[w.u16(at[tagged] + 2)]
        at[tagged] += 4
        short[tagged] = at[tagged] > end[tagged]
        tagged = tagged[(kind[tagged] == TAG) & ~short[tagged]]
    tally.add("bad-packet", p.start[rows[tagged]], f"more than {MAX_TAGS} VLAN tags")
    kind[tagged] = 0
    if short.any():
        tell_short(p, rows[short], tally)
        kind[short] = 0
    return kind, at


def _ipv4(w: Stretch, p: Packets, rows: IntArray, at: IntArray, tally: Tally) -> Bodies:
    if len(rows) == 0:
        return NO_BODIES
    header = w.rows(at, 20)
    words = header.view(">u2")
    there, length = p.end[rows] - at, words[:, 1].astype(np.int64)
    if not length.all():  # left to the network card to fill in
        length = np.where(length == 0, p.full[rows] - (at - p.start[rows]), length)
    options = (header[:, 0] & 15).astype(np.int64) * 4
    short = there < np.maximum(options, 20)
    bad = (there >= 20) & ((header[:, 0] >> 4 != 4) | (options < 20) | (length < options))
    keep = (header[:, 9] == UDP) & ~short & ~bad
    if not keep.all():
        tally.add("bad-packet", at[bad], "an IPv4 header that can't be")
        tell_short(p, rows[short & ~bad & ((there < 10) | (header[:, 9] == UDP))], tally)
        rows, at, header, words = rows[keep], at[keep], header[keep], words[keep]
        length, options = length[keep], options[keep]
    flags = words[:, 3]
    return Bodies(
        rows, at + options, at + length, header[:, 12:20], (flags & 0x1FFF).astype(np.int64) * 8,
        (flags & 0x2000) > 0, words[:, 2].astype(np.int64),
    )  # fmt: skip


def _ipv6(w: Stretch, p: Packets, rows: IntArray, at: IntArray, tally: Tally) -> Bodies:
    if len(rows) == 0:
        return NO_BODIES
    header = w.rows(at, 40)
    there, length = p.end[rows] - at, header.view(">u2")[:, 2].astype(np.int64)
    bad = (there >= 40) & (header[:, 0] >> 4 != 6)
    tally.add("bad-packet", at[bad], "an IPv6 header that can't be")
    tell_short(p, rows[there < 40], tally)
    stop = np.where(length == 0, p.start[rows] + p.full[rows], at + 40 + length)
    n = len(rows)
    b = Bodies(
        rows, at + 40, stop, header[:, 8:40], np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.bool_),
        np.zeros(n, dtype=np.int64),
    )  # fmt: skip
    kind = header[:, 6].astype(np.int64)
    kind[bad | (there < 40)] = -1
    _extensions(w, p, b, kind, tally)
    return b.take(kind == UDP)


def _extensions(w: Stretch, p: Packets, b: Bodies, kind: IntArray, tally: Tally) -> None:
    """Go over the extension headers: bodies and kinds become those of what is behind them."""
    left = np.flatnonzero(np.isin(kind, EXTENSIONS))
    for _ in range(MAX_TAGS):
        if len(left) == 0:
            return
        short = b.at[left] + 8 > p.end[b.row[left]]
        tell_short(p, b.row[left[short]], tally)
        kind[left[short]] = -1
        left = left[~short]
        octets = w.rows(b.at[left], 8)
        of, length = kind[left], octets[:, 1].astype(np.int64)
        b.at[left] += np.select([of == FRAGMENT, of == AUTHENTICATION], [8, (length + 2) * 4], (length + 1) * 8)
        kind[left] = octets[:, 0]
        fragment = left[of == FRAGMENT]
        flags = octets[of == FRAGMENT, 2:4].copy().view(">u2").ravel().astype(np.int64)
        b.place[fragment], b.more[fragment] = flags & 0xFFF8, (flags & 1) > 0
        b.ident[fragment] = octets[of == FRAGMENT, 4:8].copy().view(">u4").ravel()
        left = left[np.isin(kind[left], EXTENSIONS) & b.whole[left]]  # in fragments the rest is cut anywhere
    tally.add("bad-packet", p.start[b.row[left]], f"more than {MAX_TAGS} IPv6 extension headers")
    kind[left] = -1


def _table(size: int, values: dict[int, int]) -> NDArray[np.uint8]:
    table = np.zeros(size, dtype=np.uint8)
    table[list(values)] = list(values.values())
    return table


_NONE = np.zeros(0, dtype=np.int64)
NO_BODIES = Bodies(_NONE, _NONE, _NONE, np.zeros((0, 8), dtype=np.uint8), _NONE, _NONE > 0, _NONE)
KIND, FAMILY = _table(65_536, ETHERTYPES), _table(256, FAMILIES)
