"""Offsets of a sensor by robust least squares: iteratively re-weighted, with clusters and ships paired anew each time.

Unknown are the offsets of azimuth and range, the latency of the sensor's clock, how late each ship's reports are, how
much of a hull's near side its echo shows, and where on each ship it lies (along and across, within what its length
allows). A residual is the ship's place less
the cluster's, along the ray and across it. A lag and the latency shift the same way: most transponders are taken to
be punctual, and a ship that disagrees is late. Uncertainties are those of a sum over stretches of half a minute
(sandwich covariance), since the echo of a hull wanders slowly and neighbouring scans err alike. Where tracks of
another radar stand for the ships, they are no less than those of a sum over whole ships: the two echoes of a hull lie
apart for all of its way. How far apart changes as ships turn and pass, which is unknown too (`wander`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from maritrack import geo
from maritrack.calibrate.sightings import Sightings, Way, thinned
from maritrack.calibrate.wander import WIDTH, between_knots, knots, spacing_s, wander_prior
from maritrack.types import BoolArray, FloatArray, IntArray

SIGMA_LATENCY_S = 5.0  # of sensors; a radar that tells its picture later than this is not one to sail with
SIGMA_LAG_S = (1.0, 60.0)  # of reports of ships that are punctual, and of others
LATE_S, LATE_SIGMAS = 5.0, 3.0  # a ship is late that differs from the others by both
NEAR_SIDE, SIGMA_NEAR_SIDE = 0.25, 0.25  # of half a hull's depth: how much nearer than its middle its echo lies
FIRST_M, FIRST_RAD = 60.0, math.radians(0.5)  # residuals before they are known
LEAST_M, LEAST_RAD = 3.0, math.radians(0.05)
HUBER, GATE = 1.5, 4.0  # in standard deviations: full weight up to the first, none beyond the second
STRETCH_S = 30.0
CELL_SHARE = 0.1  # of a cell: no offset is known better
CHANGES = 0.25  # of how far off an echo may lie: by as much it wanders as a ship comes nearer and more of it shows
ROUNDS = 12
FIXED = 4  # azimuth, range, latency, near side; then a lag a ship, two places a ship, and half a length a ship
NEAR_END_M, SIGMA_NEAR_END_M = 25.0, 50.0  # half of a hull that another radar has tracked: ships are 10 to 400 m long


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Estimates with their covariance, in radians, metres and seconds."""

    value: FloatArray  # (p,) azimuth, range, latency, near side, lag (s), along and across (s, 2), half length (s)
    cov: FloatArray  # (p, p)
    shift_s: FloatArray  # (s,) lag less latency: what each ship alone tells
    lag_sigma_s: FloatArray  # (s,) of the shift and the latency
    used: IntArray  # (s,) associations
    late: BoolArray  # (s,)
    cost: float  # robust, of residuals in units of `FIRST_M` and `FIRST_RAD`: to compare fits
    rms_m: float  # weighted, of residuals

    def sigma(self, i: int) -> float:
        return math.sqrt(max(float(self.cov[i, i]), 0.0))


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Associations, one a ship and scan, with residuals (m, 2) and Jacobian (m, 2, p)."""

    ship: IntArray
    t_s: FloatArray
    e: FloatArray
    J: FloatArray
    range_m: FloatArray


def fit(sightings: Sightings, ways: tuple[Way, ...], first: FloatArray, *, lags: bool) -> Fit:
    """The estimates from a first guess (p,). Without `lags` all ships are punctual."""
    n = len(ways)
    sightings = thinned(sightings, ways, columns=len(first) + len(wander_prior(ways)))
    late = np.full(n, lags)
    free = _solve(sightings, ways, first, late)
    if not lags:
        return free
    late = _who_is_late(free.shift_s, np.sqrt(np.maximum(_shift_variance(free, ways), 0.0)))
    punctual = _solve(sightings, ways, free.value, late)
    sigma = np.sqrt(np.maximum(_shift_variance(free, ways) + punctual.cov[2, 2], 0.0))
    return replace(punctual, shift_s=free.shift_s, lag_sigma_s=sigma)


def _shift_variance(found: Fit, ways: tuple[Way, ...]) -> FloatArray:
    """Of lag less latency (n,).

    Not less than what the ship needs to go as far as its echo may lie from its antenna: of a long ship whose echo
    lies ahead of it a steady course tells nothing else.
    """
    i, C = np.arange(FIXED, FIXED + len(ways)), found.cov
    return np.asarray(C[i, i] + C[2, 2] - 2.0 * C[i, 2] + np.array([w.bias_m / w.speed_mps for w in ways]) ** 2)


def first_guess(azimuth_rad: float, range_m: float, shift_s: FloatArray) -> FloatArray:
    """Values to begin with, the shift of each ship as its lag."""
    n = len(shift_s)
    return np.concatenate([[azimuth_rad, range_m, 0.0, NEAR_SIDE], shift_s, np.zeros(2 * n), np.full(n, NEAR_END_M)])


def _solve(sightings: Sightings, ways: tuple[Way, ...], first: FloatArray, late: BoolArray) -> Fit:
    n, p = len(ways), len(first)
    wander = wander_prior(ways)
    x, mean = (np.concatenate([value, np.zeros(len(wander))]) for value in (first, first_guess(0.0, 0.0, np.zeros(n))))
    sigma_m, sigma_rad = FIRST_M, FIRST_RAD
    prior = block_diag(np.diag(1.0 / _prior_sigma(ways, late) ** 2), wander)
    for k in range(ROUNDS):
        rows = _pair(sightings, ways, x, sigma_m, sigma_rad)
        weight, inverse = _weights(rows, sigma_m, sigma_rad)
        JW = rows.J * (weight[:, None] * inverse)[:, :, None]
        A = np.einsum("mrp,mrq->pq", JW, rows.J) + prior
        x = x - np.linalg.solve(A, np.einsum("mrp,mr->p", JW, rows.e) + prior @ (x - mean))
        if 2 < k < ROUNDS - 3:
            sigma_m, sigma_rad = _spread(rows)
    rows = _pair(sightings, ways, x, sigma_m, sigma_rad)
    weight, inverse = _weights(rows, sigma_m, sigma_rad)
    JW = rows.J * (weight[:, None] * inverse)[:, :, None]
    bread = np.linalg.inv(np.einsum("mrp,mrq->pq", JW, rows.J) + prior)
    score = np.einsum("mrp,mr->mp", JW, rows.e)
    _, index = np.unique(_stretches(rows), return_inverse=True)
    sums = np.zeros((int(index.max(initial=-1)) + 1, len(x)))
    np.add.at(sums, index, score)
    meat = sums.T @ sums + prior
    cov = bread @ meat @ bread
    if any(way.seen_from_m is not None for way in ways):
        cov = _by_ship(cov, bread, rows, score, prior)
        cov[1, 1] += CHANGES**2 * float(np.mean([way.bias_m**2 for way in ways])) / n
    cov, cost, x = cov[:p, :p], _cost(sightings, ways, x), x[:p]
    cov[0, 0] += (CELL_SHARE * sightings.cell_rad) ** 2
    cov[1, 1] += (CELL_SHARE * sightings.cell_m) ** 2
    shift = x[FIXED : FIXED + n] - x[2]
    square = float((weight * (rows.e**2).sum(axis=1)).sum() / max(float(weight.sum()), 1e-9))
    return Fit(
        x, cov, shift, np.zeros(n), np.bincount(rows.ship, minlength=n), late, cost,
        math.sqrt(square),
    )  # fmt: skip


def _by_ship(cov: FloatArray, bread: FloatArray, rows: _Rows, score: FloatArray, prior: FloatArray) -> FloatArray:
    """The covariance (p, p), no variance of it less than that of whole ships, or than that of the model.

    An echo that lies off its ship does so for all of the ship's way: looks at one ship are not independent. But few
    ships may agree by chance.
    """
    _, index = np.unique(rows.ship, return_inverse=True)
    n = int(index.max(initial=-1)) + 1
    if n < 2:
        return cov
    sums = np.zeros((n, len(cov)))
    np.add.at(sums, index, score)
    ships = bread @ (n / (n - 1) * sums.T @ sums + prior) @ bread
    least = np.maximum(np.diag(ships), np.diag(bread))
    more = np.sqrt(np.maximum(least / np.diag(cov), 1.0))
    return np.asarray(cov * more * more[:, None])


def _prior_sigma(ways: tuple[Way, ...], late: BoolArray) -> FloatArray:
    flat = [math.radians(90.0), 10_000.0, SIGMA_LATENCY_S, SIGMA_NEAR_SIDE]
    places_m = np.repeat([way.bias_m for way in ways], 2)
    lags_s = np.where(late, SIGMA_LAG_S[1], SIGMA_LAG_S[0])
    return np.concatenate([flat, lags_s, places_m, np.full(len(ways), SIGMA_NEAR_END_M)])


def _pair(
    sightings: Sightings, ways: tuple[Way, ...], x: FloatArray, sigma_m: float, sigma_rad: float, gate: float = GATE
) -> _Rows:
    """For each ship and scan the nearest cluster, where one is within the gate."""
    n, parts = len(ways), []
    apart_s = spacing_s(ways)
    first_knot = len(x) - 2 * sum(knots(way, apart_s) for way in ways)
    t_s, sensor_m = sightings.t_s, sightings.sensor_m(sightings.t_s - x[2])
    for s, way in enumerate(ways):
        position, velocity, under_way = way.at(t_s + x[FIXED + s] - x[2])
        speed = np.maximum(np.hypot(velocity[:, 0], velocity[:, 1]), 1e-6)
        along = velocity / speed[:, None]
        across = np.stack([along[:, 1], -along[:, 0]], axis=1)
        i, half = FIXED + n + 2 * s, FIXED + 3 * n + s
        end = _other_end(way, along, across, position, sensor_m, t_s + x[FIXED + s] - x[2])
        place = position + x[i] * along + x[i + 1] * across + x[half] * end
        shares: list[tuple[int, IntArray, FloatArray]] = []  # place that they are like, number, share of it
        if n_knots := knots(way, apart_s):
            before, on = between_knots(way, t_s, apart_s)
            shares = [
                (j, first_knot + k * n_knots + before + b, on if b else 1.0 - on)
                for k, j in ((0, i), (1, i + 1))
                for b in (0, 1)
            ]
            first_knot += 2 * n_knots
        for j, knot, share in shares:
            place += (share * x[knot])[:, None] * (along if j == i else across)
        r, a = geo.en_to_polar(place - sensor_m)
        depth = _half_depth(way, along, position - sensor_m)
        e = np.stack(
            [r - x[3] * depth - sightings.range_m - x[1], r * geo.wrap(a - sightings.azimuth_rad - x[0])], axis=1
        )  # fmt: skip
        d2 = (e**2 / _variance(r, sigma_m, sigma_rad)).sum(axis=1)
        near = np.flatnonzero(under_way & (d2 < gate**2))
        near = near[np.lexsort((d2[near], sightings.scan[near]))]
        near = near[np.append(True, np.diff(sightings.scan[near]) > 0)[: len(near)]]
        ray = np.stack([np.sin(a[near]), np.cos(a[near])], axis=1)
        side = np.stack([ray[:, 1], -ray[:, 0]], axis=1)
        axes = np.stack([ray, side], axis=1)  # (m, 2, 2)
        J = np.zeros((len(near), 2, len(x)))
        J[:, 0, 1], J[:, 1, 0] = -1.0, -r[near]
        J[:, 0, 3] = -depth[near]
        J[:, :, FIXED + s] = np.einsum("mrk,mk->mr", axes, velocity[near])
        own_mps = sensor_m[near] - sightings.sensor_m(t_s[near] - x[2] - 1.0)  # in the second before
        J[:, :, 2] = np.einsum("mrk,mk->mr", axes, own_mps) - J[:, :, FIXED + s]
        J[:, :, i] = np.einsum("mrk,mk->mr", axes, along[near])
        J[:, :, i + 1] = np.einsum("mrk,mk->mr", axes, across[near])
        J[:, :, half] = np.einsum("mrk,mk->mr", axes, end[near])
        for j, knot, share in shares:
            J[np.arange(len(near)), :, knot[near]] = share[near][:, None] * J[:, :, j]
        parts.append(_Rows(np.full(len(near), s), t_s[near], e[near], J, r[near]))
    names = ("ship", "t_s", "e", "J", "range_m")
    return _Rows(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def _other_end(
    way: Way, along: FloatArray, across: FloatArray, position_m: FloatArray, sensor_m: FloatArray, t_s: FloatArray
) -> FloatArray:
    """How far this radar's echo of a hull lies from the other radar's, in half lengths (m, 2).

    Each sees what is turned to it, from ahead the bow, from abeam the middle: - (course . ray) of half a length, and
    so of half a width. Both the same where they look from one side; zero for ships that told where they are.
    """
    if way.seen_from_m is None:
        return np.zeros_like(position_m)
    turned = _ray(position_m - way.radar_m(t_s)) - _ray(position_m - sensor_m)
    length, width = (along * turned).sum(axis=1), WIDTH * (across * turned).sum(axis=1)
    return np.asarray(length[:, None] * along + width[:, None] * across)


def _ray(offset_m: FloatArray) -> FloatArray:
    """Unit vectors (m, 2)."""
    return np.asarray(offset_m / np.maximum(np.hypot(offset_m[:, 0], offset_m[:, 1]), 1e-9)[:, None])


def _half_depth(way: Way, along: FloatArray, offset_m: FloatArray) -> FloatArray:
    """Half of what the hull takes up along the ray (m,); 0 where its length is not known."""
    if not way.length_m > 0:
        return np.zeros(len(along))
    width_m = way.width_m if way.width_m > 0 else way.length_m * WIDTH
    ray = _ray(offset_m)
    cos, sin = np.abs((along * ray).sum(axis=1)), np.abs(along[:, 0] * ray[:, 1] - along[:, 1] * ray[:, 0])
    return np.asarray((way.length_m * cos + width_m * sin) / 2)


def _variance(range_m: FloatArray, sigma_m: float, sigma_rad: float) -> FloatArray:
    """Of residuals along the ray and across it (m, 2)."""
    return np.stack([np.full(len(range_m), sigma_m**2), sigma_m**2 + (range_m * sigma_rad) ** 2], axis=1)


def _weights(rows: _Rows, sigma_m: float, sigma_rad: float) -> tuple[FloatArray, FloatArray]:
    """Huber's weight of each association, a stretch of a ship counting once, and its inverse variances (m, 2)."""
    inverse = 1.0 / _variance(rows.range_m, sigma_m, sigma_rad)
    d = np.sqrt((rows.e**2 * inverse).sum(axis=1))
    _, index, count = np.unique(_stretches(rows), return_inverse=True, return_counts=True)
    return np.minimum(1.0, HUBER / np.maximum(d, 1e-9)) / count[index], inverse


def _stretches(rows: _Rows) -> IntArray:
    """Number of the half minute of a ship (m,) that each association belongs to."""
    return np.asarray(rows.ship * 1_000_000 + np.floor(rows.t_s / STRETCH_S).astype(np.int64))


def _spread(rows: _Rows) -> tuple[float, float]:
    """Standard deviations along the ray (m) and across it (rad), by medians; not more than at first."""
    if len(rows.t_s) == 0:
        return FIRST_M, FIRST_RAD
    along = 1.4826 * float(np.median(np.abs(rows.e[:, 0])))
    across = 1.4826 * float(np.median(np.abs(rows.e[:, 1]) / np.maximum(rows.range_m, 1.0)))
    return min(max(along, LEAST_M), FIRST_M), min(max(across, LEAST_RAD), 2 * FIRST_RAD)


def _cost(sightings: Sightings, ways: tuple[Way, ...], x: FloatArray) -> float:
    """Half squared residuals of all ships and scans, those without a cluster at what the gate costs."""
    rows = _pair(sightings, ways, x, FIRST_M, FIRST_RAD)
    d2 = (rows.e**2 / _variance(rows.range_m, FIRST_M, FIRST_RAD)).sum(axis=1)
    expected = 0
    for s, way in enumerate(ways):
        position, _, under_way = way.at(sightings.t_s + x[FIXED + s] - x[2])
        r, _ = geo.en_to_polar(position - sightings.sensor_m(sightings.t_s))
        expected += len(np.unique(sightings.scan[under_way & (r <= sightings.reach_m)]))
    return float(d2.sum() / 2 + (expected - len(d2)) * GATE**2 / 2)


def _who_is_late(shift_s: FloatArray, sigma_s: FloatArray) -> BoolArray:
    """Ships whose reports are not as punctual as those of the most.

    The latency is where most shifts lie, less than `SIGMA_LATENCY_S` or so; a ship beyond counts no more than one
    that is just late.
    """
    sigma = np.maximum(sigma_s, SIGMA_LAG_S[0])
    latency = np.arange(-40.0, 40.01, 0.1)
    apart = np.minimum(((shift_s + latency[:, None]) / sigma) ** 2, LATE_SIGMAS**2).sum(axis=1)
    best = latency[(apart + (latency / SIGMA_LATENCY_S) ** 2).argmin()]
    off = np.abs(shift_s + best)
    return np.asarray((off > LATE_S) & (off > LATE_SIGMAS * sigma))
