"""Grids as people write them: `20:100:5` or `20,55,100`, and `model.p_detect=0.7,0.8`."""

from __future__ import annotations

import itertools
import math
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from maritrack.config import toml_table
from maritrack.errors import UsageError

MOST = 10_000  # values of one key, combinations of all


def parse_numbers(text: str, *, name: str) -> tuple[float, ...]:
    """`A:B:STEP` (both ends included; the step is 1 where there is none) or a list with commas, ascending."""
    try:
        if ":" in text:
            low, high, *rest = (float(part) for part in text.split(":"))
            (step,) = rest or (1.0,)
            if not (math.isfinite(low) and math.isfinite(high) and 0 < step < math.inf and low <= high):
                raise ValueError
            n = math.floor((high - low) / step + 1e-9) + 1
            if n > MOST:
                raise UsageError(f"{name} {text}: {n} values")
            return tuple(round(low + i * step, 9) for i in range(n))
        values = tuple(sorted({float(part) for part in text.split(",")}))
    except ValueError:
        raise UsageError(f"{name} {text}: write FROM:TO:STEP or A,B,C, as in 20:100:5") from None
    if not all(map(math.isfinite, values)):
        raise UsageError(f"{name} {text}: not a finite number")
    return values


def parse_counts(text: str, *, name: str) -> tuple[int, ...]:
    """The same, of whole numbers from 1 on."""
    values = parse_numbers(text, name=name)
    if not all(value == int(value) and value >= 1 for value in values):
        raise UsageError(f"{name} {text}: whole numbers from 1 on")
    return tuple(int(value) for value in values)


def parse_axis(text: str) -> tuple[str, tuple[Any, ...]]:
    """`KEY=V1,V2,...` or `KEY=FROM:TO:STEP`; values are read as TOML, bare words are strings."""
    key, sep, told = text.partition("=")
    key, told = key.strip(), told.strip()
    if not (sep and key and told):
        raise UsageError(f"--grid {text}: write KEY=V1,V2,..., as in model.p_detect=0.7,0.8,0.9")
    if ":" in told and all(_is_number(part) for part in told.split(":")):
        values: tuple[Any, ...] = parse_numbers(told, name=f"--grid {key}")
        whole = all(part.strip().lstrip("+-").isdigit() for part in told.split(":"))
        values = tuple(int(v) for v in values) if whole else values
    else:
        values = _toml_values(told)
    if len({repr(value) for value in values}) < len(values):
        raise UsageError(f"--grid {text}: a value twice")
    return key, values


def combinations(axes: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
    """All combinations of the values of the keys, the last key fastest."""
    n = math.prod(len(values) for values in axes.values())
    if n > MOST:
        raise UsageError(f"{n} combinations, more than {MOST}")
    return [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]


def nested(assignments: Mapping[str, Any]) -> dict[str, Any]:
    """Dotted keys as the nested tables of a configuration."""
    table: dict[str, Any] = {}
    for key, value in assignments.items():
        *path, last = key.split(".")
        inner = table
        for part in path:
            inner = inner.setdefault(part, {})
        inner[last] = value
    return table


def _toml_values(told: str) -> tuple[Any, ...]:
    try:
        return tuple(toml_table(f"v = [{told}]")["v"])
    except tomllib.TOMLDecodeError:
        return tuple(_toml_value(part.strip()) for part in told.split(","))


def _toml_value(word: str) -> Any:
    try:
        return toml_table(f"v = {word}")["v"]
    except tomllib.TOMLDecodeError:
        return word


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
