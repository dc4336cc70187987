"""Centroids in the gates of vessels, and how far apart the echoes are that each vessel was seen with.

The centroid of a cluster lies about the vessel by what is not known of its place, by the noise of the measurement and
by the dispersion of the echoes that the scan before found in the vessel's gate.
"""

from __future__ import annotations

import math

import numpy as np

from maritrack.centroidsettings import CentroidConfig
from maritrack.objects import matrix2
from maritrack.objects.giw import Giw, Pairs, segment_sums
from maritrack.objects.strips import strips
from maritrack.types import Clusters, FloatArray, IntArray, Points

BLOCK = 500_000  # pairs of a vessel and a centroid looked at together


def paired(
    d: Giw, dispersion_m2: FloatArray, t_ns: IntArray, z_m: FloatArray, R: FloatArray, clusters: Clusters,
    limit: float, rules: CentroidConfig,
) -> tuple[Pairs, FloatArray]:  # fmt: skip
    """Vessels and the centroids z_m (c, 2) of noise R (c, 2, 2) in their gates, and the seconds (k,) between the two.

    First a rectangle of `gate_sigmas` on each side, then the ellipse of squared distance `limit`, both by
    S = H P H' + R + S_D.   Eq: dataset-3, dataset-4, dataset-6, dataset-7
    """
    n, c = len(d), len(z_m)
    spread = d.P[:, :2, :2] + dispersion_m2
    if n * c <= BLOCK:
        i, j = np.divmod(np.arange(n * c), max(c, 1))
    else:
        widest = float((R[:, 0, 0] + R[:, 1, 1]).max())
        late_s = float(np.abs(clusters.t_ns[None, :] - t_ns[[t_ns.argmin(), t_ns.argmax()], None]).max()) * 1e-9
        speed = np.hypot(d.x[:, 2], d.x[:, 3])
        reach_m = rules.gate_sigmas * math.sqrt(2.0) * np.sqrt(spread[:, 0, 0] + spread[:, 1, 1] + widest)
        blocks = strips(d.x[:, :2], reach_m + late_s * speed, z_m, most_pairs=BLOCK)
        near = [_in_gate(d, spread, t_ns, z_m, R, clusters, *_all(*block), limit, rules) for block in blocks]
        i, j = (np.concatenate([part[side] for part in near]) for side in (0, 1))
        order = np.lexsort((j, i))
        i, j = i[order], j[order]
    i, j = _in_gate(d, spread, t_ns, z_m, R, clusters, i, j, limit, rules)
    nu, dt_s = _innovation(d, t_ns, z_m, clusters, i, j)
    S = spread[i] + R[j]
    return Pairs(i, j, nu, d.P[i][:, :, :2], dispersion_m2[i] + R[j], S, matrix2.inverse(S)), dt_s


def _all(rows: IntArray, columns: IntArray) -> tuple[IntArray, IntArray]:
    return np.repeat(rows, len(columns)), np.tile(columns, len(rows))


def _innovation(
    d: Giw, t_ns: IntArray, z_m: FloatArray, clusters: Clusters, i: IntArray, j: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Innovations (k, 2) at the time of the cluster, and the seconds (k,) from the vessel's time to it."""
    dt_s = (clusters.t_ns[j] - t_ns[i]).astype(np.float64) * 1e-9
    return z_m[j] - d.x[i, :2] - dt_s[:, None] * d.x[i, 2:], dt_s


def _in_gate(
    d: Giw, spread: FloatArray, t_ns: IntArray, z_m: FloatArray, R: FloatArray, clusters: Clusters, i: IntArray,
    j: IntArray, limit: float, rules: CentroidConfig,
) -> tuple[IntArray, IntArray]:  # fmt: skip
    nu, _ = _innovation(d, t_ns, z_m, clusters, i, j)
    S = spread[i] + R[j]
    sides = rules.gate_sigmas * np.sqrt(np.stack([S[:, 0, 0], S[:, 1, 1]], axis=1))
    within = (np.abs(nu) <= sides).all(axis=1)
    i, j, nu, S = i[within], j[within], nu[within], S[within]
    inside = matrix2.form(matrix2.inverse(S), nu) < limit
    return i[inside], j[inside]


def dispersion(
    before_m2: FloatArray, pairs: Pairs, dt_s: FloatArray, d: Giw, points: Points, clusters: Clusters, limit: float,
    rules: CentroidConfig,
) -> FloatArray:  # fmt: skip
    """Covariances (n, 2, 2) of the points in each vessel's gate, out of the clusters whose centroid is in it.

    Points in several gates count for each. Of fewer than two points the one before is kept, less its decay.
    Eq: dataset-5
    """
    pair, nu = _in_gates(pairs, dt_s, d, points, clusters, limit)
    count, found = _covariance(pairs.i[pair], nu, len(d))
    return np.where((count >= 2.0)[:, None, None], found, rules.dispersion_decay * before_m2)


def bodies(
    before_m2: FloatArray, pairs: Pairs, dt_s: FloatArray, d: Giw, points: Points, clusters: Clusters, limit: float,
    rules: CentroidConfig, *, R: FloatArray, weight: FloatArray, passed_s: FloatArray,
) -> FloatArray:  # fmt: skip
    """Covariances (n, 2, 2) of what each vessel's body spreads its points in the gate by, passed_s (n,) later.

    Reading: dataset-5 "assumed to have originated from the target's body": clusters count by their weights (k,), the
    noise R (c, 2, 2) that spreads the points of a body of no size is taken off, and as bodies do not change with what
    is seen of them, the one before is forgotten in `dispersion_memory_s`. Eq. 5 as it stands holds two bodies in the
    gate for one as wide as they are apart, which holds both in the gate ever after.
    """
    pair, nu = _in_gates(pairs, dt_s, d, points, clusters, limit)
    count, found = _covariance(pair, nu, len(pairs.i))
    mean = segment_sums(pair, nu, len(pairs.i)) / np.maximum(count, 1.0)[:, None]
    share = np.where(count > 0.0, weight, 0.0)
    seen = np.bincount(pairs.i, share, minlength=len(d))
    share = share / np.where(seen > 0.0, seen, 1.0)[pairs.i]
    off = mean - segment_sums(pairs.i, share[:, None] * mean, len(d))[pairs.i]
    spread = found + off[:, :, None] * off[:, None, :] - R[pairs.j]
    body = segment_sums(pairs.i, share[:, None] * spread.reshape(-1, 4), len(d)).reshape(-1, 2, 2)
    body = matrix2.clip_eigenvalues(body, 0.0, np.inf)
    learned = seen if rules.dispersion_memory_s == 0.0 else -seen * np.expm1(-passed_s / rules.dispersion_memory_s)
    return np.asarray(before_m2 + learned[:, None, None] * (body - before_m2))


def _in_gates(
    pairs: Pairs, dt_s: FloatArray, d: Giw, points: Points, clusters: Clusters, limit: float
) -> tuple[IntArray, FloatArray]:
    """Pair (p,) and offset (p, 2) from the vessel of each point of a pair's cluster that is itself in the gate."""
    order = np.argsort(clusters.label, kind="stable")
    first = np.searchsorted(clusters.label[order], np.arange(len(clusters)))
    size = clusters.count[pairs.j]
    pair = np.repeat(np.arange(len(size)), size)
    nth = np.arange(len(pair)) - np.repeat(np.cumsum(size) - size, size)
    point = order[first[pairs.j[pair]] + nth]
    at = d.x[pairs.i, :2] + dt_s[:, None] * d.x[pairs.i, 2:]
    nu = points.position_m[point] - at[pair]
    inside = matrix2.form(pairs.S_inv[pair], nu) < limit
    return pair[inside], nu[inside]


def _covariance(i: IntArray, nu: FloatArray, n: int) -> tuple[FloatArray, FloatArray]:
    """Number (n,) and covariance (n, 2, 2) of the offsets nu (p, 2) of each i (p,), which is ordered."""
    rows = np.column_stack([np.ones(len(nu)), nu, nu[:, 0] ** 2, nu[:, 0] * nu[:, 1], nu[:, 1] ** 2])
    sums = segment_sums(i, rows, n)
    count = np.maximum(sums[:, 0], 1.0)
    mean, square = sums[:, 1:3] / count[:, None], sums[:, [3, 4, 4, 5]].reshape(-1, 2, 2) / count[:, None, None]
    return sums[:, 0], square - mean[:, :, None] * mean[:, None, :]
