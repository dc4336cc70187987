"""The clustering stage: polar or Cartesian DBSCAN, linkages cut at a distance, k-means, or every point for itself."""

from __future__ import annotations

import math

import numpy as np

from maritrack import geo
from maritrack.cluster.dbscan import dbscan
from maritrack.cluster.kmeans import kmeans
from maritrack.cluster.linkage import linkage_labels
from maritrack.cluster.statistics import cluster_statistics, drop_clusters
from maritrack.settings import ClusterConfig, InputConfig
from maritrack.types import Clusters, FloatArray, IntArray, Points, Scan


def cluster_points(points: Points, scan: Scan, config: ClusterConfig, sensor: InputConfig) -> Clusters:
    """Clusters of a scan's points, too small and too long ones dropped to noise."""
    weighting = config.intensity_weighting and config.method != "singletons"
    label = labels(points, scan, config)
    noise = sensor_noise(scan, sensor)
    clusters = cluster_statistics(
        points, label, scan, intensity_weighting=weighting, noise=noise, scale_db=sensor.scale_db
    )
    coarse = scan.sensor.range_res_m >= config.coarse_cell_m
    keep = clusters.count >= (max(config.min_count, config.coarse_min_count) if coarse else config.min_count)
    if math.isfinite(config.max_extent_m) and len(clusters):
        keep &= _length_m(clusters) <= config.max_extent_m
    return drop_clusters(clusters, keep)


def labels(points: Points, scan: Scan, config: ClusterConfig) -> IntArray:
    """Cluster of each point (n,), -1 = noise."""
    if config.method == "singletons":
        return np.arange(len(points))
    if config.method == "kmeans":
        return kmeans(points.position_m, config)
    eps_m = max(config.eps_m, config.eps_cells * scan.sensor.range_res_m)
    if config.method in ("single-linkage", "complete-linkage"):
        return linkage_labels(points.position_m - scan.position_m, distance_m=eps_m, how=config.method)
    xy_m, period_m = plane(points, scan, config.method)
    return dbscan(xy_m, eps_m=eps_m, min_points=config.min_points, period_m=period_m)


def plane(points: Points, scan: Scan, method: str) -> tuple[FloatArray, float]:
    """Where DBSCAN sees the points (n, 2), and the period of the first axis, 0 = none.

    Polar: the unwrapped cylinder (R phi, r) with R = cell depth / cell width, closed over North.
    Eq: polar-2, polar-3, polar-4
    """
    if method == "cartesian-dbscan":
        return points.position_m - scan.position_m, 0.0
    radius_m = cylinder_radius_m(points, scan)
    xy_m = np.stack([radius_m * geo.wrap_positive(points.azimuth_rad), points.range_m], axis=1)
    return xy_m, geo.TWO_PI * radius_m


def cylinder_radius_m(points: Points, scan: Scan) -> float:
    """R = sigma_r / sigma_phi of the cell; points without cells use 10 m and 0.5 degree."""
    depth, width = scan.sensor.range_res_m, scan.sensor.azimuth_res_rad
    return depth / width if depth > 0 and width > 0 else 10.0 / math.radians(0.5)


def sensor_noise(scan: Scan, sensor: InputConfig) -> tuple[float, float, float]:
    """Standard deviations: range (m), azimuth (rad), any direction (m).

    A cell spreads evenly, variance = width^2 / 12; the beam and the pulse smear more than the cell where
    they are wider, so the larger one counts. Cells that weigh their power (`input.scale_db`) have the variance of
    what smears them: that of pulse and cell together, and B^2 / (16 log 2) of a Gaussian beam of one-way half-power
    width B, there and back.
    """
    cell_m, depth = scan.sensor.range_res_m, max(scan.sensor.range_res_m, sensor.pulse_length_m)
    width = max(scan.sensor.azimuth_res_rad, math.radians(sensor.beam_width_deg))
    smeared_m, smeared_rad = depth / math.sqrt(12.0), width / math.sqrt(12.0)
    if sensor.scale_db > 0.0 and sensor.pulse_length_m > 0.0:
        smeared_m = math.hypot(cell_m, sensor.pulse_length_m) / math.sqrt(12.0)
    if sensor.scale_db > 0.0 and sensor.beam_width_deg > 0.0:
        smeared_rad = max(math.radians(sensor.beam_width_deg) / math.sqrt(16.0 * math.log(2.0)), smeared_rad)
    sigma_range = sensor.sigma_range_m or smeared_m
    sigma_azimuth = math.radians(sensor.sigma_azimuth_deg) or smeared_rad
    return max(sigma_range, 0.1), max(sigma_azimuth, 1e-5), sensor.sigma_m


def _length_m(clusters: Clusters) -> FloatArray:
    """Length of the ellipse with the cluster's covariance, 4 standard deviations."""
    cov = clusters.scatter_m2 / clusters.count[:, None, None]
    half = (cov[:, 0, 0] + cov[:, 1, 1]) / 2
    largest = half + np.hypot((cov[:, 0, 0] - cov[:, 1, 1]) / 2, cov[:, 0, 1])
    return np.asarray(4.0 * np.sqrt(np.maximum(largest, 0.0)))
