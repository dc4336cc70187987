"""From measured range and azimuth to the points of a scan, the same way for every point input."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maritrack.errors import InputError
from maritrack.geo import en_to_polar, polar_to_en, wrap_positive
from maritrack.io.noise import point_noise, turn_cov
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

    def __post_init__(self) -> None:
        check_lengths(
            self, len(self.range_m), "azimuth_rad", "t_ns", "intensity", "cov_m2", "truth_label", "position_m"
        )


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


def to_points(
    measured: Measured,
    *,
    sensor_m: FloatArray,
    heading_rad: float | FloatArray,
    config: InputConfig,
    where: str,
    head_up: bool,
) -> Points:
    """Points with offsets, heading (where azimuths are relative to it), latency, noise and region of interest applied.

    `sensor_m` is (2,) or (n, 2), `heading_rad` one or (n,). Points outside of roi_min..roi_max are
    left out. `where` is for the error that head-up azimuths lack a heading.
    """
    turn: float | FloatArray = np.deg2rad(config.azimuth_offset_deg)
    if head_up and config.stabilised == "head":
        if np.any(np.isnan(heading_rad)):
            raise InputError(f"{where}: azimuths relative to the bow, but no heading", hint="input.stabilised = north")
        turn = turn + heading_rad
    told = None if config.range_offset_m != 0.0 or np.any(turn) else measured.position_m
    range_m = measured.range_m + config.range_offset_m
    azimuth_rad = wrap_positive(measured.azimuth_rad + turn)
    cov = measured.cov_m2
    if cov is None:
        cov = point_noise(range_m, azimuth_rad, config)
    elif np.any(turn):
        cov = turn_cov(cov, turn)
    nothing = np.zeros(len(range_m))
    points = Points(
        range_m=range_m,
        azimuth_rad=azimuth_rad,
        position_m=sensor_m + polar_to_en(range_m, azimuth_rad) if told is None else told,
        intensity=measured.intensity,
        t_ns=measured.t_ns - round(config.latency_s * 1e9),
        range_width_m=nothing,
        azimuth_width_rad=nothing,
        cov_m2=cov,
        truth_label=measured.truth_label,
    )
    return take(points, _of_interest(range_m, config))


def point_sensor(name: str, config: InputConfig) -> Sensor:
    """A sensor that gives points: no cells, seen as far as the region of interest reaches."""
    return Sensor(id=name, range_res_m=0.0, azimuth_res_rad=0.0, max_range_m=config.roi_max_m)


def instant(sensor: Sensor, points: Points, *, t_ns: int, sensor_m: FloatArray, heading_rad: float) -> Scan:
    """A scan whose points have one common time."""
    return Scan(sensor, t_ns=t_ns, t_start_ns=t_ns, position_m=sensor_m, heading_rad=heading_rad, points=points)


def _of_interest(range_m: FloatArray, config: InputConfig) -> BoolArray:
    return (range_m >= max(config.roi_min_m, 0.0)) & (range_m <= config.roi_max_m)
