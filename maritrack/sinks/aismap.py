"""A check of AIS as a Rerun recording: a chart of verdicts with names, the same on the map, and the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from maritrack.errors import InputError
from maritrack.geo import en_to_geodetic
from maritrack.sinks import captions, shapes
from maritrack.sinks.blueprint import zoom_for
from maritrack.sinks.shapes import picture
from maritrack.types import FloatArray, Origin

Colour = tuple[int, int, int]
COLOURS: dict[str, Colour] = {
    "confirmed": (96, 255, 120), "echo": (90, 190, 190), "displaced": (255, 150, 60), "unseen": (255, 80, 80),
    "undecided": (140, 140, 150), "track without AIS": (255, 96, 205), "leap": (240, 225, 70), "radar": (130, 150, 172),
    "track": (70, 120, 80),
}  # fmt: skip
WIDE = ("displaced", "unseen", "track without AIS", "leap")  # what is to be looked at


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A way (n, 2) or a place (1, 2) east-north, of one kind of COLOURS."""

    kind: str
    name: str
    way_m: FloatArray


def write_ais_map(
    path: Path, recording: str, drawn: Sequence[Shape], *, origin: Origin | None, centre_m: FloatArray, range_m: float,
    text: str,
) -> None:  # fmt: skip
    """The shapes as PATH, which gets its name when it is whole. Errors: InputError where it can't be written."""
    rec = rr.RecordingStream("maritrack", recording_id=recording, send_properties=False)
    rec.set_log_time_enabled(False)
    partial = path.with_name(path.name + ".partial")
    try:
        rec.save(partial)
    except (OSError, RuntimeError) as error:
        raise InputError(f"{path}: {error}") from None
    rec.send_recording_name(recording)
    grid, at, words = shapes.rings(centre_m, range_m)
    rec.log("chart/grid", rr.LineStrips2D(_strips(grid), colors=[captions.GRID_COLOUR], radii=-0.5), static=True)
    named = [i for i, word in enumerate(words) if word]
    rec.log(
        "chart/grid/label",
        rr.Points2D(picture(at[named]), labels=[words[i] for i in named], colors=[captions.GRID_TEXT], radii=-0.01),
        static=True,
    )
    for kind in COLOURS:
        some = [shape for shape in drawn if shape.kind == kind and len(shape.way_m)]
        if some:
            _log(rec, kind, some, origin)
    rec.log("report", rr.TextDocument(text, media_type="text/markdown"), static=True)
    rec.send_blueprint(_layout(origin, centre_m, range_m))
    rec.flush()
    rec.disconnect()
    partial.replace(path)


def _log(rec: rr.RecordingStream, kind: str, some: Sequence[Shape], origin: Origin | None) -> None:
    """Lines, and at the end of each its place with a name."""
    entity, colour, width = kind.replace(" ", "-"), [COLOURS[kind]], 2.5 if kind in WIDE else 1.2
    ends = np.stack([shape.way_m[-1] for shape in some])
    lines = [shape.way_m for shape in some if len(shape.way_m) > 1]
    strips = rr.LineStrips2D([picture(line) for line in lines], colors=colour, radii=-width)
    rec.log(f"chart/{entity}/way", strips, static=True)
    size = 0.5 if kind == "track" else 5.0 if kind in WIDE else 3.5
    labels = None if kind == "track" else [shape.name for shape in some]
    dots = rr.Points2D(picture(ends), colors=colour, radii=-size, labels=labels, show_labels=labels is not None)
    rec.log(f"chart/{entity}", dots, static=True)
    if origin is None:
        return
    lat, lon = en_to_geodetic(origin, ends)
    rec.log(f"geo/{entity}", rr.GeoPoints(lat_lon=np.stack([lat, lon], -1), colors=colour, radii=-size), static=True)
    ways = [np.stack(en_to_geodetic(origin, line), axis=-1) for line in lines]
    rec.log(f"geo/{entity}/way", rr.GeoLineStrings(lat_lon=ways, colors=colour, radii=-width), static=True)


def _strips(strips: shapes.Strips) -> list[NDArray[np.float32]]:
    return [picture(part) for part in np.split(strips.vertex, np.cumsum(strips.count)[:-1])]


def _layout(origin: Origin | None, centre_m: FloatArray, range_m: float) -> rrb.Blueprint:
    east, north = centre_m.tolist()
    bounds = rrb.VisualBounds2D(
        x_range=[east - range_m, east + range_m], y_range=[-north - range_m, -north + range_m]
    )  # fmt: skip
    chart = rrb.Spatial2DView(name="AIS checked by radar", origin="/chart", background=[5, 8, 13], visual_bounds=bounds)
    report = rrb.TextDocumentView(name="Report", origin="/report")
    right: list[rrb.View] = [report]
    if origin is not None:
        zoom = zoom_for(1.2 * range_m, origin.lat_deg)
        right.insert(0, rrb.MapView(name="Map", origin="/geo", zoom=zoom, background=rrb.MapProvider.OpenStreetMap))
    return rrb.Blueprint(
        rrb.Horizontal(chart, rrb.Vertical(*right), column_shares=[3, 2]), rrb.TimePanel(state="hidden"),
        rrb.SelectionPanel(state="collapsed"), rrb.BlueprintPanel(state="collapsed"), auto_views=False,
        auto_layout=False,
    )  # fmt: skip
