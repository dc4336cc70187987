"""JSON from strangers: one-line errors that say where, and values that are what they claim.

Errors tell the place within the document; `naming` puts the document's name before it. What is
archived as damage has no such name, because replay knows the document by another one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from maritrack.errors import InputError

MAX_M = 1e8  # no position is farther from the origin than this


@contextmanager
def naming(name: str) -> Iterator[None]:
    """Errors of the block begin with the name of the document."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{name}: {error}", error.hint) from None


def parse_json(data: bytes, *, line: int = 1, offset: int = 0) -> Any:
    """The value of a JSON text that begins at a line and octet of its document.

    InputError names line and column, or the octet that is not UTF-8.
    """
    try:
        return json.loads(data.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise InputError(f"not UTF-8 at byte {offset + error.start}") from None
    except json.JSONDecodeError as error:
        raise InputError(f"line {line + error.lineno - 1} column {error.colno}: {error.msg}") from None
    except RecursionError:
        raise InputError(f"line {line}: nested too deeply") from None
    except ValueError:  # what json says of integers of thousands of digits
        raise InputError(f"line {line}: a number of thousands of digits") from None


def clean(text: object) -> str:
    """A name fit for a line of text: what can't be printed becomes '?'."""
    line = str(text).strip()[:200]
    return line if line.isprintable() else "".join(c if c.isprintable() else "?" for c in line)


def table_of(value: Any, *, where: str) -> Mapping[str, Any]:
    """The value if it is an object, else InputError."""
    if not isinstance(value, dict):
        raise InputError(f"{where}: an object was expected, not {_kind(value)}")
    return value


def list_of(value: Any, *, where: str) -> list[Any]:
    """The value if it is a list, else InputError."""
    if not isinstance(value, list):
        raise InputError(f"{where}: a list was expected, not {_kind(value)}")
    return value


def number_of(table: Mapping[str, Any], key: str, *, where: str, default: float | None = None, limit: float) -> float:
    """A finite number within +-limit. Absent or null: the default; None = it has to be there."""
    value = table.get(key)
    if value is None:
        if default is None:
            raise InputError(f"{where}: '{key}' is missing")
        return default
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where}: '{key}' is a number, not {_kind(value)}")
    if not -limit <= value <= limit:  # also false for nan
        raise InputError(f"{where}: '{key}' = {_short(value)} is not within +-{limit:g}")
    return float(value)


def _kind(value: Any) -> str:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true or false"
    names = {dict: "an object", list: "a list", str: "a text", int: "a number", float: "a number"}
    return names.get(type(value), type(value).__name__)


def _short(value: float) -> str:
    return f"{value:g}" if isinstance(value, float) and not math.isnan(value) else str(value)[:20]
