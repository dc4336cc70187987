"""Rows of numbers in a `maritrack-points/1` document: points, their covariances and labels, checked one by one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from maritrack.errors import InputError
from maritrack.io.jsontext import list_of
from maritrack.types import FloatArray, IntArray


def point_rows(value: Any, *, where: str, axes: int = 2) -> FloatArray:
    """Points as rows [first, second(, third), intensity] (n, axes + 1); intensity 1 where not given, nan for null."""
    rows = list_of(value, where=where)
    if not rows:
        return np.empty((0, axes + 1))
    try:
        array = np.asarray(rows)
    except ValueError:  # some with intensity, some without
        array = np.empty(0, dtype=object)
    if array.dtype == object:
        array = np.array([_row(row, axes, where=f"{where}[{i}]") for i, row in enumerate(rows)])
    if array.ndim != 2 or array.shape[1] not in (axes, axes + 1) or array.dtype.kind not in "iuf":
        raise InputError(f"{where}: each is a list of {axes} or {axes + 1} numbers")
    table = np.ones((len(array), axes + 1))
    table[:, : array.shape[1]] = array
    return table


def _row(row: Any, axes: int, *, where: str) -> list[float]:
    cells = list_of(row, where=where)
    if len(cells) not in (axes, axes + 1) or not all(c is None or type(c) in (int, float) for c in cells):
        raise InputError(f"{where}: a list of {axes} or {axes + 1} numbers was expected")
    known = [np.nan if c is None or abs(c) > 1e300 else float(c) for c in cells]
    return known if len(known) > axes else [*known, 1.0]


def cov_rows(value: Any, n: int, *, where: str) -> FloatArray | None:
    """Covariances of n points as rows (n, 3) of [xx, xy, yy], nan for null; None where there are none."""
    if value is None:
        return None
    cells = list_of(value, where=f"{where}: cov")
    if len(cells) != n:
        raise InputError(f"{where}: {len(cells)} covariances for {n} points")
    try:
        rows: NDArray[Any] = np.asarray(cells) if cells else np.empty((0, 3))
        rows = rows.astype(np.float64) if rows.dtype == object else rows  # null becomes nan
    except (TypeError, ValueError, OverflowError):
        rows = np.empty(0)
    if rows.ndim != 2 or rows.shape[1] != 3 or rows.dtype.kind not in "iuf":
        raise InputError(f"{where}: cov: each is a list of 3 numbers")
    return np.asarray(rows, dtype=np.float64)


def truth_labels(value: Any, n: int, *, where: str) -> IntArray | None:
    """The object of each of n points (n,), -1 for clutter; None where it is not told."""
    if value is None:
        return None
    labels = list_of(value, where=f"{where}: labels")
    if not all(type(item) is int and abs(item) < 2**62 for item in labels):
        raise InputError(f"{where}: labels: each is a whole number, -1 for clutter")
    if len(labels) != n:
        raise InputError(f"{where}: {len(labels)} labels for {n} points")
    return np.array(labels, dtype=np.int64)
