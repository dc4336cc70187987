"""The random-matrix model: reductions to the Kalman filter and PDA, shape ratio, invariances."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.linalg import sqrtm
from scipy.stats import invwishart, wishart

from maritrack.errors import ConfigError
from maritrack.objects import gate as gating
from maritrack.objects import giw, matrix2
from maritrack.objects.gate import gate
from maritrack.objects.giw import Giw
from maritrack.tracksettings import ModelConfig
from maritrack.types import Clusters

EXACT = 1e-9
POINT = ModelConfig(extent="point", centroid_n_max=0)
EXTENDED = ModelConfig(centroid_n_max=0, alpha_max=1e9, min_axis_m=1e-3, max_axis_m=1e5)


def clusters(mean: np.ndarray, R: np.ndarray, count: int = 1, scatter: np.ndarray | None = None) -> Clusters:
    c = len(mean)
    return Clusters(
        mean_m=mean, scatter_m2=np.zeros((c, 2, 2)) if scatter is None else scatter, count=np.full(c, count),
        weight_sq=np.full(c, 1.0 / count), noise_m2=R, t_ns=np.zeros(c, np.int64), range_m=np.zeros(c),
        azimuth_rad=np.zeros(c), intensity=np.ones(c), label=np.zeros(0, np.int64),
    )  # fmt: skip


def spd(rng: np.random.Generator, n: int, d: int, scale: float) -> np.ndarray:
    a = rng.normal(size=(n, d, d))
    return scale * (a @ a.transpose(0, 2, 1) + 0.5 * np.eye(d))


def objects(rng: np.random.Generator, n: int, *, extent: bool) -> Giw:
    X = spd(rng, n, 2, 400.0) if extent else np.zeros((n, 2, 2))
    return Giw(rng.normal(0, 50, (n, 4)), spd(rng, n, 4, 30.0), X, rng.uniform(4, 40, n))


def all_pairs(d: Giw, z: Clusters, model: ModelConfig, dt: float = 0.0) -> giw.Pairs:
    i, j = (a.ravel() for a in np.meshgrid(np.arange(len(d)), np.arange(len(z)), indexing="ij"))
    return giw.pair_up(d, z, i, j, np.full(len(i), dt), model)


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.integers(0, 10_000), st.floats(0, 5))
def test_a_point_object_with_a_certain_cluster_is_the_kalman_filter(seed: int, dt: float) -> None:
    rng = np.random.default_rng(seed)
    d = objects(rng, 1, extent=False)
    z = clusters(rng.normal(0, 50, (1, 2)), spd(rng, 1, 2, 20.0))
    F, q = np.eye(4), POINT.accel_psd_m2ps3
    F[0, 2] = F[1, 3] = dt
    Q = q * np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(2))
    x, P = F @ d.x[0], F @ d.P[0] @ F.T + Q
    H = np.eye(2, 4)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + z.noise_m2[0])
    x, P = x + K @ (z.mean_m[0] - H @ x), (np.eye(4) - K @ H) @ P
    p = giw.predict(d, np.array([dt]), POINT)
    u = giw.update(p, z, all_pairs(p, z, POINT), np.ones(1), np.zeros(1), POINT)
    assert_allclose(u.x[0], x, rtol=EXACT, atol=1e-7)
    assert_allclose(u.P[0], P, rtol=1e-7, atol=1e-6)


def test_a_cluster_of_an_earlier_time_is_the_kalman_update_of_the_moved_state() -> None:
    rng = np.random.default_rng(3)
    d, dt = objects(rng, 1, extent=False), -1.7
    z = clusters(rng.normal(0, 50, (1, 2)), spd(rng, 1, 2, 20.0))
    H = np.array([[1, 0, dt, 0], [0, 1, 0, dt]])
    S = H @ d.P[0] @ H.T + z.noise_m2[0]
    K = d.P[0] @ H.T @ np.linalg.inv(S)
    u = giw.update(d, z, all_pairs(d, z, POINT, dt), np.ones(1), np.zeros(1), POINT)
    assert_allclose(u.x[0], d.x[0] + K @ (z.mean_m[0] - H @ d.x[0]), rtol=EXACT)
    assert_allclose(u.P[0], d.P[0] - K @ S @ K.T, rtol=EXACT, atol=1e-8)


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.integers(0, 10_000), st.integers(1, 4))
def test_soft_update_is_the_moment_matched_mixture_of_single_updates(seed: int, m: int) -> None:
    rng = np.random.default_rng(seed)
    d = objects(rng, 1, extent=True)
    z = clusters(rng.normal(0, 60, (m, 2)), spd(rng, m, 2, 20.0), 6, spd(rng, m, 2, 900.0))
    w = rng.dirichlet(np.ones(m + 1))
    pairs = all_pairs(d, z, EXTENDED)
    single = [giw.update(d, z, pairs, (np.arange(m) == j).astype(float), np.zeros(1), EXTENDED) for j in range(m)]
    mean = w[0] * d.x[0] + sum(w[j + 1] * s.x[0] for j, s in enumerate(single))
    outer = [w[0] * (d.P[0] + np.outer(d.x[0] - mean, d.x[0] - mean))]
    outer += [w[j + 1] * (s.P[0] + np.outer(s.x[0] - mean, s.x[0] - mean)) for j, s in enumerate(single)]
    u = giw.update(d, z, pairs, w[1:], w[:1], EXTENDED)
    assert_allclose(u.x[0], mean, rtol=1e-8, atol=1e-8)
    assert_allclose(u.P[0], sum(outer), rtol=1e-7, atol=1e-6)
    assert_allclose(u.X[0], w[0] * d.X[0] + sum(w[j + 1] * s.X[0] for j, s in enumerate(single)), rtol=1e-8)


def test_of_what_is_hidden_in_part_a_cluster_tells_the_extent_by_the_share_that_is_seen() -> None:
    """With the probability of the rest it is a fragment: a mixture of the extent before and after."""
    rng = np.random.default_rng(7)
    d, z = objects(rng, 2, extent=True), clusters(rng.normal(0, 60, (3, 2)), spd(rng, 3, 2, 20.0), 6)
    pairs, beta, beta0 = all_pairs(d, z, EXTENDED), np.array([0.2, 0.3, 0.4, 0.6, 0.1, 0.3]), np.array([0.1, 0.0])
    whole = giw.update(d, z, pairs, beta, beta0, EXTENDED)
    hidden = np.array([0.0, 0.6])
    part = giw.update(d, z, pairs, beta, beta0, EXTENDED, hidden)
    for name in ("x", "P"):
        assert_allclose(getattr(part, name), getattr(whole, name), rtol=0)
    assert_allclose(part.X[0], whole.X[0], rtol=0)
    assert_allclose(part.X[1], 0.4 * whole.X[1] + 0.6 * d.X[1], rtol=EXACT)
    assert_allclose(part.alpha, (1.0 - hidden) * whole.alpha + hidden * d.alpha, rtol=EXACT)


@pytest.mark.eq("polar-10")
def test_plugin_shape_ratio_is_the_ratio_of_wishart_densities() -> None:
    rng = np.random.default_rng(5)
    model = replace(EXTENDED, shape="plugin", shape_n_max=0)
    d, n = objects(rng, 1, extent=True), 9
    z = clusters(np.zeros((1, 2)), spd(rng, 1, 2, 5.0), n, spd(rng, 1, 2, 2000.0))
    pairs, V0 = all_pairs(d, z, model), spd(rng, 1, 2, 700.0)
    V1 = model.rho * d.X[0] + z.noise_m2[0]
    truth = wishart.logpdf(z.scatter_m2[0], n - 1, V1) - wishart.logpdf(z.scatter_m2[0], n - 1, V0[0])
    assert_allclose(giw.log_shape_ratio(d, z, pairs, V0, model), truth, rtol=1e-9)


def test_predictive_shape_ratio_tends_to_the_plugin_as_both_extents_become_certain() -> None:
    rng = np.random.default_rng(6)
    Z, V = spd(rng, 1, 2, 900.0), spd(rng, 1, 2, 150.0)
    m, alpha = np.array([7.0]), np.array([1e7])
    limit = -0.5 * m * np.log(matrix2.det(V)) - 0.5 * matrix2.trace_product(matrix2.inverse(V), Z)
    W = 3.0 * V
    other = -0.5 * m * np.log(matrix2.det(W)) - 0.5 * matrix2.trace_product(matrix2.inverse(W), Z)
    ours = giw._log_marginal(Z, m, V, alpha) - giw._log_marginal(Z, m, W, alpha)
    assert_allclose(ours, limit - other, rtol=1e-4)


def test_the_shapes_of_clutter_vary_as_much_as_those_of_a_new_track() -> None:
    """The same spread and 4 degrees of freedom: no cluster tells them apart."""
    rng = np.random.default_rng(8)
    d = replace(objects(rng, 1, extent=True), alpha=np.array([4.0]))
    z = clusters(np.zeros((1, 2)), spd(rng, 1, 2, 5.0), 9, spd(rng, 1, 2, 2000.0))
    pairs = all_pairs(d, z, EXTENDED)
    for alpha, equal in ((4.0, True), (8.0, False)):
        ratio = giw.log_shape_ratio(replace(d, alpha=np.array([alpha])), z, pairs, pairs.Y, EXTENDED)
        assert np.isclose(ratio[0], 0.0, atol=1e-9) == equal
    assert EXTENDED.alpha_birth == 4.0


@pytest.mark.parametrize("shape", ["plugin", "predictive"])
def test_shape_ratio_is_finite_for_points_on_one_line_and_zero_for_one_point(shape: str) -> None:
    rng = np.random.default_rng(7)
    model = replace(EXTENDED, shape=shape)
    d = objects(rng, 1, extent=True)
    line = np.array([[[900.0, 0], [0, 0]]])
    V0 = spd(rng, 1, 2, 700.0)
    z = clusters(np.zeros((1, 2)), spd(rng, 1, 2, 5.0), 5, line)
    assert np.isfinite(giw.log_shape_ratio(d, z, all_pairs(d, z, model), V0, model)).all()
    z = clusters(np.zeros((1, 2)), spd(rng, 1, 2, 5.0))
    assert_allclose(giw.log_shape_ratio(d, z, all_pairs(d, z, model), V0, model), 0.0, atol=1e-12)


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.integers(0, 10_000), st.floats(-math.pi, math.pi))
def test_turning_the_world_turns_the_update(seed: int, angle: float) -> None:
    rng = np.random.default_rng(seed)
    c, s = math.cos(angle), math.sin(angle)
    T, T4 = np.array([[c, -s], [s, c]]), np.kron(np.eye(2), np.array([[c, -s], [s, c]]))
    d = objects(rng, 2, extent=True)
    z = clusters(rng.normal(0, 60, (3, 2)), spd(rng, 3, 2, 20.0), 6, spd(rng, 3, 2, 900.0))
    turned = Giw(d.x @ T4.T, T4 @ d.P @ T4.T, T @ d.X @ T.T, d.alpha)
    z_turned = replace(z, mean_m=z.mean_m @ T.T, noise_m2=T @ z.noise_m2 @ T.T, scatter_m2=T @ z.scatter_m2 @ T.T)
    beta, beta0 = np.full(6, 0.3), np.full(2, 0.1)
    a = giw.update(d, z, all_pairs(d, z, EXTENDED), beta, beta0, EXTENDED)
    b = giw.update(turned, z_turned, all_pairs(turned, z_turned, EXTENDED), beta, beta0, EXTENDED)
    assert_allclose(b.x, a.x @ T4.T, rtol=1e-7, atol=1e-7)
    assert_allclose(b.X, T @ a.X @ T.T, rtol=1e-6, atol=1e-5)


@pytest.mark.eq("polar-12")
@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.integers(0, 10_000), st.floats(-3, 3))
def test_gate_equals_its_definition(seed: int, dt: float) -> None:
    rng = np.random.default_rng(seed)
    d = objects(rng, 6, extent=True)
    z = clusters(rng.normal(0, 90, (8, 2)), spd(rng, 8, 2, 20.0))
    z = replace(z, t_ns=np.full(8, round(dt * 1e9)))
    dt = round(dt * 1e9) * 1e-9
    i, j, seconds, cut = gate(d, z, np.zeros(6, np.int64), 9.21, EXTENDED)
    assert cut == 0 and np.allclose(seconds, dt)
    H = np.array([[1, 0, dt, 0], [0, 1, 0, dt]])
    inside = set()
    for a in range(6):
        for b in range(8):
            S = H @ d.P[a] @ H.T + EXTENDED.rho * d.X[a] + z.noise_m2[b]
            nu = z.mean_m[b] - H @ d.x[a]
            if nu @ np.linalg.solve(S, nu) <= 9.21:
                inside.add((a, b))
    assert set(zip(i.tolist(), j.tolist(), strict=True)) == inside


def test_gate_in_blocks_is_the_gate_and_a_crowd_is_cut_to_the_nearest(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(2)
    d, z = objects(rng, 9, extent=True), clusters(rng.normal(0, 40, (30, 2)), spd(rng, 30, 2, 20.0))
    whole = gate(d, z, np.zeros(9, np.int64), 9.21, EXTENDED)
    monkeypatch.setattr(gating, "BLOCK", 60)
    blocks = gate(d, z, np.zeros(9, np.int64), 9.21, EXTENDED)
    assert all((a == b).all() for a, b in zip(whole[:3], blocks[:3], strict=True))
    monkeypatch.setattr(gating, "NEAREST", 3)
    i, j, _, cut = gate(d, z, np.zeros(9, np.int64), 9.21, EXTENDED)
    assert np.bincount(i).max() == 3 and cut == len(whole[0]) - len(i)
    S = (
        giw.predicted_centroid(d, whole[0], np.zeros(len(whole[0])))
        + EXTENDED.rho * d.X[whole[0]]
        + z.noise_m2[whole[1]]
    )
    S += EXTENDED.centroid_sigma_m**2 * np.eye(2)
    far = matrix2.form(matrix2.inverse(S), z.mean_m[whole[1]] - d.x[whole[0], :2])
    best = {(a, b) for a in range(9) for b in whole[1][whole[0] == a][np.argsort(far[whole[0] == a])[:3]].tolist()}
    assert set(zip(i.tolist(), j.tolist(), strict=True)) == best


@pytest.mark.eq("polar-7")
def test_extent_of_a_filled_ellipse_settles_at_its_axes() -> None:
    rng, model = np.random.default_rng(8), ModelConfig()
    X = np.array([[50.0**2, 0], [0, 10.0**2]])
    R = np.eye(2)[None]
    d: Giw | None = None
    for _ in range(60):
        u = rng.normal(size=(40, 2))
        u = u / np.linalg.norm(u, axis=1)[:, None] * np.sqrt(rng.uniform(size=(40, 1)))
        pts = u @ np.sqrt(X) + rng.normal(size=(40, 2))
        mean = pts.mean(0)[None]
        z = clusters(mean, R, 40, ((pts - mean).T @ (pts - mean))[None])
        if d is None:
            d = giw.birth(z, model)
        d = giw.predict(d, np.array([2.5]), model)
        d = giw.update(d, z, all_pairs(d, z, model), np.ones(1), np.zeros(1), model)
    assert d is not None
    axes = np.sqrt(matrix2.eigen(d.X)[0][0])
    assert_allclose(axes, [50.0, 10.0], rtol=0.1)


def test_no_cluster_and_no_object_are_normal() -> None:
    none = giw.birth(clusters(np.zeros((0, 2)), np.zeros((0, 2, 2))), EXTENDED)
    z = clusters(np.zeros((0, 2)), np.zeros((0, 2, 2)))
    i, j, _, _ = gate(none, z, np.zeros(0, np.int64), 9.21, EXTENDED)
    assert len(none) == len(i) == len(j) == 0
    assert len(giw.update(none, z, all_pairs(none, z, EXTENDED), np.zeros(0), np.zeros(0), EXTENDED)) == 0


def test_the_extent_update_with_unequal_weights_is_its_formula() -> None:
    rng = np.random.default_rng(12)
    d = objects(rng, 1, extent=True)
    z = clusters(rng.normal(0, 30, (1, 2)), spd(rng, 1, 2, 20.0), 7, spd(rng, 1, 2, 900.0))
    z = replace(z, weight_sq=np.array([0.3]))
    model = EXTENDED
    Y = model.rho * d.X[0] + z.noise_m2[0]
    S = d.P[0][:2, :2] + 0.3 * Y
    nu = z.mean_m[0] - d.x[0, :2]
    dof = 7 * (1 - 0.3)
    to_Z, to_N = sqrtm(d.X[0]) @ np.linalg.inv(sqrtm(Y)), sqrtm(d.X[0]) @ np.linalg.inv(sqrtm(S))
    expected = d.alpha[0] * d.X[0] + to_N @ np.outer(nu, nu) @ to_N.T + to_Z @ z.scatter_m2[0] @ to_Z.T
    u = giw.update(d, z, all_pairs(d, z, model), np.ones(1), np.zeros(1), model)
    assert_allclose(u.X[0], expected / (d.alpha[0] + dof + 1), rtol=1e-9)
    assert_allclose(u.alpha, d.alpha + dof + 1)


def test_the_predictive_ratio_is_the_likelihood_with_the_extent_integrated_out() -> None:
    """Against an average over inverse Wisharts of the object and of the clutter."""
    m, n = 6.0, 200_000
    Z, V1, V0 = np.array([[900.0, 200.0], [200.0, 400.0]]), np.diag([120.0, 40.0]), np.diag([700.0, 300.0])
    logs = []
    for V, alpha in ((V1, 9.0), (V0, 4.0)):
        draws = invwishart.rvs(alpha + 3.0, alpha * V, size=n, random_state=3)
        logs.append(wishart_log(Z, m, draws))
    monte_carlo = np.logaddexp.reduce(logs[0]) - np.logaddexp.reduce(logs[1])
    ours = giw._log_marginal(Z[None], np.array([m]), V1[None], np.array([9.0]))
    ours = ours - giw._log_marginal(Z[None], np.array([m]), V0[None], np.array([4.0]))
    assert_allclose(ours[0], monte_carlo, atol=0.05)


def wishart_log(Z: np.ndarray, m: float, scales: np.ndarray) -> np.ndarray:
    """Log of a Wishart density of m degrees of freedom for each scale, up to a constant."""
    inv = np.linalg.inv(scales)
    return -0.5 * m * np.log(np.linalg.det(scales)) - 0.5 * np.einsum("nij,ji->n", inv, Z)


@pytest.mark.eq("polar-7")
def test_birth_is_at_rest_at_the_cluster_with_its_spread_less_the_noise() -> None:
    model = replace(EXTENDED, sigma_velocity_mps=7.0, centroid_sigma_m=3.0)
    R, scatter = np.array([[[4.0, 1.0], [1.0, 9.0]]]), np.array([[[900.0, 0.0], [0.0, 400.0]]])
    b = giw.birth(clusters(np.array([[10.0, 20.0]]), R, 10, scatter), model)
    assert_allclose(b.X[0], (scatter[0] / 10 - R[0]) / model.rho)
    assert_allclose(b.x[0], [10.0, 20.0, 0.0, 0.0])
    assert_allclose(b.P[0][:2, :2], 4.0 * ((model.rho * b.X[0] + R[0]) / 10 + 9.0 * np.eye(2)))
    assert_allclose(b.P[0][2:, 2:], 49.0 * np.eye(2))


def test_extents_forget_towards_the_least_certainty_with_their_time_constant() -> None:
    d = objects(np.random.default_rng(1), 1, extent=True)
    later = giw.predict(d, np.array([EXTENDED.extent_time_constant_s]), EXTENDED)
    assert_allclose(later.alpha, 2.0 + (d.alpha - 2.0) * np.exp(-1.0))
    assert_allclose(later.X, d.X)


def test_a_crowd_that_is_nearer_but_outside_the_ellipse_hides_nobody() -> None:
    P = np.diag([200.0**2, 10.0**2, 1e-6, 1e-6])[None]
    d = Giw(np.zeros((1, 4)), P, np.zeros((1, 2, 2)), np.full(1, 4.0))
    beside = np.stack([np.linspace(-20, 20, 700), np.full(700, 90.0)], 1)
    z = clusters(np.concatenate([beside, [[300.0, 0.0]]]), np.tile(np.eye(2), (701, 1, 1)))
    i, j, _, cut = gate(d, z, np.zeros(1, np.int64), 9.21, POINT)
    assert (i.tolist(), j.tolist(), cut) == ([0], [700], 0)


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.integers(0, 10_000), st.integers(1, 120), st.integers(1, 90), st.floats(50, 5000))
def test_a_large_scene_is_gated_strip_by_strip_with_the_same_result(seed: int, n: int, c: int, side_m: float) -> None:
    rng = np.random.default_rng(seed)
    d = replace(objects(rng, n, extent=True), x=rng.normal(0, [side_m, side_m, 8, 8], (n, 4)))
    z = clusters(rng.normal(0, side_m, (c, 2)), spd(rng, c, 2, 20.0))
    z = replace(z, t_ns=rng.integers(-(10**9), 10**9, c))
    t_ns = rng.integers(-(10**9), 10**9, n)
    whole = gate(d, z, t_ns, 9.21, EXTENDED)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gating, "BLOCK", 20)
        strips = gate(d, z, t_ns, 9.21, EXTENDED)
    assert all((a == b).all() for a, b in zip(whole[:3], strips[:3], strict=True)) and whole[3] == strips[3]


@pytest.mark.parametrize("key", ["sigma_velocity_mps", "shape_n_max", "centroid_n_max"])
def test_what_no_model_can_have_is_refused(key: str) -> None:
    for value in (-1, 0) if key == "sigma_velocity_mps" else (-1,):
        with pytest.raises(ConfigError, match=f"model.{key}"):
            ModelConfig(**{key: value})
