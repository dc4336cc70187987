"""The blocks of a pcapng file: how long they are, where one may begin, and what an interface says of itself.

A block is a type (4), its length (4, a multiple of 4), what it holds, and its length again (4).
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field
from struct import Struct
from typing import NamedTuple

import numpy as np

from maritrack.io.containers.packets import Stretch
from maritrack.types import IntArray

SECTION, INTERFACE, OLD_PACKET, SIMPLE_PACKET, PACKET = 0x0A0D0D0A, 1, 2, 3, 6
SECTION_OCTETS = b"\x0a\x0d\x0d\x0a"
PACKET_BLOCKS = (OLD_PACKET, SIMPLE_PACKET, PACKET)
KNOWN = (*range(1, 13), 0xBAD, 0x40000BAD, SECTION)
LEAST = 12  # octets of a block
MAX_BLOCK = 4 << 20  # longer ones are not believed
MAX_FOUND = 1 << 20  # of those that are searched for
SPAN = 32_768  # places that are searched at once
HEADS = {order: Struct(order + "II") for order in "<>"}
WORDS = {order: Struct(order + "I") for order in "<>"}
MAGIC = {b"\x4d\x3c\x2b\x1a": "<", b"\x1a\x2b\x3c\x4d": ">"}
END, RESOLUTION, OFFSET = 0, 9, 14  # options of an interface


class Interface(NamedTuple):
    """What a section says of an interface."""

    link: int
    snaplen: int  # 0 = no limit
    resolution: int  # as sent: 6 = microseconds; with the highest bit, of powers of two
    offset_s: int


ASSUMED = Interface(1, 0, 6, 0)  # where a packet's interface is not known


def interface_at(data: bytes, at: int, length: int, order: str) -> Interface:
    """The interface that a block of `length` octets describes; lies of its options end them."""
    link, _, snaplen = Struct(order + "HHI").unpack_from(data, at + 8)
    resolution, offset_s = 6, 0
    option, end = Struct(order + "HH"), at + length - 4
    place = at + 16
    while place + 4 <= end:
        code, size = option.unpack_from(data, place)
        place += 4
        if code == END or place + size > end:
            break
        if code == RESOLUTION and size == 1:
            resolution = data[place]
        elif code == OFFSET and size == 8:
            offset_s = Struct(order + "q").unpack_from(data, place)[0]
        place += -(-size // 4) * 4
    return Interface(link, snaplen, resolution, offset_s)


def even_packets(w: Stretch, at: int, length: int, order: str) -> int:
    """How many whole packet blocks of this length follow each other from a place on."""
    n = (w.size - at) // length
    if n <= 0:
        return 0
    kind = order + "u4"
    heads = np.ndarray((n, 2), dtype=kind, buffer=w.data, offset=at, strides=(length, 4))
    tails = np.ndarray((n,), dtype=kind, buffer=w.data, offset=at + length - 4, strides=(length,))
    good = (heads[:, 0] == PACKET) & (heads[:, 1] == length) & (tails == length)
    return n if good.all() else int(np.argmin(good))


def order_at(w: Stretch, at: int) -> str:
    """The order of octets of the block at a place, by its lengths; "" where these don't tell."""
    for order in "<>":
        length = WORDS[order].unpack_from(w.data, at + 4)[0]
        if LEAST <= length <= w.size - at and WORDS[order].unpack_from(w.data, at + length - 4)[0] == length:
            return order
    return ""


@dataclass(slots=True)
class Search:
    """Looks for places where a block begins, and keeps what it found for the next question."""

    _of: tuple[Stretch | None, str] = (None, "")
    _low: int = 0  # places between these have been looked at
    _high: int = 0
    _places: list[int] = field(default_factory=list)
    _sure: list[bool] = field(default_factory=list)

    def next(self, w: Stretch, at: int, order: str) -> tuple[int, bool]:
        """The first place from `at` on where a block begins, and True; or False, where more octets must tell.

        `order` is that of the section, "" where it isn't known.
        """
        limit = w.size - LEAST + 1
        if self._of[0] is not w or self._of[1] != order:
            self._of, self._low, self._high = (w, order), 0, 0
        while at < limit:
            if not self._low <= at < self._high:
                self._look(w, at, min(at + SPAN, limit), order)
            i = bisect_left(self._places, at)
            if i < len(self._places):
                return self._places[i], self._sure[i]
            at = self._high
        return at, False

    def _look(self, w: Stretch, low: int, high: int, order: str) -> None:
        self._low, self._high = low, high
        found = {at: sure > 0 for one in order or "<>" for at, sure in _blocks(w, low, high, one).tolist()}
        found |= _sections(w, low, high)
        self._places = sorted(found)
        self._sure = [found[at] for at in self._places]


def _blocks(w: Stretch, low: int, high: int, order: str) -> IntArray:
    """The places of [low, high) where a block other than a section's first is, and 1 where that is sure."""
    u8 = np.frombuffer(w.data, dtype=np.uint8)
    middle = u8[low + 1 : high + 1] if order == "<" else u8[low + 2 : high + 2]
    at = low + np.flatnonzero((middle == 0) | (middle == 0x0B))  # the second lowest octet of the known types
    kind, length = (w.rows(at, 8).view(order + "u4").astype(np.int64)[:, i] for i in (0, 1))
    good = (length >= LEAST) & (length % 4 == 0) & (length <= MAX_FOUND) & np.isin(kind, KNOWN[:-1])
    at, length = at[good], length[good]
    whole = at + length <= w.size
    tail = np.where(whole, at + length - 4, at + 4)
    same = w.rows(tail, 4).view(order + "u4").ravel() == length
    keep = same & (whole | (not w.final))
    return np.stack([at[keep], whole[keep].astype(np.int64)], axis=1)


def _sections(w: Stretch, low: int, high: int) -> dict[int, bool]:
    """The same for the first blocks of sections."""
    found, at = {}, w.data.find(SECTION_OCTETS, low, high + 3)
    while at >= 0:
        order = MAGIC.get(w.data[at + 8 : at + 12]) if at + 12 <= w.size else None
        length = WORDS[order].unpack_from(w.data, at + 4)[0] if order else 0
        if LEAST + 4 <= length <= MAX_FOUND and length % 4 == 0:
            whole = at + length <= w.size
            if not whole and not w.final:
                found[at] = False
            elif whole and order and WORDS[order].unpack_from(w.data, at + length - 4)[0] == length:
                found[at] = True
        at = w.data.find(SECTION_OCTETS, at + 1, high + 3)
    return found
