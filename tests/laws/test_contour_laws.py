"""Laws of the Gaussian-process contour, its iterated filter, and the gamma rate of points."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import nbinom

from maritrack.contoursettings import ContourConfig
from maritrack.objects import contour, iekf, rate
from maritrack.types import FloatArray

RULES = ContourConfig(length_m=6.0, width_m=3.0, density="implicit")


def hulls(k: int, seed: int, rules: ContourConfig = RULES) -> tuple[FloatArray, FloatArray]:
    """States (k, s) and covariances of hulls, all different."""
    rng = np.random.default_rng(seed)
    at = np.concatenate([rng.normal(0, 30, (k, 2)), rng.normal(0, 2, (k, 2)), rng.uniform(-3, 3, (k, 2))], axis=1)
    x, P = contour.newborn(at, np.array([2.0, 2.0, 1.0, 1.0, 0.3, 0.1]), rules)
    return x + rng.multivariate_normal(np.zeros(x.shape[1]), P[0], k) * 0.3, P


def points_on(x: FloatArray, n: int, seed: int, rules: ContourConfig = RULES, sigma_m: float = 0.2) -> FloatArray:
    """Noisy points (k, n, 2) of the outlines."""
    rng = np.random.default_rng(seed)
    corners = contour.polygon(x, rules, 180)
    which = rng.integers(180, size=(len(x), n))
    return np.take_along_axis(corners, which[..., None], axis=1) + rng.normal(0, sigma_m, (len(x), n, 2))


def predicted_points(x: FloatArray, z: FloatArray, rules: ContourConfig) -> FloatArray:
    """h(x) (k, n, 2), written as the paper has it."""
    d = z - x[:, None, :2]
    angle = np.arctan2(d[..., 1], d[..., 0])
    rho = contour.radius(angle - x[:, None, 4], x[:, 6:], rules)[0]
    return x[:, None, :2] + rho[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


@pytest.mark.eq("extended-3", "extended-4")
@pytest.mark.parametrize("corner", [2.0, 4.0])
@pytest.mark.parametrize("length", [0.0, 6.0])
def test_the_derivative_of_the_measurement_is_that_of_finite_differences(length: float, corner: float) -> None:
    rules = replace(RULES, length_m=length, width_m=length / 2, corner=corner)
    x, _ = hulls(4, 1, rules)
    z = points_on(x, 25, 2, rules, sigma_m=1.0)
    d = z - x[:, None, :2]
    p = d / np.linalg.norm(d, axis=-1, keepdims=True)
    frame = np.stack([p, np.stack([-p[..., 1], p[..., 0]], axis=-1)], axis=-2)
    found = contour.residuals(x, z, rules)
    numeric = np.empty_like(found.H)
    for i in range(x.shape[1]):
        h = np.zeros(x.shape[1])
        h[i] = 1e-6
        slope = (predicted_points(x + h, z, rules) - predicted_points(x - h, z, rules)) / 2e-6
        numeric[..., i] = np.einsum("knab,knb->kna", frame, slope)
    np.testing.assert_allclose(found.H, numeric, atol=2e-6)
    residual = np.einsum("knab,knb->kna", frame, z - predicted_points(x, z, rules))
    np.testing.assert_allclose(found.e, residual[..., 0], atol=1e-9)
    np.testing.assert_allclose(residual[..., 1], 0.0, atol=1e-9)


def stacked(x: FloatArray, z: FloatArray, rules: ContourConfig) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Innovation (2n,), Jacobian (2n, s) and noise (2n, 2n) of one hull in east-north."""
    found = contour.residuals(x[None], z[None], rules)
    d = z - x[:2]
    p = d / np.linalg.norm(d, axis=-1, keepdims=True)
    frame = np.stack([p, np.stack([-p[:, 1], p[:, 0]], axis=-1)], axis=-2)
    n = len(z)
    H = np.einsum("nab,nac->nbc", frame, found.H[0]).reshape(2 * n, -1)
    noise = np.zeros((2 * n, 2 * n))
    for i in range(n):
        noise[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = frame[i].T @ np.diag(found.var[0, i]) @ frame[i]
    return (z - predicted_points(x[None], z[None], rules)[0]).ravel(), H, noise


@pytest.mark.eq("extended-2")
def test_the_iterated_filter_with_one_step_is_the_extended_kalman_filter() -> None:
    rules = replace(RULES, iterations=1)
    x, P = hulls(3, 5, rules)
    z = points_on(x, 12, 6, rules)
    got = iekf.fit(x, P, z, np.ones(z.shape[:2], bool), x, rules)
    for k in range(3):
        y, H, R = stacked(x[k], z[k], rules)
        S = H @ P[k] @ H.T + R
        K = P[k] @ H.T @ np.linalg.inv(S)
        np.testing.assert_allclose(got.x[k], x[k] + K @ y, atol=1e-8)
        np.testing.assert_allclose(got.P[k], P[k] - K @ S @ K.T, atol=1e-7)
        log_l = -0.5 * (y @ np.linalg.solve(S, y) + np.linalg.slogdet(2 * math.pi * S)[1])
        assert got.log_likelihood[k] == pytest.approx(log_l, abs=1e-6)


def test_the_iterations_end_where_the_posterior_is_flat() -> None:
    x, P = hulls(4, 7)
    z = points_on(x + np.eye(x.shape[1])[0], 30, 8)
    use = np.ones(z.shape[:2], bool)
    got = iekf.fit(x, P, z, use, x, replace(RULES, tolerance=1e-9))
    for k in range(4):
        y, H, R = stacked(got.x[k], z[k], RULES)
        slope = H.T @ np.linalg.solve(R, y) - np.linalg.solve(P[k], got.x[k] - x[k])
        scale = np.sqrt(np.diag(got.P[k]))
        assert np.abs(slope * scale).max() < 0.01  # standard deviations; R depends on the state as well
        S = H @ P[k] @ H.T + R
        seen = y + H @ (got.x[k] - x[k])
        log_l = -0.5 * (seen @ np.linalg.solve(S, seen) + np.linalg.slogdet(2 * math.pi * S)[1])
        assert got.log_likelihood[k] == pytest.approx(log_l, abs=1e-5)


def test_padding_changes_nothing_and_hulls_do_not_touch_each_other() -> None:
    x, P = hulls(3, 9)
    z = points_on(x, 10, 10)
    alone = [
        iekf.fit(x[k : k + 1], P[:1], z[k : k + 1, :6], np.ones((1, 6), bool), x[k : k + 1], RULES) for k in range(3)
    ]
    use = np.zeros((3, 10), bool)
    use[:, :6] = True
    both = iekf.fit(x, P, np.where(use[..., None], z, 1e3), use, x, RULES)
    for k in range(3):
        np.testing.assert_allclose(both.x[k], alone[k].x[0], atol=1e-9)
        assert both.log_likelihood[k] == pytest.approx(alone[k].log_likelihood[0], abs=1e-9)


def test_a_hull_whose_place_is_not_known_is_found_by_the_robust_start_alone() -> None:
    """A birth of 20 m standard deviation, 25 m off, seen from the south: the near side alone has points."""
    true, _ = contour.newborn(np.array([[15.0, 60.0, 0, 0, 0.4, 0]]), np.ones(6), RULES)
    corners = contour.polygon(true, RULES, 90)[0]
    near = corners[corners @ [0.0, 1.0] < 60.0]
    x, P = contour.newborn(np.zeros((1, 6)), np.array([20.0, 20.0, 3.0, 3.0, math.pi, math.pi / 4]), RULES)
    x[:, :2] = [0.0, 80.0]
    use = np.ones((1, len(near)), bool)
    miss = {}
    for start in ("robust", "predicted"):
        rules = replace(RULES, start=start)
        first = iekf.starts(x, P, near[None], use, np.zeros(2), 4, rules)
        got = iekf.fit(x, P, near[None], use, first, rules)
        miss[start] = float(np.hypot(*(got.x[0, :2] - true[0, :2])))
    assert miss["robust"] < 0.6
    assert miss["robust"] < 0.5 * miss["predicted"]


def test_a_point_on_the_centre_of_the_prediction_is_no_better_explained_than_one_beside_it() -> None:
    """A birth around a single point has its centre there, where the point has no bearing."""
    x, P = contour.newborn(np.zeros((2, 6)), np.array([20.0, 20.0, 3.0, 3.0, math.pi, math.pi / 4]), RULES)
    x[:, :2] = [[30.0, 20.0], [30.3, 20.0]]
    z, use = np.full((2, 1, 2), [30.0, 20.0]), np.ones((2, 1), bool)
    got = iekf.fit(x, P, z, use, iekf.starts(x, P, z, use, np.zeros(2), 4, RULES), RULES)
    assert got.log_likelihood[0] == pytest.approx(got.log_likelihood[1], abs=0.5)
    assert (np.linalg.eigvalsh(got.P[:, :2, :2])[:, 0] < 4.0).all()  # along the ray it is known by the outline


@pytest.mark.eq("extended-1")
def test_prediction_moves_the_outline_as_a_whole_and_forgets_towards_the_prior() -> None:
    rules = replace(RULES, forget_per_s=0.0)
    x, P = hulls(2, 3, rules)
    x[:, 5] = 0.0
    there, _ = contour.predict(x, P, np.full(2, 3.0), rules, 0.04)
    shift = 3.0 * x[:, None, 2:4]
    np.testing.assert_allclose(contour.polygon(there, rules), contour.polygon(x, rules) + shift, atol=1e-9)
    prior = contour.basis(RULES)
    late, P_late = contour.predict(x, P * 0.01, np.full(2, 1e5), RULES, 0.04)
    np.testing.assert_allclose(late[:, 6:], np.broadcast_to(prior.mean, (2, 9)), atol=1e-9)
    np.testing.assert_allclose(P_late[:, 6:, 6:], np.broadcast_to(prior.K, (2, 9, 9)), atol=1e-9)


def test_two_steps_of_prediction_are_one_of_both() -> None:
    x, P = hulls(2, 4)
    one = contour.predict(x, P, np.full(2, 2.5), RULES, 0.04)
    two = contour.predict(*contour.predict(x, P, np.full(2, 1.5), RULES, 0.04), np.full(2, 1.0), RULES, 0.04)
    np.testing.assert_allclose(one[0], two[0], atol=1e-9)
    np.testing.assert_allclose(one[1], two[1], atol=1e-9)


def test_turning_the_world_turns_the_fit() -> None:
    x, P = hulls(2, 11)
    z = points_on(x, 15, 12)
    use = np.ones(z.shape[:2], bool)
    c, s = math.cos(0.7), math.sin(0.7)
    turn = np.array([[c, -s], [s, c]])
    T = np.eye(x.shape[1])
    T[:2, :2] = T[2:4, 2:4] = turn
    x2 = x @ T.T
    x2[:, 4] += 0.7
    a = iekf.fit(x, P, z, use, x, RULES)
    b = iekf.fit(x2, T @ P @ T.T, z @ turn.T, use, x2, RULES)
    np.testing.assert_allclose(contour.polygon(b.x, RULES), contour.polygon(a.x, RULES) @ turn.T, atol=1e-6)
    np.testing.assert_allclose(a.log_likelihood, b.log_likelihood, atol=1e-6)


def test_the_ellipse_of_an_elliptic_outline_is_itself() -> None:
    rules = replace(RULES, angles=36)
    x, _ = contour.newborn(np.array([[3.0, -2, 0, 0, 0.6, 0]]), np.ones(6), rules)
    centre, X = contour.ellipse(contour.polygon(x, rules, 720))
    np.testing.assert_allclose(centre[0], [3.0, -2.0], atol=1e-6)
    values, vectors = np.linalg.eigh(X[0])
    np.testing.assert_allclose(np.sqrt(values), [1.5, 3.0], rtol=1e-3)
    assert abs(vectors[:, 1] @ [math.cos(0.6), math.sin(0.6)]) == pytest.approx(1.0, abs=1e-6)


def test_a_tangle_of_radii_has_a_least_radius() -> None:
    x, _ = hulls(1, 2)
    x[:, 6:] = -5.0
    corners = contour.polygon(x, RULES)
    assert np.linalg.norm(corners - x[:, None, :2], axis=-1) == pytest.approx(contour.LEAST_RADIUS_M)


@pytest.mark.parametrize("key", ["angles=3", "width_m=7", "length_m=0", "iterations=0"])
def test_settings_out_of_range_are_errors(key: str) -> None:
    name, _, value = key.partition("=")
    with pytest.raises(Exception, match=r"contour"):
        ContourConfig(**{name: int(value)})


def test_the_number_of_points_is_negative_binomial() -> None:
    """n! of their order apart: integrate a Poisson number over a gamma mean."""
    a, b = 6.0, 1.5
    n = np.arange(12)
    log_factorial = np.array([math.lgamma(k + 1) for k in n])
    got = rate.log_count(np.tile([a, b], (12, 1)), n.astype(float)) - log_factorial
    np.testing.assert_allclose(got, nbinom.logpmf(n, a, b / (b + 1)), atol=1e-9)
    assert rate.no_points(np.array([[a, b]]))[0] == pytest.approx(nbinom.pmf(0, a, b / (b + 1)))


def test_prediction_of_the_rate_keeps_its_mean_and_widens_it() -> None:
    start = np.array([[20.0, 2.0]])
    there = rate.predict(start, 20.0)
    assert there[0, 0] / there[0, 1] == pytest.approx(10.0)
    assert there[0, 0] / there[0, 1] ** 2 > start[0, 0] / start[0, 1] ** 2
    for _ in range(500):
        start = rate.update(rate.predict(start, 20.0), np.array([7.0]))
    assert start[0] == pytest.approx([140.0, 20.0], rel=1e-6)


def test_a_miss_that_says_nothing_leaves_the_rate_alone_and_one_in_sight_lowers_it() -> None:
    start = np.array([[2.0, 0.5], [2.0, 0.5]])
    q, after = rate.missed(start, np.array([0.0, 1.0]))
    assert q[0] == 1.0 and after[0].tolist() == start[0].tolist()
    assert q[1] == pytest.approx(rate.no_points(start)[1]) and after[1] == pytest.approx([2.0, 1.5])
