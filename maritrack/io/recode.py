"""A CAT240 data block with its cells compressed or not; the rest octet for octet.

What can't be read for sure is left as it is and told. `maritrack.io.recode_rows` does the same for many blocks.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from maritrack.errors import UsageError
from maritrack.io.cat240_encode import COMPRESSED, MAX_LEN, MAX_REP, VIDEO_ITEMS, data_block
from maritrack.io.cat240_exact import Video, parse_block
from maritrack.io.cat240_items import Trouble, read_items
from maritrack.io.framing import CAT240, HEADER, window
from maritrack.io.recordwalk import VIDEO_BITS, sensor_name, source_at, walk
from maritrack.types import Damage

INFLATION_FLOOR = 4 << 20  # octets
INFLATION_RATIO = 256  # octets to an octet of input
UNSURE = {"missing-item-049", "nbvb-exceeds-block", "two-video-blocks"}  # which octets are cells, and how many

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
    places = walk(block, 0, len(block))
    if places.code:
        return Recoded(block, 0, [Damage(places.code, places.starts[-1], CANT_READ)])
    if not any(present & VIDEO_BITS for present in places.present):
        return Recoded(block, 0, [])
    found = parse_block(window(0, block, final=True), 0, len(block))
    if found.lost or found.resume != len(block):
        return Recoded(block, 0, [Damage("lost-sync", found.resume, "another data block begins inside this one")])
    videos = {video.at: video for video in found.videos}
    told = {damage.offset: damage for damage in reversed(found.damage)}
    records, kept, changed = list[bytes](), list[Damage](), 0
    for at, stop, present in zip(places.starts, places.starts[1:], places.present, strict=False):
        made: bytes | Trouble | None = None
        if at in videos:
            made = _recode(block, (at, stop), videos[at], coding, budget)
        elif at in told and present & VIDEO_BITS:
            kept.append(told[at])
        if isinstance(made, tuple):
            kept.append(Damage(made[0], at, made[1], sensor_name(source_at(block, at, present))))
        changed += isinstance(made, bytes)
        records.append(made if isinstance(made, bytes) else block[at:stop])
    return Recoded(_joined(records) if changed else block, changed, kept)


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
    block: bytes, place: tuple[int, int], record: Video, coding: Coding, budget: Budget
) -> bytes | Trouble | None:
    """The record recoded, None where it is as wanted already, or why it can't be."""
    if record.compressed == coding.compress:
        return None
    trouble = next((one for one in record.troubles if one[0] in UNSURE), None)
    body = trouble or _body(block, record, coding, budget)
    if isinstance(body, tuple):
        return body
    item = item_for(len(body), record.item)
    made = _with_body(block, place, record, body, item) if item else b""
    if not item or len(made) > MAX_LEN - HEADER:
        return too_large(len(body))
    return made


def _body(block: bytes, record: Video, coding: Coding, budget: Budget) -> bytes | Trouble:
    """The octets of the cells as wanted, or why there are none."""
    packed = block[record.first : record.stop]
    octets = (record.nbcells or 0) * record.bits + 7 >> 3
    if coding.compress:
        if len(packed) == octets:
            return zlib.compress(packed, coding.level)
        what = "cells-long" if len(packed) > octets else "cells-short"
        return what, f"{octets} octets of cells are declared, {len(packed)} are valid"
    if not item_for(octets, record.item):
        return too_large(octets)
    if not budget.take(octets):
        return OVER_BUDGET
    return inflate(packed, octets) if octets or packed else b""


def _with_body(block: bytes, place: tuple[int, int], record: Video, body: bytes, item: str) -> bytes:
    """The record at `place` (to its end) with other octets of cells, in `item`."""
    at, stop = place
    span, kind = read_items(block, at, stop).span, VIDEO_ITEMS[item]
    first, last = span[record.item]
    head = bytearray(block[at:first])
    head[1] += kind.bit - VIDEO_ITEMS[record.item].bit
    head[span["048"][0] - at] ^= COMPRESSED
    counts = span["049"][0] - at
    head[counts : counts + 2] = len(body).to_bytes(2, "big")
    rep = -(-len(body) // kind.octets)
    return b"".join((head, bytes((rep,)), body, bytes(rep * kind.octets - len(body)), block[last:stop]))


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
