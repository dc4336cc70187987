"""Curves over scans as a Rerun recording: panels of several lines each, laid out in columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from maritrack.errors import InputError
from maritrack.types import FloatArray

Colour = tuple[int, int, int]


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A number for each scan."""

    entity: str  # "far/polar/jipda/ospa"
    name: str  # in the legend
    colour: Colour
    values: FloatArray  # (scans,)


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """Curves in one plot."""

    title: str
    curves: tuple[Curve, ...]
    highest: float  # of the axis, which begins at 0


def write_curves(path: Path, recording: str, panels: Sequence[Panel], *, columns: int) -> None:
    """The panels as PATH, row by row. Errors: InputError where it can't be written."""
    rec = rr.RecordingStream("maritrack", recording_id=recording, send_properties=False)
    rec.set_log_time_enabled(False)
    try:
        rec.save(path)
    except (OSError, RuntimeError) as error:
        raise InputError(f"{path}: {error}") from None
    rec.send_recording_name(recording)
    for curve in (curve for panel in panels for curve in panel.curves):
        rec.log(curve.entity, rr.SeriesLines(colors=[curve.colour], names=[curve.name], widths=[1.5]), static=True)
        scans = rr.TimeColumn("scan", sequence=np.arange(len(curve.values)))
        rec.send_columns(curve.entity, [scans], rr.Scalars.columns(scalars=curve.values))
    views = [
        rrb.TimeSeriesView(
            name=panel.title, origin="/", contents=[f"/{curve.entity}" for curve in panel.curves],
            axis_y=rrb.ScalarAxis(range=(0.0, panel.highest), zoom_lock=True),
        )
        for panel in panels
    ]  # fmt: skip
    layout = rrb.Blueprint(
        rrb.Grid(*views, grid_columns=columns), rrb.TimePanel(timeline="scan", state="collapsed"),
        rrb.SelectionPanel(state="collapsed"), rrb.BlueprintPanel(state="collapsed"), auto_views=False,
        auto_layout=False,
    )  # fmt: skip
    rec.send_blueprint(layout)
    rec.flush()
    rec.disconnect()
