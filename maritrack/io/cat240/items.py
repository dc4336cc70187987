"""The items of CAT240 records: FSPEC and spans, and from them where a data block really starts."""

from __future__ import annotations

from typing import NamedTuple

from maritrack.io.cat240.framing import HEADER, Window, candidates, is_boundary

FEW_RECORDS = 4
MANY = 1 << 62
ITEMS = (  # FRN order: FSPEC bit (first octet high), name, octets; -n = an octet REP, then REP x n; 0 = LEN first
    (0x8000, "010", 2), (0x4000, "000", 1), (0x2000, "020", 4), (0x1000, "030", -1), (0x0800, "040", 12),
    (0x0400, "041", 12), (0x0200, "048", 2), (0x0080, "049", 5), (0x0040, "050", -4), (0x0020, "051", -64),
    (0x0010, "052", -256), (0x0008, "140", 3), (0x0004, "RE", 0), (0x0002, "SP", 0),
)  # fmt: skip

Trouble = tuple[str, str]  # code, message


class Items(NamedTuple):
    """The items of one record: name -> (first octet, end), and what ended the reading."""

    span: dict[str, tuple[int, int]]
    stop: int
    trouble: Trouble | None
    vendor: bool  # the trouble is in RE or SP: the items before it are sound


def read_items(data: bytes, at: int, end: int) -> Items:
    """The items of the record at `at`, whose block ends at `end`."""
    present, at, trouble = _read_fspec(data, at, end)
    span: dict[str, tuple[int, int]] = {}
    if trouble is not None:
        return Items(span, at, trouble, False)
    for bit, name, size in ITEMS:
        if not present & bit:
            continue
        if size <= 0:
            count = data[at] if at < end else 0
            octets = count if size == 0 else 1 - size * count
        else:
            octets = size
        if octets == 0 or at >= end or at + octets > end:
            what = "has length 0" if octets == 0 and at < end else "runs over the end of its data block"
            return Items(span, at, ("truncated-item", f"item {name} {what}"), size == 0)
        span[name] = (at, at + octets)
        at += octets
    return Items(span, at, None, False)


def _read_fspec(data: bytes, at: int, end: int) -> tuple[int, int, Trouble | None]:
    """The presence bits (first octet high), the place after them, and what is wrong with them."""
    first = data[at]
    second = data[at + 1] if first & 1 and at + 1 < end else 0
    if first & 1 and (at + 1 >= end or (second & 1 and at + 2 >= end)):
        return 0, at, ("truncated-item", "FSPEC runs over the end of its data block")
    if second & 1:
        if data[at + 2] & 1 or data[at + 2] == 0:
            return 0, at, ("fspec-too-long", "FSPEC has more than two octets")
        return 0, at, ("frn-not-in-uap", "FSPEC names an item that the category does not have")
    present = (first << 8 | second) & 0xFEFE
    if present == 0:
        return 0, at, ("empty-fspec", "a record without items")
    return present, at + 1 + (first & 1), None


def is_block(w: Window, at: int) -> bool:
    """Whether the data block that seems to start at `at` does: it ends at a boundary, or its records fill it."""
    end = at + w.length(at)
    return is_boundary(w, end) or _is_filled(w.data, at + HEADER, end)


def next_block(w: Window, at: int, most: int = MANY) -> tuple[int, int]:
    """The first place from `at` on, before the window's limit, where a CAT240 block really starts, else the limit.

    Also the places that were tried; after `most` of them the answer is the next that looks like one.
    """
    tried = 0
    for place in candidates(w, at):
        if tried >= most:
            return place, tried
        tried += 1
        if is_block(w, place):
            return place, tried
    return max(at, w.limit), tried


def _is_filled(data: bytes, at: int, end: int) -> bool:
    """Whether a few whole records fill the octets up to `end`."""
    for _ in range(FEW_RECORDS):
        items = read_items(data, at, end)
        if items.trouble is not None:
            return False
        at = items.stop
        if at == end:
            return True
    return False
