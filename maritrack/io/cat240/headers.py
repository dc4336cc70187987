"""The headers of a CAT240 file at nearly the speed of reading it; the cells stay where they are.

For recordings as they should be: frames one behind the other, whose data blocks have one video record of the usual
make each, or summaries. Where anything else begins the walk ends, and the general reader has to go on.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from maritrack.geo import C_MPS
from maritrack.io.cat240.blockstarts import DATA_BLOCKS, ROOM, U8, Frames, Pieces, frame_starts
from maritrack.io.cat240.cells import BITS_OF_RES, FEMTO, HEAD, NANO, REPETITION, TOD, VENDOR
from maritrack.io.cat240.exact import INFLATION, MAX_CELLS, TOD_PER_DAY, parse_block
from maritrack.io.cat240.framing import HEADER, window
from maritrack.io.cat240.order import REMEMBERED, Memory, screen
from maritrack.io.cat240.radials import Batch, Radials, Text
from maritrack.io.datagrams import NO_TIME
from maritrack.types import BoolArray, Damage, IntArray

ODD_LEAST, ODD_SHARE = 8, 8  # so many odd blocks, and one for so many usual ones, are still worth the walk
ODD_OCTETS = 1024  # of an odd block: a longer one holds many records
MANY_FRAMES = 1 << 17  # that are looked at together
AGAIN = 16  # frames that the general reader has to read again to know what came before
TAIL = np.dtype([("tod", ">u4"), ("after", "u1")])  # from the octet before the time of day to that behind it
COPIED = ("sac", "sic", "idx", "start_az", "end_az", "start_rg", "cell_dur")

Heads = NDArray[Any]  # of HEAD
Columns = dict[str, NDArray[Any]]


class Blocks(NamedTuple):
    """The data blocks in a piece of a recording, up to the first frame that is out of the ordinary."""

    frames: int  # frames up to there
    frame: IntArray  # (n,) of each block
    begin: IntArray  # (n,) place in the piece
    end: IntArray
    t_ns: IntArray  # receive time or NO_TIME
    stream: IntArray


class Make(Protocol):
    """What the frames of a recording are."""

    @property
    def frames(self) -> Frames: ...

    def blocks(self, octets: U8, size: int, starts: IntArray) -> Blocks: ...

    def told(self, frames: int, again: int) -> None: ...  # frames of the last blocks that are done with


class RawMake:
    """Frames that are data blocks."""

    frames = DATA_BLOCKS

    def blocks(self, octets: U8, size: int, starts: IntArray) -> Blocks:
        n = len(starts) - 1
        no_time, stream = np.broadcast_to(np.int64(NO_TIME), n), np.broadcast_to(np.int64(0), n)
        return Blocks(n, np.arange(n), starts[:-1], starts[1:], no_time, stream)

    def told(self, frames: int, again: int) -> None:
        """Nothing to do."""


class HeaderWalk:
    """The headers of a file from octet `start` to its end, or to the first thing that is out of the ordinary."""

    def __init__(self, path: Path, make: Make, *, start: int = 0) -> None:
        self.end = start  # octet up to which all was told
        self.again = start  # octet, a few frames before that
        self.whole = False  # nothing follows
        self._path, self._make = path, make
        self.memories: dict[int, Memory] = {}  # of the records that were told, as the general reader has them

    def __iter__(self) -> Iterator[Batch]:
        """Batches without cells and octets. InputError where the file can't be read."""
        with Pieces(self._path, start=self.end) as pieces:
            rest = 0
            while rest <= ROOM:
                octets, size = pieces.more(rest)
                if pieces.ended:
                    self.whole = rest == 0
                    return
                starts, base, used = frame_starts(octets, size, self._make.frames, pieces), self.end, 0
                for first in range(0, len(starts), MANY_FRAMES):
                    some = starts[first : first + MANY_FRAMES + 1]
                    batches, used = self._batches(octets, size, some, base)
                    self.end = base + used
                    yield from batches
                    if used < some[-1]:
                        return
                if used == 0:
                    return
                rest = size - used

    def _batches(self, octets: U8, size: int, starts: IntArray, base: int) -> tuple[list[Batch], int]:
        """What the frames hold, up to the first that is out of the ordinary, and where that one begins.

        Places count from octet `base` of the input.
        """
        blocks = self._make.blocks(octets, size, starts)
        usual, c = _columns(octets, size, blocks)
        n, texts = _odd_blocks(octets, base, blocks, usual)
        frames = blocks.frames if n == len(usual) else int(blocks.frame[n])
        n, used = int(np.searchsorted(blocks.frame, frames)), int(starts[frames])
        again = max(frames - AGAIN, 0)
        if frames:
            self._make.told(frames, again)
            self.again = base + int(starts[again])
        if n < len(usual) or not usual.all():
            c = _rows(c, np.flatnonzero(usual[:n]))
        if frames == 0:
            return [], used
        c["offset"] = c["offset"] + base
        at, span = base + int(starts[0]), used - int(starts[0])
        keep, damage = _screen(self.memories, c)
        c = c if keep is None else _rows(c, keep)
        if len(c["bits"]) == 0:
            return [Batch(at, b"", None, damage, span, texts)], used
        packed = c.pop("packed")
        return [Batch(at, b"", _radials(c), damage, span, texts, packed)], used


def _columns(octets: U8, size: int, blocks: Blocks) -> tuple[BoolArray, Columns]:
    """Which blocks hold one video record of the usual make (see `common_rows`), and the columns of those records."""
    begin, end = blocks.begin, blocks.end
    head = gather(octets, begin, HEAD)
    c: Columns = {name: head[name].astype(np.int64) for name in COPIED}
    c["t_ns"], c["stream"] = blocks.t_ns, blocks.stream
    c["offset"], c["packed"] = begin, head["nbvb"].astype(np.int64)
    first, second = head["fspec"][:, 0], head["fspec"][:, 1]
    c["femto"], c["compressed"] = first == FEMTO, head["flags"] > 127
    c["bits"] = BITS_OF_RES[head["res"]]
    c["n_cells"] = head["nbcells_high"].astype(np.int64) << 16 | head["nbcells_low"]
    repetition = REPETITION[second]
    room = repetition * head["rep"]
    after = begin + HEAD.itemsize + room
    tail = gather(octets, np.minimum(after - 1, size), TAIL)
    last = tail["tod"].astype(np.int64)
    timed, vendor = second & TOD > 0, second & VENDOR > 0
    c["tod"] = np.where(timed, last & 0xFFFFFF, -1)
    after += 3 * timed
    usual = repetition > 0
    if vendor.any():
        length = np.where(timed, tail["after"], last >> 16 & 0xFF)
        after += np.where(vendor, length, 0)
        usual &= (length > 0) | ~vendor
    usual &= (after == end) & (c["packed"] <= room) & (head["kind"] == 2) & (c["femto"] | (first == NANO))
    usual &= (c["bits"] > 0) & (c["cell_dur"] > 0) & ((c["end_az"] - c["start_az"]) & 65_535 <= 32_768)
    usual &= (c["tod"] < TOD_PER_DAY) & _agreeing(c)
    return usual, c


def gather(octets: U8, places: IntArray, kind: np.dtype[Any]) -> Heads:
    """The octets from each place on as a table (n,)."""
    everywhere = np.ndarray((len(octets) - kind.itemsize + 1,), dtype=f"V{kind.itemsize}", buffer=octets, strides=(1,))
    return everywhere[places].view(kind)


def _agreeing(c: Columns) -> BoolArray:
    """Whether the number of cells and the number of octets can both be true."""
    n_cells, packed = c["n_cells"], c["packed"]
    needed = n_cells * c["bits"] + 7 >> 3
    if not c["compressed"].any():
        return np.asarray(packed == needed)
    possible = (n_cells > 0) & (n_cells <= MAX_CELLS) & (needed <= INFLATION * packed)
    return np.where(c["compressed"], possible, packed == needed)


def _odd_blocks(octets: U8, base: int, blocks: Blocks, usual: BoolArray) -> tuple[int, tuple[Text, ...]]:
    """How many blocks there are before the first that holds more than a usual record or summaries, and their texts."""
    odd = np.flatnonzero(~usual).tolist()
    if not odd:
        return len(usual), ()
    from maritrack.io.cat240.reader import text_of  # most recordings have no need of the general reader

    texts: list[Text] = []
    most = ODD_LEAST + (len(usual) - len(odd)) // ODD_SHARE
    for i in odd[:most]:
        begin = int(blocks.begin[i])
        if blocks.end[i] - begin > ODD_OCTETS:
            return i, tuple(texts)
        data = octets[begin : blocks.end[i]].tobytes()
        block = parse_block(window(0, data, final=False), 0, len(data))
        if block.videos or block.damage or block.lost or not block.summaries:
            return i, tuple(texts)
        texts += [text_of(summary, base + begin) for summary in block.summaries]
    return odd[most] if most < len(odd) else len(usual), tuple(texts)


def _screen(memories: dict[int, Memory], c: Columns) -> tuple[BoolArray | None, tuple[Damage, ...]]:
    """Which records are no repetitions (None = all), and what is wrong with the order of the records."""
    sensor, idx = c["stream"] << 16 | c["sac"] << 8 | c["sic"], c["idx"]
    last = slice(-REMEMBERED, None) if _is_orderly(memories, sensor, idx, c["tod"]) else slice(None)
    keys = np.stack([c[name][last] for name in ("idx", "start_az", "end_az", "start_rg")], axis=1)
    duplicate, backwards = screen(memories, sensor=sensor[last], keys=keys, tod=c["tod"][last])
    damage = tuple(
        Damage(code, int(c["offset"][i]) + HEADER, text.format(idx[i]), f"{c['sac'][i]}-{c['sic'][i]}")
        for code, text, there in (
            ("duplicate", "message {} was there before", duplicate),
            ("tod-backwards", "time of day steps back at message {}", backwards),
        )
        for i in np.flatnonzero(there).tolist()
    )
    return (~duplicate if duplicate.any() else None), damage


def _is_orderly(memories: dict[int, Memory], sensor: IntArray, idx: IntArray, tod: IntArray) -> bool:
    """Whether all are of one sensor, indices only rise and times never fall: then only the last few matter."""
    if len(sensor) < REMEMBERED or (sensor != sensor[0]).any() or (tod < 0).any():
        return False
    memory = memories.get(int(sensor[0]), Memory())
    behind = max((key[0] for key in memory.recent), default=-1) < idx[0] and memory.tod <= tod[0]
    return bool(behind and (np.diff(idx) > 0).all() and (np.diff(tod) >= 0).all())


def picked(column: NDArray[Any], rows: IntArray) -> Any:
    """Ascending rows of a column; the column itself where these are all."""
    return column if len(rows) == len(column) else column[rows]


def _rows(c: Columns, index: IntArray | BoolArray) -> Columns:
    return {name: column[index] for name, column in c.items()}


def _radials(c: Columns) -> Radials:
    return Radials(
        **c, cells=np.zeros((len(c["bits"]), 0), dtype=np.uint8),
        cell_m=np.where(c["femto"], c["cell_dur"] * 1e-15, c["cell_dur"] * 1e-9) * (C_MPS / 2),
    )  # fmt: skip
