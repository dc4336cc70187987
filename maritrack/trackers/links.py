"""Pairs of a component and a measurement: gate, likelihood, update. Batched; a component is a row.

What a pair needs of the two covariances it shares with all pairs of that component where measurements have one noise:
only innovations are computed pair by pair.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv

from maritrack.objects import sensing
from maritrack.settings import Config
from maritrack.trackers import intensity, readings
from maritrack.trackers.intensity import Intensity
from maritrack.trackers.readings import Readings
from maritrack.types import FloatArray, IntArray, Points, Scan

BLOCK = 1 << 21  # pairs looked at together


@dataclass(frozen=True, slots=True, eq=False)
class Links:
    """k pairs, ordered by component, on l rows of what they share."""

    i: IntArray  # (k,) component
    j: IntArray  # (k,) measurement
    row: IntArray  # (k,)
    nu: FloatArray  # (k, z) innovation
    of: IntArray  # (l,) component of a row
    noise: IntArray  # (l,) noise of a row
    H: FloatArray  # (l, z, s) dh/dx; of particles none
    L_inv: FloatArray  # (l, z, z) of S = L L'

    def __len__(self) -> int:
        return len(self.i)


def link(
    x: FloatArray, P: FloatArray | None, readings: Readings, i: IntArray, j: IntArray, t_ns: int, own_s: FloatArray
) -> Links:
    """Pairs (i, j) of components at t_ns; `own_s` (n,) is when each is looked at, in seconds after t_ns.

    A measurement of another time sees the component moved on: nu = z - h(p + dt v). H is taken at the component's
    own time, near which its measurements are. P = None are particles: S = R.   Eq: engm-17, engm-18, engm-19
    """
    kind, axes = readings.kind, x.shape[1] // 2
    later_s = (readings.t_ns - t_ns) * 1e-9
    if len(later_s) and np.ptp(later_s) == 0.0:  # one time for all, as of points: expected is one for each component
        expected = sensing.measure(kind, x[:, :axes] + later_s[0] * x[:, axes:] - readings.sensor_m)[i]
    else:
        expected = sensing.measure(kind, x[i, :axes] + later_s[j][:, None] * x[i, axes:] - readings.sensor_m)
    nu = sensing.innovation(kind, readings.z[j], expected)
    if P is None:
        whole = np.zeros((len(readings.R), 0, 0))
        return Links(i, j, readings.noise[j], nu, np.zeros(0, np.int64), np.arange(len(readings.R)), whole,
                     _inverse(readings.R))  # fmt: skip
    if len(readings.R) == 1:
        of, noise, row = np.arange(len(x)), np.zeros(len(x), np.int64), i
    else:
        of, noise, row = i, readings.noise[j], np.arange(len(i))
    J = sensing.jacobian(kind, x[of, :axes] + own_s[of, None] * x[of, axes:] - readings.sensor_m)
    H = np.concatenate([J, own_s[of, None, None] * J], axis=2)
    S = H @ P[of] @ H.transpose(0, 2, 1) + readings.R[noise]
    return Links(i, j, row, nu, of, noise, H, _inverse(S))


def _inverse(S: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(np.linalg.cholesky(S)))


def log_likelihood(links: Links) -> FloatArray:
    """log N(nu; 0, S) (k,).   Eq: engm-16"""
    L_inv = links.L_inv
    log_root = np.log(np.diagonal(L_inv, axis1=1, axis2=2)).sum(axis=1) - 0.5 * L_inv.shape[1] * math.log(2 * math.pi)
    return np.asarray(log_root[links.row] - 0.5 * distance2(links))


def distance2(links: Links) -> FloatArray:
    """nu' S^-1 nu (k,)."""
    white = np.einsum("kab,kb->ka", links.L_inv[links.row], links.nu)
    return np.asarray(np.einsum("ka,ka->k", white, white))


def update(x: FloatArray, P: FloatArray, links: Links, which: IntArray, R: FloatArray) -> tuple[FloatArray, FloatArray]:
    """States and covariances of the pairs `which` (n,), in Joseph's form.   Eq: engm-20, engm-21, engm-22"""
    rows, back = np.unique(links.row[which], return_inverse=True)
    H, L_inv, of = links.H[rows], links.L_inv[rows], links.of[rows]
    K = P[of] @ H.transpose(0, 2, 1) @ (L_inv.transpose(0, 2, 1) @ L_inv)
    less = np.eye(x.shape[1]) - K @ H
    after = less @ P[of] @ less.transpose(0, 2, 1) + K @ R[links.noise[rows]] @ K.transpose(0, 2, 1)
    after = (after + after.transpose(0, 2, 1)) / 2
    states = x[links.i[which]] + np.einsum("nsz,nz->ns", K[back], links.nu[which])
    return states, after[back]


def all_pairs(n: int, m: int) -> tuple[IntArray, IntArray]:
    """Every component with every measurement."""
    return np.repeat(np.arange(n), m), np.tile(np.arange(m), n)


def gated(
    x: FloatArray, P: FloatArray, readings: Readings, t_ns: int, own_s: FloatArray, p_gate: float
) -> tuple[IntArray, IntArray]:
    """Pairs whose innovation lies in the ellipse of S that holds p_gate of a Gaussian, ordered by component.

    First a disc about each component that no such measurement lies outside of, to first order of its angles.
    """
    if len(x) == 0 or len(readings) == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    axes = x.shape[1] // 2
    limit = 2.0 * float(gammaincinv(axes / 2, p_gate))  # quantile of chi squared
    place = sensing.locate(readings.kind, readings.z) + readings.sensor_m
    J = sensing.jacobian(readings.kind, place - readings.sensor_m)
    back = np.linalg.inv(J)
    R = back @ readings.R[readings.noise] @ back.transpose(0, 2, 1)
    spread = np.trace(P[:, :axes, :axes], axis1=1, axis2=2)
    later_s = (readings.t_ns - t_ns) * 1e-9
    late = float(np.abs(later_s).max(initial=0.0))
    noise = np.trace(R, axis1=1, axis2=2)
    slack = late * np.sqrt(np.trace(P[:, axes:, axes:], axis1=1, axis2=2) * limit)
    found = []
    step = max(1, BLOCK // len(place))
    for first in range(0, len(x), step):
        some = slice(first, first + step)
        reach2 = 4.0 * limit * (spread[some, None] + noise[None])
        gap2 = np.zeros(reach2.shape)
        for a in range(axes):
            gap2 += (place[None, :, a] - x[some, None, a] - later_s[None] * x[some, None, axes + a]) ** 2
        i, j = np.nonzero(gap2 <= (np.sqrt(reach2) + 2.0 * slack[some, None]) ** 2)
        i += first
        inside = distance2(link(x, P, readings, i, j, t_ns, own_s)) <= limit
        found.append((i[inside], j[inside]))
    return np.concatenate([i for i, _ in found]), np.concatenate([j for _, j in found])


def weighed(
    prior: Intensity, seen: Readings, scan: Scan, points: Points, t_ns: int, config: Config
) -> tuple[FloatArray, Links, FloatArray, FloatArray]:
    """P_D (n,) of Gaussians, their pairs with measurements, the pairs' log weights, the clutter's shares."""
    own_s = intensity.own_time(prior, scan, points, t_ns)
    p_detect = readings.visible(scan, prior.x, config)
    if config.intensity.gate == "none":
        i, j = all_pairs(len(prior), len(seen))
    else:
        i, j = gated(prior.x, prior.P, seen, t_ns, own_s, config.model.p_gate)
    pairs = link(prior.x, prior.P, seen, i, j, t_ns, own_s)
    with np.errstate(divide="ignore"):  # what is out of sight has no weight
        log_detected = np.log(p_detect * prior.w)
    log_w, unexplained = intensity.shares(log_detected[i] + log_likelihood(pairs), seen.log_kappa, j)
    return p_detect, pairs, log_w, unexplained
