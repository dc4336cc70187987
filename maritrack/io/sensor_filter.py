"""The records of one sensor out of a CAT240 data block, octet for octet."""

from __future__ import annotations

from typing import NamedTuple

from maritrack.io.cat240_encode import SUMMARY, VIDEO, data_block
from maritrack.io.cat240_exact import parse_block
from maritrack.io.cat240_items import read_items
from maritrack.io.framing import CAT240, window
from maritrack.io.recode import data_blocks, is_whole
from maritrack.io.recordwalk import ITEM_010, VENDOR_BITS, Records, kind_at, presence, source_at, walk

MOST_INSIDE = 16  # data blocks that are looked for in one that is too long
KNOWN = (SUMMARY, VIDEO, -1)


class Filtered(NamedTuple):
    """What is left of a data block."""

    octets: bytes
    cut: int  # records left out


def keep_sensor(block: bytes, source: int) -> Filtered:
    """A data block with the records of one sensor (SAC << 8 | SIC) only; empty where it has none.

    What can't be read in a damaged block stays if all records that can be read are the sensor's, else it is left out.
    A block with a LEN so long that others begin inside it comes back as several.
    """
    parts, cut, rest = list[bytes](), 0, [block]
    for _ in range(MOST_INSIDE):
        if not rest:
            break
        one = rest.pop(0)
        if is_whole(one):
            records = walk(one, 0, len(one))
            inside = _another_inside(one, records)
            kept = _before(one, records, source, inside) if inside else _keep(one, records, source)
            parts.append(kept.octets)
            cut += kept.cut
            rest = [*data_blocks(one[inside:]), *rest] if inside else rest
    return Filtered(b"".join(parts), cut)


def only_of(data: bytes, start: int, end: int, source: int) -> int:
    """How many records a data block has, if all are the sensor's; minus as many, if none is; 0 = ask `keep_sensor`."""
    records = walk(data, start, end)
    if records.code or any(data[at] == CAT240 for at in records.starts[1:-1]):
        return 0
    sources = [source_at(data, at, bits) for at, bits in zip(records.starts, records.present, strict=False)]
    n = sources.count(source)
    return n if n == len(sources) else 0 if n else -len(sources)


def _another_inside(block: bytes, records: Records) -> int:
    """Where the header of another data block was taken for a record, 0 = nowhere."""
    starts = records.starts if records.code else records.starts[:-1]
    if all(block[at] != CAT240 for at in starts[1:]):
        return 0
    resume = parse_block(window(0, block, final=True), 0, len(block)).resume
    return resume if resume in starts[1:] else 0


def _keep(block: bytes, records: Records, source: int) -> Filtered:
    sources = _sources(block, records)
    last = _vendor_record(block, records)
    sources += last
    if sources.count(source) == len(sources) > 0 and (last or not records.code):
        return Filtered(block, 0)
    if records.code:
        kinds = [kind_at(block, at, bits) for at, bits in zip(records.starts, records.present, strict=False)]
        known = {one for one, kind in zip(sources, [*kinds, VIDEO], strict=False) if kind in KNOWN}
        if known == {source}:
            return Filtered(block, 0)
    stops = [*records.starts[1:], len(block)]
    return _cut(block, [*zip(records.starts, stops, sources, strict=False)], source)


def _before(block: bytes, records: Records, source: int, end: int) -> Filtered:
    """The records of the sensor that begin before `end`, where one of the records begins."""
    n = records.starts.index(end)
    sources = _sources(block, records)[:n]
    return _cut(block, [*zip(records.starts, records.starts[1:], sources, strict=False)], source)


def _cut(block: bytes, records: list[tuple[int, int, int]], source: int) -> Filtered:
    """A data block of those of the records (place, end, source) that are the sensor's."""
    ours = [block[at:stop] for at, stop, one in records if one == source]
    return Filtered(data_block(ours) if ours else b"", len(records) - len(ours))


def _sources(block: bytes, records: Records) -> list[int]:
    return [source_at(block, at, bits) for at, bits in zip(records.starts, records.present, strict=False)]


def _vendor_record(block: bytes, records: Records) -> list[int]:
    """The source of the record after the last sound one, if only its RE or SP is damaged."""
    at = records.starts[-1]
    if not records.code or not presence(block, at, len(block)) & VENDOR_BITS:
        return []
    items = read_items(block, at, len(block))
    return [source_at(block, at, ITEM_010 if "010" in items.span else 0)] if items.vendor else []
