"""What the engm paper proves, in numbers: one object that is always seen, no birth, no death, no clutter.

EnGM-PHD is then the ensemble Gaussian mixture filter (theorem 3.1), and both it and SMC-PHD tend to the Kalman filter
on a linear model; GM-PHD is that filter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from maritrack.cluster.stage import cluster_points
from maritrack.config import load_config
from maritrack.objects import cv
from maritrack.settings import Config
from maritrack.trackers import TRACKERS, engm_phd, intensity, kernels, particles, readings
from maritrack.trackers.intensity import Intensity, IntensityState
from maritrack.types import FloatArray, Points, Scan, Sensor

SIGMA_M, STEPS, REPEATS = 5.0, 5, 10
START, SPREAD = np.array([400.0, 300.0, 3.0, -2.0]), np.diag([100.0, 60.0, 4.0, 9.0])
FIXED = ("model.p_detect=1.0", "model.clutter=fixed", "model.clutter_density_per_m2=1e-30", "intensity.gate=none",
         "intensity.p_survive_scan=1.0", "model.centroid_n_max=0", "intensity.birth_weight=1e-3",
         "intensity.bandwidth=global", "intensity.shrink=false")  # fmt: skip


@dataclass(frozen=True, slots=True)
class Limits:
    """Errors against what must be the same, or become so."""

    gm_to_kalman: float  # of the mean, in standard deviations, largest of all
    engm_to_engmf: float  # of the posterior's weights, largest of all
    to_kalman: dict[str, dict[int, float]]  # of the mean, root mean square, by filter and number of particles


def limits(numbers: tuple[int, ...] = (100, 1000, 10_000)) -> Limits:
    """All of them."""
    gm = float(np.max(errors("gm-phd", 1, REPEATS)))
    return Limits(
        gm_to_kalman=gm,
        engm_to_engmf=max(weights_apart(seed) for seed in range(REPEATS)),
        to_kalman={
            name: {n: float(np.sqrt(np.mean(errors(name, n, REPEATS) ** 2))) for n in numbers}
            for name in ("smc-phd", "engm-phd")
        },
    )


def errors(name: str, n: int, repeats: int) -> FloatArray:
    """Mean of the intensity against Kalman's after some steps (repeats, 4), in its standard deviations."""
    apart = []
    for seed in range(repeats):
        config = load_config(
            preset="points", sets=[f"tracker_name={name}", *FIXED, f"intensity.components={n}", f"seed={seed}"]
        )
        tracker, rng = TRACKERS[name](config), np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(13,)))
        state = begun(config, one_gaussian() if name == "gm-phd" else particles_of(n, rng))
        x, P = START, SPREAD
        for k in range(1, STEPS + 1):
            scan, points = seen_at(START[:2] + k * START[2:] + rng.normal(0.0, SIGMA_M, 2), k)
            clusters = cluster_points(points, scan, config.cluster, config.input)
            state = tracker.update(state, scan, points, clusters)[0]
            x, P = kalman(x, P, points.position_m[0], config.model.accel_psd_m2ps3)
        d = state.intensity
        apart.append((d.w @ d.x / d.w.sum() - x) / np.sqrt(np.diag(P)))
    return np.abs(apart)


def weights_apart(seed: int) -> float:
    """Largest difference of the posterior's weights from the ensemble Gaussian mixture filter's."""
    config = load_config(preset="points", sets=["tracker_name=engm-phd", *FIXED, "intensity.components=250"])
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(14,)))
    state = begun(config, particles_of(250, rng))
    scan, points = seen_at(START[:2] + START[2:] + rng.normal(0.0, SIGMA_M, 2), 1)
    clusters = cluster_points(points, scan, config.cluster, config.input)
    seen = readings.read(scan, points, clusters, state.tracks, config)
    prior = engm_phd.predicted(state, state.born, 1.0, config)
    hit = particles.weighed(prior, seen, scan, points, scan.t_ns, config, gaussian=True).hit
    x = state.intensity.x @ cv.transition(1.0, 2).T
    Q = cv.process_noise(1.0, 2, accel_psd_m2ps3=config.model.accel_psd_m2ps3)
    B = kernels.bandwidth(np.array([250.0]), 4)[0] * np.cov(x.T) + Q
    S = B[:2, :2] + SIGMA_M**2 * np.eye(2)
    nu = points.position_m[0] - x[:, :2]
    w = np.exp(-0.5 * np.einsum("ni,ni->n", nu, np.linalg.solve(S, nu.T).T))
    return float(np.abs(hit - w / w.sum()).max())


def kalman(x: FloatArray, P: FloatArray, z: FloatArray, q: float) -> tuple[FloatArray, FloatArray]:
    """A step of a second of the filter for a point at constant velocity."""
    F = cv.transition(1.0, 2)
    x, P = F @ x, F @ P @ F.T + cv.process_noise(1.0, 2, accel_psd_m2ps3=q)
    K = np.linalg.solve(P[:2, :2] + SIGMA_M**2 * np.eye(2), P[:2]).T
    return x + K @ (z - x[:2]), P - K @ P[:2]


def begun(config: Config, d: Intensity) -> IntensityState:
    """A state after the first scan."""
    return replace(intensity.begin(config), intensity=d, k=1)


def one_gaussian() -> Intensity:
    """The object as a Gaussian."""
    return Intensity(START[None], SPREAD[None], np.ones(1), np.ones(1, np.int64))


def particles_of(n: int, rng: np.random.Generator) -> Intensity:
    """The object as particles."""
    x = START + rng.normal(size=(n, 4)) * np.sqrt(np.diag(SPREAD))
    return Intensity(x, np.zeros((n, 4, 4)), np.full(n, 1.0 / n), np.ones(n, np.int64))


def seen_at(z: FloatArray, k: int) -> tuple[Scan, Points]:
    """A scan of one point."""
    t_ns, zero = k * 10**9, np.zeros(1)
    points = Points(
        range_m=np.hypot(z[:1], z[1:]), azimuth_rad=np.arctan2(z[:1], z[1:]), position_m=z[None], intensity=np.ones(1),
        t_ns=np.array([t_ns]), range_width_m=zero, azimuth_width_rad=zero, cov_m2=SIGMA_M**2 * np.eye(2)[None],
    )  # fmt: skip
    return Scan(Sensor("p", 0.0, 0.0, np.inf), t_ns, t_ns, np.zeros(2), np.nan, points=points), points
