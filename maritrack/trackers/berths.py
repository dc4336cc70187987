"""Objects of an intensity that the background has taken: Gaussians at their berths, beside the intensity.

They are the same for `gm-phd`, `smc-phd` and `engm-phd`, and take what the intensity leaves of the measurements.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from maritrack.settings import Config
from maritrack.trackers import intensity, links, stationary
from maritrack.trackers.intensity import Intensity, IntensityState
from maritrack.trackers.readings import Readings
from maritrack.types import BoolArray, FloatArray, IntArray, Points, Scan


@dataclass(frozen=True, slots=True, eq=False)
class Berths:
    """What became of those that were held, and of those that are from now on."""

    held: Intensity  # as they lie
    left: Intensity  # seen, or not covered any more: they join the intensity in the next scan
    cluster: IntArray  # (l,) of those that left, -1 = not seen
    unexplained: FloatArray  # (m,) share of each measurement that clutter has


def step(
    state: IntensityState, d: Intensity, cluster: IntArray, seen: Readings, unexplained: FloatArray, scan: Scan,
    points: Points, clock: tuple[int, float, bool], config: Config,
) -> tuple[BoolArray, Berths]:  # fmt: skip
    """Which rows of a posterior (n,), updated with `cluster` (n,), stay in it; the berths after the scan.

    A track is taken with all that has its label, and is seen again where it has most of a measurement that is
    none of the clutter.
    """
    held_s, nobody = state.tracks.held_s, intensity.rows(d, slice(0))
    lasts = held_s + max(clock[1], stationary.LEAST_S) <= config.tracker.stationary_s
    known = np.flatnonzero((held_s > 0) & lasts)
    if scan.covered is None and not held_s.any():
        return np.ones(len(d), bool), Berths(nobody, nobody, cluster[:0], unexplained)
    hidden = stationary.hidden(state.tracks, scan, config)
    taken, of = _taken(state, d, cluster, np.where(lasts, hidden, 0.0), config)
    held = intensity.rows(state.found, known)
    left, now, free, stays = _seen(held, hidden[known], seen, unexplained, scan, points, clock, config)
    rows = np.sort(np.concatenate([np.flatnonzero(taken), known[stays]]))
    held, pixel_m = intensity.rows(state.found, rows), 0.0 if scan.covered is None else scan.covered.pixel_m
    x, P = stationary.lying(held.x, held.P, held_s[rows] > 0, pixel_m)
    held = replace(held, x=x, P=P, w=np.minimum(held.w, 1.0))
    return ~np.append(taken, False)[of], Berths(held, left, now, free)


def _taken(
    state: IntensityState, d: Intensity, cluster: IntArray, hidden: FloatArray, config: Config
) -> tuple[BoolArray, IntArray]:
    """Tracks (t,) that the background takes from a posterior, and the track of each of its rows (n,), t = of none."""
    tracks, n = state.tracks, len(state.tracks)
    names = np.append(tracks.id, np.iinfo(np.int64).max)
    of = np.searchsorted(names, d.label)
    of[names[of] != d.label] = n
    hit = np.bincount(of, d.w * (cluster >= 0), n + 1)[:n] > 0.5
    there = np.bincount(of, minlength=n + 1)[:n] > 0
    taken = stationary.takes(tracks, hit, hidden, config.tracker) & there
    return taken & (tracks.existence >= config.tracker.delete_existence), of


def _seen(
    held: Intensity, hidden: FloatArray, seen: Readings, unexplained: FloatArray, scan: Scan, points: Points,
    clock: tuple[int, float, bool], config: Config,
) -> tuple[Intensity, IntArray, FloatArray, BoolArray]:  # fmt: skip
    """Those that leave their berths and their clusters, what is left of the measurements (m,), who stays (h,).

    Each may have left since at any speed, where a gap doesn't let it be anywhere. It is updated with the one
    measurement that it wins.
    """
    t_ns, dt_s, _ = clock
    axes, limit2 = held.x.shape[1] // 2, config.tracker.delete_sigma_m**2
    loose = held.P.copy()
    loose[:, axes:, axes:] += config.model.sigma_velocity_mps**2 * np.eye(axes)
    ahead = replace(intensity.moved(replace(held, P=loose), dt_s, config), w=held.w)
    lost = np.maximum(ahead.P[:, 0, 0], ahead.P[:, 1, 1]) > limit2
    ahead = replace(ahead, P=np.where(lost[:, None, None], loose, ahead.P))
    left_over = replace(seen, log_kappa=seen.log_kappa - np.log(np.maximum(unexplained, np.finfo(float).tiny)))
    p_detect, pairs, log_w, free = links.weighed(ahead, left_over, scan, points, t_ns, config)
    best = stationary.winners(pairs.i, pairs.j, log_w, 1.0 - free)
    x, P = links.update(ahead.x, ahead.P, pairs, best, seen.R)
    hit = np.isin(np.arange(len(held)), pairs.i[best])
    stays = ~hit & ((hidden >= 0.5) | (p_detect == 0.0))
    gone = ~hit & ~stays
    missed = replace(ahead, w=intensity.missed(held.w, p_detect, config))
    updated = Intensity(x, P, 1.0 - free[pairs.j[best]], held.label[hit])
    left = intensity.join(updated, intensity.rows(missed, gone))
    now = np.concatenate([seen.cluster[pairs.j[best]], np.full(np.count_nonzero(gone), -1)])
    return left, now, unexplained * free, stays
