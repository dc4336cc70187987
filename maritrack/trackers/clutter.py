"""How many clusters no track explains: the clutter density, learned per sensor in rings of range."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from maritrack.settings import Config
from maritrack.types import Clusters, FloatArray, IntArray, Scan

RINGS = 16


@dataclass(frozen=True, slots=True, eq=False)
class Clutter:
    """Running density of the clusters that no track explains, in rings about the sensor."""

    density_per_m2: FloatArray  # (b,)
    ring_m: float  # width of a ring; 0 = one ring for all


def clutter_at(clutter: Clutter | None, clusters: Clusters, config: Config) -> FloatArray:
    """Clutter density (c,) at clusters, per m^2: fixed, or the running estimate of their ring."""
    if clutter is None:
        return np.full(len(clusters), config.model.clutter_density_per_m2)
    return clutter.density_per_m2[_ring(clutter, clusters)]


def learn_clutter(
    clutter: Clutter | None, clusters: Clusters, unexplained: FloatArray, scan: Scan, config: Config
) -> Clutter | None:
    """The estimate with one more scan; `unexplained` (c,) is the share of each cluster that no track took.

    A slow mean, 20 scans long, in rings of a sixteenth of the range. Where the range is unknown, one ring of
    the area of the box around the clusters. A ring counts at least a fiftieth of a cluster a scan.
    """
    if config.model.clutter == "fixed":
        return clutter
    reach, least = (
        min(scan.sensor.max_range_m, config.input.roi_max_m),
        min(config.input.roi_min_m, scan.sensor.max_range_m),
    )
    if math.isfinite(reach):
        share = 1.0 if scan.swept is None else max(float(scan.swept.mean()), 1e-3)
        ring_m = reach / RINGS
        edges = np.maximum(np.arange(RINGS + 1) * ring_m, least)
        area = share * math.pi * np.maximum(edges[1:] ** 2 - edges[:-1] ** 2, ring_m**2 * 1e-3)
    elif len(clusters) >= 3:
        ring_m, area = 0.0, np.array([max(float(np.prod(np.ptp(clusters.mean_m, axis=0))), 1.0)])
    else:
        return clutter
    now = Clutter(np.zeros(len(area)), ring_m)
    count = np.bincount(_ring(now, clusters), unexplained, len(area))
    density = np.maximum(count, 0.02) / area
    if clutter is not None and len(clutter.density_per_m2) == len(area) and clutter.ring_m == ring_m:
        density = 0.95 * clutter.density_per_m2 + 0.05 * density
    return replace(now, density_per_m2=density)


def _ring(clutter: Clutter, clusters: Clusters) -> IntArray:
    if clutter.ring_m <= 0:
        return np.zeros(len(clusters), np.int64)
    return np.minimum((clusters.range_m / clutter.ring_m).astype(np.int64), len(clutter.density_per_m2) - 1)
