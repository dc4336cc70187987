"""Laws of stochastic optimisation: its weights by brute force, and how often it finds the best association."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from maritrack.associate import sampling
from maritrack.associate.sampling import Slots
from maritrack.types import FloatArray

LOG_KAPPA = math.log(2e-3)


def problem(seed: int, n_points: int, n_slots: int, spread: float = 6.0) -> tuple[Slots, FloatArray]:
    """Objects at unknown places in the plane, points about them or stray; not all points may be of all objects."""
    rng = np.random.default_rng(seed)
    at = rng.normal(0, spread, (n_slots, 2))
    of = rng.integers(-1, n_slots, n_points)
    z = np.where(of[:, None] >= 0, at[of] + rng.normal(0, 1.5, (n_points, 2)), rng.uniform(-15, 15, (n_points, 2)))
    A = np.zeros((n_slots, n_points, 2, 3))
    A[..., 0, 0] = A[..., 1, 1] = 1.0 / 1.5
    A[..., 2] = rng.normal(0, 0.2, (n_slots, n_points, 2))
    prior = at + rng.normal(0, 2.0, at.shape)
    y = (z[None] - prior[:, None]) / 1.5
    log_noise = np.full((n_slots, n_points), -math.log(2 * math.pi * 1.5**2) - LOG_KAPPA)
    log_noise[rng.random((n_slots, n_points)) < 0.1] = -np.inf
    info = np.broadcast_to(np.diag([0.25, 0.25, 4.0]), (n_slots, 3, 3)).copy()
    rate = np.column_stack([rng.uniform(4, 12, n_slots), rng.uniform(1, 3, n_slots)])
    return Slots(A, y, log_noise, info, rng.normal(0.0, 1.0, n_slots), rate), z


def weight(slots: Slots, state: tuple[int, ...]) -> float:
    """Log weight of an association as a joint Gaussian of all points of each object, by its covariance."""
    total = 0.0
    for s in range(len(slots.log_base)):
        mine = [i for i, slot in enumerate(state) if slot == s]
        if not mine:
            continue
        A = slots.A[s, mine].reshape(-1, 3)
        S = A @ np.linalg.inv(slots.info[s]) @ A.T + np.eye(len(A))
        y = slots.y[s, mine].ravel()
        a, b = slots.rate[s]
        n = len(mine)
        number = math.lgamma(a + n) - math.lgamma(a) + a * math.log(b) - (a + n) * math.log(b + 1)
        total += slots.log_base[s] + number + slots.log_point[s, mine].sum()
        total -= 0.5 * (y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1])
    return float(total)


@pytest.mark.parametrize("seed", range(5))
def test_the_weight_of_a_set_of_points_is_that_of_their_joint_density(seed: int) -> None:
    slots, _ = problem(seed, 7, 3)
    rng = np.random.default_rng(seed)
    state = rng.integers(-1, 3, 7)
    state = np.where([s >= 0 and np.isneginf(slots.log_point[s, i]) for i, s in enumerate(state)], -1, state)
    masks = state == np.arange(3)[:, None]
    got = sampling.totals(slots, np.arange(3), masks).sum()
    assert got == pytest.approx(weight(slots, tuple(state.tolist())), abs=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_what_a_point_adds_is_the_difference_of_the_weights_with_and_without_it(seed: int) -> None:
    slots, _ = problem(seed, 6, 2)
    rng = np.random.default_rng(seed + 100)
    masks = (rng.random((2, 6)) < 0.5) & np.isfinite(slots.log_point)
    first = np.flatnonzero(np.isfinite(slots.log_point[0]))[0]
    masks[0] = np.arange(6) == first  # one point alone: it has no others
    got = sampling.gains(slots, np.arange(2), masks)
    for s, i in itertools.product(range(2), range(6)):
        if np.isneginf(slots.log_point[s, i]):
            assert np.isneginf(got[s, i])
            continue
        with_it, without = masks.copy(), masks.copy()
        with_it[s, i], without[s, i] = True, False
        expected = sampling.totals(slots, np.arange(2), with_it) - sampling.totals(slots, np.arange(2), without)
        assert got[s, i] == pytest.approx(expected[s], abs=1e-8)


def all_states(slots: Slots, n: int) -> dict[tuple[int, ...], float]:
    found = {}
    for state in itertools.product(range(-1, len(slots.log_base)), repeat=n):
        if all(s < 0 or np.isfinite(slots.log_point[s, i]) for i, s in enumerate(state)):
            found[state] = weight(slots, state)
    return found


def test_stochastic_optimisation_finds_the_best_association_of_brute_force() -> None:
    """From nothing, 50 iterations a point: in 19 of 20; all that are a tenth as likely at least in 15."""
    best = near = 0
    for seed in range(20):
        slots, z = problem(seed, 6, 2)
        rng = np.random.default_rng(seed)
        visited = sampling.sample(
            slots, np.full(6, -1), np.arange(6), z, iterations=300, most_moves=200, most=50, rng=rng
        )  # fmt: skip
        every = sorted(all_states(slots, 6).items(), key=lambda one: -one[1])
        found = {tuple(row) for row in visited.slot.tolist()}
        best += every[0][0] in found
        likely = [state for state, value in every if value > every[0][1] + math.log(0.1)]
        near += all(state in found for state in likely)
        for row, value in zip(visited.slot.tolist(), visited.log_w.tolist(), strict=True):
            assert value == pytest.approx(weight(slots, tuple(row)), abs=1e-8)
    assert best >= 18
    assert near >= 13


@pytest.mark.parametrize("seed", [1, 4, 8])
def test_the_chain_of_single_points_is_in_a_state_as_long_as_it_is_likely(seed: int) -> None:
    """Iterations that change nothing are counted, not made: the time is that of the Gibbs sampler all the same."""
    slots, z = problem(seed, 3, 2, spread=2.0)
    every = all_states(slots, 3)
    p = np.exp(np.array(list(every.values())) - max(every.values()))
    p /= p.sum()
    visited = sampling.sample(
        slots, np.full(3, -1), np.arange(3), z, iterations=30_000, most_moves=30_000, most=1000,
        rng=np.random.default_rng(0), block_share=0.0,
    )  # fmt: skip
    time = {tuple(row): spent for row, spent in zip(visited.slot.tolist(), visited.spent.tolist(), strict=True)}
    share = np.array([time.get(state, 0) for state in every]) / 30_000
    assert sum(time.values()) == 30_000
    assert np.abs(share - p).max() < 0.06
    assert p.max() < 0.9  # there was a choice


def test_a_chain_is_the_same_for_the_same_seed_and_keeps_to_what_is_possible() -> None:
    slots, z = problem(11, 20, 3)
    runs = [
        sampling.sample(slots, np.full(20, -1), np.arange(20) // 4, z, iterations=1000, most_moves=60, most=30,
                        rng=np.random.default_rng(5)) for _ in range(2)
    ]  # fmt: skip
    assert runs[0].slot.tolist() == runs[1].slot.tolist()
    assert (np.diff(runs[0].log_w) <= 0).all() and len(runs[0].log_w) > 3
    for row in runs[0].slot:
        assert all(s < 0 or np.isfinite(slots.log_point[s, i]) for i, s in enumerate(row.tolist()))
    none = sampling.sample(
        slots, np.full(20, -1), np.arange(20), z, iterations=0, most_moves=60, most=30, rng=np.random.default_rng(5)
    )  # fmt: skip
    assert none.slot.tolist() == [[-1] * 20]


def test_halves_are_on_either_side_of_the_middle_along_the_longer_axis() -> None:
    z = np.column_stack([np.arange(6.0), np.tile([0.0, 0.1], 3)])
    side = sampling.halves(z)
    assert side.tolist() in ([False] * 3 + [True] * 3, [True] * 3 + [False] * 3)
    assert not sampling.halves(np.full((7, 2), [0.1, 0.7])).any()  # whose mean is not quite there


def test_points_all_in_one_place_have_no_halves_to_move() -> None:
    slots, _ = problem(11, 20, 3)
    z = np.full((20, 2), [0.1, 0.7])
    start = np.where(np.isfinite(slots.log_point[0]), 0, -1)
    found = sampling.sample(slots, start, np.zeros(20, np.int64), z, iterations=1000, most_moves=60,
                            most=30, rng=np.random.default_rng(5))  # fmt: skip
    assert len(found.log_w) > 1
