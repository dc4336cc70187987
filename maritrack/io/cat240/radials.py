"""What the CAT240 reader delivers: batches of radials as arrays, with the octets they came from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maritrack.geo import C_MPS
from maritrack.io.cat240.cells import Cells, Rows
from maritrack.io.cat240.framing import Window
from maritrack.io.datagrams import NO_TIME
from maritrack.types import BoolArray, Damage, FloatArray, IntArray, check_lengths

COLUMNS = ("sac", "sic", "idx", "start_az", "end_az", "start_rg", "cell_dur", "tod")


@dataclass(frozen=True, slots=True, eq=False)
class Radials:
    """Video records in the order of the input.

    Integers are as sent; `cells` holds native unsigned integers of the smallest type that fits the most `bits`
    (uint8 up to 8 bit, uint16, uint32), zero beyond `n_cells`.
    """

    offset: IntArray  # (n,) octet of the input where the record's data block starts
    sac: IntArray  # (n,)
    sic: IntArray  # (n,)
    idx: IntArray  # (n,) MSG_INDEX
    start_az: IntArray  # (n,) 360/65536 deg
    end_az: IntArray  # (n,)
    start_rg: IntArray  # (n,) in cells
    cell_dur: IntArray  # (n,) as sent, ns or fs
    femto: BoolArray  # (n,) unit of cell_dur
    cell_m: FloatArray  # (n,) depth of a cell
    compressed: BoolArray  # (n,)
    tod: IntArray  # (n,) 1/128 s since midnight as sent, -1 = absent or impossible
    t_ns: IntArray  # (n,) receive time: UNIX, or since a midnight (less than a year), or NO_TIME
    stream: IntArray  # (n,) index of the stream that it came in
    n_cells: IntArray  # (n,) cells delivered
    bits: IntArray  # (n,) of a cell
    cells: NDArray[np.unsignedinteger[Any]]  # (n, w); (n, 0) where only headers were asked for

    def __post_init__(self) -> None:
        check_lengths(
            self, len(self.offset), "sac", "sic", "idx", "start_az", "end_az", "start_rg", "cell_dur", "femto",
            "cell_m", "compressed", "tod", "t_ns", "stream", "n_cells", "bits", "cells",
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.offset)


class Text(NamedTuple):
    """What a summary record says."""

    offset: int  # octet of the input where the record is
    sensor: str  # "7-42", "" where it doesn't tell
    text: bytes


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """A stretch of the input and what was found in it. Batches follow each other without a gap.

    Places count in the container, unpacked; the octets are as they are stored.
    """

    start: int  # first octet
    octets: bytes | memoryview  # the input from start on, untouched; b"" where only headers were asked for
    radials: Radials | None  # None = no video record in this stretch
    damage: tuple[Damage, ...] = ()
    span: int = -1  # octets from start on that it stands for, -1 = its own
    texts: tuple[Text, ...] = ()  # of summary records
    packed: IntArray | None = None  # (n,) octets of the cells of each radial, as sent

    @property
    def end(self) -> int:
        return self.start + (self.span if self.span >= 0 else len(self.octets))


def as_radials(w: Window, rows: Rows, cells: Cells, n_cells: IntArray, stream: IntArray) -> Radials:
    """Rows (n,) of a window with their cells, of which each has `n_cells` (n,)."""
    columns = {name: np.ascontiguousarray(rows[name]) for name in COLUMNS}
    femto = rows["femto"] > 0
    widest = min(int(n_cells.max()), cells.shape[1])
    return Radials(
        offset=w.base + rows["block"], **columns, femto=femto,
        cell_m=np.where(femto, rows["cell_dur"] * 1e-15, rows["cell_dur"] * 1e-9) * C_MPS / 2,
        t_ns=np.full(len(rows), NO_TIME), stream=stream, compressed=rows["compressed"] > 0, n_cells=n_cells,
        bits=np.ascontiguousarray(rows["bits"]),
        cells=cells if cells.shape[1] == widest else np.ascontiguousarray(cells[:, :widest]),
    )  # fmt: skip


def summed(damage: list[Damage]) -> tuple[Damage, ...]:
    """The same with one entry for what happened several times in a row."""
    runs = groupby(damage, key=lambda one: (one.code, one.sensor))
    return tuple(_sum_of(list(run)) for _, run in runs)


def _sum_of(run: list[Damage]) -> Damage:
    first = run[0]
    return first if len(run) == 1 else replace(first, count=sum(one.count for one in run))
