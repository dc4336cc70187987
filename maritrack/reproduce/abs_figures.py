"""Figs. 2 to 4 of the abs paper: what was taken for background, how well, and how many vessels were tracked."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from maritrack.reproduce.abs_runs import Run, Snapshot
from maritrack.types import FloatArray, IntArray

WINDOW = 15  # steps of a running mean


def draw(runs: Sequence[Run], folder: Path) -> dict[str, Path]:
    """All figures of the runs of one seed as PNG, by name."""
    by = {run.case.name: run for run in runs}
    written = {name: folder / f"{name}.png" for name in ("figure_2", "figure_3", "figure_4")}
    _figure_2(by, written["figure_2"])
    _figure_3(by, written["figure_3"])
    _figure_4(by, written["figure_4"])
    return written


def _canvas(width: float, height: float) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _figure_2(by: dict[str, Run], path: Path) -> None:
    """Points and tracks at the three key times."""
    figure = _canvas(20.0, 5.0)
    shots = by["2B"].snapshots
    axes = np.atleast_2d(figure.subplots(max(len(shots), 1), 3, sharex=True, sharey=True))
    for row, shot in enumerate(shots):
        _points(axes[row][0], shot)
        _tracks(axes[row][1], by["2A"].snapshots[row])
        _tracks(axes[row][2], shot)
        axes[row][0].set_ylabel(f"k = {shot.t_s:.0f} s\nnorth [m]")
    for at, title in zip(axes[0], ("2B: background and foreground", "2A: tracks", "2B: tracks"), strict=True):
        at.set_title(title)
    for at in axes.ravel():
        at.set_aspect("equal")
        at.set_xlim(-3300.0, 3600.0)
        at.set_ylim(-480.0, 480.0)
    figure.savefig(path, dpi=110)


def _points(at: Any, shot: Snapshot) -> None:
    for keep, colour in ((False, "black"), (True, "#d62728")):
        z = shot.position_m[shot.keep == keep]
        at.plot(z[:, 0], z[:, 1], ".", color=colour, markersize=1.2)
    _boxes(at, shot)


def _tracks(at: Any, shot: Snapshot) -> None:
    _boxes(at, shot)
    turn = np.linspace(0.0, 2.0 * np.pi, 60)
    circle = np.stack([np.cos(turn), np.sin(turn)])
    for place, extent, number, rests in zip(shot.tracks_m, shot.extent_m2, shot.track_id, shot.stationary, strict=True):
        ring = place[:, None] + np.linalg.cholesky(extent) @ circle
        at.plot(*ring, color="#999999" if rests else "#d62728", linewidth=1.2)
        at.annotate(str(number), place, fontsize=7, xytext=(4, 8), textcoords="offset points")


def _boxes(at: Any, shot: Snapshot) -> None:
    truth = shot.truth
    for i in range(len(truth)):
        s, c = np.sin(truth.heading_rad[i]), np.cos(truth.heading_rad[i])
        corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1], [1, 1]]) / 2 * [truth.length_m[i], truth.width_m[i]]
        outline = truth.position_m[i] + corners[:, :1] * [s, c] + corners[:, 1:] * [c, -s]
        at.plot(outline[:, 0], outline[:, 1], color="#1f77b4", linewidth=0.8)


def _figure_3(by: dict[str, Run], path: Path) -> None:
    """FPR and NPV over time, 2A solid and 2B dashed."""
    figure = _canvas(10.0, 5.0)
    at = figure.subplots()
    for name, line in (("2A", "-"), ("2B", "--")):
        run = by[name]
        tp, fp, fn, tn = (smooth(run.table[:, i]) for i in range(4))
        for what, part, whole, colour in (("FPR", fp, fp + tn, "#d62728"), ("NPV", tn, tn + fn, "#1f77b4")):
            rate = np.divide(part, whole, out=np.full(len(tp), np.nan), where=whole > 0)
            at.plot(run.t_s, rate, line, color=colour, linewidth=1.2, label=f"{what} {name}")
    at.set_xlabel("time [s]")
    at.set_ylim(0.0, 1.0)
    at.grid(color="#dddddd", linewidth=0.5)
    at.legend(ncols=2)
    figure.savefig(path, dpi=110)


def smooth(count: IntArray) -> FloatArray:
    """Running sums over some steps (k,)."""
    return np.convolve(count, np.ones(WINDOW), mode="same")


def _figure_4(by: dict[str, Run], path: Path) -> None:
    """Number of confirmed tracks and of vessels under way."""
    figure = _canvas(10.0, 8.0)
    names = ("1A", "1B", "2A", "2B")
    axes = figure.subplots(len(names), 1, sharex=True, sharey=True)
    for at, name in zip(axes, names, strict=True):
        run = by[name]
        at.step(run.t_s, run.under_way.sum(axis=1), color="black", linewidth=1.2, label="vessels under way")
        at.step(run.t_s, run.n_tracks, color="#d62728", linewidth=0.8, label="tracks")
        at.axvline(run.converged_s, color="#999999", linestyle=":", label="converged")
        at.set_ylabel(name)
        at.grid(color="#dddddd", linewidth=0.5)
    axes[0].legend(ncols=3)
    axes[-1].set_xlabel("time [s]")
    figure.savefig(path, dpi=110)
