"""Which clusters lie in the gate of which objects."""

from __future__ import annotations

import numpy as np

from maritrack.objects import matrix2
from maritrack.objects.giw import Giw, predicted_centroid
from maritrack.objects.strips import strips
from maritrack.tracksettings import ModelConfig
from maritrack.types import Clusters, FloatArray, IntArray

BLOCK = 500_000  # pairs of an object and a cluster looked at together
CROWD = 256  # clusters near an object, on average, from which on all pairs of a block are asked at once
NEAREST = 64  # clusters an object may choose from


def gate(
    d: Giw, clusters: Clusters, t_ns: IntArray, limit: float, model: ModelConfig
) -> tuple[IntArray, IntArray, FloatArray, int]:
    """Pairs (i, j) whose centroid lies in the gate, full extent counted.   Eq: polar-12

    Also the seconds (k,) from each object's time t_ns (n,) to its cluster's, and how many pairs were cut because
    an object had more than 64 clusters in its gate; the nearest stay. Objects are taken in blocks: memory is
    bounded.
    """
    n, c = len(d), len(clusters)
    if n * c <= BLOCK:
        return _gate_block(d, clusters, t_ns, np.arange(n), np.arange(c), limit, model)
    reach_m = _reach(d, clusters, t_ns, limit, model)
    strip = strips(d.x[:, :2], reach_m, clusters.mean_m, most_pairs=BLOCK)
    blocks = [_gate_block(d, clusters, t_ns, rows, columns, limit, model) for rows, columns in strip]
    i, j, dt_s = (np.concatenate([block[part] for block in blocks]) for part in range(3))
    order = np.lexsort((j, i))
    return i[order], j[order], dt_s[order], sum(block[3] for block in blocks)


def _reach(d: Giw, clusters: Clusters, t_ns: IntArray, limit: float, model: ModelConfig) -> FloatArray:
    """Distance (n,) beyond which no cluster can be in the gate of an object, whenever it was seen."""
    first, last = float(clusters.t_ns.min() - t_ns.max()), float(clusters.t_ns.max() - t_ns.min())
    dt_s = max(abs(first), abs(last)) * 1e-9
    spread = d.P[:, 0, 0] + d.P[:, 1, 1] + model.rho * (d.X[:, 0, 0] + d.X[:, 1, 1])
    noise = float((clusters.noise_m2[:, 0, 0] + clusters.noise_m2[:, 1, 1]).max())
    slack = dt_s * np.sqrt(d.P[:, 2, 2] + d.P[:, 3, 3])
    bound_m = np.sqrt(spread + noise) + slack + model.centroid_sigma_m * 2
    return np.asarray(dt_s * np.hypot(d.x[:, 2], d.x[:, 3]) + np.sqrt(limit) * bound_m * (1.0 + 1e-9) + 1e-6)


def _gate_block(
    d: Giw, clusters: Clusters, t_ns: IntArray, rows: IntArray, columns: IntArray, limit: float, model: ModelConfig
) -> tuple[IntArray, IntArray, FloatArray, int]:
    """The same for the objects `rows` and the clusters `columns`, all pairs of them."""
    z, R, x, P, X = clusters.mean_m[columns], clusters.noise_m2[columns], d.x[rows], d.P[rows], d.X[rows]
    dt = (clusters.t_ns[columns][None, :] - t_ns[rows, None]).astype(np.float64) * 1e-9
    offset = z[None] - x[:, None, :2]
    offset -= dt[..., None] * x[:, None, 2:]
    spread = P[:, 0, 0] + P[:, 1, 1] + model.rho * (X[:, 0, 0] + X[:, 1, 1])
    slack = np.abs(dt) * np.sqrt(P[:, 2, 2] + P[:, 3, 3])[:, None]
    bound = (np.sqrt(spread[:, None] + (R[:, 0, 0] + R[:, 1, 1])[None]) + slack + model.centroid_sigma_m * 2) ** 2
    share = (offset[..., 0] ** 2 + offset[..., 1] ** 2) / (limit * bound)  # beyond 1 it can't be in the gate
    near, cut = share <= 1.0, 0
    if len(columns) > NEAREST and np.count_nonzero(near) > CROWD * len(
        x
    ):  # asking pair by pair would cost more than asking all
        of_all = _distance_of_all(offset, dt, P, model.rho * X, R, model.centroid_sigma_m)
        near &= of_all <= limit
        nearest = near & (of_all <= np.partition(of_all, NEAREST - 1, axis=1)[:, NEAREST - 1, None])
        cut, near = int(near.sum() - nearest.sum()), nearest
    i, j = np.nonzero(near)
    dt_s, nu = dt[i, j], offset[i, j]
    S = predicted_centroid(d, rows[i], dt_s) + model.rho * X[i] + R[j] + model.centroid_sigma_m**2 * np.eye(2)
    distance = matrix2.form(matrix2.inverse(S), nu)
    inside = distance <= limit
    i, j, dt_s, distance = i[inside], j[inside], dt_s[inside], distance[inside]
    if len(i) and np.bincount(i).max() > NEAREST:
        order = np.lexsort((distance, i))
        first = np.searchsorted(i[order], i[order])
        kept = np.sort(order[np.arange(len(order)) - first < NEAREST])
        cut += len(i) - len(kept)
        i, j, dt_s = i[kept], j[kept], dt_s[kept]
    return rows[i], columns[j], dt_s, cut


def _distance_of_all(
    offset: FloatArray, dt: FloatArray, P: FloatArray, spread: FloatArray, R: FloatArray, sigma_m: float
) -> FloatArray:
    """Squared Mahalanobis distances (n, c) of all pairs of a block, entry by entry of the 2 x 2 matrices."""

    def entry(a: int, b: int) -> FloatArray:
        still, cross, fast = P[:, a, b] + spread[:, a, b], P[:, a, b + 2] + P[:, a + 2, b], P[:, a + 2, b + 2]
        return np.asarray(still[:, None] + dt * cross[:, None] + dt * dt * fast[:, None] + R[None, :, a, b])

    ee, en, nn = entry(0, 0) + sigma_m**2, entry(0, 1), entry(1, 1) + sigma_m**2
    e, n = offset[..., 0], offset[..., 1]
    return np.asarray((nn * e * e - 2.0 * en * e * n + ee * n * n) / (ee * nn - en * en))
