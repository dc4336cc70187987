"""`maritrack table`: what a sweep says."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import options as opt
from . import render

if TYPE_CHECKING:
    from maritrack.sweep.compare import Comparison, Mean

HELP = """What a sweep or a batch says: means with bootstrap intervals, and paired differences with a test.

An input (a recording, or a scene with the noise of one seed) counts once, however many runs it has in a group. Each
group is compared with the best one (of the first metric; held, held_by_one, iou and npv are better where larger), or
with --against, on the inputs that both have: mean difference, its interval, and p of Wilcoxon's signed-rank test with
Holm's correction, without --against for all pairs of groups, as the best is chosen from them. Intervals are of 95 %:
percentiles of the bootstrap, widened as Student's t is where inputs are few. Runs that failed are left out.

Examples:

    maritrack table study --by tracker --metric gospa

    maritrack table study --by tracker --by cluster.eps_m --metric gospa --metric switches --plot study.png

    maritrack table study --by tracker --against sprt --md > comment.md
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="table", help=HELP)(table)


def table(
    folder: Annotated[Path, typer.Argument(help="Folder of a sweep, or its results.parquet.", show_default=False)],
    *,
    by: Annotated[list[str] | None, opt.method("--by", "Key of the groups: tracker, input, any setting.")] = None,
    metric: Annotated[list[str] | None, opt.method("--metric", "Column: gospa, ospa, switches, timing.total_s, ...")]
    = None,
    against: Annotated[str, opt.method("--against", "Group that the others are compared with; by default the best.")]
    = "",
    plot: Annotated[Path | None, opt.output("--plot", "Draw it (PNG).")] = None,
    md: Annotated[bool, opt.display("--md", "Markdown, for a comment on a change.")] = False,
    json_: opt.Json = False,
) -> None:  # fmt: skip
    """Read, compare, render."""
    from maritrack.sweep.compare import compare, document
    from maritrack.sweep.store import read_table

    found = compare(read_table(folder), by=by or ["tracker"], metrics=metric or ["gospa"], against=against)
    if plot is not None:
        from maritrack.sweep.picture import draw

        draw(plot, found, title=folder.resolve().name)
    render.emit_json(document(found)) if json_ else _tell(found, markdown=md)


def _tell(found: Comparison, *, markdown: bool) -> None:
    from maritrack.sweep.compare import label

    show = render.markdown_table if markdown else render.table
    for name in found.groups[0].metrics:
        rows = [(label(g.values), str(g.runs), *_cells(g.metrics[name])) for g in found.groups]
        show(f"{name}: mean over inputs", (", ".join(found.by), "runs", "inputs", "mean", "from", "to"), rows)
        pairs = [p for p in found.paired if p.metric == name]
        if pairs:
            told = [(label(p.values), *_cells(p.difference), render.number(p.p)) for p in pairs]
            header = (", ".join(found.by), "inputs", "difference", "from", "to", "p")
            show(f"{name}: minus that of {label(pairs[0].against)}", header, told)
            if (least := found.least_p(name)) > 0.05:
                print(f"\np can't be below {render.number(least)} here: more inputs (recordings, seeds) tell more")
    if found.failed:
        print(f"{found.failed} failed runs are left out")


def _cells(mean: Mean) -> tuple[str, ...]:
    return str(mean.inputs), *(render.number(value) for value in (mean.mean, mean.low, mean.high))
