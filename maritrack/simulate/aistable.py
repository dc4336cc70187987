"""What AIS would have told of a scene, as a table beside the recording: `maritrack.io.ais` reads it.

Only vessels that have it report: every 10 s below 14 knots, every 6 s below 23, else every 2, every 3.3 while they
turn, and every 3 minutes at rest. Positions, speeds and headings are rounded as the messages round them.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from maritrack.geo import en_to_geodetic, wrap
from maritrack.simulate.scenes import Scene
from maritrack.simulate.vessels import Course, Vessel
from maritrack.types import FloatArray, Origin

COLUMNS = (
    "time", "id", "name", "lat_deg", "lon_deg", "sog_knots", "cog_deg", "heading_deg", "length_m", "width_m",
)  # fmt: skip
SIDES = ("to_bow_m", "to_stern_m", "to_port_m", "to_starboard_m")  # where some antenna is not in the middle
KNOT_MPS = 1852.0 / 3600.0
REST_S, TURNING_S = 180.0, 10.0 / 3.0
GOLDEN = 0.618034  # spreads first reports over the interval
LEAST_DEG = 1.0 / 600_000.0  # 1/10000 of a minute


def ais_path(recording: Path) -> Path:
    """Where the AIS reports of a recording lie: rec.cat240 -> rec.ais.csv."""
    return recording.with_name(recording.stem + ".ais.csv")


def ais_table(scene: Scene, n_scans: int) -> str:
    """All reports during the recording, by time."""
    place = Origin(scene.lat_deg, scene.lon_deg)
    return reports_table(scene.vessel, place, scene.start_s, scene.radar.turn_s * n_scans)


def reports_table(vessels: Sequence[Vessel], origin: Origin, start_s: float, end_s: float) -> str:
    """All reports of vessels from the UNIX time start_s on, for end_s seconds, by time."""
    rows: list[tuple[float, list[str]]] = []
    telling = [v for v in vessels if v.ais]
    columns = (*COLUMNS, *SIDES) if any(any(v.antenna_m) for v in telling) else COLUMNS
    for i, vessel in enumerate(telling):
        first_s = (i * GOLDEN % 1.0) * 2.0
        rows += _rows(origin, start_s, vessel, report_times_s(vessel.course(), first_s, end_s))
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(row[: len(columns)] for _, row in sorted(rows))
    return text.getvalue()


def report_times_s(course: Course, first_s: float, end_s: float) -> FloatArray:
    """When a vessel reports, from its first report to the end."""
    times_s, t_s = [], first_s
    while t_s < end_s:
        times_s.append(t_s)
        t_s += _interval_s(course, t_s)
    return np.array(times_s)


def _interval_s(course: Course, t_s: float) -> float:
    """To the next report; a vessel that departs before it reports when it does."""
    now = course.at(np.array([t_s, t_s + TURNING_S]))
    knots = np.hypot(now.velocity_mps[0, 0], now.velocity_mps[0, 1]) / KNOT_MPS
    if knots < 0.2:
        until_s = course.depart_s - t_s if course.speed_mps > 0.0 else math.inf
        return float(min(REST_S, max(until_s, 0.0) + 2.0))
    if abs(wrap(np.diff(now.heading_rad))[0]) > 1e-3:
        return 2.0 if knots > 23.0 else TURNING_S
    return 10.0 if knots <= 14.0 else 6.0 if knots <= 23.0 else 2.0


def _rows(origin: Origin, start_s: float, vessel: Vessel, times_s: FloatArray) -> list[tuple[float, list[str]]]:
    state = vessel.course().at(times_s)
    ahead_m, starboard_m = vessel.antenna_m
    forward = np.stack([np.sin(state.heading_rad), np.cos(state.heading_rad)], axis=-1)
    antenna_m = state.position_m + ahead_m * forward + starboard_m * forward[:, ::-1] * [1.0, -1.0]
    place = en_to_geodetic(origin, antenna_m)
    lat_deg, lon_deg = (np.rint(np.asarray(angle) / LEAST_DEG) * LEAST_DEG for angle in place)
    speed_kn = np.hypot(state.velocity_mps[:, 0], state.velocity_mps[:, 1]) / KNOT_MPS
    heading_deg = np.degrees(state.heading_rad)
    rows = []
    for i, t_s in enumerate(times_s):
        at = datetime.fromtimestamp(start_s + round(float(t_s), 3), UTC)
        cog_deg = f"{round(float(heading_deg[i]), 1) % 360.0:.1f}"
        row = [
            at.isoformat(timespec="milliseconds").replace("+00:00", "Z"), vessel.id, vessel.name,
            f"{lat_deg[i]:.7f}", f"{lon_deg[i]:.7f}", f"{speed_kn[i]:.1f}", cog_deg,
            f"{round(float(heading_deg[i])) % 360}", f"{vessel.length_m:g}", f"{vessel.width_m:g}",
            f"{vessel.length_m / 2 - ahead_m:g}", f"{vessel.length_m / 2 + ahead_m:g}",
            f"{vessel.width_m / 2 + starboard_m:g}", f"{vessel.width_m / 2 - starboard_m:g}",
        ]  # fmt: skip
        rows.append((float(t_s), row))
    return rows
