"""Where ships were: reports of AIS, GNSS or a simulator, and what they say about any instant."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from maritrack.errors import UsageError
from maritrack.geo import en_to_geodetic, geodetic_to_en, wrap, wrap_positive
from maritrack.types import BoolArray, Damage, FloatArray, IntArray, Origin, Truth, check_lengths, take

REST_M = 20.0  # a ship whose two reports are nearer than this, or ...
REST_MPS = 0.5  # ... whose way between them is slower than this, lies at rest
JUMP_MPS = 60.0  # no ship is faster: an AIS position beyond is wrong


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Reports of n ships, one ship after the other, each in order of time: rows start[i]:start[i + 1]."""

    ids: tuple[str, ...]
    names: tuple[str, ...]  # "" where unknown
    start: IntArray  # (n + 1,)
    t_ns: IntArray  # (m,) strictly increasing within a ship
    position_m: FloatArray  # (m, 2) east-north
    velocity_mps: FloatArray  # (m, 2) nan where not reported
    heading_rad: FloatArray  # (m,) nan where not reported
    length_m: FloatArray  # (n,) nan where unknown
    width_m: FloatArray  # (n,)
    complete: bool  # False: there are ships without reports, a track without truth is merely unexplained
    damage: tuple[Damage, ...] = ()
    up_m: FloatArray | None = None  # (m,) where the reports have it
    vel_up_mps: FloatArray | None = None  # (m,) with it, nan where not reported

    def __post_init__(self) -> None:
        check_lengths(self, len(self.ids), "names", "length_m", "width_m")
        check_lengths(self, len(self.ids) + 1, "start")
        told = ("t_ns", "position_m", "velocity_mps", "heading_rad", "up_m", "vel_up_mps")
        check_lengths(self, int(self.start[-1]), *told)

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True, slots=True, eq=False)
class Reports:
    """Reports in any order, as a document has them. Leading axis: report."""

    ship: IntArray  # (m,) index into the ids
    t_ns: IntArray  # (m,)
    position_m: FloatArray  # (m, 2)
    velocity_mps: FloatArray  # (m, 2)
    heading_rad: FloatArray  # (m,)
    up_m: FloatArray | None = None  # (m,)
    vel_up_mps: FloatArray | None = None  # (m,) with it

    def __post_init__(self) -> None:
        told = ("t_ns", "position_m", "velocity_mps", "heading_rad", "up_m", "vel_up_mps")
        check_lengths(self, len(self.ship), *told)


def build_reference(
    reports: Reports,
    *,
    ids: Sequence[str],
    names: Sequence[str],
    length_m: FloatArray,
    width_m: FloatArray,
    complete: bool,
    damage: tuple[Damage, ...] = (),
) -> Reference:
    """Ships ordered by id, their reports by time; of reports with equal times the first counts."""
    order = np.array(sorted(range(len(ids)), key=lambda i: ids[i]), dtype=np.int64)
    rank = np.empty(len(ids), dtype=np.int64)
    rank[order] = np.arange(len(ids))
    ship = rank[reports.ship]
    rows = np.lexsort((reports.t_ns, ship))  # stable
    same = np.zeros(len(rows), dtype=bool)
    same[1:] = (np.diff(ship[rows]) == 0) & (np.diff(reports.t_ns[rows]) == 0)
    rows = rows[~same]
    return Reference(
        ids=tuple(ids[i] for i in order),
        names=tuple(names[i] for i in order),
        start=np.searchsorted(ship[rows], np.arange(len(ids) + 1)).astype(np.int64),
        t_ns=reports.t_ns[rows],
        position_m=reports.position_m[rows],
        velocity_mps=reports.velocity_mps[rows],
        heading_rad=reports.heading_rad[rows],
        length_m=length_m[order],
        width_m=width_m[order],
        complete=complete,
        damage=damage,
        up_m=None if reports.up_m is None else reports.up_m[rows],
        vel_up_mps=None if reports.vel_up_mps is None else reports.vel_up_mps[rows],
    )


def only(reference: Reference, ids: Sequence[str]) -> Reference:
    """The ships of these ids alone; all, where none is named. UsageError for one that is not there."""
    if not ids:
        return reference
    missing = [i for i in ids if i not in reference.ids]
    if missing:
        some = ", ".join(reference.ids[:8]) + (", ..." if len(reference.ids) > 8 else "")
        raise UsageError(f"no ship {', '.join(missing)} in the truth", hint=f"it has {some}")
    ship = np.repeat(np.arange(len(reference)), np.diff(reference.start))
    chosen = np.array([i in ids for i in reference.ids], bool)
    told = Reports(ship, *(getattr(reference, f.name) for f in fields(Reports) if f.name != "ship"))
    left: Reports = take(told, chosen[ship])
    return replace(
        reference, **{f.name: getattr(left, f.name) for f in fields(left) if f.name != "ship"},
        ids=tuple(i for i in reference.ids if i in ids),
        names=tuple(name for i, name in zip(reference.ids, reference.names, strict=True) if i in ids),
        start=np.append(0, np.cumsum(np.diff(reference.start)[chosen])).astype(np.int64),
        length_m=reference.length_m[chosen], width_m=reference.width_m[chosen],
    )  # fmt: skip


def moved_to(reference: Reference, *, old: Origin | None, new: Origin | None) -> Reference:
    """The same reports in the plane of another origin; untouched where either origin is unknown."""
    if old is None or new is None or old == new:
        return reference
    lat_deg, lon_deg = en_to_geodetic(old, reference.position_m)
    return replace(reference, position_m=geodetic_to_en(new, lat_deg, lon_deg))


def truth_at(
    reference: Reference,
    t_ns: int,
    *,
    centre_m: FloatArray | None = None,
    min_range_m: float = 0.0,
    max_range_m: float = math.inf,
    max_gap_moving_s: float = 30.0,
    max_gap_rest_s: float = 360.0,
    lag_s: Mapping[str, float] | None = None,
) -> Truth:
    """The ships whose place at an instant is known, from `min_range_m` to `max_range_m` from `centre_m` (2,).

    Positions are linear between two reports that are no farther apart in time than `max_gap_moving_s`,
    or `max_gap_rest_s` for a ship at rest (`REST_M`, `REST_MPS`); never before the first nor after the
    last one. Velocity is the slope between them; a complete reference that reports velocities is taken
    at its word. `lag_s` by id: reports are late, what one says was true so many seconds before its time.
    """
    ask = np.full(len(reference), t_ns, dtype=np.int64)
    if lag_s:
        ask += np.array([round(lag_s.get(i, 0.0) * 1e9) for i in reference.ids], dtype=np.int64)
    before = _last_at_or_before(reference, ask)
    ship = np.flatnonzero(before >= 0)
    here, ask = before[ship], ask[ship]
    exact = reference.t_ns[here] == ask
    a, b, slope, bridged = _stretch(
        reference, ship, here, exact, max_gap_moving_s=max_gap_moving_s, max_gap_rest_s=max_gap_rest_s
    )
    since_s = (ask - reference.t_ns[here]) / 1e9
    position = reference.position_m[here] + since_s[:, None] * np.where(bridged[:, None], slope, 0.0)
    known = bridged | exact
    if centre_m is not None:
        range_m = np.hypot(*(position - centre_m).T)
        known &= (range_m >= min_range_m) & (range_m <= max_range_m)
    share = np.clip((ask - reference.t_ns[a]) / np.maximum(reference.t_ns[b] - reference.t_ns[a], 1), 0.0, 1.0)
    velocity = _velocity(reference, a, b, share=share, slope=np.where(bridged[:, None], slope, np.nan))
    heading = _heading(reference.heading_rad[a], reference.heading_rad[b], share=share)
    kept = ship[known]
    up_m, vel_up_mps = _heights(reference, a, b, share=share)
    return Truth(
        id=tuple(reference.ids[i] for i in kept.tolist()),
        name=tuple(reference.names[i] for i in kept.tolist()),
        t_ns=t_ns,
        position_m=position[known],
        velocity_mps=velocity[known],
        heading_rad=heading[known],
        length_m=reference.length_m[kept],
        width_m=reference.width_m[kept],
        up_m=None if up_m is None else up_m[known],
        vel_up_mps=None if vel_up_mps is None else vel_up_mps[known],
    )


def _heights(
    reference: Reference, a: IntArray, b: IntArray, *, share: FloatArray
) -> tuple[FloatArray | None, FloatArray | None]:
    """Up and its velocity (n,) between two reports; those of one where it is the only one."""
    if reference.up_m is None or reference.vel_up_mps is None:
        return None, None
    told = (reference.up_m, reference.vel_up_mps)
    up_m, vel_up_mps = ((1 - share) * one[a] + share * one[b] for one in told)
    return up_m, vel_up_mps


def _last_at_or_before(reference: Reference, ask: IntArray) -> IntArray:
    """Row of each ship's last report at or before a time of its own (n,); -1 = none. All ships bisect at once."""
    low, high = reference.start[:-1].copy(), reference.start[1:].copy()  # the answer + 1 lies in low..high
    last = len(reference.t_ns) - 1
    for _ in range(int(np.max(high - low, initial=0)).bit_length()):
        middle = (low + high) // 2
        open_ = low < high
        earlier = open_ & (reference.t_ns[np.minimum(middle, last)] <= ask)
        low = np.where(earlier, middle + 1, low)
        high = np.where(open_ & ~earlier, middle, high)
    return np.where(low > reference.start[:-1], low - 1, -1)


def _stretch(
    reference: Reference,
    ship: IntArray,
    here: IntArray,
    exact: BoolArray,
    *,
    max_gap_moving_s: float,
    max_gap_rest_s: float,
) -> tuple[IntArray, IntArray, FloatArray, BoolArray]:
    """Reports a, b around the instant, velocity (n, 2) between them, and whether the gap may be bridged.

    At the very time of a report the stretch after it counts, or the one before it where that is no better.
    """
    gaps = {"max_gap_moving_s": max_gap_moving_s, "max_gap_rest_s": max_gap_rest_s}
    after = np.minimum(here + 1, reference.start[ship + 1] - 1)
    back = exact & ~_slopes(reference, here, after, **gaps)[1]
    a = np.where(back, np.maximum(here - 1, reference.start[ship]), here)
    b = np.where(back, here, after)
    return a, b, *_slopes(reference, a, b, **gaps)


def _slopes(
    reference: Reference, a: IntArray, b: IntArray, *, max_gap_moving_s: float, max_gap_rest_s: float
) -> tuple[FloatArray, BoolArray]:
    """Velocity (n, 2) along each stretch a -> b, and whether it may be bridged."""
    dt_s = (reference.t_ns[b] - reference.t_ns[a]) / 1e9
    way = reference.position_m[b] - reference.position_m[a]
    slope = way / np.where(dt_s > 0, dt_s, np.nan)[:, None]
    distance = np.hypot(way[:, 0], way[:, 1])
    rest = (distance < REST_M) | (distance < REST_MPS * dt_s)
    jump = (not reference.complete) & (distance > JUMP_MPS * np.maximum(dt_s, 1.0))  # times may be whole seconds
    return slope, ~jump & (dt_s > 0) & ((dt_s <= max_gap_moving_s) | (rest & (dt_s <= max_gap_rest_s)))


def _velocity(reference: Reference, a: IntArray, b: IntArray, *, share: FloatArray, slope: FloatArray) -> FloatArray:
    """What the reports say (n, 2) where that counts, else the slope."""
    va, vb = reference.velocity_mps[a], reference.velocity_mps[b]
    told = (1 - share[:, None]) * va + share[:, None] * vb
    slope_first = np.isfinite(slope[:, 0]) & (not reference.complete)
    usable = np.isfinite(told).all(axis=1) & ~slope_first
    return np.where(usable[:, None], told, slope)


def _heading(a: FloatArray, b: FloatArray, *, share: FloatArray) -> FloatArray:
    """Between two headings the short way round; the one that is known where the other is not."""
    between = wrap_positive(a + share * wrap(b - a))
    return np.where(np.isnan(a), b, np.where(np.isnan(b), a, between))
