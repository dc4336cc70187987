"""Radials that were sent in several messages, put together again.

A long radial may be cut along range: the parts have the same azimuths and range scale, consecutive
MSG_INDEX, and START_RG goes on where the part before ended.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from maritrack.io.cat240.radials import Radials
from maritrack.types import BoolArray, IntArray, take

MAX_RADIAL_CELLS = 524_288  # of a radial that was put together
MAX_BLOCK_CELLS = 1 << 28  # messages times the widest radial: bounds the memory
IDX_CYCLE = 1 << 32


def continues(radials: Radials, rows: IntArray | None = None) -> BoolArray:
    """Whether a radial is the next part of the one before it, shape (n,).

    `rows` picks the radials of one sensor; None says that all are of one sensor.
    """

    def column(name: str) -> IntArray:
        values: IntArray = getattr(radials, name)
        return values if rows is None else values[rows]

    start_rg = column("start_rg")
    goes_on = np.zeros(len(start_rg), dtype=bool)
    if len(goes_on) < 2:
        return goes_on
    goes_on[1:] = start_rg[1:] == start_rg[:-1] + column("n_cells")[:-1]
    goes_on[1:] &= column("n_cells")[:-1] > 0
    if not goes_on.any():
        return goes_on
    for name in ("start_az", "end_az", "cell_dur", "femto", "bits"):
        values = column(name)
        goes_on[1:] &= values[1:] == values[:-1]
    idx = column("idx")
    goes_on[1:] &= (idx[1:] - idx[:-1]) % IDX_CYCLE == 1
    return goes_on


def stitch(radials: Radials, goes_on: BoolArray) -> tuple[Radials, IntArray]:
    """The whole radials of one sensor and, of each, the row of its first part.

    `goes_on` is `continues(radials)`. A whole radial has the header of its first part. Parts that
    would make a radial or the block of radials too large stay rows of their own.
    """
    if not goes_on.any():
        return radials, np.arange(len(radials))
    first, group = _groups(goes_on)
    column = radials.start_rg - radials.start_rg[first][group]
    widest = max(min(MAX_RADIAL_CELLS, MAX_BLOCK_CELLS // len(radials)), radials.cells.shape[1])
    too_wide = np.zeros(len(first), dtype=bool)
    too_wide[group[column + radials.n_cells > widest]] = True
    if too_wide.any():
        return stitch(radials, goes_on & ~too_wide[group])
    n_cells = np.bincount(group, weights=radials.n_cells, minlength=len(first)).astype(np.int64)
    cells = np.zeros((len(first), max(int(n_cells.max()), radials.cells.shape[1])), dtype=radials.cells.dtype)
    for part in _equal_parts(column, radials.n_cells):
        lo, n = int(column[part[0]]), int(radials.n_cells[part[0]])
        cells[group[part], lo : lo + n] = radials.cells[part, :n]
    whole = take(replace(radials, cells=radials.cells[:, :0]), first)
    return replace(whole, n_cells=n_cells, cells=cells), first


def _groups(goes_on: BoolArray) -> tuple[IntArray, IntArray]:
    return np.flatnonzero(~goes_on), np.cumsum(~goes_on) - 1


def _equal_parts(column: IntArray, n_cells: IntArray) -> list[IntArray]:
    """Rows with the same place and the same length, so that each kind is copied at once."""
    order = np.lexsort((n_cells, column))
    changed = (np.diff(column[order]) != 0) | (np.diff(n_cells[order]) != 0)
    return np.split(order, np.flatnonzero(changed) + 1)


def extends(held: Radials, radials: Radials, row: int) -> bool:
    """Whether row `row` of the radials is the next part of the one radial held."""
    names = ("start_az", "end_az", "cell_dur", "femto", "bits")
    return (
        radials.start_rg[row] == held.start_rg[0] + held.n_cells[0]
        and held.n_cells[0] > 0
        and (radials.idx[row] - held.idx[0]) % IDX_CYCLE == 1
        and all(getattr(radials, name)[row] == getattr(held, name)[0] for name in names)
    )


def join(a: Radials, b: Radials) -> Radials:
    """Radials one after the other; short rows are filled with zeros."""
    cells = np.zeros(
        (len(a) + len(b), max(a.cells.shape[1], b.cells.shape[1])), dtype=max(a.cells.dtype, b.cells.dtype)
    )
    cells[: len(a), : a.cells.shape[1]] = a.cells
    cells[len(a) :, : b.cells.shape[1]] = b.cells
    names = [f.name for f in fields(a) if f.name != "cells"]
    columns = {name: np.concatenate([getattr(a, name), getattr(b, name)]) for name in names}
    return Radials(**columns, cells=cells)
