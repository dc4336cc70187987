"""Which turn of the antenna each plot belongs to, from nothing but times and azimuths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maritrack.geo import TWO_PI, wrap, wrap_positive
from maritrack.types import FloatArray, IntArray

SLOWEST_S, FASTEST_S = 15.0, 0.5  # turns that radars take
ASSUMED_S = 2.5  # a turn of a ship's radar, where too few plots tell it
EMPTY_TURNS = 10  # in a row are scans without plots; more of them are a gap
MAX_PAIRS = 4000  # are enough to measure the antenna
STAMP_RAD = np.deg2rad(5.0)  # plots of one time but farther apart are stamped with the time of their scan


@dataclass(frozen=True, slots=True, eq=False)
class Turns:
    """Turns in order of time, also empty ones: plots first[i]:first[i + 1] are those of turn i."""

    start_ns: IntArray  # (s,)
    end_ns: IntArray  # (s,)
    first: IntArray  # (s + 1,)
    segment: IntArray  # (s,) counts up after a gap

    def __len__(self) -> int:
        return len(self.start_ns)


def group_turns(t_ns: IntArray, azimuth_rad: FloatArray) -> Turns:
    """The turns of plots (n,) in order of time, n > 0.

    Turns begin at north. The azimuth is unwrapped with the antenna's period, so that neither a turn
    without plots nor plots a little out of order are miscounted. Where plots come with the time of their
    scan instead of the beam's, each time is a scan.
    """
    again = np.diff(t_ns) == 0
    if np.sum(again) > 0.2 * len(t_ns) and np.median(np.abs(wrap(np.diff(azimuth_rad)[again]))) > STAMP_RAD:
        first = np.concatenate([[0], np.flatnonzero(~again) + 1, [len(t_ns)]])
        times = t_ns[first[:-1]]
        return Turns(times, times, first, np.zeros(len(times), dtype=np.int64))
    t_s = (t_ns - t_ns[0]) / 1e9
    unwrapped = unwrap_azimuth(t_s, azimuth_rad, period_s=turn_period_s(t_s, azimuth_rad))
    number = np.floor(unwrapped / TWO_PI).astype(np.int64)
    known = np.unique(number)
    empty = np.diff(known) - 1
    filled = [np.arange(k + 1, k + 1 + n) for k, n in zip(known[:-1], empty, strict=True) if 0 < n <= EMPTY_TURNS]
    turn = np.sort(np.concatenate([known, *filled]))
    first = np.searchsorted(number, np.append(turn, turn[-1] + 1))
    start_ns, end_ns = (t_ns[0] + np.rint(_time_at(k * TWO_PI, unwrapped, t_s) * 1e9).astype(np.int64)
                        for k in (turn, turn + 1))  # fmt: skip
    held = np.diff(first) > 0
    end_ns[held] = np.maximum(end_ns[held], t_ns[first[1:][held] - 1])
    return Turns(start_ns, end_ns, first, np.cumsum(np.diff(turn, prepend=turn[0]) > 1))


def unwrap_azimuth(t_s: FloatArray, azimuth_rad: FloatArray, *, period_s: float) -> FloatArray:
    """Azimuths (n,) that never decrease, from [0, 2 pi) on: whole turns are added as time has it."""
    step, expected = wrap(np.diff(azimuth_rad)), np.diff(t_s) * TWO_PI / period_s
    step = step + TWO_PI * np.rint((expected - step) / TWO_PI)
    total = wrap_positive(azimuth_rad[:1])[0] + np.concatenate([[0.0], np.cumsum(step)])
    return np.asarray(np.maximum.accumulate(total))


def turn_period_s(t_s: FloatArray, azimuth_rad: FloatArray) -> float:
    """How long the antenna takes for a turn, by agreement of steps in azimuth with steps in time.

    Fractions of the true period agree as well where all plots are in one direction, hence the longest
    of the periods that agree best; then sharpened over longer and longer steps.
    """
    i = np.arange(min(len(t_s) - 1, MAX_PAIRS))
    grid = np.geomspace(FASTEST_S, SLOWEST_S, 700)
    score = _agreement(t_s, azimuth_rad, i, i + 1, grid)
    if score is None:
        return ASSUMED_S
    inner = score[1:-1]
    peak = np.flatnonzero((inner >= score[:-2]) & (inner >= score[2:]) & (inner >= score.max() - 0.02)) + 1
    period = float(grid[peak[-1] if len(peak) else np.argmax(score)])
    for turns, width in ((1.5, 0.15), (6.0, 0.05), (24.0, 0.012)):
        later = np.searchsorted(t_s, t_s[i] + turns * period)
        grid = period * np.linspace(1 - width, 1 + width, 101)
        score = _agreement(t_s, azimuth_rad, i[later < len(t_s)], later[later < len(t_s)], grid)
        if score is None:
            break
        period = float(grid[np.argmax(score)])
    return period


def _agreement(
    t_s: FloatArray, azimuth_rad: FloatArray, i: IntArray, j: IntArray, period_s: FloatArray
) -> FloatArray | None:
    """Mean cosine of the difference between seen and expected advance from plots i to j, for each period.

    None where fewer than three pairs tell anything: gaps longer than a minute tell nothing.
    """
    dt_s = t_s[j] - t_s[i]
    use = (dt_s > 0) & (dt_s < 60.0)
    if np.sum(use) < 3:
        return None
    seen = (azimuth_rad[j] - azimuth_rad[i])[use]
    return np.asarray(np.cos(seen - dt_s[use] * (TWO_PI / period_s)[:, None]).mean(axis=1))


def _time_at(angle_rad: FloatArray, unwrapped: FloatArray, t_s: FloatArray) -> FloatArray:
    return np.asarray(np.interp(angle_rad, unwrapped, t_s))
