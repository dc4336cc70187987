"""The adjusted Rand index against scikit-learn, against a count of all pairs, and in closed form."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.metrics import adjusted_rand_index
from maritrack.metrics.clusters import Noise, PairCounts, adjusted_rand, count_difference, pair_counts

LABELS = st.integers(0, 40).flatmap(
    lambda n: st.tuples(
        st.lists(st.integers(-2, 4), min_size=n, max_size=n), st.lists(st.integers(-1, 4), min_size=n, max_size=n)
    )
)


def counted(truth: list[int], label: list[int], noise: Noise) -> PairCounts:
    """Every pair looked at."""
    table = dict.fromkeys(itertools.product((True, False), repeat=2), 0)
    for i, j in itertools.combinations(range(len(truth)), 2):
        if truth[i] == truth[j] == -2:
            continue
        alone = noise == "single"
        one_object = truth[i] == truth[j] and not (alone and truth[i] == -1)
        one_cluster = label[i] == label[j] and not (alone and label[i] == -1)
        table[one_object, one_cluster] += 1
    return PairCounts(table[True, True], table[True, False], table[False, True], table[False, False])


@pytest.mark.parametrize("noise", ["single", "class"])
@settings(derandomize=True, deadline=None, max_examples=40)
@given(labels=LABELS)
def test_pairs_are_those_that_one_can_count(noise: Noise, labels: tuple[list[int], list[int]]) -> None:
    truth, label = labels
    assert pair_counts(np.array(truth, int), np.array(label, int), noise=noise) == counted(truth, label, noise)


@settings(derandomize=True, deadline=None, max_examples=40)
@given(labels=LABELS)
def test_with_noise_as_a_class_the_index_is_that_of_scikit_learn(labels: tuple[list[int], list[int]]) -> None:
    from sklearn.metrics import adjusted_rand_score

    truth = np.maximum(np.array(labels[0], int), -1)
    label = np.array(labels[1], int)
    assert adjusted_rand_index(truth, label, noise="class") == pytest.approx(adjusted_rand_score(truth, label))


@settings(derandomize=True, deadline=None, max_examples=40)
@given(labels=LABELS)
def test_noise_alone_is_scikit_learn_with_a_label_for_every_point_of_noise(
    labels: tuple[list[int], list[int]],
) -> None:
    from sklearn.metrics import adjusted_rand_score

    truth, label = np.maximum(np.array(labels[0], int), -1), np.array(labels[1], int)
    own = 100 + np.arange(len(truth))
    expected = adjusted_rand_score(np.where(truth < 0, own, truth), np.where(label < 0, own, label))
    assert adjusted_rand_index(truth, label) == pytest.approx(expected)


def test_closed_forms() -> None:
    objects = np.repeat(np.arange(2), 4)
    assert adjusted_rand_index(objects, 1 - objects) == 1.0  # names don't matter
    assert adjusted_rand_index(objects, np.zeros(8, int)) == 0.0  # one cluster of all: as chance has it
    assert adjusted_rand_index(objects, np.full(8, -1)) == 0.0  # all noise
    halves = np.array([0, 0, 1, 1, 2, 2, 3, 3])  # each object in two: pairs 4 of 12, none wrong, 16 apart
    assert adjusted_rand_index(objects, halves) == pytest.approx(2 * 4 * 16 / (12 * 24 + 4 * 16))
    assert adjusted_rand_index(np.full(3, -1), np.full(3, -1)) == 1.0
    assert adjusted_rand_index(np.zeros(0, int), np.zeros(0, int)) == 1.0


def test_land_in_pieces_costs_nothing_and_land_in_a_ship_does() -> None:
    truth = np.array([0, 0, 0, 1, 1, 1, -2, -2, -2, -2])
    in_pieces = np.array([0, 0, 0, 1, 1, 1, 2, 2, 3, -1])
    with_a_ship = np.array([0, 0, 0, 1, 1, 1, 1, 1, 2, 2])
    assert adjusted_rand_index(truth, in_pieces) == 1.0
    assert adjusted_rand_index(truth, with_a_ship) < 0.9
    assert count_difference(truth, in_pieces) == 0
    assert count_difference(truth, with_a_ship) == 0  # the ship with two cells of land is a cluster still
    assert count_difference(truth, np.array([0, 0, 0, 1, 1, 1, 1, 1, 1, 1])) == -1  # this one is land


def test_the_number_of_clusters_is_compared_with_objects_that_show() -> None:
    assert count_difference(np.array([5, 5, 7, -1]), np.array([0, 1, 2, -1])) == 1
    assert count_difference(np.array([5, 5, 7, -1]), np.array([0, 0, -1, -1])) == -1
    assert count_difference(np.array([-1, -1]), np.array([0, 0])) == 1  # a cluster of noise
    assert count_difference(np.array([4, 4, -2, -2]), np.zeros(4, int)) == 0  # half of it unknown: still one
    assert count_difference(np.zeros(0, int), np.zeros(0, int)) == 0


def test_a_hundred_thousand_points_do_not_overflow() -> None:
    n = 100_000
    half = np.arange(n) // (n // 2)
    assert adjusted_rand(pair_counts(half, half)) == 1.0
    assert adjusted_rand_index(half, np.arange(n) % 2) == pytest.approx(0.0, abs=1e-4)
