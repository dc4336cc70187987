"""Tracks that are no ship of AIS: those that go as a ship does but elsewhere, and those that nothing explains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from maritrack.aischeck.judge import Displacement
from maritrack.aischeck.looks import gate_m
from maritrack.aischeck.match import FORGOTTEN_M, Matching, Noise, TrackRows, position_noise
from maritrack.aischeck.ships import Ship
from maritrack.geo import en_to_polar, polar_to_en, wrap
from maritrack.types import BoolArray, FloatArray, IntArray

LEAST_SCANS, LEAST_S, LEAST_SHARE = 12, 45.0, 0.4  # that a track and a ship go alike
LEAST_WAY_M, LEAST_WAY = 150.0, 8.0  # that the ship made meanwhile, and in spreads of the distance between them
UNDER_WAY_MPS = 1.5
SIGMAS = 3.0
LEAST_RANGE_M = 10.0  # of ranges of a radar without cells
LOBE_RAD = (np.pi / 18, np.pi / 3)  # side lobes that make tracks of their own are so far beside; an escort is nearer
UNTOLD_S = 180.0  # a ship that did not report for so long may still be near


@dataclass(frozen=True, slots=True)
class Stranger:
    """A track under way that no AIS explains."""

    track: int
    scans: int
    first_s: float
    last_s: float
    from_m: tuple[float, float]
    to_m: tuple[float, float]
    speed_mps: float
    course_rad: float
    range_m: tuple[float, float]
    lobe_of: str = ""  # id of the ship whose side lobes it seems to be


def displacements(
    rows: TrackRows, ships: Sequence[Ship], matched: BoolArray, matching: Matching, noise: Noise, reach_m: float
) -> list[Displacement | None]:  # fmt: skip
    """For each ship that no track confirms, the track without a ship that goes as it does, if there is one.

    Alike are ways in parallel, at a distance that stays while the ship makes way, for most of the time of both: that
    the track moves need not be known besides. A convoy of a ship that the radar misses and one that tells no AIS looks
    the same.
    """
    free = [int(i) for i in np.unique(rows.id).tolist() if _free(rows.id == i, matching)]
    left = [s for s in range(len(ships)) if not matched[s]]
    cost = np.full((len(left), len(free)), 1e3)
    scans = len(np.unique(rows.scan))
    found: dict[tuple[int, int], Displacement] = {}
    for a, s in enumerate(left):
        for b, track in enumerate(free):
            told = _alike(rows, np.flatnonzero(rows.id == track), ships[s], noise, reach_m, scans)
            if told is not None:
                found[a, b], cost[a, b] = Displacement(track, *told[:-1]), told[-1]
    result: list[Displacement | None] = [None] * len(ships)
    for a, b in zip(*linear_sum_assignment(cost), strict=True):
        if (a, b) in found:
            others = tuple(sorted(free[j] for i, j in found if i == a and j != b))
            result[left[a]] = replace(found[a, b], others=others)
    return result


def doubles(
    rows: TrackRows, ships: Sequence[Ship], matching: Matching, noise: Noise, reach_m: float
) -> list[tuple[int, ...]]:
    """For each ship whose reports seem late, the tracks without a ship that go as it does: it may be one of those."""
    free = [int(i) for i in np.unique(rows.id).tolist() if _free(rows.id == i, matching)]
    scans = len(np.unique(rows.scan))

    def of(ship: Ship) -> tuple[int, ...]:
        told = replace(ship, lag_s=0.0)
        alike = (i for i in free if _alike(rows, np.flatnonzero(rows.id == i), told, noise, reach_m, scans) is not None)
        return tuple(alike)

    return [of(ship) if ship.lag_s else () for ship in ships]


def _free(of_track: BoolArray, matching: Matching) -> bool:
    return bool((matching.ship[of_track] < 0).mean() > 0.5)


def _alike(
    rows: TrackRows, i: IntArray, ship: Ship, noise: Noise, reach_m: float, scans: int
) -> tuple[int, tuple[float, float], float, float] | None:
    """Scans, mean offset, its sigma and a cost, of a track that goes as the ship does."""
    at, velocity, known = ship.at(rows.t_s[i])
    sure = np.trace(rows.cov[i][:, :2, :2], axis1=1, axis2=2) < FORGOTTEN_M**2
    use = known & sure & (np.hypot(*np.nan_to_num(velocity).T) > UNDER_WAY_MPS)
    overlap = min(len(i), max(int(known.sum()), 1))
    if use.sum() < LEAST_SCANS or np.ptp(rows.t_s[i][use]) < LEAST_S or use.sum() < LEAST_SHARE * overlap:
        return None
    offset = rows.position_m[i][use] - at[use]
    mean = offset.mean(axis=0)
    far = float(np.hypot(*mean))
    noise_m = position_noise(rows, i[use], ship, velocity[use], noise)
    sigma = float(np.sqrt(np.trace(noise_m, axis1=1, axis2=2).mean() / 2))
    spread = float(np.sqrt(((offset - mean) ** 2).sum(axis=1).mean() / 2))
    way = float(np.hypot(*(at[use][-1] - at[use][0])))
    if far > reach_m or far < SIGMAS * sigma or spread > 1.5 * sigma or way < max(LEAST_WAY_M, LEAST_WAY * spread):
        return None
    missing = 1.0 - float(use.sum()) / max(scans, 1)  # of two that go alike the one that does for longer
    cost = spread / sigma + far / reach_m + missing
    return int(use.sum()), (float(mean[0]), float(mean[1])), sigma, cost


def strangers(
    rows: TrackRows, moving: BoolArray, ships: Sequence[Ship], matched: BoolArray, matching: Matching, noise: Noise,
    taken: set[int], least_hits: int,
) -> list[Stranger]:  # fmt: skip
    """Moving tracks that are no ship of AIS, nor near one that is known or was a while ago. `taken` are displaced."""
    found = []
    for track in np.unique(rows.id[moving]).tolist():
        i = np.flatnonzero(rows.id == track)
        if track in taken or not _free(rows.id == track, matching):
            continue
        alone = (matching.ship[i] < 0) & ~near_a_ship(rows, i, ships, noise)
        if alone.mean() <= 0.5 or (alone & rows.hit[i]).sum() < least_hits:
            continue
        j = i[alone]
        way = rows.position_m[j[-1]] - rows.position_m[j[0]]
        velocity = np.median(rows.velocity_mps[j], axis=0)
        speed, course = float(np.hypot(*velocity)), float(np.arctan2(way[0], way[1]) % (2 * np.pi))
        found.append(
            Stranger(
                int(track), len(j), float(rows.t_s[j[0]]), float(rows.t_s[j[-1]]), _pair(rows.position_m[j[0]]),
                _pair(rows.position_m[j[-1]]), speed, course,
                (float(rows.range_m[j].min()), float(rows.range_m[j].max())),
                side_lobe_of(rows, j, [ship for ship, sure in zip(ships, matched, strict=True) if sure], noise),
            )
        )  # fmt: skip
    return found


def side_lobe_of(rows: TrackRows, i: IntArray, ships: Sequence[Ship], noise: Noise) -> str:
    """The ship whose range the rows `i` of a track keep while it changes, at another azimuth; "" = none.

    A strong echo comes in through the side lobes of the antenna too: at the same range, tens of degrees beside it.
    """
    near_m = 2.0 * max(noise.range_m, LEAST_RANGE_M)
    if np.ptp(rows.range_m[i]) < 4.0 * near_m:
        return ""
    radar_m = rows.position_m[i] - polar_to_en(rows.range_m[i], rows.azimuth_rad[i])
    for ship in ships:
        at, _, known = ship.at(rows.t_s[i])
        if known.sum() < 0.8 * len(i):
            continue
        range_m, azimuth = en_to_polar(at[known] - radar_m[known])
        beside = np.abs(wrap(azimuth - rows.azimuth_rad[i][known]))
        off_m = float(np.sqrt(np.mean((range_m - rows.range_m[i][known]) ** 2)))
        if off_m < near_m and LOBE_RAD[0] < float(np.median(beside)) < LOBE_RAD[1]:
            return ship.id
    return ""


def near_a_ship(rows: TrackRows, i: IntArray, ships: Sequence[Ship], noise: Noise) -> BoolArray:
    """Whether rows `i` lie where a ship of AIS is, or may be that has not reported for a while."""
    near = np.zeros(len(i), bool)
    for ship in ships:
        at, velocity, known = ship.at(rows.t_s[i])
        speed = np.hypot(*np.nan_to_num(velocity).T)
        room = gate_m(ship, rows.range_m[i], speed, noise)  # what is within is a part of it, its wake or its shadow
        far = np.hypot(*(rows.position_m[i] - np.nan_to_num(at, nan=1e9)).T)
        near |= known & (far < room)
        near |= ~known & _may_be(ship, rows.t_s[i] + ship.lag_s, rows.position_m[i])
    return near


def _may_be(ship: Ship, t_s: FloatArray, place_m: FloatArray) -> BoolArray:
    """Whether a ship whose reports do not tell its place may be at places (n, 2): as far as it sailed when it told."""
    if len(ship.t_s) == 0:
        return np.zeros(len(t_s), bool)
    after = np.clip(np.searchsorted(ship.t_s, t_s), 0, len(ship.t_s) - 1)
    may = np.zeros(len(t_s), bool)
    told = np.hypot(*np.nan_to_num(ship.velocity_mps).T)
    way = np.hypot(*np.diff(ship.position_m, axis=0).T) / np.maximum(np.diff(ship.t_s), 1e-3)
    speed = max(float(told.max(initial=0.0)), float(np.median(way)) if len(way) else 0.0, 1.0)
    for report in (np.maximum(after - 1, 0), after):
        since = np.abs(t_s - ship.t_s[report])
        far = np.hypot(*(place_m - ship.position_m[report]).T)
        may |= (since <= UNTOLD_S) & (far <= 200.0 + speed * since)
    return may


def _pair(value: FloatArray) -> tuple[float, float]:
    return float(value[0]), float(value[1])
