"""The data blocks of many datagrams, and which of them hold one record of the usual make."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from maritrack.io.cat240.cells import Rows, common_rows
from maritrack.io.cat240.framing import CAT240, HEADER, window
from maritrack.io.cat240.recordwalk import first_records
from maritrack.io.datagrams import Datagrams
from maritrack.io.rewrite.recode import data_blocks
from maritrack.types import BoolArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """The data blocks of datagrams; octets that are no whole block are one too."""

    bounds: IntArray  # (m + 1,) where each begins in the data, and the end
    owner: IntArray  # (m,) index of its datagram
    whole: BoolArray  # (m,) it is a CAT240 block with at least one octet of a record
    usual: BoolArray  # (m,) with one record of the usual make
    rows: Rows  # (m,) with a meaning where usual
    odd: IntArray  # index of the other whole blocks
    present: IntArray  # (odd,) bits of the items of their record, 0 where it isn't one sound record
    source: IntArray  # (odd,) SAC << 8 | SIC of that record, -1 = none
    code: IntArray  # (odd,) why their first record can't be read, see `First`


def blocks_of(d: Datagrams) -> Blocks:
    """The data blocks of datagrams."""
    bounds, owner = d.bounds, np.arange(len(d))
    if len(d) and not (one := _lengths(d.data, bounds) == np.diff(bounds)).all():
        bounds, owner = _cut(d, np.flatnonzero(~one))
    size = np.diff(bounds)
    category = np.frombuffer(d.data, dtype=np.uint8)[bounds[:-1][size > 0]]
    whole = (size > HEADER) & (_lengths(d.data, bounds) == size)
    whole[size > 0] &= category == CAT240
    usual, rows = common_rows(window(0, d.data, final=True), bounds[:-1], bounds[1:])
    odd = np.flatnonzero(whole & ~usual)
    first = first_records(np.frombuffer(d.data, dtype=np.uint8), bounds[odd], bounds[odd + 1])
    return Blocks(bounds, owner, whole, usual & whole, rows, odd, *first)


def part_of(d: Datagrams, first: int, last: int) -> Datagrams:
    """The datagrams from the index `first` up to `last`, without what was told of them."""
    if (first, last) == (0, len(d)):
        return d
    begin, end = int(d.bounds[first]), int(d.bounds[last])
    return Datagrams(
        d.end, d.data[begin:end], d.bounds[first : last + 1] - begin, d.offset[first:last], d.t_ns[first:last],
        d.stream[first:last],
    )  # fmt: skip


def joined(parts: list[bytes], owner: IntArray) -> list[bytes]:
    """The parts of each owner joined; owners don't fall."""
    cuts = np.flatnonzero(np.diff(owner)) + 1
    if len(cuts) + 1 >= len(parts):
        return parts
    return [b"".join(parts[first:last]) for first, last in pairwise([0, *cuts.tolist(), len(parts)])]


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
