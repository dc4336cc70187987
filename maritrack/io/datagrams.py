"""Datagrams out of any container: the payloads, where they stood, when they came, and between whom.

A container (capture, FINAL, MCAP) is read as a series of `Datagrams`. A datagram holds whole data blocks, as
ASTERIX has it; what isn't so is for the reader of the payloads to say.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from maritrack.types import Damage, IntArray, check_lengths

NO_TIME = int(np.iinfo(np.int64).min)  # no receive time


class Stream(NamedTuple):
    """Who sent to whom, as "address:port" ("[address]:port" for IPv6); "" = the container doesn't tell."""

    source: str = ""
    destination: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Datagrams:
    """The payloads that were completed in a stretch of a container, in the order in which they were."""

    end: int  # octet of the container up to which all has been looked at
    data: bytes  # the payloads, one behind the other
    bounds: IntArray  # (n + 1,) where each begins in `data`, and the end
    offset: IntArray  # (n,) octet of the container where its payload begins (of fragments: the first that came)
    t_ns: IntArray  # (n,) receive time, UNIX or since a midnight (YEAR_NS), or NO_TIME; of fragments: the last
    stream: IntArray  # (n,) index of its stream, in order of appearance
    damage: tuple[Damage, ...] = ()

    def __post_init__(self) -> None:
        check_lengths(self, len(self.offset), "t_ns", "stream")

    def __len__(self) -> int:
        return len(self.offset)


class Container(Protocol):
    """Reads a container once, from its beginning to its end, in bounded memory."""

    @property
    def streams(self) -> list[Stream]: ...  # those that have appeared; grows while reading

    def datagrams(self) -> Iterator[Datagrams]: ...


class DatagramWriter(Protocol):
    """Writes a container; `close` ends it under its final name, `abort` leaves nothing under that name.

    Not every datagram fits every container: `write` returns False for one that it can't hold.
    """

    def write(self, payload: bytes, *, t_ns: int, stream: Stream) -> bool: ...

    def flush(self) -> None: ...  # what was written so far can be read by others, also after a kill

    def close(self) -> None: ...

    def abort(self) -> None: ...
