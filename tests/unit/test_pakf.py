"""Principal axes: the filter by its formulas, the tracker by what it becomes when the axes stand still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from maritrack import geo
from maritrack.chain import build_chain, process
from maritrack.cluster.stage import cluster_points
from maritrack.cluster.statistics import cluster_statistics
from maritrack.config import load_config
from maritrack.objects import axes
from maritrack.objects.axes import Axes, Seen
from maritrack.settings import Config
from maritrack.trackers import TRACKERS
from maritrack.trackers.pakf import Principal
from maritrack.tracksettings import PakfConfig
from maritrack.types import CONFIRMED, Clusters, FloatArray, Frame
from tests.laws.test_tracker_laws import points_scan, scene
from tests.oracles import jpda_step
from tests.unit.scans import plain_config, scan_of, step

law = settings(derandomize=True, deadline=None, max_examples=25)
RULES = PakfConfig()
CONFIG = plain_config("pakf-jpda", "pakf.sigma_angle_deg=0.0", "pakf.sigma_axis_m=0.0", "model.accel_psd_m2ps3=0.1")


def some_axes(rng: np.random.Generator, n: int) -> Axes:
    root = rng.normal(size=(n, 3, 3)) * [0.1, 2.0, 2.0]
    short = rng.uniform(5, 20, n)
    p = np.column_stack([rng.uniform(0, 2 * np.pi, n), short + rng.uniform(30, 60, n), short])
    return Axes(p, np.einsum("nab,ncb->nac", root, root) + 1e-3 * np.eye(3))


def cloud(
    rng: np.random.Generator, n: int, angle: float, half_m: tuple[float, float], *, gauss: bool = False
) -> Clusters:
    """One cluster of n points of an ellipse at (500, 0), filled evenly or Gaussian with the same covariance."""
    z = rng.normal(size=(n, 2)) / 2 if gauss else np.empty((0, 2))
    while len(z) < n:
        u = rng.uniform(-1, 1, (4 * n, 2))
        z = u[(u**2).sum(1) <= 1][:n]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    scan, points = scan_of((z * half_m) @ turn.T + [500.0, 0.0], 0.0, sigma_m=1e-3)
    noise = (1.0, 1.0, 1.0)  # the points have their own
    return cluster_statistics(points, np.zeros(n, int), scan, intensity_weighting=False, noise=noise)


def test_an_evenly_filled_ellipse_is_measured_as_it_is() -> None:
    seen = axes.measure(cloud(np.random.default_rng(0), 20_000, 0.7, (80.0, 15.0)), CONFIG.model, RULES)
    assert_allclose(seen.z[0], [0.7, 80.0, 15.0], rtol=0.02)


def test_the_noise_of_measured_axes_is_that_of_a_sample_covariance() -> None:
    rng, n = np.random.default_rng(1), 200
    free = replace(RULES, angle_floor_deg=1e-6)
    seen = [axes.measure(cloud(rng, n, 0.7, (80.0, 50.0), gauss=True), CONFIG.model, free) for _ in range(400)]
    z, said = np.concatenate([s.z for s in seen]), np.concatenate([1 / s.information for s in seen]).mean(axis=0)
    assert_allclose(z.var(axis=0), said, rtol=0.25)


def test_a_round_cluster_has_axes_and_no_orientation() -> None:
    seen = axes.measure(cloud(np.random.default_rng(2), 500, 0.0, (30.0, 29.0)), CONFIG.model, RULES)
    assert seen.information[0, 0] == 0.0 and (seen.information[0, 1:] > 0).all()
    before = some_axes(np.random.default_rng(3), 1)
    before = replace(before, P=before.P * np.eye(3))
    after = axes.update(before, seen, np.zeros(1, int), np.zeros(1, int), np.ones(1), RULES)
    assert_allclose([after.p[0, 0], after.P[0, 0, 0]], [before.p[0, 0], before.P[0, 0, 0]])


@law
@given(st.integers(0, 10_000))
def test_one_certain_pair_is_a_kalman_update(seed: int) -> None:
    rng = np.random.default_rng(seed)
    prior, R = some_axes(rng, 1), rng.uniform(0.01, 0.1, 3) * [1.0, 100.0, 100.0]
    z = prior.p + rng.normal(0, 0.1, (1, 3))
    got = axes.update(prior, Seen(z, 1 / R[None]), np.zeros(1, int), np.zeros(1, int), np.ones(1), RULES)
    K = prior.P[0] @ np.linalg.inv(prior.P[0] + np.diag(R))
    expected = prior.p[0] + K @ (z[0] - prior.p[0])
    assert_allclose(geo.wrap(got.p[0] - expected)[0], 0.0, atol=1e-9)
    assert_allclose(got.p[0, 1:], expected[1:])
    assert_allclose(got.P[0], (np.eye(3) - K) @ prior.P[0], rtol=1e-8, atol=1e-10)


@law
@given(st.integers(0, 10_000))
def test_several_pairs_are_the_moments_of_their_mixture(seed: int) -> None:
    rng = np.random.default_rng(seed)
    prior, R = some_axes(rng, 1), np.array([0.02, 4.0, 4.0])
    z, beta = prior.p + rng.normal(0, 0.2, (3, 3)), rng.dirichlet(np.ones(4))
    got = axes.update(prior, Seen(z, np.tile(1 / R, (3, 1))), np.zeros(3, int), np.arange(3), beta[1:], RULES)
    K = prior.P[0] @ np.linalg.inv(prior.P[0] + np.diag(R))
    means = np.array([np.zeros(3), *(K @ (row - prior.p[0]) for row in z)])
    covs = np.array([prior.P[0], *[(np.eye(3) - K) @ prior.P[0]] * 3])
    mean = beta @ means
    spread = np.einsum("b,bij->ij", beta, covs + np.einsum("bi,bj->bij", means - mean, means - mean))
    assert_allclose(geo.wrap(got.p[0] - prior.p[0] - mean)[0], 0.0, atol=1e-9)
    assert_allclose(got.p[0, 1:], (prior.p[0] + mean)[1:])
    assert_allclose(got.P[0], spread, rtol=1e-7, atol=1e-9)


@law
@given(st.integers(0, 10_000), st.integers(-3, 3))
def test_a_half_turn_of_a_measured_orientation_changes_nothing(seed: int, turns: int) -> None:
    rng = np.random.default_rng(seed)
    prior, z = some_axes(rng, 1), np.array([[rng.uniform(0, 7), 50.0, 20.0]])
    zero, one, W = np.zeros(1, int), np.ones(1), np.array([[30.0, 0.1, 0.1]])
    a = axes.update(prior, Seen(z, W), zero, zero, one, RULES)
    b = axes.update(prior, Seen(z + np.array([turns * np.pi, 0, 0]), W), zero, zero, one, RULES)
    assert_allclose(axes.ellipse(a), axes.ellipse(b), rtol=1e-8)


@law
@given(st.integers(0, 10_000))
def test_the_longer_axis_stays_the_first(seed: int) -> None:
    rng = np.random.default_rng(seed)
    prior = some_axes(rng, 4)
    z = np.column_stack([rng.uniform(0, 7, 4), rng.uniform(1, 90, (4, 2))])
    n = np.arange(4)
    after = axes.update(prior, Seen(z, np.full((4, 3), 50.0)), n, n, np.ones(4), RULES)
    assert (after.p[:, 1] >= after.p[:, 2]).all()
    half = np.sqrt(np.linalg.eigvalsh(axes.ellipse(after)))
    assert_allclose(half[:, ::-1], np.abs(after.p[:, 1:]), rtol=1e-9)


def test_a_nearly_round_object_may_change_its_axes() -> None:
    prior = Axes(np.array([[0.0, 30.0, 28.0]]), np.diag([0.1, 1.0, 1.0])[None])
    assert_allclose(axes.innovation(prior.p, np.array([[1.5, 31.0, 27.0]]), RULES), [[1.5 - np.pi / 2, -3.0, 3.0]])
    assert_allclose(
        axes.innovation(np.array([[0.0, 60.0, 20.0]]), np.array([[1.5, 31.0, 27.0]]), RULES), [[1.5, -29.0, 7.0]]
    )


@pytest.mark.eq("abs-5", "abs-6")
@law
@given(st.integers(0, 10_000))
def test_with_frozen_axes_it_is_kalman_with_jpda(seed: int) -> None:
    rng = np.random.default_rng(seed)
    config = replace(CONFIG, model=replace(CONFIG.model, extent="random-matrix", p_gate=0.9))
    state = step(config, None, np.array([[0.0, 0.0], [60.0, 10.0], [30.0, 70.0]]), 0.0)
    state = step(config, state, np.array([[5.0, 0.0], [60.0, 15.0], [30.0, 66.0]]), 1.0)
    frozen = Axes(np.tile([0.4, 25.0, 10.0], (3, 1)), np.zeros((3, 3, 3)))
    X = axes.ellipse(frozen)
    density = replace(state.tracks.density, X=X)
    state = Principal(replace(state.tracks, density=density), frozen, state.recent)
    z = density.x[:, :2] + density.x[:, 2:] + rng.normal(0, 25, (3, 2))
    F = np.eye(4) + np.eye(4, k=2)
    Q = 0.1 * np.kron([[1 / 3, 1 / 2], [1 / 2, 1.0]], np.eye(2))
    x, P = density.x @ F.T, F @ density.P @ F.T + Q
    R = config.model.rho * X[0] + 25.0 * np.eye(2)
    m = config.model
    x, P = jpda_step(x, P, z, R, p_detect=m.p_detect, p_gate=m.p_gate, density=m.clutter_density_per_m2)
    after = step(config, state, z, 2.0)
    assert_allclose(after.tracks.density.x[:3], x, rtol=1e-8, atol=1e-8)
    assert_allclose(after.tracks.density.P[:3], P, rtol=1e-8, atol=1e-8)
    assert_allclose(after.tracks.density.X[:3], X, rtol=1e-9)


def seen_when(pattern: str, config: Config = CONFIG) -> Principal:
    """The state after scans of an object that is seen where the pattern has a 1."""
    state = None
    for k, mark in enumerate(pattern):
        state = step(config, state, np.array([[300.0, 0.0]]) if mark == "1" else np.zeros((0, 2)), float(k))
    assert state is not None
    return state


@pytest.mark.parametrize(
    ("pattern", "confirmed"),
    [("11", False), ("111", True), ("10101", True), ("100101", False), ("1001011", True), ("1000100010001", False)],
)
def test_m_hits_within_n_steps_confirm_a_track(pattern: str, confirmed: bool) -> None:
    assert seen_when(pattern).tracks.confirmed.tolist() == [confirmed]


@pytest.mark.parametrize(
    ("pattern", "n"),
    [("1" + "0" * 4, 1), ("1" + "0" * 5, 0), ("111" + "0" * 14, 1), ("111" + "0" * 15, 0), ("11101" + "0" * 14, 1)],
)
def test_misses_in_a_row_end_a_track(pattern: str, n: int) -> None:
    assert len(seen_when(pattern).tracks) == n


def turned(z: FloatArray, angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(z @ np.array([[c, s], [-s, c]]))


@settings(law, max_examples=6)
@given(st.integers(0, 1000), st.floats(0, 6.28))
def test_turning_the_world_turns_the_tracks(seed: int, angle: float) -> None:
    tracks = []
    for by in (0.0, angle):
        chain = build_chain(CONFIG)
        state = chain.init()
        for k, z in enumerate(scene(seed)):
            state, result = process(chain, state, Frame(k, points_scan(turned(z, by), k)))
        tracks.append(result.tracks)
    a, b = tracks
    assert len(a) == len(b)
    near = np.hypot(*(b.position_m[:, None] - turned(a.position_m, angle)[None]).transpose(2, 0, 1))
    assert near.min(axis=1).max(initial=0.0) < 1e-5


def test_a_hull_under_way_is_held_with_its_length_and_heading() -> None:
    rng, config = np.random.default_rng(5), load_config(preset="radar", sets=["tracker_name=pakf-jpda"])
    tracker = TRACKERS["pakf-jpda"](config)
    state, heading = tracker.init(), np.array([np.cos(0.5), np.sin(0.5)])
    for k in range(30):
        u = rng.uniform(-1, 1, (400, 2))
        u = u[(u**2).sum(1) <= 1] * [100.0, 16.0]
        z = u[:, :1] * heading + u[:, 1:] * [-heading[1], heading[0]] + [300.0, 500.0] + 2.5 * k * 6.0 * heading
        z += rng.normal(0.0, 3.0, z.shape)
        scan, points = scan_of(z, 2.5 * k, sigma_m=3.0)
        state, _ = tracker.update(state, scan, points, cluster_points(points, scan, config.cluster, config.input))
    t = tracker.estimate(state)
    assert t.status.tolist() == [CONFIRMED] and bool(t.moving[0])
    assert_allclose(state.axes.p[0, 1:], [100.0, 16.0], rtol=0.05)
    assert abs((state.axes.p[0, 0] - 0.5 + np.pi / 2) % np.pi - np.pi / 2) < np.radians(3)
    assert_allclose(t.velocity_mps[0], 6.0 * heading, atol=0.5)


def test_hits_count_by_steps_of_all_sensors_not_by_scans() -> None:
    """Seen by the first of two radars in every other turn, three times in five: confirmed."""
    tracker, state = TRACKERS["pakf-jpda"](CONFIG), None
    for k, mark in enumerate("10101"):
        for sensor in ("a", "b"):
            at = np.array([[300.0, 0.0]]) if mark == "1" and sensor == "a" else np.zeros((0, 2))
            scan, points = scan_of(at, float(k), sensor=sensor)
            clusters = cluster_points(points, scan, CONFIG.cluster, CONFIG.input)
            state, _ = tracker.update(tracker.init() if state is None else state, scan, points, clusters)
    assert state is not None and state.tracks.confirmed.tolist() == [True]
