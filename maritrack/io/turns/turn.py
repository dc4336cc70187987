"""The spokes of one turn of an antenna: as they are collected, and as a block when the turn is over."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maritrack.io.cat240.cells import cell_type
from maritrack.io.turns.spokes import NO_TICK, TICKS_PER_S, TURN, Spokes
from maritrack.types import BoolArray, Damage, IntArray

Cells = NDArray[np.unsignedinteger[Any]]
LEAST_ADVANCE = TURN * 5 // 100 + 1  # of a turn that was cut short: what is shorter is dropped
KEEP_BLOCK = 4  # a block of cells that is larger than the rows in use by this is not kept for them


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """The spokes of one rotation, as sent, in order of time."""

    sensor: str
    segment: int
    spokes: Spokes  # (a,) headers
    t_ns: IntArray  # (a,) since midnight of the recording's first day
    cells: Cells  # (a, b)


@dataclass(slots=True)
class OpenTurn:
    """A turn that is being collected."""

    tables: list[Spokes] = field(default_factory=list)
    pieces: list[tuple[Cells, IntArray]] = field(default_factory=list)  # rows of blocks of cells
    n: int = 0
    widest: int = 0  # cells
    turn: int = 0  # unwrapped azimuth of the first spoke
    tick: int = NO_TICK  # first known time
    low: int = 0  # least and greatest unwrapped azimuth
    high: int = 0

    def add(self, table: Spokes) -> None:
        """Headers of the next spokes, at least one."""
        turn = table["turn"]
        if self.n == 0:
            self.turn = self.low = self.high = int(turn[0])
        self.low, self.high = min(self.low, int(turn.min())), max(self.high, int(turn.max()))
        if self.tick == NO_TICK:
            known = table["tick"][table["tick"] != NO_TICK]
            self.tick = int(known[0]) if len(known) else NO_TICK
        self.widest = max(self.widest, int(table["n_cells"].max()))
        self.n += len(table)
        self.tables.append(table)

    @property
    def worth_a_scan(self) -> bool:
        """Whether what there is covers 5 % of a turn."""
        return self.high - self.low >= LEAST_ADVANCE and bool(self.pieces)

    def let_go(self, block: Cells) -> None:
        """Copy the latest rows if they are a few of a block of cells, so that it does not stay in memory for them."""
        if self.pieces and self.pieces[-1][0] is block:
            rows = self.pieces[-1][1]
            if len(rows) * KEEP_BLOCK < len(block):
                self.pieces[-1] = (block[rows, : self.widest], np.arange(len(rows)))

    def spokes(self) -> Spokes:
        return np.concatenate(self.tables) if len(self.tables) > 1 else self.tables[0]

    def cells(self, width: int, bits: int) -> Cells:
        """The cells of all spokes but the odd ones, (a, width) of so many bits, each copied once."""
        n = sum(len(rows) for _, rows in self.pieces)
        block = np.empty((n, width), dtype=cell_type(bits))
        at = 0
        for cells, rows in self.pieces:
            _copy_rows(cells, rows, block[at : at + len(rows)])
            at += len(rows)
        return block


def _copy_rows(cells: Cells, rows: IntArray, out: Cells) -> None:
    width = min(cells.shape[1], out.shape[1])
    out[:, width:] = 0
    if int(rows[-1]) - int(rows[0]) == len(rows) - 1:  # rows increase, so these follow each other
        out[:, :width] = cells[rows[0] : rows[-1] + 1, :width]
    elif width == cells.shape[1] == out.shape[1] and cells.dtype == out.dtype:
        np.take(cells, rows, axis=0, out=out, mode="clip")
    else:
        out[:, :width] = cells[rows, :width]


def last_of_repeats(spokes: Spokes) -> BoolArray:
    """False for each spoke whose azimuths come again later in the turn."""
    if (np.diff(spokes["turn"]) > 0).all() and not spokes["stray"].any():
        return np.ones(len(spokes), dtype=bool)
    key = spokes["start_az"] * TURN + spokes["end_az"]
    _, from_end = np.unique(key[::-1], return_index=True)
    last = np.zeros(len(spokes), dtype=bool)
    last[len(spokes) - 1 - from_end] = True
    return last


def findings(spokes: Spokes, sensor: str) -> Iterator[Damage]:
    """What was wrong with the spokes of a turn: one line a kind, at the first place."""
    lost, back = int(spokes["lost"].sum()), int(spokes["set_back"].sum()) / TICKS_PER_S
    for code, column, text in (
        ("lost-records", "lost", f"{lost} records missing by MSG_INDEX"),
        ("odd-range", "odd", "spokes with a range scale of their own, left out"),
        ("stray-azimuth", "stray", "spokes whose azimuth fits neither neighbour"),
        ("clock-back", "set_back", f"the clock went back by {back:g} s: time goes on from where it was"),
    ):
        wrong = spokes[column] > 0
        if wrong.any():
            n, first = int(wrong.sum()), int(spokes["offset"][np.argmax(wrong)])
            message = f"{n} {text}" if column in ("odd", "stray") else text
            yield Damage(code, first, message, sensor, lost if column == "lost" else n)


@dataclass(frozen=True, slots=True, eq=False)
class Cut:
    """The end of a turn. `turn` is None where what there was is not worth a scan."""

    found: int  # number of the record at which the end was certain
    offset: int  # octet of the input where the next turn's first spoke is
    turn: Turn | None
    damage: tuple[Damage, ...]
