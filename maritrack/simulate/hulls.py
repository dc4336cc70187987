"""Echoes of hulls in closed form: what `echoes` sums over a fine grid, for scenes that must be drawn fast.

A hull is convex, so a ray is inside of it from one range to another, and the blur of the pulse over an
exponential loss has an integral. Numbers differ from those of `echoes` by its grid alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maritrack.geo import TWO_PI, wrap
from maritrack.simulate.antenna import RadarSettings
from maritrack.simulate.echoes import FAN, HULL_DEPTHS, Mover, strengths
from maritrack.simulate.rays import BEAM_REACH, beam, through
from maritrack.simulate.scenery import Scenery
from maritrack.types import BoolArray, FloatArray, IntArray

RAYS_A_BEAM = 12.0  # across a hull, 8 at least


@dataclass(frozen=True, slots=True, eq=False)
class Heard:
    """A vessel in one turn: mean power with the strength of its pass, and what it takes from what lies behind."""

    spokes: IntArray  # (w,)
    first_cell: int
    power: FloatArray  # (w, c) over noise
    behind: int  # first cell in its shadow
    passed: FloatArray  # (w,) share of the power that gets past it


@dataclass(frozen=True, slots=True, eq=False)
class _Fleet:
    """All vessels in the middle of a turn."""

    bearing_rad: FloatArray  # (n,)
    distance_m: FloatArray  # (n,)
    slack_m: FloatArray  # (n,) as far as any part of it is from its place, at any time of the turn
    half_rad: FloatArray  # (n,) half the angle under which it appears, at any time of the turn
    hides: BoolArray  # (n, n) whether j may hide a part of i


def hear(radar: RadarSettings, fleet: Sequence[Mover], still: Scenery | None, k: int, *, seed: int) -> list[Heard]:
    """The echo of each vessel in turn k, behind the others and behind land (None = there is none)."""
    if not fleet:
        return []
    places, drawn = _places(radar, fleet, k), strengths(fleet, k, seed=seed)
    return [_heard(radar, fleet, i, k, places=places, still=still, strength=drawn[:, i]) for i in range(len(fleet))]


def _places(radar: RadarSettings, fleet: Sequence[Mover], k: int) -> _Fleet:
    states = [m.course.at(np.array([radar.turn_s * (k + 0.5)])) for m in fleet]
    position_m = np.concatenate([s.position_m for s in states])
    speed_mps = np.array([math.hypot(*s.velocity_mps[0]) for s in states])
    bearing_rad, distance_m = np.arctan2(position_m[:, 0], position_m[:, 1]), np.hypot(*position_m.T)
    slack_m = np.array([m.radius_m for m in fleet]) + radar.turn_s * np.maximum(speed_mps, 0.1)
    half_rad = np.arcsin(np.minimum(slack_m / np.maximum(distance_m, slack_m), 1.0))
    apart_rad = np.abs(wrap(bearing_rad[:, None] - bearing_rad))
    hides = (apart_rad < half_rad[:, None] + half_rad) & (distance_m - slack_m < (distance_m + slack_m)[:, None])
    np.fill_diagonal(hides, False)
    return _Fleet(bearing_rad, distance_m, slack_m, half_rad, hides)


def _heard(
    radar: RadarSettings, fleet: Sequence[Mover], i: int, k: int, *, places: _Fleet, still: Scenery | None,
    strength: FloatArray,
) -> Heard:  # fmt: skip
    mover, vessel = fleet[i], fleet[i].vessel
    first, end = _cells_near(radar, places.distance_m[i], places.slack_m[i] + 0.5 * radar.pulse_m)
    spokes = _spokes_near(radar, places.bearing_rad[i], places.half_rad[i] + BEAM_REACH * radar.beam_rad)
    if first >= end:
        return Heard(spokes[:0], 0, np.zeros((0, 0)), radar.cells, np.zeros(0))
    axis_rad = TWO_PI * (spokes + 0.5) / radar.spokes
    t_s = radar.turn_s * (k + axis_rad / TWO_PI)
    state = mover.course.at(t_s)
    outline_m = mover.hull_m(state)  # (w, v, 2)
    ray_rad, width_rad = _fan(radar, outline_m)
    near_m, far_m = chords(outline_m, ray_rad)
    edges_m, centres_m = radar.edges_m[first : end + 1], radar.centres_m[first:end]
    share = returned(near_m, far_m, edges_m, reach_m=mover.reach_m, pulse_m=radar.pulse_m)
    for j in np.nonzero(places.hides[i])[0].tolist():
        near2_m, far2_m = chords(fleet[j].hull_m(fleet[j].course.at(t_s)), ray_rad)
        depth_m = np.clip(centres_m - near2_m[..., None], 0.0, (far2_m - near2_m)[..., None])
        share *= through(depth_m / fleet[j].reach_m)
    if still is not None:
        rays = np.floor(ray_rad / TWO_PI * len(still.passed)).astype(np.int64) % len(still.passed)
        share *= still.passed[rays, first:end]
    off_rad = wrap(np.arctan2(state.position_m[:, 0], state.position_m[:, 1]) - axis_rad)
    gain = beam(wrap(ray_rad - axis_rad[:, None]), beam_rad=radar.beam_rad) * width_rad[:, None]  # (w, f)
    passes = np.floor((axis_rad + off_rad) / TWO_PI + 1e-9).astype(np.int64)
    rcs_per_m = vessel.rcs_m2 / vessel.length_m / (1.0 - math.exp(-HULL_DEPTHS))
    power = np.matmul(gain[:, None, :], share)[:, 0] * (rcs_per_m * centres_m * radar.range_law(centres_m))
    whole_rad = radar.beam_rad * math.sqrt(math.pi / (8.0 * math.log(2.0)))
    taken = (gain * (1.0 - through((far_m - near_m) / mover.reach_m))).sum(axis=1) / whole_rad
    behind = math.ceil(places.distance_m[i] / radar.cell_m) - radar.first_cell
    return Heard(spokes, first, strength[passes + 1][:, None] * power, max(behind, 0), 1.0 - np.minimum(taken, 1.0))


def _cells_near(radar: RadarSettings, distance_m: float, within_m: float) -> tuple[int, int]:
    first = math.floor((distance_m - within_m) / radar.cell_m) - radar.first_cell
    end = math.ceil((distance_m + within_m) / radar.cell_m) - radar.first_cell
    return max(first, 0), min(end, radar.cells)


def _spokes_near(radar: RadarSettings, bearing_rad: float, half_rad: float) -> IntArray:
    middle = math.floor(bearing_rad / TWO_PI * radar.spokes)
    side = min(math.ceil(half_rad / TWO_PI * radar.spokes), (radar.spokes - 1) // 2)
    return np.asarray(np.sort((middle + np.arange(-side, side + 1)) % radar.spokes), dtype=np.int64)


def _fan(radar: RadarSettings, outline_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rays (w, f) over the angle of each hull (w, v, 2), and their width (w,)."""
    middle_m = outline_m.mean(axis=1)
    bearing_rad = np.arctan2(middle_m[:, 0], middle_m[:, 1])
    off_rad = wrap(np.arctan2(outline_m[..., 0], outline_m[..., 1]) - bearing_rad[:, None])
    low_rad, span_rad = off_rad.min(axis=1), np.ptp(off_rad, axis=1)
    n = min(FAN, max(8, math.ceil(RAYS_A_BEAM * span_rad.max() / radar.beam_rad)))
    rays_rad = (bearing_rad + low_rad)[:, None] + span_rad[:, None] * (np.arange(n) + 0.5) / n
    return rays_rad, span_rad / n


def chords(outline_m: FloatArray, ray_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ranges (w, f) at which rays (w, f) enter and leave convex hulls (w, v, 2); equal where they miss."""
    s, c = np.sin(ray_rad)[..., None], np.cos(ray_rad)[..., None]
    x, y = outline_m[:, None, :, 0], outline_m[:, None, :, 1]
    along_m, left_m = x * s + y * c, y * s - x * c  # (w, f, v)
    p, q, start_m = np.roll(left_m, 1, axis=-1), left_m, np.roll(along_m, 1, axis=-1)
    crosses = (p >= 0.0) != (q >= 0.0)
    at_m = start_m + (along_m - start_m) * p / np.where(crosses, p - q, 1.0)
    near_m = np.where(crosses, at_m, np.inf).min(axis=-1)
    far_m = np.where(crosses, at_m, -np.inf).max(axis=-1)
    hit = far_m > np.maximum(near_m, 0.0)
    return np.where(hit, np.maximum(near_m, 0.0), 0.0), np.where(hit, far_m, 0.0)


def returned(
    near_m: FloatArray, far_m: FloatArray, edges_m: FloatArray, *, reach_m: float, pulse_m: float
) -> FloatArray:
    """Share of the power of rays (w, f) that comes back out of each cell between edges (c + 1,): (w, f, c).

    As `rays.returned`, whose sum over the pulse is an integral here.
    """
    near_m, depth_m = near_m[..., None], (far_m - near_m)[..., None]
    lost = 1.0 - through(depth_m / reach_m)

    def taken_m(range_m: FloatArray) -> FloatArray:
        """Integral of the share that is lost up to each range."""
        inside_m = np.clip(range_m - near_m, 0.0, depth_m)
        over = inside_m - reach_m * (1.0 - np.exp(-inside_m / reach_m))
        return np.asarray(over + lost * np.maximum(range_m - near_m - depth_m, 0.0), dtype=np.float64)

    at_edge = (taken_m(edges_m + 0.5 * pulse_m) - taken_m(edges_m - 0.5 * pulse_m)) / pulse_m
    return np.asarray(np.diff(at_edge, axis=-1), dtype=np.float64)
