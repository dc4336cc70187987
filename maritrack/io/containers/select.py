"""Which datagrams hold CAT240, and which octets of them are whole data blocks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from maritrack.errors import UsageError
from maritrack.io.cat240.framing import CAT240, HEADER, window
from maritrack.io.cat240.items import next_block
from maritrack.io.datagrams import Datagrams, Stream
from maritrack.types import BoolArray, Damage, IntArray

BLOCKS_LOOKED_AT = 64  # of other categories before the first of CAT240


class Selection:
    """Chooses the streams that hold CAT240, by what their datagrams hold, and of these the one asked for.

    `wanted` is "address", "address:port" or ":port" of the source or the destination; "" = all. A stream that has
    shown a CAT240 data block is taken from there on, whatever its datagrams are.
    """

    def __init__(self, streams: list[Stream], *, wanted: str = "") -> None:
        self._streams, self._wanted = streams, check_wanted(wanted)
        self._holds: list[bool] = []  # by stream: has shown CAT240
        self.counts: list[int] = []  # by stream: datagrams seen
        self.known: frozenset[Stream] = frozenset()  # streams that have shown CAT240 before

    def holding(self) -> list[int]:
        """The streams that have shown CAT240, whether asked for or not."""
        return [i for i, holds in enumerate(self._holds) if holds]

    def take(self, d: Datagrams) -> Datagrams:
        """The datagrams of the streams that are chosen."""
        if len(d) == 0:
            return d
        n = len(self._streams)
        self._holds += [stream in self.known for stream in self._streams[len(self._holds) :]]
        self.counts += [0] * (n - len(self.counts))
        seen = np.bincount(d.stream, minlength=n)
        keep = np.ones(len(d), dtype=np.bool_)
        order, ends = np.argsort(d.stream, kind="stable"), np.cumsum(seen)
        for stream in np.flatnonzero(seen).tolist():
            self.counts[stream] += int(seen[stream])
            rows = order[ends[stream] - seen[stream] : ends[stream]]
            if not self._holds[stream]:
                first = self._first(d, rows)
                keep[rows[:first]] = False
                self._holds[stream] = first < len(rows)
            if self._wanted and not matches(self._streams[stream], self._wanted):
                keep[rows] = False
        return d if keep.all() else subset(d, keep)

    @staticmethod
    def _first(d: Datagrams, rows: IntArray) -> int:
        """The first of the rows that holds CAT240, or how many there are."""
        for i, (begin, end) in enumerate(zip(d.bounds[rows].tolist(), d.bounds[rows + 1].tolist(), strict=True)):
            if holds_cat240(d.data, begin, end):
                return i
        return len(rows)


def check_wanted(wanted: str) -> str:
    """A stream as people write it; UsageError where it can't be one."""
    _, colon, port = wanted.rpartition(":")
    if wanted and (wanted != wanted.strip() or (colon and not wanted.endswith("]") and not port.isdigit())):
        raise UsageError(f"stream '{wanted}': write ADDRESS, ADDRESS:PORT or :PORT")
    return wanted


def matches(stream: Stream, wanted: str) -> bool:
    """Whether the source or the destination of a stream is the one asked for."""
    for end in stream:
        address, _, port = end.rpartition(":")
        if end and wanted in (end, address, address.strip("[]"), f":{port}"):
            return True
    return False


def holds_cat240(data: bytes, begin: int, end: int) -> bool:
    """Whether there is a CAT240 data block at the beginning of a datagram or behind blocks of other categories.

    The first record must have a source and a known type, so that any text or number isn't taken for one.
    """
    at = begin
    for _ in range(BLOCKS_LOOKED_AT):
        if at + HEADER + 5 > end:
            return False
        if data[at] == CAT240:
            fspec = data[at + HEADER]
            return fspec & 0xC0 == 0xC0 and data[at + HEADER + 3 + (fspec & 1)] in (1, 2)
        length = data[at + 1] << 8 | data[at + 2]
        if data[at] == 0 or length < HEADER + 1:
            return False
        at += length
    return False


def is_blocks(payload: bytes) -> bool:
    """Whether a datagram is made of whole data blocks, so that it can stand in a recording without any frame."""
    at, size = 0, len(payload)
    while at + HEADER <= size and payload[at] > 0:
        length = payload[at + 1] << 8 | payload[at + 2]
        if length < HEADER:
            return False
        at += length
    return at == size > 0


def subset(d: Datagrams, keep: BoolArray) -> Datagrams:
    """Those datagrams alone."""
    rows = np.flatnonzero(keep)
    return spans(d, rows, d.bounds[rows], d.bounds[rows + 1])


def spans(d: Datagrams, rows: IntArray, begin: IntArray, end: IntArray) -> Datagrams:
    """The stretches from `begin` to `end` of the data as datagrams; `rows` says of which datagram each is."""
    view = memoryview(d.data)
    cuts = np.flatnonzero(begin[1:] != end[:-1]) + 1  # neighbours are copied at once
    first, last = begin[np.concatenate([[0], cuts])] if len(rows) else begin, end[np.append(cuts - 1, -1)[: len(rows)]]
    data = b"".join(view[a:b] for a, b in zip(first.tolist(), last.tolist(), strict=True))
    return replace(
        d, data=data, bounds=np.concatenate([[0], np.cumsum(end - begin)]), t_ns=d.t_ns[rows], stream=d.stream[rows],
        offset=d.offset[rows] + begin - d.bounds[rows],
    )  # fmt: skip


def whole_blocks(d: Datagrams) -> Datagrams:
    """The datagrams without what isn't a data block, which is told as damage.

    A datagram ends with a data block, so a wrong length can't reach into the next one.
    """
    if not d.data:
        return d
    u8 = np.frombuffer(d.data, dtype=np.uint8)
    begin, end = d.bounds[:-1], d.bounds[1:]
    roomy = end - begin >= HEADER
    at = np.where(roomy, begin, 0)
    one_block = roomy & ((u8[np.minimum(at + 1, len(u8) - 1)].astype(np.int64) << 8
                          | u8[np.minimum(at + 2, len(u8) - 1)]) == end - begin)  # fmt: skip
    if one_block.all():
        return d
    rows: list[int] = []
    good: list[tuple[int, int]] = []
    damage: list[Damage] = []
    for i in np.flatnonzero(~one_block).tolist():
        found, wrong = _blocks_of(d, i)
        if not wrong and len(found) == 1:
            one_block[i] = True
        rows += [i] * len(found)
        good += found
        damage += wrong
    if one_block.all() and not damage:
        return d
    plain = np.flatnonzero(one_block)
    odd = ~one_block[np.array(rows, dtype=np.int64)] if rows else np.zeros(0, dtype=np.bool_)
    places = np.array(good, dtype=np.int64).reshape(-1, 2)[odd]
    all_rows = np.concatenate([plain, np.array(rows, dtype=np.int64)[odd]])
    all_spans = np.concatenate([np.stack([begin[plain], end[plain]], axis=1), places])
    order = np.argsort(all_spans[:, 0], kind="stable")
    cut = spans(d, all_rows[order], all_spans[order, 0], all_spans[order, 1])
    return replace(cut, damage=(*d.damage, *damage))


def _blocks_of(d: Datagrams, i: int) -> tuple[list[tuple[int, int]], list[Damage]]:
    """The stretches of one datagram that are whole data blocks, and what the rest is."""
    begin, stop = int(d.bounds[i]), int(d.bounds[i + 1])
    at = first = begin
    found: list[tuple[int, int]] = []
    damage: list[Damage] = []
    while at < stop:
        length = d.data[at + 1] << 8 | d.data[at + 2] if at + HEADER <= stop else 0
        if length >= HEADER and at + length <= stop and d.data[at] > 0:
            at += length
            continue
        if at > first:
            found.append((first, at))
        damage.append(_broken(d, i, at, length, stop))
        rest = window(0, d.data[at + 1 : stop], final=True)
        first = at = at + 1 + min(next_block(rest, 0)[0], len(rest.data))
    if at > first:
        found.append((first, at))
    return found, damage


def _broken(d: Datagrams, i: int, at: int, length: int, stop: int) -> Damage:
    """What is wrong where a datagram doesn't go on with a whole data block."""
    place = int(d.offset[i]) + at - int(d.bounds[i])
    if d.data[at] != CAT240:
        return Damage("lost-sync", place, f"no data block begins here, {stop - at} octets before its datagram ends")
    if length < HEADER and at + HEADER <= stop:
        return Damage("block-length<3", place, f"a data block of {length} octets")
    claim = f"a data block of {length} octets" if length else "the header of a data block"
    return Damage("truncated-block", place, f"{claim}, of which the datagram has {stop - at}")
