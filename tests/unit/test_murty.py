"""The k best pairings against all of them, one by one."""

from __future__ import annotations

import tracemalloc
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from maritrack.associate.marginals import sparse_marginals
from maritrack.associate.murty import k_best, murty_marginals
from maritrack.types import FloatArray


def table(n_rows: int, n_cols: int, seed: int, *, gaps: float = 0.3) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    pair = rng.normal(0.0, 3.0, (n_rows, n_cols))
    pair[rng.random(pair.shape) < gaps] = -np.inf
    return pair, rng.normal(0.0, 1.0, n_rows)


def all_gains(pair: FloatArray, none: FloatArray) -> list[tuple[float, tuple[int, ...]]]:
    """Every pairing with its gain, best first."""
    found = []
    for event in product(range(-1, pair.shape[1]), repeat=len(pair)):
        taken = [j for j in event if j >= 0]
        gain = sum(none[i] if j < 0 else pair[i, j] for i, j in enumerate(event))
        if len(taken) == len(set(taken)) and np.isfinite(gain):
            found.append((float(gain), event))
    return sorted(found, reverse=True)


@given(st.integers(1, 4), st.integers(0, 4), st.integers(0, 999), st.integers(1, 60))
@settings(derandomize=True, deadline=None, max_examples=120)
def test_they_are_the_best_in_order_and_each_comes_once(n_rows: int, n_cols: int, seed: int, k: int) -> None:
    pair, none = table(n_rows, n_cols, seed)
    expected = all_gains(pair, none)[:k]
    best = k_best(pair, none, k)
    assert_allclose(best.gain, [gain for gain, _ in expected], atol=1e-9)
    events = [tuple(row) for row in best.column.tolist()]
    assert len(set(events)) == len(events)
    for (gain, _), event in zip(expected, events, strict=True):  # ties may come in another order
        own = sum(none[i] if j < 0 else pair[i, j] for i, j in enumerate(event))
        assert own == pytest.approx(gain, abs=1e-9)


def test_none_of_nothing_and_nothing_of_no_rows() -> None:
    assert k_best(np.zeros((0, 3)), np.zeros(0), 5).column.shape == (1, 0)
    assert len(k_best(np.zeros((2, 2)), np.zeros(2), 0).gain) == 0


@given(st.integers(2, 4), st.integers(2, 5), st.integers(0, 999))
@settings(derandomize=True, deadline=None, max_examples=60)
def test_with_all_events_the_marginals_are_exact_and_with_few_they_are_near(n: int, m: int, seed: int) -> None:
    pair, none = table(n, m, seed, gaps=0.2)
    track, measurement = np.nonzero(np.isfinite(pair))
    weights = pair[track, measurement]
    exact = sparse_marginals(track, measurement, weights, none, n, m)
    all_events = sparse_marginals(track, measurement, weights, none, n, m, exact_limit=0, murty=100_000)
    assert_allclose(all_events[0], exact[0], atol=1e-9)
    assert_allclose(all_events[1], exact[1], atol=1e-9)
    few = sparse_marginals(track, measurement, weights, none, n, m, exact_limit=0, murty=40)
    assert_allclose(few[0], exact[0], atol=0.2)


def test_what_waits_holds_no_tables_and_a_large_group_gets_fewer_events() -> None:
    pair, none = table(40, 45, 1, gaps=0.0)
    tracemalloc.start()
    assert len(k_best(pair, none, 100).gain) == 100
    assert tracemalloc.get_traced_memory()[1] < 10e6
    tracemalloc.stop()
    track, measurement = np.nonzero(np.isfinite(pair))
    few = sparse_marginals(track, measurement, pair[track, measurement], none, 40, 45, exact_limit=0, murty=10**9)
    assert_allclose(np.bincount(track, few[0]) + few[1], 1.0)
    assert few[2] == 1


def test_one_event_is_the_best_assignment() -> None:
    pair = np.array([[2.0, 1.0], [1.5, -1.0]])
    assert_allclose(murty_marginals(pair, 1), [[0.0, 1.0], [1.0, 0.0]])
