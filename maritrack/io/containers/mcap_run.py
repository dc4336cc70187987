"""The messages that follow each other in a chunk of an MCAP file, found one by one and read together."""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maritrack.io.containers.mcap_stream import RECORD
from maritrack.io.containers.mcap_walk import MESSAGE
from maritrack.types import BoolArray, IntArray

MOST = 16_384  # messages taken together
HEAD = np.dtype([
    ("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("t_ns", "<i8"), ("sent_ns", "<u8"),
])  # fmt: skip


class Messages(NamedTuple):
    """Where the payloads of messages begin and end, (n,), and what stands before them."""

    first: IntArray
    end: IntArray
    head: NDArray[np.void]  # of HEAD

    def of(self, rows: BoolArray) -> Messages:
        return self if rows.all() else Messages(self.first[rows], self.end[rows], self.head[rows])

    def channels(self) -> list[int]:
        """Numbers of their channels, in order of appearance."""
        ids, first = np.unique(self.head["channel"], return_index=True)
        found: list[int] = ids[np.argsort(first)].tolist()
        return found


def messages_from(data: memoryview, at: int, most: int) -> Messages:
    """The whole messages that follow each other from a place on, at most so many."""
    places, unpack_from = list[int](), RECORD.unpack_from
    try:
        for _ in range(min(most, MOST)):
            opcode, length = unpack_from(data, at)
            if opcode != MESSAGE:
                break
            places.append(at)
            at += RECORD.size + length
    except (struct.error, OverflowError):  # the end of the data
        pass
    starts = np.array(places, dtype=np.int64)
    starts = starts[starts + HEAD.itemsize <= len(data)]
    # A view with a head at every place, of which only the wanted ones are copied.
    everywhere = np.ndarray((max(len(data) - HEAD.itemsize + 1, 0),), f"V{HEAD.itemsize}", data, strides=(1,))
    head = everywhere[starts].view(HEAD)
    length = np.minimum(head["length"], len(data)).astype(np.int64)
    end = starts + RECORD.size + length
    good = (length >= HEAD.itemsize - RECORD.size) & (end <= len(data))
    n = len(starts) if good.all() else int(np.argmin(good))
    return Messages(starts[:n] + HEAD.itemsize, end[:n], head[:n])
