"""`maritrack score`: metrics of an archived run once more."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from . import options as opt
from . import render

HELP = """Metrics of an archived run once more: against other truth, or with other settings of the metrics.

The tracks are those of the archive. Exit 1 when a --fail-over limit is exceeded.

Examples:

    maritrack score run.mcap --set score.c_m=50 --objects

    maritrack score run.mcap --truth ais.csv --moving --truth-lag 210574000=37

    maritrack score run.mcap --fail-over gospa=80 --json
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="score", help=HELP)(score)


def matched(sets: Sequence[str], ids: str) -> Sequence[str]:
    """The settings with --truth-match as one of them."""
    return [*sets, f"score.truth_match={json.dumps(ids)}"] if ids else sets


def score(
    run: Annotated[Path, typer.Argument(help="Archive of a run, or its folder.", show_default=False)],
    *,
    truth: opt.Truth = None,
    truth_match: opt.TruthMatch = "",
    sets: Annotated[list[str] | None, opt.method("--set", "One setting of the metrics, e.g. score.c_m=50.")] = None,
    moving: Annotated[bool, opt.method("--moving", "Score moving tracks only.")] = False,
    truth_lag: Annotated[
        list[str] | None, opt.given("--truth-lag", "ID=SECONDS: reports of that ship are late.")
    ] = None,
    fail_over: Annotated[
        list[str] | None, opt.display("--fail-over", "METRIC=LIMIT, e.g. gospa=5: exit 1 above it.")
    ] = None,
    objects: Annotated[bool, opt.display("--objects", "How each object of the truth was held.")] = False,
    json_: opt.Json = False,
    quiet: opt.Quiet = False,
) -> None:
    """Score, check, render."""
    from maritrack.replay import archive_path
    from maritrack.score import check, parse_limits
    from maritrack.score import score as rescore

    path, limits = archive_path(run), parse_limits(fail_over or ())
    document, damage = rescore(
        path, truth=truth, sets=matched(sets or (), truth_match), moving=moving, lags=truth_lag or ()
    )
    for item in damage:
        render.note(f"warning: {path}: {item.message}", quiet=quiet)
    rows = check(document["metrics"], limits)
    if json_:
        told = [{"metric": r.metric, "limit": r.limit, "value": r.value, "exceeded": r.exceeded} for r in rows]
        render.emit_json(document | {"limits": told})
    else:
        render.scores(document, objects=objects)
        for row in rows:
            print(f"{row.metric} {render.number(row.value)} {'exceeds' if row.exceeded else 'is within'} {row.limit:g}")
    raise typer.Exit(1 if any(row.exceeded for row in rows) else 0)
