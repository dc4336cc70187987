"""How likely the counts are that a pixel had: one sorted table of pairs, a row of the model and a count above 0.

A count that is not observed becomes less likely by the learning rate with each look, so its entry stays as it is if it
is told as a level: log psi plus the time of the row, which is counted in e-folds and stands still while the row is not
looked at. Only what a scan observes is written.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from maritrack.types import BoolArray, FloatArray, IntArray

BITS = 15  # of a count in a name
D = TypeVar("D", bound=np.generic)


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """Entries ascending by name."""

    name: IntArray  # (p,) row << BITS | count
    level: FloatArray  # (p,) log psi + time of the row

    def __len__(self) -> int:
        return len(self.name)

    @property
    def row(self) -> IntArray:
        """Row of each entry (p,)."""
        return self.name >> BITS

    @property
    def count(self) -> IntArray:
        """Count of each entry (p,)."""
        return self.name & ((1 << BITS) - 1)


NO_PAIRS = Pairs(np.zeros(0, np.int64), np.zeros(0))


def found(names: IntArray, wanted: IntArray) -> tuple[IntArray, BoolArray]:
    """Where each wanted name (h,) is, or would be, in ascending names, and whether it is there."""
    place = np.searchsorted(names, wanted)
    if len(names) == 0:
        return place, np.zeros(len(wanted), bool)
    return place, names.take(place, mode="clip") == wanted


def level_of(pairs: Pairs, place: IntArray, has: BoolArray, base: FloatArray) -> FloatArray:
    """Levels (h,) of what was `found`, and `base` (h,) of what was not."""
    return np.where(has, pairs.level.take(place, mode="clip"), base) if len(pairs) else base


def others(n: int, at: IntArray) -> BoolArray:
    """Which of n places are not those of `at`."""
    result = np.ones(n, bool)
    result[at] = False
    return result


def merged(old: NDArray[D], rest: BoolArray, at: IntArray, new: NDArray[D] | D | float) -> NDArray[D]:
    """An array with `new` values at the places `at`, and the old ones in the `rest` of them."""
    result = np.empty(len(rest), old.dtype)
    result[rest] = old
    result[at] = new
    return result


def observed(pairs: Pairs, name: IntArray, place: IntArray, has: BoolArray, level: FloatArray) -> Pairs:
    """The table with the levels (h,) of what a scan observed: names, ascending, and where they were `found`."""
    if has.all():
        changed = pairs.level.copy()
        changed[place] = level
        return replace(pairs, level=changed)
    at = place + np.cumsum(~has) - ~has
    new = at[~has]
    rest = others(len(pairs) + len(new), new)
    return Pairs(merged(pairs.name, rest, at, name), merged(pairs.level, rest, at, level))


def with_rows(pairs: Pairs, place: IntArray) -> Pairs:
    """The table of a model to which rows (m,) are added, each before the row that is now at its `place`."""
    border = np.searchsorted(pairs.name, place << BITS)
    before = np.cumsum(np.bincount(border, minlength=len(pairs) + 1)[: len(pairs)])
    return replace(pairs, name=pairs.name + (before << BITS))


def of_rows(pairs: Pairs, row: IntArray) -> Pairs:
    """The entries of some rows (k,), which are numbered anew in this order."""
    first, end = np.searchsorted(pairs.name, row << BITS), np.searchsorted(pairs.name, (row + 1) << BITS)
    size = end - first
    place = np.arange(size.sum()) + np.repeat(first - np.cumsum(size) + size, size)
    name = np.repeat(np.arange(len(row)) << BITS, size) | pairs.count[place]
    return Pairs(name, pairs.level[place])
