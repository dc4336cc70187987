"""How much two runs may differ and be called equal: for all numbers, or by part and name from a TOML file.

rtol = 1e-6                          # of all numbers that nothing else is said about
[metrics]
gospa = { rtol = 0.01, atol = 0.5 }
ospa = 0.02                          # alone: rtol
[counts]
points = 0.001                       # counts are exact unless named
[tracks]
position_m = { atol = 0.1 }
"*" = 1e-5                           # all others of the part
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from maritrack.errors import ConfigError

PARTS = ("metrics", "counts", "scan", "truth", "points", "clusters", "tracks", "scores")
EXACT = ("counts", "manifest")  # unless a file says otherwise
ALL = "*"


class Tolerance(NamedTuple):
    """Floats are the same within atol + rtol times the larger one; all else is exact, `whole` numbers unless told."""

    rtol: float = 0.0
    atol: float = 0.0
    whole: bool = False


NOTHING = Tolerance()


@dataclass(frozen=True, slots=True)
class Tolerances:
    """A tolerance for each thing that is compared."""

    floats: Tolerance = NOTHING
    own: Mapping[str, Tolerance] = field(default_factory=dict)  # by "part.name" or "part.*"

    def of(self, part: str, name: str) -> Tolerance:
        """That of a column or entry of a part."""
        usual = NOTHING if part in EXACT else self.floats
        return self.own.get(f"{part}.{name}", self.own.get(f"{part}.{ALL}", usual))

    def unused(self, compared: Collection[str]) -> list[str]:
        """Metrics and counts with a tolerance that are not among those compared ("metrics.gospa"): mistyped?

        Warnings are not meant: a run may have none.
        """
        parts = {part for part in ("metrics", "counts") if any(name.startswith(f"{part}.") for name in compared)}
        told = (name.partition(".") for name in self.own)
        return [f"{part}.{name}" for part, _, name in told if part in parts and name != ALL
                and not name.startswith("warnings.") and f"{part}.{name}" not in compared]  # fmt: skip


def read_tolerances(path: Path, *, floats: Tolerance) -> Tolerances:
    """The tolerances of a file, over those of all floats. ConfigError where it makes no sense."""
    try:
        table = tomllib.loads(path.read_text("utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:  # no text, no TOML, a number without end; nests too deeply
        raise ConfigError(f"{path}: {error}") from None
    plain = {name: value for name, value in table.items() if name in Tolerance._fields[:2]}
    own: dict[str, Tolerance] = {}
    for part, entries in table.items():
        if part in plain:
            continue
        if part not in PARTS or not isinstance(entries, Mapping):
            raise ConfigError(f"{path}: unknown key '{part}'", hint="rtol, atol, tables " + ", ".join(PARTS))
        for name, entry in _flat(entries):
            own[f"{part}.{name}"] = _tolerance(path, f"{part}.{name}", entry)._replace(whole=part == "counts")
    base = _tolerance(path, "rtol, atol", {**floats._asdict(), **plain})
    return Tolerances(base, own)


def _flat(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Entries of a part, those of nested tables (counts.warnings) with their dotted names."""
    for name, entry in table.items():
        if isinstance(entry, Mapping) and not entry.keys() <= {"rtol", "atol"}:
            yield from _flat(entry, f"{prefix}{name}.")
        else:
            yield prefix + name, entry


def _tolerance(path: Path, name: str, entry: Any) -> Tolerance:
    told = {"rtol": entry} if not isinstance(entry, Mapping) else dict(entry)
    told.pop("whole", None)
    if not told or not all(_is_size(value) for value in told.values()):
        raise ConfigError(f"{path}: '{name}': write a number or {{ rtol = 0.01, atol = 0.5 }}, not negative")
    return Tolerance(float(told.get("rtol", 0.0)), float(told.get("atol", 0.0)))


def _is_size(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0.0 <= value < math.inf
