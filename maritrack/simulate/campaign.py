"""Campaigns at sea: a ship's radar display, vessels that tell AIS, aids to navigation and racons.

The scenes `daan`, `darc` and `manv` are after the three recordings of the dataset paper, which are not public: vessels
of their sizes, aids to navigation by the way, a racon that answers, manoeuvres, one vessel in the shadow of another.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from datetime import datetime

import numpy as np

from maritrack.errors import ConfigError
from maritrack.io.reference import Reference, Reports, build_reference
from maritrack.simulate.ppi import Echoes, Look
from maritrack.simulate.vessels import Vessel
from maritrack.types import BoolArray, FloatArray, IntArray, Origin

KEY = 13  # of the random numbers of these scenes
SCATTER_M = 25.0  # of a hull, one scatterer for so much of it
MOST_STRENGTH = 1.6  # a receiver that is saturated shows no more
ATON_M = 3.0


@dataclass(frozen=True, kw_only=True)
class Mark:
    """An aid to navigation at rest, with or without a racon, which answers with dashes behind itself."""

    id: str
    east_m: float
    north_m: float
    rcs_m2: float = 100.0
    racon_m: float = 0.0  # length of its answer; 0 = no racon
    racon_period_s: float = 20.0
    racon_on_s: float = 12.0


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """What a display showed. Metres east and north of the origin; seconds."""

    title: str
    start: datetime
    lat_deg: float
    lon_deg: float
    scans: int
    own: str  # the vessel that carries the radar
    vessel: tuple[Vessel, ...]
    mark: tuple[Mark, ...] = ()
    display: Look = field(default_factory=Look)
    period_s: float = 1.0
    lost: float = 0.0  # share of frames that were not grabbed
    unit_range_m: float = 3000.0  # at which an echo of 1 m^2 is at the threshold
    span_db: float = 50.0  # from no echo to a saturated one
    threshold: float = 0.4  # of the strength of pixels that are points
    clutter_rate: float = 1.0  # false echoes in a scan, on average
    mark_fade: float = 8.0

    def __post_init__(self) -> None:
        if self.start.tzinfo is None:
            raise ConfigError(f"start = {self.start} has no time zone: write 2026-05-12T06:30:00Z")
        if self.scans < 1 or not self.period_s > 0 or not 0 <= self.lost < 1 or self.clutter_rate < 0:
            raise ConfigError("scans starts at 1; period_s > 0, lost is within 0..1, clutter_rate not negative")
        ids = [v.id for v in self.vessel]
        if self.own not in ids or len(set(ids)) < len(ids):
            raise ConfigError("vessels have ids of their own, and `own` is one of them")

    @property
    def start_s(self) -> float:
        """UNIX seconds of the first scan."""
        return self.start.timestamp()

    @property
    def origin(self) -> Origin:
        """Where east = north = 0 is."""
        return Origin(self.lat_deg, self.lon_deg)

    @property
    def others(self) -> tuple[Vessel, ...]:
        """The vessels that the radar may see."""
        return tuple(v for v in self.vessel if v.id != self.own)

    def own_m(self, t_s: FloatArray) -> FloatArray:
        """Where the radar is (t, 2)."""
        return next(v for v in self.vessel if v.id == self.own).course().at(t_s).position_m


def grabbed(scene: Campaign, n_scans: int, *, seed: int) -> IntArray:
    """The steps whose frame was grabbed; the first always is."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(KEY, 0)))
    kept = rng.random(n_scans) >= scene.lost
    kept[0] = True
    return np.flatnonzero(kept)


def echoes_of(scene: Campaign, k: int, *, seed: int) -> tuple[Echoes, IntArray]:
    """What the radar sees at step k, from where it is, and the vessel (n,) of each echo: -1 = mark, racon or clutter.

    A hull is a row of scatterers that fade each for itself; a vessel in the shadow of a nearer one is not seen.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(KEY, k + 1)))
    t_s: FloatArray = np.array([k * scene.period_s])
    own_m = scene.own_m(t_s)[0]
    rows: list[tuple[FloatArray, IntArray]] = []
    for n in np.flatnonzero(~_hidden(scene, t_s, own_m)).tolist():
        table = _hull(scene, scene.others[n], t_s, own_m, rng)
        rows.append((table, np.full(len(table), n)))
    for mark in scene.mark:
        table = _mark(scene, mark, float(t_s[0]), own_m, rng)
        rows.append((table, np.full(len(table), -1)))
    clutter = _clutter(scene, rng)
    rows.append((clutter, np.full(len(clutter), -1)))
    table = np.concatenate([row for row, _ in rows])
    label = np.concatenate([of for _, of in rows])
    seen = table[:, 5] > 0.5 * scene.threshold
    table, label = table[seen], label[seen]
    return Echoes(table[:, :2], table[:, 2], table[:, 3], table[:, 4], table[:, 5]), label


def _table(
    position_m: FloatArray, length_m: float, width_m: float, heading_rad: float, strength: FloatArray
) -> FloatArray:
    n = len(position_m)
    return np.column_stack(
        [position_m, np.full(n, length_m), np.full(n, width_m), np.full(n, heading_rad), strength]
    )  # fmt: skip


def _strength(scene: Campaign, rcs_m2: FloatArray, range_m: FloatArray) -> FloatArray:
    """What the display makes of echoes: logarithmic, with the fourth power of the range."""
    level_db = 10.0 * np.log10(np.maximum(rcs_m2, 1e-9)) - 40.0 * np.log10(
        np.maximum(range_m, 1.0) / scene.unit_range_m
    )  # fmt: skip
    return np.clip(scene.threshold + level_db / scene.span_db, 0.0, MOST_STRENGTH)


def _hull(scene: Campaign, vessel: Vessel, t_s: FloatArray, own_m: FloatArray, rng: np.random.Generator) -> FloatArray:
    state = vessel.course().at(t_s)
    n = max(1, round(vessel.length_m / SCATTER_M))
    heading = float(state.heading_rad[0])
    forward = np.array([math.sin(heading), math.cos(heading)])
    along = ((np.arange(n) + 0.5) / n - 0.5) * vessel.length_m
    at_m = state.position_m[0] - own_m + along[:, None] * forward
    fading = rng.gamma(vessel.fade, 1.0 / vessel.fade, n)
    strength = _strength(scene, vessel.rcs_m2 / n * fading, np.hypot(*at_m.T))
    return _table(at_m, vessel.length_m / n, vessel.width_m, heading, strength)


def _hidden(scene: Campaign, t_s: FloatArray, own_m: FloatArray) -> BoolArray:
    """Vessels (n,) whose middle lies behind the hull of a nearer one that is longer by a fifth."""
    fleet = scene.others
    states = [v.course().at(t_s) for v in fleet]
    offset = np.array([s.position_m[0] - own_m for s in states]).reshape(-1, 2)
    heading = np.array([s.heading_rad[0] for s in states])
    length_m, width_m = np.array([v.length_m for v in fleet]), np.array([v.width_m for v in fleet])
    range_m, azimuth = np.hypot(*offset.T), np.arctan2(*offset.T)
    across_m = np.abs(length_m * np.sin(heading - azimuth)) + np.abs(width_m * np.cos(heading - azimuth))
    apart = np.abs((azimuth[:, None] - azimuth[None] + np.pi) % (2 * np.pi) - np.pi)
    behind = range_m[:, None] > range_m[None] + 1.0
    shadow = apart < (0.5 * across_m / np.maximum(range_m, 1.0))[None]
    return np.asarray((behind & shadow & (length_m[None] >= 1.2 * length_m[:, None])).any(axis=1))


def _mark(scene: Campaign, mark: Mark, t_s: float, own_m: FloatArray, rng: np.random.Generator) -> FloatArray:
    """The echo of an aid to navigation, and the dash, dot and dash of its racon while it answers."""
    at = np.array([mark.east_m, mark.north_m]) - own_m
    range_m = float(np.hypot(*at))
    fading = float(rng.gamma(scene.mark_fade, 1.0 / scene.mark_fade))
    strength = _strength(scene, np.array([mark.rcs_m2 * fading]), np.array([range_m]))
    rows = [_table(at[None], ATON_M, ATON_M, 0.0, strength)]
    if mark.racon_m > 0 and t_s % mark.racon_period_s < mark.racon_on_s:
        azimuth, ahead = math.atan2(*at), at / max(range_m, 1.0)
        for begin, end in ((0.06, 0.4), (0.5, 0.62), (0.72, 1.0)):
            middle = at + 0.5 * (begin + end) * mark.racon_m * ahead
            power = np.array([rng.uniform(0.5, 0.9)])
            rows.append(_table(middle[None], 1.2 * (end - begin) * mark.racon_m, ATON_M, azimuth, power))
    return np.concatenate(rows)


def _clutter(scene: Campaign, rng: np.random.Generator) -> FloatArray:
    n = int(rng.poisson(scene.clutter_rate))
    reach_m = scene.display.radius_px * scene.display.pixel_m * 0.97
    r, a = reach_m * np.sqrt(rng.random(n)), rng.uniform(0.0, 2.0 * np.pi, n)
    at = np.column_stack([r * np.sin(a), r * np.cos(a)])
    return np.column_stack([at, np.full((n, 2), ATON_M), np.zeros(n), rng.uniform(0.45, 0.9, n)])


def reference_of(scene: Campaign, n_scans: int) -> Reference:
    """Where the vessels were at each step: the truth, of the middle of their hulls."""
    t_s: FloatArray = scene.period_s * np.arange(n_scans, dtype=np.float64)
    states = [v.course().at(t_s) for v in scene.others]
    n = len(states)
    reports = Reports(
        ship=np.repeat(np.arange(n), n_scans),
        t_ns=np.tile(np.rint((scene.start_s + t_s) * 1e9).astype(np.int64), n),
        position_m=np.concatenate([s.position_m for s in states]),
        velocity_mps=np.concatenate([s.velocity_mps for s in states]),
        heading_rad=np.concatenate([s.heading_rad for s in states]),
    )
    return build_reference(
        reports, ids=[v.id for v in scene.others], names=[v.name for v in scene.others],
        length_m=np.array([v.length_m for v in scene.others]), width_m=np.array([v.width_m for v in scene.others]),
        complete=True,
    )  # fmt: skip


def north_up(scene: Campaign, k: int) -> Look:
    """The display at step k, north up, with the heading line of the ship."""
    own = next(v for v in scene.vessel if v.id == scene.own)
    heading = math.degrees(float(own.course().at(np.array([k * scene.period_s])).heading_rad[0]))
    return replace(scene.display, heading_line_deg=heading, up_deg=0.0)
