"""Tracks, points and clusters of an archive as CSV, tracks and their outlines as GeoJSON: for spreadsheets and maps.

Times are UNIX seconds, or seconds of day where the recording has no date. Orientation is clockwise
from North: 0..360 where the speed tells bow from stern, else 0..180. Unknown is empty.
"""

from __future__ import annotations

import itertools
import json
import os
import sys
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from maritrack.errors import InputError, UsageError
from maritrack.geo import en_to_geodetic
from maritrack.io.archive import ArchivedScan, iter_results, read_archive
from maritrack.outlines import Polygons
from maritrack.types import STATUS, Damage, FloatArray, IntArray, Origin

STDOUT = Path("-")
SPEED_MPS = 0.5  # from here on the velocity says which end is the bow
_SENSOR = "\0"  # stands for the sensor's name until unknown numbers are blanked

# A column and how its values are written. time_s takes two: seconds and nanoseconds.
_HEAD = (("scan", "%d"), ("time_s", "%d.%09d"), ("sensor", _SENSOR))
_LATLON = (("lat_deg", "%.8f"), ("lon_deg", "%.8f"))
_ELLIPSE = (("length_m", "%.3f"), ("width_m", "%.3f"), ("orientation_deg", "%.2f"))
_POLAR = (("range_m", "%.3f"), ("azimuth_deg", "%.5f"), ("east_m", "%.3f"), ("north_m", "%.3f"))
TRACKS = (
    *_HEAD, ("track_id", "%d"), ("status", "%s"), ("moving", "%d"), ("existence", "%.6f"), ("east_m", "%.3f"),
    ("north_m", "%.3f"), ("up_m", "%.3f"), ("vel_east_mps", "%.4f"), ("vel_north_mps", "%.4f"), *_ELLIPSE, *_LATLON,
)  # fmt: skip
POINTS = (*_HEAD, *_POLAR, ("intensity", "%.10g"), ("cluster", "%.0f"), *_LATLON)
CLUSTERS = (
    *_HEAD, ("cluster", "%d"), *_POLAR, ("count", "%d"), ("intensity", "%.10g"), *_ELLIPSE, *_LATLON,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Exported:
    """How many rows each output got, and what of the archive could not be read."""

    rows: Mapping[str, int]
    damage: tuple[Damage, ...]


def export(
    path: Path,
    *,
    tracks: Path | None = None,
    points: Path | None = None,
    clusters: Path | None = None,
    geojson: Path | None = None,
    outlines: Path | None = None,
    moving: bool = False,
) -> Exported:
    """Write what is asked for; "-" is the standard output. `moving`: only rows of tracks that move then.

    Outlines are polygons in degrees, or in a file that ends in .csv WKT in metres east and north. Points outside of any
    cluster have cluster -1, points that background subtraction removed none. UsageError where the call makes no sense,
    InputError where the archive lacks what is asked for.
    """
    targets = {"tracks": tracks, "points": points, "clusters": clusters, "geojson": geojson, "outlines": outlines}
    asked = {name: target for name, target in targets.items() if target is not None}
    if not asked:
        raise UsageError("nothing to export", "say --tracks, --points, --clusters, --geojson or --outlines FILE")
    if sum(target == STDOUT for target in asked.values()) > 1:
        raise UsageError("only one export can go to the standard output")
    archive = read_archive(path)
    origin = archive.manifest.origin
    if points is not None and not archive.points:
        raise UsageError(f"{path}: the run was archived without its points")
    table = outlines is not None and outlines.suffix.lower() == ".csv"
    if origin is None and (geojson is not None or (outlines is not None and not table)):
        raise UsageError(f"{path}: the run has no origin, so there is no latitude and longitude for GeoJSON")
    damage: list[Damage] = []
    with ExitStack() as stack:
        files = {name: stack.enter_context(_atomic(target)) for name, target in asked.items()}
        with np.errstate(all="ignore"):  # a number that leads nowhere becomes nan, and nan stays empty
            rows = _export(iter_results(path, on_damage=damage.append), files, origin, moving=moving, table=table)
    return Exported(rows, tuple(damage))


def _export(
    scans: Iterator[ArchivedScan], files: Mapping[str, TextIO], origin: Origin | None, *, moving: bool, table: bool
) -> dict[str, int]:
    """Write all rows; how many there were."""
    kinds: dict[str, tuple[Any, Callable[[ArchivedScan], list[Any]]]] = {
        "tracks": (TRACKS, lambda scan: _track_columns(scan, origin, moving=moving)),
        "points": (POINTS, lambda scan: _point_columns(scan, origin)),
        "clusters": (CLUSTERS, lambda scan: _cluster_columns(scan, origin)),
    }
    rows = dict.fromkeys(files, 0)
    lines: dict[int, _Line] = {}
    polygons = Polygons(files["outlines"], origin, table=table) if "outlines" in files else None
    for name, (kind, _) in kinds.items():
        if name in files:
            files[name].write(",".join(column for column, _ in kind) + "\n")
    for scan in scans:
        for name, file in files.items():
            if name == "geojson":
                _extend(lines, scan, origin, moving=moving)
            elif polygons is not None and name == "outlines":
                polygons.write(scan, moving=moving)
            else:
                columns = kinds[name][1](scan)
                rows[name] += len(columns[0])
                file.write(_csv(kinds[name][0], columns, scan.scan.sensor.id))
    if "geojson" in files:
        rows["geojson"] = len(lines)
        _write_lines(files["geojson"], lines)
    if polygons is not None:
        polygons.end()
        rows["outlines"] = polygons.count
    return rows


@contextmanager
def _atomic(path: Path) -> Iterator[TextIO]:
    """A text file that gets its name when all went well."""
    if path == STDOUT:
        yield sys.stdout
        sys.stdout.flush()
        return
    partial = path.with_name(path.name + ".partial")
    try:
        file = partial.open("w", encoding="utf-8", newline="\n")
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror or error}") from None
    try:
        with file:
            yield file
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def _csv(kind: Sequence[tuple[str, str]], columns: Sequence[Any], sensor: str) -> str:
    """Rows as text: one format for all of them at once. nan is left empty."""
    row = ",".join(form for _, form in kind) + "\n"
    values = tuple(itertools.chain.from_iterable(zip(*(column.tolist() for column in columns), strict=True)))
    text = (row * len(columns[0]) % values).replace(",nan", ",")
    quoted = sensor if sensor.replace("-", "").isalnum() else '"' + sensor.replace('"', '""') + '"'
    return text.replace(_SENSOR, quoted)


def _head(k: int, t_ns: IntArray) -> list[Any]:
    return [np.full(len(t_ns), k), t_ns // 10**9, t_ns % 10**9]


def _track_columns(scan: ArchivedScan, origin: Origin | None, *, moving: bool) -> list[Any]:
    tracks = scan.tracks
    length_m, width_m, orientation_deg = ellipse(tracks.extent_m2, tracks.velocity_mps)
    known = (tracks.status >= 0) & (tracks.status < len(STATUS))
    columns = [
        *_head(scan.k, tracks.t_ns), tracks.id, np.array([*STATUS, ""])[np.where(known, tracks.status, len(STATUS))],
        tracks.moving, tracks.existence, *tracks.position_m.T,
        np.full(len(tracks), np.nan) if tracks.up_m is None else tracks.up_m, *tracks.velocity_mps.T, length_m, width_m,
        orientation_deg, *_geodetic(origin, tracks.position_m),
    ]  # fmt: skip
    return [column[tracks.moving] for column in columns] if moving else columns


def _point_columns(scan: ArchivedScan, origin: Origin | None) -> list[Any]:
    points, keep = scan.points, scan.keep
    if points is None or keep is None:
        raise InputError(f"scan {scan.k} was archived without its points")
    cluster = np.full(len(points), np.nan)
    cluster[keep] = scan.clusters.label
    return [
        *_head(scan.k, points.t_ns), points.range_m, _degrees(points.azimuth_rad), *points.position_m.T,
        points.intensity, cluster, *_geodetic(origin, points.position_m),
    ]  # fmt: skip


def _cluster_columns(scan: ArchivedScan, origin: Origin | None) -> list[Any]:
    """The size is four standard deviations: the diameter of an ellipse that is filled evenly."""
    clusters = scan.clusters
    extent_m2 = 4.0 * clusters.scatter_m2 / np.maximum(clusters.count, 1)[:, None, None]
    return [
        *_head(scan.k, clusters.t_ns), np.arange(len(clusters)), clusters.range_m, _degrees(clusters.azimuth_rad),
        *clusters.mean_m.T, clusters.count, clusters.intensity, *ellipse(extent_m2, None),
        *_geodetic(origin, clusters.mean_m),
    ]  # fmt: skip


def ellipse(extent_m2: FloatArray, velocity_mps: FloatArray | None) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Length (n,), width (n,) and orientation in degrees (n,) of ellipses (n, 2, 2); nan where there is none."""
    ee, en, nn = extent_m2[:, 0, 0], extent_m2[:, 0, 1], extent_m2[:, 1, 1]
    mean, half = (ee + nn) / 2, np.hypot((ee - nn) / 2, en)
    is_ellipse = (mean + half > 0) & np.isfinite(mean + half)
    is_long = is_ellipse & (half > 1e-9 * mean)  # a circle has no orientation
    orientation_deg = 90.0 - np.degrees(np.arctan2(2.0 * en, ee - nn) / 2.0)
    length_m, width_m = (
        np.where(is_ellipse, 2.0 * np.sqrt(np.maximum(np.where(is_ellipse, axis_m2, 0.0), 0.0)), np.nan)
        for axis_m2 in (mean + half, mean - half)
    )
    period_deg = np.full(len(ee), 180.0)
    if velocity_mps is not None:
        bow = np.stack([np.sin(np.radians(orientation_deg)), np.cos(np.radians(orientation_deg))], axis=-1)
        fast = np.hypot(*velocity_mps.T) > SPEED_MPS
        orientation_deg += 180.0 * (fast & ((velocity_mps * bow).sum(axis=-1) < 0))
        period_deg[fast] = 360.0
    return length_m, width_m, np.where(is_long, np.round(orientation_deg, 2) % period_deg, np.nan)


def _degrees(azimuth_rad: FloatArray) -> FloatArray:
    return np.asarray(np.round(np.degrees(azimuth_rad), 5) % 360.0)


def _geodetic(origin: Origin | None, position_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    if origin is None or len(position_m) == 0:
        return np.full(len(position_m), np.nan), np.full(len(position_m), np.nan)
    return en_to_geodetic(origin, position_m)


@dataclass(slots=True)
class _Line:
    """A track on its way, and what was last known of it."""

    lon_lat_deg: array[float] = field(default_factory=lambda: array("d"))
    properties: dict[str, Any] = field(default_factory=dict)


def _extend(lines: dict[int, _Line], scan: ArchivedScan, origin: Origin | None, *, moving: bool) -> None:
    """Add a scan's tracks to the lines."""
    columns = dict(
        zip(
            ("scan", "s", "ns", *(n for n, form in TRACKS[3:] if form)),
            _track_columns(scan, origin, moving=moving),
            strict=True,
        )
    )
    for row in zip(*(column.tolist() for column in columns.values()), strict=True):
        now = dict(zip(columns, row, strict=True))
        if not np.isfinite(now["lat_deg"] + now["lon_deg"]):
            continue
        line = lines.setdefault(now["track_id"], _Line())
        line.lon_lat_deg.extend((round(now["lon_deg"], 8), round(now["lat_deg"], 8)))
        time_s = now["s"] + now["ns"] / 1e9
        line.properties = {
            "track_id": now["track_id"], "sensor": scan.scan.sensor.id, "status": now["status"],
            "moving": bool(now["moving"]) or line.properties.get("moving", False),
            "first_time_s": line.properties.get("first_time_s", time_s), "last_time_s": time_s,
            "length_m": _finite(now["length_m"]), "width_m": _finite(now["width_m"]),
        }  # fmt: skip


def _finite(value: float) -> float | None:
    return round(value, 3) if np.isfinite(value) else None


def _write_lines(file: TextIO, lines: Mapping[int, _Line]) -> None:
    """A FeatureCollection, a line per track; a track that was seen once is a point."""
    file.write('{"type": "FeatureCollection", "features": [')
    for i, (_, line) in enumerate(sorted(lines.items())):
        places = np.array(line.lon_lat_deg).reshape(-1, 2).tolist()
        geometry: dict[str, Any] = {"type": "LineString", "coordinates": places}
        if len(places) == 1:
            geometry = {"type": "Point", "coordinates": places[0]}
        feature = {"type": "Feature", "properties": line.properties, "geometry": geometry}
        file.write((",\n" if i else "\n") + json.dumps(feature))
    file.write("\n]}\n")
