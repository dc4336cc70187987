"""`maritrack smooth`: tracks of an archived run in hindsight."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from . import options as opt
from . import render

HELP = """Offline tracks of an archived run: what its tracks were, told with all that came after.

Positions, velocities and extents are smoothed over the whole of each track (fixed-interval smoother), a track is
shown from its first hit to its last, and whether it is true and whether it moves is judged by all of its life
(settings smooth.*). The run itself is not repeated. Writes a new archive, which export, score, diff and show read
like any other; it says that its tracks are offline, and of which run. The run's own tracks are causal: compare
like with like.

Examples:

    maritrack smooth run-a/run.mcap -o run-a-offline && maritrack diff run-a run-a-offline --only metrics

    maritrack smooth run-a --set smooth.min_hits=20 --set smooth.moving_displacement_m=200 -o offline

    maritrack smooth run-a -o offline && maritrack export offline/run.mcap --tracks tracks.csv --moving
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="smooth", help=HELP)(smooth)


def smooth(
    run: Annotated[Path, typer.Argument(help="Archive of a run, or its folder.", show_default=False)],
    *,
    sets: Annotated[list[str] | None, opt.method("--set", "A setting of smooth.* or score.*: KEY=VALUE.")] = None,
    inputs: Annotated[
        list[Path] | None, opt.given("--input", "The recording, where only its digest is archived.")
    ] = None,
    out: opt.Out = None,
    no_rrd: Annotated[bool, opt.output("--no-rrd", "No picture.")] = False,
    no_mcap: Annotated[bool, opt.output("--no-mcap", "No archive.")] = False,
    force: Annotated[bool, opt.output("--force", "Smooth even if equal tracks are there.")] = False,
    view: Annotated[bool, opt.display("--view", "Open the picture in the Rerun viewer.")] = False,
    json_: opt.Json = False,
    quiet: opt.Quiet = False,
) -> None:
    """Prepare, smooth, render."""
    from maritrack.replay import archive_path
    from maritrack.smooth import ready
    from maritrack.smooth import smooth as smoothed

    prepared = ready(
        archive_path(run), sets=sets or (), inputs=inputs or (), out=out, rrd=not no_rrd, mcap=not no_mcap, force=force
    )
    for line in prepared.notes:
        render.note(f"note: {line}", quiet=quiet)
    with render.progress(quiet=quiet, total_scans=prepared.archive.n_scans) as tick:
        summary, reused = smoothed(prepared, progress=tick)
    for damage in [d for d in prepared.damage if d not in prepared.archive.damage]:
        render.note(f"warning: {prepared.archive.path}: {damage.message}", quiet=quiet)
    if reused:
        render.note("equal tracks are here already (--force smooths again)", quiet=quiet)
    render.emit_json(summary) if json_ else render.summary(summary)
    if view and "rrd" in summary["outputs"]:
        render.view(Path(summary["outputs"]["rrd"]))
    if summary.get("interrupted"):
        raise typer.Exit(130)
