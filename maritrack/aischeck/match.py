"""Which track is which ship, over time: distances by their covariances, lags of transponders, the best assignment.

The cost of a pair in a scan is the mean square of its normalised distance over the scans around it, so that one scan
alone changes nothing; of all pairs within the gate the assignment with the least sum is taken, scan by scan.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from maritrack.aischeck.ships import CLOCK_S, GNSS_M, Ship
from maritrack.objects import matrix2
from maritrack.retrospect import History
from maritrack.types import BoolArray, FloatArray, IntArray

GATE = 13.8  # 99.9 % of normalised squared distances in the plane
AROUND = 10  # rows to either side that a cost is the mean of
LAG_SIGMA_S = 10.0  # of lags, before anything is seen
LAG_STEP_S, LAG_LEAST_S, LAG_GAIN = 2.0, 5.0, 40.0  # a lag counts from this on, and when it explains so much more
LAG_SHARE = 0.5  # ... and no lag less than this share of it: else a convoy's next ship would do
UNDER_WAY_MPS = 1.0
FORGOTTEN_M = 200.0  # a track that is less certain than this says nothing


@dataclass(frozen=True, slots=True, eq=False)
class TrackRows:
    """The rows of all tracks with what the check needs, ordered by track, then scan."""

    scan: IntArray  # (m,)
    id: IntArray  # (m,)
    t_s: FloatArray  # (m,)
    position_m: FloatArray  # (m, 2)
    velocity_mps: FloatArray  # (m, 2)
    cov: FloatArray  # (m, 4, 4)
    hit: BoolArray  # (m,)
    range_m: FloatArray  # (m,) from the radar that looked
    azimuth_rad: FloatArray  # (m,)


@dataclass(frozen=True, slots=True)
class Noise:
    """Errors of the radar that filters do not know of."""

    azimuth_rad: float  # standard deviation of what is left of its azimuth offset
    range_m: float  # ... and of ranges: half a cell


@dataclass(frozen=True, slots=True, eq=False)
class Matching:
    """The outcome."""

    ship: IntArray  # (m,) index of the ship of each row, -1 = none
    offset_m: FloatArray  # (m, 2) track minus ship; nan without a ship
    d2: FloatArray  # (m,) its normalised square


def position_noise(rows: TrackRows, i: IntArray, ship: Ship, velocity_mps: FloatArray, noise: Noise) -> FloatArray:
    """Covariances (n, 2, 2) of track minus ship at rows `i`."""
    along = np.stack([np.sin(rows.azimuth_rad[i]), np.cos(rows.azimuth_rad[i])], axis=-1)
    across = np.stack([along[:, 1], -along[:, 0]], axis=-1)
    every = GNSS_M**2 + ship.hull_m**2
    P = rows.cov[i][:, :2, :2] + every * np.eye(2)
    P = P + noise.range_m**2 * along[:, :, None] * along[:, None, :]
    P = P + (rows.range_m[i] * noise.azimuth_rad)[:, None, None] ** 2 * across[:, :, None] * across[:, None, :]
    return np.asarray(P + CLOCK_S**2 * velocity_mps[:, :, None] * velocity_mps[:, None, :])


def square(offset: FloatArray, cov: FloatArray) -> FloatArray:
    """Normalised squares (n,) of offsets (n, 2)."""
    solved = np.linalg.solve(cov, offset[:, :, None])[:, :, 0]
    return np.asarray((offset * solved).sum(axis=1))


def distances(
    rows: TrackRows, i: IntArray, ship: Ship, noise: Noise, *, lag_s: float | None = None
) -> tuple[FloatArray, FloatArray]:
    """Offsets (n, 2) and their normalised squares (n,) at rows `i`; inf where the ship or the track is not known."""
    at, velocity, known = ship.at(rows.t_s[i], lag_s=lag_s)
    spread = matrix2.eigen(rows.cov[i][:, :2, :2])[0][:, 0]
    usable = known & (spread < FORGOTTEN_M**2)
    offset = rows.position_m[i] - at
    d2 = np.full(len(i), np.inf)
    j = np.flatnonzero(usable)
    if len(j):
        d2[j] = square(offset[j], position_noise(rows, i[j], ship, velocity[j], noise))
    return offset, d2


def candidates(rows: TrackRows, ship: Ship, reach_m: float, max_lag_s: float) -> list[IntArray]:
    """The rows of each track that comes near the ship at some time, as far as it may be late."""
    at, velocity, known = ship.at(rows.t_s, lag_s=0.0)
    if max_lag_s and not known.all():  # late reports may tell of a time before the first
        later, fast, told = ship.at(rows.t_s, lag_s=max_lag_s)
        at, velocity = np.where(known[:, None], at, later), np.where(known[:, None], velocity, fast)
        known = known | told
    room = reach_m + max_lag_s * np.hypot(*np.nan_to_num(velocity).T)
    near = known & (np.hypot(*np.nan_to_num(rows.position_m - at, nan=1e9).T) < room)
    return [np.flatnonzero(rows.id == i) for i in np.unique(rows.id[near]).tolist()]


def with_lags(rows: TrackRows, ships: list[Ship], noise: Noise, max_lag_s: float) -> list[Ship]:
    """The ships with the lag at which tracks follow them best, where it explains much more than none."""
    return [replace(ship, lag_s=_lag_s(rows, ship, noise, max_lag_s)) for ship in ships]


def _lag_s(rows: TrackRows, ship: Ship, noise: Noise, max_lag_s: float) -> float:
    fast = np.hypot(*np.diff(ship.position_m, axis=0).T) > UNDER_WAY_MPS * np.maximum(np.diff(ship.t_s), 1e-3)
    near = candidates(rows, ship, 300.0, max_lag_s) if max_lag_s > 0 and fast.any() else []
    if not near:
        return 0.0
    i = np.concatenate(near)
    lags = np.arange(-max_lag_s / 2, max_lag_s + LAG_STEP_S / 2, LAG_STEP_S)
    gain = np.array(
        [_gain(rows, i, distances(rows, i, ship, noise, lag_s=lag)[1]) - (lag / LAG_SIGMA_S) ** 2 for lag in lags]
    )
    none = _gain(rows, i, distances(rows, i, ship, noise, lag_s=0.0)[1])
    best = int(np.argmax(gain))
    way = np.hypot(*np.diff(ship.position_m, axis=0).T) / np.maximum(np.diff(ship.t_s), 1e-3)
    far = abs(float(lags[best])) * float(np.median(way[fast]))  # less than this is where on the hull the echo lies
    much = gain[best] - none >= LAG_GAIN and none < LAG_SHARE * gain[best]
    if not much or abs(lags[best]) < LAG_LEAST_S or far < 3.0 * math.hypot(ship.hull_m, GNSS_M):
        return 0.0
    return float(lags[best])


def _gain(rows: TrackRows, i: IntArray, d2: FloatArray) -> float:
    """What rows `i` say for a lag: of each scan the nearest alone, and rows that are hit."""
    said = np.where(rows.hit[i], np.maximum(GATE - d2, 0.0), 0.0)
    best = np.zeros(int(rows.scan.max(initial=0)) + 1)
    np.maximum.at(best, rows.scan[i], said)
    return float(best.sum())


def match(rows: TrackRows, ships: list[Ship], noise: Noise, *, reach_m: float) -> Matching:
    """The ship of each row of the tracks."""
    n = len(rows.id)
    pair_row, pair_ship, pair_cost, pair_d2 = [], [], [], []
    offset_m = np.full((n, 2), np.nan)
    for s, ship in enumerate(ships):
        for i in candidates(rows, ship, reach_m, abs(ship.lag_s)):
            d2 = distances(rows, i, ship, noise)[1]
            cost = around(np.minimum(d2, 2 * GATE), np.isfinite(d2))
            ok = np.isfinite(d2) & (cost < GATE)
            pair_row.append(i[ok])
            pair_ship.append(np.full(int(ok.sum()), s))
            pair_cost.append(cost[ok])
            pair_d2.append(d2[ok])
    ship_of, d2_of = np.full(n, -1), np.full(n, np.nan)
    if pair_row:
        row, which, cost, d2 = (np.concatenate(p) for p in (pair_row, pair_ship, pair_cost, pair_d2))
        chosen = best_pairs(rows.scan[row], row, which, cost)
        ship_of[row[chosen]], d2_of[row[chosen]] = which[chosen], d2[chosen]
    for s, ship in enumerate(ships):
        i = np.flatnonzero(ship_of == s)
        offset_m[i] = rows.position_m[i] - ship.at(rows.t_s[i])[0]
    return Matching(ship_of, offset_m, d2_of)


def around(value: FloatArray, known: BoolArray) -> FloatArray:
    """Mean (n,) over the known values of the rows around each; inf where none is."""
    window = np.ones(2 * AROUND + 1)
    total = np.convolve(np.where(known, value, 0.0), window)[AROUND : AROUND + len(value)]
    count = np.convolve(known.astype(float), window)[AROUND : AROUND + len(value)]
    return np.where(count > 0.5, total / np.maximum(count, 1.0), np.inf)


def best_pairs(scan: IntArray, row: IntArray, ship: IntArray, cost: FloatArray) -> IntArray:
    """Indices of the pairs that make up the best assignment of each scan."""
    order = np.argsort(scan, kind="stable")
    begins = np.append(True, np.diff(scan[order]) != 0)[: len(order)]
    chosen = []
    for pairs in np.split(order, np.flatnonzero(begins)[1:]) if len(order) else []:
        r, a = np.unique(row[pairs], return_inverse=True)
        s, b = np.unique(ship[pairs], return_inverse=True)
        table = np.full((len(r), len(s)), GATE)
        table[a, b] = cost[pairs]
        index = np.full((len(r), len(s)), -1)
        index[a, b] = pairs
        picked = index[linear_sum_assignment(table)]
        chosen.append(picked[picked >= 0])
    return np.concatenate(chosen) if chosen else np.zeros(0, np.int64)


def rows_of(history: History, start_ns: int, sensor_m: FloatArray) -> TrackRows:
    """Rows of confirmed tracks; `sensor_m` (k, 2) is where the radar of each scan was, by its number."""
    tracks = history.tracks
    offset = tracks.position_m - sensor_m[history.scan]
    return TrackRows(
        history.scan, tracks.id, np.asarray((tracks.t_ns - start_ns) * 1e-9, float), tracks.position_m,
        tracks.velocity_mps, tracks.cov,
        tracks.cluster >= 0, np.hypot(*offset.T), np.arctan2(offset[:, 0], offset[:, 1]),
    )  # fmt: skip
