"""`maritrack diff`: what differs between two runs."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from . import options as opt
from . import render

HELP = """What differs between two runs: archives, run folders or summaries. Exit 0 equal, 1 different.

With a summary on either side metrics and counts are compared, else every frame. Timings never count.

Examples:

    maritrack diff runs/a runs/b

    maritrack diff golden.json now.json --rtol 1e-6 --only metrics --md

    maritrack diff golden.json runs/now/run.mcap --tolerances tol.toml --junit diff.xml

A file of tolerances is TOML: rtol and atol of all numbers, then tables metrics, counts, tracks, points, clusters,
scores, scan, truth with an entry for each name ("*" = all others): gospa = 0.01 (rtol) or { rtol = 0, atol = 0.5 }.
"""
SHOWN = 10
ALL = 1 << 31


class Only(StrEnum):
    """Parts of a run."""

    metrics = "metrics"
    tracks = "tracks"


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="diff", help=HELP)(diff)


def diff(
    a: Annotated[Path, typer.Argument(help="A run: archive, folder or summary.json.", show_default=False)],
    b: Annotated[Path, typer.Argument(help="Another one.", show_default=False)],
    *,
    rtol: Annotated[float, typer.Option("--rtol", min=0.0, help="Numbers may differ by this share.")] = 0.0,
    atol: Annotated[float, typer.Option("--atol", min=0.0, help="Numbers may differ by this much.")] = 0.0,
    tolerances: Annotated[Path | None, typer.Option("--tolerances", help="TOML with one for each metric, ...")] = None,
    only: Annotated[Only | None, typer.Option("--only", help="Compare only these.")] = None,
    all_: Annotated[bool, typer.Option("--all", help=f"All differences, not only the first {SHOWN}.")] = False,
    junit: Annotated[Path | None, typer.Option("--junit", help="Write what was compared as JUnit XML.")] = None,
    json_: opt.Json = False,
    md: Annotated[bool, typer.Option("--md", help="Markdown, for a comment on a change.")] = False,
) -> None:
    """Compare, render."""
    from maritrack.diff import diff as compare
    from maritrack.tolerances import Tolerance, Tolerances, read_tolerances

    floats = Tolerance(rtol, atol)
    allowed = read_tolerances(tolerances, floats=floats) if tolerances is not None else Tolerances(floats)
    found = compare(a, b, tolerances=allowed, only=only.value if only else None, limit=ALL if all_ else SHOWN)
    if unused := allowed.unused(found.parts):
        render.note(f"note: {tolerances}: neither run has {', '.join(unused)}", quiet=False)
    if junit is not None:
        from maritrack.junit import junit_octets

        junit.write_bytes(junit_octets(found, a=str(a), b=str(b)))
    render.emit_json(render.diff_document(found)) if json_ else render.diff(found, str(a), str(b), markdown=md)
    raise typer.Exit(0 if found.equal else 1)
