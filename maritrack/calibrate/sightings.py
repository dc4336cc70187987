"""What there is to compare: clusters of a sensor in its own polar coordinates, and ways of ships under way."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from maritrack import geo
from maritrack.chain import detect
from maritrack.cluster.stage import cluster_points
from maritrack.io.reference import Reference
from maritrack.settings import Config
from maritrack.types import BoolArray, Clusters, FloatArray, Frame, IntArray, Scan

BIAS_SHARE, LENGTH_M, LEAST_BIAS_M = 0.25, 200.0, 3.0  # of a ship's length, which is this where unknown
KERNEL = 3.0  # standard deviations of a Gaussian to either side
MOST_VALUES = 10**7  # of a Jacobian
LEAST_SPEED_MPS = 1.0  # slower ships tell nothing about clocks, and moorings are full of echoes


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """Clusters of one sensor in all its scans, with its settings applied. Rows n in order of scans."""

    scan: IntArray  # (n,)
    t_s: FloatArray  # (n,) since `start_ns`
    range_m: FloatArray  # (n,)
    azimuth_rad: FloatArray  # (n,)
    pose_s: FloatArray  # (k,) middle of each scan, increasing
    pose_m: FloatArray  # (k, 2) where the sensor was then
    start_ns: int
    reach_m: float  # of the farthest cluster
    cell_m: float  # depth of a cell, 0 where unknown
    cell_rad: float  # its width

    def __len__(self) -> int:
        return len(self.scan)

    def sensor_m(self, t_s: FloatArray) -> FloatArray:
        """Where the sensor was (m, 2) at times (m,)."""
        return _between(t_s, self.pose_s, self.pose_m)


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """Reports of one ship."""

    id: str
    name: str
    length_m: float  # nan where unknown
    width_m: float
    bias_m: float  # standard deviation of where its echo lies, seen from the place that it reports
    t_s: FloatArray  # (m,) increasing
    position_m: FloatArray  # (m, 2)
    max_gap_s: float  # longer ones are not bridged
    seen_from_m: FloatArray | None = None  # (m, 2) where the radar was that tracked it; None = it told its own place

    @property
    def speed_mps(self) -> float:
        """Typical speed while under way."""
        speed = np.hypot(*np.diff(self.position_m, axis=0).T) / np.diff(self.t_s)
        return float(np.median(speed[speed >= LEAST_SPEED_MPS])) if (speed >= LEAST_SPEED_MPS).any() else 1.0

    def at(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Position and velocity (n, 2) at times (n,), and where the ship is known to be under way."""
        after = np.clip(np.searchsorted(self.t_s, t_s, side="right"), 1, len(self.t_s) - 1)
        a, dt = after - 1, np.diff(self.t_s)[after - 1]
        velocity = (self.position_m[after] - self.position_m[a]) / dt[:, None]
        position = self.position_m[a] + (t_s - self.t_s[a])[:, None] * velocity
        inside = (t_s >= self.t_s[0]) & (t_s <= self.t_s[-1]) & (dt <= self.max_gap_s)
        return position, velocity, inside & (np.hypot(velocity[:, 0], velocity[:, 1]) >= LEAST_SPEED_MPS)

    def radar_m(self, t_s: FloatArray) -> FloatArray:
        """Where the radar was that tracked it (n, 2) at times (n,)."""
        assert self.seen_from_m is not None
        return _between(t_s, self.t_s, self.seen_from_m)


def thinned(sightings: Sightings, ways: tuple[Way, ...], *, columns: int) -> Sightings:
    """Every n-th scan, where all would make a Jacobian of more than `MOST_VALUES`: neighbouring scans err alike."""
    looks = sum(np.count_nonzero((sightings.pose_s >= w.t_s[0]) & (sightings.pose_s <= w.t_s[-1])) for w in ways)
    every = -(-2 * looks * columns // MOST_VALUES)
    if every < 2:
        return sightings
    keep = sightings.scan % every == 0
    return replace(
        sightings, scan=sightings.scan[keep], t_s=sightings.t_s[keep], range_m=sightings.range_m[keep],
        azimuth_rad=sightings.azimuth_rad[keep],
    )  # fmt: skip


def sightings_of(frames: Iterable[Frame], config: Config) -> dict[str, Sightings]:
    """The clusters of each sensor of a recording."""
    parts: dict[str, list[tuple[Scan, Clusters]]] = {}
    for frame in frames:
        clusters = cluster_points(detect(frame.scan, config), frame.scan, config.cluster, config.input)
        bare = replace(frame.scan, video=None, points=None)
        parts.setdefault(bare.sensor.id, []).append((bare, clusters))
    return {sensor: _put_together(rows) for sensor, rows in parts.items()}


def _put_together(rows: list[tuple[Scan, Clusters]]) -> Sightings:
    middle_ns = np.array([(scan.t_ns + scan.t_start_ns) // 2 for scan, _ in rows])
    start_ns, order = int(middle_ns[0]), np.argsort(middle_ns, kind="stable")
    none = np.zeros(0)
    bare = Sightings(
        scan=np.repeat(np.arange(len(rows)), [len(clusters) for _, clusters in rows]),
        t_s=np.concatenate([clusters.t_ns - start_ns for _, clusters in rows]) * 1e-9, range_m=none, azimuth_rad=none,
        pose_s=(middle_ns - start_ns)[order] * 1e-9, pose_m=np.stack([scan.position_m for scan, _ in rows])[order],
        start_ns=start_ns, reach_m=0.0, cell_m=rows[0][0].sensor.range_res_m,
        cell_rad=rows[0][0].sensor.azimuth_res_rad,
    )  # fmt: skip
    mean_m = np.concatenate([clusters.mean_m for _, clusters in rows])
    range_m, azimuth_rad = geo.en_to_polar(mean_m - bare.sensor_m(bare.t_s))
    return replace(bare, range_m=range_m, azimuth_rad=azimuth_rad, reach_m=float(range_m.max(initial=0.0)))


def as_seen(way: Way, sightings: Sightings) -> Way:
    """A way that another radar has tracked with how far off its echo may lie here: more, the more the views differ.

    From one place both see the same of a hull. From two sides, or from near and from far, where only what is turned
    to the radar exceeds the threshold, one may see the bow and the other the stern, of a ship of unknown length. What
    is shorter than that is taken out of the way.
    """
    if way.seen_from_m is None:
        return way
    here, there = sightings.sensor_m(way.t_s) - way.position_m, way.seen_from_m - way.position_m
    near_m, far_m = (np.maximum(np.hypot(*offset.T), 1.0) for offset in (here, there))
    turned = np.hypot(*(here / near_m[:, None] - there / far_m[:, None]).T)
    differ = float(np.median(np.minimum(turned + np.abs(np.log(near_m / far_m)), 1.0)))
    return _steadied(replace(way, bias_m=float(np.hypot(way.bias_m, differ * BIAS_SHARE * LENGTH_M))))


def _steadied(way: Way) -> Way:
    """The way without what is shorter than its echo may lie off: that is of how a hull shows, not of how a ship sails.

    A track's speed changes as the echo slides along the hull. In a fit those changes would tell a latency, falsely
    and too surely. Local lines, weighted by a Gaussian of the time that the ship takes for `bias_m`.
    """
    scale_s, position = way.bias_m / way.speed_mps, way.position_m.copy()
    cuts = np.flatnonzero(np.diff(way.t_s) > way.max_gap_s) + 1
    for rows in np.split(np.arange(len(way.t_s)), cuts):
        t_s, n = way.t_s[rows] / scale_s, len(rows)
        ahead = int((np.searchsorted(t_s, t_s + KERNEL, side="right") - np.arange(n)).max())
        sums, moments = np.zeros((n, 3)), np.zeros((n, 2, 2))
        for k in range(1 - ahead, ahead):
            i = np.arange(max(-k, 0), n - max(k, 0))
            d = t_s[i + k] - t_s[i]
            powers = np.where(np.abs(d) <= KERNEL, np.exp(-(d**2) / 2), 0.0)[:, None] * d[:, None] ** np.arange(3)
            sums[i] += powers
            moments[i] += powers[:, :2, None] * way.position_m[rows[i + k], None]
        whole = sums[:, 0] * sums[:, 2] - sums[:, 1] ** 2
        line = sums[:, 2:] * moments[:, 0] - sums[:, 1:2] * moments[:, 1]
        told = whole > 0
        position[rows[told]] = line[told] / whole[told, None]
    return replace(way, position_m=position)


def _since(t_ns: IntArray, start_ns: int) -> FloatArray:
    return np.asarray((t_ns - start_ns) * 1e-9, np.float64)


def _between(t_s: FloatArray, at_s: FloatArray, position_m: FloatArray) -> FloatArray:
    """Positions (n, 2) at times (n,), of positions (k, 2) at increasing times (k,)."""
    return np.stack([np.interp(t_s, at_s, position_m[:, axis]) for axis in (0, 1)], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Radar:
    """Where a radar was over time."""

    t_ns: IntArray  # (k,) increasing
    position_m: FloatArray  # (k, 2)


def ways_of(
    reference: Reference, start_ns: int, *, max_gap_s: float, bias_m: Mapping[str, float], radar: Radar | None = None
) -> list[Way]:
    """The ships that are under way at some time, by id. `bias_m` by id, where the length does not tell it.

    Those that a `radar` has tracked know from where.
    """
    ways = []
    for i, (first, last) in enumerate(zip(reference.start[:-1].tolist(), reference.start[1:].tolist(), strict=True)):
        if last - first < 2:
            continue
        t_s = _since(reference.t_ns[first:last], start_ns)
        length_m, width_m = float(reference.length_m[i]), float(reference.width_m[i])
        by_length = max(BIAS_SHARE * (length_m if length_m > 0 else LENGTH_M), LEAST_BIAS_M)
        bias = bias_m.get(reference.ids[i], by_length)
        way = Way(
            reference.ids[i], reference.names[i], length_m, width_m, bias, t_s, reference.position_m[first:last],
            max_gap_s, None if radar is None else _between(t_s, _since(radar.t_ns, start_ns), radar.position_m),
        )  # fmt: skip
        if way.at((t_s[1:] + t_s[:-1]) / 2)[2].any():
            ways.append(way)
    return ways
