"""Ensemble Gaussian mixture PHD filter: particles become Gaussians by kernels, are updated, and drawn anew.

Durant, Zanetti 2025 (paper `engm`). With one object that is always seen, no birth, no death and no clutter it is the
ensemble Gaussian mixture filter: the weights are normalised likelihoods, the update that of a Gaussian sum, and the
kernels have the bandwidth of one object (theorem 3.1).   Eq: engm-28, engm-30, engm-31, engm-32, engm-33, engm-34,
engm-35, engm-36, engm-37, engm-38
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from maritrack.settings import Config
from maritrack.trackers import intensity, kernels, links, particles
from maritrack.trackers.intensity import Intensity, IntensityState
from maritrack.trackers.particle_phd import ParticlePhd
from maritrack.trackers.particles import Drawn
from maritrack.trackers.readings import Readings
from maritrack.types import Points, Scan


def tracker(config: Config) -> ParticlePhd:
    """Particles move, become a mixture with the births, which is updated; particles are drawn from it."""
    return ParticlePhd(config, predicted, updated)


def predicted(state: IntensityState, born: Intensity, dt_s: float, config: Config) -> Intensity:
    """The prior as a mixture with a kernel for each particle.   Eq: engm-2, engm-10

    Global: survivors and births are drawn anew from both (algorithm 2). Local: births are groups of their own.
    """
    old = intensity.moved(replace(state.intensity, P=np.zeros_like(state.intensity.P)), dt_s, config)
    Q = old.P  # zero moved on: the noise alone
    rng = intensity.draws(config, state.k, intensity.MIX)
    survivors = smoothed(old, config)
    survivors = replace(survivors, P=survivors.P + Q)
    if config.intensity.bandwidth == "local":
        return intensity.join(survivors, smoothed(particles.born_particles(born, config, rng), config))
    if len(born) == 0:
        return survivors
    return uniform(survivors, born, config, rng)


def smoothed(d: Intensity, config: Config) -> Intensity:
    """Particles as kernels: `intensity.shrink` keeps their covariance as a whole."""
    if len(d) == 0:
        return d
    group, n_groups = particles.grouped(d.label, config)
    x, K = kernels.kernels(d.x, d.w, group, n_groups, shrink=config.intensity.shrink)
    return replace(d, x=x, P=K[group])


def uniform(survivors: Intensity, born: Intensity, config: Config, rng: np.random.Generator) -> Intensity:
    """Algorithm 2: samples of survivors and births as one mixture, all of one weight, made a mixture again.

    Eq: engm-23, engm-24, engm-25, engm-26, engm-27
    """
    both = intensity.join(survivors, born)
    n, W = config.intensity.components + len(born), both.w.sum()
    row = kernels.draw(both.w, np.zeros(len(both), np.int64), np.array([n]), rng)
    x = kernels.gaussian(both.x[row], both.P[row], rng)
    even = Intensity(x, np.zeros((n, *both.P.shape[1:])), np.full(n, W / n), both.label[row])
    return smoothed(even, config)


def updated(prior: Intensity, seen: Readings, scan: Scan, points: Points, t_ns: int, k: int, config: Config) -> Drawn:
    """The mixture updated, and particles drawn from it (algorithm 1).   Eq: engm-14"""
    seen_by = particles.weighed(prior, seen, scan, points, t_ns, config, gaussian=True)
    i, j = seen_by.pairs.i, seen_by.pairs.j
    own = np.concatenate([i, np.arange(len(prior))])  # a row for each pair, then the components as they were
    cluster = np.concatenate([seen.cluster[j], np.full(len(prior), -1, np.int64)])
    w, rng = np.concatenate([seen_by.hit, seen_by.left]), intensity.draws(config, k, intensity.RESAMPLE)
    row, weight, group = particles.redrawn(w, seen_by.group[own], cluster, config, rng)
    hit = row < len(i)
    x, P = prior.x[own[row]], prior.P[own[row]]
    x[hit], P[hit] = links.update(prior.x, prior.P, seen_by.pairs, row[hit], seen.R)
    d = Intensity(kernels.gaussian(x, P, rng), np.zeros_like(P), weight, prior.label[own[row]])
    return Drawn(d, cluster[row], group, seen_by.unexplained)
