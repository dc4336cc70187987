"""`maritrack dump`: the records of a CAT240 recording, as they are."""

from __future__ import annotations

import csv
import json
import os
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

HELP = """Records of a CAT240 recording as JSON Lines, or as CSV, in the order of the file.

A problem stands in its place: {"warning": code, "offset": octet, "message": what}.

Examples:

    maritrack dump harbour.cat240 | head -3

    maritrack dump harbour.cat240 --csv > records.csv

    zcat old.cat240.gz | maritrack dump - --cells | jq -c 'select(.idx == 7).cells'
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="dump", help=HELP)(dump)


def dump(
    recording: Annotated[Path, typer.Argument(help="CAT240 file, - for standard input.", show_default=False)],
    *,
    cells: Annotated[bool, typer.Option("--cells", help="With the video cells.")] = False,
    csv_: Annotated[bool, typer.Option("--csv", help="CSV with a header, an item that was not sent is empty.")] = False,
) -> None:
    """Read, write, line by line."""
    from maritrack.errors import InputError
    from maritrack.io.cat240 import file_chunks
    from maritrack.io.dump import CSV_FIELDS, dump_records

    piped = str(recording) == "-"
    name = "standard input" if piped else str(recording)
    chunks: Iterable[bytes] = iter(lambda: os.read(0, 1 << 20), b"") if piped else file_chunks(recording)
    seen: dict[str, int] = {}
    rows = _counted(dump_records(chunks, cells=cells, name=name), seen)
    _write_csv(rows, CSV_FIELDS) if csv_ else _write_lines(rows)
    if not seen:
        raise InputError(f"{name}: is empty")
    if set(seen) == {"not-asterix"}:
        raise InputError(f"{name}: no CAT240 in it")


def _counted(rows: Iterator[dict[str, Any]], seen: dict[str, int]) -> Iterator[dict[str, Any]]:
    """The rows, while their kinds are counted: record, or the code of a problem."""
    for row in rows:
        kind = row.get("warning", "record")
        seen[kind] = seen.get(kind, 0) + 1
        yield row


def _write_lines(rows: Iterator[dict[str, Any]]) -> None:
    for row in rows:
        sys.stdout.write(json.dumps(row) + "\n")


def _write_csv(rows: Iterator[dict[str, Any]], fields: tuple[str, ...]) -> None:
    writer = csv.DictWriter(sys.stdout, fields, lineterminator="\n")
    writer.writeheader()
    for row in rows:
        cells = {"cells": " ".join(map(str, row["cells"]))} if "cells" in row else {}
        writer.writerow(row | cells)
