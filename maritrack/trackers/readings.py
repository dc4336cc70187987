"""The measurements of a scan as an intensity filter takes them: values, noise, times and clutter intensity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maritrack import geo
from maritrack.cluster.stage import sensor_noise
from maritrack.objects import giw, sensing
from maritrack.objects.sensing import Measurement
from maritrack.settings import Config
from maritrack.trackers import steps
from maritrack.trackers.tracklist import TrackList
from maritrack.types import Clusters, FloatArray, IntArray, Points, Scan


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """Measurements of one scan, m of them; as many noises as differ."""

    kind: Measurement
    sensor_m: FloatArray  # (axes,)
    z: FloatArray  # (m, z)
    R: FloatArray  # (q, z, z)
    noise: IntArray  # (m,) row of R
    t_ns: IntArray  # (m,)
    log_kappa: FloatArray  # (m,) clutter intensity, per unit of z
    cluster: IntArray  # (m,)

    def __len__(self) -> int:
        return len(self.z)


def read(scan: Scan, points: Points, clusters: Clusters, tracks: TrackList, config: Config) -> Readings:
    """The clusters of a scan, or its points as clusters of one, as the settings say to measure them.

    `intensity.clutter_space` = "jacobian" has the clutter that is uniform in space per unit of the measurements,
    kappa(z) = lambda |d position / d z|. "cartesian" has lambda itself, whatever z is.   Eq: engm-43

    Deviates: engm-43 the density of the paper is one of space, and the paper compares it with a likelihood of range
    and angles; with "cartesian", the preset `engm`, so do we.
    """
    rules = config.intensity
    kind = rules.measurement
    sensor_m = np.append(scan.position_m, scan.up_m)[: sensing.AXES[kind]]
    if kind == "range-azimuth-elevation":
        cluster, z, var, t_ns = _in_space(points, clusters, scan, config)
        R, noise = _distinct(var[:, :, None] * np.eye(3))
        lam = np.full(len(z), rules.clutter_density_per_m3)
    else:
        offset, R_m2 = clusters.mean_m - scan.position_m, _noise_m2(clusters, config)
        J = sensing.jacobian(kind, offset)
        polar = np.stack([clusters.range_m, clusters.azimuth_rad], axis=-1)
        cluster, z, t_ns = np.arange(len(clusters)), offset if kind == "clusters" else polar, clusters.t_ns
        R, noise = _distinct(J @ R_m2 @ J.transpose(0, 2, 1) if kind == "range-azimuth" else R_m2)
        lam = steps.clutter_density(tracks, clusters, scan, config)
    per_z = sensing.volume(kind, z) if rules.clutter_space == "jacobian" else np.ones(len(z))
    return Readings(kind, sensor_m, z, R, noise, t_ns, np.log(lam * per_z), cluster)


def _in_space(
    points: Points, clusters: Clusters, scan: Scan, config: Config
) -> tuple[IntArray, FloatArray, FloatArray, IntArray]:
    """Cluster, measurement, its variances and time of each point, in the order of the clusters.

    Points without elevation say nothing. Their noise is theirs, or that of the settings.
    """
    if points.elevation_rad is None:
        none = np.zeros(0, np.int64)
        return none, np.zeros((0, 3)), np.zeros((0, 3)), none
    sigma_range, sigma_azimuth, _ = sensor_noise(scan, config.input)
    sigma = [sigma_range, sigma_azimuth, max(np.deg2rad(config.input.sigma_elevation_deg), 1e-5)]
    var = np.tile(np.square(sigma), (len(points), 1)) if points.noise is None else points.noise
    z = np.stack([points.range_m, points.azimuth_rad, points.elevation_rad], axis=-1)
    order = np.argsort(clusters.label, kind="stable")
    return clusters.label[order], z[order], var[order], points.t_ns[order]


def _noise_m2(clusters: Clusters, config: Config) -> FloatArray:
    """Covariances (m, 2, 2) of centroids in east-north."""
    n = len(clusters)
    share = giw.centroid_weight(clusters, np.arange(n), config.model)[:, None, None]
    own = config.intensity.cluster_spread * clusters.scatter_m2 / clusters.count[:, None, None]
    return np.asarray(clusters.noise_m2 * share + own + config.model.centroid_sigma_m**2 * np.eye(2))


def _distinct(R: FloatArray) -> tuple[FloatArray, IntArray]:
    """Covariances that differ (q, z, z), one where all are alike, and whose is whose (m,)."""
    if len(R) == 0 or np.ptp(R, axis=0).max() == 0.0:
        one = R[:1] if len(R) else np.eye(R.shape[1])[None]
        return one, np.zeros(len(R), np.int64)
    return R, np.arange(len(R))


def places(readings: Readings, which: IntArray) -> tuple[FloatArray, FloatArray]:
    """Positions (n, axes) that measurements tell, and their covariances to first order."""
    z = readings.z[which]
    offset = sensing.locate(readings.kind, z)
    back = np.linalg.inv(sensing.jacobian(readings.kind, offset))
    R = readings.R[readings.noise[which]]
    return readings.sensor_m + offset, back @ R @ back.transpose(0, 2, 1)


def visible(scan: Scan, position_m: FloatArray, config: Config) -> FloatArray:
    """P_D (n,) at positions (n, axes): model.p_detect, less in the background, 0 where this scan did not look."""
    at = position_m[:, :2]
    seen = geo.visible(scan, at, config.input.roi_min_m, config.input.roi_max_m)
    hidden = geo.in_mask(scan.covered, at)
    p_detect = config.model.p_detect * np.where(hidden, config.tracker.covered_detect, 1.0)
    return np.where(seen, p_detect, 0.0)
