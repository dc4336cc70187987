"""Scans of points in space, and intensity trackers run on them."""

from __future__ import annotations

from typing import Any

import numpy as np

from maritrack.cluster.stage import cluster_points
from maritrack.config import load_config
from maritrack.settings import Config
from maritrack.simulate.pointscene import points_of
from maritrack.trackers import TRACKERS
from maritrack.types import FloatArray, Scan, Sensor
from tests.unit.scans import scan_of

INTENSITY_TRACKERS = ("gm-phd", "smc-phd", "engm-phd")
SIGMA = np.array([1.0, 0.01, 0.01])


def plane_config(tracker: str, *sets: str) -> Config:
    """Points of known noise in the plane, always seen, no births but at clusters, hardly any clutter."""
    fixed = ["model.p_detect=1.0", "model.clutter=fixed", "model.clutter_density_per_m2=1e-30", "intensity.gate=none",
             "intensity.p_survive_scan=1.0", "model.centroid_n_max=0", "intensity.birth_weight=0.001",
             "intensity.bandwidth=global", "intensity.shrink=false"]  # fmt: skip
    return load_config(preset="points", sets=[f"tracker_name={tracker}", *fixed, *sets])


def space_scan(z: FloatArray, t_s: float) -> Scan:
    """Measurements (n, 3) of range, azimuth and elevation from a sensor at the origin."""
    z = np.asarray(z, float).reshape(-1, 3)
    t_ns = round(t_s * 1e9)
    points = points_of(z, t_ns, np.full(len(z), -1), SIGMA**2)
    return Scan(Sensor("p", 0.0, 0.0, np.inf), t_ns, t_ns, np.zeros(2), np.nan, points=points)


def step_scan(config: Config, state: Any, scan: Scan) -> Any:
    """The state after a scan; a state of None is that of the beginning."""
    tracker = TRACKERS[config.tracker_name](config)
    assert scan.points is not None
    clusters = cluster_points(scan.points, scan, config.cluster, config.input)
    return tracker.update(tracker.init() if state is None else state, scan, scan.points, clusters)[0]


def plane_step(config: Config, state: Any, z: Any, t_s: float) -> Any:
    """The same with points at z (n, 2) in the plane."""
    return step_scan(config, state, scan_of(z, t_s)[0])
