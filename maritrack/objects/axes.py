"""Principal axes of an extended object: orientation and two semi-axes as a Gaussian, updated by a Kalman filter.

A reconstruction: the abs paper names the filter (PAKF, its ref. 5) and its state, the measurement model here is
ours. A cluster's covariance without the sensor's noise gives an orientation and two semi-axes, whose noise is that
of a sample covariance of Gaussian points. State [orientation, semi-axis along it, semi-axis across], orientation
in radians counter-clockwise from east, the first axis the longer one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maritrack.objects import matrix2
from maritrack.objects.giw import segment_sums
from maritrack.tracksettings import ModelConfig, PakfConfig
from maritrack.types import Clusters, FloatArray, IntArray

EYE3 = np.eye(3)
SWAP = np.array([0, 2, 1])  # of the semi-axes


@dataclass(frozen=True, slots=True, eq=False)
class Axes:
    """Densities of n objects."""

    p: FloatArray  # (n, 3) orientation (rad), semi-axes (m), the longer first
    P: FloatArray  # (n, 3, 3)

    def __len__(self) -> int:
        return len(self.p)


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Principal axes of clusters as measurements."""

    z: FloatArray  # (c, 3) orientation, semi-axes
    information: FloatArray  # (c, 3) 1 / variance of each; 0 = not observed


def empty() -> Axes:
    """No object."""
    return Axes(np.zeros((0, 3)), np.zeros((0, 3, 3)))


def predict(axes: Axes, dt_s: FloatArray, rules: PakfConfig) -> Axes:
    """Densities after dt_s (n,) seconds of a random walk."""
    sigma = np.array([math.radians(rules.sigma_angle_deg), rules.sigma_axis_m, rules.sigma_axis_m])  # in a second
    return Axes(axes.p, axes.P + dt_s[:, None, None] * np.diag(sigma**2))


def follow_course(axes: Axes, velocity_mps: FloatArray, rules: PakfConfig) -> Axes:
    """Densities that know that a hull points where it goes: course as a measurement of the orientation.

    For velocities (n, 2) above `course_min_mps`; `course_sigma_deg` = 0 leaves it out.
    """
    if rules.course_sigma_deg == 0.0:
        return axes
    fast = np.hypot(velocity_mps[:, 0], velocity_mps[:, 1]) > rules.course_min_mps
    z = np.column_stack([np.arctan2(velocity_mps[:, 1], velocity_mps[:, 0]), axes.p[:, 1:]])
    information = np.zeros_like(z)
    information[fast, 0] = math.radians(rules.course_sigma_deg) ** -2
    n = np.arange(len(axes))
    return update(axes, Seen(z, information), n, n, np.ones(len(axes)), rules)


def measure(clusters: Clusters, model: ModelConfig, rules: PakfConfig) -> Seen:
    """Principal axes of clusters and what they tell.

    With n points and eigenvalues a >= b of their covariance (noise removed): semi-axes sqrt(a / rho), sqrt(b / rho)
    of variance l^2 / 2n, not below one cell; orientation of variance a b / (n (a - b)^2), not below
    `angle_floor_deg`, and not observed where b > `round_ratio` a.
    """
    if len(clusters) == 0:
        return Seen(np.zeros((0, 3)), np.zeros((0, 3)))
    n = 1.0 / clusters.weight_sq
    values, major = matrix2.eigen(clusters.scatter_m2 / clusters.count[:, None, None] - clusters.noise_m2)
    values = np.maximum(values, 0.0)
    a, b = values[:, 0], values[:, 1]
    half_m = np.clip(np.sqrt(values / model.rho), model.min_axis_m, model.max_axis_m)
    z = np.column_stack([np.arctan2(major[:, 1], major[:, 0]), half_m])
    minor = np.stack([-major[:, 1], major[:, 0]], axis=1)
    cell_m2 = 12.0 * np.stack([matrix2.form(clusters.noise_m2, u) for u in (major, minor)], axis=1)
    variance_m2 = np.maximum(half_m**2 / (2.0 * n[:, None]), cell_m2)
    pointed = (b <= rules.round_ratio * a) & (a > 0.0)
    apart = np.where(pointed, a - b, 1.0)
    variance_rad2 = np.maximum(a * b / (n * apart**2), math.radians(rules.angle_floor_deg) ** 2)
    return Seen(z, np.column_stack([np.where(pointed, 1.0 / variance_rad2, 0.0), 1.0 / variance_m2]))


def birth(seen: Seen) -> Axes:
    """New objects at measurements (c,); an orientation that was not observed may be any."""
    variance = 1.0 / np.maximum(seen.information, np.array([12.0 / math.pi**2, 1e-9, 1e-9]))
    return Axes(seen.z.copy(), variance[:, :, None] * EYE3)


def update(axes: Axes, seen: Seen, i: IntArray, j: IntArray, beta: FloatArray, rules: PakfConfig) -> Axes:
    """Moment-matched mixture of the updates of objects i by clusters j with weights beta (k,), i in order.

    The weight that is left is that of no cluster. Innovations are averaged, never angles. With beta = 1 it is
    the Kalman filter.
    """
    if len(i) == 0:
        return axes
    P, W = axes.P[i], seen.information[j][:, :, None] * EYE3
    P_pair = np.linalg.solve(EYE3 + P @ W, P)  # (P^-1 + W)^-1
    P_pair = (P_pair + P_pair.transpose(0, 2, 1)) / 2
    step = np.einsum("kab,kb->ka", P_pair @ W, innovation(axes.p[i], seen.z[j], rules))
    spread = P_pair - P + step[:, :, None] * step[:, None, :]
    sums = segment_sums(i, np.concatenate([step, spread.reshape(-1, 9)], axis=1) * beta[:, None], len(axes))
    mean = sums[:, :3]
    P_new = axes.P + sums[:, 3:].reshape(-1, 3, 3) - mean[:, :, None] * mean[:, None, :]
    return _ordered(Axes(axes.p + mean, (P_new + P_new.transpose(0, 2, 1)) / 2))


def innovation(p: FloatArray, z: FloatArray, rules: PakfConfig) -> FloatArray:
    """z - p (k, 3): the orientation modulo pi, within +- pi/2; of a nearly round object the axes may change places."""
    off_rad = _half_turn(z[:, 0] - p[:, 0])
    crossed = (np.abs(off_rad) > math.pi / 4) & (p[:, 2] ** 2 > rules.round_ratio * p[:, 1] ** 2)
    z = np.where(crossed[:, None], z[:, SWAP], z)
    off_rad = np.where(crossed, _half_turn(off_rad + math.pi / 2), off_rad)
    return np.column_stack([off_rad, z[:, 1:] - p[:, 1:]])


def _half_turn(angle_rad: FloatArray) -> FloatArray:
    """Angles modulo pi in [-pi/2, pi/2)."""
    return np.asarray((angle_rad + math.pi / 2) % math.pi - math.pi / 2)


def _ordered(axes: Axes) -> Axes:
    """The same ellipses with the longer axis first and the orientation in [0, 2 pi)."""
    crossed = axes.p[:, 2] > axes.p[:, 1]
    p = np.where(crossed[:, None], axes.p[:, SWAP] + [math.pi / 2, 0.0, 0.0], axes.p)
    P = np.where(crossed[:, None, None], axes.P[:, SWAP][:, :, SWAP], axes.P)
    p[:, 0] %= 2 * math.pi
    return Axes(p, P)


def held(axes: Axes, model: ModelConfig) -> Axes:
    """Densities whose semi-axes are within the limits of the model."""
    half_m = np.clip(axes.p[:, 1:], model.min_axis_m, model.max_axis_m)
    return Axes(np.column_stack([axes.p[:, :1], half_m]), axes.P)


def ellipse(axes: Axes) -> FloatArray:
    """X (n, 2, 2) of the ellipses {u: u' X^-1 u <= 1}."""
    major = np.stack([np.cos(axes.p[:, 0]), np.sin(axes.p[:, 0])], axis=1)
    outer, a2, b2 = major[:, :, None] * major[:, None, :], axes.p[:, 1] ** 2, axes.p[:, 2] ** 2
    return np.asarray(b2[:, None, None] * np.eye(2) + (a2 - b2)[:, None, None] * outer)
