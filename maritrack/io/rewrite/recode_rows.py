"""Datagrams with their cells compressed or not: many data blocks at a time.

Blocks of the usual make are done as arrays, all others one by one by `maritrack.io.rewrite.recode`, with the same
outcome.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from maritrack.io.cat240.cells import FREE_OCTETS, HEAD, Rows, gather, take_rows
from maritrack.io.cat240.encode import COMPRESSED, MAX_LEN, MAX_REP, VIDEO_ITEMS
from maritrack.io.cat240.exact import INFLATION
from maritrack.io.cat240.framing import HEADER, window
from maritrack.io.cat240.inflate import inflate
from maritrack.io.cat240.items import Trouble
from maritrack.io.cat240.recordwalk import CODES, VIDEO_BITS, sensor_name, walk
from maritrack.io.datagrams import Datagrams
from maritrack.io.rewrite.datablocks import Blocks, blocks_of, joined
from maritrack.io.rewrite.recode import CANT_READ, OVER_BUDGET, Budget, Coding, recode_block, too_large
from maritrack.io.rewrite.recode import inflate as inflate_one
from maritrack.types import Damage, IntArray

GROUP = 32 << 20  # octets that may wait in memory to be written
BITS = np.array([item.bit for item in VIDEO_ITEMS.values()])
OCTETS = np.array([item.octets for item in VIDEO_ITEMS.values()])
ZEROS = bytes(256)
FEW = 4  # streams of as many octets for which a buffer doesn't pay

Body = bytes | memoryview | Trouble | None


class Some(NamedTuple):
    """A run of datagrams, recoded."""

    payloads: list[bytes]
    changed: int  # records
    kept: list[Damage]  # records that stay as they were though they should change, summed up


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


def _octets(rows: Rows) -> IntArray:
    """Octets of the cells before compression."""
    octets: IntArray = rows["n_cells"] * rows["bits"] + 7 >> 3
    return octets


def _recode_some(d: Datagrams, blocks: Blocks, span: slice, coding: Coding, budget: Budget) -> Some:
    owner, bounds = blocks.owner[span], blocks.bounds[span.start : span.stop + 1].tolist()
    parts = [d.data[first:last] for first, last in pairwise(bounds)]
    rows, places = blocks.rows[span], d.offset[owner] + blocks.bounds[span] - d.bounds[owner]
    todo = np.flatnonzero(blocks.usual[span] & (rows["compressed"] != coding.compress))
    kept, changed = _Kept(), 0
    odd = _to_look_at(blocks, span, places, kept)
    for i, made in zip(todo.tolist(), _recode_rows(d.data, take_rows(rows, todo), coding, budget), strict=True):
        if isinstance(made, bytes):
            parts[i] = made
            changed += 1
        elif made is None:
            odd.append(i)
        else:
            kept.tell(made, int(rows["sac"][i] << 8 | rows["sic"][i]), int(places[i]) + HEADER)
    for i in odd:
        records = walk(d.data, bounds[i], bounds[i + 1])
        if records.code:
            kept.tell((records.code, CANT_READ), -1, int(places[i]) + records.starts[-1] - bounds[i])
        elif any(present & VIDEO_BITS for present in records.present):
            found = recode_block(parts[i], coding, budget)
            parts[i] = found.octets
            changed += found.changed
            for damage in found.kept:
                kept.tell((damage.code, damage.message), damage.sensor, int(places[i]) + damage.offset)
    return Some(joined(parts, owner), changed, kept.damage())


def _to_look_at(blocks: Blocks, span: slice, places: IntArray, kept: _Kept) -> list[int]:
    """Which of the blocks of the span may have to be recoded though they aren't of the usual make."""
    here = slice(*np.searchsorted(blocks.odd, [span.start, span.stop]).tolist())
    odd, present, code = blocks.odd[here] - span.start, blocks.present[here], blocks.code[here]
    for one in np.unique(code[code > 0]).tolist():
        these = odd[code == one]
        kept.tell((CODES[one], CANT_READ), -1, int(places[these[0]]) + HEADER, count=len(these))
    look: list[int] = odd[(code == 0) & ((present == 0) | (present & VIDEO_BITS > 0))].tolist()
    return look


class _Kept:
    """What is told of records that stay as they are, summed up by code and sensor."""

    def __init__(self) -> None:
        self._told: dict[tuple[str, int | str], list[Any]] = {}

    def tell(self, trouble: Trouble, sensor: int | str, offset: int, *, count: int = 1) -> None:
        """Count a trouble of a sensor (its name, or SAC << 8 | SIC)."""
        told = self._told.setdefault((trouble[0], sensor), [0, offset, trouble[1]])
        told[0] += count
        if offset < told[1]:
            told[1:] = offset, trouble[1]

    def damage(self) -> list[Damage]:
        found = [
            Damage(code, offset, message, sensor if isinstance(sensor, str) else sensor_name(sensor), count)
            for (code, sensor), (count, offset, message) in self._told.items()
        ]
        return sorted(found, key=lambda one: one.offset)


def _recode_rows(data: bytes, rows: Rows, coding: Coding, budget: Budget) -> list[bytes | Trouble | None]:
    """Data blocks of the usual make, all to be recoded, or why not; None = to be done the exact way."""
    if len(rows) == 0:
        return []
    source, first, stop = memoryview(data), rows["first"], rows["first"] + rows["octets"]
    if coding.compress:
        compress, level = zlib.compress, coding.level
        spans = zip(first.tolist(), stop.tolist(), strict=True)
        return [*_with_bodies(data, rows, [compress(source[begin:end], level) for begin, end in spans])]
    octets = _octets(rows)
    small = octets <= MAX_REP * OCTETS[-1]
    affordable = small & (np.cumsum(np.where(small, octets, 0)) <= budget.left)
    bodies = _inflated(source, first, stop, np.where(affordable, octets, -1), budget)
    budget.take(int(octets[affordable].sum()))
    done: list[bytes | Trouble | None] = [*_with_bodies(data, rows, bodies)]
    for i in np.flatnonzero(~affordable).tolist():
        done[i] = OVER_BUDGET if small[i] else too_large(int(octets[i]))
    for i, body in enumerate(bodies):
        if isinstance(body, tuple):
            done[i] = body
    return done


def _inflated(source: memoryview, first: IntArray, stop: IntArray, octets: IntArray, budget: Budget) -> list[Body]:
    """What zlib streams inflate to, or why it isn't as many octets as told; None where -1 was told."""
    bodies: list[Body] = [None] * len(octets)
    short = bool((stop - first).max() <= FREE_OCTETS)
    order = np.argsort(octets, kind="stable")
    for index in np.split(order, np.flatnonzero(np.diff(octets[order])) + 1):
        n = int(octets[index[0]])
        if n < 0:
            continue
        begin, end, which = first[index].tolist(), stop[index].tolist(), index.tolist()
        target = memoryview(bytearray(n * len(which)))
        if n == 0 or len(which) < FEW or not budget.trusting:
            failed = [*range(len(which))]
        else:
            failed = inflate(source, begin, end, target, freely=short)
            budget.trusting = len(failed) * 8 <= len(which)  # else each is inflated twice
        for at, i in zip(range(0, len(target), n or 1), which, strict=False):
            bodies[i] = target[at : at + n]
        for k in failed:
            bodies[which[k]] = inflate_one(source[begin[k] : end[k]].tobytes(), n)
    return bodies


def _with_bodies(data: bytes, rows: Rows, bodies: Sequence[Body]) -> list[bytes | None]:
    """The blocks with other octets of cells, None where there are none or where they don't fit."""
    w = window(0, data, final=True)
    head = gather(w, rows["block"], HEAD.itemsize).view(HEAD)[:, 0].copy()
    size = np.array([-1 if body is None or isinstance(body, tuple) else len(body) for body in bodies])
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
        if fit and body is not None and not isinstance(body, tuple)
        else None
        for i, (fit, body, pad, (first, last)) in enumerate(zip(fits.tolist(), bodies, pads, tails, strict=True))
    ]
