"""DBSCAN over a grid of eps and min_points against DBSCAN one by one, label by label."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from maritrack.cluster import dbscan as module
from maritrack.cluster.dbscan import dbscan
from maritrack.cluster.grid import dbscan_grid

LEAST = (1, 2, 3, 5, 9)


def one_by_one(xy: np.ndarray, eps: list[float], period: float) -> list[np.ndarray]:
    return [
        np.stack([dbscan(xy, eps_m=e, min_points=least, period_m=period) for e in eps]) for least in LEAST
    ]  # fmt: skip


@settings(derandomize=True, deadline=None, max_examples=30)
@given(
    seed=st.integers(0, 10_000),
    n=st.integers(0, 150),
    step_m=st.sampled_from([0.0, 7.4948, 15.0]),  # 0 = anywhere; else cells of a lattice, full of equal distances
    period_m=st.sampled_from([0.0, 300.0]),
    eps=st.lists(st.sampled_from([7.5, 15.0, 20.0, 21.3, 30.0, 45.0, 61.0]), min_size=1, unique=True).map(sorted),
)
def test_labels_are_those_of_dbscan(seed: int, n: int, step_m: float, period_m: float, eps: list[float]) -> None:
    xy = np.random.default_rng(seed).uniform(0, 300, (n, 2))
    if step_m:
        xy = np.round(xy / step_m) * step_m
    found = list(dbscan_grid(xy, eps_m=eps, min_points=LEAST, period_m=period_m))
    for ours, theirs in zip(found, one_by_one(xy, eps, period_m), strict=True):
        assert_array_equal(ours, theirs)


def test_a_crowd_is_left_to_dbscan(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_PAIRS", 1000)
    xy = np.random.default_rng(1).normal(0, [20, 10], (300, 2))
    eps = [1.0, 2.0, 10.0, 20.0]
    assert not module.crowded(module.tree_of(xy, 0.0), 1.0) and module.crowded(module.tree_of(xy, 0.0), 10.0)
    for ours, theirs in zip(dbscan_grid(xy, eps_m=eps, min_points=LEAST), one_by_one(xy, eps, 0.0), strict=True):
        assert_array_equal(ours, theirs)
    everywhere = list(dbscan_grid(xy, eps_m=eps[2:], min_points=LEAST))
    assert_array_equal(everywhere[0], one_by_one(xy, eps[2:], 0.0)[0])


def test_neighbours_at_exactly_eps_are_neighbours() -> None:
    xy = np.array([[0.0, 0.0], [30.0, 0.0], [60.1, 0.0]])
    assert [labels.tolist() for labels in dbscan_grid(xy, eps_m=[30.0, 30.1], min_points=[2])] == [
        [[0, 0, -1], [0, 0, 0]]
    ]


def test_eps_come_in_order() -> None:
    with pytest.raises(ValueError, match="ascending"):
        next(dbscan_grid(np.zeros((1, 2)), eps_m=[2.0, 1.0], min_points=[1]))
