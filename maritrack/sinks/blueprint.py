"""How the viewer lays out a run: the situation at the left, map, plots, tracks and log at the right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from maritrack.sinks.view import Box

BACKGROUND = (5, 8, 13)
MAP_HEIGHT_PX = 210.0
MANY, FEW = ("points", "clusters", "tracks"), ("confirmed", "moving", "truth")


@dataclass(frozen=True, slots=True)
class Layout:
    """What there is to show."""

    bounds: Box
    map_m: float  # height of what the map shows
    latitude_deg: float | None = None  # None = no map
    distances: tuple[str, ...] = ()  # entity paths of scores in metres
    counted: tuple[str, ...] = ()  # of scores that count objects or tracks
    other_scores: tuple[str, ...] = ()


def blueprint(layout: Layout) -> rrb.Blueprint:
    """The default view of a run: all of it without a click."""
    plots: list[rrb.View | rrb.Container] = [
        rrb.Horizontal(
            _plot("Points, clusters, all tracks per scan", [f"metrics/counts/{w}" for w in MANY]),
            _plot("Tracks per scan", [f"metrics/counts/{w}" for w in FEW]),
        )
    ]
    if layout.distances:
        plots.append(_plot("Error against truth [m]", layout.distances))
    right: list[rrb.View | rrb.Container] = [
        *([_map(layout)] if layout.latitude_deg is not None else []),
        *plots,
        _details(layout),
    ]
    return rrb.Blueprint(
        rrb.Horizontal(_ppi(layout.bounds), rrb.Vertical(*right, row_shares=[1.0] * len(right)), column_shares=[3, 2]),
        rrb.TimePanel(timeline="time", state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def zoom_for(size_m: float, latitude_deg: float, *, height_px: float = MAP_HEIGHT_PX) -> float:
    """Zoom of a web map that shows `size_m` in this many pixels."""
    metres_per_px = max(size_m, 1.0) / height_px
    return float(np.clip(np.log2(156_543.03 * np.cos(np.radians(latitude_deg)) / metres_per_px), 1.0, 19.0))


def _ppi(bounds: Box) -> rrb.Spatial2DView:
    return rrb.Spatial2DView(
        name="PPI",
        origin="/ppi",
        contents=["+ /ppi/**"],
        background=list(BACKGROUND),
        visual_bounds=rrb.VisualBounds2D(x_range=[bounds.west, bounds.east], y_range=[-bounds.north, -bounds.south]),
    )


def _map(layout: Layout) -> rrb.MapView:
    assert layout.latitude_deg is not None
    return rrb.MapView(
        name="Map",
        origin="/geo",
        zoom=zoom_for(layout.map_m, layout.latitude_deg),
        background=rrb.MapProvider.OpenStreetMap,
    )


def _plot(name: str, paths: Sequence[str]) -> rrb.TimeSeriesView:
    always = rr.encodings.TimeRangeBoundary.infinite()
    return rrb.TimeSeriesView(
        name=name,
        origin="/metrics",
        contents=[f"+ /{path}" for path in paths],
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
        axis_x=rrb.TimeAxis(view_range=rr.encodings.TimeRange(start=always, end=always)),
    )


def _details(layout: Layout) -> rrb.Tabs:
    views: list[rrb.View] = [
        rrb.TextDocumentView(name="Tracks", origin="/tables/tracks"),
        rrb.TextLogView(name="Log", origin="/log", columns=rrb.TextLogColumns(timeline_columns=["scan"])),
        rrb.TextDocumentView(name="Legend and run", origin="/run"),
    ]
    if layout.distances and layout.counted:
        views.append(_plot("Missed and false [count]", layout.counted))
    if layout.other_scores:
        views.append(_plot("Other scores", layout.other_scores))
    views.append(_plot("CPU per scan [ms]", ["metrics/timing/**"]))
    return rrb.Tabs(*views, active_tab=0)
