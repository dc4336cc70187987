"""Figs. 1, 2, 4 and 5 of the extended paper: the scenes with what trackers draw, and the scores scan by scan."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from maritrack.reproduce.extended_claims import PAPER, named
from maritrack.reproduce.extended_runs import (
    GP,
    JIPDA,
    NAMES,
    SCENES,
    SHIPS,
    TEST_1,
    TEST_2,
    TRACKERS,
    Run,
    one_scan,
    shown,
    the_scene,
)
from maritrack.simulate.lidar import outline
from maritrack.simulate.lidarscene import present, reference_of, scans_of
from maritrack.types import FloatArray

COLOURS = {GP: "#1f77b4", JIPDA: "#d62728"}
PARTS = (
    ("gospa", "GOSPA"), ("gospa_localisation", "localisation"), ("gospa_missed", "missed"),
    ("gospa_false", "false"), ("iou", "IoU"),
)  # fmt: skip


def draw(runs: Sequence[Run], folder: Path) -> dict[str, Path]:
    """All of them as PNG."""
    made = {
        "figure_1": scenes(runs), "figure_2": evolution(runs, SHIPS), "figure_4": evolution(runs, TEST_1),
        "figure_5": evolution(runs, TEST_2),
    }  # fmt: skip
    written = {}
    for name, figure in made.items():
        written[name] = folder / f"{name}.png"
        figure.savefig(written[name], dpi=110)
    return written


def _canvas(rows: int, columns: int, size: tuple[float, float], **shared: Any) -> tuple[Any, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False, **shared)


def evolution(runs: Sequence[Run], scene: str) -> Any:
    """Scores over the scans, means over the runs; the paper's means dotted."""
    figure, axes = _canvas(len(PARTS), 1, (10.0, 11.0), sharex=True)
    for at, (score, title) in zip(axes[:, 0], PARTS, strict=True):
        for tracker in TRACKERS:
            curve = mean_of_runs(np.array([run.scores[score] for run in named(runs, scene, tracker)]))
            at.plot(curve, color=COLOURS[tracker], linewidth=1.0, label=f"{tracker}: {np.nanmean(curve):.2f}")
            at.axhline(PAPER[scene, tracker][score], color=COLOURS[tracker], linestyle=":", linewidth=0.9)
        at.set_ylabel(title)
        at.set_ylim(bottom=0.0)
        at.grid(color="#dddddd", linewidth=0.5)
        at.legend(frameon=False, fontsize=8, loc="upper right")
    axes[-1, 0].set_xlabel("scan")
    count = len(named(runs, scene, JIPDA))
    axes[0, 0].set_title(f"{NAMES[scene]} ({scene}), mean of {count} runs; dotted: the paper's means")
    return figure


def mean_of_runs(values: FloatArray) -> FloatArray:
    """Mean over runs (r, scans) of those that have a value, nan where none has."""
    known = np.isfinite(values)
    count = known.sum(axis=0)
    total = np.where(known, values, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def scenes(runs: Sequence[Run]) -> Any:
    """Ways, points of one scan, true outlines there, and what each tracker draws."""
    figure, axes = _canvas(1, len(SCENES), (18.0, 6.5))
    for at, name in zip(axes[0], SCENES, strict=True):
        scene, first = the_scene(name), named(runs, name, JIPDA)[0]
        k = shown(scene, len(first.cpu_ms))
        reference = reference_of(scene, len(first.cpu_ms))
        for i in range(len(reference)):
            way = reference.position_m[reference.start[i] : reference.start[i + 1]]
            at.plot(*way.T, color="#bbbbbb", linewidth=0.8)
        cloud = one_scan(scans_of(scene, k, seed=first.case.seed)).points
        assert cloud is not None
        at.plot(*cloud.position_m.T, ".", color="black", ms=2)
        for _, boat, state in present(scene, k):
            _ring(at, outline(state, boat)[0], color="black", linewidth=0.9)
        for tracker in TRACKERS:
            for number, shape in enumerate(named(runs, name, tracker)[0].shapes):
                _ring(at, shape, color=COLOURS[tracker], linewidth=1.2, label=None if number else tracker)
        at.plot(*scene.place_m, "^", color="black", ms=6)
        at.set(title=f"{NAMES[name]} ({name}), scan {k}", xlabel="east [m]", ylabel="north [m]", aspect="equal")
        at.legend(frameon=False, fontsize=8)
    return figure


def _ring(at: Any, corners: FloatArray, **style: Any) -> None:
    if len(corners):
        at.plot(*np.concatenate([corners, corners[:1]]).T, **style)
