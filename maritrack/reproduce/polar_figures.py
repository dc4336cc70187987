"""Figs. 3 and 4 of the polar paper: OSPA and its parts over time, both domains side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from maritrack.reproduce.polar_runs import DOMAINS, TRACKERS, Run

if TYPE_CHECKING:
    from maritrack.sinks.curves import Panel

PARTS = ("OSPA distance [m]", "localisation [m]", "cardinality [m]")
ENTITIES = ("ospa", "localisation", "cardinality")
COLOURS = {"sprt": "#999999", "ipda": "#0072b2", "jipda": "#d55e00", "cb-giw-phd": "#009e73"}


def draw(runs: Sequence[Run], area: str, path: Path) -> None:
    """The figure of a field from its runs of one seed, as PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 8.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(3, 2, sharex=True, sharey="row")
    for column, domain in enumerate(DOMAINS):
        for row, part in enumerate(PARTS):
            at = axes[row][column]
            for run in runs:
                if run.domain == domain:
                    at.plot(run.ospa[row], color=COLOURS[run.tracker], linewidth=0.9, label=run.tracker)
            at.set_ylim(0.0, 105.0)
            at.grid(color="#dddddd", linewidth=0.5)
            at.set_title(f"{domain} clusters") if row == 0 else None
            at.set_ylabel(part) if column == 0 else None
    for at in axes[-1]:
        at.set_xlabel("scan")
    handles, labels = axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(TRACKERS), frameon=False)
    figure.suptitle(f"{area} field, seed {runs[0].case.seed}, c = 100 m, p = 2")
    figure.savefig(path, dpi=110)


def panels(runs: Sequence[Run]) -> tuple[Panel, ...]:
    """The same numbers for the viewer, as many columns as there are domains."""
    from maritrack.sinks.curves import Curve, Panel

    found = []
    for area in dict.fromkeys(run.case.area for run in runs):
        for row, part in enumerate(PARTS):
            for domain in DOMAINS:
                mine = [run for run in runs if (run.case.area, run.domain) == (area, domain)]
                lines = tuple(
                    Curve(
                        f"{area}/{domain}/{run.tracker}/{ENTITIES[row]}", run.tracker, rgb(run.tracker), run.ospa[row]
                    )
                    for run in mine
                )
                found.append(Panel(f"{area} field, {domain} clusters: {part}", lines, 105.0))
    return tuple(found)


def rgb(tracker: str) -> tuple[int, int, int]:
    """The colour of a tracker."""
    text = COLOURS[tracker]
    return int(text[1:3], 16), int(text[3:5], 16), int(text[5:7], 16)
