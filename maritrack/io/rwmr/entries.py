"""polarMeas.json and cartesianMeas.json: the points of each step, in any of the forms that they may have.

The certain form is an object of steps, each a flat list `[s0, s1, [a, b], [a, b], ...]` or null. Others are read where
they can mean one thing only: lists of steps, objects with named columns, two rows instead of pairs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from maritrack.errors import InputError
from maritrack.io.jsontext import MAX_M, parse_json
from maritrack.types import FloatArray

POINTS = ("points", "meas", "measurements", "detections")
FIRST = ("r", "range", "range_m", "rho", "x", "east", "e")
SECOND = ("theta", "bearing", "az", "azimuth", "phi", "y", "north", "n")
MAX_STEP = 10**9


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """One entry of a document."""

    number: int
    header: tuple[float, ...]  # numbers before the first point
    rows: FloatArray  # (n, 2) as in the document


@dataclass(slots=True)
class Told:
    """What was met on the way: forms other than the certain one, and what was left out."""

    forms: dict[str, int] = field(default_factory=dict)
    left_out: int = 0

    def note(self, form: str) -> None:
        """Count a form."""
        self.forms[form] = self.forms.get(form, 0) + 1


def read_steps(data: bytes) -> tuple[list[Step], Told]:
    """The steps of a document by number. InputError where it is no JSON or holds no step."""
    told = Told()
    document = parse_json(data)
    if isinstance(document, dict) and len(document) == 1 and not _is_number(next(iter(document))):
        inner = next(iter(document.values()))
        if isinstance(inner, dict | list):
            told.note("steps within another object")
            document = inner
    found = [Step(number, *_entry(entry, told)) for number, entry in _numbered(document, told)]
    if not found and document:
        raise InputError("no steps: neither an object of numbered steps nor a list")
    return sorted(found, key=lambda step: step.number), told


def _numbered(document: Any, told: Told) -> Iterator[tuple[int, Any]]:
    if isinstance(document, list):
        told.note("a list of steps, counted from 0")
        yield from enumerate(document)
    elif isinstance(document, dict):
        seen: set[int] = set()
        for key, entry in document.items():
            number = int(key) if _is_number(key) else -1
            if number in seen or number < 0:
                told.left_out += 1
                continue
            seen.add(number)
            yield number, entry
    else:
        raise InputError("neither an object of steps nor a list of them")


def _entry(entry: Any, told: Told) -> tuple[tuple[float, ...], FloatArray]:
    """Header and rows of an entry."""
    if entry is None:
        return (), np.zeros((0, 2))
    if isinstance(entry, Mapping):
        return _object(entry, told)
    if not isinstance(entry, list):
        told.left_out += 1
        return (), np.zeros((0, 2))
    at = next((i for i, item in enumerate(entry) if not _is_value(item)), len(entry))
    header = tuple(float(value) for value in entry[:at])
    rest = entry[at:]
    if len(rest) == 2 and all(isinstance(row, list) and len(row) != 2 for row in rest) and len(rest[0]) == len(rest[1]):
        told.note("two rows instead of pairs")
        rest = [list(pair) for pair in zip(*rest, strict=True)]
    return header, _rows(rest, told)


def _object(entry: Mapping[str, Any], told: Told) -> tuple[tuple[float, ...], FloatArray]:
    by_name = {str(key).lower(): value for key, value in entry.items()}
    header = tuple(float(value) for value in by_name.values() if _is_value(value))
    inner = next((by_name[name] for name in POINTS if name in by_name), None)
    if inner is not None:
        told.note("objects with their points by name")
        more, rows = _entry(inner, told)
        return header + more, rows
    columns = [next((by_name[n] for n in names if isinstance(by_name.get(n), list)), None) for names in (FIRST, SECOND)]
    if columns[0] is not None and columns[1] is not None and len(columns[0]) == len(columns[1]):
        told.note("objects with columns by name")
        return header, _rows([list(pair) for pair in zip(*columns, strict=True)], told)
    told.left_out += bool(entry)
    return header, np.zeros((0, 2))


def _rows(items: list[Any], told: Told) -> FloatArray:
    """Pairs (n, 2); numbers among them begin a new group and are passed over."""
    pairs: list[tuple[float, float]] = []
    for item in items:
        if _is_value(item):
            told.note("numbers between points: a new group")
            continue
        if isinstance(item, Mapping):
            lower = {str(key).lower(): value for key, value in item.items()}
            pair: Any = [next((lower[n] for n in names if n in lower), None) for names in (FIRST, SECOND)]
            told.note("points by name")
        else:
            pair = item
        good = isinstance(pair, list) and len(pair) in (2, 3) and all(_is_value(value) for value in pair)
        if good and max(abs(pair[0]), abs(pair[1])) <= MAX_M:
            pairs.append((float(pair[0]), float(pair[1])))
        else:
            told.left_out += 1
    return np.array(pairs, np.float64).reshape(-1, 2)


def _is_value(value: Any) -> bool:
    """A finite number that a double can hold."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) < 1e300 if isinstance(value, int) else math.isfinite(value)


def _is_number(key: str) -> bool:
    return key.strip().isascii() and key.strip().isdecimal() and len(key) < 20 and int(key) <= MAX_STEP
