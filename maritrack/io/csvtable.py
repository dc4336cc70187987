"""Tables as comma, semicolon or tab separated text, whose columns are found by name."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maritrack.errors import InputError
from maritrack.io.times import DAY_S, iso_to_s, usable_time
from maritrack.types import FloatArray

TIMES = (
    "time", "timestamp", "datetime", "basedatetime", "base_date_time",
    "time_utc", "time_s", "time_ms", "time_s_utc_of_day", "epoch", "t",
)  # fmt: skip
MOST_LINE = 1 << 20
DAY_FIRST = re.compile(r"(\d\d)[/.](\d\d)[/.](\d{4})")


@dataclass(frozen=True, slots=True)
class Table:
    """Columns of text by simplified name, all of one length."""

    name: str  # of the document, for messages
    columns: dict[str, tuple[str, ...]]
    decimal_comma: bool

    @property
    def rows(self) -> int:
        return len(next(iter(self.columns.values())))


def read_table(data: bytes, *, name: str) -> Table:
    """A table with a line of names on top. Short rows are filled up, empty ones left out."""
    if endless_line(data):
        raise InputError(f"{name}: a line of more than {MOST_LINE >> 10} KiB, no table")
    text = data.decode("utf-8-sig", "replace").lstrip()
    separator = separator_of(first_line(text))
    rows: list[list[str]] = []
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
    try:
        rows.extend(row for row in reader if row)
    except csv.Error as error:
        raise InputError(f"{name}: line {reader.line_num}: {error}") from None
    if not rows:
        raise InputError(f"{name}: empty")
    header = [simple_name(cell) for cell in rows[0]]
    width = len(header)
    body = [row if len(row) >= width else row + [""] * (width - len(row)) for row in rows[1:]]
    cells = list(zip(*body, strict=False)) if body else [()] * width
    columns: dict[str, tuple[str, ...]] = {}
    for title, column in zip(header, cells, strict=False):
        columns.setdefault(title, column)  # of two columns with one name the first counts
    return Table(name, columns, decimal_comma=separator != ",")


def endless_line(data: bytes) -> bool:
    """Whether a line is longer than any of a table: its cells would take fifty times its memory."""
    starts = range(0, len(data) - MOST_LINE, MOST_LINE)
    return any(data.find(b"\n", at, at + MOST_LINE) < 0 and data.find(b"\r", at, at + MOST_LINE) < 0 for at in starts)


def first_line(text: str) -> str:
    """The text up to its first end of line."""
    return re.split(r"[\r\n]", text, maxsplit=1)[0]


def simple_name(cell: str) -> str:
    """A column's name in lower case, words joined by '_', units in brackets kept: "Range [m]" is range_m."""
    return re.sub(r"[^a-z0-9]+", "_", cell.strip().lower()).strip("_")


def separator_of(line: str) -> str:
    """The separator that a line of names uses most."""
    return max(",;\t", key=line.count)


def find(table: Table, names: Sequence[str]) -> str | None:
    """The first of the names that is a column of the table."""
    return next((n for n in names if n in table.columns), None)


def numbers(table: Table, column: str | None) -> FloatArray:
    """A column as numbers; nan where a cell is none, or everywhere for no column."""
    if column is None:
        return np.full(table.rows, np.nan)
    cells = table.columns[column]
    if table.decimal_comma:
        cells = tuple(cell.replace(",", ".") for cell in cells)
    return np.fromiter(map(_number, cells), dtype=np.float64, count=len(cells))


def times_s(table: Table) -> tuple[FloatArray, bool]:
    """Times in seconds (n,), nan where a cell is none, and whether they are of a day without a date.

    ISO 8601 or day/month/year texts; seconds, milli-, micro- or nanoseconds since 1970; seconds since
    midnight (numbers below two days).
    """
    column = find(table, TIMES)
    if column is None:
        raise InputError(f"{table.name}: no column of times", hint="name it time_s, time or timestamp")
    time_s = numbers(table, column)
    if np.isnan(time_s).all():
        time_s = np.fromiter(map(_calendar_s, table.columns[column]), dtype=np.float64, count=table.rows)
    finite = np.abs(time_s[np.isfinite(time_s)])
    typical = float(np.median(finite)) if len(finite) else 0.0
    scale = next((k for k in (1e9, 1e6, 1e3) if typical > 1e8 * k), 1.0)  # 1e8 s is 1973, before all of this
    time_s = time_s / scale
    return np.where(usable_time(time_s), time_s, np.nan), typical < 2 * DAY_S


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")


def _calendar_s(cell: str) -> float:
    """Seconds since 1970 of a calendar time, day first where the year comes third."""
    return iso_to_s(DAY_FIRST.sub(r"\3-\2-\1", cell.strip(), count=1))
