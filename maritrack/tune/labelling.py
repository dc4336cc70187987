"""Which object each point of a scan is of: from labelled cells, from the points themselves, or from positions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from maritrack import geo
from maritrack.errors import InputError
from maritrack.metrics.clusters import NOISE, UNKNOWN
from maritrack.simulate.labels import Owners
from maritrack.simulate.scenes import LAND_ID
from maritrack.types import BoolArray, FloatArray, Frame, IntArray, Points, Scan, Truth

ECHO_SHARE = 0.5  # of a scan's labelled cells that must have an echo, or the labels are of another recording


UNDER_WAY_MPS = 0.5


class Labelling(Protocol):
    """How points come by their objects."""

    @property
    def told(self) -> str:
        """In words, for the answer."""
        ...

    def label(self, k: int, frame: Frame, points: Points) -> IntArray:
        """Object of each point (n,) of the k-th turn of the recording: >= 0, or NOISE, or UNKNOWN."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class CellLabels:
    """Cells that the simulator labelled. Land is UNKNOWN: nobody says which pieces of it are one."""

    owners: Owners
    path: Path
    azimuth_offset_rad: float  # of the settings, which the table doesn't know of

    @property
    def told(self) -> str:
        return f"cells of {self.path.name}; land is no object, pairs of its points do not count"

    def label(self, k: int, frame: Frame, points: Points) -> IntArray:
        video = frame.scan.video
        if video is None or not video.intensity.size:
            return np.full(len(points), NOISE)
        n_cells = video.intensity.shape[1]
        n_spokes = round(geo.TWO_PI / float(np.median(video.width_rad)))
        rows = slice(*np.searchsorted(self.owners.scan, [k, k + 1]).tolist())
        spoke, cell = self.owners.spoke[rows].astype(np.int64), self.owners.cell[rows].astype(np.int64)
        self._check(k, frame.scan, spoke, cell, self._spoke(video.azimuth_rad, n_spokes), n_spokes)
        of_cell = np.full(n_spokes * n_cells, NOISE)
        owner = self.owners.owner[rows].astype(np.int64)
        land = [i for i, name in enumerate(self.owners.ids) if name == LAND_ID]
        inside = (spoke < n_spokes) & (cell < n_cells)
        of_cell[(spoke * n_cells + cell)[inside]] = np.where(np.isin(owner, land), UNKNOWN, owner)[inside]
        at = np.rint((points.range_m - video.first_range_m) / video.cell_m).astype(np.int64)
        return np.asarray(of_cell[self._spoke(points.azimuth_rad, n_spokes) * n_cells + at], dtype=np.int64)

    def _spoke(self, azimuth_rad: FloatArray, n_spokes: int) -> IntArray:
        """Number of the spoke from North in the recording's own azimuth."""
        turned = geo.wrap_positive(azimuth_rad - self.azimuth_offset_rad) / geo.TWO_PI
        return np.minimum((turned * n_spokes).astype(np.int64), n_spokes - 1)

    def _check(self, k: int, scan: Scan, spoke: IntArray, cell: IntArray, of_row: IntArray, n_spokes: int) -> None:
        """InputError where the labelled cells of this turn have no echo."""
        assert scan.video is not None
        row = np.full(n_spokes, -1)
        row[of_row] = np.arange(len(of_row))
        inside = (spoke < n_spokes) & (cell < scan.video.intensity.shape[1])
        spoke, cell, n = spoke[inside], cell[inside], len(spoke)
        heard = int(np.count_nonzero(scan.video.intensity[row[spoke], cell] * (row[spoke] >= 0)))
        if heard < ECHO_SHARE * n:
            message = f"{self.path}: {heard} of the {n} labelled cells of turn {k} have an echo: of another recording?"
            raise InputError(message)


@dataclass(frozen=True, slots=True)
class GivenLabels:
    """Labels that the points bring along."""

    @property
    def told(self) -> str:
        return "labels of the points themselves"

    def label(self, k: int, frame: Frame, points: Points) -> IntArray:
        label = points.truth_label
        if label is None:
            raise InputError(f"scan {k}: points without labels")
        return np.where(label >= 0, label, NOISE)


@dataclass(frozen=True, slots=True)
class HullLabels:
    """Points within the hull of a true object, grown by what radar and reports blur. All others are UNKNOWN: they
    may be land, a vessel that reports nothing, or clutter.
    """

    margin_m: float  # around every hull: error of the reported position
    radius_m: float  # of an object of unknown size
    beam_rad: float  # width of the antenna's beam, 0 = that of a spoke
    pulse_m: float
    moving_only: bool = False  # objects at rest are UNKNOWN as well: what lies at a quay is not told from it

    @property
    def told(self) -> str:
        beam = f"the beam of {math.degrees(self.beam_rad):.2f} deg" if self.beam_rad else "a spoke (beam unknown)"
        which = f"objects under way (from {UNDER_WAY_MPS:g} m/s)" if self.moving_only else "all objects"
        return (
            f"positions and hulls of {which}, grown by {self.margin_m:g} m, the cell and {beam}; {self.radius_m:g} m "
            "where the size is unknown; all other points may be land, vessels without reports or clutter: their pairs "
            "do not count, and nothing is said of clusters of noise"
        )

    def label(self, k: int, frame: Frame, points: Points) -> IntArray:
        if frame.truth is None or len(frame.truth) == 0 or len(points) == 0:
            return np.full(len(points), UNKNOWN)
        relative = self._relative(frame.truth, points)
        nearest = relative.argmin(axis=0)
        counts = (relative[nearest, np.arange(len(points))] <= 1.0) & self._counts(frame.truth)[nearest]
        return np.where(counts, nearest, UNKNOWN)

    def _counts(self, truth: Truth) -> BoolArray:
        under_way = np.hypot(*truth.velocity_mps.T) >= UNDER_WAY_MPS  # not where the velocity is unknown
        return under_way if self.moving_only else np.ones(len(truth), bool)

    def _relative(self, truth: Truth, points: Points) -> FloatArray:
        """How far out points (n,) lie of each object, (t, n); up to 1 is within.

        A hull blurred by a box along and across the beam is the sum of two rectangles: what lies within the width of
        it along all four of their axes.
        """
        velocity = np.where(np.isfinite(truth.velocity_mps), truth.velocity_mps, 0.0)
        since_s = (points.t_ns - truth.t_ns) * 1e-9
        centre = truth.position_m[:, None] + velocity[:, None] * since_s[None, :, None]
        offset = points.position_m[None] - centre  # (t, n, 2)
        blur_range = points.range_width_m / 2 + self.pulse_m / 2 + self.margin_m
        beam = np.maximum(points.azimuth_width_rad, self.beam_rad)
        blur_across = points.range_m * (beam + points.azimuth_width_rad) / 2 + self.margin_m
        range_axis, across_axis = _axes(np.broadcast_to(points.azimuth_rad, offset.shape[:2]))
        length, width, heading = self._hulls(truth)
        of_hull = np.where(np.isnan(heading)[:, None], points.azimuth_rad[None], heading[:, None])
        along_axis, abeam_axis = _axes(of_hull)
        outer = np.zeros(offset.shape[:2])
        for axis in (range_axis, across_axis, along_axis, abeam_axis):
            hull = length[:, None] / 2 * _dot(axis, along_axis) + width[:, None] / 2 * _dot(axis, abeam_axis)
            half = hull + blur_range * _dot(axis, range_axis) + blur_across * _dot(axis, across_axis)
            outer = np.maximum(outer, _dot(offset, axis) / half)
        return outer

    def _hulls(self, truth: Truth) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Length, width and heading (t,); without a heading a square, the heading nan."""
        speed = np.hypot(*truth.velocity_mps.T)
        course = np.where(speed > 1.0, np.arctan2(truth.velocity_mps[:, 0], truth.velocity_mps[:, 1]), np.nan)
        heading = np.where(np.isfinite(truth.heading_rad), truth.heading_rad, course)
        sized = np.isfinite(truth.length_m) & np.isfinite(truth.width_m) & (truth.length_m > 0)
        length = np.where(sized, truth.length_m, 2 * self.radius_m)
        turned = sized & np.isfinite(heading)
        return length, np.where(turned, truth.width_m, length), np.where(turned, heading, np.nan)


def _axes(azimuth_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors (..., 2) along azimuths (...) and to the right of them."""
    s, c = np.sin(azimuth_rad), np.cos(azimuth_rad)
    return np.stack([s, c], axis=-1), np.stack([c, -s], axis=-1)


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.abs(np.einsum("tnd,tnd->tn", a, b)))
