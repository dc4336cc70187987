"""Objects that give many points of a scan: hulls with a Gaussian-process contour, or ellipses of a random matrix.

What the mixture asks of either: how it moves, whose gate a point is in, what a set of points makes of it and how
likely that was, and how it looks to first order, for the search of associations.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import gammaln

from maritrack.contoursettings import ContourConfig
from maritrack.objects import contour, giw, iekf, matrix2
from maritrack.objects.giw import Giw
from maritrack.settings import Config
from maritrack.trackers.bernoullis import Bernoullis
from maritrack.types import BoolArray, Clusters, FloatArray, IntArray

PAIRS = 50_000  # of an object and a point looked at together


@dataclass(frozen=True, slots=True, eq=False)
class Sets:
    """Sets of points (k, n), padded."""

    z: FloatArray  # (k, n, 2)
    R: FloatArray  # (k, n, 2, 2) noise
    use: BoolArray  # (k, n)

    @property
    def count(self) -> FloatArray:
        """Points of each (k,)."""
        return np.asarray(self.use.sum(axis=1), np.float64)


class Linear(Protocol):
    """Objects about a fit: see `maritrack.associate.sampling`."""


class PointModel(Protocol):
    """An object and its points. `Bernoullis` here are rows of single objects, of which densities alone count."""

    @property
    def states(self) -> int:
        """Of a hull, 0 where the track list says all."""

    def predict(self, rows: Bernoullis, dt_s: FloatArray) -> Bernoullis:
        """Rows dt_s (n,) later."""

    def distance2(self, rows: Bernoullis, i: IntArray, z: FloatArray, R: FloatArray) -> FloatArray:
        """Squared distances (k,) of points z (k, 2) from rows i (k,), in standard deviations."""

    def reach_m(self, rows: Bernoullis, limit: float) -> FloatArray:
        """Distance (n,) from the centre beyond which no point is in the gate."""

    def fit(self, rows: Bernoullis, sets: Sets, sensor_m: FloatArray, headings: int) -> tuple[Bernoullis, FloatArray]:
        """Rows (k,) given their sets, and the log of how likely those points were, m^-2 each."""

    def linear(
        self, rows: Bernoullis, fitted: Bernoullis, z: FloatArray, R: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """A (k, n, 2, d), y (k, n, 2), log of the noise's density (k, n), prior information, about the fits."""

    def newborn(self, rows: Bernoullis, at_m: FloatArray, sigma_m: float, sigma_mps: float) -> Bernoullis:
        """Rows of new objects around places (k, 2), all else of the rows as it is."""


def gated(model: PointModel, rows: Bernoullis, z: FloatArray, R: FloatArray, limit: float) -> tuple[IntArray, IntArray]:
    """Rows and points (k,) that are within the gate of each other, in blocks."""
    none = np.zeros(0, np.int64)
    if len(rows) == 0 or len(z) == 0:
        return none, none
    tree, reach = cKDTree(z), model.reach_m(rows, limit)
    found_i, found_j = [], []
    begin = 0
    count = tree.query_ball_point(rows.tracks.density.x[:, :2], reach, return_length=True)
    ends = np.cumsum(count)
    while begin < len(rows):
        base = ends[begin - 1] if begin else 0
        end = max(int(np.searchsorted(ends, base + PAIRS, side="right")), begin + 1)
        near = tree.query_ball_point(rows.tracks.density.x[begin:end, :2], reach[begin:end], return_sorted=True)
        i = np.repeat(np.arange(begin, end), [len(one) for one in near])
        j = np.concatenate([np.asarray(one, np.int64) for one in near]) if len(i) else none
        good = model.distance2(rows, i, z[j], R[j]) <= limit
        found_i.append(i[good])
        found_j.append(j[good])
        begin = end
    return np.concatenate(found_i), np.concatenate(found_j)


@dataclass(frozen=True, slots=True)
class HullModel:
    """A contour by a Gaussian process."""

    config: Config

    @property
    def rules(self) -> ContourConfig:
        """Settings of the contour."""
        return self.config.contour

    @property
    def states(self) -> int:
        """Kinematics and radii."""
        return contour.FIXED + self.rules.angles

    def predict(self, rows: Bernoullis, dt_s: FloatArray) -> Bernoullis:
        """Constant velocity and turn rate."""
        x, P = contour.predict(rows.x, rows.P, dt_s, self.rules, self.config.model.accel_psd_m2ps3)
        return self._shown(replace(rows, x=x, P=P))

    def reach_m(self, rows: Bernoullis, limit: float) -> FloatArray:
        """Longest radius, and the uncertainty of place and radius."""
        sigma2 = matrix2.eigen(rows.P[:, :2, :2])[0][:, 0] + np.einsum("nii->ni", rows.P)[:, contour.FIXED :].max(
            axis=1
        )
        longest = np.maximum(rows.x[:, contour.FIXED :].max(axis=1), 0.0) * 1.2 + 1.0
        return np.asarray(longest + np.sqrt(limit * (2.0 * sigma2 + self.rules.sigma_point_m**2)))

    def distance2(self, rows: Bernoullis, i: IntArray, z: FloatArray, R: FloatArray) -> FloatArray:
        """Of the point from the outline, along the ray from the centre."""
        found = contour.residuals(rows.x[i], z[:, None], self.rules)
        H = found.H[:, 0]
        S = H @ rows.P[i] @ H.transpose(0, 2, 1) + found.var[:, 0, :, None] * np.eye(2)
        return np.asarray(matrix2.inverse(S)[:, 0, 0] * found.e[:, 0] ** 2)

    def fit(self, rows: Bernoullis, sets: Sets, sensor_m: FloatArray, headings: int) -> tuple[Bernoullis, FloatArray]:
        """The iterated filter, of many points by some of them, spread over the bearings."""
        most, count = self.rules.most_points, sets.count
        z, use = sets.z, sets.use
        if 0 < most < z.shape[1]:
            pick = np.rint(np.linspace(0.0, 1.0, most) * (count[:, None] - 1.0)).astype(np.int64)
            few = count[:, None] <= most
            order = np.argsort(~use, axis=1, kind="stable")
            place = np.where(few, np.arange(most), np.maximum(pick, 0))
            at = np.take_along_axis(order, place, axis=1)
            z = np.take_along_axis(z, at[..., None], axis=1)
            use = np.take_along_axis(use, at, axis=1) & (~few | (np.arange(most) < count[:, None]))
        start = iekf.starts(rows.x, rows.P, z, use, sensor_m, headings, self.rules)
        found = iekf.fit(rows.x, rows.P, z, use, start, self.rules)
        more = count - use.sum(axis=1)  # those that were left out weigh as the others do on the fit
        log_l = found.log_likelihood
        if more.any():
            each = iekf.log_on_hull(found.x, z, self.rules)
            log_l = log_l + more * np.where(use, each, 0.0).sum(axis=1) / np.maximum(use.sum(axis=1), 1)
        return self._shown(replace(rows, x=found.x, P=found.P)), log_l

    def linear(
        self, rows: Bernoullis, fitted: Bernoullis, z: FloatArray, R: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The contour's derivative where the fit is."""
        k = len(rows)
        found = contour.residuals(fitted.x, np.broadcast_to(z, (k, *z.shape)), self.rules)
        A = found.H / np.sqrt(found.var)[..., None]
        e = np.stack([found.e, np.zeros_like(found.e)], axis=-1) / np.sqrt(found.var)
        y = e + np.einsum("knad,kd->kna", A, fitted.x - rows.x)
        log_noise = iekf.log_noise(fitted.x, found, self.rules)
        info = np.linalg.inv(rows.P)
        return A, y, log_noise, (info + info.transpose(0, 2, 1)) / 2

    def newborn(self, rows: Bernoullis, at_m: FloatArray, sigma_m: float, sigma_mps: float) -> Bernoullis:
        """At rest, whatever its heading.

        Reading: extended sec. 4.2 "heading component is pi" and so on are standard deviations.
        """
        x = np.zeros((len(at_m), contour.FIXED))
        x[:, :2] = at_m
        sigma = np.array([sigma_m, sigma_m, sigma_mps, sigma_mps, math.pi, math.pi / 4])
        state, P = contour.newborn(x, sigma, self.rules)
        return self._shown(replace(rows, x=state, P=P))

    def _shown(self, rows: Bernoullis) -> Bernoullis:
        """The rows with the ellipse of their outline in the track list."""
        X = contour.ellipse(contour.polygon(rows.x, self.rules, 24))[1] if len(rows) else np.zeros((0, 2, 2))
        X = matrix2.clip_eigenvalues(X, 1e-2, 1e8)
        density = Giw(
            rows.x[:, :4].copy(), rows.P[:, :4, :4].copy(), X, np.full(len(rows), self.config.model.alpha_max)
        )
        return replace(rows, tracks=replace(rows.tracks, density=density))


@dataclass(frozen=True, slots=True)
class MatrixModel:
    """An ellipse by a random matrix, points all over it (Granstroem, Fatemi, Svensson 2020)."""

    config: Config
    states: int = 0

    def predict(self, rows: Bernoullis, dt_s: FloatArray) -> Bernoullis:
        """As of `maritrack.objects.giw`."""
        return _with(rows, giw.predict(rows.tracks.density, dt_s, self.config.model))

    def reach_m(self, rows: Bernoullis, limit: float) -> FloatArray:
        """Of place and extent together."""
        d = rows.tracks.density
        spread = matrix2.eigen(d.P[:, :2, :2] + self.config.model.rho * d.X)[0][:, 0]
        return np.asarray(np.sqrt(limit * spread) * 1.01 + math.sqrt(limit) * 1.0 + 5.0)

    def distance2(self, rows: Bernoullis, i: IntArray, z: FloatArray, R: FloatArray) -> FloatArray:
        """Of the point from the centre, with the full extent."""
        d = rows.tracks.density
        S = d.P[i, :2, :2] + self.config.model.rho * d.X[i] + R
        return matrix2.form(matrix2.inverse(S), z - d.x[i, :2])

    def fit(self, rows: Bernoullis, sets: Sets, sensor_m: FloatArray, headings: int) -> tuple[Bernoullis, FloatArray]:
        """The update by the set's centroid and scatter, and the predictive likelihood of its points.

        -n ln pi - ln n + (nu-3)/2 ln|V| - (nu+-3)/2 ln|V+| + the gamma functions + n/2 ln|X| - (n-1)/2 ln|Y|
        - 1/2 ln|S|, nu = alpha + 6, V = alpha X.
        """
        d, model, k = rows.tracks.density, self.config.model, len(rows)
        if k == 0:
            return rows, np.zeros(0)
        clusters = _clusters(sets)
        full = replace(model, centroid_n_max=0, cluster_size="count", centroid_sigma_m=0.0)
        index = np.arange(k)
        pairs = giw.pair_up(d, clusters, index, index, np.zeros(k), full)
        V_new, alpha_new = giw.extent_update(d, clusters, pairs, full)
        V_new = V_new * alpha_new[:, None, None]
        n = sets.count
        a, b = d.alpha + 3.0, alpha_new + 3.0
        log_l = (
            -n * math.log(math.pi) - np.log(n)
            + 0.5 * a * np.log(matrix2.det(d.alpha[:, None, None] * d.X)) - 0.5 * b * np.log(matrix2.det(V_new))
            + gammaln(b / 2) + gammaln((b - 1) / 2) - gammaln(a / 2) - gammaln((a - 1) / 2)
            + 0.5 * n * np.log(matrix2.det(d.X)) - 0.5 * (n - 1) * np.log(matrix2.det(pairs.Y))
            - 0.5 * np.log(matrix2.det(pairs.S))
        )  # fmt: skip
        return _with(rows, giw.update(d, clusters, pairs, np.ones(k), np.zeros(k), full)), np.asarray(log_l)

    def linear(
        self, rows: Bernoullis, fitted: Bernoullis, z: FloatArray, R: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """With the extent of the fit as if it were known."""
        d, k, n = rows.tracks.density, len(rows), len(z)
        Y = self.config.model.rho * fitted.tracks.density.X[:, None] + R
        root = np.linalg.inv(np.linalg.cholesky(Y))
        A = np.zeros((k, n, 2, 4))
        A[..., :2] = root
        y = (root @ (z - d.x[:, None, :2])[..., None])[..., 0]
        log_noise = -math.log(2.0 * math.pi) + np.log(root[..., 0, 0]) + np.log(root[..., 1, 1])
        return A, y, np.asarray(log_noise), np.asarray(np.linalg.inv(d.P), np.float64)

    def newborn(self, rows: Bernoullis, at_m: FloatArray, sigma_m: float, sigma_mps: float) -> Bernoullis:
        """At rest, an ellipse of the contour's length and width, round."""
        k, model, outline = len(at_m), self.config.model, self.config.contour
        x = np.concatenate([at_m, np.zeros((k, 2))], axis=1)
        P = np.broadcast_to(np.diag([sigma_m**2, sigma_m**2, sigma_mps**2, sigma_mps**2]), (k, 4, 4)).copy()
        half2 = max(outline.length_m * outline.width_m / 4.0, model.min_axis_m**2)
        X = np.broadcast_to(half2 * np.eye(2), (k, 2, 2)).copy()
        return _with(rows, Giw(x, P, X, np.full(k, model.alpha_birth)))


def _with(rows: Bernoullis, density: Giw) -> Bernoullis:
    return replace(rows, tracks=replace(rows.tracks, density=density))


def _clusters(sets: Sets) -> Clusters:
    """Sets of points as clusters: centroid, scatter, noise."""
    n, w = sets.count, sets.use.astype(np.float64)
    mean = (sets.z * w[..., None]).sum(axis=1) / n[:, None]
    gap = (sets.z - mean[:, None]) * w[..., None]
    noise = (sets.R * w[..., None, None]).sum(axis=1) / n[:, None, None]
    k, none = len(n), np.zeros(len(n))
    return Clusters(
        mean_m=mean, scatter_m2=gap.transpose(0, 2, 1) @ gap, count=n.astype(np.int64), weight_sq=1.0 / n,
        noise_m2=noise, t_ns=np.zeros(k, np.int64), range_m=none, azimuth_rad=none, intensity=none,
        label=np.zeros(0, np.int64),
    )  # fmt: skip
