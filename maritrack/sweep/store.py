"""What a sweep leaves in its folder: a file for each finished run, and the table of all.

rows/<run id>.json   configuration, metrics and counts: the same octets whoever ran it, wherever, in which order
timings.jsonl        CPU milliseconds of the runs, in the order in which they ended
runs/<run id>/       archive and summary of each run, where they are kept
results.parquet      the table, a row a run in the order of the plan; results.csv: the same
"""

from __future__ import annotations

import json
import math
import os
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from maritrack.errors import InputError
from maritrack.sinks.summary import json_octets
from maritrack.sweep.work import Done, Row

ROWS, TIMINGS, RUNS, TABLE = "rows", "timings.jsonl", "runs", "results"
FIRST = ("run_id", "input", "kind", "tracker", "preset", "seed", "error")
SEED = re.compile(r"^seed = .*\n", re.MULTILINE)  # of a configuration: the table has it anyway
Cells = dict[str, Any]


def write_row(folder: Path, done: Done) -> None:
    """Write what came of a run: times first, then, all at once, the row that says that it is finished."""
    run_id = done.row["run_id"]
    if done.timing:
        line = json.dumps({"run_id": run_id, **done.timing}) + "\n"
        with (folder / TIMINGS).open("ab+") as file:
            file.seek(max(file.seek(0, os.SEEK_END) - 1, 0))
            broken = file.read() not in (b"", b"\n")  # the last line, of a process that was killed
            file.write(b"\n" * broken + line.encode())
    _replace(folder / ROWS / f"{run_id}.json", json_octets(done.row))


def read_row(folder: Path, run_id: str) -> Row | None:
    """The row of a finished run; None where there is none, or one that can't be read."""
    try:
        row: Row = json.loads((folder / ROWS / f"{run_id}.json").read_bytes())
        return row if cells(row, {})["run_id"] == run_id else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def read_timings(folder: Path) -> dict[str, Mapping[str, float]]:
    """Times by run, the last ones of a run that ran twice; a line that breaks off is left out."""
    try:
        lines = (folder / TIMINGS).read_text("utf-8").splitlines()
    except OSError:
        return {}
    found: dict[str, Mapping[str, float]] = {}
    for line in lines:
        try:
            told = json.loads(line)
            found[told.pop("run_id")] = told
        except (ValueError, KeyError, AttributeError, TypeError):
            continue
    return found


def cells(row: Row, timing: Mapping[str, float]) -> Cells:
    """A row flat: who it is, metrics, `counts.*`, every setting by its key, `timing.*`."""
    flat: Cells = {name: row[name] for name in FIRST}
    flat |= {name: math.nan if value is None else value for name, value in row["metrics"].items()}
    flat |= {f"counts.{name}": value for name, value in row["counts"].items()}
    flat["input_sha256"] = row["input_sha256"]
    flat |= _settings_of(SEED.sub("", row["config"], 1)) if row["config"] else dict(row["values"])
    return flat | {f"timing.{name}": value for name, value in timing.items()}


@lru_cache(maxsize=1024)
def _settings_of(config: str) -> Mapping[str, Any]:
    """Settings by key: those of runs that differ in their seed alone are read once, and in memory once."""
    return _settings(tomllib.loads(config))


def _settings(table: Mapping[str, Any], prefix: str = "") -> Cells:
    flat: Cells = {}
    for name, value in table.items():
        if isinstance(value, Mapping):
            flat |= _settings(value, f"{prefix}{name}.")
        elif prefix or name not in ("preset", "seed", "tracker_name"):
            flat[prefix + name] = json.dumps(value) if isinstance(value, list) else value  # a table has no lists
    return flat


def write_table(folder: Path, rows: Iterable[Row]) -> dict[str, str]:
    """Write the table of these rows as Parquet and CSV; their paths."""
    import pyarrow as pa  # type: ignore[import-untyped]
    from pyarrow import csv, parquet

    columns = _columns(rows, read_timings(folder))
    table = pa.table({name: _column(columns.pop(name)) for name in list(columns)})
    paths = {kind: folder / f"{TABLE}.{kind}" for kind in ("parquet", "csv")}
    for kind, write in (("parquet", parquet.write_table), ("csv", csv.write_csv)):
        partial = paths[kind].with_name(paths[kind].name + ".partial")
        write(table, str(partial))
        os.replace(partial, paths[kind])
    return {kind: str(path) for kind, path in paths.items()}


def _columns(rows: Iterable[Row], timings: Mapping[str, Mapping[str, float]]) -> dict[str, list[Any]]:
    """Values by column, None where a row has none; columns in the order of the row that has most, times last."""
    columns: dict[str, list[Any]] = {}
    full: Sequence[str] = ()
    n = 0
    for row in rows:
        one = cells(row, timings.get(row["run_id"], {}))
        for name, value in one.items():
            column = columns.setdefault(name, [])
            column.extend([None] * (n - len(column)))
            column.append(value)
        full, n = full if len(full) >= len(one) else tuple(one), n + 1
    for column in columns.values():
        column.extend([None] * (n - len(column)))
    order = {name: i for i, name in enumerate(full)}
    names = sorted(columns, key=lambda name: (name.startswith("timing."), order.get(name, len(order)), name))
    return {name: columns[name] for name in names}


def _column(values: Sequence[Any]) -> Any:
    """A column of one type: numbers where all are, else text; None = not there."""
    import pyarrow as pa

    kinds = {type(value) for value in values if value is not None}
    if kinds <= {int, float} and float in kinds:
        return pa.array([None if value is None else float(value) for value in values], pa.float64())
    if len(kinds) > 1:
        return pa.array([None if value is None else str(value) for value in values], pa.string())
    return pa.array(values)


def read_table(folder: Path) -> list[Cells]:
    """The rows of the table of a folder. InputError where there is none."""
    from pyarrow import ArrowInvalid, parquet

    path = folder / f"{TABLE}.parquet" if folder.is_dir() else folder
    hint = "it is written by `maritrack sweep` and `maritrack batch`"
    try:
        rows: list[Cells] = parquet.read_table(str(path)).to_pylist()
    except (OSError, ArrowInvalid) as error:
        raise InputError(f"{path}: no table of runs: {error}", hint=hint) from None
    if not rows or not rows[0].keys() >= {*FIRST, "input_sha256"}:
        raise InputError(f"{path}: a table, but not of runs", hint=hint)
    return rows


def _replace(path: Path, octets: bytes) -> None:
    partial = path.with_name(path.name + ".partial")
    partial.write_bytes(octets)
    os.replace(partial, path)
