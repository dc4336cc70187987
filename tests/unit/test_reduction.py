"""Reduction of mixtures: what a merged component keeps, who is merged with whom."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import sqrtm
from scipy.optimize import brentq
from scipy.special import digamma, gammaln
from scipy.stats import invwishart

from maritrack.objects import reduction
from maritrack.objects.giw import Giw

law = settings(derandomize=True, deadline=None, max_examples=60)


def spd(rng: np.random.Generator, n: int, least: float, most: float) -> np.ndarray:
    angle = rng.uniform(0, np.pi, n)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)
    return np.asarray(
        turn @ (np.exp(rng.uniform(np.log(least), np.log(most), (n, 2)))[:, :, None] * turn.transpose(0, 2, 1))
    )


def mixture(seed: int, n: int, *, spread_m: float = 40.0) -> Giw:
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, 4, 4)) * np.array([10.0, 10.0, 2.0, 2.0])[:, None]
    return Giw(
        rng.normal(size=(n, 4)) * np.array([spread_m, spread_m, 3.0, 3.0]),
        A @ A.transpose(0, 2, 1) + np.diag([25.0, 25.0, 1.0, 1.0]),
        spd(rng, n, 25.0, 1e4),
        rng.uniform(2.5, 60.0, n),
    )


def all_in_one(n: int) -> np.ndarray:
    return np.zeros(n, np.int64)


def weights(seed: int, n: int) -> np.ndarray:
    return np.sort(np.random.default_rng(seed + 1).uniform(0.001, 2.0, n))[::-1]


def mean_inverse_and_log_det(X: np.ndarray, alpha: float) -> tuple[np.ndarray, float]:
    """E[X^-1] and E[log|X|] of an inverse Wishart in the textbook's nu and V."""
    nu, V = alpha + 6.0, alpha * X
    psi = digamma((nu - 3) / 2) + digamma((nu - 4) / 2)
    return (nu - 3) * np.linalg.inv(V), math.log(np.linalg.det(V)) - 2 * math.log(2) - psi


def test_a_component_alone_stays_itself_to_the_last_bit() -> None:
    d, log_w = mixture(1, 5), np.log(weights(1, 5))
    merged, log_merged = reduction.merge(d, log_w, np.arange(5))
    d = Giw(d.x, (d.P + d.P.transpose(0, 2, 1)) / 2, d.X, d.alpha)
    for name in ("x", "P", "X", "alpha"):
        assert_array_equal(getattr(merged, name), getattr(d, name))
    assert_array_equal(log_merged, log_w)


@law
@given(st.integers(0, 10_000), st.integers(2, 6))
def test_components_that_are_the_same_are_that_component_with_all_their_weight(seed: int, n: int) -> None:
    one, w = mixture(seed, 1), weights(seed, n)
    d = Giw(*(np.repeat(getattr(one, name), n, axis=0) for name in ("x", "P", "X", "alpha")))
    merged, log_w = reduction.merge(d, np.log(w), all_in_one(n))
    assert_allclose(np.exp(log_w), [w.sum()], rtol=1e-12)
    assert_array_equal(merged.X, one.X)
    assert_array_equal(merged.alpha, one.alpha)
    assert_allclose(merged.x, one.x, rtol=1e-12)
    assert_allclose(merged.P, one.P, rtol=1e-12)


@law
@given(st.integers(0, 10_000), st.integers(2, 6))
def test_weight_mean_and_covariance_of_the_mixture_are_kept(seed: int, n: int) -> None:
    d, w = mixture(seed, n), weights(seed, n)
    merged, log_w = reduction.merge(d, np.log(w), all_in_one(n))
    p = w / w.sum()
    mean = sum(p[i] * d.x[i] for i in range(n))
    P = sum(p[i] * (d.P[i] + np.outer(d.x[i] - mean, d.x[i] - mean)) for i in range(n))
    assert_allclose(np.exp(log_w), [w.sum()], rtol=1e-12)
    assert_allclose(merged.x[0], mean, rtol=1e-9, atol=1e-9)
    assert_allclose(merged.P[0], P, rtol=1e-9, atol=1e-9)


@law
@given(st.integers(0, 10_000), st.integers(2, 6))
def test_mean_inverse_and_mean_log_determinant_of_the_extent_are_kept(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    w, near = weights(seed, n), spd(rng, 1, 100.0, 2500.0)
    X = near * rng.uniform(0.8, 1.25, (n, 1, 1))  # alike, as merged ones are
    alpha = rng.uniform(8.0, 60.0, n)
    p = w / w.sum()
    X1, alpha1 = reduction.merge_extents(X, alpha, p, all_in_one(n))
    given_one = [mean_inverse_and_log_det(X[i], alpha[i]) for i in range(n)]
    inverse, log_det = mean_inverse_and_log_det(X1[0], float(alpha1[0]))
    assert_allclose(inverse, sum(p[i] * given_one[i][0] for i in range(n)), rtol=1e-8)
    assert_allclose(log_det, sum(p[i] * given_one[i][1] for i in range(n)), rtol=1e-8)
    assert alpha1[0] <= alpha.max() + 1e-9


def test_the_moments_kept_are_those_of_samples() -> None:
    X, alpha, p = np.array([[[400.0, 50.0], [50.0, 90.0]], [[300.0, 0.0], [0.0, 140.0]]]), np.array([20.0, 9.0]), 0.7
    X1, alpha1 = reduction.merge_extents(X, alpha, np.array([p, 1 - p]), all_in_one(2))
    rng = np.random.default_rng(0)

    def sampled(Y: np.ndarray, a: float, n: int) -> np.ndarray:
        return np.asarray(invwishart(df=a + 3.0, scale=a * Y).rvs(n, random_state=rng))

    n = 40_000
    mixed = np.concatenate([sampled(X[0], 20.0, int(p * n)), sampled(X[1], 9.0, n - int(p * n))])
    merged = sampled(X1[0], float(alpha1[0]), n)
    assert_allclose(np.linalg.inv(merged).mean(0), np.linalg.inv(mixed).mean(0), rtol=0.03, atol=1e-4)
    assert_allclose(np.log(np.linalg.det(merged)).mean(), np.log(np.linalg.det(mixed)).mean(), atol=0.03)


@law
@given(st.integers(0, 10_000), st.integers(2, 5))
def test_the_merged_extent_is_the_root_of_the_equation_solved_alone(seed: int, n: int) -> None:
    """The equation as Granstroem and Orguner write it, with weights that don't add up to one."""
    d, w = mixture(seed, n), weights(seed, n)
    nu, V, W = d.alpha + 6.0, d.alpha[:, None, None] * d.X, w.sum()
    C1 = sum(w[i] * (nu[i] - 3) * np.linalg.inv(V[i]) for i in range(n))
    C2 = sum(w[i] * (digamma((nu[i] - 3) / 2) + digamma((nu[i] - 4) / 2)) for i in range(n))
    C3 = sum(w[i] * math.log(np.linalg.det(V[i])) for i in range(n))

    def h(v: float) -> float:
        left = W * (2 * math.log(v - 3) - digamma((v - 3) / 2) - digamma((v - 4) / 2))
        return float(left + 2 * W * math.log(W) - W * math.log(np.linalg.det(C1)) + C2 - C3)

    root = brentq(h, 4 + 1e-9, nu.max() + 1, xtol=1e-12)
    merged, _ = reduction.merge(d, np.log(w), all_in_one(n))
    if root < 8.0:
        assert_allclose(merged.alpha, 2.0)
        assert_allclose(merged.X[0], sum(w[i] * d.X[i] for i in range(n)) / W, rtol=1e-9)
    else:
        assert_allclose(merged.alpha[0] + 6.0, root, rtol=1e-8)
        assert_allclose(merged.X[0], (root - 3) * W * np.linalg.inv(C1) / (root - 6), rtol=1e-6)


def test_solving_finds_the_number_it_began_with_from_nearly_one_to_a_thousand() -> None:
    a = np.concatenate([1.0 + np.geomspace(1e-6, 1.0, 20), np.geomspace(2.0, 1e3, 30)])
    target = 2 * np.log(a) - digamma(a / 2) - digamma((a - 1) / 2)
    assert_allclose(reduction.solve_spread(target, a + 1.0), a, rtol=1e-7)
    assert_allclose(reduction.solve_spread(target, np.full_like(a, 2e3)), a, rtol=1e-7)


@law
@given(st.integers(0, 10_000))
def test_groups_merge_as_they_would_alone(seed: int) -> None:
    rng, n = np.random.default_rng(seed), 9
    d, log_w, into = mixture(seed, n), np.log(weights(seed, n)), np.arange(n)
    for k in range(1, n):
        into[k] = rng.choice(np.unique(into[:k])) if rng.random() < 0.6 else k
    merged, log_merged = reduction.merge(d, log_w, into)
    for g, lead in enumerate(np.unique(into)):
        rows = np.flatnonzero(into == lead)
        part = Giw(d.x[rows], d.P[rows], d.X[rows], d.alpha[rows])
        alone, log_alone = reduction.merge(part, log_w[rows], all_in_one(len(rows)))
        assert_allclose(log_merged[g], log_alone[0], rtol=1e-12, atol=1e-12)
        for name in ("x", "P", "X", "alpha"):
            assert_allclose(getattr(merged, name)[g], getattr(alone, name)[0], rtol=1e-8, atol=1e-9)


def test_weights_far_below_the_smallest_number_merge_as_well() -> None:
    d, log_w = mixture(3, 3), np.array([-2000.0, -2001.0, -2003.0])
    merged, log_merged = reduction.merge(d, log_w, all_in_one(3))
    same, _ = reduction.merge(d, log_w + 2000.0, all_in_one(3))
    assert_allclose(log_merged, -2000.0 + math.log(1 + math.exp(-1) + math.exp(-3)), rtol=1e-12)
    assert_allclose(merged.X, same.X, rtol=1e-12)


def test_points_keep_no_extent() -> None:
    d = mixture(4, 3)
    points = Giw(d.x, d.P, np.zeros((3, 2, 2)), d.alpha)
    merged, _ = reduction.merge(points, np.log(weights(4, 3)), all_in_one(3))
    assert_array_equal(merged.X, np.zeros((1, 2, 2)))


@law
@given(st.integers(0, 10_000), st.integers(0, 14), st.floats(0, 1))
def test_leaders_are_those_of_the_greedy_loop(seed: int, n: int, density: float) -> None:
    rng = np.random.default_rng(seed)
    like = np.triu(rng.random((n, n)) < density, 1)
    into = [-1] * n
    for a in range(n):
        if into[a] < 0:
            into[a] = a
            for b in range(a + 1, n):
                if into[b] < 0 and like[a, b]:
                    into[b] = a
    i, j = np.nonzero(like)
    shuffled = rng.permutation(len(i))
    assert reduction.leaders(i[shuffled], j[shuffled], n).tolist() == into


@law
@given(st.integers(0, 10_000), st.integers(0, 12), st.floats(0.5, 30))
def test_near_pairs_are_those_of_the_plain_loop(seed: int, n: int, limit: float) -> None:
    d = mixture(seed, n, spread_m=15.0)
    i, j = reduction.near_pairs(d, limit)
    plain = []
    for a in range(n):
        for b in range(a + 1, n):
            gap = d.x[a] - d.x[b]
            if gap @ np.linalg.inv(d.P[a]) @ gap < limit:
                plain.append((a, b))
    assert sorted(zip(i.tolist(), j.tolist(), strict=True)) == plain


@law
@given(st.integers(0, 10_000), st.integers(0, 12), st.floats(0.5, 30))
def test_pairs_of_a_hull_are_those_of_the_plain_loop(seed: int, n: int, limit: float) -> None:
    d = mixture(seed, n)
    expected = []
    for i in range(n):
        for j in range(i + 1, n):
            gap = d.x[i] - d.x[j]
            place = gap[:2] @ np.linalg.inv(d.P[i, :2, :2] + 0.25 * d.X[i]) @ gap[:2]
            if place + gap[2:] @ np.linalg.inv(d.P[i, 2:, 2:] + d.P[j, 2:, 2:]) @ gap[2:] < limit:
                expected.append((i, j))
    i, j = reduction.near_pairs(d, limit, hull=0.25 * d.X)
    assert sorted(zip(i.tolist(), j.tolist(), strict=True)) == expected


@law
@given(st.integers(0, 10_000))
def test_gauss_wasserstein_is_the_formula_with_matrix_roots(seed: int) -> None:
    A, B = spd(np.random.default_rng(seed), 2, 25.0, 1e4)
    root = sqrtm(A).real
    plain = np.trace(A) + np.trace(B) - 2 * np.trace(sqrtm(root @ B @ root).real)
    assert_allclose(reduction.gauss_wasserstein2(A[None], B[None]), [plain], rtol=1e-7, atol=1e-6)
    assert_allclose(reduction.gauss_wasserstein2(A[None], A[None]), [0.0], atol=1e-8)


def test_gauss_wasserstein_of_the_same_directions_is_the_distance_of_the_axes() -> None:
    A, B = np.diag([40.0**2, 10.0**2])[None], np.diag([43.0**2, 6.0**2])[None]
    assert_allclose(reduction.gauss_wasserstein2(A, B), [25.0])


def one_way_kl(X1: np.ndarray, alpha1: float, X2: np.ndarray, alpha2: float) -> float:
    """KL(1||2) as the textbook has it, with all its gamma functions."""
    n1, n2, V1, V2 = alpha1 + 6, alpha2 + 6, alpha1 * X1, alpha2 * X2

    def log_gamma2(a: float) -> float:
        return float(math.log(math.pi) / 2 + gammaln(a) + gammaln(a - 0.5))

    M = np.linalg.inv(V1) @ V2
    gamma = log_gamma2((n2 - 3) / 2) - log_gamma2((n1 - 3) / 2)
    psi = digamma((n1 - 4) / 2) + digamma((n1 - 3) / 2)
    scatter = (n1 - 3) / 2 * np.trace(M) - (n1 - 3) - (n2 - 3) / 2 * math.log(np.linalg.det(M))
    return float(gamma + scatter - (n2 - n1) / 2 * psi)


@law
@given(st.integers(0, 10_000), st.floats(2.1, 80), st.floats(2.1, 80))
def test_symmetric_kl_is_the_sum_of_both_ways(seed: int, a: float, b: float) -> None:
    A, B = spd(np.random.default_rng(seed), 2, 25.0, 1e4)
    both = one_way_kl(A, a, B, b) + one_way_kl(B, b, A, a)
    one = reduction.symmetric_kl(A[None], np.array([a]), B[None], np.array([b]))
    assert_allclose(one, [both], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("alpha", "other", "grown", "divergence"), [(60, 4, 1.0, 22.7), (60, 10, 1.0, 6.7), (60, 60, 1.5, 10.5)]
)
def test_symmetric_kl_compares_certainty_as_well(alpha: float, other: float, grown: float, divergence: float) -> None:
    X = np.diag([900.0, 100.0])[None]
    kl = reduction.symmetric_kl(X, np.array([float(alpha)]), X * grown, np.array([float(other)]))
    assert_allclose(kl, [divergence], atol=0.06)


def test_nothing_merges_with_nothing() -> None:
    d = mixture(0, 0)
    merged, log_w = reduction.merge(d, np.zeros(0), np.zeros(0, np.int64))
    assert len(merged) == len(log_w) == len(reduction.near_pairs(d, 4.0)[0]) == 0
    assert len(reduction.leaders(np.zeros(0, int), np.zeros(0, int), 0)) == 0
