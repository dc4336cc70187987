"""The state that `gm-phd`, `smc-phd` and `engm-phd` share, and their prediction: survival and birth.

The intensity is a density of objects: its integral over a region is the number of objects expected there.
Eq: engm-1
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from maritrack.objects import cv, sensing
from maritrack.settings import Config
from maritrack.trackers import steps, tracklist
from maritrack.trackers.readings import Readings, places
from maritrack.trackers.tracklist import TrackList
from maritrack.types import BoolArray, Clusters, FloatArray, IntArray, Points, Scan

BIRTH, RESAMPLE, MIX, EXTRACT, NOISE = range(5)  # draws of a scan


@dataclass(frozen=True, slots=True, eq=False)
class Intensity:
    """Weighted Gaussians of one time, or particles, whose P is zero."""

    x: FloatArray  # (n, 2 axes)
    P: FloatArray  # (n, 2 axes, 2 axes)
    w: FloatArray  # (n,)
    label: IntArray  # (n,)

    def __len__(self) -> int:
        return len(self.w)


@dataclass(frozen=True, slots=True, eq=False)
class IntensityState:
    """All that survives from one scan to the next."""

    intensity: Intensity
    born: Intensity  # Gaussians that join in the next scan, under their labels where they come from a berth
    t_ns: int  # of both
    k: int  # scans so far
    tracks: TrackList  # what is reported, by label, and its past
    found: Intensity  # the same with all axes; those that are held in the background are not in the intensity
    unreported: IntArray  # (t,) scans since a track was last reported
    copies: Mapping[tuple[int, int], int] = field(default_factory=dict)  # of gm-phd, by label and number: their label


def nothing(axes: int) -> Intensity:
    """No component."""
    s = 2 * axes
    return Intensity(np.zeros((0, s)), np.zeros((0, s, s)), np.zeros(0), np.zeros(0, np.int64))


def begin(config: Config) -> IntensityState:
    """No object.   Eq: engm-42

    Deviates: engm-42 the paper begins with one component of a weight of 1e-16 "to favor births"; we with none.
    """
    none = nothing(sensing.AXES[config.intensity.measurement])
    return IntensityState(none, none, 0, 0, tracklist.empty(), none, np.zeros(0, np.int64))


def rows(d: Intensity, index: IntArray | BoolArray | slice) -> Intensity:
    """The components `index`, in that order."""
    return Intensity(d.x[index], d.P[index], d.w[index], d.label[index])


def join(a: Intensity, b: Intensity) -> Intensity:
    """All components of both."""
    both = np.concatenate
    return Intensity(both([a.x, b.x]), both([a.P, b.P]), both([a.w, b.w]), both([a.label, b.label]))


def draws(config: Config, k: int, stage: int) -> np.random.Generator:
    """The chance of a stage of scan k: the same whatever was drawn before."""
    return np.random.default_rng(np.random.SeedSequence(config.seed, spawn_key=(7, stage, k)))


def clock(state: IntensityState, scan: Scan) -> tuple[int, float, bool]:
    """Time of the intensity in this scan, the seconds to it, and whether the clock stepped back.

    It is the middle of the scan; a scan that is older moves nothing. The first scan has nothing to move.
    """
    middle_ns = (scan.t_ns + scan.t_start_ns) // 2
    if state.k == 0:
        return middle_ns, 0.0, False
    ahead_ns = middle_ns - state.t_ns
    return max(middle_ns, state.t_ns), max(ahead_ns, 0) * 1e-9, ahead_ns < 0


def moved(d: Intensity, dt_s: float, config: Config) -> Intensity:
    """The intensity dt_s later: moved on, less what does not survive.   Eq: engm-3"""
    if dt_s == 0.0:
        return d
    axes, rules = d.x.shape[1] // 2, config.intensity
    F = cv.transition(dt_s, axes)
    P = F @ d.P @ F.T + noise_of(dt_s, axes, config)
    return Intensity(d.x @ F.T, P, rules.p_survive_scan * d.w, d.label)


def noise_of(dt_s: float, axes: int, config: Config) -> FloatArray:
    """Q of a scan."""
    return cv.process_noise(
        dt_s, axes, accel_psd_m2ps3=config.model.accel_psd_m2ps3, sigma=config.intensity.sigma_process
    )


def newborn(state: IntensityState, dt_s: float, config: Config) -> Intensity:
    """Gaussians of the objects that appear in this scan, without labels (-1) where they are of the mixture.

    With `intensity.birth_draws` each has a mean that was drawn from the mixture and the covariance of the mixture,
    as in the paper, which is then twice as wide as the mixture itself.   Eq: engm-44, engm-45
    """
    rules, born = config.intensity, replace(moved(state.born, dt_s, config), w=state.born.w)
    if rules.birth == "clusters":
        return born
    x = np.array([(*one.mean_m, *one.mean_mps) for one in rules.births])
    sigma = np.array([(*one.sigma_m, *one.sigma_mps) for one in rules.births])
    w = np.array([one.weight for one in rules.births])
    if rules.birth_draws:
        rng = draws(config, state.k, BIRTH)
        which = rng.choice(len(w), rules.birth_draws, p=w / w.sum())
        x = x[which] + sigma[which] * rng.normal(size=(rules.birth_draws, x.shape[1]))
        sigma, w = sigma[which], np.full(rules.birth_draws, w.sum() / rules.birth_draws)
    P = sigma[:, :, None] ** 2 * np.eye(x.shape[1])
    return join(Intensity(x, P, w, np.full(len(w), -1, np.int64)), born)


def labelled(d: Intensity, next_label: int) -> tuple[Intensity, int]:
    """The same with a label of its own for each component that has none (-1), and the next that is free."""
    new = d.label < 0
    label = d.label.copy()
    label[new] = next_label + np.arange(np.count_nonzero(new))
    return replace(d, label=label), next_label + int(np.count_nonzero(new))


def born_at_clusters(
    tracks: TrackList, readings: Readings, unexplained: FloatArray, scan: Scan, clusters: Clusters, t_ns: int,
    config: Config,
) -> Intensity:  # fmt: skip
    """Gaussians at measurements that are explained by less than half, without labels; they join in the next scan.

    At rest, as uncertain as the measurement, velocity by model.sigma_velocity_mps, carried from the time of the
    measurement to that of the intensity, t_ns.
    """
    rules = config.intensity
    axes = sensing.AXES[rules.measurement]
    if rules.birth != "clusters":
        return nothing(axes)
    free = np.flatnonzero(unexplained > 0.5)
    if rules.birth_weight > 0:
        w = np.full(len(free), rules.birth_weight)
    else:
        lam = steps.clutter_density(tracks, clusters, scan, config)[readings.cluster[free]]
        born = config.model.p_detect * config.tracker.birth_density_per_m2
        w = born / (lam + born)
    at, R = places(readings, free)
    dt_s = ((t_ns - readings.t_ns[free]) * 1e-9)[:, None, None]
    speed = config.model.sigma_velocity_mps**2 * np.eye(axes)
    P = np.zeros((len(free), 2 * axes, 2 * axes))
    P[:, :axes, :axes] = R + dt_s**2 * speed
    P[:, :axes, axes:] = P[:, axes:, :axes] = dt_s * speed
    P[:, axes:, axes:] = speed
    return Intensity(np.concatenate([at, np.zeros_like(at)], axis=1), P, w, np.full(len(free), -1, np.int64))


def own_time(d: Intensity, scan: Scan, points: Points, t_ns: int) -> FloatArray:
    """Seconds (n,) after t_ns at which the beam passes each component."""
    if scan.t_ns == scan.t_start_ns:
        return np.full(len(d), (scan.t_ns - t_ns) * 1e-9)
    return tracklist.seconds(tracklist.beam_time(scan, points, d.x[:, :2]) - t_ns)


def shares(log_wl: FloatArray, log_kappa: FloatArray, j: IntArray) -> tuple[FloatArray, FloatArray]:
    """Log weights of updated components (k,), and the share of each measurement (m,) that clutter has.

    log_wl (k,) is log P_D w q: w_ij = P_D w_i q_ij / (kappa_j + sum_l P_D w_l q_lj).   Eq: engm-15
    """
    most = log_kappa.copy()
    np.maximum.at(most, j, log_wl)
    total = np.exp(log_kappa - most) + np.bincount(j, np.exp(log_wl - most[j]), len(most))
    log_all = most + np.log(total)
    return np.asarray(log_wl - log_all[j]), np.exp(log_kappa - log_all)


def missed(w: FloatArray, p_detect: FloatArray, config: Config) -> FloatArray:
    """Weights (n,) of what no measurement updates: (1 - P_D P_G) w."""
    p_gate = 1.0 if config.intensity.gate == "none" else config.model.p_gate
    return np.asarray((1.0 - p_detect * p_gate) * w)
