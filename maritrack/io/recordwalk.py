"""Where the records of a CAT240 data block are and which items each has, without looking at more than that takes."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from maritrack.io.cat240_items import ITEMS

HEADER = 3
ITEM_010, ITEM_000, ITEM_140 = 0x8000, 0x4000, 0x0008  # bits of presence, first octet of FSPEC high
VIDEO_BITS = 0x0070
VENDOR_BITS = 0x0006
BEFORE_140 = 0xFEF0


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


def kind_at(data: bytes, at: int, present: int) -> int:
    """Message type of the record at `at`, -1 = none."""
    if not present & ITEM_000:
        return -1
    return data[at + 1 + (data[at] & 1) + (2 if present & ITEM_010 else 0)]


def time_at(data: bytes, at: int, end: int, present: int) -> int:
    """Time of day of the record at `at`, -1 = none, or it would be behind `end`."""
    if not present & ITEM_140:
        return -1
    steps, rest = layout(present & BEFORE_140)
    place = at + 2
    for skip, unit, more in steps:
        place += skip
        if place >= end:
            return -1
        place += data[place] * unit + more
    place += rest
    return data[place] << 16 | data[place + 1] << 8 | data[place + 2] if place + 3 <= end else -1


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
