"""Rows of some scans, sent to a Rerun recording as one chunk an entity and archetype."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain
from typing import Any

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import rerun as rr

from maritrack.sinks.drawing import Row
from maritrack.sinks.shapes import Strips

ARCHETYPES: dict[str, Any] = {
    archetype.__name__: archetype
    for archetype in (
        rr.Points2D, rr.LineStrips2D, rr.Arrows2D, rr.GeoPoints, rr.GeoLineStrings, rr.Scalars, rr.SeriesLines,
        rr.TextLog, rr.TextDocument, rr.AnyValues, rr.EncodedImage, rr.Transform3D,
    )
}  # fmt: skip
STRIPS_2D = rr.components.LineStrip2DBatch([]).as_arrow_array().type
STRIPS_GEO = rr.components.GeoLineStringBatch([]).as_arrow_array().type


class Batch:
    """Rows of some scans, by entity and archetype in order of first use."""

    def __init__(self) -> None:
        self._rows: dict[tuple[str, str], list[tuple[int, int, Mapping[str, Any]]]] = {}

    def add(self, row: Row, k: int, t_ns: int) -> None:
        """Put a row behind those of its kind."""
        self._rows.setdefault((row.entity, row.kind), []).append((k, t_ns, row.parts))

    def entities(self) -> list[str]:
        """Those with rows, in order of first use."""
        return list(dict.fromkeys(entity for entity, _ in self._rows))

    def send(self, rec: rr.RecordingStream) -> None:
        """One chunk per entity and archetype."""
        for (entity, kind), rows in self._rows.items():
            index = [
                rr.TimeColumn("scan", sequence=[k for k, _, _ in rows]),
                rr.TimeColumn("time", timestamp=np.array([t for _, t, _ in rows], np.int64).astype("datetime64[ns]")),
            ]
            lengths = [len(next(iter(parts.values()))) for _, _, parts in rows]
            joined = {name: _joined([parts[name] for _, _, parts in rows], kind) for name in rows[0][2]}
            rec.send_columns(entity, index, ARCHETYPES[kind].columns(**joined).partition(lengths))


def _joined(parts: list[Any], kind: str) -> Any:
    """The parts of many rows as one column's values."""
    if isinstance(parts[0], Strips):
        vertex = np.concatenate([p.vertex for p in parts])
        offset = np.concatenate([[0], np.cumsum(np.concatenate([p.count for p in parts]))])
        strips_type = STRIPS_GEO if kind == "GeoLineStrings" else STRIPS_2D
        flat = pa.array(vertex.ravel(), strips_type.value_type.value_type)
        pairs = pa.FixedSizeListArray.from_arrays(flat, type=strips_type.value_type)
        return pa.ListArray.from_arrays(pa.array(offset, pa.int32()), pairs, type=strips_type)
    if isinstance(parts[0], np.ndarray):
        values = np.concatenate(parts)
        return pa.array(values) if kind == "AnyValues" else values  # an Arrow array keeps its type when empty
    return list(chain.from_iterable(parts))
