"""What holds for every joint association: probabilities, brute force, symmetries."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose

from maritrack.associate import joint_marginals
from maritrack.associate.marginals import sparse_marginals
from maritrack.associate.matchings import frontier, row_order
from maritrack.types import FloatArray
from tests.oracles import joint_event_existence, joint_event_marginals

EXACT = 1e-12
law = settings(derandomize=True, deadline=None, max_examples=60)


@st.composite
def tables(draw: Any, tracks: int = 4, measurements: int = 5, size: float = 8.0) -> FloatArray:
    """Log weights (t, m), -inf where a pair is not possible."""
    shape = draw(st.tuples(st.integers(1, tracks), st.integers(1, measurements)))
    values = draw(arrays(np.float64, shape, elements=st.floats(-size, size)))
    possible = draw(arrays(np.bool_, shape, elements=st.sampled_from([True, True, False])))
    return np.where(possible, values, -np.inf)


def marginals(log_weight: FloatArray, log_missed: FloatArray, limit: int = 12) -> FloatArray:
    """Association probabilities (t, 1 + m) of a table."""
    track, measurement = np.nonzero(log_weight > -np.inf)
    pairs, missed, _ = sparse_marginals(
        track, measurement, log_weight[track, measurement], log_missed, *log_weight.shape, exact_limit=limit
    )
    beta = np.hstack([missed[:, None], np.zeros_like(log_weight)])
    beta[track, 1 + measurement] = pairs
    return beta


def random_table(rng: np.random.Generator, n: int, m: int, share: float = 1.0, size: float = 3.0) -> FloatArray:
    return np.where(rng.random((n, m)) < share, rng.normal(0.0, size, (n, m)), -np.inf)


@law
@given(tables(), st.floats(-10.0, 0.0))
def test_jpda_marginals_equal_brute_force(log_weight: FloatArray, missed: float) -> None:
    log_missed = np.full(len(log_weight), missed)
    expected = joint_event_marginals(np.exp(log_missed), np.exp(log_weight))
    assert_allclose(marginals(log_weight, log_missed), expected, atol=EXACT)


@law
@given(tables(size=500.0))
def test_weights_far_beyond_a_double_product_equal_brute_force(log_weight: FloatArray) -> None:
    wide = np.exp(log_weight.astype(np.longdouble))
    expected = joint_event_marginals(np.ones(len(wide), dtype=np.longdouble), wide)
    assert_allclose(marginals(log_weight, np.zeros(len(wide))), expected.astype(float), atol=1e-11)


@law
@given(tables(), st.data())
def test_jipda_existence_equals_brute_force(log_weight: FloatArray, data: Any) -> None:
    r = data.draw(arrays(np.float64, len(log_weight), elements=st.floats(0.0, 1.0)))
    N = np.exp(log_weight)
    ours = joint_marginals(N, N > 0, p_detect=0.8, p_gate=0.97, clutter_density=0.5, existence=r)
    expected = joint_event_marginals(1 - 0.8 * 0.97 * r, 0.8 * r[:, None] * N / 0.5)
    assert_allclose(ours.beta, expected, atol=EXACT)
    assert_allclose(ours.existence, joint_event_existence(expected, r, 0.8, 0.97), atol=EXACT)


@law
@given(tables(6, 7))
def test_frontier_elimination_equals_brute_force(log_psi: FloatArray) -> None:
    log_psi = log_psi[:5, (log_psi[:5] > -np.inf).any(axis=0)]
    if log_psi.size:
        expected = joint_event_marginals(np.ones(len(log_psi)), np.exp(log_psi))
        assert_allclose(frontier(log_psi, row_order(log_psi)[0]), expected[:, 1:], atol=EXACT)


@law
@given(tables(9, 9, size=30.0))
def test_rows_sum_to_one_and_columns_to_no_more(log_weight: FloatArray) -> None:
    beta = marginals(log_weight, np.zeros(len(log_weight)))
    assert beta.min() >= 0.0
    assert_allclose(beta.sum(axis=1), 1.0, rtol=EXACT)
    assert beta[:, 1:].sum(axis=0).max() <= 1.0 + EXACT


@law
@given(tables())
def test_jipda_of_certain_tracks_is_jpda(log_weight: FloatArray) -> None:
    N = np.exp(log_weight)
    ours = joint_marginals(N, N > 0, p_detect=0.9, p_gate=0.99, clutter_density=1.0, existence=np.ones(len(N)))
    expected = joint_event_marginals(np.full(len(N), 1 - 0.9 * 0.99), 0.9 * N)
    assert_allclose(ours.existence, 1.0, rtol=EXACT)
    assert_allclose(ours.beta_given_existence, expected, atol=EXACT)


@law
@given(tables(), st.floats(-3e5, 3e5))
def test_a_common_factor_of_all_weights_of_a_track_does_not_matter(log_weight: FloatArray, factor: float) -> None:
    log_missed = np.full(len(log_weight), -1.0)
    shift = factor * np.arange(len(log_weight))
    shifted = marginals(log_weight + shift[:, None], log_missed + shift)
    assert_allclose(shifted, marginals(log_weight, log_missed), atol=1e-8)  # rounding of 9e5 + x


@pytest.mark.parametrize(("n", "m", "share"), [(6, 8, 0.5), (9, 30, 0.2), (11, 13, 0.6), (40, 60, 0.05)])
def test_the_order_of_tracks_and_measurements_does_not_matter(n: int, m: int, share: float) -> None:
    rng = np.random.default_rng(n)
    table, missed = random_table(rng, n, m, share), rng.uniform(-3.0, 0.0, n)
    rows, cols = rng.permutation(n), rng.permutation(m)
    beta = marginals(table, missed)
    turned = marginals(table[rows][:, cols], missed[rows])
    assert_allclose(turned[:, 0], beta[rows, 0], atol=EXACT)
    assert_allclose(turned[:, 1:], beta[rows][:, 1 + cols], atol=EXACT)


@pytest.mark.parametrize(("n", "m"), [(3, 7), (12, 14), (5, 30)])
def test_tracks_and_measurements_can_change_roles(n: int, m: int) -> None:
    table = random_table(np.random.default_rng(m), n, m)
    upright = marginals(table, np.zeros(n))[:, 1:]
    assert_allclose(marginals(table.T, np.zeros(m))[:, 1:].T, upright, atol=EXACT)


@pytest.mark.parametrize(("n", "m"), [(4, 9), (8, 11), (12, 14)])
def test_elimination_over_tracks_equals_that_over_measurements(n: int, m: int) -> None:
    table = random_table(np.random.default_rng(m), n, m, share=0.8)
    over_measurements = frontier(table.T, row_order(table.T)[0]).T
    assert_allclose(frontier(table, row_order(table)[0]), over_measurements, atol=EXACT)


def test_a_detour_over_a_thirteenth_track_changes_nothing() -> None:
    """Twelve tracks against more measurements: a track that hardly sees any leaves them as they were."""
    table = random_table(np.random.default_rng(5), 12, 14)
    with_more = np.vstack([table, np.full((1, 14), -60.0)])
    expected = marginals(table, np.zeros(12))
    assert_allclose(marginals(with_more, np.zeros(13), limit=13)[:12], expected, atol=EXACT)


@pytest.mark.parametrize("seed", range(20))
def test_belief_propagation_is_near_the_exact_marginals(seed: int) -> None:
    rng = np.random.default_rng(seed)
    table = random_table(rng, int(rng.integers(3, 9)), int(rng.integers(3, 9)), share=0.6, size=2.0)
    missed = np.log(rng.uniform(0.2, 0.8, len(table)))
    assert_allclose(marginals(table, missed, limit=0), marginals(table, missed), atol=0.1)


@law
@given(tables(8, 8, size=100.0))
def test_belief_propagation_gives_probabilities(log_weight: FloatArray) -> None:
    beta = marginals(log_weight, np.zeros(len(log_weight)), limit=0)
    assert beta.min() >= 0.0
    assert_allclose(beta.sum(axis=1), 1.0, rtol=EXACT)
    assert beta[:, 1:].sum(axis=0).max() <= 1.0 + 1e-3
