"""`maritrack dump`: the records of a CAT240 recording, as they are."""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

HELP = """Records of a CAT240 recording as JSON Lines, or as CSV, in the order of the file.

A problem stands in its place: {"warning": code, "offset": octet, "message": what}.

Examples:

    maritrack dump harbour.cat240 | head -3

    maritrack dump harbour.cat240 --csv > records.csv

    maritrack dump radar.pcap.gz --stream :8600 --cells | jq -c 'select(.idx == 7).cells'
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="dump", help=HELP)(dump)


def dump(
    recording: Annotated[Path, typer.Argument(help="Recording, - for standard input.", show_default=False)],
    *,
    cells: Annotated[bool, typer.Option("--cells", help="With the video cells.")] = False,
    stream: Annotated[str, typer.Option("--stream", help="Of a capture: ADDRESS, ADDRESS:PORT or :PORT.")] = "",
    csv_: Annotated[bool, typer.Option("--csv", help="CSV with a header, an item that was not sent is empty.")] = False,
) -> None:
    """Read, write, line by line."""
    from maritrack.errors import InputError
    from maritrack.io import refuse_known
    from maritrack.io.containers.kinds import is_gzip_of_nothing
    from maritrack.io.dump import CSV_FIELDS, dump_recording
    from maritrack.io.octets import octets_from_file, octets_from_stdin

    octets = octets_from_stdin() if str(recording) == "-" else octets_from_file(recording, "")
    name = octets.name
    if not octets.head or is_gzip_of_nothing(octets.head):
        raise InputError(f"{name}: empty")
    refuse_known(octets.head, name)
    seen: dict[str, int] = {}
    rows = _counted(dump_recording(octets, cells=cells, stream=stream), seen)
    _write_csv(rows, CSV_FIELDS) if csv_ else _write_lines(rows)
    if not seen:
        raise InputError(f"{name}: no CAT240 in it")
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
