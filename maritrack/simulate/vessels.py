"""Vessels that move: where each one is at any time, and the outline of its hull.

A path is a chain of arcs and straight lines, told by its length; when the vessel is where on it is a
second, separate law (moored, speeding up, steady). Lengths in metres, time in seconds since the scene began.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from maritrack.errors import ConfigError
from maritrack.geo import wrap
from maritrack.types import FloatArray

# Outline of a hull, (forward, starboard) in lengths and widths, counter-clockwise as seen from above:
# pointed bow, full width from a quarter length before midships, a narrower transom.
HULL = np.array([[0.5, 0.0], [0.4, -0.3], [0.25, -0.5], [-0.45, -0.5], [-0.5, -0.4], [-0.5, 0.4], [-0.45, 0.5],
                 [0.25, 0.5], [0.4, 0.3]])  # fmt: skip
_AROUND = 2.0 * np.pi * np.arange(32) / 32
OUTLINES = {"hull": HULL, "ellipse": 0.5 * np.stack([np.cos(_AROUND), np.sin(_AROUND)], axis=1)[::-1]}


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """A vessel at several instants."""

    position_m: FloatArray  # (t, 2) east-north of midships
    velocity_mps: FloatArray  # (t, 2)
    heading_rad: FloatArray  # (t,)


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """A path of p pieces of constant curvature, and the law of speed along it. The last piece has no end."""

    begin_m: FloatArray  # (p,) distance along the path at which a piece begins
    position_m: FloatArray  # (p, 2) where it begins
    heading_rad: FloatArray  # (p,) and how it heads there
    curvature_per_m: FloatArray  # (p,) clockwise positive
    speed_mps: float
    depart_s: float  # at rest until then
    accel_mps2: float  # inf = at full speed at once
    end_m: float = math.inf  # comes to rest there ...
    brake_mps2: float = math.inf  # ... slowing down by this

    def at(self, t_s: FloatArray) -> State:
        """Position, velocity and heading at each time (t,)."""
        t_s = np.asarray(t_s, dtype=np.float64)
        along_m, speed_mps = _braked(self, *_along(self, np.maximum(t_s - self.depart_s, 0.0)))
        piece = np.searchsorted(self.begin_m, along_m, side="right") - 1
        piece = np.maximum(piece, 0)
        step_m = along_m - self.begin_m[piece]
        turned_rad = self.curvature_per_m[piece] * step_m
        chord_m = step_m * np.sinc(0.5 * turned_rad / np.pi)  # of an arc; of a straight line its length
        position_m = self.position_m[piece] + chord_m[:, None] * _unit(self.heading_rad[piece] + 0.5 * turned_rad)
        heading_rad = self.heading_rad[piece] + turned_rad
        moving_mps = np.where(t_s < self.depart_s, 0.0, speed_mps)
        return State(position_m, moving_mps[:, None] * _unit(heading_rad), heading_rad % (2 * np.pi))


def _along(course: Course, tau_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance gone and speed, (t,) each, a time after departure."""
    if math.isinf(course.accel_mps2):
        return course.speed_mps * tau_s, np.full_like(tau_s, course.speed_mps)
    full_s = course.speed_mps / course.accel_mps2
    rising_s = np.minimum(tau_s, full_s)
    along_m = 0.5 * course.accel_mps2 * rising_s**2 + course.speed_mps * (tau_s - rising_s)
    return along_m, course.accel_mps2 * rising_s


def _braked(course: Course, along_m: FloatArray, speed_mps: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance and speed (t,) of a vessel that stops at the end of its way, from those of one that goes on."""
    if math.isinf(course.end_m):
        return along_m, speed_mps
    way_m = 0.5 * course.speed_mps**2 / course.brake_mps2  # from full speed to rest
    over_s = np.clip((along_m - (course.end_m - way_m)) / course.speed_mps, 0.0, course.speed_mps / course.brake_mps2)
    braking = over_s > 0.0
    slower_mps = course.speed_mps - course.brake_mps2 * over_s
    braked_m = course.end_m - 0.5 * slower_mps**2 / course.brake_mps2
    return np.where(braking, braked_m, along_m), np.where(braking, slower_mps, speed_mps)


def _unit(heading_rad: FloatArray) -> FloatArray:
    return np.stack([np.sin(heading_rad), np.cos(heading_rad)], axis=-1)


def moored(position_m: FloatArray, *, heading_rad: float) -> Course:
    """At rest for ever."""
    return straight(position_m, heading_rad=heading_rad, speed_mps=0.0)


def straight(position_m: FloatArray, *, heading_rad: float, speed_mps: float) -> Course:
    """Steady course and speed."""
    start_m = np.asarray(position_m, dtype=np.float64).reshape(1, 2)
    zero = np.zeros(1)
    return Course(zero, start_m, np.array([heading_rad]), zero, speed_mps, 0.0, math.inf)


def through(waypoints_m: FloatArray, *, speed_mps: float, turn_rad_per_s: float) -> Course:
    """From waypoint to waypoint (w, 2), w >= 2, turning at a stated rate, and straight on after the last.

    A turn is the arc that touches both legs, so the vessel passes inside of the waypoint. Raises ConfigError
    where the legs are too short for it.
    """
    points_m = np.asarray(waypoints_m, dtype=np.float64)
    legs_m = np.diff(points_m, axis=0)
    length_m = np.hypot(legs_m[:, 0], legs_m[:, 1])
    heading_rad = np.arctan2(legs_m[:, 0], legs_m[:, 1])
    turn_rad = wrap(np.diff(heading_rad))
    radius_m = speed_mps / turn_rad_per_s
    cut_m = np.concatenate([[0.0], radius_m * np.tan(np.abs(turn_rad) / 2), [0.0]])  # of both legs at a waypoint
    left_m = length_m - cut_m[:-1] - cut_m[1:]
    if np.any(left_m < 0.0) or np.any(length_m == 0.0):
        i = int(np.argmin(left_m))
        raise ConfigError(f"leg {i} of {length_m[i]:.0f} m is too short for turns of radius {radius_m:.0f} m")
    lengths_m = _alternate(left_m, radius_m * np.abs(turn_rad))
    headings_rad = _alternate(heading_rad, heading_rad[:-1])
    curvature = _alternate(np.zeros(len(left_m)), np.sign(turn_rad) / radius_m)
    turned_rad = curvature * lengths_m
    chords_m = lengths_m * np.sinc(0.5 * turned_rad / np.pi)
    steps_m = chords_m[:, None] * _unit(headings_rad + 0.5 * turned_rad)
    begin_m = np.concatenate([[0.0], np.cumsum(lengths_m)[:-1]])
    position_m = points_m[0] + np.concatenate([np.zeros((1, 2)), np.cumsum(steps_m, axis=0)[:-1]])
    return Course(begin_m, position_m, headings_rad, curvature, speed_mps, 0.0, math.inf)


def _alternate(legs: FloatArray, arcs: FloatArray) -> FloatArray:
    """Leg, arc, leg, ..., leg."""
    both = np.zeros(len(legs) + len(arcs))
    both[::2], both[1::2] = legs, arcs
    return both


def depart(course: Course, *, at_s: float, accel_mps2: float) -> Course:
    """The same path, at rest until a time, then speeding up to the speed of the course."""
    return replace(course, depart_s=at_s, accel_mps2=accel_mps2)


def arrive(course: Course, *, at_m: FloatArray, brake_mps2: float) -> Course:
    """The same path, slowing down so that it ends at a place (2,) on its last leg.

    Raises ConfigError where the way is too short to reach full speed and to stop.
    """
    end_m = float(course.begin_m[-1] + np.hypot(*(np.asarray(at_m) - course.position_m[-1])))
    rising_m = 0.0 if math.isinf(course.accel_mps2) else 0.5 * course.speed_mps**2 / course.accel_mps2
    way_m = rising_m + 0.5 * course.speed_mps**2 / brake_mps2
    if end_m < way_m:
        raise ConfigError(f"a way of {end_m:.0f} m is too short to speed up and to stop in: {way_m:.0f} m")
    return replace(course, end_m=end_m, brake_mps2=brake_mps2)


def hull(state: State, *, length_m: float, width_m: float, outline: str = "hull") -> FloatArray:
    """Outline at each instant, (t, v, 2) east-north, counter-clockwise."""
    forward = _unit(state.heading_rad)
    starboard = _unit(state.heading_rad + np.pi / 2)
    body_m = OUTLINES[outline] * [length_m, width_m]
    outline_m = body_m[:, :1] * forward[:, None, :] + body_m[:, 1:] * starboard[:, None, :]
    return np.asarray(state.position_m[:, None, :] + outline_m, dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class Vessel:
    """A floating object of a scene, as its file tells it. One waypoint = it never moves."""

    id: str
    name: str = ""
    length_m: float
    width_m: float
    outline: Literal["hull", "ellipse"] = "hull"
    rcs_m2: float  # echo seen broadside
    fade: float = 2.0  # shape of the gamma law of the echo from turn to turn; 1 = Swerling I, large = steady
    waypoints_m: tuple[tuple[float, ...], ...]
    speed_mps: float = 0.0
    turn_deg_per_s: float = 1.0
    heading_deg: float = 0.0  # where there is one waypoint only
    depart_s: float = 0.0
    accel_mps2: float = math.inf
    brake_mps2: float = math.inf  # stops at its last waypoint, slowing down by this; inf = goes straight on
    ais: bool = True  # tells others where it is
    antenna_m: tuple[float, ...] = (0.0, 0.0)  # of AIS: ahead and to starboard of the middle of the hull

    def __post_init__(self) -> None:
        for name in ("length_m", "width_m", "rcs_m2", "fade", "turn_deg_per_s", "accel_mps2", "brake_mps2"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"vessel '{self.id}': {name} must be greater than 0")
        if not self.waypoints_m or any(len(p) != 2 for p in self.waypoints_m):
            raise ConfigError(f"vessel '{self.id}': waypoints_m is a list of [east, north]")
        if (len(self.waypoints_m) > 1) != (self.speed_mps > 0.0):
            raise ConfigError(f"vessel '{self.id}': a speed and at least two waypoints belong together")
        if self.depart_s < 0.0:
            raise ConfigError(f"vessel '{self.id}': depart_s must not be negative")
        aboard = [abs(a) <= size / 2 for a, size in zip(self.antenna_m, (self.length_m, self.width_m), strict=False)]
        if len(self.antenna_m) != 2 or not all(aboard):
            raise ConfigError(f"vessel '{self.id}': antenna_m is [ahead, starboard] of the middle, within the hull")

    def course(self) -> Course:
        """The path and the law of speed that the settings mean."""
        points_m = np.array(self.waypoints_m)
        if len(points_m) == 1:
            return moored(points_m[0], heading_rad=math.radians(self.heading_deg))
        try:
            path = through(points_m, speed_mps=self.speed_mps, turn_rad_per_s=math.radians(self.turn_deg_per_s))
            path = depart(path, at_s=self.depart_s, accel_mps2=self.accel_mps2)
            stops = math.isfinite(self.brake_mps2)
            return arrive(path, at_m=points_m[-1], brake_mps2=self.brake_mps2) if stops else path
        except ConfigError as error:
            raise ConfigError(f"vessel '{self.id}': {error}") from None
