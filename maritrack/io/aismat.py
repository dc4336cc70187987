"""AIS in MATLAB 5 files: arrays side by side, in a struct, or in a struct for each ship, as a table of columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from maritrack.errors import InputError
from maritrack.io.aisrows import LAT, LON
from maritrack.io.csvtable import TIMES, Table, simple_name
from maritrack.io.jsontext import naming
from maritrack.io.matfile import read_mat

MAT5 = b"MATLAB 5.0 MAT-file"
DATENUM_1970, DATENUM = 719_529.0, (600_000.0, 900_000.0)  # MATLAB counts days; these are of the years 1643 to 2464
MOST_ROWS = 4_000_000  # of a table, whose cells take ten times the memory of the numbers
Columns = dict[str, tuple[str, ...]]


def holds_ais(data: bytes) -> bool:
    """Whether a MATLAB file holds latitudes and longitudes."""
    try:
        return any(_rows(values) for values in _tables(read_mat(data)))
    except InputError:
        return False


def table_of_mat(data: bytes, *, name: str) -> Table:
    """The reports of a file: all arrays of one length, of each struct that has latitudes and longitudes.

    A value that stands alone in such a struct (the MMSI or the name of a ship) is that of each of its rows. Times may
    be MATLAB's days. InputError, with what there is instead, where nothing has latitude and longitude.
    """
    with naming(name):
        content = read_mat(data)
        parts = _parts(content)
        if not parts:
            held = ", ".join(sorted(content)) or "nothing"
            raise InputError(f"no columns of latitude and longitude: it holds {held}")
    titles = list(dict.fromkeys(title for part in parts for title in part))
    rows = [len(next(iter(part.values()))) for part in parts]
    columns = {
        title: tuple(cell for part, n in zip(parts, rows, strict=True) for cell in part.get(title, ("",) * n))
        for title in titles
    }
    return Table(name, columns, decimal_comma=False)


def _parts(content: Mapping[str, Any]) -> list[Columns]:
    """The tables in a file as columns."""
    found = [values for values in _tables(content) if _rows(values)]
    if (rows := sum(map(_rows, found))) > MOST_ROWS:
        raise InputError(f"{rows} reports, at most {MOST_ROWS} are read")
    return [_columns(values) for values in found]


def _tables(content: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """What may be tables: the variables themselves, or else the structs among them."""
    if _rows(content):
        return [content]
    structs = [value for value in content.values() if isinstance(value, (dict, list))]
    every = [row for value in structs for row in (value if isinstance(value, list) else [value])]
    return [row for row in every if isinstance(row, dict)]


def _rows(values: Mapping[str, Any]) -> int:
    """How many latitudes and longitudes a struct has; 0 where it has none, or not as many of each."""
    named = {simple_name(name): value for name, value in values.items()}
    lat, lon = (next((named[n] for n in names if n in named), None) for names in (LAT, LON))
    if not (_numeric(lat) and _numeric(lon)):
        return 0
    n, other = (int(np.asarray(angle).size) for angle in (lat, lon))
    return n if n == other else 0


def _columns(values: Mapping[str, Any]) -> Columns:
    """A struct of latitudes and longitudes as columns."""
    n = _rows(values)
    named = {simple_name(name): value for name, value in values.items()}
    columns = {title: _cells(value, n, is_time=title in TIMES) for title, value in named.items()}
    return {title: cells for title, cells in columns.items() if cells is not None}


def _cells(value: Any, n: int, *, is_time: bool) -> tuple[str, ...] | None:
    """A column of n cells; None for what has another length."""
    if isinstance(value, str):
        return (value,) * n
    if isinstance(value, Sequence):
        return tuple(str(cell) for cell in value) if len(value) == n else None
    if not _numeric(value) or np.size(value) not in (1, n):
        return None
    numbers = np.broadcast_to(np.asarray(value, float).ravel(), (n,))
    if is_time and n and DATENUM[0] < np.median(numbers) < DATENUM[1]:
        numbers = (numbers - DATENUM_1970) * 86_400.0
    return tuple(str(int(x)) if x.is_integer() else repr(x) for x in numbers.tolist())


def _numeric(value: Any) -> bool:
    return isinstance(value, (int, float)) or (isinstance(value, np.ndarray) and value.dtype.kind in "iuf")
