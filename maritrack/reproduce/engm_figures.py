"""Figs. 1 to 4 of the engm paper: what was reported where, how many, OSPA over time, components and CPU."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from maritrack.reproduce.engm_claims import PAPER, named
from maritrack.reproduce.engm_runs import PAPERS, SOUND, TRACKERS, Run, the_scene
from maritrack.simulate.pointscene import truth_of

COLOURS = {"gm-phd": "#d62728", "smc-phd": "#1f77b4", "engm-phd": "#2ca02c"}
CLUTTER = {PAPERS: "clutter per volume of space (paper)", SOUND: "clutter in measurement space"}
PARTS = ("OSPA [m]", "localisation [m]", "cardinality [m]")


def draw(runs: Sequence[Run], folder: Path) -> dict[str, Path]:
    """All four as PNG."""
    drawn = {"figure_1": positions, "figure_2": numbers, "figure_3": distances, "figure_4": costs}
    written = {}
    for name, make in drawn.items():
        written[name] = folder / f"{name}.png"
        make(runs).savefig(written[name], dpi=110)
    return written


def _canvas(rows: int, columns: int, size: tuple[float, float], **shared: Any) -> tuple[Any, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False, **shared)


def positions(runs: Sequence[Run]) -> Any:
    """Fig. 1: east and up of all that was reported, one run strong, and the objects' ways."""
    figure, axes = _canvas(2, 3, (12.0, 9.0), sharex=True, sharey=True)
    scene = the_scene()
    ways = np.stack([truth_of(scene, k) for k in (0, scene.scans - 1)])
    for row, clutter in enumerate(CLUTTER):
        for column, tracker in enumerate(TRACKERS):
            at, mine = axes[row][column], named(runs, tracker, clutter)
            every = np.concatenate([run.position_m for run in mine])
            opacity = min(1.0, 30.0 / len(mine))
            at.plot(every[:, 0], every[:, 2], ".", color=COLOURS[tracker], ms=2, alpha=0.03 + 0.3 * opacity, mew=0)
            at.plot(mine[0].position_m[:, 0], mine[0].position_m[:, 2], "o", color=COLOURS[tracker], ms=3)
            for i in range(ways.shape[1]):
                at.plot(ways[:, i, 0], ways[:, i, 2], color="black", linewidth=1.2)
            at.set(xlim=(-50, 250), ylim=(-50, 450), title=f"{tracker}\n{CLUTTER[clutter]}")
            at.grid(color="#dddddd", linewidth=0.5)
    for at in axes[-1]:
        at.set_xlabel("east [m]")
    for at in axes[:, 0]:
        at.set_ylabel("up [m]")
    return figure


def numbers(runs: Sequence[Run]) -> Any:
    """Fig. 2: how many objects are reported of two."""
    figure, axes = _canvas(2, 3, (12.0, 6.5), sharex=True, sharey=True)
    for row, clutter in enumerate(CLUTTER):
        for column, tracker in enumerate(TRACKERS):
            at, mine = axes[row][column], named(runs, tracker, clutter)
            count = np.array([run.found for run in mine])
            k = np.tile(np.arange(count.shape[1]), len(mine))
            at.plot(k, count.ravel(), ".", color=COLOURS[tracker], ms=4, alpha=0.05, mew=0)
            at.plot(count[0], ".-", color=COLOURS[tracker], linewidth=0.8, ms=3)
            at.axhline(2.0, color="black", linewidth=1.0)
            at.set(ylim=(-0.5, 12.5), title=f"{tracker}\n{CLUTTER[clutter]}")
            at.grid(color="#dddddd", linewidth=0.5)
    for at in axes[-1]:
        at.set_xlabel("scan")
    for at in axes[:, 0]:
        at.set_ylabel("objects reported")
    return figure


def distances(runs: Sequence[Run]) -> Any:
    """Fig. 3: OSPA and its parts, means over the runs."""
    figure, axes = _canvas(3, 2, (12.0, 9.0), sharex=True, sharey="row")
    for column, clutter in enumerate(CLUTTER):
        for row, part in enumerate(PARTS):
            at = axes[row][column]
            for tracker in TRACKERS:
                curve = np.mean([run.ospa[row] for run in named(runs, tracker, clutter)], axis=0)
                at.plot(curve, color=COLOURS[tracker], label=f"{tracker}: {curve.mean():.1f}")
                if row == 0 and clutter == PAPERS:
                    at.axhline(PAPER[tracker]["OSPA"], color=COLOURS[tracker], linestyle=":", linewidth=0.9)
            at.set_ylabel(part)
            at.grid(color="#dddddd", linewidth=0.5)
            at.legend(frameon=False, fontsize=8)
        axes[0][column].set_title(CLUTTER[clutter] + (", dotted: published means" if clutter == PAPERS else ""))
        axes[-1][column].set_xlabel("scan")
    return figure


def costs(runs: Sequence[Run]) -> Any:
    """Fig. 4: components and CPU of a run."""
    figure, axes = _canvas(1, 2, (10.0, 4.0))
    for row, clutter in enumerate(CLUTTER):
        for i, tracker in enumerate(TRACKERS):
            mine = named(runs, tracker, clutter)
            values = (np.mean([run.components.mean() for run in mine]), np.mean([run.cpu_s for run in mine]))
            for at, value, form in zip(axes[0], values, ("{:.0f}", "{:.2f}"), strict=True):
                bar = at.bar(i + 0.4 * row, value, 0.38, color=COLOURS[tracker], alpha=1.0 - 0.5 * row)
                at.bar_label(bar, [form.format(value)])
    for at, what in zip(axes[0], ("mean number of components", "CPU of a run of 101 scans [s]"), strict=True):
        at.set_xticks([i + 0.2 for i in range(len(TRACKERS))], TRACKERS)
        at.set_title(what)
    figure.suptitle("strong: " + CLUTTER[PAPERS] + ", pale: " + CLUTTER[SOUND])
    return figure
