"""A file in large pieces, and where the frames in a piece begin: data blocks, or packets of a capture.

The chain of lengths is the authority, as everywhere. Frames of one length are counted at once; short ones are looked
for by two of their octets, and what is found has to link up; only the rest is gone through one by one.
"""

from __future__ import annotations

import struct
import threading
from bisect import bisect_left
from pathlib import Path
from queue import SimpleQueue
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maritrack.errors import InputError
from maritrack.io.cat240.framing import CAT240, HEADER
from maritrack.types import IntArray

SPAN = 16 << 20  # octets read at once
ROOM = 1 << 17  # before them, for a frame that begins in the piece before
SLACK = 1 << 10  # after them, which may be looked at though nothing is there
ALIGNED = 64  # octets: reading to other places can take several times as long
SLAB = 1 << 19  # octets that the cache of a processor holds
FEW = 64  # frames that are gone through one by one before the next look for something quicker
SHORT = 900  # octets of a frame up to which looking for it is quicker than going through

U8 = NDArray[np.uint8]
NONE: IntArray = np.zeros(0, dtype=np.int64)


class Frames(NamedTuple):
    """How frames tell their length, and what they look like."""

    word: str  # numpy type of the number
    at: int  # where it is
    more: int  # octets that it doesn't count
    least: int  # octets of a frame, with these
    marks: tuple[int, int]  # places of two octets that most frames have alike
    first: int = -1  # first octet of every frame, -1 = any

    @property
    def number(self) -> struct.Struct:
        return struct.Struct(self.word[0] + {"u2": "H", "u4": "I"}[self.word[1:]])


DATA_BLOCKS = Frames(">u2", 1, 0, HEADER + 1, (0, HEADER), CAT240)


class Marks(NamedTuple):
    """Two octets by which frames are looked for, and their places in a frame."""

    places: tuple[int, int]
    octets: tuple[int, int]

    def found(self, octets: U8, first: int, last: int) -> IntArray:
        """Places from `first` up to `last` that have them."""
        found = [NONE]
        for at in range(first, last, SLAB):
            end = min(at + SLAB, last)
            there = octets[at + self.places[1] : end + self.places[1]] == self.octets[1]
            there &= octets[at + self.places[0] : end + self.places[0]] == self.octets[0]
            found.append(np.flatnonzero(there) + at)
        return np.concatenate(found)


class Pieces:
    """A file, read ahead into two buffers that take turns. InputError where it can't be read.

    The thread that reads ahead also looks for `marks` in what it has read.
    """

    def __init__(self, path: Path, *, start: int = 0) -> None:
        self.ended = False  # there was no more of the file
        self.marks: Marks | None = None
        self.found: tuple[Marks, IntArray] | None = (
            None  # marks that were looked for in the last piece, and where they are
        )
        self._path, self._start, self._span = path, start, SPAN
        self._free: SimpleQueue[U8 | None] = SimpleQueue()
        self._full: SimpleQueue[tuple[U8, int, tuple[Marks, IntArray] | None] | OSError] = SimpleQueue()
        self._buffer: U8 | None = None
        self._stop = ROOM  # of what is in it

    def __enter__(self) -> Pieces:
        for _ in range(2):
            self._free.put(_aligned(ROOM + self._span + SLACK))
        threading.Thread(target=self._read, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._free.put(None)

    def more(self, rest: int) -> tuple[U8, int]:
        """The last `rest` octets of the piece before (at most ROOM) with those that follow, and how many there are.

        SLACK octets behind them are there without a meaning. The piece is valid until the next one is asked for.
        """
        got = self._full.get()
        if isinstance(got, OSError):
            raise InputError(f"{self._path}: {got.strerror}") from got
        buffer, n, found = got
        if self._buffer is not None:
            buffer[ROOM - rest : ROOM] = self._buffer[self._stop - rest : self._stop]
            self._free.put(self._buffer)
        self._buffer, self._stop, self.ended = buffer, ROOM + n, n == 0
        octets = buffer[ROOM - rest :]
        self.found = found and (found[0], np.concatenate([found[0].found(octets, 0, rest), found[1] + rest]))
        return octets, rest + n

    def _read(self) -> None:
        """Fill the buffers that are free, until there is no more."""
        try:
            with open(self._path, "rb", buffering=0) as file:
                file.seek(self._start)
                n = 1
                while n and (buffer := self._free.get()) is not None:
                    n = file.readinto(buffer[ROOM : ROOM + self._span].data)
                    marks = self.marks
                    found = marks and (marks, marks.found(buffer[ROOM:], 0, n))
                    self._full.put((buffer, n, found))
        except OSError as error:
            self._full.put(error)


def _aligned(size: int) -> U8:
    whole = np.zeros(size + ALIGNED, dtype=np.uint8)
    return whole[-whole.ctypes.data % ALIGNED :][:size]


def frame_starts(octets: U8, size: int, frames: Frames, pieces: Pieces | None = None) -> IntArray:
    """Starts of the frames that follow each other from place 0 on, and the end of the last whole one.

    At least SLACK octets behind the first `size` may be looked at. `pieces` is told what to look for in the next piece.
    """
    runs = [np.zeros(1, dtype=np.int64)]
    at, hops = 0, FEW
    places: _Places | None = None
    while True:
        run = _even_run(octets, at, size, frames)
        if len(run):
            hops = FEW
        else:
            run = _hop(octets, at, size, frames, hops)
            if len(run) == 0:
                break
            if int(run[-1]) - at > SHORT * len(run):
                hops *= 4
            else:
                runs.append(run)
                places = places or _Places(octets, at, size, frames, pieces)
                run = places.linked(int(run[-1]))
        runs.append(run)
        at = int(run[-1]) if len(run) else int(runs[-2][-1])
    starts = np.concatenate(runs)
    if pieces is not None:
        pieces.marks = places.marks if places is not None and 2 * len(places) > len(starts) else None
    return starts


def _even_run(octets: U8, at: int, size: int, frames: Frames) -> IntArray:
    """Ends of the frames from `at` on that have one length, if there are not too few of them."""
    if size - at < FEW * frames.least:
        return NONE
    length = int(frames.number.unpack_from(octets.data, at + frames.at)[0])
    step = length + frames.more
    whole = (size - at) // step if step >= frames.least else 0
    if whole < FEW:
        return NONE
    lengths = np.ndarray((whole,), dtype=frames.word, buffer=octets, offset=at + frames.at, strides=(step,))
    if (lengths[:4] != length).any():
        return NONE
    same = lengths == length
    if frames.first >= 0:
        same &= octets[at : at + whole * step : step] == frames.first
    whole = whole if same.all() else int(np.argmin(same))
    return np.arange(at + step, at + whole * step + 1, step) if whole >= FEW else NONE


def _hop(octets: U8, at: int, size: int, frames: Frames, most: int) -> IntArray:
    """Ends of the frames that follow each other from `at` on, at most so many."""
    first, places, more = at, list[int](), frames.more
    data, append, unpack_from = octets[frames.at : size].data, places.append, frames.number.unpack_from
    try:
        for _ in range(most):
            at += unpack_from(data, at)[0] + more
            append(at)
    except struct.error:  # the end of the data
        pass
    ends = np.fromiter(places, dtype=np.int64, count=len(places))
    starts = np.append(first, ends)[:-1]
    sound = (ends - starts >= frames.least) & (ends <= size)
    if frames.first >= 0:
        sound &= octets[np.minimum(starts, size)] == frames.first
    return ends if sound.all() else ends[: int(np.argmin(sound))]


class _Places:
    """Places that look like the beginning of a frame like the one at `at`, to be linked up by their lengths."""

    def __init__(self, octets: U8, at: int, size: int, frames: Frames, pieces: Pieces | None) -> None:
        if pieces is not None and pieces.found is not None:
            self.marks, places = pieces.found
        else:
            one, two = frames.marks
            self.marks = Marks(frames.marks, (int(octets[at + one]), int(octets[at + two])))
            places = self.marks.found(octets, at, size)
        every = np.ndarray((size,), dtype=frames.word, buffer=octets, offset=frames.at, strides=(1,))
        ends = places + frames.more + every[places]
        whole = (ends <= size) & (ends >= places + frames.least)
        self._places: IntArray = places[whole]
        self._ends: IntArray = ends[whole]
        self._breaks: list[int] = np.flatnonzero(self._ends[:-1] != self._places[1:]).tolist()

    def __len__(self) -> int:
        return len(self._places)

    def linked(self, at: int) -> IntArray:
        """Ends of the frames from `at` on, each of which begins where the one before ends."""
        runs, places, n = [NONE], self._places, len(self._places)
        i = int(places.searchsorted(at))
        while i < n and places[i] == at:
            k = bisect_left(self._breaks, i)
            last = self._breaks[k] if k < len(self._breaks) else n - 1
            runs.append(self._ends[i : last + 1])
            at, i = int(self._ends[last]), last + 1
            i += int(places[i:].searchsorted(at)) if i < n and places[i] < at else 0
        return np.concatenate(runs)
