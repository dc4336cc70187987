"""Where the records of a CAT240 data block are and which items each has, without looking at more than that takes."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maritrack.io.cat240.items import ITEMS
from maritrack.types import IntArray

HEADER = 3
ITEM_010, ITEM_000, ITEM_048, ITEM_140 = 0x8000, 0x4000, 0x0200, 0x0008  # bits of presence, first octet of FSPEC high
VIDEO_BITS = 0x0070
VENDOR_BITS = 0x0006
CODES = ("", "truncated-item", "fspec-too-long", "frn-not-in-uap", "empty-fspec")
BEFORE_048, BEFORE_140 = 0xFC00, 0xFEF0


class Records(NamedTuple):
    """The records of a data block, up to the first that can't be read."""

    starts: list[int]  # (n + 1,) the last is the end of the block, or where the trouble is
    present: list[int]  # (n,) bits of their items
    code: str  # of the trouble, "" = none


class Layout(NamedTuple):
    """How to go over a record with certain items."""

    steps: tuple[tuple[int, int, int], ...]  # fixed octets, then a count: so many octets, times the count and one more
    rest: int  # fixed octets after that


def walk(data: bytes, start: int, end: int) -> Records:
    """The records of the data block in [start, end)."""
    at = start + HEADER
    starts, present = [at], list[int]()
    while at < end:
        first = data[at]
        bits, place = first & 0xFE, at + 1
        if first & 1:
            if place >= end:
                return Records(starts, present, "truncated-item")
            second = data[place]
            if second & 1:
                return Records(starts, present, _long_fspec(data, place + 1, end))
            bits, place = bits << 8 | second, place + 1
        else:
            bits <<= 8
        if bits == 0:
            return Records(starts, present, "empty-fspec")
        steps, rest = layout(bits)
        for skip, unit, more in steps:
            place += skip
            if place >= end or (more == 0 and data[place] == 0):
                return Records(starts, present, "truncated-item")
            place += data[place] * unit + more
        at = place + rest
        if at > end:
            return Records(starts, present, "truncated-item")
        starts.append(at)
        present.append(bits)
    return Records(starts, present, "")


class First(NamedTuple):
    """The first records of data blocks (n,)."""

    present: IntArray  # bits of its items, 0 unless it is the only one of its block and sound
    source: IntArray  # SAC << 8 | SIC, -1 = none
    code: IntArray  # why it can't be read, index of CODES, 0 = it can, or RE or SP have to be looked at


def first_records(u8: NDArray[np.uint8], begin: IntArray, end: IntArray) -> First:
    """The first records of data blocks with at least one octet of a record."""
    last = len(u8) - 1
    at = begin + HEADER
    octets = [u8[np.minimum(at + i, last)].astype(np.int64) for i in range(3)]
    two = octets[0] & 1 > 0
    present = (octets[0] & 0xFE) << 8 | np.where(two, octets[1], 0)
    cut, long = two & (at + 1 >= end), two & (octets[1] & 1 > 0)
    cut |= long & (at + 2 >= end)
    at += 1 + two
    source = u8[np.minimum(at, last)].astype(np.int64) << 8 | u8[np.minimum(at + 1, last)]
    short = np.zeros(len(at), dtype=np.bool_)
    for bit, _, size in ITEMS:
        there = present & bit > 0
        if size > 0:
            at += size * there
        elif there.any():
            count = u8[np.minimum(at, last)].astype(np.int64)
            short |= there & ((at >= end) | ((count == 0) & (size == 0)))
            at += np.where(there, count * (-size or 1) + (1 if size else 0), 0)
    short |= at > end
    undefined = (octets[2] & 1 > 0) | (octets[2] == 0)
    code = np.select([cut, long & undefined, long, present == 0, short & (present & VENDOR_BITS == 0)], [1, 2, 3, 4, 1])
    single = ~cut & ~long & ~short & (at == end)
    return First(np.where(single, present, 0), np.where(present & ITEM_010, source, -1), code)


@cache
def layout(present: int) -> Layout:
    """How to go over a record with these items."""
    steps, fixed = [], 0
    for bit, _, size in ITEMS:
        if not present & bit:
            continue
        if size > 0:
            fixed += size
        else:
            steps.append((fixed, -size or 1, 1 if size else 0))
            fixed = 0
    return Layout(tuple(steps), fixed)


def source_at(data: bytes, at: int, present: int) -> int:
    """SAC << 8 | SIC of the record at `at`, -1 = none."""
    if not present & ITEM_010:
        return -1
    first = at + 1 + (data[at] & 1)
    return data[first] << 8 | data[first + 1]


def sensor_name(source: int) -> str:
    """The name of SAC << 8 | SIC, "" for -1."""
    return f"{source >> 8}-{source & 255}" if source >= 0 else ""


def kind_at(data: bytes, at: int, present: int) -> int:
    """Message type of the record at `at`, -1 = none."""
    if not present & ITEM_000:
        return -1
    return data[at + 1 + (data[at] & 1) + (2 if present & ITEM_010 else 0)]


def time_at(data: bytes, at: int, end: int, present: int) -> int:
    """Time of day of the record at `at`, -1 = none, or it would be behind `end`."""
    place = place_after(data, at, present & BEFORE_140, end) if present & ITEM_140 else end
    return data[place] << 16 | data[place + 1] << 8 | data[place + 2] if place + 3 <= end else -1


def place_after(data: bytes, at: int, items: int, end: int = -1) -> int:
    """The place behind these items of the record at `at`, which are its first; with `end` at most about there."""
    steps, rest = layout(items)
    place = at + 1 + (data[at] & 1)
    for skip, unit, more in steps:
        place += skip
        if 0 <= end <= place:
            return end
        place += data[place] * unit + more
    return place + rest


def presence(data: bytes, at: int, end: int) -> int:
    """Bits of the items that the FSPEC of the record at `at` names, 0 where it is cut off or too long."""
    if not data[at] & 1:
        return data[at] << 8
    if at + 1 >= end or data[at + 1] & 1:
        return 0
    return (data[at] & 0xFE) << 8 | data[at + 1]


def _long_fspec(data: bytes, third: int, end: int) -> str:
    if third >= end:
        return "truncated-item"
    return "fspec-too-long" if data[third] & 1 or data[third] == 0 else "frn-not-in-uap"
