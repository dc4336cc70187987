"""DBSCAN on the plane and on the cylinder against scikit-learn and against the definition."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from maritrack.cluster import dbscan as module
from maritrack.cluster.dbscan import dbscan


def partition(label: np.ndarray) -> set[frozenset[int]]:
    return {frozenset(np.flatnonzero(label == c).tolist()) for c in set(label.tolist()) - {-1}}


def core_partition(xy: np.ndarray, label: np.ndarray, eps: float, least: int) -> tuple[set[frozenset[int]], set[int]]:
    near = (np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1)) <= eps).sum(1)
    core = near >= least
    return {frozenset(i for i in group if core[i]) for group in partition(label)}, set(np.flatnonzero(label == -1))


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.integers(0, 10_000), st.integers(0, 120), st.sampled_from([1, 3, 5]))
def test_partition_of_core_points_and_noise_equal_scikit_learn(seed: int, n: int, least: int) -> None:
    from sklearn.cluster import DBSCAN

    xy = np.random.default_rng(seed).uniform(0, 400, (n, 2))
    ours = dbscan(xy, eps_m=30.0, min_points=least)
    theirs = DBSCAN(eps=30.0, min_samples=least).fit_predict(xy) if n else np.zeros(0, int)
    assert core_partition(xy, ours, 30.0, least) == core_partition(xy, theirs, 30.0, least)


@pytest.mark.eq("polar-4")
@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.integers(0, 10_000), st.floats(0, 1))
def test_turning_the_cylinder_changes_no_cluster(seed: int, turn: float) -> None:
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, [1000, 300], (80, 2))
    moved = np.stack([(xy[:, 0] + turn * 1000) % 1000, xy[:, 1]], 1)
    a = dbscan(xy, eps_m=40.0, min_points=3, period_m=1000.0)
    b = dbscan(moved, eps_m=40.0, min_points=3, period_m=1000.0)
    assert partition(a) == partition(b)


def test_a_cluster_across_the_seam_is_one() -> None:
    xy = np.array([[995.0, 10], [999, 10], [3, 10], [7, 10], [500, 10]])
    assert dbscan(xy, eps_m=10.0, min_points=2, period_m=1000.0).tolist() == [0, 0, 0, 0, -1]


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.integers(0, 10_000))
def test_order_of_points_does_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 300, (90, 2))
    order = rng.permutation(90)
    a, b = dbscan(xy, eps_m=25.0, min_points=4), dbscan(xy[order], eps_m=25.0, min_points=4)
    back = np.empty(90, int)
    back[order] = b
    assert partition(a) == partition(back)


def test_a_crowd_beyond_the_limit_of_pairs_is_gathered_and_still_one_cluster(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_PAIRS", 1000)
    rng = np.random.default_rng(1)
    crowd = np.concatenate([rng.normal(0, 5, (300, 2)), rng.normal(500, 5, (300, 2)), [[250.0, 250.0]]])
    label = dbscan(crowd, eps_m=20.0, min_points=3)
    assert partition(label) == {frozenset(range(300)), frozenset(range(300, 600))}
    assert label[600] == -1


def test_gathering_neither_unites_nor_parts_what_is_clearly_apart_or_near(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two crowds of 300 equal points, 15 % farther apart than eps and 15 % nearer, anywhere on the grid."""
    monkeypatch.setattr(module, "MAX_PAIRS", 1000)
    for shift in np.linspace(0.0, 20.0, 33):
        for away, found in ((23.0, 2), (17.0, 1)):
            crowds = np.repeat([[shift, 0.0], [shift + away, 0.0]], 300, axis=0)
            assert len(partition(dbscan(crowds, eps_m=20.0, min_points=3))) == found


@settings(derandomize=True, deadline=None, max_examples=30)
@given(
    seed=st.integers(0, 10_000),
    step_m=st.sampled_from([0.0, 7.5]),
    least=st.sampled_from([2, 9, 14]),
    period_m=st.sampled_from([0.0, 300.0]),
)
def test_labels_are_the_same_whatever_share_of_the_pairs_is_held(
    seed: int, step_m: float, least: int, period_m: float
) -> None:
    xy = np.random.default_rng(seed).uniform(0, 300, (400, 2))
    xy = np.round(xy / step_m) * step_m if step_m else xy
    expected = dbscan(xy, eps_m=30.0, min_points=least, period_m=period_m)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "MAX_PAIRS", 200)
        assert module.crowded(module.tree_of(module.on_cylinder(xy, period_m), period_m), 30.0)
        assert_array_equal(dbscan(xy, eps_m=30.0, min_points=least, period_m=period_m), expected)


def test_a_filled_block_of_cells_takes_memory_for_a_bounded_number_of_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    """10,000 cells of 7.5 m with 160 neighbours each, less than what is gathered: 800,000 pairs, 12.8 MB of numbers."""
    monkeypatch.setattr(module, "MAX_PAIRS", 40_000)
    xy = 7.5 * np.stack(np.divmod(np.arange(10_000.0), 100.0), axis=1)
    tracemalloc.start()
    try:
        label = dbscan(xy, eps_m=55.0, min_points=3)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert not label.any()
    assert peak < 5e6


def test_fifty_thousand_equal_points_stay_within_memory() -> None:
    assert set(dbscan(np.zeros((50_000, 2)), eps_m=10.0, min_points=3).tolist()) == {0}


def test_no_point_gives_no_label() -> None:
    assert dbscan(np.zeros((0, 2)), eps_m=1.0, min_points=1).shape == (0,)
