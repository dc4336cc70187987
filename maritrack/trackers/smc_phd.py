"""Sequential Monte Carlo PHD filter: Vo, Singh, Doucet 2005, as in the engm paper.

Particles carry labels, which stay through resampling.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from maritrack.settings import Config
from maritrack.trackers import intensity, particles
from maritrack.trackers.intensity import Intensity, IntensityState
from maritrack.trackers.particle_phd import ParticlePhd
from maritrack.trackers.particles import Drawn
from maritrack.trackers.readings import Readings
from maritrack.types import FloatArray, IntArray, Points, Scan


def tracker(config: Config) -> ParticlePhd:
    """Particles move, are weighed by all measurements and drawn anew."""
    return ParticlePhd(config, predicted, updated)


def predicted(state: IntensityState, born: Intensity, dt_s: float, config: Config) -> Intensity:
    """Particles of the prior: those that survive, each with noise of its own, and the new ones.   Eq: engm-7"""
    axes = state.intensity.x.shape[1] // 2
    old = intensity.moved(state.intensity, dt_s, config)
    Q = intensity.noise_of(dt_s, axes, config)
    if dt_s > 0 and Q.any():
        noise = intensity.draws(config, state.k, intensity.NOISE).normal(size=old.x.shape)
        old = replace(old, x=old.x + noise @ np.linalg.cholesky(Q).T)
    new = particles.born_particles(born, config, intensity.draws(config, state.k, intensity.MIX))
    return intensity.join(replace(old, P=np.zeros_like(old.P)), new)


def updated(prior: Intensity, seen: Readings, scan: Scan, points: Points, t_ns: int, k: int, config: Config) -> Drawn:
    """The particles weighed and resampled.   Eq: engm-8, engm-9"""
    seen_by = particles.weighed(prior, seen, scan, points, t_ns, config, gaussian=False)
    i, j, hit = seen_by.pairs.i, seen_by.pairs.j, seen_by.hit
    rng, every = intensity.draws(config, k, intensity.RESAMPLE), np.arange(len(prior))
    if config.intensity.bandwidth == "global":
        own, w = every, seen_by.left + np.bincount(i, hit, len(prior))
        cluster = _taken(i, j, hit, w, seen)
    else:  # a row for each measurement that a particle may have been
        own, w = np.concatenate([i, every]), np.concatenate([hit, seen_by.left])
        cluster = np.concatenate([seen.cluster[j], np.full(len(prior), -1, np.int64)])
    row, weight, group = particles.redrawn(w, seen_by.group[own], cluster, config, rng)
    d = replace(intensity.rows(prior, own[row]), w=weight)
    return Drawn(d, cluster[row], group, seen_by.unexplained)


def _taken(i: IntArray, j: IntArray, hit: FloatArray, w: FloatArray, seen: Readings) -> IntArray:
    """The cluster of each particle (n,) with the most of its weight, -1 where that is of none."""
    best = np.full(len(w), -1, np.int64)
    order = np.lexsort((hit, i))
    best[i[order]] = order  # the last one written, the largest weight, stays
    lead = np.maximum(best, 0)
    if len(i) == 0:
        return best
    found = (best >= 0) & (hit[lead] > 0.5 * w)
    return np.where(found, seen.cluster[j[lead]], -1)
