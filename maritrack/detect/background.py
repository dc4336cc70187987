"""Adaptive background subtraction: what comes back scan after scan in the same place is no vessel under way.

Each pixel of a grid in east-north keeps a distribution psi over how many points it has in a scan: 0 .. v - 1, learned
by stochastic weak estimation (Oommen, Rueda 2006). Pixels that never had a point all have the same psi, so only the
others are kept, each as of the scan that last hit it: an empty scan takes psi to a psi + (1 - a) e_0, and many of
them are one power of a. Time is counted in e-folds, -log a a scan, so that a may differ from scan to scan. Of a
pixel's counts only those that it had are kept one by one; the others have their equal share of the start, `floor`.
All of this is exact, not an approximation of the dense model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maritrack import geo
from maritrack.settings import SubtractConfig
from maritrack.types import BoolArray, FloatArray, IntArray, Mask, Points, Scan, Tracks, take

TINY = 1e-17  # a count of this weight is as good as one that never was
SLOTS = 4  # counts kept by a new pixel; doubled when one pixel needs more


@dataclass(frozen=True, slots=True, eq=False)
class Background:
    """The model after a scan. Rows are the pixels that ever had a point, ascending by key, each as of its own time."""

    key: IntArray  # (n,) geo.pixel_key
    at: FloatArray  # (n,) e-folds: the time of the row
    floor: FloatArray  # (n,) psi of each count without a slot
    count: NDArray[np.int16]  # (n, s) counts that the pixel had, -1 = free slot; slot 0 is count 0
    weight: FloatArray  # (n, s) psi of them
    hold: FloatArray  # (n,) background as long as hold exp(at - now) > 1
    drift: FloatArray  # (n,) |psi - e_0|
    now: float = 0.0  # e-folds since the beginning
    change: tuple[float, ...] = ()  # abs-9 of the last scans, mean over the pixels of this list, newest last
    scans: int = 0
    converged: bool = False
    settled: bool = False  # converged in time, not by the limit
    t_ns: int = 0  # of the last scan
    corner_m: tuple[float, float] = (0.0, 0.0)  # east-north of a corner of pixel (0, 0)

    def __len__(self) -> int:
        return len(self.key)


def no_background(corner_m: tuple[float, float] = (0.0, 0.0)) -> Background:
    """The model before the first scan."""
    none = np.zeros(0)
    return Background(
        none.astype(np.int64), none, none, np.zeros((0, SLOTS), np.int16), np.zeros((0, SLOTS)), none, none,
        corner_m=corner_m,
    )  # fmt: skip


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
    at = tracks.position_m + tracks.velocity_mps * ((t_ns - tracks.t_ns) * 1e-9)[:, None]
    shape = np.linalg.inv(tracks.extent_m2 + margin_m**2 * np.eye(2))
    for centre, S in zip(at, shape, strict=True):
        off = position_m - centre
        result |= np.einsum("ni,ij,nj->n", off, S, off) <= 1.0
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

    psi <- a psi, and 1 - a more for the count that was observed. Rows that are `seen` (n,) and have no point observe
    0, the others nothing.   Eq: abs-8
    """
    count, now, step = np.minimum(count, rules.categories - 1), model.now, -math.log(rate)
    place = np.searchsorted(model.key, key)
    known = np.zeros(len(key), bool)
    known[place < len(model)] = model.key[place[place < len(model)]] == key[place < len(model)]
    waits = ~seen
    waits[place[known]] = False
    if waits.any():
        model = replace(model, at=np.where(waits, model.at + step, model.at))
    if not known.all():
        waits = np.insert(waits, place[~known], False)
        model = _with_pixels(model, key[~known], rules)
    hit = place + np.cumsum(~known) - ~known
    rows = _brought_to(take(model, hit), now)
    slot, has = _slot(rows, count)
    d = (1.0 - rate) * np.exp(model.at - now) * model.drift
    d[hit] = (1.0 - rate) * _distance(rows, slot, has, rules)
    rows = _observe(rows, count, slot, has, rate)
    model = _written(model, hit, judged(replace(rows, at=rows.at + step), rules))
    active = d[~waits] if waits.any() else d
    model = _noted(replace(model, now=now - math.log(rate)), float(active.mean()) if len(active) else 0.0, rate)
    return _bounded(model, rules.max_pixels)


def _with_pixels(model: Background, key: IntArray, rules: SubtractConfig) -> Background:
    """The model with rows for pixels that had no point so far, as they were at the beginning.

    psi_i(0) = 1 / v; with `subtract.start` = "empty" all of it is at count 0.   Eq: abs-7
    """
    at, n = np.searchsorted(model.key, key), len(key)
    uniform = rules.start == "uniform"
    share = 1.0 / rules.categories if uniform else 0.0
    count = np.full((n, model.count.shape[1]), -1, np.int16)
    weight = np.zeros(count.shape)
    count[:, 0], weight[:, 0] = 0, share if uniform else 1.0
    start = {"key": key, "at": np.zeros(n), "floor": np.full(n, share), "count": count, "weight": weight,
             "hold": np.zeros(n), "drift": np.zeros(n)}  # fmt: skip
    grown = {name: np.insert(getattr(model, name), at, values, axis=0) for name, values in start.items()}
    return replace(model, **grown)


def _brought_to(rows: Background, now: float) -> Background:
    """The rows after the empty scans since their time."""
    left = np.exp(rows.at - now)
    weight = left[:, None] * rows.weight
    weight[:, 0] += 1.0 - left
    return replace(rows, at=np.full(len(rows), now), floor=left * rows.floor, weight=weight)


def _observe(rows: Background, count: IntArray, slot: IntArray, has: BoolArray, rate: float) -> Background:
    """The rows after an observation of `count` (n,), which `has` a slot or gets one; more of them where needed."""
    free = 1 + np.argmin(rows.weight[:, 1:], axis=1)
    at = np.arange(len(rows))
    if (~has & (rows.weight[at, free] > TINY)).any():
        rows = _with_slots(rows, 2 * rows.count.shape[1])
        free = 1 + np.argmin(rows.weight[:, 1:], axis=1)
    slot = np.where(has, slot, free)
    kept, weight = rows.count.copy(), rows.weight.copy()
    weight[at, slot] = np.where(has, weight[at, slot], rows.floor)
    kept[at, slot] = count
    weight *= rate
    weight[at, slot] += 1.0 - rate
    return replace(rows, count=kept, weight=weight, floor=rate * rows.floor)


def _slot(rows: Background, count: IntArray) -> tuple[IntArray, BoolArray]:
    """Slot of a count (n,) in each row, and whether there is one."""
    same = rows.count == count[:, None]
    return np.argmax(same, axis=1), same.any(axis=1)


def _with_slots(rows: Background, slots: int) -> Background:
    """The rows with room for more counts."""
    more = ((0, 0), (0, slots - rows.count.shape[1]))
    return replace(rows, count=np.pad(rows.count, more, constant_values=np.int16(-1)), weight=np.pad(rows.weight, more))


def _written(model: Background, index: IntArray, rows: Background) -> Background:
    """The model with some of its rows replaced."""
    if rows.count.shape[1] > model.count.shape[1]:
        model = _with_slots(model, rows.count.shape[1])
    arrays = {name: getattr(model, name).copy() for name in ("at", "floor", "count", "weight", "hold", "drift")}
    for name, array in arrays.items():
        array[index] = getattr(rows, name)
    return replace(model, **arrays)


def _distance(rows: Background, slot: IntArray, has: BoolArray, rules: SubtractConfig) -> FloatArray:
    """|psi - e_c| (n,) for the count c in a slot, or without one: what a scan with that count changes, over 1 - a."""
    at = np.arange(len(rows))
    own = np.where(has, rows.weight[at, slot], rows.floor)
    rest = rows.weight.copy()
    rest[at[has], slot[has]] = 0.0
    without = rules.categories - np.count_nonzero(rows.count >= 0, axis=1) - ~has
    squared = np.einsum("ij,ij->i", rest, rest)
    return np.asarray(np.sqrt(squared + without * rows.floor**2 + (1.0 - own) ** 2))


def judged(model: Background, rules: SubtractConfig) -> Background:
    """The model with its rows judged by the settings."""
    first, has = np.zeros(len(model), np.int64), np.ones(len(model), bool)
    return replace(model, hold=_hold(model, rules), drift=_distance(model, first, has, rules))


def _hold(rows: Background, rules: SubtractConfig) -> FloatArray:
    """How long each row (n,) stays background without points: as long as hold exp(at - now) > 1.

    `map`: the likeliest count exceeds the threshold; it competes with psi_0 = 1 - (1 - psi_0) a^g, and counts
    below it decay as it does; of equals the smaller counts. `tail`: counts above the threshold are likelier than
    `subtract.tail_probability`, together.
    """
    kept = rows.count >= 0
    above = kept & (rows.count > rules.threshold)
    free_above = rules.categories - 1 - rules.threshold - above.sum(axis=1)  # counts without a slot
    if rules.decision == "tail":
        tail = np.where(above, rows.weight, 0.0).sum(axis=1) + free_above * rows.floor
        return np.asarray(tail / rules.tail_probability)
    below = kept & ~above
    free_below = rules.threshold + 1 - below.sum(axis=1)
    high = np.where(above, rows.weight, 0.0).max(axis=1, initial=0.0)
    high = np.maximum(high, np.where(free_above > 0, rows.floor, 0.0))
    low = np.where(below[:, 1:], rows.weight[:, 1:], 0.0).max(axis=1, initial=0.0)
    low = np.maximum(low, np.where(free_below > 0, rows.floor, 0.0))
    return np.where(high > low, 1.0 + high - rows.weight[:, 0], 0.0)


def _noted(model: Background, change: float, rate: float) -> Background:
    """The model with the mean change of a scan, and whether it has converged, which it then stays.

    The change of a pixel whose count fluctuates never dies out, so it is no limit that tells: the mean of the last
    L = 1 / (1 - a) scans is within 5 % of that of the L scans before, or the change is below 0.2 (1 - a) after L
    scans, or 10 L scans have passed.   Eq: abs-9
    """
    span = math.ceil(round(1.0 / (1.0 - rate), 6))
    history = (*model.change, change)[-2 * span :]
    steady = len(history) >= span and change < 0.2 * (1.0 - rate)
    if len(history) == 2 * span:
        earlier, later = math.fsum(history[:span]), math.fsum(history[span:])
        steady |= abs(later - earlier) <= 0.05 * earlier
    return replace(
        model, change=history, settled=model.settled or (steady and not model.converged),
        converged=model.converged or steady or model.scans >= 10 * span,
    )  # fmt: skip


def _bounded(model: Background, most: int) -> Background:
    """The model with at most so many pixels: beyond, a quarter goes, those that are nearest to empty."""
    if len(model) <= most:
        return model
    left = model.drift * np.exp(model.at - model.now)
    return take(model, np.sort(np.argsort(-left, kind="stable")[: most - most // 4]))


def mask_of(model: Background, rules: SubtractConfig) -> Mask:
    """The pixels that are background now."""
    now = model.hold * np.exp(model.at - model.now) > 1.0
    return Mask(model.key[now], rules.pixel_m, model.corner_m)


def psi_of(model: Background, key: IntArray, rules: SubtractConfig) -> FloatArray:
    """The distributions (n, v) of some pixels now, those without a row included."""
    known = np.isin(key, model.key)
    model = _with_pixels(model, np.unique(key[~known]), rules)
    rows = _brought_to(take(model, np.searchsorted(model.key, key)), model.now)
    psi = np.tile(rows.floor[:, None], rules.categories)
    row, slot = np.nonzero(rows.count >= 0)
    psi[row, rows.count[row, slot]] = rows.weight[row, slot]
    return psi
