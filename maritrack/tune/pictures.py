"""Pictures of studies as PNG, drawn without a display, and their grids as CSV."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from maritrack.errors import InputError
from maritrack.tune.clustering import Study, choose
from maritrack.tune.subjects import DOMAINS
from maritrack.tune.tracking import TRACKER, Row
from maritrack.types import FloatArray

NAMES = {"polar-dbscan": "polar", "cartesian-dbscan": "Cartesian"}
DOTS_PER_INCH = 110
MOST_NUMBERS = 400  # cells of a panel that have their number written in


def draw_clustering(path: Path, of: Study, *, title: str) -> None:
    """Heat maps of ARI and count difference over eps and min_points, the domains side by side, the choice framed."""
    figure, panels = sheet(2, len(DOMAINS), width=1.6 + 0.36 * len(of.eps_m), height=1.3 + 0.3 * len(of.min_points))
    ari_low = min(math.floor(10.0 * float(of.ari.min())) / 10.0, 0.9)
    most = max(float(of.count_difference.max()), 1.0)
    for d, domain in enumerate(DOMAINS):
        chosen = choose(of, d)
        at = f"{of.eps_m[chosen[0]]:g} m, {of.min_points[chosen[1]]} points"
        for panel, values, name, colours, limits in (
            (panels[0][d], of.ari[d], "adjusted Rand index", "viridis", (ari_low, 1.0)),
            (panels[1][d], of.count_difference[d], "|clusters - objects| a scan", "viridis_r", (0.0, most)),
        ):
            _heat(panel, values.T, of.eps_m, of.min_points, colours=colours, limits=limits, decimals=2)
            panel.set(xlabel="eps [m]", ylabel="min_points", title=f"{NAMES[domain]}: {name}; framed: {at}")
            _frame(panel, *chosen)
    figure.suptitle(title)
    save(figure, path)


def draw_tracking(path: Path, rows: Sequence[Row], axes: Mapping[str, Sequence[Any]], *, by: str, title: str) -> bool:
    """The metric over one key (lines) or two (heat maps), a line or a panel for each tracker; whether it was drawn.

    More keys have no picture.
    """
    keys = [key for key in axes if key != TRACKER]
    if len(keys) not in (1, 2):
        return False
    trackers = axes.get(TRACKER, ("",))
    found = np.full((len(trackers), *(len(axes[key]) for key in keys)), np.nan)
    for row in rows:
        place = [_index(axes[key], row.values[key]) for key in keys]
        found[(_index(trackers, row.values.get(TRACKER, "")), *place)] = row.metrics.get(by, math.nan)
    if len(keys) == 1:
        _draw_lines(path, found, trackers, keys[0], axes[keys[0]], by=by, title=title)
    else:
        _draw_maps(path, found, trackers, keys, axes, by=by, title=title)
    return True


def _index(values: Sequence[Any], value: Any) -> int:
    return next(i for i, other in enumerate(values) if repr(other) == repr(value))


def _draw_lines(
    path: Path, found: FloatArray, trackers: Sequence[Any], key: str, values: Sequence[Any], *, by: str, title: str
) -> None:
    figure, panels = sheet(1, 1, width=7.0, height=4.2)
    panel = panels[0][0]
    numbers = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values)
    x = np.array(values, float) if numbers else np.arange(len(values), dtype=float)
    order = np.argsort(x)
    for line, tracker in zip(found, trackers, strict=True):
        panel.plot(x[order], line[order], marker="o", label=str(tracker) or None)
    if not numbers:
        panel.set_xticks(x, [str(value) for value in values])
    if len(trackers) > 1:
        panel.legend()
    panel.set(xlabel=key, ylabel=_unit(by), title=title)
    panel.grid(alpha=0.3)
    save(figure, path)


def _draw_maps(
    path: Path, found: FloatArray, trackers: Sequence[Any], keys: Sequence[str], axes: Mapping[str, Sequence[Any]], *,
    by: str, title: str,
) -> None:  # fmt: skip
    across, up = (axes[key] for key in keys)
    width, height = max(4.6, 2.0 + 0.7 * len(across)), max(3.2, 1.6 + 0.45 * len(up))
    figure, panels = sheet(1, len(trackers), width=width, height=height)
    known = found[np.isfinite(found)]
    limits = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    for panel, values, tracker in zip(panels[0], found, trackers, strict=True):
        _heat(panel, values.T, across, up, colours="viridis_r", limits=limits, decimals=1)
        panel.set(xlabel=keys[0], ylabel=keys[1], title=f"{tracker} {_unit(by)}".strip())
        if np.isfinite(values).any():
            _frame(panel, *divmod(int(np.nanargmin(values)), values.shape[1]))
    figure.suptitle(title)
    save(figure, path)


def _unit(metric: str) -> str:
    units = {"gospa": "m", "ospa": "m", "ospa_localisation": "m", "ospa_cardinality": "m", "gospa_localisation": "m^p"}
    return f"{metric} [{units[metric]}]" if metric in units else metric


def sheet(rows: int, columns: int, *, width: float, height: float) -> tuple[Any, Any]:
    """A figure without a display and its panels [row][column]; inches of one panel."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width * columns, height * rows + 0.5), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def _heat(
    panel: Any, values: FloatArray, across: Sequence[Any], up: Sequence[Any], *, colours: str,
    limits: tuple[float, float], decimals: int,
) -> None:  # fmt: skip
    """Values (up, across) as colours, with their numbers where there is room."""
    shown = panel.imshow(values, origin="lower", aspect="auto", cmap=colours, vmin=limits[0], vmax=limits[1])
    panel.figure.colorbar(shown, ax=panel, fraction=0.04)
    panel.set_xticks(range(len(across)), [_label(value) for value in across], rotation=45 if len(across) > 12 else 0)
    panel.set_yticks(range(len(up)), [_label(value) for value in up])
    if values.size > MOST_NUMBERS:
        return
    for (row, column), value in np.ndenumerate(values):
        text = "failed" if math.isnan(value) else f"{value:.{decimals}f}"
        dark = not math.isnan(value) and sum(shown.cmap(shown.norm(value))[:3]) < 1.5
        panel.text(column, row, text, ha="center", va="center", fontsize=6.5, color="white" if dark else "black")


def _label(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _frame(panel: Any, column: int, row: int) -> None:
    from matplotlib.patches import Rectangle

    panel.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, fill=False, edgecolor="red", linewidth=2, clip_on=False))


def save(figure: Any, path: Path) -> None:
    """Write a PNG; equal studies give equal octets."""
    octets = io.BytesIO()
    figure.savefig(octets, format="png", dpi=DOTS_PER_INCH, metadata={"Software": None})
    _write(path, octets.getvalue())


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Rows with the columns of all of them, in the order in which they first occur."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, names, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    _write(path, text.getvalue().encode())


def _write(path: Path, octets: bytes) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(octets)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
