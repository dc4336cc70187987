"""`maritrack replay`: run again from the archive."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from . import options as opt
from . import render

HELP = """Run again from an archive: the recording, the configuration and the truth are in it.

--verify compares every output message with the archived one: exit 0 the same, 1 different. An archive
of a run that was killed (run.mcap.partial) is replayed as far as it goes. Offline tracks (`maritrack smooth`) are no
run of their own: replay the run that they come from, then smooth that.

Examples:

    maritrack replay run.mcap --verify

    maritrack replay run.mcap --set model.p_detect=0.7 -o other && maritrack diff run.mcap other
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="replay", help=HELP)(replay)


def replay(
    run: Annotated[Path, typer.Argument(help="Archive of a run, or its folder.", show_default=False)],
    *,
    verify: Annotated[bool, typer.Option("--verify", help="Compare with what is archived; writes nothing.")] = False,
    tracker: opt.Tracker = "",
    sets: opt.Sets = None,
    inputs: Annotated[
        list[Path] | None, opt.given("--input", "The recording, where only its digest is archived.")
    ] = None,
    out: opt.Out = None,
    no_rrd: Annotated[bool, opt.output("--no-rrd", "No picture.")] = False,
    no_mcap: Annotated[bool, opt.output("--no-mcap", "No archive.")] = False,
    force: Annotated[bool, opt.output("--force", "Run even if an equal run is there.")] = False,
    view: Annotated[bool, opt.display("--view", "Open the picture in the Rerun viewer.")] = False,
    json_: opt.Json = False,
    quiet: opt.Quiet = False,
) -> None:
    """Prepare, run, render."""
    from maritrack.errors import UsageError
    from maritrack.job import execute
    from maritrack.replay import archive_path, prepare, verify_run

    if verify and (tracker or sets or out or view):
        raise UsageError("--verify runs what is archived and writes nothing: no -t, --set, -o or --view with it")
    ready = prepare(
        archive_path(run), tracker=tracker, sets=sets or (), inputs=inputs or (), out=out,
        rrd=not no_rrd, mcap=not no_mcap, force=force,
    )  # fmt: skip
    for line in ready.notes:
        render.note(f"note: {line}", quiet=quiet)
    with render.progress(quiet=quiet, total_scans=ready.archive.n_scans) as tick:
        if verify:
            found = verify_run(ready, progress=tick)
        else:
            summary, reused = execute(ready.job, progress=tick)
    for damage in [d for d in ready.damage if d not in ready.archive.damage]:
        render.note(f"warning: {ready.archive.path}: {damage.message}", quiet=quiet)
    if verify:
        render.emit_json(render.verification_document(found)) if json_ else render.verification(found)
        raise typer.Exit(0 if found.equal else 1)
    _tell(summary, reused, as_json=json_, quiet=quiet)
    if view and "rrd" in summary["outputs"]:
        render.view(Path(summary["outputs"]["rrd"]))
    if summary.get("interrupted"):
        raise typer.Exit(130)


def _tell(summary: dict[str, Any], reused: bool, *, as_json: bool, quiet: bool) -> None:
    if reused:
        render.note("an equal run is here already (--force runs it again)", quiet=quiet)
    render.emit_json(summary) if as_json else render.summary(summary)
