"""k-means: as many clusters as there are bodies, one where there is one, and the same in whatever order."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from maritrack.chain import sample_events
from maritrack.cluster.chained import groups
from maritrack.cluster.kmeans import INDEX, MOST_POINTS, calinski_harabasz, kmeans, most_clusters, sampled
from maritrack.cluster.lloyd import lloyd, plus_plus
from maritrack.errors import ConfigError
from maritrack.settings import ClusterConfig
from maritrack.types import FloatArray, IntArray, take
from tests.unit.scans import scan_of

INDICES: Any = ("calinski-harabasz", "davies-bouldin", "silhouette")
CONFIG = ClusterConfig(method="kmeans", eps_m=30.0)


def hull(
    east: float, north: float, *, length: float = 40.0, turn: float = 0.5, seed: int = 0, n: int = 30
) -> FloatArray:
    """Points of a vessel: a box four times as long as wide."""
    rng = np.random.default_rng(seed)
    along, across = rng.uniform(-0.5, 0.5, n) * length, rng.uniform(-0.5, 0.5, n) * length / 4
    return np.stack(
        [east + along * np.sin(turn) + across * np.cos(turn), north + along * np.cos(turn) - across * np.sin(turn)], 1
    )


def same_partition(a: IntArray, b: IntArray) -> bool:
    return bool(np.array_equal(a[:, None] == a[None, :], b[:, None] == b[None, :]))


@pytest.mark.parametrize("index", INDICES)
@pytest.mark.parametrize("bodies", [2, 3, 5, 8])
def test_bodies_far_apart_are_as_many_clusters(index: Any, bodies: int) -> None:
    rng = np.random.default_rng(bodies)
    places = np.array(list(itertools.product(range(3), range(3))))[rng.permutation(9)[:bodies]] * 900.0
    points = np.concatenate([hull(*place, seed=k) for k, place in enumerate(places)])
    truth = np.repeat(np.arange(bodies), 30)
    assert same_partition(kmeans(points, replace(CONFIG, k_index=index)), truth)


@pytest.mark.parametrize("rule", ["gap", "spread"])
@pytest.mark.parametrize("length", [10.0, 60.0, 180.0])
def test_one_vessel_is_one_cluster_however_long(rule: Any, length: float) -> None:
    points = hull(4000.0, -900.0, length=length, n=80)
    assert kmeans(points, replace(CONFIG, k_rule=rule)).tolist() == [0] * 80


def test_two_boats_near_each_other_are_two_by_their_gap_and_one_by_their_spread() -> None:
    points = np.concatenate([hull(0.0, 0.0, length=12.0), hull(80.0, 0.0, length=12.0, seed=1)])
    truth = np.repeat([0, 1], 30)
    assert same_partition(kmeans(points, CONFIG), truth)
    assert kmeans(points, replace(CONFIG, k_rule="spread")).max() == 0


def test_a_torn_echo_is_one_by_its_spread_and_two_by_its_gap() -> None:
    points = np.concatenate([hull(0.0, 0.0, length=20.0), hull(60.0, 0.0, length=20.0, seed=1)])
    group = groups(points, CONFIG.eps_m)
    assert most_clusters(points, group, CONFIG) == 2
    assert most_clusters(points, group, replace(CONFIG, k_rule="spread")) == 1


def test_without_the_rule_of_gaps_calinski_harabasz_cuts_long_vessels() -> None:
    points = np.concatenate([hull(0.0, 0.0, length=150.0), hull(900.0, 0.0, length=150.0, seed=1)])
    assert kmeans(points, replace(CONFIG, k_rule="spread")).max() + 1 > 2
    assert kmeans(points, CONFIG).max() + 1 == 2


def test_no_more_clusters_than_k_max() -> None:
    points = np.concatenate([hull(900.0 * k, 0.0, seed=k) for k in range(6)])
    assert kmeans(points, replace(CONFIG, k_max=4)).max() <= 3


@pytest.mark.parametrize(
    ("points", "expected"),
    [([], []), ([[5.0, 5.0]], [0]), ([[0.0, 0.0], [10.0, 0.0]], [0, 0]), ([[0.0, 0.0], [500.0, 0.0]], [0, 1]),
     ([[0.0, 0.0]] * 4, [0] * 4), ([[0.0, 0.0], [500.0, 0.0], [500.0, 0.0], [0.0, 0.0]], [0, 1, 1, 0])],
)  # fmt: skip
def test_few_and_equal_points(points: list[list[float]], expected: list[int]) -> None:
    assert kmeans(np.array(points).reshape(-1, 2), CONFIG).tolist() == expected


@settings(derandomize=True, deadline=None, max_examples=12)
@given(st.integers(0, 10**6), st.integers(1, 40))
def test_neither_order_nor_place_nor_repetition_makes_a_difference(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    points = np.round(rng.normal(0, 300, (n, 2)))
    label = kmeans(points, CONFIG)
    order = rng.permutation(n)
    assert same_partition(kmeans(points[order], CONFIG), label[order])
    assert np.array_equal(kmeans(points, CONFIG), label)
    assert same_partition(kmeans(points + np.array([4096.0, -8192.0]), CONFIG), label)


@pytest.mark.parametrize("index", INDICES)
def test_the_chosen_number_has_the_best_index_of_all(index: Any) -> None:
    points = np.random.default_rng(3).normal(0, 400, (40, 2))
    points = points[np.lexsort((points[:, 1], points[:, 0]))]
    start = plus_plus(points, 10, seed=0)
    values = {k: INDEX[index](points, lloyd(points, start[:, :k])[1]) for k in range(2, 11)}
    assert kmeans(points, replace(CONFIG, k_index=index)).max() + 1 == max(values, key=lambda k: values[k])


def test_calinski_harabasz_is_its_definition() -> None:
    points = np.random.default_rng(4).normal(0, 100, (30, 2))
    label = lloyd(points, plus_plus(points, 3, seed=0))[1]
    mean = points.mean(axis=0)
    within = sum(((points[label == k] - points[label == k].mean(axis=0)) ** 2).sum() for k in range(3))
    between = sum((label == k).sum() * ((points[label == k].mean(axis=0) - mean) ** 2).sum() for k in range(3))
    assert_allclose(INDEX["calinski-harabasz"](points, label), (between / 2) / (within / 27))


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.lists(st.integers(1, 60), min_size=1, max_size=30), st.integers(1, 400), st.integers(0, 99))
def test_a_sample_has_small_groups_whole_and_of_large_ones_about_the_same(
    sizes: list[int], most: int, seed: int
) -> None:
    group = np.random.default_rng(seed).permutation(np.repeat(np.arange(len(sizes)), sizes))
    chosen = sampled(group, most)
    assert len(chosen) <= max(most, 1) and (np.diff(chosen) > 0).all()
    if len(group) <= most:
        assert len(chosen) == len(group)
    elif len(sizes) <= most:
        left = np.bincount(group[chosen], minlength=len(sizes))
        cut = left < np.array(sizes)
        assert left.min() >= 1 and cut.any()
        assert left[~cut].max(initial=0) <= 2 * left[cut].max() + 1  # none is cut down below what another may keep


def test_a_run_says_that_its_clusters_are_those_of_a_sample() -> None:
    _, points = scan_of(np.random.default_rng(0).uniform(-3000, 3000, (MOST_POINTS + 1, 2)), 0.0)
    few = sample_events(take(points, np.arange(MOST_POINTS)), CONFIG)
    assert few == () == sample_events(points, replace(CONFIG, method="singletons"))
    (told,) = sample_events(points, CONFIG)
    assert told.level == "warning" and str(MOST_POINTS) in told.message


def test_many_points_are_clustered_by_a_sample_of_them() -> None:
    n = 3 * MOST_POINTS
    points = np.concatenate([hull(0.0, 0.0, n=n), hull(900.0, 0.0, seed=1, n=n)])
    assert same_partition(kmeans(points, CONFIG)[:: n // 50], np.repeat([0, 1], n)[:: n // 50])


@pytest.mark.parametrize("seed", range(6))
def test_of_many_starts_the_best_is_as_good_as_the_library_s(seed: int) -> None:
    from sklearn.cluster import KMeans
    from sklearn.metrics import calinski_harabasz_score

    points = np.concatenate([hull(400.0 * k, 90.0 * k * seed, seed=seed + k) for k in range(5)])
    for k in (2, 3, 5, 7):
        centre, label = lloyd(points, plus_plus(points, k, seed=seed))
        theirs = KMeans(k, n_init=10, random_state=seed).fit(points)
        assert ((points - centre[label]) ** 2).sum() <= 1.02 * theirs.inertia_
        assert_allclose(centre, [points[label == i].mean(axis=0) for i in range(k)], rtol=1e-12, atol=1e-9)
        assert_allclose(calinski_harabasz(points, label), calinski_harabasz_score(points, label), rtol=1e-9)


def test_more_clusters_than_places_leave_some_empty() -> None:
    points = np.repeat([[0.0, 0.0], [10.0, 0.0]], 4, axis=0)
    centre, label = lloyd(points, plus_plus(points, 3, seed=0))
    assert_allclose(centre[label], points)


@pytest.mark.parametrize("wrong", [{"k_max": 1}, {"one_spread_m": 0.0}, {"kmeans_seed": -1}])
def test_settings_that_make_no_sense_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="cluster"):
        ClusterConfig(**wrong)
