"""Random-matrix model of an extended object: Gaussian kinematics, inverse-Wishart extent.

Feldmann, Fraenken, Koch 2011, in the mean parametrisation: extent X (mean) with alpha degrees of freedom
(alpha = nu - 6 of the textbook). A point scatters with rho X + R about the centre; with rho = 1/4 the
ellipse {u: u' X^-1 u <= 1} is filled evenly. `extent = "point"` is the same model with X = 0: the
Kalman filter of a point object. Constant velocity, state [east, north, vel_east, vel_north].
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaln

from maritrack.objects import matrix2
from maritrack.tracksettings import ModelConfig
from maritrack.types import Clusters, FloatArray, IntArray

EYE4 = np.eye(4)


@dataclass(frozen=True, slots=True, eq=False)
class Giw:
    """Densities of n objects."""

    x: FloatArray  # (n, 4)
    P: FloatArray  # (n, 4, 4)
    X: FloatArray  # (n, 2, 2) m^2, zero for points
    alpha: FloatArray  # (n,)

    def __len__(self) -> int:
        return len(self.x)


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """Pairs of an object and a cluster, ordered by object, and what both the weight and the update need."""

    i: IntArray  # (k,) object
    j: IntArray  # (k,) cluster
    nu: FloatArray  # (k, 2) innovation
    PHt: FloatArray  # (k, 4, 2)
    Y: FloatArray  # (k, 2, 2) rho X + R, spread of a point
    S: FloatArray  # (k, 2, 2) of the centroid
    S_inv: FloatArray  # (k, 2, 2)


def predict(d: Giw, dt_s: FloatArray, model: ModelConfig) -> Giw:
    """Densities after dt_s (n,) seconds; the extent keeps its mean and forgets with its time constant."""
    F = np.broadcast_to(EYE4, (len(d), 4, 4)).copy()
    F[:, 0, 2] = F[:, 1, 3] = dt_s
    P = F @ d.P @ F.transpose(0, 2, 1)
    q = model.accel_psd_m2ps3
    for axis in (0, 1):
        P[:, axis, axis] += q * dt_s**3 / 3
        P[:, axis, axis + 2] += q * dt_s**2 / 2
        P[:, axis + 2, axis] += q * dt_s**2 / 2
        P[:, axis + 2, axis + 2] += q * dt_s
    x = d.x.copy()
    x[:, :2] += dt_s[:, None] * d.x[:, 2:]
    alpha = 2.0 + np.exp(-dt_s / model.extent_time_constant_s) * (d.alpha - 2.0)
    return Giw(x, P, d.X, alpha)


def smooth(d: Giw, later: Giw, dt_s: FloatArray, model: ModelConfig) -> Giw:
    """Densities with the use of what came later: one step back of a fixed-interval smoother.

    `d` are filtered densities, `later` the smoothed ones of the same objects dt_s (n,) seconds after. The state
    is the Rauch-Tung-Striebel smoother of the constant-velocity model, exact where the updates were Kalman's; of a
    mixture that was moment-matched it is the smoother of the Gaussian in its place.

    The extent is an inverse Wishart with natural parameters alpha and V = alpha X. What the future adds to the
    predicted ones counts less by the factor with which `predict` forgets, f = exp(-dt / tau), as it does forwards:
    alpha_s = alpha + f (alpha_later - alpha_predicted), V_s = V + f (V_later - V_predicted). V_predicted is
    alpha_predicted X, so V_s = (alpha - f alpha_predicted) X + f V_later, a mean with weights that are not negative.
    Without forgetting all extents are the last one: that of a rigid object with all its clusters.
    """
    ahead = predict(d, dt_s, model)
    F = np.broadcast_to(EYE4, (len(d), 4, 4)).copy()
    F[:, 0, 2] = F[:, 1, 3] = dt_s
    back = np.linalg.solve(ahead.P, F @ d.P).transpose(0, 2, 1)  # P F' P_ahead^-1
    x = d.x + np.einsum("nij,nj->ni", back, later.x - ahead.x)
    P = d.P + back @ (later.P - ahead.P) @ back.transpose(0, 2, 1)
    P = (P + P.transpose(0, 2, 1)) / 2
    if model.extent == "point":
        return Giw(x, P, d.X, d.alpha)
    fade = np.exp(-dt_s / model.extent_time_constant_s)
    own = d.alpha - fade * ahead.alpha
    alpha = own + fade * later.alpha
    X = (own[:, None, None] * d.X + (fade * later.alpha)[:, None, None] * later.X) / alpha[:, None, None]
    return Giw(x, P, X, alpha)


def birth(clusters: Clusters, model: ModelConfig) -> Giw:
    """New objects at rest at clusters (c,), the extent from the steady state.   Eq: polar-7"""
    c = len(clusters)
    X0 = np.zeros((c, 2, 2))
    if model.extent == "random-matrix":
        raw = (clusters.scatter_m2 / clusters.count[:, None, None] - clusters.noise_m2) / model.rho
        X0 = matrix2.clip_eigenvalues(raw, model.min_axis_m**2, model.max_axis_m**2)
    share = centroid_weight(clusters, np.arange(c), model)[:, None, None]
    P = np.zeros((c, 4, 4))
    P[:, :2, :2] = (model.rho * X0 + clusters.noise_m2) * share + model.centroid_sigma_m**2 * np.eye(2)
    if model.extent == "random-matrix":
        P[:, :2, :2] *= 4.0  # "inflated covariance" (polar, sec. II); assumed: by 2 in each axis
    P[:, 2, 2] = P[:, 3, 3] = model.sigma_velocity_mps**2
    x = np.concatenate([clusters.mean_m, np.zeros((c, 2))], axis=1)
    return Giw(x, P, X0, np.full(c, model.alpha_birth))


def centroid_weight(clusters: Clusters, j: IntArray, model: ModelConfig) -> FloatArray:
    """1/n of the centroid's covariance: sum of squared weights, not below 1/centroid_n_max.

    Deviates: polar-11 the default is cluster_size = "effective" and centroid_n_max = 20, the preset `radar` has 1;
    the paper has n_k, "count", without a limit, 0. With equal weights n_k is the effective size.
    """
    least = 1.0 / model.centroid_n_max if model.centroid_n_max > 0 else 0.0
    return np.maximum(weight_sq(clusters, j, model), least)


def weight_sq(clusters: Clusters, j: IntArray, model: ModelConfig) -> FloatArray:
    """1/n of clusters j (k,): the sum of squared weights, or of the count of points whatever their weights."""
    return np.asarray(1.0 / clusters.count[j] if model.cluster_size == "count" else clusters.weight_sq[j])


def predicted_centroid(d: Giw, i: IntArray, dt_s: FloatArray) -> FloatArray:
    """H P H' (k, 2, 2) of objects i at dt_s (k,) seconds from their time."""
    P, t = d.P[i], dt_s[:, None, None]
    cross = P[:, :2, 2:]
    return np.asarray(P[:, :2, :2] + t * (cross + cross.transpose(0, 2, 1)) + t * t * P[:, 2:, 2:])


def pair_up(d: Giw, clusters: Clusters, i: IntArray, j: IntArray, dt_s: FloatArray, model: ModelConfig) -> Pairs:
    """Innovations and their covariances for pairs, dt_s (k,).   Eq: polar-11

    H = [I, dt I]: a cluster of another time than the density's sees the object moved on by its velocity.
    """
    P, t = d.P[i], dt_s[:, None, None]
    PHt = P[:, :, :2] + t * P[:, :, 2:]
    Y = model.rho * d.X[i] + clusters.noise_m2[j]
    share = centroid_weight(clusters, j, model)[:, None, None]
    S = PHt[:, :2] + t * PHt[:, 2:] + Y * share + model.centroid_sigma_m**2 * np.eye(2)
    nu = clusters.mean_m[j] - d.x[i, :2] - dt_s[:, None] * d.x[i, 2:]
    return Pairs(i, j, nu, PHt, Y, S, matrix2.inverse(S))


def log_centroid(pairs: Pairs) -> FloatArray:
    """log N(centroid; H x, S) of each pair (k,), per m^2."""
    return np.asarray(
        -np.log(2 * np.pi) - 0.5 * np.log(matrix2.det(pairs.S)) - 0.5 * matrix2.form(pairs.S_inv, pairs.nu)
    )


def log_shape_ratio(d: Giw, clusters: Clusters, pairs: Pairs, V0: FloatArray, model: ModelConfig) -> FloatArray:
    """Log likelihood ratio of the cluster's scatter, object against clutter, of each pair (k,).

    V0 (c, 2, 2) is the clutter's scatter a point. `plugin`: ratio of Wisharts, in which normalisers and |Z|
    cancel, so that it is finite for singular scatter and 0 for one point.   Eq: polar-10
    `predictive`: both scatters integrated over inverse Wisharts. `none`: 0. `shape_n_max` limits the degrees
    of freedom.   Deviates: polar-10 the default is `predictive` with shape_n_max = 10; the paper has `plugin` and 0.
    """
    if model.shape == "none" or model.extent == "point":
        return np.zeros(len(pairs.i))
    count = clusters.count[pairs.j].astype(np.float64)
    dof = count * (1.0 - weight_sq(clusters, pairs.j, model))  # n - 1 with equal weights
    kept = np.minimum(dof, model.shape_n_max) if model.shape_n_max > 0 else dof
    scale = np.divide(kept, dof, out=np.zeros_like(dof), where=dof > 0)
    Z = clusters.scatter_m2[pairs.j] * scale[:, None, None]
    V1, V0 = pairs.Y, V0[pairs.j]
    if model.shape == "plugin":
        inv1, inv0 = matrix2.inverse(V1), matrix2.inverse(V0)
        log_dets = np.log(matrix2.det(V0)) - np.log(matrix2.det(V1))
        return np.asarray(0.5 * kept * log_dets - 0.5 * matrix2.trace_product(inv1 - inv0, Z))
    clutter_alpha = np.full(len(kept), 4.0)  # assumed: clutter shapes vary as much as those of new tracks
    return _log_marginal(Z, kept, V1, d.alpha[pairs.i]) - _log_marginal(Z, kept, V0, clutter_alpha)


def _log_marginal(Z: FloatArray, m: FloatArray, Y: FloatArray, alpha: FloatArray) -> FloatArray:
    """Log density of a scatter Z of m degrees of freedom, up to a term in Z and m alone."""
    a, aY = (alpha + 3.0) / 2.0, alpha[:, None, None] * Y
    gamma = _log_gamma2(a + m / 2.0) - _log_gamma2(a)
    return np.asarray(a * np.log(matrix2.det(aY)) - (a + m / 2.0) * np.log(matrix2.det(aY + Z)) + gamma)


def _log_gamma2(a: FloatArray) -> FloatArray:
    """Log of the bivariate gamma function, up to a constant."""
    return np.asarray(gammaln(a) + gammaln(a - 0.5))


def clutter_scatter(clusters: Clusters, sensor_m: FloatArray, eps_m: float, radius_m: float) -> FloatArray:
    """Broad scatter V0 (c, 2, 2) of clutter, round in the metric of the clustering.

    Half of eps along range; across it the same number of cells, (r / R) times as many metres. `radius_m` = 0
    says that the clustering was Cartesian: round in metres.
    """
    s2 = (eps_m / 2.0) ** 2
    if radius_m <= 0:
        return np.broadcast_to(s2 * np.eye(2), (len(clusters), 2, 2)).copy()
    offset = clusters.mean_m - sensor_m
    r = np.maximum(np.hypot(offset[:, 0], offset[:, 1]), 1e-9)
    u = np.where(r[:, None] > 1e-6, offset / r[:, None], [0.0, 1.0])
    along = u[:, :, None] * u[:, None, :]
    across = np.eye(2) - along
    stretch = np.maximum(r / radius_m, 1e-3) ** 2
    return np.asarray(s2 * (along + stretch[:, None, None] * across))


def update(
    d: Giw, clusters: Clusters, pairs: Pairs, beta: FloatArray, beta0: FloatArray, model: ModelConfig,
    hidden: FloatArray | None = None,
) -> Giw:  # fmt: skip
    """Moment-matched mixture of the single updates of each object, weights conditioned on existence.

    beta (k,) for pairs, beta0 (n,) for missed. One pair with beta = 1 is the random-matrix update itself;
    with X = 0 it is the Kalman filter, and the mixture is the PDA update. Of an object of which a share `hidden` (n,)
    cannot be seen a cluster is a fragment with that probability, which says where it is, not how large.
    """
    if len(pairs.i) == 0:
        return d
    K = pairs.PHt @ pairs.S_inv
    step = np.einsum("kij,kj->ki", K, pairs.nu)
    shrink = K @ pairs.PHt.transpose(0, 2, 1)
    spread = step[:, :, None] * step[:, None, :] - shrink
    n = len(d)
    rows = np.concatenate([step, spread.reshape(-1, 16)], axis=1) * beta[:, None]
    sums = segment_sums(pairs.i, rows, n)
    x = d.x + sums[:, :4]
    P = d.P + sums[:, 4:].reshape(n, 4, 4) - sums[:, :4, None] * sums[:, None, :4]
    P = (P + P.transpose(0, 2, 1)) / 2
    if model.extent == "point":
        return replace(d, x=x, P=P)
    X_pair, alpha_pair = extent_update(d, clusters, pairs, model)
    if hidden is not None:
        beta, beta0 = beta * (1.0 - hidden[pairs.i]), beta0 + hidden * (1.0 - beta0)
    rows = np.concatenate([X_pair.reshape(-1, 4), alpha_pair[:, None]], axis=1) * beta[:, None]
    sums = segment_sums(pairs.i, rows, n)
    X = beta0[:, None, None] * d.X + sums[:, :4].reshape(n, 2, 2)
    X = matrix2.clip_eigenvalues(X, model.min_axis_m**2, model.max_axis_m**2)
    return Giw(x, P, X, np.minimum(beta0 * d.alpha + sums[:, 4], model.alpha_max))


def extent_update(d: Giw, clusters: Clusters, pairs: Pairs, model: ModelConfig) -> tuple[FloatArray, FloatArray]:
    """Extent (k, 2, 2) and degrees of freedom (k,) of each pair's single update.

    The scatter has n (1 - sum w^2) degrees of freedom (n - 1 with equal weights), the innovation one more.
    """
    X, j = d.X[pairs.i], pairs.j
    dof = clusters.count[j] * (1.0 - weight_sq(clusters, j, model))
    X_root = matrix2.root(X)
    to_extent = X_root @ matrix2.inverse(matrix2.root(pairs.Y))
    Zhat = to_extent @ clusters.scatter_m2[j] @ to_extent.transpose(0, 2, 1)
    u = np.einsum("kij,kj->ki", X_root @ matrix2.inverse(matrix2.root(pairs.S)), pairs.nu)
    alpha, alpha_new = d.alpha[pairs.i], d.alpha[pairs.i] + dof + 1.0
    X_new = (alpha[:, None, None] * X + u[:, :, None] * u[:, None, :] + Zhat) / alpha_new[:, None, None]
    return X_new, alpha_new


def segment_sums(i: IntArray, rows: FloatArray, n: int) -> FloatArray:
    """Sums (n, m) of rows (k, m) by their index i (k,), which must be ordered."""
    out = np.zeros((n, rows.shape[1]))
    if len(i):
        starts = np.flatnonzero(np.concatenate([[True], i[1:] != i[:-1]]))
        out[i[starts]] = np.add.reduceat(rows, starts, axis=0)
    return out
