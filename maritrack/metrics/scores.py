"""Scores of a frame, and running sums over frames that do not grow with the length of the recording.

A track refers to its own time, so a truth object is moved there by its velocity before the two are
compared. Nothing here changes an argument: sums go in, new sums come out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from maritrack.metrics.gospa import gospa_from_distances
from maritrack.metrics.iou import has_outline, has_shape, pair_ious
from maritrack.metrics.ospa import ospa_from_distances
from maritrack.types import BoolArray, FloatArray, Tracks, Truth

KEYS = (
    "ospa", "ospa_localisation", "ospa_cardinality", "gospa", "gospa_localisation", "gospa_missed", "gospa_false",
    "n_truth", "n_tracks",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Hold:
    """How long, and by which tracks, a truth object was held."""

    id: str
    name: str = ""
    frames: int = 0  # in which it was present
    held: int = 0  # of these, with a track within the limit
    assigned: int = 0  # of these, with a track of its own
    switches: int = 0  # the assigned track was another one than the last time
    breaks: int = 0  # held before, not held now
    track: int = -1  # id of the track that held it last, -1 = none yet
    holding: bool = False  # in its last frame
    by: Mapping[int, int] = field(default_factory=dict)  # frames held by track id
    near: Mapping[int, int] = field(default_factory=dict)  # frames within the limit of track id, assigned or not
    squared_m2: float = 0.0  # sum of squared distances while held


@dataclass(frozen=True, slots=True, eq=False)
class ScoreSums:
    """Sums over frames; start with ScoreSums()."""

    total: Mapping[str, float] = field(default_factory=dict)
    count: Mapping[str, int] = field(default_factory=dict)  # frames in which the score was not nan
    objects: Mapping[str, Hold] = field(default_factory=dict)  # by truth id


def truth_distances(truth: Truth, tracks: Tracks, *, velocity: bool = False) -> FloatArray:
    """Distances (n, t) in metres between truth, moved to each track's own time, and tracks.

    A truth object of unknown velocity stays where it is. Up counts where both have it. With `velocity` the difference
    of the velocities is a part of the distance, a metre a second as much as a metre (extended, sec. 4.3); of those
    of unknown velocity it is not.
    """
    told = np.asarray(np.isfinite(truth.velocity_mps).all(axis=1, keepdims=True))
    v = np.where(told, truth.velocity_mps, 0.0)
    dt_s = (tracks.t_ns - truth.t_ns) * 1e-9
    moved = truth.position_m[:, None] + v[:, None] * dt_s[None, :, None]
    gap = moved - tracks.position_m[None]
    if truth.up_m is not None and truth.vel_up_mps is not None and tracks.up_m is not None:
        climb = np.where(np.isfinite(truth.vel_up_mps), truth.vel_up_mps, 0.0)
        above = truth.up_m[:, None] + climb[:, None] * dt_s[None, :] - tracks.up_m[None]
        gap = np.concatenate([gap, above[..., None]], axis=2)
    if velocity:
        gap = np.concatenate([gap, told[:, None] * (v[:, None] - tracks.velocity_mps[None])], axis=2)
    return np.asarray(np.linalg.norm(gap, axis=2), dtype=np.float64)


def score_frame(
    truth: Truth | None,
    tracks: Tracks,
    *,
    which: BoolArray,
    c_m: float,
    p: float,
    covered: BoolArray | None = None,
    unexplained: bool = False,
    velocity: bool = False,
    bow_share: float = 0.25,
) -> dict[str, float]:
    """Scores of one frame by name (KEYS), nan all but n_tracks where there is no truth.

    Only tracks `which` (t,) and truth objects `covered` (n,) count. gospa_localisation is a p-th
    power, gospa_missed and gospa_false are counts; where truth is known to be incomplete
    (`unexplained`) the latter is named gospa_unexplained. `iou`, of the pairs of GOSPA in the mean, is there where
    ships have outlines, with a bow over `bow_share` of their length, and tracks draw something; nan where no pair has.
    With `velocity` distances are of position and velocity together.
    """
    names = [("gospa_unexplained" if unexplained and k == "gospa_false" else k) for k in KEYS]
    if truth is None:
        return dict.fromkeys(names, math.nan) | {"n_tracks": float(np.count_nonzero(which))}
    rows, cols = np.arange(len(truth)) if covered is None else np.flatnonzero(covered), np.flatnonzero(which)
    D = truth_distances(truth, tracks, velocity=velocity)[np.ix_(rows, cols)]
    o, g = ospa_from_distances(D, c=c_m, p=p), gospa_from_distances(D, c=c_m, p=p)
    distance = (o.total, o.localisation, o.cardinality, g.total, g.localisation_p)
    values = (*distance, g.n_missed, g.n_false, *D.shape)
    scores = {name: float(value) for name, value in zip(names, values, strict=True)}
    if has_outline(truth)[rows].any() and has_shape(tracks)[cols].any():
        ious = pair_ious(
            truth, tracks, np.stack([rows[g.pairs[:, 0]], cols[g.pairs[:, 1]]], axis=1), bow_share=bow_share
        )
        known = np.isfinite(ious)
        scores["iou"] = float(ious[known].mean()) if known.any() else math.nan
    return scores


def add(sums: ScoreSums, scores: Mapping[str, float]) -> ScoreSums:
    """Sums with one more frame; nan counts as absent."""
    total, count = dict(sums.total), dict(sums.count)
    for name, value in scores.items():
        known = not math.isnan(value)
        total[name] = total.get(name, 0.0) + (value if known else 0.0)
        count[name] = count.get(name, 0) + known
    return replace(sums, total=total, count=count)


def means(sums: ScoreSums) -> dict[str, float]:
    """Mean of each score over the frames that have it, nan where none has."""
    return {name: sums.total[name] / n if n else math.nan for name, n in sums.count.items()}


def hold(
    sums: ScoreSums,
    truth: Truth | None,
    tracks: Tracks,
    *,
    which: BoolArray,
    hold_m: float,
    covered: BoolArray | None = None,
) -> ScoreSums:
    """Sums with one more frame of who holds whom: one track, not farther than hold_m, for each truth object.

    As many as possible are held; a pair of the last frame stays a pair as long as it can, so that
    a switch is the tracker's and not the assignment's. Then the distances decide.
    """
    if truth is None:
        return sums
    rows = np.arange(len(truth)) if covered is None else np.flatnonzero(covered)
    cols = np.flatnonzero(which)
    before = [sums.objects.get(truth.id[j], Hold(truth.id[j])) for j in rows.tolist()]
    D = truth_distances(truth, tracks)[np.ix_(rows, cols)]
    stays = np.array([h.track if h.holding else -1 for h in before], dtype=np.int64)[:, None] == tracks.id[cols]
    partner = _partners(D / hold_m, stays)
    objects = dict(sums.objects)
    for row, (j, h) in enumerate(zip(rows.tolist(), before, strict=True)):
        close = tracks.id[cols[D[row] <= hold_m]].tolist()
        near = {**h.near, **{i: h.near.get(i, 0) + 1 for i in close}} if close else h.near
        seen = replace(h, name=truth.name[j] or h.name, frames=h.frames + 1, held=h.held + bool(close), near=near)
        if partner[row] < 0:
            objects[h.id] = replace(seen, holding=False, breaks=h.breaks + h.holding)
        else:
            objects[h.id] = _held(seen, int(tracks.id[cols[partner[row]]]), float(D[row, partner[row]]))
    return replace(sums, objects=objects)


def _partners(relative: FloatArray, stays: BoolArray) -> list[int]:
    """Column of each row of distances (n, m) in units of the limit, -1 = none within it."""
    within = relative <= 1.0
    many = min(relative.shape) + 1.0  # worth more than all distances together
    worth = np.where(within, many + many**2 * stays - relative, 0.0)
    partner = [-1] * len(relative)
    for row, col in zip(*linear_sum_assignment(worth, maximize=True), strict=True):
        if within[row, col]:
            partner[row] = int(col)
    return partner


def _held(h: Hold, track: int, distance_m: float) -> Hold:
    return replace(
        h,
        assigned=h.assigned + 1,
        switches=h.switches + (h.track not in {-1, track}),
        track=track,
        holding=True,
        by={**h.by, track: h.by.get(track, 0) + 1},
        squared_m2=h.squared_m2 + distance_m**2,
    )


def summary_objects(sums: ScoreSums) -> list[dict[str, Any]]:
    """One row for each truth object, by id; held_by_one is the share of frames in which one and the same track
    was within the limit, `held` counts those with any. Two objects side by side may share a track; `assigned`
    counts those with a track of its own.
    """
    return [
        {
            "id": h.id,
            "name": h.name,
            "frames": h.frames,
            "held": h.held,
            "held_share": h.held / h.frames,
            "assigned": h.assigned,
            "held_by_one": max(h.near.values(), default=0) / h.frames,
            "ids": len(h.by),
            "switches": h.switches,
            "breaks": h.breaks,
            "rms_m": math.sqrt(h.squared_m2 / h.assigned) if h.assigned else math.nan,
        }
        for h in sorted(sums.objects.values(), key=lambda h: h.id)
    ]
