"""`maritrack sweep`: every combination of inputs, settings and seeds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from . import options as opt
from . import render

HELP = """Every combination of inputs, settings and seeds is a run; one table holds what came of them.

An input is a recording, its URL (s3://..., through fsspec), or a scene that is simulated anew with each seed. A run is
known by its content: what is finished in DIR is not run again, and a sweep that was killed goes on. What fails is a row
with its error. Neither the number of workers nor their order changes a result. DIR/results.parquet and .csv are the
table (`maritrack table DIR`), DIR/rows has a file for each run.

Examples:

    maritrack sweep rec.cat240 --grid tracker=sprt,jipda --grid cluster.eps_m=35,45,55 -o study

    maritrack sweep harbour --seeds 0:100 --grid tracker=sprt,jipda -o monte-carlo

    maritrack sweep s3://bucket/a.cat240 s3://bucket/b.cat240 --scheduler tcp://10.0.0.1:8786 -o study
"""
GRID = "KEY=V1,V2,... or KEY=FROM:TO:STEP; tracker=A,B."
SEEDS = "FROM:TO (0:100 are 0 to 99) or A,B: of a scene's noise, and of the run."


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="sweep", help=HELP)(sweep)


def sweep(
    inputs: Annotated[list[str], typer.Argument(help="Recordings, URLs, scenes.", show_default=False)],
    *,
    out: opt.SweepOut,
    grid: Annotated[list[str] | None, opt.method("--grid", GRID)] = None,
    seeds: Annotated[str, opt.method("--seeds", SEEDS)] = "",
    preset: opt.Preset = "",
    config: opt.ConfigFile = None,
    sets: opt.Sets = None,
    moving: Annotated[bool, opt.method("--moving", "Score moving tracks only.")] = False,
    truth: opt.Truths = None,
    truth_match: opt.TruthMatch = "",
    own_ship: opt.OwnShips = None,
    limit: opt.Limit = None,
    scans: Annotated[int, opt.given("--scans", "Scans of a scene; 0 = as many as it has.")] = 0,
    workers: opt.AllWorkers = 0,
    scheduler: opt.Scheduler = "",
    archive: Annotated[bool, opt.output("--archive", "Keep run.mcap of each run in DIR/runs.")] = False,
    retry: opt.Retry = False,
    json_: opt.Json = False,
    quiet: opt.Quiet = False,
) -> None:  # fmt: skip
    """Parse, plan, run, render."""
    from maritrack.sweep.drive import sweep as run_all
    from maritrack.sweep.plan import Settings, parse_axes, parse_seeds, plan
    from maritrack.sweep.sources import named

    axes, chosen = parse_axes(grid or ()), parse_seeds(seeds) if seeds else ()
    folder = str(Path.cwd()) if scheduler else ""  # relative paths are of here, wherever the workers stand
    sources = named(inputs, scans=scans, truth=truth or (), own_ship=own_ship or (), folder=folder)
    over: dict[str, Any] = {"input": {"limit": limit}} if limit is not None else {}
    over |= opt.scored(moving, truth_match)
    processes = opt.processes(workers)
    settings = Settings(preset=preset, file=config, sets=sets or (), over=over)
    runs = plan(sources, axes=axes, seeds=chosen, settings=settings, workers=processes, scheduler=scheduler)
    with render.runs(quiet=quiet) as tick:
        found = run_all(
            runs, out, workers=processes, scheduler=scheduler, keep=archive, retry=retry, tick=tick
        )  # fmt: skip
    note_doubles(sources, runs, quiet=quiet)
    if len(chosen) > 1 and not all(source.scene for source in sources):
        render.note("note: no tracker draws random numbers: a recording gives the same with every seed", quiet=quiet)
    tell(found, out, json_=json_)


def note_doubles(sources: Any, runs: Any, *, quiet: bool) -> None:
    """Say so where an input has no row of its own."""
    n = len(sources) - len({run.source for run in runs})
    if n:
        render.note(f"note: {n} inputs have the content of another one, which has the row", quiet=quiet)


def tell(found: Any, out: Path, *, json_: bool) -> None:
    """What came of a sweep or a batch."""
    rows, bad = found.rows, found.failed
    if json_:
        told = {"runs": len(rows), "failed": len(bad), "reused": found.reused, "outputs": found.outputs, "rows": rows}
        render.emit_json(told)
        return
    print(f"{len(rows)} runs, {found.reused} of them finished before, {len(bad)} failed")
    errors: dict[str, int] = {}
    for row in bad:
        errors[row["error"]] = errors.get(row["error"], 0) + 1
    render.table("errors", ("error", "runs"), [(error, str(n)) for error, n in errors.items()])
    if bad:
        print("failed runs are not tried again without --retry-failed")
    for name, path in found.outputs.items():
        print(f"{name}: {path}")
    print(f"next: maritrack table {out}")
