"""Groups of a table as a picture: each metric a panel, each group a point with its interval."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from maritrack.sweep.compare import Comparison, label
from maritrack.tune.pictures import save, sheet


def draw(path: Path, found: Comparison, *, title: str) -> None:
    """A PNG; equal tables give equal octets. Along an axis where the key is one number, else as a list."""
    names = list(found.groups[0].metrics)
    values = [group.values for group in found.groups]
    line = len(found.by) == 1 and all(isinstance(v[0], int | float) and not isinstance(v[0], bool) for v in values)
    height = 3.4 if line else max(2.0, 0.35 * len(values) + 1.2)
    figure, grid = sheet(1, len(names), width=4.8, height=height)
    for panel, name in zip(grid[0], names, strict=True):
        _along(panel, found, name) if line else _listed(panel, found, name)
    figure.suptitle(f"{title}: mean over inputs, 95 % interval", fontsize=10)
    save(figure, path)


def _bars(found: Comparison, name: str) -> tuple[Any, Any]:
    """Means (g,) and lengths of the intervals below and above them (2, g), 0 where there is none."""
    means = [group.metrics[name] for group in found.groups]
    middle = np.array([m.mean for m in means])
    low, high = (np.array([getattr(m, end) for m in means]) for end in ("low", "high"))
    return middle, np.nan_to_num(np.stack([middle - low, high - middle])).clip(0.0)


def _along(panel: Any, found: Comparison, name: str) -> None:
    middle, bars = _bars(found, name)
    x = np.array([float(group.values[0]) for group in found.groups])
    order = np.argsort(x)
    panel.errorbar(x[order], middle[order], bars[:, order], marker="o", capsize=3)
    panel.set(xlabel=found.by[0], ylabel=name)
    panel.grid(alpha=0.3)


def _listed(panel: Any, found: Comparison, name: str) -> None:
    middle, bars = _bars(found, name)
    rows = np.arange(len(middle))[::-1]
    panel.errorbar(middle, rows, xerr=bars, fmt="o", capsize=3)
    panel.set_yticks(rows, [label(group.values) for group in found.groups])
    panel.set_ylim(-0.6, len(rows) - 0.4)
    panel.set(xlabel=name, ylabel=", ".join(found.by))
    panel.grid(alpha=0.3, axis="x")
