"""Hard association on pair lists against what it says, done slowly."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from maritrack.associate.hard import assign, best_per_track, greedy, nearest_track, optimal
from maritrack.types import BoolArray, FloatArray, IntArray

Problem = tuple[IntArray, IntArray, FloatArray]
law = settings(derandomize=True, deadline=None, max_examples=60)
seeds = st.integers(0, 10_000)


def problem(seed: int, n_tracks: int = 6, n_measurements: int = 6, share: float = 0.5) -> Problem:
    """A random list of pairs in random order, costs of any sign, some of them equal."""
    rng = np.random.default_rng(seed)
    i, j = np.nonzero(rng.random((n_tracks, n_measurements)) < share)
    shuffled = rng.permutation(len(i))
    return i[shuffled], j[shuffled], np.round(rng.normal(0, 20, len(i)), rng.integers(0, 3))


def one_by_one(i: IntArray, j: IntArray, cost: FloatArray) -> BoolArray:
    """Ascending, each pair if both are free."""
    taken, busy = np.zeros(len(i), bool), set()
    for k in sorted(range(len(i)), key=lambda k: (cost[k], i[k], j[k])):
        if not {("t", i[k]), ("m", j[k])} & busy:
            taken[k] = True
            busy |= {("t", i[k]), ("m", j[k])}
    return taken


def best_sum(i: IntArray, j: IntArray, cost: FloatArray) -> tuple[int, float]:
    """Most pairs, and the least sum of costs of that many, over all subsets."""
    best = (0, 0.0)
    for subset in product([False, True], repeat=len(i)):
        chosen = np.array(subset, bool)
        if len(set(i[chosen])) == len(set(j[chosen])) == chosen.sum():
            best = min(best, (-int(chosen.sum()), float(cost[chosen].sum())))
    return -best[0], best[1]


@law
@given(seeds, st.integers(0, 40), st.integers(0, 40))
def test_greedy_takes_pairs_one_by_one_in_the_order_of_their_cost(seed: int, n: int, m: int) -> None:
    pairs = problem(seed, n, m, 0.2)
    assert_array_equal(greedy(*pairs), one_by_one(*pairs))


def test_a_chain_of_rising_costs_is_taken_every_second() -> None:
    """The longest way for rounds: each pair shuts out the next."""
    n = 200
    i, j = np.arange(n) // 2, (np.arange(n) + 1) // 2
    assert_array_equal(greedy(i, j, np.arange(n, dtype=float)), np.arange(n) % 2 == 0)


@law
@given(seeds)
def test_optimal_is_the_best_of_all_assignments(seed: int) -> None:
    i, j, cost = problem(seed, 4, 4, 0.6)
    i, j, cost = i[:9], j[:9], cost[:9]
    taken = optimal(i, j, cost)
    count, total = best_sum(i, j, cost)
    assert taken.sum() == count
    assert float(cost[taken].sum()) == pytest.approx(total, abs=1e-9)


@law
@given(seeds, st.floats(0.1, 0.9))
def test_optimal_is_never_behind_greedy(seed: int, share: float) -> None:
    i, j, cost = problem(seed, 15, 12, share)
    best, quick = optimal(i, j, cost), greedy(i, j, cost)
    assert best.sum() >= quick.sum()
    if best.sum() == quick.sum():
        assert cost[best].sum() <= cost[quick].sum() + 1e-9


def test_optimal_lets_a_track_step_aside_where_greedy_does_not() -> None:
    """Two tracks want the first measurement; only the first track can take another."""
    i, j, cost = np.array([0, 0, 1]), np.array([0, 1, 0]), np.array([1.0, 3.0, 2.0])
    assert greedy(i, j, cost).tolist() == [True, False, False]
    assert optimal(i, j, cost).tolist() == [False, True, True]
    assert assign(i, j, cost, how="greedy").tolist() == [True, False, False]
    assert assign(i, j, cost, how="optimal").tolist() == [False, True, True]


@law
@given(seeds)
def test_each_measurement_goes_to_its_nearest_track(seed: int) -> None:
    i, j, cost = problem(seed)
    taken = nearest_track(i, j, cost)
    for m in set(j.tolist()):
        mine = np.flatnonzero(j == m)
        assert np.flatnonzero(taken & (j == m)).tolist() == [min(mine, key=lambda k: (cost[k], i[k]))]


@law
@given(seeds, st.integers(1, 4))
def test_each_track_keeps_its_cheapest_pairs(seed: int, most: int) -> None:
    i, j, cost = problem(seed)
    cost = cost + 1e-3 * j  # no ties
    taken = best_per_track(i, cost, most)
    for t in set(i.tolist()):
        mine = i == t
        assert_array_equal(np.sort(cost[taken & mine]), np.sort(cost[mine])[:most])


@pytest.mark.parametrize("how", [greedy, optimal, nearest_track])
@law
@given(seed=seeds)
def test_the_order_of_the_pairs_does_not_matter(how: Callable[..., BoolArray], seed: int) -> None:
    i, j, cost = problem(seed)
    cost = cost + np.random.default_rng(seed).normal(0, 1e-3, len(cost))
    turn = np.random.default_rng(seed + 1).permutation(len(i))
    assert_array_equal(how(i[turn], j[turn], cost[turn]), how(i, j, cost)[turn])


@pytest.mark.parametrize("how", [greedy, optimal])
@law
@given(seed=seeds, shift=st.floats(-1e6, 1e6))
def test_a_constant_on_all_costs_changes_nothing(how: Callable[..., BoolArray], seed: int, shift: float) -> None:
    i, j, cost = problem(seed)
    cost = cost + np.random.default_rng(seed).normal(0, 1.0, len(cost))
    assert_array_equal(how(i, j, cost + shift), how(i, j, cost))


def test_without_pairs_nothing_is_taken() -> None:
    none = np.zeros(0, np.int64)
    for taken in (greedy(none, none, np.zeros(0)), optimal(none, none, np.zeros(0)),
                  nearest_track(none, none, np.zeros(0)), best_per_track(none, np.zeros(0), 3)):  # fmt: skip
        assert taken.dtype == bool and len(taken) == 0
