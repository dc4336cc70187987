"""Where the data blocks of an ASTERIX stream begin: the chain of LEN, and finding it again when it breaks.

A data block is CAT (one octet), LEN (two, counting CAT and LEN too) and its records; the next one follows at once.
Everything here is a question about a place in a window, answered from the LOOKAHEAD octets after it, so that the
answers don't depend on how the input was cut into windows.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maritrack.io.source import Come
from maritrack.types import IntArray

CAT240 = 0xF0
HEADER = 3
LENGTH = struct.Struct(">H")
LOOKAHEAD = 11 * 65_536  # a block, the hops over other categories after it, and the header where they land
HOPS = 8
FEW_HOPS = 16  # through blocks one by one, until it is known that they hold
MANY_BLOCKS = 64  # from which on it pays to look at them all at once
FEW_PLACES = 8
PIECE_LEAST, PIECE_MOST = 2 << 20, 4 << 20
CATEGORIES = frozenset(
    (*range(1, 5), *range(7, 12), *range(15, 22), 23, 24, 25, 30, 31, 32, 34, 48, 61, 62, 63, 65, 128, 129, 150, 152,
     153, 205, 238, 239, 240, 247, 252)
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """A stretch of the input in memory. Places are counted from its first octet."""

    base: int  # octet of the input where it starts
    data: bytes
    u8: NDArray[np.uint8]  # the same octets
    final: bool  # the input ends with it

    @property
    def limit(self) -> int:
        """Before this place any question has its answer; after it only whether a whole block begins here."""
        return len(self.data) if self.final else max(0, len(self.data) - LOOKAHEAD)

    def length(self, at: int) -> int:
        """LEN of the header at a place, 0 where the window ends first."""
        return self.data[at + 1] << 8 | self.data[at + 2] if at + HEADER <= len(self.data) else 0


def window(base: int, data: bytes, *, final: bool) -> Window:
    """A window over `data`, which starts at octet `base` of the input."""
    return Window(base, data, np.frombuffer(data, dtype=np.uint8), final)


def pieces(chunks: Iterable[bytes | memoryview]) -> Iterator[memoryview]:
    """The input in pieces of 2 to 4 MiB, however it was cut; smaller ones at its end, and where no more has Come yet.

    A piece is valid until the next one is asked for.
    """
    held = bytearray()
    for chunk in chunks:
        view = memoryview(chunk).cast("B")
        for at in range(0, len(view), PIECE_MOST):
            part = view[at : at + PIECE_MOST]
            if not held and len(part) >= PIECE_LEAST:
                yield part
                continue
            held += part
            if len(held) >= PIECE_LEAST or isinstance(chunk, Come):
                yield memoryview(held)
                held = bytearray()
    if held:
        yield memoryview(held)


def chain(w: Window, at: int, most: int) -> IntArray:
    """Starts of the whole CAT240 blocks that follow each other from `at`, and the end of the last.

    At most `most` blocks. Without a block the answer is `[at]`.
    """
    even = _even_blocks(w, at, most) if most >= MANY_BLOCKS else 0
    first, at = at, at + even * w.length(at)
    runs, hops = [np.arange(first, at + 1, w.length(first)) if even else np.array([at])], FEW_HOPS
    most -= even
    while most > 0:
        ends = _hop(w, int(runs[-1][-1]), min(hops, most))
        runs.append(ends)
        if len(ends) < min(hops, most):
            break
        most, hops = most - hops, 8 * hops
    return np.concatenate([run for run in runs if len(run)])


def _hop(w: Window, at: int, most: int) -> IntArray:
    """Ends of the CAT240 blocks that follow each other from `at`, at most so many."""
    starts = [at]
    lengths, append, unpack_from = memoryview(w.data)[1:], starts.append, LENGTH.unpack_from
    try:
        for _ in range(most):
            at += unpack_from(lengths, at)[0]
            append(at)
    except struct.error:  # the end of the data: cheaper than to ask each time
        pass
    places = np.fromiter(starts, dtype=np.int64, count=len(starts))
    sound = (np.diff(places) >= HEADER) & (places[1:] <= len(w.data)) & (w.u8[places[:-1]] == CAT240)
    return places[1:] if sound.all() else places[1 : 1 + int(np.argmin(sound))]


def _even_blocks(w: Window, at: int, most: int) -> int:
    """How many blocks from `at` on have the same header, where that is quick to see: the raw video of one radar."""
    length = w.length(at)
    if length < HEADER or w.data[at] != CAT240:
        return 0
    whole = min(most, (len(w.data) - at) // length)
    heads = w.u8[at : at + whole * length].reshape(whole, length)[:, :HEADER]
    for n in (min(4, whole), whole):
        same = (heads[:n] == heads[:1]).all(axis=1)
        if not same.all():
            return int(np.argmin(same))
    return whole


def is_boundary(w: Window, at: int) -> bool:
    """Whether a block may end here: at the end of the input, a CAT240 header or blocks of other categories."""
    if at >= len(w.data):
        return w.final and at == len(w.data)
    if w.data[at] == CAT240:
        return at + HEADER > len(w.data) or w.length(at) >= HEADER
    return bool(other_blocks(w, at))


def other_blocks(w: Window, at: int) -> list[int]:
    """Ends of the blocks of other categories that follow each other from `at`; none where that isn't believable.

    Any octets look like CAT and LEN. Believed is a chain of known categories that comes to a CAT240 header or to
    the end of the input, or holds for HOPS blocks; and one block of any category right before such a place, where
    a CAT240 block has to look like one. What holds CAT240 blocks that follow each other is none of these.
    """
    ends = _foreign(w, at)
    return [] if ends and _holds_blocks(w, at + 1, ends[-1]) else ends


def _foreign(w: Window, at: int) -> list[int]:
    """The same, whatever stands in them."""
    data, size = w.data, len(w.data)
    ends: list[int] = []
    known = True
    while len(ends) < HOPS:
        length = w.length(at)
        if length < HEADER or at + length > size or data[at] == 0:
            return []
        known = known and data[at] in CATEGORIES
        at += length
        ends.append(at)
        if at == size if w.final else at >= size:
            return ends
        if data[at] == CAT240:
            header = w.length(at) >= HEADER or at + HEADER > size
            return ends if header and (known or looks_like(w, at)) else []
        if not known:
            return []
    return ends[:-1]


def candidates(w: Window, at: int) -> Iterator[int]:
    """Places from `at` on, before the window's limit, that look like the start of a CAT240 block."""
    for _ in range(FEW_PLACES):
        at = w.data.find(CAT240, at, w.limit)
        if at < 0:
            return
        if looks_like(w, at):
            yield at
        at += 1
    span = 512
    while at < w.limit:
        end = min(at + span, w.limit)
        yield from lookalikes(w, at, end).tolist()
        at, span = end, min(4 * span, 1 << 20)


def looks_like(w: Window, at: int) -> bool:
    """Whether the octets here read CAT 240, a LEN inside the input and a record of a known type with a SAC/SIC.

    Octets of video often read F0; a LEN that lands on another F0 is then a matter of luck. The first record
    of a block tells more: its FSPEC has 010 and 000, and 000 is 1 or 2.
    """
    data, length = w.data, w.length(at)
    if length < HEADER + 4 or at + length > len(data) or at + HEADER + 5 > len(data):
        return False
    fspec = data[at + HEADER]
    return data[at] == CAT240 and fspec & 0xC0 == 0xC0 and data[at + HEADER + 3 + (fspec & 1)] in (1, 2)


def lookalikes(w: Window, first: int, end: int) -> IntArray:
    """All places in [first, end) that `looks_like` says yes to."""
    return _alike(w, first + np.flatnonzero(w.u8[first:end] == CAT240))


def _alike(w: Window, at: IntArray) -> IntArray:
    """Those of the places that `looks_like` says yes to."""
    u8 = w.u8
    at = at[at + HEADER + 5 <= len(u8)]
    at = at[u8[at] == CAT240]
    stop = at + (u8[at + 1].astype(np.int64) << 8 | u8[at + 2])
    fspec = u8[at + HEADER]
    kind = u8[at + HEADER + 3 + (fspec & 1)]
    good = (stop >= at + HEADER + 4) & (stop <= len(u8)) & (fspec & 0xC0 == 0xC0) & ((kind == 1) | (kind == 2))
    found: IntArray = at[good]
    return found


def _holds_blocks(w: Window, first: int, end: int) -> bool:
    """Whether in [first, end) a CAT240 block begins that another one follows."""
    if w.data.find(CAT240, first, end) < 0:
        return False
    at = lookalikes(w, first, end)
    return len(_alike(w, at + (w.u8[at + 1].astype(np.int64) << 8 | w.u8[at + 2]))) > 0
