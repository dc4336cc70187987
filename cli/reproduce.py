"""`maritrack reproduce`: the experiment of a paper, run again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from . import options as opt
from . import render

HELP = """The experiment of a paper, run again: its tables beside ours, its figures, and which of its statements hold.

Scenes are simulated, so that the truth is known. A statement that does not hold says so and is no error: the exit
code is 0. Results do not depend on --workers.

Examples:

    maritrack reproduce polar --quick

    maritrack reproduce polar -o polar-again --seeds 5

    maritrack reproduce polar --quick --json > polar.json

    maritrack reproduce --list
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="reproduce", help=HELP)(reproduce)


def reproduce(
    paper: Annotated[str, typer.Argument(help="Key of the paper.", show_default=False)] = "",
    *,
    quick: Annotated[bool, opt.method("--quick", "Fewer and shorter runs, the same statements.")] = False,
    seeds: Annotated[int, opt.method("--seeds", "Monte Carlo runs; 0 = as many as the experiment has.")] = 0,
    workers: Annotated[int, opt.method("--workers", "-w", "Processes; 0 = one for each core.")] = 0,
    out: Annotated[Path | None, opt.output("--out", "-o", "Folder for figures and report.json.")] = None,
    list_: Annotated[bool, opt.display("--list", "Papers that can be run again.")] = False,
    json_: opt.Json = False,
    quiet: opt.Quiet = False,
) -> None:
    """Run, write the report, render."""
    from maritrack.errors import UsageError
    from maritrack.fanout import cores
    from maritrack.reproduce import REPRODUCTIONS
    from maritrack.reproduce import reproduce as run_again
    from maritrack.reproduce.claims import Plan

    if list_:
        render.emit_json({"papers": list(REPRODUCTIONS)}) if json_ else print("\n".join(REPRODUCTIONS))
        return
    if not paper:
        raise UsageError("which paper?", hint="papers: " + ", ".join(REPRODUCTIONS))
    workers = workers or min(cores(), opt.MOST_WORKERS)
    opt.check_workers(workers)
    plan = Plan(quick=quick, seeds=seeds, workers=workers, out=out)
    with render.steps("run", quiet=quiet) as tick:
        report = run_again(paper, plan, tick=tick)
    if out is not None:
        render.write_json(out / "report.json", report.document())
    if json_:
        render.emit_json(report.document())
    else:
        render.report(report)
