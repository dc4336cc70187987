"""Shapes of the picture as plain arrays: ellipses, hulls, trails and range rings.

Everything here is east-north; `picture` turns it over for a view whose y points down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maritrack.geo import TWO_PI
from maritrack.types import BoolArray, FloatArray, IntArray, Tracks, Truth

NM_M = 1852.0
STEPS_NM = (0.25, 0.5, 1.0, 2.0, 3.0, 6.0, 12.0, 24.0, 48.0)
STEPS_M = (5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)


def picture(position_m: FloatArray) -> NDArray[np.float32]:
    """East-north (..., 2) as x right, y down: (east, -north)."""
    return (np.asarray(position_m) * (1.0, -1.0)).astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class Strips:
    """Lines of different lengths, their vertices end to end."""

    vertex: FloatArray  # (v, 2)
    count: IntArray  # (s,) vertices of each line

    def __len__(self) -> int:
        return len(self.count)


def as_strips(polygons: FloatArray) -> Strips:
    """Lines (s, v, 2) with equally many vertices."""
    n, v = polygons.shape[:2]
    return Strips(polygons.reshape(-1, 2), np.full(n, v, np.int64))


def join(parts: list[FloatArray]) -> Strips:
    """Lines given one by one."""
    vertex = np.concatenate(parts) if parts else np.zeros((0, 2))
    return Strips(vertex, np.array([len(p) for p in parts], np.int64))


def ellipses(centre_m: FloatArray, shape_m2: FloatArray, *, scale: float = 1.0, vertices: int = 24) -> FloatArray:
    """Closed polygons (n, vertices + 1, 2) of {u: u' S^-1 u <= scale^2}: semi-axes scale sqrt(eig S).

    They go through the symmetric root of S, which has a closed form for two by two.
    """
    det = shape_m2[:, 0, 0] * shape_m2[:, 1, 1] - shape_m2[:, 0, 1] * shape_m2[:, 1, 0]
    s = np.sqrt(np.maximum(det, 0.0))
    t = np.sqrt(np.maximum(shape_m2[:, 0, 0] + shape_m2[:, 1, 1] + 2 * s, 0.0))
    root = (shape_m2 + s[:, None, None] * np.eye(2)) / np.where(t > 0, t, 1.0)[:, None, None]
    angle = np.linspace(0.0, TWO_PI, vertices + 1)
    circle = scale * np.stack([np.sin(angle), np.cos(angle)])  # (2, v)
    return centre_m[:, None, :] + np.swapaxes(root @ circle, 1, 2)


def axes_of(extent_m2: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Length and width (n,) of ellipses in metres (whole axes), and azimuth of the long axis, [0, pi)."""
    ee, nn, en = extent_m2[:, 0, 0], extent_m2[:, 1, 1], extent_m2[:, 0, 1]
    middle, radius = (ee + nn) / 2, np.hypot((ee - nn) / 2, en)
    orientation = 0.5 * np.arctan2(2 * en, nn - ee) % np.pi
    return 2 * np.sqrt(np.maximum(middle + radius, 0)), 2 * np.sqrt(np.maximum(middle - radius, 0)), orientation


def track_outlines(tracks: Tracks, rows: BoolArray) -> tuple[Strips, IntArray]:
    """Hull or ellipse to scale of the tracks that have one, and the row of each."""
    index = np.flatnonzero(rows)
    if tracks.contour_m:
        index = np.array([i for i in index if len(tracks.contour_m[i]) > 1], np.int64)
        return join([np.vstack([tracks.contour_m[i], tracks.contour_m[i][:1]]) for i in index]), index
    extent = tracks.extent_m2[index]
    index = index[np.trace(extent, axis1=1, axis2=2) > 0]
    return as_strips(ellipses(tracks.position_m[index], tracks.extent_m2[index])), index


def hulls(truth: Truth) -> FloatArray:
    """Outline (n, 6, 2) of the objects whose length, width and heading are known: a box with a bow."""
    known = np.isfinite(truth.length_m) & np.isfinite(truth.width_m) & np.isfinite(truth.heading_rad)
    ahead = np.array([-0.5, 0.3, 0.5, 0.3, -0.5, -0.5])
    right = np.array([-0.5, -0.5, 0.0, 0.5, 0.5, -0.5])
    along = ahead * truth.length_m[known, None]
    across = right * truth.width_m[known, None]
    s, c = np.sin(truth.heading_rad[known, None]), np.cos(truth.heading_rad[known, None])
    outline = np.stack([along * s + across * c, along * c - across * s], axis=-1)
    return truth.position_m[known, None, :] + outline


@dataclass(frozen=True, slots=True, eq=False)
class Trails:
    """The last positions of the tracks that live, oldest first; nan before a track began."""

    id: IntArray  # (t,)
    position_m: FloatArray  # (t, h, 2)


def no_trails(length: int) -> Trails:
    """Before the first scan."""
    return Trails(np.zeros(0, np.int64), np.zeros((0, length, 2)))


def extend_trails(trails: Trails, tracks: Tracks) -> Trails:
    """The trails one scan later. Tracks that are gone are forgotten."""
    grown = np.full((len(tracks), trails.position_m.shape[1], 2), np.nan)
    if len(trails.id):
        found = np.minimum(np.searchsorted(trails.id, tracks.id), len(trails.id) - 1)
        old = trails.id[found] == tracks.id
        grown[old, :-1] = trails.position_m[found[old], 1:]
    grown[:, -1] = tracks.position_m
    return Trails(tracks.id, grown)


def trail_strips(trails: Trails, rows: BoolArray) -> tuple[Strips, IntArray]:
    """The trails of these tracks that have two positions or more, and the row of each."""
    known = np.isfinite(trails.position_m[:, :, 0])
    index = np.flatnonzero(rows & (known.sum(axis=1) >= 2))
    return Strips(trails.position_m[index][known[index]], known[index].sum(axis=1)), index


def ring_step(range_m: float) -> tuple[float, float, str]:
    """Distance between range rings: in metres, and as it is written. Three to six rings."""
    if range_m >= 1.5 * NM_M:
        step = next((s for s in STEPS_NM if range_m / NM_M / s < 6.5), STEPS_NM[-1])
        return step * NM_M, step, "NM"
    step = next((s for s in STEPS_M if range_m / s < 6.5), STEPS_M[-1])
    return step, step, "m"


def rings(centre_m: FloatArray, range_m: float) -> tuple[Strips, FloatArray, list[str]]:
    """Range rings and the cross of the compass; where their labels stand, and what they say."""
    step_m, step, unit = ring_step(range_m)
    radius = np.arange(1, int(range_m / step_m + 1e-6) + 1) * step_m
    angle = np.linspace(0.0, TWO_PI, 121)
    circle = np.stack([np.sin(angle), np.cos(angle)], axis=-1)
    arm = np.array([[0.0, 1.0], [1.0, 0.0], [0.0, -1.0], [-1.0, 0.0]])
    tip = range_m * np.array([[-0.012, 0.965], [0.0, 1.0], [0.012, 0.965]])
    lines = [centre_m + r * circle for r in radius if r < 0.97 * range_m]
    lines += [centre_m + range_m * circle, centre_m + tip]
    lines += [centre_m + np.outer([0.0, range_m], a) for a in arm]
    slant = np.array([np.sin(np.radians(45)), np.cos(np.radians(45))])
    at = np.concatenate([radius[:, None] * slant, range_m * np.array([[0.0, 1.0], [0.0, 0.0]])])
    text = [f"{(i + 1) * step:g} {unit}" for i in range(len(radius))] + ["N", ""]
    return join(lines), centre_m + at, text
