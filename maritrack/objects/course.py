"""Vessels that steer: place, course and speed as a Gaussian, moved on by an extended Kalman filter.

State [east, north, course, speed], the course clockwise from north in radians. A course means nothing for what lies at
rest, and the first two echoes of a vessel do not tell it: rows that are not `steered` are
[east, north, vel_east, vel_north] with white acceleration, until their velocity is known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maritrack import geo
from maritrack.centroidsettings import CentroidConfig
from maritrack.objects import giw, matrix2
from maritrack.objects.giw import Giw
from maritrack.tracksettings import ModelConfig
from maritrack.types import BoolArray, FloatArray

EYE4 = np.eye(4)


@dataclass(frozen=True, slots=True, eq=False)
class Courses:
    """Densities of n vessels."""

    x: FloatArray  # (n, 4)
    P: FloatArray  # (n, 4, 4)
    steered: BoolArray  # (n,) the state has course and speed

    def __len__(self) -> int:
        return len(self.x)


def empty() -> Courses:
    """No vessel."""
    return Courses(np.zeros((0, 4)), np.zeros((0, 4, 4)), np.zeros(0, bool))


def jacobian(x: FloatArray, dt_s: FloatArray) -> FloatArray:
    """F (n, 4, 4) of the motion over dt_s (n,) seconds at states x (n, 4) with a course.

    That phi_t stands on the right of eq. 1 makes no difference: without its noise the course is constant.
    Eq: dataset-1
    """
    F = np.broadcast_to(EYE4, (len(x), 4, 4)).copy()
    sin, cos = np.sin(x[:, 2]), np.cos(x[:, 2])
    F[:, 0, 2], F[:, 1, 2] = x[:, 3] * dt_s * cos, -x[:, 3] * dt_s * sin
    F[:, 0, 3], F[:, 1, 3] = dt_s * sin, dt_s * cos
    return F


def predict(c: Courses, dt_s: FloatArray, model: ModelConfig, rules: CentroidConfig) -> Courses:
    """Densities after dt_s (n,) seconds; Q of the paper's u_t grows with the time."""
    F = jacobian(c.x, dt_s)
    sigma = np.array([rules.sigma_position_m] * 2 + [math.radians(rules.sigma_course_deg), rules.sigma_speed_mps])
    P = F @ c.P @ F.transpose(0, 2, 1) + dt_s[:, None, None] * np.diag(sigma**2)
    x = c.x.copy()
    x[:, :2] += (dt_s * c.x[:, 3])[:, None] * np.stack([np.sin(c.x[:, 2]), np.cos(c.x[:, 2])], axis=1)
    free = giw.predict(as_points(c.x, c.P), dt_s, model)
    return Courses(
        np.where(c.steered[:, None], x, free.x), np.where(c.steered[:, None, None], P, free.P), c.steered
    )  # fmt: skip


def as_points(x: FloatArray, P: FloatArray) -> Giw:
    """States and covariances as densities without extent."""
    return Giw(x, P, np.zeros((len(x), 2, 2)), np.full(len(x), 3.0))


def cartesian(c: Courses) -> Giw:
    """The same with velocities east and north, to first order; without extent."""
    x, J = c.x.copy(), np.broadcast_to(EYE4, c.P.shape).copy()
    sin, cos, v = np.sin(c.x[:, 2]), np.cos(c.x[:, 2]), c.x[:, 3]
    x[:, 2], x[:, 3] = v * sin, v * cos
    J[:, 2, 2], J[:, 2, 3], J[:, 3, 2], J[:, 3, 3] = v * cos, sin, -v * sin, cos
    P = J @ c.P @ J.transpose(0, 2, 1)
    return as_points(np.where(c.steered[:, None], x, c.x), np.where(c.steered[:, None, None], P, c.P))


def steered(x: FloatArray, P: FloatArray) -> Courses:
    """Cartesian states (n, 4) and covariances that have a velocity, with course and speed, to first order."""
    v = np.maximum(np.hypot(x[:, 2], x[:, 3]), 1e-9)
    J, out = np.broadcast_to(EYE4, P.shape).copy(), x.copy()
    out[:, 2], out[:, 3] = np.arctan2(x[:, 2], x[:, 3]), v
    J[:, 2, 2], J[:, 2, 3] = x[:, 3] / v**2, -x[:, 2] / v**2
    J[:, 3, 2], J[:, 3, 3] = x[:, 2] / v, x[:, 3] / v
    return Courses(out, J @ P @ J.transpose(0, 2, 1), np.ones(len(x), bool))


def settled(c: Courses, rules: CentroidConfig) -> Courses:
    """The same densities: courses wrapped, no speed negative, and those steered whose velocity has become known.

    A speed below zero is the opposite course: a change of the sign of one variable.
    """
    back = c.steered & (c.x[:, 3] < 0.0)
    sign = np.where(back, -1.0, 1.0)
    x, P = c.x.copy(), c.P.copy()
    x[:, 3] *= sign
    P[:, 3, :] *= sign[:, None]
    P[:, :, 3] *= sign[:, None]
    x[:, 2] = np.where(c.steered, geo.wrap(x[:, 2] + np.where(back, math.pi, 0.0)), x[:, 2])
    known = ~c.steered & (matrix2.form(matrix2.inverse(c.P[:, 2:, 2:]), c.x[:, 2:]) > rules.course_chi2)
    if known.any():
        now = steered(x[known], P[known])
        x[known], P[known] = now.x, now.P
    return Courses(x, (P + P.transpose(0, 2, 1)) / 2, c.steered | known)
