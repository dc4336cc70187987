"""Gaussian-process model of a hull seen by its outline: a centre, a heading, and the radius at some angles.

Wahlstroem, Oezkan 2015. A point lies where the ray from the centre meets the outline,
z = xc + p(theta) f(theta), theta seen from the centre.   Eq: extended-3

The radius f is a Gaussian process of the angle in the frame of the hull, with a kernel of period 2 pi; between the
basis angles it is f(u) = m(u) + g(u) (f - m), with what that does not know as noise. The state is
[east, north, vel_east, vel_north, heading, turn rate, radius at each basis angle].   Eq: extended-1

The heading here is an angle of the plane: from east, counter-clockwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from maritrack.contoursettings import ContourConfig
from maritrack.types import FloatArray

FIXED = 6  # states before the radii
HEADING, TURN = 4, 5
LEAST_RADIUS_M = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Basis:
    """What the settings say about radii."""

    angle: FloatArray  # (f,)
    mean: FloatArray  # (f,) prior
    K: FloatArray  # (f, f) prior covariance
    K_inv: FloatArray  # (f, f)


@cache
def basis(rules: ContourConfig) -> Basis:
    """The basis angles, and mean and covariance of the radii there before anything is seen."""
    angle = np.arange(rules.angles, dtype=np.float64) * (2.0 * math.pi / rules.angles)
    K = kernel(angle[:, None] - angle, rules) + rules.sigma_n_m**2 * np.eye(rules.angles)
    return Basis(angle, outline(angle, rules)[0], K, np.asarray(np.linalg.inv(K), np.float64))


def kernel(gap_rad: FloatArray, rules: ContourConfig) -> FloatArray:
    """Covariance of the radii at two angles so far apart, without jitter."""
    return np.asarray(_periodic(gap_rad, rules) + rules.sigma_r_m**2)


def _periodic(gap_rad: FloatArray, rules: ContourConfig) -> FloatArray:
    return np.asarray(rules.sigma_f_m**2 * np.exp(-2.0 * np.sin(0.5 * gap_rad) ** 2 / rules.length_scale_rad**2))


def outline(u: FloatArray, rules: ContourConfig) -> tuple[FloatArray, FloatArray]:
    """Prior mean of the radius at angles u, and its derivative: (|cos u / a|^p + |sin u / b|^p)^(-1/p).

    Deviates: extended-3 the default mean is an outline of `contour.length_m` by `contour.width_m`; the zero mean of
    Wahlstroem and Oezkan, length_m = 0, lets hulls shrink where they are not seen.
    """
    if rules.length_m == 0:
        return np.zeros_like(u), np.zeros_like(u)
    a, b, p = rules.length_m / 2.0, rules.width_m / 2.0, rules.corner
    c, s = np.cos(u), np.sin(u)
    one, two = np.abs(c / a) ** p, np.abs(s / b) ** p
    m = (one + two) ** (-1.0 / p)
    slope = np.sign(s) * np.abs(s / b) ** (p - 1.0) * c / b - np.sign(c) * np.abs(c / a) ** (p - 1.0) * s / a
    return np.asarray(m), np.asarray(-m / (one + two) * slope)


def radius(u: FloatArray, f: FloatArray, rules: ContourConfig) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Radius (k, n) at angles u (k, n) of hulls with radii f (k, f), its slope, weights g (k, n, f), unknown variance.

    rho = m(u) + g(u) (f - m), g = k(u, basis) K^-1; the slope by u takes the periodic part of the kernel alone.
    """
    b = basis(rules)
    gap = u[..., None] - b.angle
    periodic = _periodic(gap, rules)
    k_u = periodic + rules.sigma_r_m**2
    g = k_u @ b.K_inv
    slope = (-np.sin(gap) / rules.length_scale_rad**2 * periodic) @ b.K_inv
    m, m_slope = outline(u, rules)
    offset = (f - b.mean)[:, :, None]
    prior = rules.sigma_f_m**2 + rules.sigma_r_m**2
    unknown = np.maximum(prior - (g * k_u).sum(axis=-1), 0.0)
    return m + (g @ offset)[..., 0], m_slope + (slope @ offset)[..., 0], g, unknown


def predict(x: FloatArray, P: FloatArray, dt_s: FloatArray, rules: ContourConfig, accel_psd_m2ps3: float) -> tuple[
    FloatArray, FloatArray
]:  # fmt: skip
    """States (n, s) and covariances (n, s, s) after dt_s (n,): constant velocity and turn rate, radii that forget.

    Eq: extended-2
    """
    n, s = x.shape
    b = basis(rules)
    keep = np.exp(-rules.forget_per_s * dt_s)
    F = np.broadcast_to(np.eye(s), (n, s, s)).copy()
    F[:, 0, 2] = F[:, 1, 3] = F[:, HEADING, TURN] = dt_s
    F[:, range(FIXED, s), range(FIXED, s)] = keep[:, None]
    out = F @ P @ F.transpose(0, 2, 1)
    for at, rate, q in ((0, 2, accel_psd_m2ps3), (1, 3, accel_psd_m2ps3), (HEADING, TURN, rules.sigma_turn_rps2**2)):
        out[:, at, at] += q * dt_s**3 / 3
        out[:, at, rate] += q * dt_s**2 / 2
        out[:, rate, at] += q * dt_s**2 / 2
        out[:, rate, rate] += q * dt_s
    out[:, FIXED:, FIXED:] += (1.0 - keep**2)[:, None, None] * b.K
    moved = x.copy()
    moved[:, :2] += dt_s[:, None] * x[:, 2:4]
    moved[:, HEADING] += dt_s * x[:, TURN]
    moved[:, FIXED:] = b.mean + keep[:, None] * (x[:, FIXED:] - b.mean)
    return moved, out


def newborn(x: FloatArray, sigma: FloatArray, rules: ContourConfig) -> tuple[FloatArray, FloatArray]:
    """States (n, s) of hulls nothing is known about but [east, north, vel, vel, heading, turn] x (n, 6) and sigma."""
    b = basis(rules)
    n, s = len(x), FIXED + rules.angles
    P = np.zeros((n, s, s))
    P[:, range(FIXED), range(FIXED)] = np.broadcast_to(sigma, (n, FIXED)) ** 2
    P[:, FIXED:, FIXED:] = b.K
    return np.concatenate([x, np.broadcast_to(b.mean, (n, rules.angles))], axis=1), P


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """Points against outlines, in the frame of the ray from the centre: along it and across."""

    e: FloatArray  # (k, n) along; across it is zero, as the angle is the point's own
    H: FloatArray  # (k, n, 2, s) derivative of the predicted point, along and across
    var: FloatArray  # (k, n, 2)


def residuals(x: FloatArray, z: FloatArray, rules: ContourConfig) -> Residuals:
    """What points z (k, n, 2) say against outlines x (k, s), to first order.   Eq: extended-4

    The angle of the point depends on centre and heading as well: all derivatives are those of
    h(x) = xc + p(theta(x)) rho(theta(x) - heading).
    """
    d = z - x[:, None, :2]
    r = np.maximum(np.hypot(d[..., 0], d[..., 1]), 1e-6)
    p = d / r[..., None]
    u = np.arctan2(d[..., 1], d[..., 0]) - x[:, None, HEADING]
    rho, slope, g, unknown = radius(u, x[:, FIXED:], rules)
    H = np.zeros((*z.shape[:2], 2, x.shape[1]))
    across = np.stack([-p[..., 1], p[..., 0]], axis=-1)
    H[..., 0, :2] = p - (slope / r)[..., None] * across
    H[..., 0, HEADING] = -slope
    H[..., 0, FIXED:] = g
    H[..., 1, :2] = (1.0 - rho / r)[..., None] * across
    noise = rules.sigma_point_m**2
    return Residuals(r - rho, H, np.stack([noise + unknown, np.full_like(unknown, noise)], axis=-1))


def polygon(x: FloatArray, rules: ContourConfig, corners: int = 64) -> FloatArray:
    """Outlines (n, corners, 2) of states x (n, s) in east-north."""
    u = np.broadcast_to(2.0 * math.pi * np.arange(corners) / corners, (len(x), corners))
    rho = np.maximum(radius(u, x[:, FIXED:], rules)[0], LEAST_RADIUS_M)
    angle = u + x[:, HEADING, None]
    return np.asarray(x[:, None, :2] + rho[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1))


def ellipse(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centroids (n, 2) of outlines (n, v, 2), and the ellipse (n, 2, 2) of the same second moments."""
    a, b = corners, np.roll(corners, -1, axis=1)
    origin = corners.mean(axis=1, keepdims=True)
    a, b = a - origin, b - origin
    cross = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    area = cross.sum(axis=1) / 2.0
    centre = ((a + b) * cross[..., None]).sum(axis=1) / (6.0 * area)[:, None]
    outer = a[..., :, None] * a[..., None, :] + b[..., :, None] * b[..., None, :]
    mixed = (a + b)[..., :, None] * (a + b)[..., None, :]
    second = ((outer + mixed) * cross[..., None, None]).sum(axis=1) / (24.0 * area)[:, None, None]
    cov = second - centre[:, :, None] * centre[:, None, :]
    return origin[:, 0] + centre, np.asarray(4.0 * cov)
