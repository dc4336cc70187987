"""What a LiDAR that turns in the plane sees of boats: the nearest thing on each ray, wakes and stray returns.

One return a ray, so that what stands behind another boat is hidden (extended, sec. 4.1). A wake is a cloud of points
behind the stern; a point of it hides what is behind it and is hidden by what is before it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maritrack.errors import ConfigError
from maritrack.geo import TWO_PI, en_to_polar
from maritrack.simulate import vessels
from maritrack.simulate.hulls import chords
from maritrack.simulate.vessels import Course, State
from maritrack.types import FloatArray, IntArray

NO_OBJECT = -1  # label of wake and clutter


@dataclass(frozen=True, kw_only=True)
class Lidar:
    """A LiDAR aboard the platform of a scene."""

    name: str = "lidar"
    forward_m: float = 0.0  # from the place of the platform, ahead and ...
    starboard_m: float = 0.0
    step_deg: float = 0.25  # from ray to ray
    max_range_m: float = 100.0
    sigma_range_m: float = 0.1
    p_return: float = 1.0  # of a ray that hits something
    clutter_rate: float = 0.0  # stray points in a scan on average, uniform in the disc, hidden by nothing

    def __post_init__(self) -> None:
        if not (0.0 < self.step_deg <= 90.0 and self.max_range_m > 0.0 and self.sigma_range_m >= 0.0):
            raise ConfigError(f"lidar '{self.name}': step_deg is within 0..90, max_range_m > 0, sigma_range_m >= 0")
        if not (0.0 <= self.p_return <= 1.0 and self.clutter_rate >= 0.0):
            raise ConfigError(f"lidar '{self.name}': p_return is within 0..1, clutter_rate not negative")

    @property
    def rays(self) -> int:
        """How many of them make a turn."""
        return max(round(360.0 / self.step_deg), 1)


@dataclass(frozen=True, kw_only=True)
class Boat:
    """A boat of a scene. It is there from `from_s` on, and begins its way then."""

    id: str
    length_m: float
    width_m: float
    bow_m: float  # length over which the bow narrows to a point
    waypoints_m: tuple[tuple[float, ...], ...]
    speed_mps: float
    turn_deg_per_s: float
    from_s: float = 0.0
    wake_rate: float = 0.0  # points of its wake in a scan on average, before some of them are hidden
    wake_length_m: float = 0.0  # mean distance of them behind the stern

    def __post_init__(self) -> None:
        if not (self.length_m > self.bow_m >= 0.0 and self.width_m > 0.0):
            raise ConfigError(f"boat '{self.id}': width_m > 0, bow_m within 0..length_m")
        if len(self.waypoints_m) < 2 or any(len(p) != 2 for p in self.waypoints_m):
            raise ConfigError(f"boat '{self.id}': waypoints_m is a list of two or more [east, north]")
        if not (self.speed_mps > 0.0 and self.turn_deg_per_s > 0.0 and self.from_s >= 0.0):
            raise ConfigError(f"boat '{self.id}': speed_mps and turn_deg_per_s > 0, from_s not negative")
        if self.wake_rate < 0.0 or (self.wake_rate > 0.0) != (self.wake_length_m > 0.0):
            raise ConfigError(f"boat '{self.id}': a rate of the wake and its length belong together")

    def course(self) -> Course:
        """Its path; ConfigError where a leg is too short for the turns."""
        turn_rad_per_s = math.radians(self.turn_deg_per_s)
        try:
            path = vessels.through(
                np.array(self.waypoints_m), speed_mps=self.speed_mps, turn_rad_per_s=turn_rad_per_s
            )  # fmt: skip
        except ConfigError as error:
            raise ConfigError(f"boat '{self.id}': {error}") from None
        return vessels.depart(path, at_s=self.from_s, accel_mps2=math.inf)


def outline(state: State, boat: Boat) -> FloatArray:
    """Its hull at each instant (t, 5, 2) east-north, counter-clockwise from the tip of the bow."""
    half, side, shoulder = boat.length_m / 2, boat.width_m / 2, boat.length_m / 2 - boat.bow_m
    body = np.array([[half, 0.0], [shoulder, -side], [-half, -side], [-half, side], [shoulder, side]])
    return placed(body, state)


def placed(body_m: FloatArray, state: State) -> FloatArray:
    """Points [forward, starboard] (n, 2) in the frame of a boat, where they are at each instant (t, n, 2)."""
    s, c = np.sin(state.heading_rad)[:, None], np.cos(state.heading_rad)[:, None]
    east, north = body_m[:, 0] * s + body_m[:, 1] * c, body_m[:, 0] * c - body_m[:, 1] * s
    return np.asarray(state.position_m[:, None] + np.stack([east, north], axis=-1))


@dataclass(frozen=True, slots=True, eq=False)
class Returns:
    """Points of one scan as seen from the sensor."""

    range_m: FloatArray  # (n,)
    azimuth_rad: FloatArray  # (n,)
    label: IntArray  # (n,) number of the boat, NO_OBJECT = wake or clutter


def sweep(
    lidar: Lidar, sensor_m: FloatArray, fleet: Sequence[tuple[int, Boat, State]], rng: np.random.Generator
) -> Returns:
    """One turn among boats (number, boat, its one state) that are there. Noise is along the ray alone."""
    n_rays, azimuth_rad = lidar.rays, TWO_PI * np.arange(lidar.rays) / lidar.rays
    range_m, label = np.full(n_rays, np.inf), np.full(n_rays, NO_OBJECT, np.int64)
    for number, boat, state in fleet:
        near_m, far_m = chords(outline(state, boat) - sensor_m, azimuth_rad[None])
        nearer = (far_m[0] > 0.0) & (near_m[0] < range_m)
        range_m[nearer], label[nearer] = near_m[0, nearer], number
    for _, boat, state in fleet:
        wake_m, wake_rad = en_to_polar(wake(boat, state, rng) - sensor_m)
        ray = np.rint(wake_rad / TWO_PI * n_rays).astype(np.int64) % n_rays
        order = np.argsort(-wake_m, kind="stable")  # the nearest of a ray is written last
        first_m = np.full(n_rays, np.inf)
        first_m[ray[order]] = wake_m[order]
        nearer = first_m < range_m
        range_m[nearer], label[nearer] = first_m[nearer], NO_OBJECT
    noisy_m = range_m + lidar.sigma_range_m * rng.normal(size=n_rays)
    seen = (range_m <= lidar.max_range_m) & (noisy_m >= 0.0) & (rng.random(n_rays) < lidar.p_return)
    stray = rng.poisson(lidar.clutter_rate)
    stray_m = lidar.max_range_m * np.sqrt(rng.random(stray))
    stray_rad = TWO_PI * rng.random(stray)
    return Returns(
        np.concatenate([noisy_m[seen], stray_m]), np.concatenate([azimuth_rad[seen], stray_rad]),
        np.concatenate([label[seen], np.full(stray, NO_OBJECT)]),
    )  # fmt: skip


def wake(boat: Boat, state: State, rng: np.random.Generator) -> FloatArray:
    """Points (n, 2) of the wake: behind the stern, thinning out, on both edges of a V that widens by a tenth."""
    n = rng.poisson(boat.wake_rate)
    behind_m = rng.exponential(boat.wake_length_m, n) if n else np.zeros(0)
    side_m = (boat.width_m / 2 + 0.1 * behind_m) * rng.uniform(-1.0, 1.0, n)
    return np.asarray(placed(np.stack([-boat.length_m / 2 - behind_m, side_m], axis=1), state)[0])
