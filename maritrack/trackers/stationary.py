"""Tracks that the background has taken: which they are, and how they stay as they were until they leave.

A vessel that stops becomes background, and its echoes are taken away. Every tracker keeps such a track in the same
way: `covered` says how much of it is hidden, `takes` whom the background takes, `lying` where it lies meanwhile.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from maritrack import geo
from maritrack.objects import matrix2
from maritrack.objects.giw import Giw
from maritrack.settings import Config
from maritrack.trackers import tracklist
from maritrack.trackers.tracklist import TrackList
from maritrack.tracksettings import TrackerConfig
from maritrack.types import STATIONARY, BoolArray, FloatArray, IntArray, Mask, Scan, Tracks

LEAST_S = 1e-9  # what is held has been so for longer than 0


def covered(tracks: TrackList, scan: Scan, config: Config) -> FloatArray:
    """Share of each track (t,) whose points are taken away as background: none of those that are spared."""
    return _unless_spared(tracks, covered_share(tracks, scan.covered), config)


def hidden(tracks: TrackList, scan: Scan, config: Config) -> FloatArray:
    """The same (t,) of the backgrounds of all sensors together: each sees, and hides, its own side of a vessel.

    What lies where one sensor has no sight, or hides less than half of it, is not gone when that one sees nothing.
    """
    return _unless_spared(tracks, covered_share(tracks, scan.covered, *scan.also_covered), config)


def _unless_spared(tracks: TrackList, share: FloatArray, config: Config) -> FloatArray:
    spared = tracks.confirmed & tracks.moving & (config.subtract.spare == "moving")
    return np.where(spared, 0.0, share)


def covered_share(tracks: TrackList, mask: Mask | None, *others: Mask) -> FloatArray:
    """Share of each track (t,) that lies in a background: of its centre and of the middles of its semi-axes."""
    if mask is None or len(tracks) == 0:
        return np.zeros(len(tracks))
    half_m2, major = matrix2.eigen(tracks.density.X)
    axes = np.stack([major, major[:, ::-1] * (-1.0, 1.0)], axis=1)  # (t, 2, 2) one a row
    arms = 0.5 * np.sqrt(np.maximum(half_m2, 0.0))[:, :, None] * axes
    offset = np.concatenate([np.zeros((len(tracks), 1, 2)), arms, -arms], axis=1)
    at = (tracks.density.x[:, None, :2] + offset).reshape(-1, 2)
    inside = np.logical_or.reduce([geo.in_mask(one, at) for one in (mask, *others)])
    return np.asarray(inside.reshape(len(tracks), 5).mean(axis=1))


def takes(tracks: TrackList, hit: BoolArray, share: FloatArray, rules: TrackerConfig) -> BoolArray:
    """Whom (t,) the background takes: confirmed tracks that were not `hit`, at least half of them covered."""
    return np.asarray(tracks.confirmed & ~hit & (share >= 0.5) & (rules.stationary_s > 0))


def lying(x: FloatArray, P: FloatArray, again: BoolArray, pixel_m: float) -> tuple[FloatArray, FloatArray]:
    """States (n, 2 axes), positions before velocities, and covariances of what lies where it was before a scan.

    Without velocity, and less certain by a pixel when it begins, not `again` (n,): the background hides a vessel as
    it is, and where it is to within that.
    """
    axes = x.shape[1] // 2
    still, spread = x.copy(), P.copy()
    still[:, axes:] = 0.0
    spread[:, :axes, axes:] = spread[:, axes:, :axes] = 0.0
    spread[:, :2, :2] += np.where(again, 0.0, pixel_m**2)[:, None, None] * np.eye(2)
    return still, spread


def waiting(tracks: TrackList, lost: BoolArray, t_ns: int) -> TrackList:
    """The list in which those of the `lost` (t,) that are held lie where they lay, until t_ns: others may be anywhere.

    They are as certain as they were, and held for longer by the gap; the others are not touched.
    """
    waits = lost & (tracks.held_s > 0)
    gap_s = np.where(waits, tracklist.seconds(t_ns - tracks.t_ns), 0.0)
    return replace(tracks, t_ns=np.where(waits, t_ns, tracks.t_ns), held_s=tracks.held_s + gap_s)


def hold_covered(
    tracks: TrackList, before: TrackList, hit: BoolArray, share: FloatArray, scan: Scan, rules: TrackerConfig
) -> TrackList:
    """The list after a scan where those that the background takes stay as they were.

    They keep the existence, the place and the misses of the scan before. A scan that does not look where one is held
    has a share of 1 there. What comes through of one that is held may be its way out or a flicker of the quay: it
    stays held, but moves on until a whole step has shown nothing of it. When it lies again it is less certain by a
    pixel: with several sensors once, as each would take one for what another has just seen.
    """
    mask = scan.covered
    if mask is None:
        return replace(tracks, held_s=np.zeros(len(tracks)))
    lay, several = before.held_s > 0, len(scan.also_covered) > 0
    lately = (tracks.told == tracklist.HIT) | ((tracks.misses < 2) & (before.held_s <= LEAST_S))
    seen = hit | (lay & lately)
    held, stays = takes(tracks, seen, share, rules), lay & takes(tracks, ~seen, share, rules)
    d, old = tracks.density, before.density
    still, spread = lying(old.x, old.P, lay & (several | (before.held_s > LEAST_S)), mask.pixel_m)
    rows = held[:, None]
    density = Giw(
        np.where(rows, still, d.x), np.where(rows[:, None], spread, d.P), np.where(rows[:, None], old.X, d.X),
        np.where(held, old.alpha, d.alpha),
    )  # fmt: skip
    since_s = np.maximum(tracklist.seconds(tracks.t_ns - before.t_ns), LEAST_S)
    return replace(
        tracks, density=density, existence=np.where(held, before.existence, tracks.existence),
        misses=np.where(held, before.misses, tracks.misses),
        held_s=np.where(held, before.held_s + since_s, np.where(stays, LEAST_S, 0.0)),
    )  # fmt: skip


def winners(i: IntArray, j: IntArray, log_w: FloatArray, explained: FloatArray) -> IntArray:
    """Rows of pairs (k,), one for each object i that wins a measurement j, by object.

    A measurement that is `explained` (m,) by more than half goes to the object of its heaviest pair; of several an
    object has the heaviest. Two that lie at one berth leave it one after the other, and not never.
    """
    order = np.lexsort((i, -log_w, j))
    first = order[np.unique(j[order], return_index=True)[1]]
    won = first[explained[j[first]] > 0.5]
    order = won[np.lexsort((j[won], -log_w[won], i[won]))]
    return np.asarray(order[np.unique(i[order], return_index=True)[1]])


def told(tracks: TrackList, status: IntArray, rules: TrackerConfig) -> Tracks:
    """What a list of components says to the outside, of the status (t,) each has unless the background holds it.

    A weight may be above one, an existence not.
    """
    status = np.where(tracks.confirmed & (tracks.held_s > 0), STATIONARY, status)
    shown = tracklist.estimate(tracks, rules)
    return replace(shown, status=status.astype(np.int64), existence=np.minimum(tracks.existence, 1.0))
