"""Each time the radar looked where AIS says a ship is: whether there was an echo, and how often there is one beside it.

All points of a scan count, those too that background subtraction took away: a ship at anchor is seen, though it is no
track. Beside the ship, at the same range, eight other places are looked at in the same way: what is found there comes
by chance.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from maritrack.aischeck.match import Noise
from maritrack.aischeck.ships import CLOCK_S, GNSS_M, Ship
from maritrack.geo import en_to_polar, polar_to_en, visible
from maritrack.io.archive import ArchivedScan
from maritrack.types import BoolArray, FloatArray, IntArray

BESIDE = (-9.0, -7.0, -5.0, -3.0, 3.0, 5.0, 7.0, 9.0)  # radii of its gate that the other places lie off
MOST_HALF_M = 120.0  # of a hull, that counts for the gate


@dataclass(frozen=True, slots=True, eq=False)
class Looks:
    """Looks at all ships. Leading axis: look, ordered by scan."""

    ship: IntArray  # (n,)
    scan: IntArray  # (n,)
    t_s: FloatArray  # (n,)
    range_m: FloatArray  # (n,) from the radar
    azimuth_rad: FloatArray  # (n,)
    position_m: FloatArray  # (n, 2) where AIS says that it was
    speed_mps: FloatArray  # (n,)
    radius_m: FloatArray  # (n,) of the gate
    hit: BoolArray  # (n,)
    beside: FloatArray  # (n,) share of the places beside with an echo; nan where all of them are other ships'
    hidden: BoolArray  # (n,) land lies between


def gate_m(ship: Ship, range_m: FloatArray, speed_mps: FloatArray, noise: Noise) -> FloatArray:
    """Radius (n,) about the place told in which an echo of the ship lies."""
    sigma = np.sqrt(GNSS_M**2 + noise.range_m**2 + (range_m * noise.azimuth_rad) ** 2 + (CLOCK_S * speed_mps) ** 2)
    return np.asarray(min(ship.half_m, MOST_HALF_M) + 2.0 * sigma)


def beam_s(
    azimuth_rad: FloatArray, point_azimuth_rad: FloatArray, point_s: FloatArray, otherwise_s: float
) -> FloatArray:
    """When the beam passed each azimuth (n,): the time of the point next to it."""
    if len(point_s) == 0:
        return np.full(len(azimuth_rad), otherwise_s)
    order = np.argsort(point_azimuth_rad)
    at = np.searchsorted(point_azimuth_rad[order], azimuth_rad)
    low, high = order[(at - 1) % len(order)], order[at % len(order)]
    apart = [np.abs((azimuth_rad - point_azimuth_rad[i] + np.pi) % (2 * np.pi) - np.pi) for i in (low, high)]
    return np.asarray(np.where(apart[0] <= apart[1], point_s[low], point_s[high]))


def look(
    scans: Iterable[ArchivedScan], ships: Sequence[Ship], noise: Noise, *, start_ns: int, roi_m: tuple[float, float],
    hidden_by: Sequence[FloatArray] = (),
) -> Looks:  # fmt: skip
    """All looks at the ships, while their place is told and the radar sweeps it."""
    from maritrack.aischeck.coast import hidden

    columns = [_looks_of(scan, ships, noise, start_ns, roi_m) for scan in scans]
    ship, number, t_s, range_m, azimuth, at, speed, radius, hit, beside, sensor = (
        np.concatenate([column[i] for column in columns]) for i in range(11)
    )
    return Looks(
        ship.astype(np.int64), number.astype(np.int64), t_s, range_m, azimuth, at, speed, radius, hit.astype(bool),
        beside, hidden(sensor, at, hidden_by),
    )  # fmt: skip


def _looks_of(
    scan: ArchivedScan, ships: Sequence[Ship], noise: Noise, start_ns: int, roi_m: tuple[float, float]
) -> tuple[FloatArray, ...]:
    """The columns of the looks of one scan."""
    echo_m, echo_ns = (
        (scan.clusters.mean_m, scan.clusters.t_ns)
        if scan.points is None
        else (scan.points.position_m, scan.points.t_ns)
    )
    middle_s = ((scan.scan.t_ns + scan.scan.t_start_ns) // 2 - start_ns) * 1e-9
    sensor = scan.scan.position_m
    places = [ship.at(np.array([middle_s])) for ship in ships]
    at = np.concatenate([p[0] for p in places]) if ships else np.zeros((0, 2))
    known = np.array([bool(p[2][0]) for p in places], bool)
    index = np.flatnonzero(known)
    _, azimuth = en_to_polar(at[index] - sensor)
    _, echo_azimuth = en_to_polar(echo_m - sensor)
    t_s = beam_s(azimuth, echo_azimuth, np.asarray((echo_ns - start_ns) * 1e-9, float), middle_s)
    exact = [ships[i].at(np.array([t])) for i, t in zip(index.tolist(), t_s.tolist(), strict=True)]
    keep = np.array([bool(e[2][0]) for e in exact], bool)
    index, t_s = index[keep], t_s[keep]
    at = np.concatenate([e[0] for e in exact])[keep] if exact else np.zeros((0, 2))
    velocity = np.concatenate([e[1] for e in exact])[keep] if exact else np.zeros((0, 2))
    seen = visible(scan.scan, at, *roi_m)
    index, t_s, at, velocity = index[seen], t_s[seen], at[seen], velocity[seen]
    range_m, azimuth = en_to_polar(at - sensor)
    speed = np.hypot(*velocity.T)
    radius = np.array(
        [float(gate_m(ships[i], r, v, noise)) for i, r, v in zip(index.tolist(), range_m, speed, strict=True)]
    )
    tree = cKDTree(echo_m) if len(echo_m) else None
    hit = _any(tree, at, radius)
    beside = _beside(tree, sensor, at, range_m, azimuth, radius)
    return (
        index.astype(float), np.full(len(index), float(scan.k)), t_s, range_m, azimuth, at, speed, radius,
        hit.astype(float), beside, np.tile(sensor, (len(index), 1)),
    )  # fmt: skip


def _any(tree: cKDTree | None, at: FloatArray, radius: FloatArray) -> BoolArray:
    """Whether an echo lies within the radius of each place (n, 2)."""
    if tree is None or len(at) == 0:
        return np.zeros(len(at), bool)
    return np.asarray(tree.query(at)[0] <= radius)


def _beside(
    tree: cKDTree | None, sensor: FloatArray, at: FloatArray, range_m: FloatArray, azimuth: FloatArray,
    radius: FloatArray,
) -> FloatArray:  # fmt: skip
    """Share (n,) of the places beside each ship with an echo, those apart that another ship may lie in."""
    turn = np.array(BESIDE)[None, :] * (radius / np.maximum(range_m, radius))[:, None]
    places = sensor + polar_to_en(np.repeat(range_m[:, None], len(BESIDE), 1), azimuth[:, None] + turn)
    found = _any(tree, places.reshape(-1, 2), np.repeat(radius, len(BESIDE))).reshape(len(at), len(BESIDE))
    near = np.hypot(*np.moveaxis(places[:, :, None] - at[None, None], -1, 0)) < 2.0 * radius[None, None, :]
    free = ~near.any(axis=2) if len(at) else np.zeros((0, len(BESIDE)), bool)
    count = free.sum(axis=1)
    return np.where(count > 0, (found & free).sum(axis=1) / np.maximum(count, 1), np.nan)
