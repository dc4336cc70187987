"""Vessels as a radar hears them: hulls seen at the time of each spoke, behind land and behind each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from maritrack.geo import TWO_PI, wrap
from maritrack.simulate.antenna import FADE, RadarSettings, rng
from maritrack.simulate.rays import BEAM_REACH, beam, inside_length, returned, through
from maritrack.simulate.scenery import Scenery
from maritrack.simulate.vessels import Course, State, Vessel, hull
from maritrack.types import BoolArray, FloatArray, IntArray

HULL_DEPTHS = 4.0  # reaches in the width of a hull: exp(-4) of the power gets past it broadside
FAN = 32  # rays across a hull


@dataclass(frozen=True, slots=True, eq=False)
class Echo:
    """Mean power of one vessel in one turn: a window of spokes and cells."""

    spokes: IntArray  # (w,)
    first_cell: int
    power: FloatArray  # (w, c) over noise


@dataclass(frozen=True, slots=True, eq=False)
class Mover:
    """A vessel and its course, relative to the antenna."""

    vessel: Vessel
    course: Course

    @property
    def radius_m(self) -> float:
        return 0.5 * math.hypot(self.vessel.length_m, self.vessel.width_m)

    @property
    def reach_m(self) -> float:
        return self.vessel.width_m / HULL_DEPTHS

    def hull_m(self, state: State) -> FloatArray:
        v = self.vessel
        return hull(state, length_m=v.length_m, width_m=v.width_m, outline=v.outline)


def movers(radar: RadarSettings, vessels: Sequence[Vessel]) -> tuple[Mover, ...]:
    """The vessels of a scene as the antenna sees them."""
    found = []
    for vessel in vessels:
        course = vessel.course()
        shifted_m = course.position_m - [radar.east_m, radar.north_m]
        found.append(Mover(vessel, replace(course, position_m=shifted_m)))
    return tuple(found)


def echoes(radar: RadarSettings, fleet: Sequence[Mover], still: Scenery, k: int) -> tuple[Echo, ...]:
    """The mean echo of each vessel in turn k, behind land and behind each other, without fading."""
    return tuple(_echo(radar, fleet, i, still, k) for i in range(len(fleet)))


def _echo(radar: RadarSettings, fleet: Sequence[Mover], i: int, still: Scenery, k: int) -> Echo:
    mover, vessel = fleet[i], fleet[i].vessel
    azimuth_rad, t_s = radar.azimuths_rad(), radar.times_s(k)
    state = mover.course.at(t_s)
    seen = _within(state.position_m, azimuth_rad, mover.radius_m, BEAM_REACH * radar.beam_rad)
    spokes = np.nonzero(seen)[0]
    first, end = _cells_of(radar, state.position_m[spokes], mover.radius_m + radar.pulse_m)
    if not len(spokes) or first >= end:
        return Echo(spokes[:0], 0, np.zeros((0, 0)))
    t_s, axis_rad = t_s[spokes], azimuth_rad[spokes]
    outline_m = mover.hull_m(mover.course.at(t_s))  # (w, v, 2)
    ray_rad, ray_width_rad = _fan(outline_m)
    rays, times_s = ray_rad.ravel(), np.repeat(t_s, FAN)
    share = returned(
        np.repeat(outline_m, FAN, axis=0), rays, radar.edges_m[first : end + 1],
        reach_m=mover.reach_m, pulse_m=radar.pulse_m,
    )  # fmt: skip
    centres_m = radar.centres_m[first:end]
    share *= clear(fleet, rays, times_s, centres_m, but=i)
    share *= still.passed[_ray_index(still, rays), first:end]
    gain = beam(wrap(ray_rad - axis_rad[:, None]), beam_rad=radar.beam_rad) * ray_width_rad[:, None]  # (w, rays)
    rcs_per_m = vessel.rcs_m2 / vessel.length_m / (1.0 - math.exp(-HULL_DEPTHS))
    collected = np.einsum("wf,wfc->wc", gain, share.reshape(len(spokes), FAN, -1))
    return Echo(spokes, first, rcs_per_m * centres_m * radar.range_law(centres_m) * collected)


def _within(position_m: FloatArray, azimuth_rad: FloatArray, radius_m: float, margin_rad: float) -> BoolArray:
    """Which directions (n,) come near a disc about the position (n, 2) at their time."""
    distance_m = np.hypot(position_m[:, 0], position_m[:, 1])
    half_rad = np.arcsin(np.minimum(radius_m / np.maximum(distance_m, radius_m), 1.0)) + margin_rad
    off_rad = wrap(np.arctan2(position_m[:, 0], position_m[:, 1]) - azimuth_rad)
    return np.asarray(np.abs(off_rad) <= half_rad)


def _cells_of(radar: RadarSettings, position_m: FloatArray, radius_m: float) -> tuple[int, int]:
    """First and last-but-one cell within a radius of any of the positions."""
    if not len(position_m):
        return 0, 0
    distance_m = np.hypot(position_m[:, 0], position_m[:, 1])
    first = math.floor((distance_m.min() - radius_m) / radar.cell_m) - radar.first_cell
    end = math.ceil((distance_m.max() + radius_m) / radar.cell_m) - radar.first_cell
    return max(first, 0), min(end, radar.cells)


def _fan(outline_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rays (w, FAN) that share out the angle under which each hull (w, v, 2) appears, and their width (w,)."""
    middle_m = outline_m.mean(axis=1)
    bearing_rad = np.arctan2(middle_m[:, 0], middle_m[:, 1])
    off_rad = wrap(np.arctan2(outline_m[..., 0], outline_m[..., 1]) - bearing_rad[:, None])
    low, high = off_rad.min(axis=1), off_rad.max(axis=1)
    width_rad = (high - low) / FAN
    return (bearing_rad + low)[:, None] + width_rad[:, None] * (np.arange(FAN) + 0.5), width_rad


def clear(
    fleet: Sequence[Mover], ray_rad: FloatArray, t_s: FloatArray, range_m: FloatArray, *, but: int = -1
) -> FloatArray:
    """Share of the power that all vessels (but one) let through along rays (n,) to ranges (r,): (n, r)."""
    passed = np.ones((len(ray_rad), len(range_m)))
    for j, mover in enumerate(fleet):
        if j == but:
            continue
        state = mover.course.at(t_s)
        rows = np.nonzero(_within(state.position_m, ray_rad, mover.radius_m, 0.0))[0]
        if len(rows):
            outline_m = mover.hull_m(mover.course.at(t_s[rows]))
            passed[rows] *= through(inside_length(outline_m, ray_rad[rows], range_m) / mover.reach_m)
    return passed


def _ray_index(still: Scenery, azimuth_rad: FloatArray) -> IntArray:
    n = len(still.passed)
    return np.floor(azimuth_rad / TWO_PI * n).astype(np.int64) % n


def fades(radar: RadarSettings, fleet: Sequence[Mover], i: int, echo: Echo, k: int, *, seed: int) -> FloatArray:
    """Strength of a vessel's echo about its mean, (w,): one number for each pass of the beam over it.

    A pass over North belongs to two turns and keeps its number.
    """
    azimuth_rad, t_s = radar.azimuths_rad()[echo.spokes], radar.times_s(k)[echo.spokes]
    position_m = fleet[i].course.at(t_s).position_m
    off_rad = wrap(np.arctan2(position_m[:, 0], position_m[:, 1]) - azimuth_rad)
    # a little past North, so that rounding does not part the echo of what lies due North
    passes = np.floor((azimuth_rad + off_rad) / TWO_PI + 1e-9).astype(np.int64)
    return np.asarray(strengths(fleet, k, seed=seed)[passes + 1, i], dtype=np.float64)


def strengths(fleet: Sequence[Mover], k: int, *, seed: int) -> FloatArray:
    """Strength of each vessel's echo in the pass before that of turn k, in it and in the one after, (3, n)."""
    shapes = np.array([m.vessel.fade for m in fleet])
    return np.stack([rng(seed, FADE, p + 1).standard_gamma(shapes) / shapes for p in (k - 1, k, k + 1)])
