"""OSPA and GOSPA in situations with an answer by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from maritrack.metrics import gospa, ospa
from maritrack.metrics.gospa import gospa_from_distances
from maritrack.metrics.ospa import ospa_from_distances

EXACT = 1e-12
NOTHING = np.empty((0, 2))
ORIGIN = np.zeros((1, 2))


def test_two_empty_sets_are_equal() -> None:
    assert ospa(NOTHING, [], c=10.0, p=2.0).total == 0.0
    assert gospa([], NOTHING, c=10.0, p=2.0).total == 0.0


def test_ospa_of_an_empty_set_is_the_cutoff_all_of_it_cardinality() -> None:
    for sets in ((NOTHING, ORIGIN), (np.ones((3, 2)), NOTHING)):
        ours = ospa(*sets, c=10.0, p=2.0)
        assert (ours.total, ours.localisation, ours.cardinality) == (10.0, 0.0, 10.0)


def test_gospa_of_an_empty_set_counts_all_others() -> None:
    missed = gospa(np.ones((3, 2)), NOTHING, c=10.0, p=2.0)
    false = gospa(NOTHING, np.ones((3, 2)), c=10.0, p=2.0)
    assert (missed.n_missed, missed.n_false, missed.missed_p, missed.false_p) == (3, 0, 150.0, 0.0)
    assert (false.n_missed, false.n_false, false.missed_p, false.false_p) == (0, 3, 0.0, 150.0)


def test_an_estimate_at_the_cutoff_is_false_and_its_truth_missed() -> None:
    at = gospa(ORIGIN, [[10.0, 0.0]], c=10.0, p=2.0)
    inside = gospa(ORIGIN, [[9.0, 0.0]], c=10.0, p=2.0)
    assert (at.n_missed, at.n_false, len(at.pairs), at.localisation_p) == (1, 1, 0, 0.0)
    assert (inside.n_missed, inside.n_false, inside.localisation_p) == (0, 0, 81.0)
    assert inside.pairs.tolist() == [[0, 0]]


def test_assignment_is_optimal_and_not_greedy() -> None:
    ours = gospa([[0.0], [3.0]], [[2.0], [100.0], [6.5]], c=10.0, p=1.0)
    assert ours.pairs.tolist() == [[0, 0], [1, 2]]  # nearest first: 3 with 2, and 0 with 6.5
    assert_allclose(ours.total, 2.0 + 3.5 + 5.0, rtol=EXACT)


def test_gospa_with_another_alpha_follows_its_definition() -> None:
    """Two truths far from one estimate: one pair at the cutoff, one surplus of c^p / alpha."""
    ours = gospa([[0.0], [1000.0]], [[500.0]], c=10.0, p=2.0, alpha=1.0)
    assert_allclose(ours.total, math.sqrt(100.0 + 100.0), rtol=EXACT)
    assert (ours.n_missed, ours.n_false) == (2, 1)
    assert (ours.missed_p, ours.false_p) == (150.0, 50.0)


def test_ospa_parts_add_up_in_the_pth_power() -> None:
    ours = ospa([[0.0], [50.0], [90.0]], [[3.0], [54.0]], c=10.0, p=2.0)
    assert_allclose(ours.localisation, math.sqrt(25.0 / 3.0), rtol=EXACT)
    assert_allclose(ours.cardinality, math.sqrt(100.0 / 3.0), rtol=EXACT)
    assert_allclose(ours.total, math.sqrt(125.0 / 3.0), rtol=EXACT)


def test_distances_may_be_given_and_infinite() -> None:
    D = np.array([[1.0, np.inf], [np.inf, np.inf]])
    assert_allclose(ospa_from_distances(D, c=2.0, p=1.0).total, 1.5, rtol=EXACT)
    assert_allclose(gospa_from_distances(D, c=2.0, p=1.0).total, 3.0, rtol=EXACT)


def test_a_high_order_does_not_overflow_ospa() -> None:
    assert_allclose(ospa([[0.0]], [[50.0]], c=100.0, p=400.0).total, 50.0, rtol=1e-9)


@pytest.mark.parametrize(
    ("truth", "changed"),
    [
        ([[np.nan, 0.0]], {}),
        ([[np.inf, 0.0]], {}),
        ([[0.0, 0.0, 0.0]], {}),
        ([0.0, 0.0], {}),
        (ORIGIN, {"c": 0.0}),
        (ORIGIN, {"c": np.inf}),
        (ORIGIN, {"c": np.nan}),
        (ORIGIN, {"p": 0.5}),
        (ORIGIN, {"p": np.inf}),
    ],
)
def test_senseless_arguments_are_errors(truth: Any, changed: dict[str, float]) -> None:
    for metric in (ospa, gospa):
        with pytest.raises(ValueError):
            metric(truth, ORIGIN, **({"c": 10.0, "p": 2.0} | changed))


@pytest.mark.parametrize("alpha", [0.0, -1.0, 2.5])
def test_alpha_out_of_range_is_an_error(alpha: float) -> None:
    with pytest.raises(ValueError, match="alpha"):
        gospa(ORIGIN, ORIGIN, c=10.0, p=2.0, alpha=alpha)


@pytest.mark.parametrize("D", [[[np.nan]], [[-1.0]], [1.0]])
def test_senseless_distances_are_errors(D: Any) -> None:
    with pytest.raises(ValueError, match="distance"):
        ospa_from_distances(D, c=10.0, p=2.0)
    with pytest.raises(ValueError, match="distance"):
        gospa_from_distances(D, c=10.0, p=2.0)
