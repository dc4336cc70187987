"""The records of one sensor (SAC << 8 | SIC) out of CAT240 data blocks, octet for octet."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from maritrack.io.cat240.encode import SUMMARY, VIDEO, data_block
from maritrack.io.cat240.framing import CAT240
from maritrack.io.cat240.items import read_items
from maritrack.io.cat240.recordwalk import ITEM_010, VENDOR_BITS, Records, kind_at, presence, source_at, walk
from maritrack.io.containers.select import subset
from maritrack.io.datagrams import Datagrams
from maritrack.io.rewrite.datablocks import Blocks, blocks_of, joined
from maritrack.io.rewrite.recode import another_inside, data_blocks, is_whole
from maritrack.types import BoolArray, IntArray

MOST_INSIDE = 16  # data blocks that are looked for in one that is too long
KNOWN = (SUMMARY, VIDEO, -1)


class Filtered(NamedTuple):
    """What is left of a data block."""

    octets: bytes
    cut: int  # records left out


class Ours(NamedTuple):
    """What is left of datagrams, in order, without those of which nothing is."""

    datagrams: Datagrams
    cut: int  # records left out
    sources: frozenset[int]  # SAC << 8 | SIC seen in blocks of the usual make


def of_sensor(d: Datagrams, source: int) -> Ours:
    """The records of one sensor out of many datagrams; what isn't whole data blocks of the category is left out."""
    blocks = blocks_of(d)
    rows = blocks.rows
    keep = blocks.usual & (rows["sac"] << 8 | rows["sic"] == source)
    cut = int((blocks.usual & ~keep).sum())
    sources = frozenset(np.unique((rows["sac"] << 8 | rows["sic"])[blocks.usual]).tolist())
    if blocks.usual.all() and len(keep) == len(d):
        return Ours(d if keep.all() else subset(d, keep), cut, sources)
    left = dict[int, bytes]()
    single = blocks.present > 0
    keep[blocks.odd] = single & (blocks.source == source)
    cut += int((single & (blocks.source != source)).sum())
    look = blocks.odd[(blocks.code == 0) & ~single]
    for i, first, last in zip(
        look.tolist(), blocks.bounds[look].tolist(), blocks.bounds[look + 1].tolist(), strict=True
    ):
        found = keep_sensor(d.data[first:last], source)
        left[i] = found.octets
        keep[i] = len(found.octets) > 0
        cut += found.cut
    octets = [left.get(i, block) for i, block in _slices(d.data, blocks, keep)]
    payloads = joined(octets, blocks.owner[keep])
    return Ours(_rebuilt(d, np.unique(blocks.owner[keep]), payloads), cut, sources)


def keep_sensor(block: bytes, source: int) -> Filtered:
    """A data block with the records of one sensor (SAC << 8 | SIC) only; empty where it has none.

    What can't be read in a damaged block stays if all records that can be read are the sensor's, else it is left out.
    A block with a LEN so long that others begin inside it comes back as several.
    """
    if not is_whole(block):
        return Filtered(b"", 0)
    records = walk(block, 0, len(block))
    places = records.starts[1:] if records.code else records.starts[1:-1]
    if places and CAT240 in [block[at] for at in places]:
        return _keep_of_several(block, source)
    return _keep(block, records, source)


def _keep_of_several(block: bytes, source: int) -> Filtered:
    """The same for a block that may hold others."""
    parts, cut, rest = list[bytes](), 0, [block]
    for _ in range(MOST_INSIDE):
        if not rest:
            break
        one = rest.pop(0)
        if is_whole(one):
            records = walk(one, 0, len(one))
            inside = another_inside(one)
            inside = inside if inside in records.starts[1:] else 0
            kept = _before(one, records, source, inside) if inside else _keep(one, records, source)
            parts.append(kept.octets)
            cut += kept.cut
            rest = [*data_blocks(one[inside:]), *rest] if inside else rest
    return Filtered(b"".join(parts), cut)


def _keep(block: bytes, records: Records, source: int) -> Filtered:
    sources = _sources(block, records)
    if not records.code:
        return _cut(block, records.starts, sources, source)
    last = _vendor_record(block, records)
    kinds = [kind_at(block, at, bits) for at, bits in zip(records.starts, records.present, strict=False)]
    known = [one for one, kind in zip(sources, kinds, strict=True) if kind in KNOWN] + last
    if known and known.count(source) == len(known):
        return Filtered(block, 0)
    return _cut(block, [*records.starts, len(block)], sources + last, source, whole=False)


def _before(block: bytes, records: Records, source: int, end: int) -> Filtered:
    """The records of the sensor that begin before `end`, where one of the records begins."""
    n = records.starts.index(end)
    return _cut(block, records.starts, _sources(block, records)[:n], source, whole=False)


def _cut(block: bytes, starts: list[int], sources: list[int], source: int, *, whole: bool = True) -> Filtered:
    """A data block of those records whose source is `source`: the block itself where all are and it is `whole`."""
    n = sources.count(source)
    if n == len(sources) and whole:
        return Filtered(block, 0)
    if n == 0:
        return Filtered(b"", len(sources))
    ours = [block[starts[i] : starts[i + 1]] for i, one in enumerate(sources) if one == source]
    return Filtered(data_block(ours), len(sources) - n)


def _sources(block: bytes, records: Records) -> list[int]:
    return [source_at(block, at, bits) for at, bits in zip(records.starts, records.present, strict=False)]


def _vendor_record(block: bytes, records: Records) -> list[int]:
    """The source of the record after the last sound one, if only its RE or SP is damaged."""
    at = records.starts[-1]
    if not presence(block, at, len(block)) & VENDOR_BITS:
        return []
    items = read_items(block, at, len(block))
    return [source_at(block, at, ITEM_010 if "010" in items.span else 0)] if items.vendor else []


def _slices(data: bytes, blocks: Blocks, keep: BoolArray) -> Iterator[tuple[int, bytes]]:
    """Index and octets of the blocks to keep."""
    index = np.flatnonzero(keep)
    for i, first, last in zip(
        index.tolist(), blocks.bounds[index].tolist(), blocks.bounds[index + 1].tolist(), strict=True
    ):
        yield i, data[first:last]


def _rebuilt(d: Datagrams, index: IntArray, payloads: Sequence[bytes]) -> Datagrams:
    """The datagrams `index` with these payloads."""
    sizes = np.array([len(payload) for payload in payloads], dtype=np.int64)
    bounds = np.concatenate([[0], np.cumsum(sizes)])
    return replace(
        d, data=b"".join(payloads), bounds=bounds, offset=d.offset[index], t_ns=d.t_ns[index], stream=d.stream[index]
    )
