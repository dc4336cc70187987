"""Scans and truth as `maritrack-points/1`: what simulators write and `io.pointjson` reads back."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from maritrack.errors import UsageError
from maritrack.io.mount import NOWHERE_ELSE, Mount, aboard
from maritrack.io.noise import en_cov_to_plot
from maritrack.io.pointdoc import DEG, FORMAT, FRAMES
from maritrack.io.reference import Reference
from maritrack.types import FloatArray, Origin, Points, Scan

SPARE = (",", ":")


def write_points(
    scans: Iterable[Scan],
    *,
    frame: str = "enu",
    origin: Origin | None = None,
    sensors: Mapping[str, Mapping[str, float]] | None = None,
    mounts: Mapping[str, Mount] | None = None,
    reference: Reference | None = None,
    lines: bool = False,
) -> bytes:
    """A document (or JSON Lines) of scans that have points, with the truth where there is one.

    `sensors` is the document's table; of a sensor in `mounts` the pose that is written is its platform's. A scan is
    written with its pose, and with covariances, labels and intensities where it has them. Times keep microseconds;
    all else is exact in "enu" and "enu3", rounded by the way through polar coordinates in "polar" and "polar3".
    Frames of three numbers are for points with elevation; their noise is for `sensors` to tell.
    """
    if frame not in FRAMES:
        raise UsageError(f"frame '{frame}' is not one of {', '.join(FRAMES)}")
    head: dict[str, Any] = {"format": FORMAT, "frame": frame}
    if origin is not None:
        head["origin"] = {"lat_deg": origin.lat_deg, "lon_deg": origin.lon_deg}
    if sensors:
        head["sensors"] = {key: dict(value) for key, value in sensors.items()}
    truth = [] if reference is None else list(truth_records(reference))
    rows = (scan_record(scan, frame=frame, mount=(mounts or {}).get(scan.sensor.id, NOWHERE_ELSE)) for scan in scans)
    if not lines:
        document = head | {"scans": list(rows)} | ({"truth": truth} if reference is not None else {})
        return _line(document)
    return b"".join([_line(head), *([_line({"truth": truth})] if truth else []), *map(_line, rows)])


def scan_record(scan: Scan, *, frame: str, mount: Mount = NOWHERE_ELSE) -> dict[str, Any]:
    """One entry of "scans"; the pose is that of the platform on which the sensor is mounted."""
    points = scan.points
    if points is None:
        raise UsageError("a scan of video has no points to write")
    at_m = 2.0 * scan.position_m - aboard(scan.position_m, scan.heading_rad, mount) if mount.offset else scan.position_m
    pose = {"east_m": float(at_m[0]), "north_m": float(at_m[1])}
    if np.isfinite(scan.heading_rad):
        pose["heading_deg"] = float(np.rad2deg(scan.heading_rad))
    record: dict[str, Any] = {"time_s": scan.t_ns / 1e9, "sensor": scan.sensor.id, "pose": pose}
    record["points"] = _columns(points, frame=frame).tolist()
    if points.cov_m2 is not None and not frame.endswith("3"):
        record["cov"] = _cov(points, points.cov_m2, frame=frame).tolist()
    if points.truth_label is not None:
        record["labels"] = points.truth_label.tolist()
    return record


def truth_records(reference: Reference) -> Iterator[dict[str, Any]]:
    """Entries of "truth", ship by ship; what is not known is left out."""
    velocity, heading = reference.velocity_mps, np.rad2deg(reference.heading_rad)
    unknown = np.full(len(reference.t_ns), np.nan)
    up = unknown if reference.up_m is None else reference.up_m
    vel_up = unknown if reference.vel_up_mps is None else reference.vel_up_mps
    for i, key in enumerate(reference.ids):
        size = {"length_m": reference.length_m[i], "width_m": reference.width_m[i]}
        for row in range(int(reference.start[i]), int(reference.start[i + 1])):
            told = {
                "vel_east_mps": velocity[row, 0], "vel_north_mps": velocity[row, 1], "heading_deg": heading[row],
                "up_m": up[row], "vel_up_mps": vel_up[row],
            } | size  # fmt: skip
            yield {
                "id": key,
                **({"name": reference.names[i]} if reference.names[i] else {}),
                "time_s": int(reference.t_ns[row]) / 1e9,
                "east_m": float(reference.position_m[row, 0]),
                "north_m": float(reference.position_m[row, 1]),
                **{name: float(value) for name, value in told.items() if np.isfinite(value)},
            }


def _columns(points: Points, *, frame: str) -> FloatArray:
    place = points.position_m
    if frame.startswith("polar"):
        place = np.stack([points.range_m, points.azimuth_rad / DEG], axis=-1)
    if frame.endswith("3"):
        third = points.up_m if frame == "enu3" else points.elevation_rad
        if third is None:
            raise UsageError(f"frame '{frame}': the points have no elevation")
        place = np.column_stack([place, third if frame == "enu3" else third / DEG])
    plain = bool(np.all(points.intensity == 1.0))
    return place if plain else np.column_stack([place, points.intensity])


def _cov(points: Points, cov_m2: FloatArray, *, frame: str) -> FloatArray:
    if frame == "polar":
        return np.asarray(en_cov_to_plot(points.range_m, points.azimuth_rad, cov_m2) / [1.0, DEG, DEG**2])
    return cov_m2[:, [0, 0, 1], [0, 1, 1]]


def _line(value: Mapping[str, Any]) -> bytes:
    return json.dumps(value, separators=SPARE, allow_nan=False, ensure_ascii=False).encode() + b"\n"
