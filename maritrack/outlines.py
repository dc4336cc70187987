"""What tracks draw, contours and hulls or ellipses, as polygons for maps (GeoJSON) and tables (WKT in metres)."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any, TextIO

import numpy as np

from maritrack.geo import en_to_geodetic
from maritrack.io.archive import ArchivedScan
from maritrack.metrics.iou import has_shape, shape
from maritrack.types import STATUS, FloatArray, Origin, Tracks

COLUMNS = "scan,time_s,sensor,track_id,status,moving,kind,area_m2,outline"
CORNERS = 3  # at least, or there is no area


class Polygons:
    """A file of outlines on its way: `write` a scan after the other, then `end`."""

    def __init__(self, file: TextIO, origin: Origin | None, *, table: bool) -> None:
        self._file, self._origin, self._table = file, origin, table
        self.count = 0
        file.write(COLUMNS + "\n" if table else '{"type": "FeatureCollection", "features": [')

    def write(self, scan: ArchivedScan, *, moving: bool) -> None:
        """The outlines of a scan's tracks, or of those that move."""
        for row, ring in rings(scan.tracks, moving=moving):
            tracks = scan.tracks
            second, nano = divmod(int(tracks.t_ns[row]), 10**9)
            status = STATUS[tracks.status[row]] if 0 <= tracks.status[row] < len(STATUS) else ""
            kind = "contour" if tracks.contour_m else "ellipse"
            if self._table:
                corners = ", ".join(f"{east:.3f} {north:.3f}" for east, north in ring.tolist())
                name = '"' + scan.scan.sensor.id.replace('"', '""') + '"'
                self._file.write(
                    f"{scan.k},{second}.{nano:09d},{name},{tracks.id[row]},{status},{int(tracks.moving[row])},{kind},"
                    f'{area_m2(ring):.3f},"POLYGON (({corners}))"\n'
                )
            else:
                self._file.write((",\n" if self.count else "\n") + json.dumps({
                    "type": "Feature",
                    "properties": {
                        "scan": scan.k, "time_s": second + nano / 1e9, "sensor": scan.scan.sensor.id,
                        "track_id": int(tracks.id[row]), "status": status, "moving": bool(tracks.moving[row]),
                        "kind": kind, "area_m2": round(area_m2(ring), 3),
                    },
                    "geometry": {"type": "Polygon", "coordinates": [_degrees(self._origin, ring)]},
                }))  # fmt: skip
            self.count += 1

    def end(self) -> None:
        """What closes the file."""
        if not self._table:
            self._file.write("\n]}\n")


def rings(tracks: Tracks, *, moving: bool) -> Iterator[tuple[int, FloatArray]]:
    """Row and closed outline (v + 1, 2) of each track that has one, counter-clockwise."""
    drawn = has_shape(tracks) & (tracks.moving | (not moving))
    for row in np.flatnonzero(drawn).tolist():
        corners = shape(tracks, row)
        if len(corners) >= CORNERS and np.isfinite(corners).all():
            yield row, np.concatenate([corners, corners[:1]]) if _signed(corners) >= 0 else _turned(corners)


def _turned(corners: FloatArray) -> FloatArray:
    return np.concatenate([corners, corners[:1]])[::-1]


def area_m2(ring: FloatArray) -> float:
    """Area within a ring."""
    return abs(_signed(ring))


def _signed(corners: FloatArray) -> float:
    """Area by the shoelace formula, positive for counter-clockwise."""
    offset = corners - corners.mean(axis=0)
    x, y = offset.T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _degrees(origin: Origin | None, ring: FloatArray) -> Any:
    if origin is None:
        raise ValueError("no origin")
    lat_deg, lon_deg = en_to_geodetic(origin, ring)
    return np.round(np.stack([lon_deg, lat_deg], axis=-1), 8).tolist()
