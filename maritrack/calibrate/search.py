"""Where to begin: offsets that bring most of the ships onto clusters, of all that are thinkable.

Each cluster votes for the offsets of azimuth and range that would bring it onto a ship, once a scan and cell. What is
right gets a vote in every scan; moorings and land, which lie still, spread theirs over the cells as the ship goes by.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maritrack import geo
from maritrack.calibrate.sightings import Sightings, Way
from maritrack.types import FloatArray

CELL_RAD, CELL_M, CELL_S = math.radians(0.5), 50.0, 5.0  # of the votes
NEAR_RAD, NEAR_M = math.radians(0.75), 75.0  # votes count for the cells around: a hull is long, and its echo wanders
WIDE_RAD, WIDE_M = math.radians(10.0), 200.0  # what chance gives is found out over no less than this
MOST = 8  # cells of azimuth to either side
LEAST_SCANS = 8  # that a ship is seen in
LEAST_SHARE = 0.35  # of its scans
LEAST_CONTRAST = 0.2  # above the share that chance gives
LATE_COST = 0.003  # of a share, a second: of two that fit alike the more punctual one


@dataclass(frozen=True, slots=True)
class Span:
    """How far the search goes to either side."""

    azimuth_rad: float
    range_m: float
    time_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """Offsets to begin with, and the ships that agree."""

    azimuth_rad: float
    range_m: float
    ways: tuple[Way, ...]
    late_s: tuple[float, ...]  # how much later than the clusters each ship's reports are
    n_candidates: int  # ships under way within reach


def search(sightings: Sightings, ways: list[Way], span: Span) -> Start:
    """The offsets with the most votes; no ships where none is seen well enough."""
    shifts = _grid(math.floor(span.time_s / CELL_S), CELL_S)
    wide = Span(max(span.azimuth_rad, WIDE_RAD), max(span.range_m, WIDE_M), span.time_s)
    azimuth, range_ = _centres(wide)
    asked = (np.abs(azimuth) <= span.azimuth_rad)[:, None] & (np.abs(range_) <= span.range_m)
    total: FloatArray | None = None
    seen: list[tuple[Way, FloatArray, int]] = []
    for way in ways:
        share, n_scans = votes(sightings, way, shifts, wide)
        if n_scans < LEAST_SCANS:
            continue
        share = share - LATE_COST * np.abs(shifts)[:, None, None]
        best = share.max(axis=0)
        gain = n_scans * np.maximum(best - np.median(best), 0.0)
        total = gain if total is None else total + gain
        seen.append((way, share, n_scans))
    if total is None:
        return Start(0.0, 0.0, (), (), 0)
    row, column = np.unravel_index(int(np.where(asked, total, -1.0).argmax()), total.shape)
    agree: list[tuple[Way, float]] = []
    for way, share, n_scans in seen:
        here = share[:, row, column]
        shift = float(shifts[here.argmax()])
        told = float(here.max()) + LATE_COST * abs(shift)
        chance = float(np.median(share.max(axis=0)))
        if told >= LEAST_SHARE and told * n_scans >= LEAST_SCANS and here.max() - chance >= LEAST_CONTRAST:
            agree.append((way, shift))
    return Start(
        float(azimuth[row]), float(range_[column]), tuple(w for w, _ in agree), tuple(s for _, s in agree), len(seen)
    )


def votes(sightings: Sightings, way: Way, shifts: FloatArray, span: Span) -> tuple[FloatArray, int]:
    """Share of scans (s, a, r) with a cluster at each shift of time and offsets of azimuth and range; and of how many.

    Scans count while the ship is under way and within reach.
    """
    azimuth, range_ = _centres(span)
    share, n_scans = np.zeros((len(shifts), len(azimuth), len(range_))), 0
    width = len(azimuth) * len(range_)
    for i, shift in enumerate(shifts.tolist()):
        position, _, under_way = way.at(sightings.t_s + shift)
        r, a = geo.en_to_polar(position - sightings.sensor_m(sightings.t_s))
        known = under_way & (r <= sightings.reach_m)
        counted = len(np.unique(sightings.scan[known]))
        if counted < LEAST_SCANS:
            continue
        n_scans = max(n_scans, counted)
        ia = np.rint((geo.wrap(a - sightings.azimuth_rad) - azimuth[0]) / CELL_RAD).astype(np.int64)
        ir = np.rint((r - sightings.range_m - range_[0]) / CELL_M).astype(np.int64)
        near = np.flatnonzero(known & (ia >= -MOST) & (ia < len(azimuth) + MOST) & (ir >= -1) & (ir <= len(range_)))
        half = np.clip((NEAR_RAD + NEAR_M / np.maximum(r[near], 1.0)) / CELL_RAD, 1, MOST).astype(np.int64)
        scan, ia, ir = sightings.scan[near], ia[near], ir[near]
        cells = (
            np.unique(
                np.concatenate(
                    [
                        (scan * len(azimuth) + ia + da)[ok] * len(range_) + (ir + dr)[ok]
                        for da in range(-MOST, MOST + 1)
                        for dr in (-1, 0, 1)
                        if (
                            ok := (abs(da) <= half)
                            & (ia + da >= 0)
                            & (ia + da < len(azimuth))
                            & (ir + dr >= 0)
                            & (ir + dr < len(range_))
                        ).any()
                    ]
                    or [scan[:0]]
                )
            )
            % width
        )
        share[i] = np.bincount(cells, minlength=width).reshape(len(azimuth), len(range_)) / counted
    return share, n_scans


def _centres(span: Span) -> tuple[FloatArray, FloatArray]:
    """Offsets of azimuth and range in the middle of the cells."""
    azimuth = _grid(math.ceil(span.azimuth_rad / CELL_RAD), CELL_RAD)
    return azimuth, _grid(math.ceil(span.range_m / CELL_M), CELL_M)


def _grid(n: int, step: float) -> FloatArray:
    return np.arange(-n, n + 1, dtype=np.float64) * step
