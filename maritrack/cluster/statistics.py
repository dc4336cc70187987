"""From labelled points to clusters: intensity-weighted centroid and scatter, noise, time, order."""

from __future__ import annotations

import numpy as np

from maritrack import geo
from maritrack.types import Clusters, FloatArray, IntArray, Points, Scan


def cluster_statistics(
    points: Points, label: IntArray, scan: Scan, *, intensity_weighting: bool, noise: tuple[float, float, float],
    scale_db: float = 0.0,
) -> Clusters:  # fmt: skip
    """Clusters of the points that carry a label, ordered by azimuth, then range.

    With weights w = l / sum(l) (l = intensity, or 1): mean = sum w z, scatter = n sum w (z - mean)(z - mean)'.
    A logarithmic video of `scale_db` decibels from 0 to full scale weighs cells by their power: then beam and pulse
    add their own variance to that of a hull, whatever the strength of the echo. `noise` = standard deviations of
    range (m), azimuth (rad) and of any direction (m) where the points carry no covariance.   Eq: polar-5, polar-6
    """
    n = int(label.max(initial=-1)) + 1
    inside = label >= 0
    at, z = label[inside], points.position_m[inside]
    raw = np.maximum(points.intensity[inside], 0.0) if intensity_weighting else np.ones(len(at))
    total = _sum(at, raw, n)
    if intensity_weighting and scale_db > 0.0:
        raw = 10.0 ** (raw / (2.0**scan.sensor.bits - 1.0) * scale_db / 10.0)
    raw = np.where(total[at] > 0, raw, 1.0)  # a cluster of zeros weighs its points equally
    w = raw / np.bincount(at, raw, n)[at]
    count = np.bincount(at, minlength=n)
    origin = scan.position_m
    mean = _sums(at, w[:, None] * (z - origin), n) + origin
    d = z - mean[at]
    scatter = count[:, None] * _sums(at, w[:, None] * np.stack([d[:, 0] ** 2, d[:, 0] * d[:, 1], d[:, 1] ** 2], 1), n)
    t0 = scan.t_ns
    t_ns = t0 + np.rint(np.bincount(at, w * (points.t_ns[inside] - t0), n)).astype(np.int64)
    range_m, azimuth = geo.en_to_polar(mean - origin)
    if points.cov_m2 is None:
        cov = _noise(range_m, azimuth, noise)
    else:
        cov = _sums(at, (w[:, None] * points.cov_m2[inside].reshape(-1, 4)), n).reshape(-1, 2, 2)
    order = np.lexsort((range_m, azimuth))
    rank = np.empty(n, np.int64)
    rank[order] = np.arange(n)
    clusters = Clusters(
        mean_m=mean,
        scatter_m2=scatter[:, [0, 1, 1, 2]].reshape(-1, 2, 2),
        count=count,
        weight_sq=_sum(at, w * w, n),
        noise_m2=cov,
        t_ns=t_ns,
        range_m=range_m,
        azimuth_rad=azimuth,
        intensity=total,
        label=label,
    )
    return reorder(clusters, order, rank)


def reorder(clusters: Clusters, order: IntArray, rank: IntArray) -> Clusters:
    """Rows `order` of the clusters; `rank` is the new number of each old cluster, -1 = dropped to noise."""
    label = clusters.label
    return Clusters(
        **{
            name: getattr(clusters, name)[order]
            for name in ("mean_m", "scatter_m2", "count", "weight_sq", "noise_m2", "t_ns", "range_m", "azimuth_rad",
                         "intensity")
        },
        label=np.where(label >= 0, np.append(rank, -1)[label], -1),
    )  # fmt: skip


def drop_clusters(clusters: Clusters, keep: np.ndarray) -> Clusters:
    """Only the clusters `keep` (c,) bool; points of the others become noise."""
    if keep.all():
        return clusters
    return reorder(clusters, np.flatnonzero(keep), np.where(keep, np.cumsum(keep) - 1, -1))


def _sum(at: IntArray, values: FloatArray, n: int) -> FloatArray:
    return np.bincount(at, values, n).astype(np.float64)


def _sums(at: IntArray, values: FloatArray, n: int) -> FloatArray:
    return np.stack([np.bincount(at, values[:, i], n) for i in range(values.shape[1])], axis=1)


def _noise(range_m: FloatArray, azimuth_rad: FloatArray, noise: tuple[float, float, float]) -> FloatArray:
    sigma_range, sigma_azimuth, sigma_any = noise
    var_range = np.full(len(range_m), max(sigma_range, sigma_any) ** 2)
    across = np.maximum((range_m * sigma_azimuth) ** 2, sigma_any**2)
    var_azimuth = across / np.maximum(range_m, 1.0) ** 2
    return geo.polar_cov_to_en(np.maximum(range_m, 1.0), azimuth_rad, var_range, var_azimuth)
