"""Point objects in space that cross, seen by a radar with range, azimuth and elevation among clutter.

The scene `crossing-3d` is that of the engm paper: two objects that meet at one point.   Eq: engm-40, engm-41
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from maritrack import geo
from maritrack.errors import ConfigError
from maritrack.io.pointwriter import write_points
from maritrack.io.reference import Reference, Reports, build_reference
from maritrack.objects import cv, sensing
from maritrack.simulate.writing import scans_asked, write_octets
from maritrack.types import FloatArray, IntArray, Points, Scan, Sensor

KIND: sensing.Measurement = "range-azimuth-elevation"


@dataclass(frozen=True, kw_only=True)
class PointScene:
    """Objects at constant velocity, and what is seen of them from the origin. Metres east, north and up; seconds."""

    title: str
    scans: int
    period_s: float
    sigma_range_m: float
    sigma_azimuth_deg: float
    sigma_elevation_deg: float
    p_detect: float
    clutter_rate: float  # points in a scan, on average
    clutter_low_m: tuple[float, ...]  # corners of the box that they are uniform in
    clutter_high_m: tuple[float, ...]
    objects: tuple[tuple[float, ...], ...]  # state at the first scan: three positions, three velocities

    def __post_init__(self) -> None:
        if self.scans < 1 or not 0 <= self.p_detect <= 1 or self.clutter_rate < 0:
            raise ConfigError("scans starts at 1, p_detect is within 0..1, clutter_rate not negative")
        if any(len(x) != 6 for x in self.objects) or len(self.clutter_low_m) != 3 or len(self.clutter_high_m) != 3:
            raise ConfigError("an object is 6 numbers, a corner 3")


def truth_of(scene: PointScene, k: int) -> FloatArray:
    """States (n, 6) at scan k."""
    return np.asarray(np.array(scene.objects, float).reshape(-1, 6) @ cv.transition(k * scene.period_s, 3).T)


def scan_of(scene: PointScene, k: int, *, seed: int) -> Scan:
    """Scan k: points in an order of chance, each with the object it comes from, -1 = clutter.

    Clutter is uniform in the box and measured without noise. Equal seed and k give equal points.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(11, k)))
    at = truth_of(scene, k)[:, :3]
    sigma = np.array([scene.sigma_range_m, *np.deg2rad([scene.sigma_azimuth_deg, scene.sigma_elevation_deg])])
    z = sensing.measure(KIND, at) + sigma * rng.normal(size=at.shape)
    seen = np.flatnonzero(rng.random(len(at)) < scene.p_detect)
    box = rng.uniform(scene.clutter_low_m, scene.clutter_high_m, (rng.poisson(scene.clutter_rate), 3))
    whole = np.concatenate([z[seen], sensing.measure(KIND, box)])
    label = np.concatenate([seen, np.full(len(box), -1)])
    order = rng.permutation(len(whole))
    t_ns = round(k * scene.period_s * 1e9)
    points = points_of(whole[order], t_ns, label[order], np.square(sigma))
    return Scan(Sensor("radar", 0.0, 0.0, np.inf), t_ns, t_ns, np.zeros(2), np.nan, points=points)


def points_of(z: FloatArray, t_ns: int, label: IntArray, var: FloatArray) -> Points:
    """Points of measurements (n, 3) of these variances (3,) from a sensor at the origin."""
    at, nothing = sensing.locate(KIND, z), np.zeros(len(z))
    return Points(
        range_m=z[:, 0], azimuth_rad=geo.wrap_positive(z[:, 1]), position_m=at[:, :2], intensity=np.ones(len(z)),
        t_ns=np.full(len(z), t_ns), range_width_m=nothing, azimuth_width_rad=nothing, truth_label=label,
        elevation_rad=z[:, 2], up_m=at[:, 2], noise=np.tile(var, (len(z), 1)),
    )  # fmt: skip


def reference_of(scene: PointScene, n_scans: int) -> Reference:
    """Where the objects were at each scan."""
    x = np.stack([truth_of(scene, k) for k in range(n_scans)], axis=1)  # (n, k, 6)
    n, rows = len(x), x.reshape(-1, 6)
    t_ns = np.rint(np.arange(n_scans) * scene.period_s * 1e9).astype(np.int64)
    reports = Reports(
        ship=np.repeat(np.arange(n), n_scans), t_ns=np.tile(t_ns, n), position_m=rows[:, :2], velocity_mps=rows[:, 3:5],
        heading_rad=np.full(len(rows), np.nan), up_m=rows[:, 2], vel_up_mps=rows[:, 5],
    )  # fmt: skip
    unknown, ids = np.full(n, np.nan), [f"object-{i + 1}" for i in range(n)]
    return build_reference(reports, ids=ids, names=[""] * n, length_m=unknown, width_m=unknown, complete=True)


def simulate_points(
    scene: PointScene,
    out: Path,
    *,
    seed: int,
    scans: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Write OUT as `maritrack-points/1` in range, azimuth and elevation, the truth in it; returns what was written."""
    n_scans = scans_asked(scene.scans, scans, seed=seed)
    written = []
    for k in range(n_scans):
        written.append(scan_of(scene, k, seed=seed))
        if progress is not None:
            progress(k + 1, n_scans)
    sigmas = {name: getattr(scene, name) for name in ("sigma_range_m", "sigma_azimuth_deg", "sigma_elevation_deg")}
    reference = reference_of(scene, n_scans)
    octets = write_points(written, frame="polar3", sensors={"radar": sigmas}, reference=reference)
    write_octets(out, octets)
    points = sum(len(scan.points) for scan in written if scan.points is not None)
    return {
        "recording": str(out), "octets": len(octets), "scans": n_scans, "points": points,
        "objects": len(scene.objects), "truth_rows": len(reference.t_ns), "seed": seed,
    }  # fmt: skip
