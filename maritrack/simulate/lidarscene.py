"""Scenes of boats about a platform with LiDARs: `four-ships`, `canal-1` and `canal-2` of the extended paper."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from maritrack import geo
from maritrack.errors import ConfigError
from maritrack.io.mount import Mount, aboard
from maritrack.io.pointwriter import write_points
from maritrack.io.reference import Reference, Reports, build_reference
from maritrack.simulate.lidar import Boat, Lidar, sweep
from maritrack.simulate.vessels import State
from maritrack.simulate.writing import scans_asked, write_octets
from maritrack.types import Origin, Points, Scan, Sensor

KEY = 12  # of the random numbers of these scenes


@dataclass(frozen=True, kw_only=True)
class LidarScene:
    """Boats, and the LiDARs that see them from a platform that lies still. Metres east and north; seconds."""

    title: str
    scans: int
    period_s: float
    lidar: tuple[Lidar, ...]
    boat: tuple[Boat, ...]
    east_m: float = 0.0  # of the platform
    north_m: float = 0.0
    heading_deg: float = 0.0
    lat_deg: float = math.nan  # of the origin, where there is one
    lon_deg: float = math.nan

    def __post_init__(self) -> None:
        if self.scans < 1 or not self.period_s > 0.0:
            raise ConfigError("scans starts at 1, period_s is greater than 0")
        for kind, names in (("lidar", [x.name for x in self.lidar]), ("boat", [x.id for x in self.boat])):
            if not names:
                raise ConfigError(f"no {kind} in the scene")
            if len(set(names)) < len(names):
                raise ConfigError(f"two of the table '{kind}' have one name")

    @property
    def place_m(self) -> np.ndarray:
        """Of the platform (2,)."""
        return np.array([self.east_m, self.north_m])

    @property
    def origin(self) -> Origin | None:
        """Where east = north = 0 is, None where the scene does not say."""
        return None if math.isnan(self.lat_deg + self.lon_deg) else Origin(self.lat_deg, self.lon_deg)

    def mount(self, lidar: Lidar) -> Mount:
        """Where a LiDAR is aboard."""
        return Mount(lidar.forward_m, lidar.starboard_m, 0.0)


def present(scene: LidarScene, k: int) -> Iterator[tuple[int, Boat, State]]:
    """Boats that are there in scan k, by number, each with its state in arrays of one row."""
    t_s = k * scene.period_s
    for number, boat in enumerate(scene.boat):
        if t_s >= boat.from_s - 1e-9:
            yield number, boat, boat.course().at(np.array([t_s]))


def scans_of(scene: LidarScene, k: int, *, seed: int) -> list[Scan]:
    """Scan k of every LiDAR, each point with the number of its boat, -1 = wake or clutter.

    Equal seed and k give equal points.
    """
    fleet, t_ns, scans = list(present(scene, k)), round(k * scene.period_s * 1e9), []
    heading_rad = math.radians(scene.heading_deg)
    for i, lidar in enumerate(scene.lidar):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(KEY, k, i)))
        at_m = aboard(scene.place_m, heading_rad, scene.mount(lidar))
        seen = sweep(lidar, at_m, fleet, rng)
        order = np.lexsort((seen.range_m, seen.azimuth_rad))
        n, nothing = len(order), np.zeros(len(order))
        range_m, azimuth_rad = seen.range_m[order], seen.azimuth_rad[order]
        points = Points(
            range_m=range_m, azimuth_rad=azimuth_rad, position_m=at_m + geo.polar_to_en(range_m, azimuth_rad),
            intensity=np.ones(n), t_ns=np.full(n, t_ns), range_width_m=nothing, azimuth_width_rad=nothing,
            truth_label=seen.label[order],
        )  # fmt: skip
        sensor = Sensor(lidar.name, 0.0, 0.0, lidar.max_range_m)
        scans.append(Scan(sensor, t_ns, t_ns, at_m, heading_rad, points=points))
    return scans


def reference_of(scene: LidarScene, n_scans: int) -> Reference:
    """Where the boats were at each scan, from their first one on."""
    rows = [(number, k, state) for k in range(n_scans) for number, _, state in present(scene, k)]
    states = [state for _, _, state in rows]

    def column(values: list[Any], width: int) -> np.ndarray:
        return np.concatenate(values) if values else np.zeros((0, width))

    reports = Reports(
        ship=np.array([number for number, _, _ in rows], np.int64),
        t_ns=np.array([round(k * scene.period_s * 1e9) for _, k, _ in rows], np.int64),
        position_m=column([s.position_m for s in states], 2), velocity_mps=column([s.velocity_mps for s in states], 2),
        heading_rad=np.array([s.heading_rad[0] for s in states]),
    )  # fmt: skip
    return build_reference(
        reports, ids=[b.id for b in scene.boat], names=[""] * len(scene.boat),
        length_m=np.array([b.length_m for b in scene.boat]), width_m=np.array([b.width_m for b in scene.boat]),
        complete=True,
    )  # fmt: skip


def simulate_lidar(
    scene: LidarScene,
    out: Path,
    *,
    seed: int,
    scans: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Write OUT as `maritrack-points/1` in range and azimuth, truth and labels in it; returns what was written."""
    n_scans = scans_asked(scene.scans, scans, seed=seed)
    written: list[Scan] = []
    for k in range(n_scans):
        written += scans_of(scene, k, seed=seed)
        if progress is not None:
            progress(k + 1, n_scans)
    mounts = {lidar.name: scene.mount(lidar) for lidar in scene.lidar}
    sensors = {
        lidar.name: {
            "sigma_range_m": lidar.sigma_range_m, "sigma_azimuth_deg": lidar.step_deg / math.sqrt(12.0),
            "forward_m": lidar.forward_m, "starboard_m": lidar.starboard_m,
        }
        for lidar in scene.lidar
    }  # fmt: skip
    reference = reference_of(scene, n_scans)
    octets = write_points(
        written, frame="polar", origin=scene.origin, sensors=sensors, mounts=mounts, reference=reference
    )  # fmt: skip
    write_octets(out, octets)
    points = sum(len(scan.points) for scan in written if scan.points is not None)
    return {
        "recording": str(out), "octets": len(octets), "scans": n_scans, "points": points,
        "objects": len(scene.boat), "truth_rows": len(reference.t_ns), "seed": seed,
    }  # fmt: skip
