"""OSPA, GOSPA and T-GOSPA are metrics, equal their definitions, and reduce to each other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose

from maritrack.metrics import gospa, ospa, t_gospa
from maritrack.metrics.distances import distance_table
from maritrack.types import FloatArray
from tests.oracles import gospa_by_permutation, gospa_by_subsets, ospa_by_permutation, t_gospa_with_dummies

EXACT = 1e-9
law = settings(derandomize=True, deadline=None, max_examples=50)
few = settings(derandomize=True, deadline=None, max_examples=25)
coordinates = st.integers(-120, 120).map(lambda x: x / 8)
orders = st.sampled_from([1.0, 1.5, 2.0, 3.0])
C = 10.0

Distance = Callable[[FloatArray, FloatArray, float], float]
METRICS: dict[str, Distance] = {
    "ospa": lambda x, y, p: ospa(x, y, c=C, p=p).total,
    "gospa": lambda x, y, p: gospa(x, y, c=C, p=p).total,
    "gospa, alpha 1": lambda x, y, p: gospa(x, y, c=C, p=p, alpha=1.0).total,
}


@st.composite
def positions(draw: Any, most: int = 4) -> FloatArray:
    n = draw(st.integers(0, most))
    return np.asarray(draw(arrays(np.float64, (n, 2), elements=coordinates)), dtype=np.float64)


@st.composite
def trajectories(draw: Any, n_times: int = 4, most: int = 3) -> FloatArray:
    """Trajectories (n, t, 1) on a line, with holes."""
    n = draw(st.integers(0, most))
    states = draw(arrays(np.float64, (n, n_times, 1), elements=coordinates))
    gone = draw(arrays(np.bool_, (n, n_times, 1), elements=st.sampled_from([False, False, False, True])))
    return np.where(gone, np.nan, states)


@pytest.mark.parametrize("metric", METRICS.values(), ids=METRICS)
@law
@given(positions(), positions(), orders)
def test_distance_is_symmetric_and_zero_to_itself(metric: Distance, x: FloatArray, y: FloatArray, p: float) -> None:
    assert_allclose(metric(x, y, p), metric(y, x, p), atol=EXACT)
    assert metric(x, x[::-1], p) == 0.0


@pytest.mark.parametrize("metric", METRICS.values(), ids=METRICS)
@law
@given(positions(), positions(), positions(), orders)
def test_distance_obeys_the_triangle(metric: Distance, x: FloatArray, y: FloatArray, z: FloatArray, p: float) -> None:
    assert metric(x, z, p) <= metric(x, y, p) + metric(y, z, p) + EXACT


@law
@given(positions(), positions(), orders)
def test_ospa_equals_the_best_permutation_and_never_exceeds_c(x: FloatArray, y: FloatArray, p: float) -> None:
    ours = ospa(x, y, c=C, p=p)
    assert_allclose(ours.total, ospa_by_permutation(distance_table(x, y), C, p), atol=EXACT)
    assert_allclose(ours.total**p, ours.localisation**p + ours.cardinality**p, atol=EXACT)
    assert ours.total <= C + EXACT


@law
@given(positions(), positions(), orders, st.sampled_from([0.5, 1.0, 1.7, 2.0]))
def test_gospa_equals_its_definition(x: FloatArray, y: FloatArray, p: float, alpha: float) -> None:
    ours = gospa(x, y, c=C, p=p, alpha=alpha)
    assert_allclose(ours.total, gospa_by_permutation(distance_table(x, y), C, p, alpha), atol=EXACT)
    assert_allclose(ours.total**p, ours.localisation_p + ours.missed_p + ours.false_p, atol=1e-7)


@law
@given(positions(), positions(), orders)
def test_gospa_counts_each_single_half_a_cutoff(x: FloatArray, y: FloatArray, p: float) -> None:
    ours = gospa(x, y, c=C, p=p)
    assert_allclose(ours.total, gospa_by_subsets(distance_table(x, y), C, p), atol=EXACT)
    assert_allclose(ours.missed_p + ours.false_p, C**p / 2 * (ours.n_missed + ours.n_false), rtol=EXACT)
    assert (ours.n_missed, ours.n_false) == (len(x) - len(ours.pairs), len(y) - len(ours.pairs))


@law
@given(positions(), positions(), st.sampled_from([0.001, 0.3048, 1852.0]))
def test_other_units_scale_the_distance(x: FloatArray, y: FloatArray, scale: float) -> None:
    scaled = gospa(x * scale, y * scale, c=C * scale, p=2.0)
    assert_allclose(scaled.total, gospa(x, y, c=C, p=2.0).total * scale, rtol=1e-7)


def sum_over_time(x: FloatArray, y: FloatArray, p: float) -> float:
    there = ([row[~np.isnan(row[:, 0])] for row in (x[:, k], y[:, k])] for k in range(4))
    return float(sum(gospa(a, b, c=C, p=p).total ** p for a, b in there))


@few
@given(trajectories(), trajectories(), st.sampled_from([1.0, 2.0]))
def test_t_gospa_with_free_switches_is_the_sum_of_gospa(x: FloatArray, y: FloatArray, p: float) -> None:
    assert_allclose(t_gospa(x, y, c=C, p=p, gamma=0.0).total ** p, sum_over_time(x, y, p), atol=1e-7)


@few
@given(trajectories(), trajectories(), st.sampled_from([1.0, 2.0]), st.sampled_from([0.5, 3.0, 20.0]))
def test_t_gospa_is_never_less_than_the_sum_of_gospa(x: FloatArray, y: FloatArray, p: float, gamma: float) -> None:
    ours = t_gospa(x, y, c=C, p=p, gamma=gamma)
    assert ours.total**p >= sum_over_time(x, y, p) - 1e-7
    parts = ours.localisation_p + ours.missed_p + ours.false_p + ours.switch_p
    assert_allclose(parts, ours.total**p, atol=1e-7)


@few
@given(
    trajectories(),
    trajectories(),
    st.sampled_from([1.0, 2.0]),
    st.sampled_from([0.5, 4.0]),
    st.sampled_from([0.5, 0.8]),
)
def test_t_gospa_equals_the_program_with_dummies(
    x: FloatArray, y: FloatArray, p: float, gamma: float, rho: float
) -> None:
    expected = t_gospa_with_dummies(x, y, c=C, p=p, gamma=gamma, rho=rho)
    assert_allclose(t_gospa(x, y, c=C, p=p, gamma=gamma, rho=rho).total, expected, atol=1e-7)


@pytest.mark.parametrize("seed", range(4))
def test_one_truth_with_many_estimates_equals_the_program_with_dummies(seed: int) -> None:
    """The shortest path that replaces the program where all pairs have a trajectory in common."""
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.normal(0.0, 1.0, (1, 12, 2)), axis=1)
    y = x + rng.normal(0.0, 4.0, (4, 12, 2))
    y[rng.random((4, 12)) < 0.3] = np.nan
    for truth, estimates in ((x, y), (y, x)):
        expected = t_gospa_with_dummies(truth, estimates, c=C, p=2.0, gamma=3.0, rho=0.5)
        assert_allclose(t_gospa(truth, estimates, c=C, p=2.0, gamma=3.0).total, expected, atol=1e-7)


@few
@given(trajectories(), trajectories(), trajectories(), st.sampled_from([1.0, 2.0]))
def test_t_gospa_obeys_the_triangle(x: FloatArray, y: FloatArray, z: FloatArray, p: float) -> None:
    def d(a: FloatArray, b: FloatArray) -> float:
        return t_gospa(a, b, c=C, p=p, gamma=3.0).total

    assert d(x, z) <= d(x, y) + d(y, z) + 1e-7
    assert_allclose(d(x, y), d(y, x), atol=1e-7)
    assert_allclose(d(x, x), 0.0, atol=1e-6)


@few
@given(trajectories(), trajectories())
def test_t_gospa_does_not_know_the_direction_of_time(x: FloatArray, y: FloatArray) -> None:
    forward, backward = (t_gospa(a, b, c=C, p=2.0, gamma=3.0).total for a, b in ((x, y), (x[:, ::-1], y[:, ::-1])))
    assert_allclose(forward, backward, atol=1e-7)


@few
@given(trajectories(), trajectories())
def test_truth_and_estimates_change_roles_with_rho(x: FloatArray, y: FloatArray) -> None:
    there = t_gospa(x, y, c=C, p=2.0, gamma=3.0, rho=0.8).total
    assert_allclose(t_gospa(y, x, c=C, p=2.0, gamma=3.0, rho=0.2).total, there, atol=1e-7)
