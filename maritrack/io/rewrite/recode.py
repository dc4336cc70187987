"""A CAT240 data block with its cells compressed or not; the rest octet for octet.

What can't be read for sure is left as it is and told. `maritrack.io.rewrite.recode_rows` does the same for many blocks.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from maritrack.errors import UsageError
from maritrack.io.cat240.encode import COMPRESSED, MAX_LEN, MAX_REP, VIDEO, VIDEO_ITEMS, data_block
from maritrack.io.cat240.exact import parse_block
from maritrack.io.cat240.framing import CAT240, HEADER, window
from maritrack.io.cat240.items import Trouble
from maritrack.io.cat240.recordwalk import (
    BEFORE_048,
    ITEM_048,
    VIDEO_BITS,
    kind_at,
    place_after,
    sensor_name,
    source_at,
    walk,
)  # fmt: skip
from maritrack.types import Damage

INFLATION_FLOOR = 4 << 20  # octets
INFLATION_RATIO = 256  # octets to an octet of input
NEEDED = (  # bits of items, of which one has to be there
    (0x0C00, ("missing-item-041", "video without azimuth")),
    (ITEM_048, ("missing-item-048", "video without cell resolution")),
    (0x0080, ("missing-item-049", "video without its number of cells")),
)
ITEM_OF_BIT = {item.bit: name for name, item in VIDEO_ITEMS.items()}
CANT_READ = "a record that can't be read: its data block stays as it is"
OVER_BUDGET = ("inflation-budget", "the input inflates to too many octets")


@dataclass(frozen=True, slots=True)
class Coding:
    """How cells are to be sent."""

    compress: bool
    level: int = 6  # of zlib, 0 to 9

    def __post_init__(self) -> None:
        if not 0 <= self.level <= 9:
            raise UsageError(f"compression level {self.level}, not 0 to 9")


@dataclass(slots=True)
class Budget:
    """Octets that may still be inflated: a hostile input grows to a multiple of its size and no further."""

    left: int = INFLATION_FLOOR
    trusting: bool = True  # most streams have been as they are declared

    def earn(self, octets: int) -> None:
        """So many more octets of input were read."""
        self.left += INFLATION_RATIO * octets

    def take(self, octets: int) -> bool:
        """Whether so many octets may be inflated, which are then gone."""
        affordable = octets <= self.left
        self.left -= octets if affordable else 0
        return affordable


class Recoded(NamedTuple):
    """What became of some octets."""

    octets: bytes
    changed: int  # records whose cells are coded in another way now
    kept: list[Damage]  # records that stay as they were though they should change; offset = place in the octets


def data_blocks(octets: bytes) -> list[bytes]:
    """The data blocks of a datagram, as far as LEN leads; the rest, if any, is the last one."""
    blocks, at = [], 0
    while at < len(octets):
        length = octets[at + 1] << 8 | octets[at + 2] if at + HEADER <= len(octets) else 0
        end = at + length if HEADER <= length <= len(octets) - at else len(octets)
        blocks.append(octets[at:end])
        at = end
    return blocks


def recode_block(block: bytes, coding: Coding, budget: Budget) -> Recoded:
    """A data block with the cells of its video records recoded; several blocks where they outgrow one.

    Only the video item, its kind in FSPEC, the bit of compression, the number of valid octets and LEN change. The
    item 050, 051 or 052 stays if it holds the cells, else it is the smallest that does. Not a whole, sound CAT240
    block: untouched.
    """
    if not is_whole(block):
        return Recoded(block, 0, [])
    found = walk(block, 0, len(block))
    if found.code:
        return Recoded(block, 0, [Damage(found.code, found.starts[-1], CANT_READ)])
    if CAT240 in [block[at] for at in found.starts[1:-1]] and (inside := another_inside(block)):
        return Recoded(block, 0, [Damage("lost-sync", inside, "another data block begins inside this one")])
    records, kept, changed = list[bytes](), list[Damage](), 0
    for at, stop, present in zip(found.starts, found.starts[1:], found.present, strict=False):
        made = _recode(block, (at, stop), present, coding, budget) if present & VIDEO_BITS else None
        if isinstance(made, tuple):
            kept.append(Damage(made[0], at, made[1], sensor_name(source_at(block, at, present))))
        changed += isinstance(made, bytes)
        records.append(made if isinstance(made, bytes) else block[at:stop])
    return Recoded(_joined(records) if changed else block, changed, kept)


def another_inside(block: bytes) -> int:
    """Where the exact reader takes what looks like a record for the header of another data block, 0 = nowhere."""
    resume = parse_block(window(0, block, final=True), 0, len(block)).resume
    return resume if resume < len(block) else 0


def inflate(packed: bytes, octets: int) -> bytes | Trouble:
    """The `octets` that a stream inflates to, or why it isn't exactly as many."""
    stream = zlib.decompressobj()
    try:
        found = stream.decompress(packed, octets + 1)
    except zlib.error:
        return inflate_bare(packed, octets)
    return found if stream.eof and len(found) == octets else why_not(len(found), octets, ended=stream.eof)


def inflate_bare(packed: bytes, octets: int) -> bytes | Trouble:
    """The same for a stream that zlib can't read: it may be one without zlib's header."""
    headed = len(packed) > 1 and packed[0] & 15 == 8 and packed[0] < 128 and (packed[0] << 8 | packed[1]) % 31 == 0
    stream = zlib.decompressobj(-15)
    try:
        found = b"" if headed else stream.decompress(packed, octets + 1)
    except zlib.error:
        found = b""
    sound = stream.eof and len(found) == octets > 0 and not stream.unused_data
    return found if sound else ("zlib-error", "cells can't be inflated")


def why_not(found: int, octets: int, *, ended: bool) -> Trouble:
    """What is wrong with a stream that inflates to another number of octets."""
    if found > octets:
        return "inflates-beyond-declared", f"the cells inflate to more than the {octets} octets declared"
    if ended:
        return "cells-short", f"{octets} octets of cells are declared, the stream holds {found}"
    return "zlib-error", "cells can't be inflated: the stream is cut off"


def item_for(octets: int, item: str) -> str:
    """The item that holds so many octets: `item` itself if it does, else the smallest; "" = none."""
    order = (item, *VIDEO_ITEMS)
    return next((name for name in order if octets <= MAX_REP * VIDEO_ITEMS[name].octets), "")


def too_large(octets: int) -> Trouble:
    """What to tell of cells that no record holds."""
    return "too-large", f"{octets} octets of cells are too many for one record"


def is_whole(block: bytes) -> bool:
    """Whether it is a data block of the category with room for a record."""
    return len(block) > HEADER and block[0] == CAT240 and block[1] << 8 | block[2] == len(block)


def _recode(
    block: bytes, place: tuple[int, int], present: int, coding: Coding, budget: Budget
) -> bytes | Trouble | None:
    """The record at `place` (to its end) recoded, None where it is as wanted already, or why it can't be."""
    at, stop = place
    form = place_after(block, at, present & BEFORE_048)  # 048, then 049 and the video item
    if present & ITEM_048 and (block[form] >= COMPRESSED) == coding.compress:
        return None
    if trouble := _lacking(block, at, present):
        return trouble
    item = ITEM_OF_BIT[present & VIDEO_BITS]
    nbvb, nbcells = block[form + 2] << 8 | block[form + 3], int.from_bytes(block[form + 4 : form + 7], "big")
    first, old = form + 8, VIDEO_ITEMS[item]
    if nbvb > block[first - 1] * old.octets:
        return "nbvb-exceeds-block", f"{nbvb} valid octets are declared, the block has {block[first - 1] * old.octets}"
    body = _body(block[first : first + nbvb], nbcells, block[form + 1], coding, item, budget)
    if isinstance(body, tuple):
        return body
    name = item_for(len(body), item)
    new = VIDEO_ITEMS[name or item]
    rep = -(-len(body) // new.octets)
    tail = first + block[first - 1] * old.octets
    if not name or first - at + rep * new.octets + stop - tail > MAX_LEN - HEADER:
        return too_large(len(body))
    head = bytearray(block[at:first])
    head[1] += new.bit - old.bit
    head[form - at] ^= COMPRESSED
    head[form - at + 2 : form - at + 4] = len(body).to_bytes(2, "big")
    head[-1] = rep
    return b"".join((head, body, bytes(rep * new.octets - len(body)), block[tail:stop]))


def _lacking(block: bytes, at: int, present: int) -> Trouble | None:
    """What a record with a video block lacks, so that it can't be told which octets are its cells."""
    for bits, told in NEEDED:
        if not present & bits:
            return told
    if present & VIDEO_BITS not in ITEM_OF_BIT:
        return "two-video-blocks", "more than one video block"
    return (
        None if kind_at(block, at, present) in (-1, VIDEO) else ("type-mismatch", "video in a record of another type")
    )


def _body(packed: bytes, nbcells: int, res: int, coding: Coding, item: str, budget: Budget) -> bytes | Trouble:
    """The octets of the cells as wanted, or why there are none."""
    if not 1 <= res <= 6:
        return "bad-res", f"resolution {res} is not one of 1 to 6"
    octets = (nbcells << res - 1) + 7 >> 3
    if coding.compress:
        if len(packed) == octets:
            return zlib.compress(packed, coding.level)
        what = "cells-long" if len(packed) > octets else "cells-short"
        return what, f"{octets} octets of cells are declared, {len(packed)} are valid"
    if not item_for(octets, item):
        return too_large(octets)
    if not budget.take(octets):
        return OVER_BUDGET
    return inflate(packed, octets) if octets or packed else b""


def _joined(records: Sequence[bytes]) -> bytes:
    """Data blocks of the records: one, or as few as hold them."""
    blocks, waiting, size = list[bytes](), list[bytes](), HEADER
    for record in records:
        if waiting and size + len(record) > MAX_LEN:
            blocks.append(data_block(waiting))
            waiting, size = [], HEADER
        waiting.append(record)
        size += len(record)
    return b"".join((*blocks, data_block(waiting)))
