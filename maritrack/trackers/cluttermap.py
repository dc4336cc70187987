"""Where clutter comes: the rate of clusters that no track took, cell by cell in east-north, learned as the run goes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maritrack import geo
from maritrack.tracksettings import ClutterMapConfig
from maritrack.types import Clusters, FloatArray, IntArray, Scan

LEAST = 1e-3  # clusters a scan: a cell below is forgotten, which bounds the map of a radar that travels


@dataclass(frozen=True, slots=True, eq=False)
class ClutterMap:
    """Rates as of one scan. Rows are cells, ascending by key."""

    key: IntArray  # (m,) geo.pixel_key
    rate: FloatArray  # (m,) clusters a scan
    t_ns: int  # of that scan


def map_density(clutter: ClutterMap | None, position_m: FloatArray, rules: ClutterMapConfig) -> FloatArray:
    """Density (n,) per m^2 and scan that the map adds at positions (n, 2): the mean over a cell and its neighbours."""
    if clutter is None or len(clutter.key) == 0:
        return np.zeros(len(position_m))
    total = np.zeros(len(position_m))
    for east in (-1, 0, 1):
        for north in (-1, 0, 1):
            key = geo.pixel_key(position_m + rules.cell_m * np.array([east, north]), rules.cell_m)
            at = np.minimum(np.searchsorted(clutter.key, key), len(clutter.key) - 1)
            total += np.where(clutter.key[at] == key, clutter.rate[at], 0.0)
    return np.asarray(np.maximum(total - rules.least_rate, 0.0) / (9.0 * rules.cell_m**2))


def learn_map(
    clutter: ClutterMap | None, clusters: Clusters, untaken: FloatArray, scan: Scan, rules: ClutterMapConfig
) -> ClutterMap | None:
    """The map with one more scan; `untaken` (c,) is the share of each cluster that counts as clutter.

    Rates follow with the time constant of the memory, from none at the beginning; those of places out of sight
    fade as well. The time of a scan is that since the last one, in the first scan that of its turn.
    """
    if rules.method == "none":
        return clutter
    since_ns = scan.t_ns - (scan.t_start_ns if clutter is None else clutter.t_ns)
    left = np.exp(-max(since_ns * 1e-9, 0.0) / rules.memory_s)
    key, cell = np.unique(geo.pixel_key(clusters.mean_m, rules.cell_m), return_inverse=True)
    rate = (1.0 - left) * np.bincount(cell, untaken, len(key))
    if clutter is not None:
        key, cell = np.unique(np.concatenate([clutter.key, key]), return_inverse=True)
        rate = np.bincount(cell, np.concatenate([left * clutter.rate, rate]), len(key))
    lasting = rate >= LEAST * (1.0 - left)
    key, rate = key[lasting], rate[lasting]
    if len(key) > rules.max_cells:
        top = np.sort(np.argsort(-rate, kind="stable")[: rules.max_cells])
        key, rate = key[top], rate[top]
    return ClutterMap(key, rate, scan.t_ns)
