"""What the intensity filters are in their limits: Kalman filters, the ensemble Gaussian mixture filter."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from maritrack.cluster.stage import cluster_points
from maritrack.objects import cv, sensing
from maritrack.settings import Config
from maritrack.trackers import TRACKERS, engm_phd, intensity, kernels, particles, readings
from maritrack.trackers.intensity import Intensity, IntensityState
from maritrack.types import CONFIRMED, FloatArray
from tests.unit.scans3 import INTENSITY_TRACKERS, plane_config, plane_step, space_scan, step_scan

law = settings(derandomize=True, deadline=None, max_examples=15)
SIGMA_M = 5.0  # of `scan_of`
X0, P0 = np.array([400.0, 300.0, 3.0, -2.0]), np.diag([100.0, 60.0, 4.0, 9.0])

FROM_CLUSTERS = ("intensity.birth=clusters", "intensity.birth_weight=0.01")


def kalman(x: FloatArray, P: FloatArray, z: FloatArray, dt_s: float, q: float) -> tuple[FloatArray, FloatArray]:
    """The filter written out: one step of a point at constant velocity."""
    F = np.kron([[1, dt_s], [0, 1]], np.eye(2))
    Q = q * np.kron([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]], np.eye(2))
    x, P = F @ x, F @ P @ F.T + Q
    K = P[:, :2] @ np.linalg.inv(P[:2, :2] + SIGMA_M**2 * np.eye(2))
    return x + K @ (z - x[:2]), P - K @ P[:2]


def begun(config: Config, d: Intensity) -> IntensityState:
    """A state that is not the first: the next scan is predicted to."""
    return replace(intensity.begin(config), intensity=d, k=1)


def ensemble(n: int, seed: int) -> Intensity:
    """Particles of one object."""
    x = np.random.default_rng(seed).multivariate_normal(X0, P0, n)
    return Intensity(x, np.zeros((n, 4, 4)), np.full(n, 1.0 / n), np.ones(n, np.int64))


def moments(state: IntensityState) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of all of the intensity."""
    d = state.intensity
    w = d.w / d.w.sum()
    mean = w @ d.x
    gap = d.x - mean
    return mean, np.einsum("n,ni,nj->ij", w, gap, gap) + np.einsum("n,nij->ij", w, d.P)


@law
@given(seed=st.integers(0, 10_000), dt_s=st.floats(0.5, 5.0))
@pytest.mark.eq("engm-4", "engm-5", "engm-6", "engm-39")
def test_gm_phd_with_one_object_and_a_linear_model_is_the_kalman_filter(seed: int, dt_s: float) -> None:
    config = plane_config("gm-phd")
    rng = np.random.default_rng(seed)
    state: Any = begun(config, Intensity(X0[None], P0[None], np.ones(1), np.ones(1, np.int64)))
    x, P = X0, P0
    for k in range(1, 7):
        z = x[:2] + dt_s * x[2:] + rng.normal(0, 8, 2)
        state = plane_step(config, state, z, k * dt_s)
        step_s = round(k * dt_s * 1e9) * 1e-9 - round((k - 1) * dt_s * 1e9) * 1e-9
        x, P = kalman(x, P, z, step_s, config.model.accel_psd_m2ps3)
        d = state.intensity
        assert len(d) == 1
        assert_allclose(d.x[0], x, rtol=1e-9)
        assert_allclose(d.P[0], P, rtol=1e-7, atol=1e-9)
        assert d.w[0] == pytest.approx(1.0, abs=1e-9)


def engmf(x: FloatArray, z: FloatArray, R: FloatArray, measure: Any, jacobian: Any) -> tuple[Any, Any, Any]:
    """The ensemble Gaussian mixture filter's posterior, particle by particle, from predicted particles."""
    n, s = x.shape
    beta = (4.0 / (n * (s + 2))) ** (2.0 / (s + 4))
    B = beta * np.cov(x.T)
    w, mean, cov = [], [], []
    for one in x:
        H = jacobian(one)
        S = H @ B @ H.T + R
        K = B @ H.T @ np.linalg.inv(S)
        nu = z - measure(one)
        w.append(np.exp(-0.5 * nu @ np.linalg.solve(S, nu)) / np.sqrt(np.linalg.det(2 * np.pi * S)))
        mean.append(one + K @ nu)
        cov.append(B - K @ S @ K.T)
    return np.array(w) / np.sum(w), np.array(mean), np.array(cov)


@law
@given(seed=st.integers(0, 10_000), n=st.integers(30, 80))
@pytest.mark.eq("engm-7", "engm-10", "engm-11", "engm-12", "engm-13", "engm-14", "engm-15", "engm-16", "engm-17",
                "engm-18", "engm-19", "engm-20", "engm-21", "engm-22", "engm-28", "engm-29", "engm-30", "engm-31",
                "engm-32", "engm-33", "engm-34", "engm-35", "engm-36", "engm-37", "engm-38")  # fmt: skip
def test_engm_phd_of_one_object_always_seen_without_birth_death_and_clutter_is_the_engmf(seed: int, n: int) -> None:
    """Theorem 3.1, in space with range, azimuth and elevation: the same mixture, component by component."""
    sets = ("intensity.measurement=range-azimuth-elevation", "intensity.clutter_density_per_m3=1e-200",
            "model.accel_psd_m2ps3=0.0", f"intensity.components={n}")  # fmt: skip
    config = plane_config("engm-phd", *sets)
    rng = np.random.default_rng(seed)
    x = np.array([40.0, 60.0, 70.0, 1.0, -1.0, 0.5]) + rng.normal(size=(n, 6)) * [4, 4, 4, 1, 1, 1]
    d = Intensity(x, np.zeros((n, 6, 6)), np.full(n, 1.0 / n), np.ones(n, np.int64))
    ahead = x @ cv.transition(1.0, 3).T
    z = sensing.measure("range-azimuth-elevation", np.array([[41.0, 59.0, 71.0]]))[0]
    scan = space_scan(z, 1.0)
    assert scan.points is not None
    state = begun(config, d)
    prior = engm_phd.predicted(state, state.born, 1.0, config)
    clusters = cluster_points(scan.points, scan, config.cluster, config.input)
    seen = readings.read(scan, scan.points, clusters, state.tracks, config)
    found = particles.weighed(prior, seen, scan, scan.points, scan.t_ns, config, gaussian=True)
    every = np.arange(n)
    mean, cov = engm_phd.links.update(prior.x, prior.P, found.pairs, every, seen.R)

    def h(one: FloatArray) -> FloatArray:
        level = np.hypot(one[0], one[1])
        return np.array([np.hypot(level, one[2]), np.arctan2(one[0], one[1]), np.arctan2(one[2], level)])

    def by_differences(one: FloatArray) -> FloatArray:
        step = 1e-5 * np.eye(6)
        return np.stack([(h(one + e) - h(one - e)) / 2e-5 for e in step], axis=1)

    w, m, P = engmf(ahead, z, seen.R[0], h, by_differences)
    assert_allclose(found.hit, w, rtol=1e-4)
    assert found.hit.sum() == pytest.approx(1.0, abs=1e-9) and found.left.max() == 0.0
    assert_allclose(mean, m, rtol=1e-5, atol=1e-4)
    assert_allclose(cov, P, rtol=1e-4, atol=1e-4)


def error_to_kalman(name: str, n: int) -> float:
    """Distance of the posterior's mean from Kalman's, in standard deviations, over the worst state, mean of 6 runs."""
    far = []
    for seed in range(6):
        config = plane_config(name, f"intensity.components={n}", f"seed={seed}")
        z = np.array([406.0, 295.0])
        state = plane_step(config, begun(config, ensemble(n, seed)), z, 1.0)
        x, P = kalman(X0, P0, z, 1.0, config.model.accel_psd_m2ps3)
        far.append(float(np.abs((moments(state)[0] - x) / np.sqrt(np.diag(P))).max()))
    return float(np.mean(far))


@pytest.mark.parametrize("name", ["smc-phd", "engm-phd"])
@pytest.mark.eq("engm-8", "engm-9")
def test_particles_tend_to_the_kalman_posterior_as_they_become_many(name: str) -> None:
    """The error falls about as n to the power of -1/2; the covariance of many is Kalman's, but for their kernel."""
    few, many = error_to_kalman(name, 100), error_to_kalman(name, 10_000)
    assert many < 0.05 and many < 0.3 * few
    config = plane_config(name, "intensity.components=40000")
    z = np.array([406.0, 295.0])
    mean, cov = moments(plane_step(config, begun(config, ensemble(40_000, 1)), z, 1.0))
    x, P = kalman(X0, P0, z, 1.0, config.model.accel_psd_m2ps3)
    scale = np.sqrt(np.diag(P))
    assert_allclose(mean / scale, x / scale, atol=0.03)
    assert_allclose(cov / np.outer(scale, scale), P / np.outer(scale, scale), atol=0.08)  # beta is 0.064


@pytest.mark.parametrize("name", INTENSITY_TRACKERS)
@pytest.mark.eq("engm-1")
def test_the_weight_of_the_intensity_is_the_number_of_objects_that_are_seen(name: str) -> None:
    """P_D = 1, no clutter: each measurement adds 1, whatever the prior says."""
    config = plane_config(name)
    state: Any = None
    at = np.array([[100.0, 0.0], [-400.0, 300.0], [0.0, -250.0]])
    for k in range(4):
        state = plane_step(config, state, at + k, float(k))
    assert state.intensity.w.sum() == pytest.approx(3.0, abs=1e-6)


@pytest.mark.parametrize("name", INTENSITY_TRACKERS)
@pytest.mark.parametrize("measurement", ["clusters", "range-azimuth"])
def test_an_object_keeps_its_id(name: str, measurement: str) -> None:
    """Three objects far apart, a little clutter, some misses: three tracks, the same ids at the end as early on."""
    config = plane_config(
        name, "intensity.bandwidth=local", f"intensity.measurement={measurement}", "model.p_detect=0.9",
        "model.clutter_density_per_m2=1e-6", "intensity.p_survive_scan=0.99", "intensity.hold_scans=3",
        "intensity.gate=ellipse", "intensity.birth_weight=0.05", "model.sigma_velocity_mps=5.0",
        "intensity.components=900", "intensity.group_particles=300",
    )  # fmt: skip
    rng = np.random.default_rng(3)
    at, v = np.array([[500.0, 0.0], [-400.0, 600.0], [0.0, -450.0]]), np.array([[3.0, 1.0], [0.0, -3.0], [-2.0, 2.0]])
    state: Any = None
    ids = []
    for k in range(20):
        z = (at + k * v)[rng.random(3) < 0.95] + rng.normal(0, 3, 2)
        clutter = rng.uniform(-1000, 1000, (rng.poisson(2), 2))
        state = plane_step(config, state, np.concatenate([z, clutter]), float(k))
        tracks = TRACKERS[name](config).estimate(state)
        which = tracks.status >= CONFIRMED
        gap = np.linalg.norm((at + k * v)[:, None] - tracks.position_m[None, which], axis=2)
        ids.append(set(tracks.id[which][(gap < 40).any(axis=0)].tolist()))
    assert len(ids[8]) == 3 and ids[8] == ids[-1]


@pytest.mark.parametrize("name", INTENSITY_TRACKERS)
@pytest.mark.parametrize("bandwidth", ["global", "local"])
def test_equal_seeds_give_equal_states_and_the_order_of_points_does_not_count(name: str, bandwidth: str) -> None:
    rng = np.random.default_rng(5)
    z = [rng.uniform([60, 0, 0], [120, 1.5, 1.0], (6, 3)) for _ in range(6)]
    config = plane_config(
        name, "intensity.measurement=range-azimuth-elevation", f"intensity.bandwidth={bandwidth}",
        "intensity.clutter_density_per_m3=1e-7", "model.p_detect=0.9", "intensity.components=120",
    )  # fmt: skip
    states: list[Any] = [None, None]
    for k, points in enumerate(z):
        states = [step_scan(config, state, space_scan(rows, float(k)))
                  for state, rows in zip(states, (points, points[::-1]), strict=True)]  # fmt: skip
    a, b = states
    for field in ("x", "P", "w", "label"):
        assert_array_equal(getattr(a.intensity, field), getattr(b.intensity, field))
    assert_array_equal(a.tracks.id, b.tracks.id)


@pytest.mark.parametrize("name", INTENSITY_TRACKERS)
@pytest.mark.parametrize("bandwidth", ["global", "local"])
@pytest.mark.parametrize(
    "sets",
    [
        ("model.p_detect=0.9",), ("model.p_detect=1.0",), ("model.p_detect=1.0", *FROM_CLUSTERS),
        ("intensity.p_survive_scan=0.0", *FROM_CLUSTERS),
    ],
)  # fmt: skip
def test_nothing_seen_far_times_and_a_clock_that_steps_back_are_ordinary(
    name: str, bandwidth: str, sets: tuple[str, ...]
) -> None:
    config = plane_config(name, f"intensity.bandwidth={bandwidth}", *sets)
    state: Any = None
    for z, t_s in (([], 0.0), ([[50.0, 60.0]], 1.0), ([], 2.0), ([[51.0, 60.0]] * 2, 2.0), ([[0.0, 0.0]], 3600.0),
                   ([[5.0, 5.0]], 3000.0), ([], 3601.0)):  # fmt: skip
        state = plane_step(config, state, z, t_s)
        tracks = TRACKERS[name](config).estimate(state)
        assert np.isfinite(tracks.position_m).all() and np.isfinite(tracks.cov).all()
        assert (np.diff(tracks.id) > 0).all()
    assert state.t_ns == 3601 * 10**9


@pytest.mark.eq("engm-23", "engm-24", "engm-25", "engm-26", "engm-27", "engm-2")
def test_algorithm_2_draws_births_by_their_share_of_the_weight_and_makes_all_weights_equal() -> None:
    config = plane_config("engm-phd", "intensity.components=4000")
    old = replace(ensemble(4000, 1), P=np.tile(np.eye(4), (4000, 1, 1)))
    born = Intensity(np.full((10, 4), 5000.0), np.tile(np.eye(4), (10, 1, 1)), np.full(10, 0.01), np.full(10, 9))
    prior = engm_phd.uniform(old, born, config, np.random.default_rng(0))
    assert len(prior) == 4010 and prior.w.sum() == pytest.approx(1.1)
    assert np.ptp(prior.w) == 0.0
    share = np.mean(prior.label == 9)
    assert abs(share - 0.1 / 1.1) < 4 * np.sqrt(0.083 / 4010)
    beta = (4 / (4010 * 6)) ** (2 / 8)
    assert_allclose(prior.P[0], beta / 2 * np.cov(prior.x.T) + 1e-6 * np.eye(4), rtol=1e-9)  # ceil(1.1) = 2


@pytest.mark.eq("engm-3")
def test_survivors_are_moved_on_and_weigh_less_births_do_not() -> None:
    config = plane_config("gm-phd", "intensity.p_survive_scan=0.9", "intensity.sigma_process=0.5")
    d = Intensity(X0[None], P0[None], np.array([2.0]), np.ones(1, np.int64))
    later = intensity.moved(d, 3.0, config)
    F = cv.transition(3.0, 2)
    assert_allclose(later.x[0], F @ X0)
    Q = cv.process_noise(3.0, 2, accel_psd_m2ps3=config.model.accel_psd_m2ps3) + 0.25 * np.eye(4)
    assert_allclose(later.P[0], F @ P0 @ F.T + Q)
    assert later.w[0] == pytest.approx(1.8)
    born = intensity.newborn(replace(begun(config, d), born=d), 3.0, config)
    assert born.w[0] == 2.0 and np.allclose(born.x[0], F @ X0)


def test_a_kernel_of_two_far_groups_is_narrow_where_it_is_local() -> None:
    rng = np.random.default_rng(2)
    x = np.concatenate([rng.normal(size=(200, 4)), rng.normal(size=(200, 4)) + 5000.0])
    w, group = np.full(400, 1 / 200), np.repeat([0, 1], 200)
    _, wide = kernels.kernels(x, w, np.zeros(400, np.int64), 1)
    _, narrow = kernels.kernels(x, w, group, 2)
    beta = (4 / (200 * 6)) ** (2 / 8)
    assert wide[0, 0, 0] > 1e5
    assert_allclose(narrow[1], beta * np.cov(x[200:].T) + 1e-6 * np.eye(4), rtol=1e-9)


def test_kernels_that_shrink_leave_the_covariance_of_the_particles_as_it_is() -> None:
    x = np.random.default_rng(8).normal(size=(60, 4)) * [1, 2, 3, 4] + 10.0
    w, group = np.full(60, 1 / 60), np.zeros(60, np.int64)
    for shrink, wider in ((True, 1.0), (False, 1.0 + (4 / (60 * 6)) ** (2 / 8))):
        centre, K = kernels.kernels(x, w, group, 1, shrink=shrink)
        assert_allclose(centre.mean(axis=0), x.mean(axis=0))
        assert_allclose(np.cov(centre.T) + K[0], wider * np.cov(x.T), atol=1e-5)
