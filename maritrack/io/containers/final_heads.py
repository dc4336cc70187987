"""The data blocks in the records of a FINAL file, for `headers`: files as they should be.

That is records with a footer and a time of day, each with one data block of category 240. Everything else is for the
general reader.
"""

from __future__ import annotations

import numpy as np

from maritrack.io.cat240.blockstarts import U8, Frames
from maritrack.io.cat240.framing import CAT240, HEADER
from maritrack.io.cat240.headers import Blocks, gather
from maritrack.io.containers.final import FinalReader
from maritrack.io.containers.final_walk import FOOTER, HEAD, LEAP_CS, NO_TIME_CS, layout_of
from maritrack.types import IntArray

BEFORE = 7  # octets of a record's header before the data block, from the one before its line on
BLOCK_HEAD = np.dtype({
    "names": ["line", "time", "cat", "len"], "formats": [">u4", ">u4", "u1", ">u2"],  # numbers of three octets: low
    "offsets": [0, 3, BEFORE, BEFORE + 1], "itemsize": BEFORE + 3,
})  # fmt: skip


class FinalMake:
    """The records of a FINAL file that begins with `head`."""

    def __init__(self, head: bytes) -> None:
        self._layout = layout_of(head[:HEAD])
        self._reader = FinalReader(())  # counts the days and names the streams
        self.streams = self._reader.streams
        least = self._layout + HEADER + 1 + len(FOOTER)
        self.frames = Frames(">u2", 0, 0, least, (self._layout, self._layout + HEADER))

    def blocks(self, octets: U8, size: int, starts: IntArray) -> Blocks:
        """The data blocks of the records that begin at `starts`, up to the first that is out of the ordinary."""
        begin, end = starts[:-1] + self._layout, starts[1:] - len(FOOTER)
        head, footer = gather(octets, begin - BEFORE, BLOCK_HEAD), gather(octets, end, np.dtype("V4"))
        time_cs = head["time"].astype(np.int64) & 0xFF_FFFF
        good = (head["cat"] == CAT240) & (head["len"] == end - begin)
        good &= footer.view("<u4") == int.from_bytes(FOOTER, "little")
        good &= (time_cs < LEAP_CS) | (time_cs == NO_TIME_CS)
        n = len(begin) if good.all() else int(np.argmin(good))
        begin, end = begin[:n], end[:n]
        t_ns, stream = self._reader.headers(head["line"][:n].astype(np.int64) & 0xFF_FFFF, time_cs[:n])
        return Blocks(n, np.arange(n), begin, end, t_ns, stream)

    def told(self, frames: int, again: int) -> None:
        """Nothing to do."""
