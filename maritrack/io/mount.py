"""Where a sensor is aboard its platform, and so where it is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maritrack.errors import InputError
from maritrack.types import FloatArray


@dataclass(frozen=True, slots=True)
class Mount:
    """Place of a sensor from that of its platform, and how it is turned."""

    forward_m: float = 0.0
    starboard_m: float = 0.0
    turn_rad: float = 0.0  # clockwise from the bow, of its azimuth 0; counts for azimuths that are relative to the bow

    @property
    def offset(self) -> bool:
        """Whether it is anywhere else than the platform."""
        return self.forward_m != 0.0 or self.starboard_m != 0.0


NOWHERE_ELSE = Mount()  # at the place of the platform, ahead


def aboard(platform_m: FloatArray, heading_rad: float, mount: Mount) -> FloatArray:
    """East-north (2,) of the sensor on a platform at (2,). InputError where that takes a heading and there is none."""
    if not mount.offset:
        return platform_m
    if math.isnan(heading_rad):
        raise InputError("a sensor that is mounted off its platform's place, but no heading")
    s, c = math.sin(heading_rad), math.cos(heading_rad)
    ahead, right = np.array([s, c]), np.array([c, -s])
    return np.asarray(platform_m + mount.forward_m * ahead + mount.starboard_m * right)
