"""Scans of point objects made by hand, and trackers run on them."""

from __future__ import annotations

from typing import Any

import numpy as np

from maritrack import geo
from maritrack.cluster.stage import cluster_points
from maritrack.config import load_config
from maritrack.settings import Config
from maritrack.trackers import TRACKERS
from maritrack.types import Clusters, FloatArray, Points, Scan, Sensor

SECOND = 10**9
OF_CLUSTERS = tuple(name for name in TRACKERS if name != "gp-pmbm")  # that one asks for many points of a hull
LIST_TRACKERS = ("sprt", "ipda", "jipda")


def plain_config(tracker: str, *sets: str) -> Config:
    """Points with known noise, P_D = 0.8 and P_G = 0.99, fixed clutter, nothing united, nothing lost by time."""
    fixed = ["model.p_detect=0.8", "model.p_gate=0.99", "model.clutter=fixed", "model.clutter_density_per_m2=1e-6",
             "model.p_survive=1.0", "tracker.duplicate_distance_m=0.0", "tracker.birth_existence=0.6",
             "tracker.delete_misses=1000", "tracker.delete_sigma_m=1e6", "model.centroid_n_max=0"]  # fmt: skip
    return load_config(preset="points", sets=[f"tracker_name={tracker}", *fixed, *sets])


def scan_of(z: Any, t_s: float, *, sigma_m: float = 5.0, sensor: str = "p") -> tuple[Scan, Points]:
    """Points at z (n, 2) about a sensor at the origin that sees any distance."""
    z = np.asarray(z, float).reshape(-1, 2)
    n, t_ns = len(z), round(t_s * SECOND)
    range_m, azimuth = geo.en_to_polar(z)
    points = Points(
        range_m=range_m, azimuth_rad=azimuth, position_m=z, intensity=np.ones(n), t_ns=np.full(n, t_ns),
        range_width_m=np.zeros(n), azimuth_width_rad=np.zeros(n), cov_m2=np.tile(sigma_m**2 * np.eye(2), (n, 1, 1)),
    )  # fmt: skip
    return Scan(Sensor(sensor, 0, 0, np.inf), t_ns, t_ns, np.zeros(2), np.nan, points=points), points


def step(config: Config, state: Any, z: Any, t_s: float) -> Any:
    """The state after a scan with points at z; a state of None is that of the beginning."""
    tracker = TRACKERS[config.tracker_name](config)
    scan, points = scan_of(z, t_s)
    clusters = cluster_points(points, scan, config.cluster, config.input)
    return tracker.update(tracker.init() if state is None else state, scan, points, clusters)[0]


def clusters_of(config: Config, z: FloatArray, t_s: float) -> Clusters:
    """The clusters that `step` hands to the tracker."""
    scan, points = scan_of(z, t_s)
    return cluster_points(points, scan, config.cluster, config.input)
