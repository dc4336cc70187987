"""Motion at constant velocity in two or three dimensions: the state is all positions, then all velocities.

[east, north, vel_east, vel_north], or [east, north, up, vel_east, vel_north, vel_up].   Eq: engm-39
"""

from __future__ import annotations

import numpy as np

from maritrack.types import FloatArray


def transition(dt_s: float, axes: int) -> FloatArray:
    """F (2 axes, 2 axes) over dt_s seconds."""
    F = np.eye(2 * axes)
    F[:axes, axes:] = dt_s * np.eye(axes)
    return F


def process_noise(dt_s: float, axes: int, *, accel_psd_m2ps3: float, sigma: float = 0.0) -> FloatArray:
    """Q (2 axes, 2 axes): white acceleration, and `sigma` (m, m/s) of white noise on every state at the end."""
    one = np.array([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]])
    return np.asarray(np.kron(accel_psd_m2ps3 * one, np.eye(axes)) + sigma**2 * np.eye(2 * axes))
