"""Iterated extended Kalman filter of many hulls at once, each with its own set of points.

Gauss-Newton on the posterior: with one iteration it is the extended Kalman filter. In information form, so that the
cost is linear in the points. Sets of points are padded to one length; what is padding has no weight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maritrack.contoursettings import ContourConfig
from maritrack.objects import contour
from maritrack.objects.contour import FIXED, HEADING
from maritrack.types import BoolArray, FloatArray

LOG_2PI = math.log(2.0 * math.pi)


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Posteriors of k hulls."""

    x: FloatArray  # (k, s)
    P: FloatArray  # (k, s, s)
    log_likelihood: FloatArray  # (k,) of the points as density of each, m^-2n
    steps: int  # of the one that took longest


def fit(
    x: FloatArray, P: FloatArray, z: FloatArray, use: BoolArray, start: FloatArray, rules: ContourConfig
) -> Fit:  # fmt: skip
    """Posteriors of hulls x (k, s), P (k, s, s) given points z (k, n, 2) that count where `use` (k, n).

    From `start` (k, s); a step that raises the cost (z - h)' R^-1 (z - h) + (s - x)' P^-1 (s - x) is halved. The
    likelihood is the prior predictive at the linearisation it ends with.
    """
    k = len(x)
    if k == 0:
        return Fit(x, P, np.zeros(0), 0)
    info = np.linalg.inv(P)
    info = (info + info.transpose(0, 2, 1)) / 2
    s = start.copy()
    e, A = _white(s, z, use, rules)
    cost = _cost(e, s - x, info)
    step = _step(e, A, s - x, info)
    share = np.ones(k)
    active = np.arange(k)
    rounds = 0
    for rounds in range(1, rules.iterations + 1):
        near = share[active] * np.abs(step[active]).max(axis=1) < rules.tolerance
        if rounds > 1:
            active = active[~near]
        if len(active) == 0:
            break
        tried = s[active] + share[active, None] * step[active]
        e_new, A_new = _white(tried, z[active], use[active], rules)
        cost_new = _cost(e_new, tried - x[active], info[active])
        good = (cost_new <= cost[active] + 1e-9) | (rules.iterations == 1)
        better = active[good]
        s[better], cost[better], e[better], A[better] = tried[good], cost_new[good], e_new[good], A_new[good]
        if len(better):
            step[better] = _step(e[better], A[better], s[better] - x[better], info[better])
        share[better], share[active[~good]] = 1.0, share[active[~good]] / 2.0
    if rules.iterations == 1:  # the gain of the one linearisation there was
        e, A = _white(start, z, use, rules)
        return _posterior(x, start, e, A, info, z, use, s, rules, rounds)
    return _posterior(x, s, e, A, info, z, use, s, rules, rounds)


def _posterior(
    x: FloatArray, at: FloatArray, e: FloatArray, A: FloatArray, info: FloatArray, z: FloatArray, use: BoolArray,
    s: FloatArray, rules: ContourConfig, rounds: int,
) -> Fit:  # fmt: skip
    total = info + A.transpose(0, 2, 1) @ A
    L = np.linalg.cholesky(total)
    y = e + (A @ (at - x)[:, :, None])[..., 0]
    b = (A.transpose(0, 2, 1) @ y[:, :, None])[..., 0]
    cov = np.linalg.inv(total)
    cov = (cov + cov.transpose(0, 2, 1)) / 2
    fitted = (b * (cov @ b[:, :, None])[..., 0]).sum(axis=1)
    log_det = 2.0 * np.log(np.einsum("kii->ki", L)).sum(axis=1) - np.linalg.slogdet(info)[1]
    var = np.where(use[..., None], contour.residuals(at, z, rules).var, 1.0)
    log_noise = np.log(var).sum(axis=(1, 2))
    count = use.sum(axis=1)
    log_l = -count * LOG_2PI - 0.5 * (log_noise + log_det + (y**2).sum(axis=1) - fitted)
    if rules.density == "perimeter":
        log_l += count * (0.5 * (LOG_2PI + 2.0 * math.log(rules.sigma_point_m)) - np.log(perimeter(s, rules)))
    return Fit(s, cov, log_l, rounds)


def log_noise(x: FloatArray, found: contour.Residuals, rules: ContourConfig) -> FloatArray:
    """Log density (k, n) of points at the outline of x, m^-2.

    With `contour.density` = "perimeter" a point may be anywhere on the outline. With "implicit" it has the density of
    the noise across the ray as well, as if its place along the outline were told.

    Deviates: extended-2 the default is "perimeter"; the paper's stacked Gaussian is "implicit", the preset `extended`.
    It counts a point for 20 times as likely as it is, so that new hulls take over what is followed.
    """
    log = -LOG_2PI - 0.5 * np.log(found.var).sum(axis=-1)
    if rules.density == "perimeter":
        log = log + (0.5 * LOG_2PI + math.log(rules.sigma_point_m) - np.log(perimeter(x, rules)))[:, None]
    return np.asarray(log)


def log_on_hull(x: FloatArray, z: FloatArray, rules: ContourConfig) -> FloatArray:
    """Log density (k, n) of points z (k, n, 2) when the outlines are x."""
    found = contour.residuals(x, z, rules)
    return np.asarray(log_noise(x, found, rules) - 0.5 * found.e**2 / found.var[..., 0])


def perimeter(x: FloatArray, rules: ContourConfig) -> FloatArray:
    """Length (k,) of the outlines."""
    corners = contour.polygon(x, rules, 36)
    return np.asarray(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).sum(axis=1))


def _white(x: FloatArray, z: FloatArray, use: BoolArray, rules: ContourConfig) -> tuple[FloatArray, FloatArray]:
    """Residuals (k, 2n) and derivatives (k, 2n, s) over their noise, those of padding zero.

    A point on the centre has no bearing, so that nothing can be derived by it; how far it is from the outline counts.
    """
    found = contour.residuals(x, z, rules)
    centre = np.hypot(z[..., 0] - x[:, None, 0], z[..., 1] - x[:, None, 1]) < contour.LEAST_RADIUS_M
    weight = np.where(use[..., None], 1.0 / np.sqrt(found.var), 0.0)
    e = np.stack([found.e, np.zeros_like(found.e)], axis=-1) * weight
    k, n, _, s = found.H.shape
    slope = found.H * np.where(centre[..., None], 0.0, weight)[..., None]
    return e.reshape(k, 2 * n), slope.reshape(k, 2 * n, s)


def _cost(e: FloatArray, gap: FloatArray, info: FloatArray) -> FloatArray:
    return np.asarray((e**2).sum(axis=1) + np.einsum("ki,kij,kj->k", gap, info, gap))


def _step(e: FloatArray, A: FloatArray, gap: FloatArray, info: FloatArray) -> FloatArray:
    slope = (A.transpose(0, 2, 1) @ e[:, :, None])[..., 0] - (info @ gap[:, :, None])[..., 0]
    return np.asarray(np.linalg.solve(info + A.transpose(0, 2, 1) @ A, slope[..., None])[..., 0])


def starts(
    x: FloatArray, P: FloatArray, z: FloatArray, use: BoolArray, sensor_m: FloatArray, headings: int,
    rules: ContourConfig,
) -> FloatArray:  # fmt: skip
    """Where the iterations begin (k, s): the cheapest, by their cost, of the prediction and hulls beside the points.

    Those have the predicted outline with its side towards the sensor on the centroid of the points, at `headings`
    headings within half a turn. `contour.start` = "predicted" has the prediction alone.

    Reading: extended sec. 3.1 "a special criterion is used to initialize the optimization": this is ours.
    """
    if rules.start == "predicted":
        return x
    k, s = x.shape
    count = np.maximum(use.sum(axis=1), 1)
    middle = (z * use[..., None]).sum(axis=1) / count[:, None]
    ray = middle - sensor_m
    ray /= np.maximum(np.linalg.norm(ray, axis=1), 1e-9)[:, None]
    tried = np.repeat(x[:, None], headings + 1, axis=1)
    tried[:, 1:, HEADING] += math.pi * np.arange(headings) / headings
    u = np.arctan2(-ray[:, 1], -ray[:, 0])[:, None] - tried[:, 1:, HEADING]
    flat = tried[:, 1:].reshape(-1, s)
    rho = contour.radius(u.reshape(-1, 1), flat[:, FIXED:], rules)[0].reshape(k, headings)
    tried[:, 1:, :2] = middle[:, None] + np.maximum(rho, contour.LEAST_RADIUS_M)[..., None] * ray[:, None]
    info = np.linalg.inv(P)
    n = headings + 1
    e, _ = _white(tried.reshape(-1, s), np.repeat(z, n, axis=0), np.repeat(use, n, axis=0), rules)
    gap = tried - x[:, None]
    cost = (e**2).sum(axis=1).reshape(k, n) + np.einsum("kni,kij,knj->kn", gap, info, gap)
    return np.asarray(tried[np.arange(k), cost.argmin(axis=1)])
