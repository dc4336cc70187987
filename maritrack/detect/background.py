"""Adaptive background subtraction: what comes back scan after scan in the same place is no vessel under way.

Each pixel of a grid in east-north keeps a distribution psi over how many points it has in a scan: 0 .. v - 1, learned
by stochastic weak estimation (Oommen, Rueda 2006). Pixels that never had a point all have the same psi, so only the
others have a row. An observation c takes psi to a psi + (1 - a) e_c, and with it what is asked of a row: how likely it
is to have points, its distance from an empty one, how likely counts above the threshold are. Each of these follows
from its value before and from psi_c alone, so that no scan looks at all counts of a row; where a row has no point all
of them shrink by a. What psi_c is, `pairs` tells, of the counts that the row had; the others have their equal share of
the start. Time is counted in e-folds, -log a a look, so that a may differ from scan to scan.
All of this is exact, not an approximation of the dense model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maritrack import geo
from maritrack.detect.pairs import (
    BITS,
    NO_PAIRS,
    Pairs,
    found,
    level_of,
    merged,
    observed,
    of_rows,
    others,
    with_rows,
)
from maritrack.settings import SubtractConfig
from maritrack.types import BoolArray, FloatArray, IntArray, Mask, Points, Scan, Tracks, take

TINY = 1e-17  # a count as unlikely as this is as good as one that never was
FAINT = 1e-250  # and this is zero; less would be slow to reckon with
TIDY = 16.0  # e-folds after which both are looked for


@dataclass(frozen=True, slots=True, eq=False)
class Background:
    """The model after a scan. Rows are the pixels that ever had a point, ascending by key."""

    key: IntArray  # (n,) geo.pixel_key
    late: FloatArray  # (n,) e-folds in which the row was not looked at: now - late is its own time
    base: FloatArray  # (n,) log psi of each count at the beginning: the level of those that it never had
    rest: FloatArray  # (n,) 1 - psi_0
    drift: FloatArray  # (n,) |psi - e_0|
    high: FloatArray  # (n,) psi of the likeliest count above the threshold; where the tail decides, of all of them
    low: FloatArray  # (n,) psi of the likeliest count up to the threshold but 0; 0 where the tail decides
    last: NDArray[np.int16]  # (n,) count at the last look
    off: FloatArray  # (n,) |psi - e_last|, where last > 0
    pairs: Pairs = NO_PAIRS
    now: float = 0.0  # e-folds since the beginning
    change: tuple[float, ...] = ()  # abs-9 of the last scans, sum over the pixels of this list, newest last
    scans: int = 0
    converged: bool = False
    settled: bool = False  # converged in time, not by the limit
    t_ns: int = 0  # of the last scan
    corner_m: tuple[float, float] = (0.0, 0.0)  # east-north of a corner of pixel (0, 0)

    def __len__(self) -> int:
        return len(self.key)


def no_background(corner_m: tuple[float, float] = (0.0, 0.0)) -> Background:
    """The model before the first scan."""
    no = np.zeros(0)
    return Background(no.astype(np.int64), no, no, no, no, no, no, no.astype(np.int16), no, corner_m=corner_m)


def learn(
    model: Background, scan: Scan, points: Points, rules: SubtractConfig, *,
    roi_min_m: float = 0.0, roi_max_m: float = math.inf, spared: Tracks | None = None,
) -> Background:  # fmt: skip
    """The model with one more scan: counts of its points per pixel, 0 in each pixel that it looked at.

    What lies under the tracks `spared` is not looked at.

    A pixel whose centre is out of the scan's range, of the region of interest or of the sector swept has seen
    nothing and stays as it is. One that never had a point counts as looked at in every scan.
    """
    rate = rate_of(model, scan, rules)
    position_m = points.position_m[points.range_m <= roi_max_m]
    centre_m = geo.pixel_centre(model.key, rules.pixel_m, model.corner_m)
    seen = geo.visible(scan, centre_m, roi_min_m, roi_max_m)
    if spared is not None and len(spared):
        position_m = position_m[~under(spared, position_m, scan.t_ns, rules.pixel_m)]
        seen &= ~under(spared, centre_m, scan.t_ns, rules.pixel_m)
    key, count = np.unique(geo.pixel_key(position_m, rules.pixel_m, model.corner_m), return_counts=True)
    model = replace(model, scans=model.scans + 1, t_ns=scan.t_ns)
    return model if rate >= 1.0 else take_counts(model, key, count, seen, rules, rate=rate)


def under(tracks: Tracks, position_m: FloatArray, t_ns: int, margin_m: float) -> BoolArray:
    """Which positions (n, 2) lie under one of the tracks, moved on to a time: in its ellipse or so near to it."""
    result = np.zeros(len(position_m), bool)
    east_m, north_m = np.ascontiguousarray(position_m.T)
    at = tracks.position_m + tracks.velocity_mps * ((t_ns - tracks.t_ns) * 1e-9)[:, None]
    shape = np.linalg.inv(tracks.extent_m2 + margin_m**2 * np.eye(2))
    for (east, north), ((ee, en), (_, nn)) in zip(at.tolist(), shape.tolist(), strict=True):
        x, y = east_m - east, north_m - north
        result |= (ee * x + 2.0 * en * y) * x + nn * y * y <= 1.0
    return result


def rate_of(model: Background, scan: Scan, rules: SubtractConfig) -> float:
    """The learning rate a of a scan: given, or from the half-life in scans or in seconds.

    Seconds are those of the turn, or those since the last scan where points come without; a gap in the recording
    counts as half a half-life at most.
    """
    if rules.half_life_s > 0:
        turn_ns = scan.t_ns - scan.t_start_ns or (scan.t_ns - model.t_ns if model.scans else 0)
        turn_s = min(max(turn_ns * 1e-9, 0.0), rules.half_life_s / 2)
        return float(0.5 ** (turn_s / rules.half_life_s))
    return float(0.5 ** (1.0 / rules.half_life_scans)) if rules.half_life_scans > 0 else rules.learning_rate


def take_counts(
    model: Background, key: IntArray, count: IntArray, seen: BoolArray, rules: SubtractConfig, *, rate: float
) -> Background:
    """The model after a scan with `count` (h,) > 0 points in the pixels `key` (h,), which ascend, each once.

    Rows that are `seen` (n,) and have no point observe 0, the others nothing.
    """
    step, count = -math.log(rate), np.minimum(count, rules.categories - 1)
    hit, known = found(model.key, key)
    waits, new = ~seen, ~known
    waits[hit[known]] = False
    if new.any():
        model, hit, place = _with_pixels(model, key[new], hit[new], rules), hit + np.cumsum(new) - new, hit[new]
        waits = np.insert(waits, place, False) if waits.any() else np.zeros(len(model), bool)
    name, now = (hit << BITS) | count, model.now + step
    place, has = found(model.pairs.name, name)
    psi = np.exp(level_of(model.pairs, place, has, model.base.take(hit)) + (model.late.take(hit) - model.now))
    after, psi, away = _observed(model, hit, count, psi, rules, rate)

    distance, late = model.drift.copy(), model.late
    distance[hit] = away
    fade: Any = rate  # of a row without a point
    keep: Any = 0
    if waits.any():
        distance, fade, keep, late = distance[~waits], np.where(waits, 1.0, rate), waits, late + step * waits
    arrays: dict[str, Any] = {x: getattr(model, x) * (keep if x in ("last", "off") else fade) for x in after}
    for x, values in after.items():
        arrays[x][hit] = values
    pairs = observed(model.pairs, name, place, has, np.log(psi) + (now - late[hit]))
    change = (1.0 - rate) * float(distance.sum())
    model = _noted(replace(model, late=late, pairs=pairs, now=now, **arrays), change, len(distance), rate)
    return _bounded(_tidied(model, step), rules.max_pixels)


def _observed(
    model: Background, hit: IntArray, count: IntArray, psi: FloatArray, rules: SubtractConfig, a: float
) -> tuple[dict[str, NDArray[Any]], FloatArray, FloatArray]:
    """What a `count` (h,) > 0, as likely as `psi` (h,), makes of the rows `hit`, and of psi; |psi - e_c| before it.

    psi <- a psi, and 1 - a more for the count that was observed.   Eq: abs-8
    """
    b, above = 1.0 - a, count > rules.threshold
    rest, drift, last, off = (x.take(hit) for x in (model.rest, model.drift, model.last, model.off))
    high, low = a * model.high.take(hit), a * model.low.take(hit)
    # |psi - e_c|^2 = |psi - e_0|^2 + 2 (psi_0 - psi_c), but for a count that comes again the difference of equals
    squared = np.maximum(drift**2 + 2.0 * (1.0 - rest - psi), 0.0)
    away = np.where(last == count, off, np.sqrt(squared))
    drift = np.sqrt((a * drift) ** 2 + (2.0 * a * b) * (psi + rest) + 2.0 * b**2)
    psi = a * psi + b
    if rules.decision == "tail":
        high += b * above
    else:
        high, low = np.maximum(high, psi * above), np.maximum(low, psi * ~above)
    after = {"rest": a * rest + b, "drift": drift, "high": high, "low": low, "last": count, "off": a * away}
    return after, psi, away


def _with_pixels(model: Background, key: IntArray, place: IntArray, rules: SubtractConfig) -> Background:
    """The model with rows, before those that are now at `place`, for pixels that had no point so far.

    psi_i(0) = 1 / v; with `subtract.start` = "empty" all of it is at count 0.   Eq: abs-7
    """
    v, left, at = rules.categories, math.exp(-model.now), place + np.arange(len(key))
    share, base = (1.0 / v, -math.log(v)) if rules.start == "uniform" else (0.0, -math.inf)
    tail = rules.decision == "tail"
    start = {
        "key": key, "late": 0.0, "base": base, "rest": left * (v - 1) * share,
        "drift": left * math.sqrt(v * (v - 1)) * share, "last": 0, "off": 0.0,
        "high": left * share * (v - 1 - rules.threshold if tail else 1),
        "low": 0.0 if tail or rules.threshold == 0 else left * share,
    }  # fmt: skip
    rest = others(len(model) + len(key), at)
    grown: dict[str, Any] = {x: merged(getattr(model, x), rest, at, values) for x, values in start.items()}
    return replace(model, pairs=with_rows(model.pairs, place), **grown)


def judged(model: Background, rules: SubtractConfig) -> Background:
    """The model with `drift`, `high` and `low` reckoned anew from all counts of each row, by the settings."""
    n, row, count, time = len(model), model.pairs.row, model.pairs.count, model.now - model.late
    floor, psi = np.exp(model.base - time), np.exp(model.pairs.level - time[row])
    above = count > rules.threshold
    free = rules.categories - 1 - np.bincount(row, minlength=n)
    drift = np.sqrt(model.rest**2 + np.bincount(row, psi**2, n) + free * floor**2)
    if rules.decision == "tail":
        free = rules.categories - 1 - rules.threshold - np.bincount(row[above], minlength=n)
        tail = np.bincount(row[above], psi[above], n) + free * floor
        return replace(model, drift=drift, high=np.asarray(tail, float), low=np.zeros(n))
    high, low = floor.copy(), floor * (rules.threshold > 0)  # those that a row never had are the least likely
    np.maximum.at(high, row[above], psi[above])
    np.maximum.at(low, row[~above], psi[~above])
    return replace(model, drift=drift, high=high, low=low)


def _noted(model: Background, change: float, pixels: int, rate: float) -> Background:
    """The model with the change of a scan in all its `pixels`, and whether it has converged, which it then stays.

    The change of a pixel whose count fluctuates never dies out, so it is no limit that tells: the mean of the last
    L = 1 / (1 - a) scans is within 5 % of that of the L scans before, or the change of a pixel is below 0.2 (1 - a)
    after L scans, or 10 L scans have passed. Compared are sums, which are the mean over all pixels that the paper
    has, but for a factor: the list grows by what ever had a point, noise, and land that comes in sight of a ship,
    and the mean over it falls by a tenth in each L scans for as long as one waits.   Eq: abs-9
    """
    span = math.ceil(round(1.0 / (1.0 - rate), 6))
    history = (*model.change, change)[-2 * span :]
    steady = len(history) >= span and change < 0.2 * (1.0 - rate) * max(pixels, 1)
    if len(history) == 2 * span:
        earlier, later = math.fsum(history[:span]), math.fsum(history[span:])
        steady |= abs(later - earlier) <= 0.05 * earlier
    return replace(
        model, change=history, settled=model.settled or (steady and not model.converged),
        converged=model.converged or steady or model.scans >= 10 * span,
    )  # fmt: skip


def _tidied(model: Background, step: float) -> Background:
    """The model, from time to time, without counts and rests that are as good as none."""
    if math.floor(model.now / TIDY) == math.floor((model.now - step) / TIDY):
        return model
    own = model.now - model.late[model.pairs.row]
    kept = model.pairs.level - own > math.log(TINY)
    rest = model.rest > FAINT
    faded: dict[str, Any] = {x: np.where(rest, getattr(model, x), 0.0) for x in ("rest", "drift", "high", "low")}
    return replace(model, pairs=Pairs(model.pairs.name[kept], model.pairs.level[kept]), **faded)


def _bounded(model: Background, most: int) -> Background:
    """The model with at most so many pixels: beyond, a quarter goes, those that are nearest to empty."""
    if len(model) <= most:
        return model
    rows = np.sort(np.argsort(-model.drift, kind="stable")[: most - most // 4])
    return replace(take(model, rows), pairs=of_rows(model.pairs, rows))


def mask_of(model: Background, rules: SubtractConfig) -> Mask:
    """The pixels that are background now.

    `map`: the likeliest count exceeds the threshold; of equals the smaller counts. `tail`: counts above the threshold
    are likelier than `subtract.tail_probability`, together.
    """
    if rules.decision == "tail":
        now = model.high > rules.tail_probability
    else:
        now = (model.high > model.low) & (model.high + model.rest > 1.0)
    return Mask(model.key.take(np.flatnonzero(now)), rules.pixel_m, model.corner_m)


def psi_of(model: Background, key: IntArray, rules: SubtractConfig) -> FloatArray:
    """The distributions (n, v) of some pixels now, those without a row included."""
    new = np.setdiff1d(key, model.key)
    model = _with_pixels(model, new, np.searchsorted(model.key, new), rules)
    rows = np.searchsorted(model.key, key)
    time, pairs = model.now - model.late[rows], of_rows(model.pairs, rows)
    psi = np.tile(np.exp(model.base[rows] - time)[:, None], rules.categories)
    psi[pairs.row, pairs.count] = np.exp(pairs.level - time[pairs.row])
    psi[:, 0] = 1.0 - model.rest[rows]
    return psi
