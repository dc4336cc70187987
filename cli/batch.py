"""`maritrack batch`: many recordings, long ones in segments."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from . import options as opt
from . import render
from .sweep import GRID, note_doubles, tell

HELP = """Many recordings: a folder, a pattern, URLs. One table holds what came of them, as of `maritrack sweep`.

A recording longer than --segment, and of 8 MiB or more, is run in segments of equal length, at the same time where
there are cores, and joined into DIR/runs/ID/run.mcap. A segment begins with an overlap to learn most of what the run in
one piece knows by then, and is run on behind its end until the next one tells the same for 48 scans: up to there the
joined run is that of one piece, ids included, from there on it is so to 1 cm, but for what the background forgets
later. Where two segments never tell the same the whole of the next is run again. summary.json tells where the seams
are, how many tracks were alive there and how many kept their ids. --segment 0 splits nothing. With --scheduler all
workers must see DIR under the same path.

Examples:

    maritrack batch campaign/ -o results

    maritrack batch 'radar/2026-*.cat240' --segment 30 --grid tracker=sprt,jipda -o results

    maritrack batch 's3://bucket/day-*.cat240' --scheduler tcp://10.0.0.1:8786 -o /shared/results
"""
SEGMENT = "Minutes; longer recordings are split. 0 = none is."
OVERLAP = "Seconds before a segment counts; by default as long as the settings remember."
RUN_ON = "Seconds for which a segment is run on, at most, until the next tells the same; by default all of the next."


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="batch", help=HELP)(batch)


def batch(
    places: Annotated[list[str], typer.Argument(help="Folders, patterns, recordings, URLs.", show_default=False)],
    *,
    out: opt.SweepOut,
    grid: Annotated[list[str] | None, opt.method("--grid", GRID)] = None,
    preset: opt.Preset = "",
    config: opt.ConfigFile = None,
    sets: opt.Sets = None,
    moving: Annotated[bool, opt.method("--moving", "Score moving tracks only.")] = False,
    truth: opt.Truths = None,
    truth_match: opt.TruthMatch = "",
    own_ship: opt.OwnShips = None,
    segment: Annotated[float, opt.method("--segment", SEGMENT)] = 60.0,
    overlap: Annotated[float | None, opt.method("--overlap", OVERLAP)] = None,
    run_on: Annotated[float | None, opt.method("--run-on", RUN_ON)] = None,
    workers: opt.AllWorkers = 0,
    scheduler: opt.Scheduler = "",
    archive: Annotated[bool, opt.output("--archive", "Keep run.mcap of short recordings as well.")] = False,
    retry: opt.Retry = False,
    json_: opt.Json = False,
    quiet: opt.Quiet = False,
) -> None:  # fmt: skip
    """Parse, plan, run, render."""
    from maritrack.errors import UsageError
    from maritrack.sweep.batch import Cut
    from maritrack.sweep.batch import batch as run_all
    from maritrack.sweep.plan import Settings, parse_axes, plan
    from maritrack.sweep.sources import named, octets_in, recordings

    if not all(value >= 0 for value in (segment, overlap or 0.0, run_on or 0.0)):  # nan is neither
        raise UsageError("--segment, --overlap and --run-on must not be negative")
    names, others = recordings(places)
    if others:
        render.note(f"note: {len(others)} files are no recordings: {others[0]}, ...", quiet=quiet)
    folder = str(Path.cwd()) if scheduler else ""  # relative paths are of here, wherever the workers stand
    sources = named(names, truth=truth or (), own_ship=own_ship or (), folder=folder)
    processes = opt.processes(workers)
    settings = Settings(preset=preset, file=config, sets=sets or (), over=opt.scored(moving, truth_match))
    runs = plan(
        sources, axes=parse_axes(grid or ()), seeds=(), settings=settings, workers=processes, scheduler=scheduler
    )  # fmt: skip
    sizes = {source.name: octets_in(source) for source in sources} if segment else {}
    cut = Cut(
        segment_s=60.0 * segment, overlap_s=-1.0 if overlap is None else overlap,
        run_on_s=math.inf if run_on is None else run_on,
    )  # fmt: skip
    with render.runs(quiet=quiet) as tick:
        found = run_all(
            runs, out, cut, sizes=sizes, workers=processes, scheduler=scheduler, keep=archive, retry=retry, tick=tick
        )  # fmt: skip
    note_doubles(sources, runs, quiet=quiet)
    tell(found, out, json_=json_)
