"""What is to be said of each ship and of each track, from matches and looks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from maritrack.aischeck.looks import Looks
from maritrack.aischeck.match import Matching, Noise, TrackRows, position_noise, square
from maritrack.aischeck.seeing import Seeing, p_so_few, p_so_many, ring_of
from maritrack.aischeck.ships import Ship
from maritrack.types import BoolArray, FloatArray, IntArray

CONFIRMED, ECHO, DISPLACED, UNSEEN, UNDECIDED = "confirmed", "echo", "displaced", "unseen", "undecided"
LEAST_MATCHED, LEAST_SHARE = 12, 0.25  # scans, and share of the looks, in which a track is the ship
REST_MPS = 1.0  # slower ships are taken to lie
MISFIT = 11.8  # 3 sigma in the plane
ABOARD_M = 60.0  # a ship always nearer than this to the radar may carry it
BESIDE_SPREAD = 0.2  # of chance echoes from place to place


@dataclass(frozen=True, slots=True)
class Rules:
    """When something is said."""

    p_unseen: float = 0.001  # probability of so few echoes, of a ship that is there, below which it is not seen
    p_echo: float = 0.0001  # ... of so many by chance, below which there is an echo


@dataclass(frozen=True, slots=True)
class Displacement:
    """A track that goes as a ship does, elsewhere."""

    track: int
    scans: int
    offset_m: tuple[float, float]  # track minus ship
    sigma_m: float  # of such an offset, were they one
    others: tuple[int, ...] = ()  # tracks that go so too: it may be any of them


@dataclass(frozen=True, slots=True)
class Verdict:
    """What radar says of a ship."""

    id: str
    name: str
    verdict: str
    why: str
    looks: int  # while its place was told, in reach and not hidden
    hidden: int  # looks that land hid
    hits: int
    beside: float  # share of the places beside it with an echo
    p_detect: float  # of the confirmed ships at its ranges; nan = not known
    p_so_few: float  # of so few hits, were it there
    p_by_chance: float  # of so many hits, were nothing there
    matched: int  # scans in which a track is the ship
    tracks: tuple[int, ...]
    lag_s: float
    speed_mps: float
    range_m: tuple[float, float]
    offset_m: tuple[float, float]  # track minus ship, mean; nan without one
    offset_sigmas: float
    velocity_mps: tuple[float, float]  # track minus ship, mean
    velocity_sigmas: float
    displaced: Displacement | None
    doubles: tuple[int, ...]  # of one displaced or late, other tracks that go as it does
    place_m: tuple[float, float]  # where it was said to be last


def verdicts(
    ships: Sequence[Ship], rows: TrackRows, moving: BoolArray, matching: Matching, looks: Looks, seeing: Seeing,
    displaced: Sequence[Displacement | None], doubles: Sequence[tuple[int, ...]], noise: Noise, rules: Rules,
) -> list[Verdict]:  # fmt: skip
    """One for each ship that the radar looked at."""
    found = []
    for s, ship in enumerate(ships):
        here = np.flatnonzero(looks.ship == s)
        if len(here):
            of = np.flatnonzero(matching.ship == s)
            told = _verdict(s, ship, here, of, rows, moving, matching, looks, seeing, displaced[s], noise, rules)
            found.append(replace(told, doubles=doubles[s]) if told.displaced is None else told)
    return found


def matched_ships(n: int, looks: Looks, rows: TrackRows, matching: Matching, moving: BoolArray) -> BoolArray:
    """The ships (n,) that moving tracks confirm."""
    return np.array([_is_matched(s, looks, rows, matching, moving) for s in range(n)], bool)


def _is_matched(s: int, looks: Looks, rows: TrackRows, matching: Matching, moving: BoolArray) -> bool:
    here = int(((looks.ship == s) & (looks.speed_mps >= REST_MPS)).sum())
    scans = len(np.unique(rows.scan[(matching.ship == s) & moving & rows.hit]))
    return scans >= LEAST_MATCHED and scans >= LEAST_SHARE * here


def _verdict(
    s: int, ship: Ship, here: IntArray, of: IntArray, rows: TrackRows, moving: BoolArray, matching: Matching,
    looks: Looks, seeing: Seeing, displaced: Displacement | None, noise: Noise, rules: Rules,
) -> Verdict:  # fmt: skip
    open_ = here[~looks.hidden[here]]
    hits, n = int(looks.hit[open_].sum()), len(open_)
    beside = float(np.nanmean(looks.beside[open_])) if np.isfinite(looks.beside[open_]).any() else 0.0
    p_ring = seeing.p_detect(without=s)[ring_of(looks.range_m[open_])]
    told = np.isfinite(p_ring)
    mean = float(p_ring[told].mean()) if told.any() else math.nan
    scale, spread = 1.0 / seeing.independent, seeing.spread_of_another(without=s)
    few = p_so_few(looks.hit[open_][told].sum() * scale, told.sum() * scale, mean, spread) if told.any() else 1.0
    many = p_so_many(hits * scale, n * scale, beside, BESIDE_SPREAD) if n else 1.0
    speed = float(np.median(looks.speed_mps[here]))
    matched = len(np.unique(rows.scan[of]))
    offset, off_sigmas, velocity, fast_sigmas = _misfit(ship, of, rows, matching, noise)
    is_matched = _is_matched(s, looks, rows, matching, moving)
    aboard = float(looks.range_m[here].max()) < ABOARD_M
    verdict, why = _said(
        is_matched, displaced, n, len(here) - n, hits, mean, few, many, beside, speed, matched, aboard, rules
    )
    last = looks.position_m[here[-1]]
    return Verdict(
        ship.id, ship.name, verdict, why, n, len(here) - n, hits, beside, mean, few, many, matched,
        tuple(np.unique(rows.id[of]).tolist()), ship.lag_s, speed,
        (float(looks.range_m[here].min()), float(looks.range_m[here].max())), offset, off_sigmas, velocity,
        fast_sigmas, displaced if verdict == DISPLACED else None,
        displaced.others if displaced is not None and verdict == DISPLACED else (), (float(last[0]), float(last[1])),
    )  # fmt: skip


def _said(
    is_matched: bool, displaced: Displacement | None, n: int, hidden: int, hits: int, mean: float, few: float,
    many: float, beside: float, speed: float, matched: int, aboard: bool, rules: Rules,
) -> tuple[str, str]:  # fmt: skip
    """The first that applies."""
    share, echoes = f"{hits} echoes in {n} looks", many < rules.p_echo
    if is_matched:
        return CONFIRMED, f"a track goes with it in {matched} scans"
    if displaced is not None and not (echoes and speed >= REST_MPS):
        far = math.hypot(*displaced.offset_m)
        return DISPLACED, f"track {displaced.track} goes as it does, {far:.0f} m away, in {displaced.scans} scans"
    if few < rules.p_unseen and matched < LEAST_MATCHED and not echoes:
        return UNSEEN, f"{share}, where ships have {mean:.0%}: probability {few:.1g}, were it there"
    if echoes and speed < REST_MPS:
        return ECHO, f"{share}, {beside:.0%} beside it: something lies where it lies"
    if echoes:
        return CONFIRMED, f"{share} on its way, {beside:.0%} beside it: probability {many:.1g} by chance"
    reasons = (
        (aboard, f"{share}: it is where the radar is, own ship? (--own-ship)"),
        (n == 0, f"land lies before it in all {hidden} looks"),
        (matched >= LEAST_MATCHED, f"{share}, a track goes with it in {matched} scans only"),
        (math.isnan(mean), f"{share}: no other ship at this range tells what is to be expected"),
        (beside > 0.5, f"{share}, but {beside:.0%} beside it: land or clutter"),
    )
    otherwise = f"{share}, where ships have {mean:.0%}: too few looks, or ships that differ too much"
    return UNDECIDED, next((why for applies, why in reasons if applies), otherwise)


def _misfit(
    ship: Ship, of: IntArray, rows: TrackRows, matching: Matching, noise: Noise
) -> tuple[tuple[float, float], float, tuple[float, float], float]:
    """Mean offsets of position and velocity of the tracks that are the ship, and how many sigmas that is.

    What is wrong with the radar's azimuth or with the hull's middle is the same in all scans: the covariance of the
    mean is taken to be that of one scan, for velocities that of stretches of half a minute.
    """
    nan = (math.nan, math.nan)
    if len(of) == 0:
        return nan, math.nan, nan, math.nan
    _, told, _ = ship.at(rows.t_s[of])
    offset = matching.offset_m[of].mean(axis=0)
    d2 = float(square(offset[None], position_noise(rows, of, ship, told, noise).mean(axis=0)[None])[0])
    apart = (rows.velocity_mps[of] - told).mean(axis=0)
    spans = max(float(np.ptp(rows.t_s[of])) / 30.0, 1.0)
    V = rows.cov[of][:, 2:, 2:].mean(axis=0) / spans + 0.25 * np.eye(2)
    v2 = float(square(apart[None], V[None])[0])
    return _pair(offset), math.sqrt(d2), _pair(apart), math.sqrt(v2)


def _pair(value: FloatArray) -> tuple[float, float]:
    return float(value[0]), float(value[1])


def misfits(verdict: Verdict) -> tuple[bool, bool]:
    """Whether position and velocity of a confirmed ship disagree with its tracks beyond 3 sigma."""
    told = verdict.verdict == CONFIRMED and verdict.matched >= LEAST_MATCHED
    position = told and verdict.offset_sigmas**2 > MISFIT
    return position, told and verdict.velocity_sigmas**2 > MISFIT
