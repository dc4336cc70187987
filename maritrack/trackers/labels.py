"""Tracks out of an intensity: what is found in it under a label is that label's track, with its past."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maritrack.objects.giw import Giw
from maritrack.settings import Config
from maritrack.trackers import intensity, stationary, tracklist
from maritrack.trackers.berths import Berths
from maritrack.trackers.intensity import Intensity, IntensityState
from maritrack.trackers.tracklist import TrackList
from maritrack.types import COASTED, CONFIRMED, TENTATIVE, BoolArray, FloatArray, IntArray, Tracks


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Objects and what may become one, each label once."""

    label: IntArray  # (e,)
    x: FloatArray  # (e, 2 axes)
    P: FloatArray  # (e, 2 axes, 2 axes)
    w: FloatArray  # (e,) objects expected here
    cluster: IntArray  # (e,) the cluster that most of it was updated with, -1 = it was missed


def unique_labels(label: IntArray, w: FloatArray, next_label: int) -> tuple[IntArray, int]:
    """Labels (n,) that are all different, and the next free one: the heaviest keeps it, others get new ones.

    Of equal weights the first keeps it.
    """
    order = np.lexsort((np.arange(len(w)), -w, label))
    ranked = label[order]
    again = np.zeros(len(label), bool)
    again[order[1:]] = ranked[1:] == ranked[:-1]
    fresh = label.copy()
    fresh[again] = next_label + np.arange(np.count_nonzero(again))
    return fresh, next_label + int(np.count_nonzero(again))


def followed(
    state: IntensityState, found: Found, berths: Berths, t_ns: int, dt_s: float, sensor: str, next_label: int,
    config: Config,
) -> tuple[TrackList, Intensity, IntArray]:  # fmt: skip
    """The list of tracks with one more scan, ordered by label, the same with all axes, scans unreported (t,).

    A label that is new begins; one that is not found any more has ended. `confirmed` rows have been reported once.
    Those that are held at their berths keep their misses.
    """
    before, held = state.tracks, berths.held
    all_ = intensity.join(Intensity(found.x, found.P, found.w, found.label), intensity.join(berths.left, held))
    order = np.argsort(all_.label)
    whole = intensity.rows(all_, order)
    label, x, P = whole.label, whole.x, whole.P
    cluster = np.concatenate([found.cluster, berths.cluster, np.full(len(held), -1)])[order]
    rests = np.isin(label, held.label)
    n, axes = len(label), x.shape[1] // 2
    level = [0, 1, axes, axes + 1]
    at = np.minimum(np.searchsorted(before.id, label), max(len(before) - 1, 0))
    known = before.id[at] == label if len(before) else np.zeros(n, bool)

    def past(values: NDArray[Any], other: float) -> NDArray[Any]:
        begun = np.full((n, *values.shape[1:]), other, values.dtype)
        begun[known] = values[at[known]]
        return begun

    density = Giw(x[:, level], P[np.ix_(range(n), level, level)], np.zeros((n, 2, 2)), np.full(n, 3.0))
    lag_m = np.where(known[:, None], past(before.lag_m, 0.0), x[:, :2])
    now = replace(
        before, density=density, t_ns=np.full(n, t_ns), existence=whole.w, id=label, hits=past(before.hits, 0),
        misses=past(before.misses, 0), confirmed=past(before.confirmed, False), lag_m=lag_m,
        moving=past(before.moving, False), settled=past(before.settled, 0.0), cluster=cluster,
        told=past(before.told, tracklist.NOTHING), next_id=next_label,
        held_s=np.where(rests, past(before.held_s, 0.0) + max(dt_s, stationary.LEAST_S), 0.0),
    )  # fmt: skip
    now = tracklist.count(now, cluster >= 0, sensor)
    now = replace(now, misses=np.where(rests, past(before.misses, 0), now.misses))
    now = replace(now, confirmed=now.confirmed | reported(now, config))
    now = tracklist.follow(now, np.where(known, dt_s, 0.0), config.tracker)
    return now, whole, np.where(reported(now, config), 0, past(state.unreported, 0) + 1)


def reported(tracks: TrackList, config: Config) -> BoolArray:
    """Tracks (t,) that stand for an object now."""
    rules = config.intensity
    return np.asarray((tracks.existence > rules.extract_weight) & (tracks.hits >= rules.extract_hits))


def estimate(state: IntensityState, config: Config) -> Tracks:
    """All that is found, at the time of the intensity; heavier than `intensity.extract_weight` is confirmed."""
    tracks, rules = state.tracks, config.intensity
    late = tracks.confirmed & (state.unreported <= rules.hold_scans)
    status = np.where(reported(tracks, config), CONFIRMED, np.where(late, COASTED, TENTATIVE))
    told = replace(stationary.told(tracks, status, config.tracker), extent_dof=None)
    if config.intensity.measurement != "range-azimuth-elevation":
        return told
    return replace(told, up_m=state.found.x[:, 2].copy(), vel_up_mps=state.found.x[:, 5].copy())
