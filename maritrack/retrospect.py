"""Tracks in hindsight: every row of a run's tracks smoothed with what came after it, and each track judged whole.

A causal tracker must say at once whether a track is true and whether it moves. Afterwards both are told by all of
its life: a track is true when it was confirmed and was hit often enough, and then it counts from its first hit to
its last; it moves when it made good more way than its own length and had way on for half of its life.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace

import numpy as np

from maritrack.objects import giw, matrix2
from maritrack.objects.giw import Giw
from maritrack.settings import Config
from maritrack.tracksettings import ModelConfig, SmoothConfig
from maritrack.types import COASTED, CONFIRMED, STATIONARY, BoolArray, FloatArray, IntArray, Tracks, take

DIRECTIONS = 16  # in which the way of a track is measured: the greatest distance within half a percent


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """Tracks of all scans, one row a track and scan, ordered by id, then scan."""

    scan: IntArray  # (m,)
    tracks: Tracks  # m rows

    def __len__(self) -> int:
        return len(self.scan)

    def rows(self, index: IntArray | BoolArray) -> History:
        """The rows `index`, in that order."""
        return History(self.scan[index], _rows(self.tracks, np.arange(len(self))[index]))

    def by_scan(self) -> dict[int, Tracks]:
        """The tracks of each scan that has any, ordered by id."""
        order = np.argsort(self.scan, kind="stable")
        numbers, first = np.unique(self.scan[order], return_index=True)
        parts = np.split(order, first[1:])
        return {k: _rows(self.tracks, rows) for k, rows in zip(numbers.tolist(), parts, strict=False)}


_NONE = Tracks(
    np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 4, 4)),
    np.zeros((0, 2, 2)), np.zeros(0), np.zeros(0, np.int64), np.zeros(0, bool), np.zeros(0, np.int64), (), np.zeros(0),
)  # fmt: skip


def gather(scans: Iterable[tuple[int, Tracks]]) -> History:
    """The history of a run from the number and the tracks of each scan."""
    numbers, parts = [], []
    for k, tracks in scans:
        numbers.append(np.full(len(tracks), k, np.int64))
        unknown = np.full(len(tracks), np.nan)
        known = unknown if tracks.extent_dof is None else tracks.extent_dof
        parts.append(replace(tracks, extent_dof=known, up_m=None, vel_up_mps=None))  # hindsight is of the plane
    if not parts:
        return History(np.zeros(0, np.int64), _NONE)
    names = [f.name for f in fields(Tracks) if f.name not in ("contour_m", "up_m", "vel_up_mps")]
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    contours = tuple(contour for part in parts for contour in part.contour_m)
    scan, tracks = np.concatenate(numbers), Tracks(**columns, contour_m=contours)
    return History(scan, tracks).rows(np.lexsort((scan, tracks.id)))


def hindsight(history: History, config: Config) -> History:
    """The tracks that were true, from first hit to last, smoothed, and judged to move over all of their lives."""
    lived = between_hits(smoothed(history, config.model))
    if len(lived) == 0:
        return lived
    true, moving = judged(lived, config.smooth)
    status = np.where(lived.tracks.cluster >= 0, CONFIRMED, COASTED)
    status = np.where(lived.tracks.status == STATIONARY, STATIONARY, status)
    return replace(lived, tracks=replace(lived.tracks, status=status, moving=moving)).rows(true)


def smoothed(history: History, model: ModelConfig) -> History:
    """Each row with the use of all later rows of its track; the last row of a track stays what the filter said.

    Extents stay as filtered where the tracker has no degrees of freedom for them; contours move with the position.
    Existence is that of the two-state chain: what exists later existed before.
    """
    tracks, n = history.tracks, len(history)
    if n == 0:
        return history
    last = np.append(np.diff(tracks.id) != 0, True)
    x = np.concatenate([tracks.position_m, tracks.velocity_mps], axis=1)
    dof = np.zeros(n) if tracks.extent_dof is None else tracks.extent_dof
    known = np.isfinite(dof)
    d = Giw(x, tracks.cov.copy(), tracks.extent_m2.copy(), np.where(known, dof, 3.0))
    r, dt_s = tracks.existence.copy(), np.append(np.diff(tracks.t_ns), 0).clip(0) * 1e-9
    by_scan = np.argsort(history.scan, kind="stable")
    starts = np.flatnonzero(np.append(True, np.diff(history.scan[by_scan]) > 0))
    for rows in reversed(np.split(by_scan, starts[1:])):
        i = rows[~last[rows]]
        step = giw.smooth(_density(d, i), _density(d, i + 1), dt_s[i], model)
        d.x[i], d.P[i], d.X[i], d.alpha[i] = step.x, step.P, step.X, step.alpha
        r[i] = smooth_existence(r[i], r[i + 1], model.p_survive ** dt_s[i])
    moved = d.x[:, :2] - tracks.position_m
    return replace(
        history,
        tracks=replace(
            tracks, position_m=d.x[:, :2], velocity_mps=d.x[:, 2:], cov=d.P, existence=r,
            extent_m2=np.where(known[:, None, None], d.X, tracks.extent_m2),
            extent_dof=np.where(known, d.alpha, np.nan),
            contour_m=tuple(contour + step for contour, step in zip(tracks.contour_m, moved, strict=False)),
        ),
    )  # fmt: skip


def smooth_existence(r: FloatArray, later: FloatArray, p_survive: FloatArray) -> FloatArray:
    """Existence (n,) given all: r now, smoothed `later`, and the probability to survive until then.

    What does not exist later either ended in between, or did not exist before.
    """
    gone = 1.0 - p_survive * r
    ended = np.divide(r * (1.0 - p_survive), gone, out=np.zeros_like(r), where=gone > 0)
    return np.asarray(later + (1.0 - later) * ended)


def between_hits(history: History) -> History:
    """The rows of each track from its first hit to its last; none of a track without a hit."""
    hit = history.tracks.cluster >= 0
    first, group = _groups(history.tracks.id)
    so_far = np.cumsum(hit)
    since: IntArray = so_far - (so_far - hit)[first][group]  # hits of the same track up to here
    left = np.add.reduceat(hit.astype(np.int64), first)[group] - since if len(first) else since
    return history.rows((since > 0) & ((left > 0) | hit))


def judged(history: History, rules: SmoothConfig) -> tuple[BoolArray, BoolArray]:
    """Whether the track of each row (m,) is true, and whether it moves."""
    tracks = history.tracks
    first, group = _groups(tracks.id)
    hits = np.add.reduceat((tracks.cluster >= 0).astype(np.int64), first)
    confirmed = np.logical_or.reduceat(tracks.status >= CONFIRMED, first)
    length_m = median(2.0 * np.sqrt(np.maximum(matrix2.eigen(tracks.extent_m2)[0][:, 0], 0.0)), first, group)
    speed_mps = median(np.hypot(tracks.velocity_mps[:, 0], tracks.velocity_mps[:, 1]), first, group)
    way = greatest_distance(tracks.position_m, first)
    true = confirmed & (hits >= rules.min_hits)
    moving = (
        (speed_mps > rules.moving_speed_mps)
        & (way > rules.moving_displacement_m + rules.moving_lengths * length_m)
        & (length_m <= rules.moving_length_max_m)
    )
    return true[group], (true & moving)[group]


def greatest_distance(position_m: FloatArray, first: IntArray) -> FloatArray:
    """Greatest distance between two places of each track (g,), of rows (m, 2) that begin at `first` (g,)."""
    angle = np.arange(DIRECTIONS) * math.pi / DIRECTIONS
    along = position_m @ np.stack([np.sin(angle), np.cos(angle)])
    return np.asarray((np.maximum.reduceat(along, first) - np.minimum.reduceat(along, first)).max(axis=1))


def median(value: FloatArray, first: IntArray, group: IntArray) -> FloatArray:
    """Median (g,) of the values (m,) of each group; its rows begin at `first` (g,)."""
    ordered = value[np.lexsort((value, group))]
    count = np.diff(np.append(first, len(value)))
    return np.asarray((ordered[first + (count - 1) // 2] + ordered[first + count // 2]) / 2)


def _groups(id_: IntArray) -> tuple[IntArray, IntArray]:
    """Where the rows of each id begin (g,), and the number of its group for each row (m,); ids are ordered."""
    begins = np.append(True, np.diff(id_) != 0)[: len(id_)]
    return np.flatnonzero(begins), np.cumsum(begins) - 1


def _density(d: Giw, i: IntArray) -> Giw:
    return Giw(d.x[i], d.P[i], d.X[i], d.alpha[i])


def _rows(tracks: Tracks, index: IntArray) -> Tracks:
    contours = tuple(tracks.contour_m[i] for i in index.tolist()) if tracks.contour_m else ()
    return replace(take(tracks, index), contour_m=contours)
