"""Intersection over union of the outline of a ship and of what a track draws: contour, hull or ellipse.

The outline of a ship is a box of its length and width whose foremost part narrows to a point (extended, sec. 4.1).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from maritrack.objects import matrix2
from maritrack.types import BoolArray, FloatArray, IntArray, Tracks, Truth

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

CORNERS = 64  # of an ellipse


def outlines(truth: Truth, rows: IntArray, bow_share: float) -> FloatArray:
    """Outlines (k, 5, 2) of ships, counter-clockwise from the tip of the bow; nan where size or heading are unknown."""
    half, side = truth.length_m[rows] / 2, truth.width_m[rows] / 2
    shoulder = half - bow_share * truth.length_m[rows]
    forward = np.stack([half, shoulder, -half, -half, shoulder], axis=1)
    right = np.stack([np.zeros(len(rows)), -side, -side, side, side], axis=1)
    s, c = np.sin(truth.heading_rad[rows])[:, None], np.cos(truth.heading_rad[rows])[:, None]
    body = np.stack([forward * s + right * c, forward * c - right * s], axis=-1)
    return np.asarray(truth.position_m[rows, None] + body)


def has_outline(truth: Truth) -> BoolArray:
    """Ships (n,) whose length, width and heading are known."""
    return np.asarray(np.isfinite(truth.length_m) & np.isfinite(truth.width_m) & np.isfinite(truth.heading_rad))


def has_shape(tracks: Tracks) -> BoolArray:
    """Tracks (t,) that draw something: all where the tracker draws contours, else those with an extent."""
    if tracks.contour_m:
        return np.ones(len(tracks), bool)
    return np.asarray(np.trace(tracks.extent_m2, axis1=1, axis2=2) > 0.0)


def shape(tracks: Tracks, row: int) -> FloatArray:
    """Outline (v, 2) of a track: its contour, without one the ellipse of its extent."""
    if tracks.contour_m:
        return tracks.contour_m[row]
    root = matrix2.root(tracks.extent_m2[row][None])[0]
    angle = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    return np.asarray(tracks.position_m[row] + np.stack([np.cos(angle), np.sin(angle)], axis=1) @ root)


def iou(a: FloatArray, b: FloatArray) -> float:
    """Of two polygons (v, 2), in 0..1; 0 where one of them has no area. They may be concave or cross themselves."""
    p, q = _polygon(a), _polygon(b)
    if p is None or q is None:
        return 0.0
    common = float(p.intersection(q).area)
    union = float(p.area) + float(q.area) - common
    return common / union if union > 0.0 else 0.0


def _polygon(corners: FloatArray) -> BaseGeometry | None:
    import shapely  # not at the top: not every run has outlines

    if len(corners) < 3:
        return None
    polygon = shapely.Polygon(corners)
    return polygon if polygon.is_valid else shapely.make_valid(polygon)


def pair_ious(truth: Truth, tracks: Tracks, pairs: IntArray, *, bow_share: float) -> FloatArray:
    """IoU (k,) of pairs (k, 2) of truth and track, the ship moved to the track's time; nan where one has no outline."""
    found = np.full(len(pairs), np.nan)
    known = has_outline(truth)[pairs[:, 0]] & has_shape(tracks)[pairs[:, 1]]
    rows = pairs[known]
    v = np.where(np.isfinite(truth.velocity_mps[rows[:, 0]]), truth.velocity_mps[rows[:, 0]], 0.0)
    moved = v * ((tracks.t_ns[rows[:, 1]] - truth.t_ns) * 1e-9)[:, None]
    ships = outlines(truth, rows[:, 0], bow_share) + moved[:, None]
    found[known] = [iou(ship, shape(tracks, k)) for ship, k in zip(ships, rows[:, 1].tolist(), strict=True)]
    return found
