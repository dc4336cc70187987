"""How the records of a window are cut into batches, and how many of them may be inflated."""

from __future__ import annotations

import numpy as np

from maritrack.io.cat240.cells import Rows
from maritrack.types import BoolArray

MAX_RADIALS = 12_288  # of a batch
MAX_CELL_OCTETS = 32 << 20
MAX_PADDING, PADDING = 4 << 20, 4  # octets of cells in a batch beyond that many times those that were sent
INFLATION_FLOOR = 4 << 20  # cells
INFLATION_RATIO = 256  # cells to an octet of input


def charge(rows: Rows, base: int, inflated: int) -> tuple[BoolArray, int]:
    """Which rows (n,) of a window at octet `base` may be inflated, and how many cells the input then has inflated to.

    All may, until a hostile input would grow beyond its budget; `inflated` is what it had grown to before.
    """
    affordable = np.ones(len(rows), dtype=np.bool_)
    if not rows["compressed"].any():
        return affordable, inflated
    cells = np.where(rows["compressed"] > 0, rows["n_cells"], 0)
    budget = np.maximum(INFLATION_FLOOR, INFLATION_RATIO * (base + rows["block_end"]))
    total = inflated + int(cells.sum())
    if total <= int(budget[0]) or (inflated + np.cumsum(cells) <= budget).all():
        return affordable, total
    for i, (n, limit) in enumerate(zip(cells.tolist(), budget.tolist(), strict=True)):
        affordable[i] = n == 0 or inflated + n <= limit
        inflated += n if affordable[i] else 0
    return affordable, inflated


def split(rows: Rows) -> list[int]:
    """Bounds of runs of rows that make a batch: not too many cells, and not too many of them for padding."""
    octets = rows["n_cells"] * np.maximum(rows["bits"] >> 3, 1)
    widest = int(rows["n_cells"].max(initial=0)) * max(int(rows["bits"].max(initial=0)) >> 3, 1)
    block = len(rows) * widest
    if len(rows) <= MAX_RADIALS and block <= MAX_CELL_OCTETS and block <= MAX_PADDING + PADDING * int(octets.sum()):
        return [0, len(rows)]
    bounds, most, depth, held = [0], 0, 0, 0
    sizes = np.maximum(rows["bits"] >> 3, 1).tolist()
    for i, (cells, size) in enumerate(zip(rows["n_cells"].tolist(), sizes, strict=True)):
        most, depth, held = max(most, cells), max(depth, size), held + cells * size
        n = i - bounds[-1]
        block = (n + 1) * most * depth
        if n > 0 and (n == MAX_RADIALS or block > MAX_CELL_OCTETS or block > MAX_PADDING + PADDING * held):
            bounds.append(i)
            most, depth, held = cells, size, cells * size
    return [*bounds, len(rows)]


def ends_of(rows: Rows, bounds: list[int], start: int, stop: int) -> list[int]:
    """Where each batch ends in the window: before the data block of the next one's first row."""
    ends = [start]
    for i in bounds[1:-1]:
        shared = rows["block"][i] == rows["block"][i - 1]  # records of one block in two batches: the first has it
        ends.append(max(ends[-1], int(rows["block_end" if shared else "block"][i])))
    return [*ends[1:], stop]
