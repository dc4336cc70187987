"""What is told of the turns of a sensor: range scales, and where records, time or the scale are amiss."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from maritrack.io.turns.spokes import NO_TICK
from maritrack.io.turns.sweep import Setting
from maritrack.types import IntArray


class Grid(NamedTuple):
    """The cells of a spoke."""

    setting: Setting
    n_cells: int


class Loss(NamedTuple):
    """Records that are missing by their MSG_INDEX."""

    t_ns: int | None
    offset: int  # octet of the recording where the next one is
    records: int


class Pause(NamedTuple):
    """A long time between two spokes."""

    ticks: int
    t_ns: int  # of the spoke before
    offset: int  # of the one after it


class Change(NamedTuple):
    """Another range scale."""

    t_ns: int | None
    offset: int
    old: Grid
    new: Grid


@dataclass(slots=True)
class Opened:
    """The turn that is being counted."""

    n: int = 0  # spokes
    kept: int = 0  # without those of a range scale of their own
    turn: int = 0  # unwrapped azimuth of the first spoke
    last: int = 0  # of the last
    low: int = 0
    high: int = 0
    tick: int = NO_TICK  # first known time
    until: int = NO_TICK  # last
    widest: int = 0  # cells
    t_ns: int | None = None  # of the first spoke
    offset: int = -1
    last_offset: int = -1
    rising: bool = True
    azimuths: list[IntArray] = field(default_factory=list)  # START and END in one, to find spokes that come again
    shown: list[tuple[IntArray, IntArray, IntArray]] = field(default_factory=list)  # of good spokes, for `Sectors`
