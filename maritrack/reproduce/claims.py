"""What comes of repeating an experiment: statements that hold or do not, tables, and the files of its figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from maritrack.errors import UsageError

Cell = str | float | int | None  # of a table; None = there is no such number


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """How much of an experiment is run, and where its figures go."""

    quick: bool = False  # fewer runs, the same statements
    seeds: int = 0  # Monte Carlo runs, seeds 1, 2, ...; 0 = as many as the experiment has
    workers: int = 1  # processes; they change nothing but the time
    out: Path | None = None  # folder of figures; None = none are drawn

    def __post_init__(self) -> None:
        if self.seeds < 0:
            raise UsageError(f"--seeds {self.seeds}: not negative; 0 = as many as the experiment has")
        if self.workers < 1:
            raise UsageError(f"--workers {self.workers}: at least 1")


@dataclass(frozen=True, slots=True)
class Case:
    """A scene with its seed: what a worker is given."""

    scene: str
    seed: int
    scans: int = 0  # 0 = all


@dataclass(frozen=True, slots=True)
class Claim:
    """A statement that can be wrong, with the numbers that decide it: ours and, where it has them, the paper's."""

    name: str
    holds: bool
    ours: Any  # numbers by name
    paper: Any  # likewise; None where the paper has no number


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of numbers under a header."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    text_columns: int = 1  # that come first

    def __post_init__(self) -> None:
        if any(len(row) != len(self.header) for row in self.rows):
            raise ValueError(f"table '{self.title}': rows and header differ in length")


@dataclass(frozen=True, slots=True)
class Report:
    """A repeated experiment."""

    paper: str  # key, as in `maritrack papers`
    quick: bool
    claims: tuple[Claim, ...]
    tables: Mapping[str, Table] = field(default_factory=dict)  # by key
    figures: Mapping[str, Path] = field(default_factory=dict)  # by key; files that were written

    def document(self) -> dict[str, Any]:
        """The report as one JSON document; a table is a list of rows by column."""
        return {
            "paper": self.paper,
            "quick": self.quick,
            "claims": [{"name": c.name, "holds": c.holds, "ours": c.ours, "paper": c.paper} for c in self.claims],
            "tables": {key: rows_by_column(table) for key, table in self.tables.items()},
            "figures": {key: str(path) for key, path in self.figures.items()},
        }


def rows_by_column(table: Table) -> list[dict[str, Cell]]:
    """Each row of a table as values by the names of its columns."""
    return [dict(zip(table.header, row, strict=True)) for row in table.rows]
