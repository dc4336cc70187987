"""The data blocks of a raw recording, where the reader of CAT240 finds them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from maritrack.io.cat240.cells import join_rows
from maritrack.io.cat240.exact import parse_block
from maritrack.io.cat240.framing import (
    CAT240,
    HEADER,
    Window,
    chain,
    looks_like,
    other_blocks,
    pieces,
    window,
)
from maritrack.io.cat240.items import read_items
from maritrack.io.cat240.scan import Chain, Found, scan
from maritrack.io.containers.select import spans
from maritrack.io.datagrams import NO_TIME, Datagrams
from maritrack.types import BoolArray, Damage, IntArray

BROKEN = ("lost-sync", "block-length<3", "truncated-block", "effort-budget", "not-asterix")  # octets are passed over


def data_blocks(chunks: Iterable[bytes]) -> Iterator[Datagrams]:
    """Each data block of a raw recording as a datagram; what is between them is damage.

    Every record that `read_batches` comes upon is in one of them, and what it passes over is in none. Of a block
    whose LEN reaches into the next one there is the part with its records, with the LEN that this has.
    """
    rest, base, state = b"", 0, Chain(fast=True)
    for piece in pieces(chunks):
        w = window(base, b"".join((rest, piece)), final=False)
        found = _datagrams(w, state)
        yield found
        rest, base = w.data[found.end - base :], found.end
    yield _datagrams(window(base, rest, final=True), state)


class _Blocks(NamedTuple):
    """Data blocks in a window, in order."""

    first: IntArray  # (n,)
    last: IntArray  # (n,) where it ends
    follow: IntArray  # (n,) where the reader goes on behind it, -1 = it has to look for the next one
    cut: BoolArray  # (n,) its LEN says that it ends further on


def _datagrams(w: Window, state: Chain) -> Datagrams:
    """The blocks of a window, as far as it can be judged."""
    none = np.zeros(0, dtype=np.int64)
    at, found, damage = 0, [_Blocks(none, none, none, none > 0)], list[Damage]()
    lost = state.lost >= 0
    while (some := scan(w, at, state)).end > at:
        found.append(_blocks_of(w, at, some, lost=lost))
        damage += [one for one in some.damage if one.code in BROKEN]
        at, lost = some.end, state.lost >= 0
    first, last, _, cut = (np.concatenate([blocks[i] for blocks in found]) for i in range(4))
    n = len(first)
    zeros = np.zeros(n, dtype=np.int64)
    # The window as datagrams whose bounds are the blocks' starts, then only the blocks themselves.
    whole = Datagrams(
        w.base + at, w.data, np.append(first, at), w.base + first, np.full(n, NO_TIME), zeros, tuple(damage)
    )
    return _relabelled(spans(whole, np.arange(n), first, last), cut)


def _relabelled(d: Datagrams, cut: BoolArray) -> Datagrams:
    """The blocks, those that were cut with the LEN that they have now."""
    if not cut.any():
        return d
    data = bytearray(d.data)
    for first, last in zip(d.bounds[:-1][cut].tolist(), d.bounds[1:][cut].tolist(), strict=True):
        data[first + 1 : first + HEADER] = (last - first).to_bytes(2, "big")
    return Datagrams(d.end, bytes(data), d.bounds, d.offset, d.t_ns, d.stream, d.damage)


def _blocks_of(w: Window, start: int, found: Found, *, lost: bool) -> _Blocks:
    """The blocks in what was scanned from `start` on: those with records, and what links up between them.

    `lost`: no block begins at `start`.
    """
    known = _with_records(w, found)
    if any(one.code == "effort-budget" for one in found.damage):
        return known
    before, after = np.concatenate([[-1 if lost else start], known.follow]), np.append(known.first, found.end)
    linked = [_linked(w, before[i], after[i]) for i in np.flatnonzero((before >= 0) & (before < after)).tolist()]
    if not linked:
        return known
    first, last = np.concatenate(linked).T
    both = [(known.first, first), (known.last, last), (known.follow, last), (known.cut, first < 0)]
    order = np.argsort(np.concatenate(both[0]), kind="stable")
    return _Blocks(*(np.concatenate(columns)[order] for columns in both))


def _with_records(w: Window, found: Found) -> _Blocks:
    """The blocks of which the reader has records. Where it didn't get to the end of one, it ends with its records."""
    rows = join_rows(found.rows)
    at, block, end, exact = rows["at"], rows["block"], rows["block_end"], rows["record"] >= 0
    if found.summaries:
        texts = np.array([one.at for one in found.summaries], dtype=np.int64)
        alone = np.array([one.at for one in found.summaries if looks_like(w, one.at - HEADER)], dtype=np.int64) - HEADER
        at, block = np.concatenate([at, texts]), np.concatenate([block, alone])
        end = np.concatenate([end, alone + (w.u8[alone + 1].astype(np.int64) << 8 | w.u8[alone + 2])])
        exact = np.append(exact, np.ones(len(alone), dtype=np.bool_))
    first, which = np.unique(block, return_index=True)
    last, cut = end[which], np.zeros(len(first), dtype=np.bool_)
    follow = last.copy()
    for i in np.flatnonzero(exact[which]).tolist():
        begin, stop = int(first[i]), int(last[i])
        read = parse_block(w, begin, stop)
        follow[i] = -1 if read.lost else read.resume
        cut[i] = read.resume < stop
        if cut[i]:
            record = int(at[(at > begin) & (at < read.resume)].max())
            last[i] = min(read_items(w.data, record, stop).stop, read.resume)
    return _Blocks(first, last, follow, cut)


def _linked(w: Window, at: int, stop: int) -> IntArray:
    """Starts and ends (n, 2) of blocks without records, or of other categories, that follow each other from `at` on."""
    found = [np.zeros((0, 2), dtype=np.int64)]
    while at < stop:
        if w.data[at] == CAT240:
            places = chain(w, at, (stop - at) // HEADER)
            places = places[places <= stop]
            full = np.flatnonzero(np.diff(places) > HEADER).tolist()
            odd = next((i for i in full if not _is_read(w, int(places[i]), int(places[i + 1]))), len(places))
            places = places[: odd + 1]
        else:
            places = np.array([at, *(end for end in other_blocks(w, at) if end <= stop)], dtype=np.int64)
        if len(places) < 2:
            break
        found.append(np.stack([places[:-1], places[1:]], axis=1))
        at = int(places[-1])
    return np.concatenate(found)


def _is_read(w: Window, start: int, end: int) -> bool:
    """Whether the reader goes on at the end of a block."""
    read = parse_block(w, start, end)
    return read.resume == end and not read.lost
