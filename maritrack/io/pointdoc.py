"""The parts of a `maritrack-points/1` document: header, scans, truth.

`{"format", "frame", "origin"?, "sensors"?, "scans": [...], "truth"?: [...]}`:

- "enu": points are [east_m, north_m(, intensity)] about the origin, covariances in m^2;
- "polar": points are [range_m, azimuth_deg(, intensity)] from the sensor, covariances
  [m^2, m deg, deg^2];
- "enu3" and "polar3" have a third number, up_m or elevation_deg, before the intensity, and no covariances; ranges are
  slant ranges.

A scan's pose is where its sensor was; without one the sensor's own entry says so, else the origin. Of a sensor whose
entry has `forward_m`, `starboard_m` or `turn_deg` the pose, or the place in the entry, is that of the platform that
carries it, with others perhaps: the sensor is that far ahead and to starboard, and its azimuths, where they are
relative to the bow, are turned by that much clockwise.
Noise is, in this order: the scan's `cov`, the sigmas of the sensor's entry, those of the settings
(`io.noise.point_noise`); without any of them the points have none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from maritrack.errors import InputError
from maritrack.io.jsontext import MAX_M, clean, naming, number_of, table_of
from maritrack.io.mount import NOWHERE_ELSE, Mount, aboard
from maritrack.io.noise import plot_cov_to_en, usable_cov
from maritrack.io.pointrows import cov_rows, point_rows, truth_labels
from maritrack.io.pointscan import Measured, instant, measured_at, measured_in_space, point_sensor, to_points
from maritrack.io.reference import Reference, Reports, build_reference
from maritrack.io.times import MAX_S, seconds_to_ns
from maritrack.settings import InputConfig
from maritrack.types import BoolArray, Damage, FloatArray, IntArray, Origin, Scan

FORMAT = "maritrack-points/1"
FRAMES = ("enu", "polar", "enu3", "polar3")
SIGMAS = ("sigma_range_m", "sigma_azimuth_deg", "sigma_elevation_deg", "sigma_m")
DEG = np.deg2rad(1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """What the table of sensors says of one, or what holds without an entry."""

    position_m: FloatArray  # (2,)
    config: InputConfig  # with this sensor's sigmas
    up_m: float = 0.0
    mount: Mount = NOWHERE_ELSE


@dataclass(frozen=True, slots=True, eq=False)
class Header:
    """What a document says of all its scans."""

    frame: str  # of FRAMES
    origin: Origin | None
    sensors: Mapping[str, Entry]
    config: InputConfig
    own: Mapping[str, InputConfig]  # of single sensors, in place of that

    @property
    def polar(self) -> bool:
        return self.frame.startswith("polar")

    @property
    def axes(self) -> int:
        return 3 if self.frame.endswith("3") else 2


def header_of(document: Any, *, config: InputConfig, own: Mapping[str, InputConfig] | None = None) -> Header:
    """The checked header of a document, or of the first line of JSON Lines; `own` are settings of single sensors."""
    own = own or {}
    table = table_of(document, where="document")
    if table.get("format") != FORMAT:
        raise InputError(f'"format" is {clean(table.get("format"))!r}, not "{FORMAT}"')
    frame = table.get("frame", "enu")
    if frame not in FRAMES:
        raise InputError(f'"frame" is {clean(frame)!r}, not one of {", ".join(FRAMES)}')
    sensors = table_of(table.get("sensors") or {}, where="sensors")
    entries = {
        (name := _sensor_id(key, where="sensors")): _entry(
            value, where=f"sensors.{clean(key)}", config=own.get(name, config)
        )
        for key, value in sensors.items()
    }
    return Header(frame, _origin(table.get("origin")), entries, config, own)


def scan_of(value: Any, header: Header, *, where: str) -> tuple[Scan, tuple[Damage, ...]]:
    """One scan, and what was left out of it. InputError where it is none."""
    table = table_of(value, where=where)
    t_ns = int(seconds_to_ns(np.array(number_of(table, "time_s", where=where, limit=MAX_S))))
    only = next(iter(header.sensors)) if len(header.sensors) == 1 else "radar"
    sensor = only if table.get("sensor") is None else _sensor_id(table["sensor"], where=where)
    entry = header.sensors.get(sensor, Entry(np.zeros(2), header.own.get(sensor, header.config)))
    platform_m, heading_rad = _pose(table.get("pose"), entry, where=where)
    with naming(where):
        position_m = aboard(platform_m, heading_rad, entry.mount)
    rows = point_rows(table.get("points"), axes=header.axes, where=f"{where}: points")
    if header.axes == 3 and table.get("cov") is not None:
        raise InputError(f"{where}: points of 3-D have no 'cov': say sigmas of the sensor")
    cov, label = (
        cov_rows(table.get("cov"), len(rows), where=where),
        truth_labels(table.get("labels"), len(rows), where=where),
    )
    good = _usable(rows, cov, polar=header.polar)
    measured = _measured(
        rows[good],
        None if cov is None else cov[good],
        None if label is None else label[good],
        header=header,
        sensor_m=position_m,
        sensor_up_m=entry.up_m,
        t_ns=t_ns,
    )
    points = to_points(
        measured,
        sensor_m=position_m,
        sensor_up_m=entry.up_m,
        heading_rad=heading_rad,
        config=entry.config,
        where=where,
        head_up=header.polar,
        mount_rad=entry.mount.turn_rad,
    )
    scan = instant(
        point_sensor(sensor, header.config), points, t_ns=t_ns, sensor_m=position_m, heading_rad=heading_rad,
        up_m=entry.up_m,
    )  # fmt: skip
    bad = len(rows) - int(np.sum(good))
    lost = Damage("bad-point", -1, f"{where}: points of {len(rows)} that are no places", sensor, count=bad)
    return scan, (lost,) if bad else ()


def fixed_origin(config: InputConfig) -> Origin | None:
    """The place that the settings give."""
    known = np.isfinite(config.lat_deg) and np.isfinite(config.lon_deg)
    return Origin(config.lat_deg, config.lon_deg) if known else None


def truth_of(records: list[Any], *, where: str = "truth", damage: tuple[Damage, ...] = ()) -> Reference:
    """The reference that the records of `truth` make, complete."""
    ids: dict[str, int] = {}
    names: dict[int, str] = {}
    ship, values = [], []
    for i, record in enumerate(records):
        place = f"{where}[{i}]"
        table = table_of(record, where=place)
        if type(table.get("id")) not in (str, int):
            raise InputError(f"{place}: 'id' is a text or a number")
        ship.append(ids.setdefault(clean(table["id"]), len(ids)))
        values.append(_truth_numbers(table, where=place))
        names[ship[-1]] = names.get(ship[-1]) or clean(table.get("name") or "")
    rows = np.array(values, dtype=np.float64).reshape(-1, 10)
    of_ship = np.array(ship, dtype=np.int64)
    heights = len(rows) > 0 and bool(np.isfinite(rows[:, 8]).all())
    return build_reference(
        Reports(
            ship=of_ship,
            t_ns=seconds_to_ns(rows[:, 0]),
            position_m=rows[:, 1:3],
            velocity_mps=rows[:, 3:5],
            heading_rad=np.deg2rad(rows[:, 5]),
            up_m=rows[:, 8] if heights else None,
            vel_up_mps=rows[:, 9] if heights else None,
        ),
        ids=list(ids),
        names=[names[i] for i in range(len(ids))],
        length_m=_first_known(of_ship, rows[:, 6], len(ids)),
        width_m=_first_known(of_ship, rows[:, 7], len(ids)),
        complete=True,
        damage=damage,
    )


def _usable(rows: FloatArray, cov: FloatArray | None, *, polar: bool) -> BoolArray:
    limit = np.append(np.full(rows.shape[1] - 1, MAX_M), 1e12)
    good = np.all(np.abs(np.nan_to_num(rows, nan=np.inf)) <= limit, axis=1)
    if polar:
        good &= rows[:, 0] >= 0
        good &= np.abs(rows[:, 2]) <= 90.0 if rows.shape[1] == 4 else True
    return np.asarray(good if cov is None else good & usable_cov(cov))


def _measured(
    rows: FloatArray,
    cov: FloatArray | None,
    label: IntArray | None,
    *,
    header: Header,
    sensor_m: FloatArray,
    sensor_up_m: float,
    t_ns: int,
) -> Measured:
    if header.axes == 3 and not header.polar:
        return measured_in_space(
            rows[:, :3], sensor_m=sensor_m, sensor_up_m=sensor_up_m, t_ns=t_ns, intensity=rows[:, 3], truth_label=label
        )
    if not header.polar:
        matrix = None if cov is None else cov[:, [[0, 1], [1, 2]]]
        return measured_at(
            rows[:, :2], sensor_m=sensor_m, t_ns=t_ns, intensity=rows[:, 2], cov_m2=matrix, truth_label=label
        )
    range_m, azimuth_rad = rows[:, 0], rows[:, 1] * DEG
    matrix = None if cov is None else plot_cov_to_en(range_m, azimuth_rad, cov * [1.0, DEG, DEG**2])
    times = np.full(len(rows), t_ns, dtype=np.int64)
    elevation_rad = rows[:, 2] * DEG if header.axes == 3 else None
    return Measured(range_m, azimuth_rad, times, rows[:, -1], matrix, label, elevation_rad=elevation_rad)


def _pose(value: Any, entry: Entry, *, where: str) -> tuple[FloatArray, float]:
    if value is None:
        return entry.position_m, float("nan")
    table = table_of(value, where=f"{where}: pose")
    position = [number_of(table, key, where=f"{where}: pose", limit=MAX_M) for key in ("east_m", "north_m")]
    heading = number_of(table, "heading_deg", where=f"{where}: pose", default=np.nan, limit=1e6)
    return np.array(position), float(np.deg2rad(heading))


def _entry(value: Any, *, where: str, config: InputConfig) -> Entry:
    table = table_of(value, where=where)
    position = [number_of(table, key, where=where, default=0.0, limit=MAX_M) for key in ("east_m", "north_m")]
    sigmas = {key: number_of(table, key, where=where, default=0.0, limit=1e6) for key in SIGMAS}
    if min(sigmas.values()) < 0:
        raise InputError(f"{where}: a sigma is negative")
    if max(sigmas.values()) > 0:
        config = replace(
            config,
            sigma_range_m=sigmas["sigma_range_m"],
            sigma_azimuth_deg=sigmas["sigma_azimuth_deg"],
            sigma_elevation_deg=sigmas["sigma_elevation_deg"],
            sigma_m=sigmas["sigma_m"],
        )
    up_m = number_of(table, "up_m", where=where, default=0.0, limit=MAX_M)
    forward_m, starboard_m = (
        number_of(table, key, where=where, default=0.0, limit=1e4) for key in ("forward_m", "starboard_m")
    )
    turn_deg = number_of(table, "turn_deg", where=where, default=0.0, limit=360.0)
    return Entry(np.array(position), config, up_m, Mount(forward_m, starboard_m, float(np.deg2rad(turn_deg))))


def _origin(value: Any) -> Origin | None:
    if value is None:
        return None
    table = table_of(value, where="origin")
    return Origin(
        number_of(table, "lat_deg", where="origin", limit=90.0),
        number_of(table, "lon_deg", where="origin", limit=180.0),
    )


def _truth_numbers(table: Mapping[str, Any], *, where: str) -> list[float]:
    """Time, place, velocity, heading, length and width, up and its velocity; nan where they are not told."""
    known = [number_of(table, "time_s", where=where, limit=MAX_S)]
    known += [number_of(table, key, where=where, limit=MAX_M) for key in ("east_m", "north_m")]
    optional = ("vel_east_mps", "vel_north_mps", "heading_deg", "length_m", "width_m", "up_m", "vel_up_mps")
    return known + [number_of(table, key, where=where, default=np.nan, limit=1e6) for key in optional]


def _first_known(ship: IntArray, value: FloatArray, n: int) -> FloatArray:
    """For each of n ships the first positive value (n,), nan where there is none."""
    known = value > 0
    first = np.full(n, np.nan)
    ships, rows = np.unique(ship[known], return_index=True)
    first[ships] = value[known][rows]
    return first


def _sensor_id(value: Any, *, where: str) -> str:
    """An id that can be part of a path."""
    if type(value) not in (str, int):
        raise InputError(f"{where}: the id of a sensor is a text")
    return clean(value).replace("/", "-") or "radar"
