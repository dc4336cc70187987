"""Datagrams with their cells compressed or not, or with one sensor's records only: many data blocks at a time.

Blocks of the usual make are done as arrays, all others one by one by `maritrack.io.recode`, with the same outcome.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from maritrack.io.cat240_cells import HEAD, Rows, common_rows, gather, take_rows
from maritrack.io.cat240_encode import COMPRESSED, MAX_LEN, MAX_REP, VIDEO_ITEMS
from maritrack.io.cat240_exact import INFLATION
from maritrack.io.cat240_items import Trouble
from maritrack.io.datagrams import Datagrams
from maritrack.io.framing import CAT240, HEADER, window
from maritrack.io.recode import (
    OVER_BUDGET,
    Budget,
    Coding,
    data_blocks,
    inflate_bare,
    recode_block,
    too_large,
    why_not,
)  # fmt: skip
from maritrack.io.recordwalk import VIDEO_BITS, walk
from maritrack.io.select import subset
from maritrack.io.sensor_filter import keep_sensor, only_of
from maritrack.types import BoolArray, Damage, IntArray

GROUP = 32 << 20  # octets that may wait in memory to be written
BITS = np.array([item.bit for item in VIDEO_ITEMS.values()])
OCTETS = np.array([item.octets for item in VIDEO_ITEMS.values()])
ZEROS = bytes(256)


class Some(NamedTuple):
    """A run of datagrams, recoded."""

    payloads: list[bytes]
    changed: int  # records
    kept: list[Damage]  # records that stay as they were though they should change, summed up


class Ours(NamedTuple):
    """What is left of datagrams, in order, without those of which nothing is."""

    datagrams: Datagrams
    cut: int  # records left out
    sources: frozenset[int]  # SAC << 8 | SIC seen in blocks of the usual make


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """The data blocks of datagrams; octets that are no whole block are one too."""

    bounds: IntArray  # (m + 1,) where each begins in the data, and the end
    owner: IntArray  # (m,) index of its datagram
    whole: BoolArray  # (m,) it is a CAT240 block with at least one octet of a record
    usual: BoolArray  # (m,) with one record of the usual make
    rows: Rows  # (m,) with a meaning where usual


def blocks_of(d: Datagrams) -> Blocks:
    """The data blocks of datagrams."""
    bounds, owner = d.bounds, np.arange(len(d))
    if len(d) and not (one := _lengths(d.data, bounds) == np.diff(bounds)).all():
        bounds, owner = _cut(d, np.flatnonzero(~one))
    size = np.diff(bounds)
    category = np.frombuffer(d.data, dtype=np.uint8)[bounds[:-1][size > 0]]
    whole = (size > HEADER) & (_lengths(d.data, bounds) == size)
    whole[size > 0] &= category == CAT240
    usual, rows = common_rows(window(0, d.data, final=True), bounds)
    return Blocks(bounds, owner, whole, usual & whole, rows)


def part_of(d: Datagrams, first: int, last: int) -> Datagrams:
    """The datagrams from the index `first` up to `last`, without what was told of them."""
    if (first, last) == (0, len(d)):
        return d
    begin, end = int(d.bounds[first]), int(d.bounds[last])
    return Datagrams(
        d.end, d.data[begin:end], d.bounds[first : last + 1] - begin, d.offset[first:last], d.t_ns[first:last],
        d.stream[first:last],
    )  # fmt: skip


def recode_datagrams(d: Datagrams, coding: Coding, budget: Budget) -> Iterator[Some]:
    """The datagrams with their cells recoded, in runs that memory can hold."""
    blocks = blocks_of(d)
    rows = blocks.rows
    size = np.diff(blocks.bounds)
    if not coding.compress:
        size = np.where(blocks.usual, size + np.minimum(_octets(rows), MAX_LEN), INFLATION * size)
    grown = np.cumsum(np.bincount(blocks.owner, size, minlength=len(d)).astype(np.int64))
    cuts = np.flatnonzero(np.diff(grown // GROUP)) + 1
    for first, last in pairwise([0, *cuts.tolist(), len(d)]):
        span = slice(*np.searchsorted(blocks.owner, [first, last]).tolist())
        yield _recode_some(d, blocks, span, coding, budget)


def of_sensor(d: Datagrams, sensor: tuple[int, int]) -> Ours:
    """The records of one sensor (SAC, SIC), with everything around them that isn't another's."""
    blocks = blocks_of(d)
    rows = blocks.rows
    keep = blocks.usual & (rows["sac"] == sensor[0]) & (rows["sic"] == sensor[1])
    cut = int((blocks.usual & ~keep).sum())
    sources = frozenset(np.unique((rows["sac"] << 8 | rows["sic"])[blocks.usual]).tolist())
    if blocks.usual.all() and len(keep) == len(d):
        return Ours(d if keep.all() else subset(d, keep), cut, sources)
    left, source = dict[int, bytes](), sensor[0] << 8 | sensor[1]
    odd = np.flatnonzero(blocks.whole & ~blocks.usual)
    for i, first, last in zip(odd.tolist(), blocks.bounds[odd].tolist(), blocks.bounds[odd + 1].tolist(), strict=True):
        n = only_of(d.data, first, last, source)
        if n == 0:
            found = keep_sensor(d.data[first:last], source)
            left[i] = found.octets
            keep[i] = len(found.octets) > 0
            cut += found.cut
        else:
            keep[i] = n > 0
            cut += max(0, -n)
    octets = [left.get(i, block) for i, block in _slices(d.data, blocks, keep)]
    payloads = _joined(octets, blocks.owner[keep])
    return Ours(_rebuilt(d, np.unique(blocks.owner[keep]), payloads), cut, sources)


def _lengths(data: bytes, bounds: IntArray) -> IntArray:
    """LEN of each stretch as if it were a data block, -1 where it is too short for one."""
    u8 = np.frombuffer(data, dtype=np.uint8)
    roomy = np.diff(bounds) >= HEADER
    lengths = np.full(len(roomy), -1, dtype=np.int64)
    at = bounds[:-1][roomy]
    lengths[roomy] = u8[at + 1].astype(np.int64) << 8 | u8[at + 2]
    return lengths


def _cut(d: Datagrams, several: IntArray) -> tuple[IntArray, IntArray]:
    """Bounds and owners of data blocks, where the datagrams `several` aren't one block."""
    places, owners = [d.bounds[:-1]], [np.arange(len(d))]
    for i, first, last in zip(
        several.tolist(), d.bounds[several].tolist(), d.bounds[several + 1].tolist(), strict=True
    ):
        sizes = [len(block) for block in data_blocks(d.data[first:last])]
        inner = first + np.cumsum(sizes[:-1], dtype=np.int64)
        places.append(inner)
        owners.append(np.full(len(inner), i))
    place, owner = np.concatenate(places), np.concatenate(owners)
    order = np.argsort(place, kind="stable")
    return np.append(place[order], d.bounds[-1]), owner[order]


def _octets(rows: Rows) -> IntArray:
    """Octets of the cells before compression."""
    octets: IntArray = rows["n_cells"] * rows["bits"] + 7 >> 3
    return octets


def _recode_some(d: Datagrams, blocks: Blocks, span: slice, coding: Coding, budget: Budget) -> Some:
    owner, bounds = blocks.owner[span], blocks.bounds[span.start : span.stop + 1].tolist()
    parts = [d.data[first:last] for first, last in pairwise(bounds)]
    usual, rows = blocks.usual[span], blocks.rows[span]
    todo = np.flatnonzero(usual & (rows["compressed"] != coding.compress))
    done = _recode_rows(d.data, take_rows(rows, todo), coding, budget)
    changed, kept, odd = 0, dict[tuple[str, str], Damage](), np.flatnonzero(blocks.whole[span] & ~usual).tolist()
    places = (d.offset[owner] + blocks.bounds[span] - d.bounds[owner]).tolist()
    for i, made in zip(todo.tolist(), done, strict=True):
        if isinstance(made, bytes):
            parts[i] = made
            changed += 1
        elif made is None:
            odd.append(i)
        else:
            _tell(kept, Damage(made[0], HEADER, made[1], f"{rows['sac'][i]}-{rows['sic'][i]}"), places[i])
    for i in odd:
        records = walk(d.data, bounds[i], bounds[i + 1])
        if not records.code and not any(present & VIDEO_BITS for present in records.present):
            continue
        found = recode_block(parts[i], coding, budget)
        parts[i] = found.octets
        changed += found.changed
        for damage in found.kept:
            _tell(kept, damage, places[i])
    return Some(_joined(parts, owner), changed, sorted(kept.values(), key=lambda one: one.offset))


def _tell(kept: dict[tuple[str, str], Damage], damage: Damage, place: int) -> None:
    """Count what is told of a block at `place` with what was told before."""
    kind, offset = (damage.code, damage.sensor), place + damage.offset
    before = kept.get(kind)
    if before is None:
        kept[kind] = replace(damage, offset=offset)
    else:
        kept[kind] = replace(before, offset=min(before.offset, offset), count=before.count + 1)


def _recode_rows(data: bytes, rows: Rows, coding: Coding, budget: Budget) -> list[bytes | Trouble | None]:
    """Data blocks of the usual make, all to be recoded, or why not; None = to be done the exact way."""
    if len(rows) == 0:
        return []
    source = memoryview(data)
    spans = zip(rows["first"].tolist(), (rows["first"] + rows["octets"]).tolist(), strict=True)
    if coding.compress:
        compress, level = zlib.compress, coding.level
        return [*_with_bodies(data, rows, [compress(source[first:stop], level) for first, stop in spans])]
    octets = _octets(rows)
    small = octets <= MAX_REP * OCTETS[-1]
    affordable = small & (np.cumsum(np.where(small, octets, 0)) <= budget.left)
    bodies = _inflated(source, spans, np.where(affordable, octets, -1).tolist())
    budget.take(int(octets[affordable].sum()))
    done: list[bytes | Trouble | None] = [*_with_bodies(data, rows, bodies)]
    for i in np.flatnonzero(~affordable).tolist():
        done[i] = OVER_BUDGET if small[i] else too_large(int(octets[i]))
    for i, body in enumerate(bodies):
        if isinstance(body, tuple):
            done[i] = body
    return done


def _inflated(source: memoryview, spans: Iterable[tuple[int, int]], octets: list[int]) -> list[bytes | Trouble | None]:
    """The octets that zlib streams inflate to, or why they aren't as many as told; None where -1 was told."""
    bodies: list[bytes | Trouble | None] = []
    append, inflater = bodies.append, zlib.decompressobj
    for (first, stop), n in zip(spans, octets, strict=True):
        body: bytes | Trouble | None = None
        if n >= 0:
            stream = inflater()
            try:
                body = stream.decompress(source[first:stop], n + 1)
            except zlib.error:
                body = inflate_bare(bytes(source[first:stop]), n)
            else:
                body = body if len(body) == n and stream.eof else why_not(len(body), n, ended=stream.eof)
        append(body)
    return bodies


def _with_bodies(data: bytes, rows: Rows, bodies: Sequence[bytes | Trouble | None]) -> list[bytes | None]:
    """The blocks with other octets of cells, None where there are none or where they don't fit."""
    w = window(0, data, final=True)
    head = gather(w, rows["block"], HEAD.itemsize).view(HEAD)[:, 0].copy()
    size = np.array([len(body) if isinstance(body, bytes) else -1 for body in bodies])
    old = np.argmax(head["fspec"][:, 1, None] & BITS > 0, axis=1)
    holds = size[:, None] <= MAX_REP * OCTETS
    item = np.where(holds[np.arange(len(rows)), old], old, np.argmax(holds, axis=1))
    rep = -(-size // OCTETS[item])
    tail = rows["block"] + HEAD.itemsize + head["rep"] * OCTETS[old]
    length = HEAD.itemsize + rep * OCTETS[item] + rows["block_end"] - tail
    fits = (size >= 0) & holds[:, 2] & (length <= MAX_LEN)
    head["len"], head["nbvb"], head["rep"] = length, size, rep
    head["fspec"][:, 1] += (BITS[item] - BITS[old]).astype(np.uint8)
    head["flags"] ^= COMPRESSED
    heads, n, pads = head.tobytes(), HEAD.itemsize, (rep * OCTETS[item] - size).tolist()
    tails = zip(tail.tolist(), rows["block_end"].tolist(), strict=True)
    return [
        b"".join((heads[i * n : i * n + n], body, ZEROS[:pad], data[first:last]))
        if fit and isinstance(body, bytes)
        else None
        for i, (fit, body, pad, (first, last)) in enumerate(zip(fits.tolist(), bodies, pads, tails, strict=True))
    ]


def _slices(data: bytes, blocks: Blocks, keep: BoolArray) -> Iterator[tuple[int, bytes]]:
    """Index and octets of the blocks to keep."""
    index = np.flatnonzero(keep)
    for i, first, last in zip(
        index.tolist(), blocks.bounds[index].tolist(), blocks.bounds[index + 1].tolist(), strict=True
    ):
        yield i, data[first:last]


def _joined(parts: list[bytes], owner: IntArray) -> list[bytes]:
    """The parts of each owner joined; owners don't fall."""
    cuts = np.flatnonzero(np.diff(owner)) + 1
    if len(cuts) + 1 >= len(parts):
        return parts
    return [b"".join(parts[first:last]) for first, last in pairwise([0, *cuts.tolist(), len(parts)])]


def _rebuilt(d: Datagrams, index: IntArray, payloads: Sequence[bytes]) -> Datagrams:
    """The datagrams `index` with these payloads."""
    sizes = np.array([len(payload) for payload in payloads], dtype=np.int64)
    bounds = np.concatenate([[0], np.cumsum(sizes)])
    return replace(
        d, data=b"".join(payloads), bounds=bounds, offset=d.offset[index], t_ns=d.t_ns[index], stream=d.stream[index]
    )
