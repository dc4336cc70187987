"""Figs. 6 to 9 of the dataset paper: the ways of the targets, and their position errors over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from maritrack.reproduce.dataset_claims import lost, named
from maritrack.reproduce.dataset_runs import EC, GATE, SCENES, STANDARD, TARGETS, Run, the_scene
from maritrack.types import FloatArray

COLOURS = {EC: "#1f77b4", STANDARD: "#d62728", GATE: "#8a8a8a"}
FIGURE = {"daan": "figure_7", "darc": "figure_8", "manv": "figure_9"}


def draw(runs: Sequence[Run], folder: Path) -> dict[str, Path]:
    """All of them as PNG."""
    made = {"figure_6": ways(runs)} | {FIGURE[scene]: errors(runs, scene) for scene in SCENES}
    written = {}
    for name, figure in made.items():
        written[name] = folder / f"{name}.png"
        figure.savefig(written[name], dpi=110)
    return written


def _canvas(rows: int, columns: int, size: tuple[float, float]) -> tuple[Any, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def by_second(runs: Sequence[Run], key: str) -> tuple[FloatArray, FloatArray]:
    """Errors (runs, seconds) of a target on one grid of seconds, nan where a frame was lost, and the grid."""
    last = max(round(float(run.time_s[-1])) for run in runs)
    table = np.full((len(runs), last + 1), np.nan)
    for row, run in enumerate(runs):
        table[row, np.rint(run.time_s).astype(int)] = run.error_m[key]
    return table, np.arange(last + 1.0)


def errors(runs: Sequence[Run], scene: str) -> Any:
    """Median of the runs over time, and the middle half of them, of those that have not lost the target."""
    keys = TARGETS[scene]
    figure, axes = _canvas(len(keys), 1, (9.0, 3.4 * len(keys)))
    for row, (at, key) in enumerate(zip(axes[:, 0], keys, strict=True)):
        for tracker in (GATE, STANDARD, EC):  # the last one lies on top
            mine, gone = named(runs, scene, tracker), lost(runs, scene, tracker)[:, row]
            label = f"{tracker}, lost in {gone.sum()} of {len(gone)} runs" if gone.any() else tracker
            if gone.all():
                at.plot([], [], color=COLOURS[tracker], label=label)
                continue
            table, second = by_second([run for run, away in zip(mine, gone, strict=True) if not away], key)
            there = np.isfinite(table).any(axis=0)
            low, middle, high = np.nanquantile(table[:, there], (0.25, 0.5, 0.75), axis=0)
            at.plot(second[there], middle, color=COLOURS[tracker], linewidth=1.0, label=label)
            if tracker != GATE:
                at.fill_between(second[there], low, high, color=COLOURS[tracker], alpha=0.2, linewidth=0)
        at.set(title=f"{scene}, {key}", xlabel="time [s]", ylabel="position error [m]")
        at.set_ylim(bottom=0.0)
        at.grid(color="#dddddd", linewidth=0.5)
        at.legend(frameon=False, fontsize=8)
    return figure


def ways(runs: Sequence[Run]) -> Any:
    """What ec-jpda estimates, on jpda, in the first run of each scene, on the true ways."""
    figure, axes = _canvas(1, len(SCENES), (17.0, 6.0))
    for at, name in zip(axes[0], SCENES, strict=True):
        scene = the_scene(name)
        for vessel in scene.others:
            at.plot(*vessel.course().at(np.arange(0.0, scene.scans)).position_m.T, color="#bbbbbb", linewidth=4.5)
        for mark in scene.mark:
            at.plot(mark.east_m, mark.north_m, "^" if mark.racon_m else "o", color="black", ms=5)
        for tracker, width in ((STANDARD, 2.6), (EC, 0.9)):
            run = named(runs, name, tracker)[0]
            for number, way in enumerate(run.way_m.values()):
                label = None if number else tracker
                at.plot(*way.T, color=COLOURS[tracker], linewidth=width, label=label)
        at.set(title=f"{name}, run {run.case.seed}", xlabel="east [m]", ylabel="north [m]", aspect="equal")
        at.legend(frameon=False, fontsize=8)
    return figure
