"""The records of one CAT240 data block, item by item, with everything that can be wrong with them.

Slow and complete: the reader sends here every block that isn't of the common make, and its fast way is tested
against this one. A record is read by its FSPEC, never by its type or by fixed offsets.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from maritrack.io.cat240.framing import HEADER, Window, is_boundary, looks_like
from maritrack.io.cat240.items import Items, Trouble, is_block, read_items
from maritrack.types import Damage

TOD_PER_DAY = 86_400 * 128
MAX_CELLS = 524_288
INFLATION = 1032  # deflate can't do more
MAX_STRANGE = 4  # records of no known type in one block, then the rest of it is left
SUMMARY, VIDEO = 1, 2

HEADER_ITEM = struct.Struct(">HHII")  # items 040 and 041
BLOCK_OCTETS = {"050": 4, "051": 64, "052": 256}


class Video(NamedTuple):
    """A video record whose cells can be looked for. Places count from the start of the window."""

    block: int
    block_end: int
    at: int
    sac: int | None
    sic: int | None
    idx: int | None
    femto: bool
    start_az: int
    end_az: int
    start_rg: int
    cell_dur: int
    compressed: bool
    res: int
    nbvb: int | None
    nbcells: int | None
    item: str  # "050", "051" or "052"
    rep: int
    first: int  # the valid octets of the video block
    stop: int
    tod: int | None
    re: bytes | None
    sp: bytes | None
    text: bytes | None
    troubles: tuple[Trouble, ...]  # to be told when the radial is delivered

    @property
    def bits(self) -> int:
        """Of a cell."""
        return int(1 << self.res - 1)

    @property
    def most_cells(self) -> int:
        """Cells that the record can hold: as declared, and no more than its octets can stand for."""
        octets = (self.stop - self.first) * (INFLATION if self.compressed else 1)
        declared = MAX_CELLS if self.nbcells is None else self.nbcells
        return min(declared, MAX_CELLS, octets * 8 // self.bits)


class Summary(NamedTuple):
    """A video summary record: free text."""

    at: int
    sac: int | None
    sic: int | None
    text: bytes
    tod: int | None
    re: bytes | None
    sp: bytes | None


class Block(NamedTuple):
    """What a data block holds, and where to go on."""

    videos: list[Video]
    summaries: list[Summary]
    damage: list[Damage]
    resume: int
    lost: bool  # nothing begins at `resume`: look for the next block from there


def parse_block(w: Window, start: int, end: int) -> Block:
    """The records of the data block in [start, end) of a window, of which `end` may be a lie.

    A record that can't be read costs the rest of the block. When LEN was too long, the header of the next block
    was taken for a record: reading goes on after the last good record, not at the end of the block.
    """
    out = Block([], [], [], end, False)
    at = good = start + HEADER
    strange: list[int] = []  # places where something began that is no record we know
    intact = True
    while at < end and intact and len(strange) < MAX_STRANGE:
        items = read_items(w.data, at, end)
        if _add_record(w, (start, end, at), items, out):
            good = items.stop
        else:
            strange.append(at)
        intact, at = items.trouble is None, items.stop
    if intact and not strange:
        return out
    return _resume(w, out, (start, end, good), strange)


def _resume(w: Window, out: Block, place: tuple[int, int, int], strange: list[int]) -> Block:
    """Where to go on after a block (start, end, end of the last good record) that didn't read well."""
    start, end, good = place
    for at in strange:
        if at > start + HEADER and looks_like(w, at) and (at == good or is_block(w, at)):
            message = f"the data block at {w.base + start} is longer than its records: another one begins inside it"
            out.damage.append(Damage("lost-sync", w.base + at, message))
            return out._replace(resume=at)
    return out if is_boundary(w, end) else out._replace(resume=good, lost=True)


def _add_record(w: Window, place: tuple[int, int, int], items: Items, out: Block) -> bool:
    """Put the record at `place` (block, its end, record) into `out`; whether it is of a kind that we know."""
    data, span = w.data, items.span
    sensor = "{}-{}".format(*data[span["010"][0] : span["010"][1]]) if "010" in span else ""
    kind = data[span["000"][0]] if "000" in span else None
    if items.trouble is not None and not items.vendor:
        made: Video | Summary | Trouble = items.trouble
        kind = None
    else:
        made = _make(data, place, kind, items)
    if isinstance(made, Video):
        out.videos.append(made)
        return True
    if isinstance(made, Summary):
        out.summaries.append(made)
        troubles = _summary_troubles(made, kind, items.trouble)
    else:
        troubles = [made]
    out.damage.extend(Damage(code, w.base + place[2], message, sensor) for code, message in troubles)
    return isinstance(made, Summary) or kind in (SUMMARY, VIDEO)


def _make(data: bytes, place: tuple[int, int, int], kind: int | None, items: Items) -> Video | Summary | Trouble:
    """The record that the items make up, or why there is none."""
    span = items.span
    has_video = any(name in span for name in BLOCK_OCTETS)
    if kind not in (None, SUMMARY, VIDEO):
        return "unknown-type", f"message type {kind}"
    if kind == SUMMARY and has_video:
        return "type-mismatch", "a summary record with video"
    if kind == VIDEO or has_video:
        return _make_video(data, place, kind, items)
    if "030" not in span:
        return ("missing-item-030", "a summary without text") if kind else ("missing-item-000", "no message type")
    sac, sic = _pair(data, span.get("010"))
    first, stop = span["030"]
    tod = _number(data, span.get("140"))
    return Summary(
        place[2], sac, sic, data[first + 1 : stop], tod, _vendor(data, span, "RE"), _vendor(data, span, "SP")
    )


def _make_video(data: bytes, place: tuple[int, int, int], kind: int | None, items: Items) -> Video | Trouble:
    """A video record, or why its cells are of no use."""
    span = items.span
    videos = [name for name in BLOCK_OCTETS if name in span]
    if "040" not in span and "041" not in span:
        return "missing-item-041", "video without azimuth: neither item 040 nor 041"
    if "048" not in span:
        return "missing-item-048", "video without cell resolution"
    if not videos:
        return "missing-item-video", "no video block: none of the items 050, 051 and 052"
    femto = "041" in span
    at = span["041" if femto else "040"][0]
    flags, res = data[span["048"][0]], data[span["048"][0] + 1]
    start_az, end_az, start_rg, cell_dur = HEADER_ITEM.unpack_from(data, at)
    if not 1 <= res <= 6:
        return "bad-res", f"resolution {res} is not one of 1 to 6"
    if cell_dur == 0:
        return "cell-duration-zero", "cells without depth"
    counts = _number(data, span.get("049"))
    nbvb, nbcells = (None, None) if counts is None else (counts >> 24, counts & 0xFFFFFF)
    item = next((name for name in videos if span[name][1] - span[name][0] - 1 >= (nbvb or 0)), videos[0])
    first, stop = span[item]
    sac, sic = _pair(data, span.get("010"))
    record = Video(
        *place, sac, sic, _number(data, span.get("020")), femto, start_az, end_az, start_rg, cell_dur,
        flags >= 0x80, res, nbvb, nbcells, item, data[first],
        first + 1, stop if nbvb is None else min(stop, first + 1 + nbvb), _number(data, span.get("140")),
        _vendor(data, span, "RE"), _vendor(data, span, "SP"),
        data[span["030"][0] + 1 : span["030"][1]] if "030" in span else None, (),
    )  # fmt: skip
    troubles = _video_troubles(record, kind, items, stop - first - 1)
    return record._replace(troubles=tuple(troubles)) if troubles else record


def _video_troubles(record: Video, kind: int | None, items: Items, room: int) -> list[Trouble]:
    """What to tell about a record that is delivered, before its cells were looked at."""
    span, found = items.span, list[Trouble]()
    for name, absent in (("010", record.sac is None), ("000", kind is None), ("020", record.idx is None)):
        if absent:
            found.append((f"missing-item-{name}", f"video without item {name}"))
    if record.nbvb is None:
        found.append(("missing-item-049", "video without its number of cells: the whole block is used"))
    elif record.nbvb > room:
        found.append(("nbvb-exceeds-block", f"{record.nbvb} valid octets are declared, the block has {room}"))
    if kind == VIDEO and record.text is not None:
        found.append(("type-mismatch", "a video record with summary text"))
    if "040" in span and "041" in span:
        found.append(("two-headers", "items 040 and 041: the finer one is used"))
    if sum(name in span for name in BLOCK_OCTETS) > 1:
        found.append(("two-video-blocks", f"more than one video block: item {record.item} is used"))
    if (record.end_az - record.start_az) % 65_536 > 32_768:
        found.append(
            ("az-span-implausible", f"azimuths {record.start_az} to {record.end_az} span more than half a turn")
        )
    if record.tod is not None and record.tod >= TOD_PER_DAY:
        found.append(("tod-out-of-range", f"time of day {record.tod / 128:.2f} s"))
    if items.trouble is not None:
        found.append(items.trouble)
    return found


def _summary_troubles(record: Summary, kind: int | None, trouble: Trouble | None) -> list[Trouble]:
    found = list[Trouble]()
    if record.sac is None:
        found.append(("missing-item-010", "summary without item 010"))
    if kind is None:
        found.append(("missing-item-000", "summary without item 000"))
    if not record.text.isascii():
        found.append(("summary-not-ascii", "summary text is not ASCII"))
    if record.tod is not None and record.tod >= TOD_PER_DAY:
        found.append(("tod-out-of-range", f"time of day {record.tod / 128:.2f} s"))
    return found if trouble is None else [*found, trouble]


def _pair(data: bytes, span: tuple[int, int] | None) -> tuple[int | None, int | None]:
    return (None, None) if span is None else (data[span[0]], data[span[0] + 1])


def _number(data: bytes, span: tuple[int, int] | None) -> int | None:
    return None if span is None else int.from_bytes(data[span[0] : span[1]], "big")


def _vendor(data: bytes, span: dict[str, tuple[int, int]], name: str) -> bytes | None:
    return data[span[name][0] + 1 : span[name][1]] if name in span else None
