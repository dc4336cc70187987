"""T-GOSPA in situations with an answer by hand; c = 10, p = 2, gamma = 2."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from maritrack.metrics import t_gospa
from maritrack.metrics.tgospa import TGospa
from maritrack.types import FloatArray

EXACT = 1e-9
GONE = np.nan


def lines(*rows: list[float]) -> FloatArray:
    """Trajectories on a line, one value for each time."""
    return np.array(rows, dtype=float)[:, :, None]


def score(truth: Any, estimates: Any, **changed: float) -> TGospa:
    return t_gospa(truth, estimates, **({"c": 10.0, "p": 2.0, "gamma": 2.0} | changed))


def parts(ours: TGospa) -> list[float]:
    return [ours.localisation_p, ours.missed_p, ours.false_p, ours.switch_p]


def test_nothing_against_nothing_is_zero() -> None:
    empty = np.empty((0, 5, 2))
    assert score(empty, empty).total == 0.0
    assert score([], []).total == 0.0


def test_all_states_are_missed_or_false_without_a_counterpart() -> None:
    X = lines([0.0, 0.0, GONE], [50.0, 50.0, 50.0])
    assert parts(score(X, X[:0])) == [0.0, 250.0, 0.0, 0.0]
    assert parts(score([], X)) == [0.0, 0.0, 250.0, 0.0]
    assert parts(score([], X, rho=0.2)) == [0.0, 0.0, 100.0, 0.0]


def test_a_swap_of_two_labels_costs_two_changes_of_partner() -> None:
    X = lines([0.0] * 6, [5.0] * 6)
    swapped = lines([0.0, 0.0, 0.0, 5.0, 5.0, 5.0], [5.0, 5.0, 5.0, 0.0, 0.0, 0.0])
    ours = score(X, swapped)
    assert_allclose(parts(ours), [0.0, 0.0, 0.0, 8.0], atol=EXACT)
    assert_allclose(ours.n_switch, 2.0, atol=EXACT)


def test_a_track_broken_in_two_is_one_change_of_partner() -> None:
    whole = lines([0.0] * 6)
    broken = lines([0.0, 0.0, 0.0, GONE, GONE, GONE], [GONE, GONE, GONE, 0.0, 0.0, 0.0])
    assert_allclose(parts(score(whole, broken)), [0.0, 0.0, 0.0, 4.0], atol=EXACT)
    assert_allclose(parts(score(broken, whole)), [0.0, 0.0, 0.0, 4.0], atol=EXACT)


def test_a_hole_is_a_miss_and_no_switch() -> None:
    ours = score(lines([0.0] * 5), lines([0.0, GONE, GONE, 0.0, 0.0]))
    assert_allclose(parts(ours), [0.0, 100.0, 0.0, 0.0], atol=EXACT)


def test_a_short_excursion_is_not_worth_a_change_of_partner() -> None:
    X = lines([0.0] * 5)
    Y = lines([1.0] * 5, [GONE, GONE, 0.5, GONE, GONE])
    assert_allclose(parts(score(X, Y)), [5.0, 0.0, 50.0, 0.0], atol=EXACT)
    ours = score(X, Y, gamma=0.5)  # two changes cost 0.5 and win 0.75
    assert_allclose(parts(ours), [4.25, 0.0, 50.0, 0.5], atol=EXACT)


def test_a_pair_at_the_cutoff_is_missed_and_false() -> None:
    assert parts(score(lines([0.0]), lines([10.0]))) == [0.0, 50.0, 50.0, 0.0]


def test_one_time_is_enough() -> None:
    assert_allclose(parts(score(lines([0.0], [3.0]), lines([1.0], [4.0]))), [2.0, 0.0, 0.0, 0.0], atol=EXACT)


def test_an_estimate_that_never_comes_near_changes_nothing_but_the_false_states() -> None:
    rng = np.random.default_rng(3)
    X = np.cumsum(rng.normal(size=(3, 20, 2)), axis=1)
    Y = X + rng.normal(size=X.shape)
    far = np.full((1, 20, 2), 1e4)
    near, both = score(X, Y), score(X, np.concatenate([far, Y]))
    assert_allclose(both.false_p, near.false_p + 20 * 50.0, atol=EXACT)
    assert_allclose(both.total**2, near.total**2 + 20 * 50.0, rtol=EXACT)


@pytest.mark.parametrize(
    "changed", [{"c": 0.0}, {"p": 0.9}, {"gamma": -1.0}, {"gamma": np.inf}, {"rho": 0.0}, {"rho": 1.0}]
)
def test_senseless_settings_are_errors(changed: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(changed))):
        score(lines([0.0]), lines([0.0]), **changed)


@pytest.mark.parametrize(
    "truth",
    [np.zeros((1, 2)), np.zeros((1, 3, 1)), np.full((1, 2, 1), np.inf), np.array([[[0.0, np.nan], [0.0, 0.0]]])],
)
def test_senseless_trajectories_are_errors(truth: FloatArray) -> None:
    with pytest.raises(ValueError):
        score(truth, np.zeros((1, 2, 1)))


def _swapping(seed: int = 6) -> tuple[np.ndarray, np.ndarray]:
    """Four ships of 40 scans in metres; half way two estimates change places, and a fifth of all are missing."""
    rng = np.random.default_rng(seed)
    X = np.cumsum(rng.normal(0, 5, (4, 40, 2)), 1) + rng.normal(0, 60, (4, 1, 2))
    Y = X + rng.normal(0, 10, X.shape)
    Y[0, 20:], Y[1, 20:] = Y[1, 20:].copy(), Y[0, 20:].copy()
    Y[rng.random(Y.shape[:2]) < 0.2] = np.nan
    return X, Y


@pytest.mark.parametrize("unit", [1e-3, 1 / 1852, 1 / 111_000, 1e-9, 1e6])
@pytest.mark.parametrize("p", [1.0, 2.0, 10.0])
def test_the_unit_of_length_does_not_matter(unit: float, p: float) -> None:
    X, Y = _swapping()
    metres = t_gospa(X, Y, c=100.0, p=p, gamma=20.0)
    scaled = t_gospa(X * unit, Y * unit, c=100.0 * unit, p=p, gamma=20.0 * unit)
    assert scaled.total / unit == pytest.approx(metres.total, rel=1e-9)
    assert scaled.n_switch == pytest.approx(metres.n_switch, abs=1e-6)


@pytest.mark.parametrize(("p", "gamma"), [(2.0, 1e160), (200.0, 20.0), (200.0, 1e9), (1.0, 1e300)])
def test_a_change_that_is_too_dear_does_not_happen_and_nothing_overflows(p: float, gamma: float) -> None:
    X, Y = _swapping()
    found = t_gospa(X, Y, c=100.0, p=p, gamma=gamma)
    assert np.isfinite(found.total)
    if gamma > 100.0:
        assert found.n_switch == 0.0
        assert found.total == pytest.approx(t_gospa(X, Y, c=100.0, p=p, gamma=1e4).total, rel=1e-9)
