"""How well background subtraction tells background from vessels, point by point (abs, Table IV).

Positive is background: a point that was taken away. True is what lies outside of the boxes of the vessels that are
known: a rectangle of the hull's length and width, turned to its heading.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maritrack.types import BoolArray, FloatArray, IntArray, Points, Truth

COURSE_MPS = 0.5  # above this the course stands for a heading that is not known


@dataclass(frozen=True, slots=True)
class Confusion:
    """Points of one scan by what they were taken for and what they are."""

    tp: int  # taken away, outside of all boxes
    fp: int  # taken away, in a box: part of a vessel is lost
    fn: int  # left, outside of all boxes: background, or clutter, is tracked
    tn: int  # left, in a box

    @property
    def fpr(self) -> float:
        """FP / (FP + TN): share of the points of vessels that are lost; nan without any."""
        return self.fp / (self.fp + self.tn) if self.fp + self.tn else math.nan

    @property
    def npv(self) -> float:
        """TN / (TN + FN): share of the points left that are of vessels; nan where none is left."""
        return self.tn / (self.tn + self.fn) if self.tn + self.fn else math.nan


def confusion(points: Points, keep: BoolArray, truth: Truth, *, margin_m: float = 0.0) -> Confusion:
    """Points (n,) of which `keep` were left, against the boxes of truth, which are wider by `margin_m` all around."""
    vessel = in_boxes(points, truth, margin_m=margin_m)
    tp, fp, fn, tn = (int(np.count_nonzero(a & b)) for a in (~keep, keep) for b in (~vessel, vessel))
    return Confusion(tp, fp, fn, tn)


def in_boxes(points: Points, truth: Truth, *, margin_m: float = 0.0) -> BoolArray:
    """Whether each point (n,) lies in the box of a vessel at the time when the beam saw it."""
    inside = np.zeros(len(points), bool)
    for i in np.flatnonzero(has_box(truth)).tolist():
        inside |= in_box(points.position_m, points.t_ns, truth, i, margin_m=margin_m)
    return inside


def in_box(position_m: FloatArray, t_ns: IntArray, truth: Truth, i: int, *, margin_m: float = 0.0) -> BoolArray:
    """Whether each position (n, 2) lies in the box of vessel i, which is moved on to the times t_ns (n,).

    A vessel whose size or heading is unknown has no box; under way its course stands for the heading.
    """
    heading_rad = float(headings(truth)[i])
    since_s = (t_ns - truth.t_ns) * 1e-9
    moved_m = since_s[:, None] * np.nan_to_num(truth.velocity_mps[i])
    ahead_m, abeam_m = _aboard(position_m - truth.position_m[i] - moved_m, heading_rad)
    along, across = truth.length_m[i] / 2 + margin_m, truth.width_m[i] / 2 + margin_m
    return np.asarray((np.abs(ahead_m) <= along) & (np.abs(abeam_m) <= across))  # false where something is nan


def headings(truth: Truth) -> FloatArray:
    """Heading of each vessel (n,) in radians, that of its course where it is not known; nan where neither is."""
    east_mps, north_mps = truth.velocity_mps.T
    course_rad = np.where(np.hypot(east_mps, north_mps) > COURSE_MPS, np.arctan2(east_mps, north_mps), math.nan)
    return np.where(np.isnan(truth.heading_rad), course_rad, truth.heading_rad)


def has_box(truth: Truth) -> BoolArray:
    """Which vessels (n,) have a box: their size and their heading are known."""
    return np.asarray(np.isfinite(truth.length_m + truth.width_m + headings(truth)), bool)


def _aboard(offset_m: FloatArray, heading_rad: float) -> tuple[FloatArray, FloatArray]:
    """Offsets (n, 2) east-north as metres ahead and to starboard."""
    s, c = math.sin(heading_rad), math.cos(heading_rad)
    return offset_m[:, 0] * s + offset_m[:, 1] * c, offset_m[:, 0] * c - offset_m[:, 1] * s


def background_scores(
    points: Points, keep: BoolArray, truth: Truth | None, *, margin_m: float = 0.0
) -> dict[str, float]:
    """`fpr` and `npv` of one scan, nan where there is no truth, or no vessel of it has a box."""
    if truth is None or not has_box(truth).any():
        return {"fpr": math.nan, "npv": math.nan}
    table = confusion(points, keep, truth, margin_m=margin_m)
    return {"fpr": table.fpr, "npv": table.npv}
