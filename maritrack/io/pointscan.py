"""From measured range and azimuth to the points of a scan, the same way for every point input."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maritrack.errors import InputError
from maritrack.geo import en_to_polar, polar_to_en, wrap_positive
from maritrack.io.noise import noise_in_space, point_noise, turn_cov
from maritrack.settings import InputConfig
from maritrack.types import BoolArray, FloatArray, IntArray, Points, Scan, Sensor, check_lengths, take


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """What an input says of the points of a scan, before the settings are applied."""

    range_m: FloatArray  # (n,)
    azimuth_rad: FloatArray  # (n,)
    t_ns: IntArray  # (n,) as stamped
    intensity: FloatArray  # (n,)
    cov_m2: FloatArray | None = None  # (n, 2, 2) east-north
    truth_label: IntArray | None = None  # (n,)
    position_m: FloatArray | None = None  # (n, 2) where the input tells it, east-north
    elevation_rad: FloatArray | None = None  # (n,) in 3-D, where range is the slant range
    up_m: FloatArray | None = None  # (n,) in 3-D, where the input tells it

    def __post_init__(self) -> None:
        names = ("azimuth_rad", "t_ns", "intensity", "cov_m2", "truth_label", "position_m", "elevation_rad", "up_m")
        check_lengths(self, len(self.range_m), *names)


def measured_at(
    position_m: FloatArray,
    *,
    sensor_m: FloatArray,
    t_ns: int,
    intensity: FloatArray | None = None,
    cov_m2: FloatArray | None = None,
    truth_label: IntArray | None = None,
) -> Measured:
    """Points at east-north positions (n, 2), seen from a sensor at (2,), all at one time."""
    range_m, azimuth_rad = en_to_polar(position_m - sensor_m)
    n = len(position_m)
    times, ones = np.full(n, t_ns, dtype=np.int64), np.ones(n)
    intensity = ones if intensity is None else intensity
    return Measured(range_m, azimuth_rad, times, intensity, cov_m2, truth_label, position_m)


def measured_in_space(
    position_m: FloatArray,
    *,
    sensor_m: FloatArray,
    sensor_up_m: float,
    t_ns: int,
    intensity: FloatArray,
    truth_label: IntArray | None = None,
) -> Measured:
    """Points at east-north-up positions (n, 3), seen from a sensor at (2,) and its height, all at one time."""
    level_m, azimuth_rad = en_to_polar(position_m[:, :2] - sensor_m)
    above_m = position_m[:, 2] - sensor_up_m
    times = np.full(len(position_m), t_ns, dtype=np.int64)
    return Measured(
        np.hypot(level_m, above_m), azimuth_rad, times, intensity, None, truth_label, position_m[:, :2],
        np.arctan2(above_m, level_m), position_m[:, 2],
    )  # fmt: skip


def to_points(
    measured: Measured,
    *,
    sensor_m: FloatArray,
    sensor_up_m: float = 0.0,
    heading_rad: float | FloatArray,
    config: InputConfig,
    where: str,
    head_up: bool,
    mount_rad: float = 0.0,
) -> Points:
    """Points with offsets, heading (where azimuths are relative to it), latency, noise and region of interest applied.

    `sensor_m` is (2,) or (n, 2), `heading_rad` one or (n,). Points outside of roi_min..roi_max are
    left out. `mount_rad` is how the sensor is turned from the bow, for azimuths relative to it.
    `where` is for the error that head-up azimuths lack a heading. In 3-D ranges are slant ranges, and
    the noise of range, azimuth and elevation is that of the settings, where they have one of elevation.
    """
    turn: float | FloatArray = np.deg2rad(config.azimuth_offset_deg)
    if head_up and config.stabilised == "head":
        if np.any(np.isnan(heading_rad)):
            raise InputError(f"{where}: azimuths relative to the bow, but no heading", hint="input.stabilised = north")
        turn = turn + heading_rad + mount_rad
    as_told = config.range_offset_m == 0.0 and not np.any(turn)
    told = measured.position_m if as_told else None
    range_m = measured.range_m + config.range_offset_m
    elevation = measured.elevation_rad
    level_m = range_m if elevation is None else range_m * np.cos(elevation)
    azimuth_rad = wrap_positive(measured.azimuth_rad + turn)
    cov = measured.cov_m2
    if cov is None:
        cov = point_noise(level_m, azimuth_rad, config)
    elif np.any(turn):
        cov = turn_cov(cov, turn)
    nothing = np.zeros(len(range_m))
    points = Points(
        range_m=range_m,
        azimuth_rad=azimuth_rad,
        position_m=sensor_m + polar_to_en(level_m, azimuth_rad) if told is None else told,
        intensity=measured.intensity,
        t_ns=measured.t_ns - round(config.latency_s * 1e9),
        range_width_m=nothing,
        azimuth_width_rad=nothing,
        cov_m2=cov,
        truth_label=measured.truth_label,
        elevation_rad=elevation,
        up_m=_heights(measured, range_m, sensor_up_m, as_told=as_told),
        noise=None if elevation is None else noise_in_space(range_m, config),
    )
    return take(points, _of_interest(range_m, config))


def _heights(measured: Measured, range_m: FloatArray, sensor_up_m: float, *, as_told: bool) -> FloatArray | None:
    if measured.elevation_rad is None or (as_told and measured.up_m is not None):
        return measured.up_m
    return np.asarray(sensor_up_m + range_m * np.sin(measured.elevation_rad))


def point_sensor(name: str, config: InputConfig) -> Sensor:
    """A sensor that gives points: no cells, seen as far as the region of interest reaches."""
    return Sensor(id=name, range_res_m=0.0, azimuth_res_rad=0.0, max_range_m=config.roi_max_m)


def instant(
    sensor: Sensor, points: Points, *, t_ns: int, sensor_m: FloatArray, heading_rad: float, up_m: float = 0.0
) -> Scan:
    """A scan whose points have one common time."""
    return Scan(
        sensor, t_ns=t_ns, t_start_ns=t_ns, position_m=sensor_m, heading_rad=heading_rad, points=points, up_m=up_m
    )


def _of_interest(range_m: FloatArray, config: InputConfig) -> BoolArray:
    return (range_m >= max(config.roi_min_m, 0.0)) & (range_m <= config.roi_max_m)
