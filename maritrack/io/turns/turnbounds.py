"""What bounds turns: one alone, and all of an input together, so that a hostile one does not take all there is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from maritrack.io.turns.shortruns import MAX_TICKS
from maritrack.io.turns.spokes import NO_TICK
from maritrack.io.turns.sweep import Swept

MAX_SPOKES = 65_536  # of a turn
MAX_CELLS = 1 << 26  # of a turn, padding included; of 16 bit half as many, of 32 bit a quarter
SILENT_TURNS = 3
FREE_SCANS, LEAST_SPOKES = 256, 128
BUDGET_FLOOR, BUDGET_RATIO = 1 << 28, 256  # octets of cells in turns, and more for each octet of input


@dataclass(slots=True)
class TurnBudget:
    """What the turns of all sensors of an input may take together."""

    used: int = 0  # octets of cells

    def allows(self, octets: int, place: int) -> bool:
        """Whether a turn may have so many more, now that the input is read up to an octet; then they are used."""
        if self.used + octets > BUDGET_FLOOR + BUDGET_RATIO * place:
            return False
        self.used += octets
        return True


class Limits(NamedTuple):
    """What can't be exceeded within a stretch, so that it needn't be looked for in each turn."""

    n_cells: int
    silence: int  # ticks
    long: bool  # it may last longer than a turn
    most_cells: int = MAX_CELLS  # of a turn


def limits_of(s: Swept, begin: int) -> Limits:
    ticks = s.tick if s.tick.min() != NO_TICK else s.tick[s.tick != NO_TICK]
    if begin != NO_TICK:
        ticks = np.append(ticks, begin)
    return Limits(int(s.n_cells.max()), int(s.silence.max()), len(ticks) > 0 and int(np.ptp(ticks)) > MAX_TICKS)
