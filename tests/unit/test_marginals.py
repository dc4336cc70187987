"""Situations of joint association that have an answer by hand."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from maritrack.associate import joint_marginals
from maritrack.associate.groups import connected_groups
from maritrack.associate.marginals import JointMarginals, sparse_marginals
from maritrack.associate.matchings import loopy
from maritrack.types import FloatArray, IntArray

EXACT = 1e-12
NONE = np.empty(0, dtype=np.int64)


def associate(
    N: FloatArray, existence: FloatArray | float = 1.0, *, p_detect: float = 0.9, p_gate: float = 0.99,
    clutter_density: float = 1e-4,
) -> JointMarginals:  # fmt: skip
    return joint_marginals(
        N, N > 0, p_detect=p_detect, p_gate=p_gate, clutter_density=clutter_density, existence=existence
    )


def dense(n_tracks: int, n_measurements: int) -> tuple[IntArray, IntArray]:
    track, measurement = np.divmod(np.arange(n_tracks * n_measurements), max(n_measurements, 1))
    return track, measurement


def test_one_track_is_ipda_in_closed_form() -> None:
    N, r = np.array([3e-4, 1e-3]), 0.7
    ratio = 1 - 0.9 * 0.99 + 0.9 * N.sum() / 1e-4
    ours = associate(N[None], np.array([r]))
    assert_allclose(ours.existence, ratio * r / (1 - r + ratio * r), rtol=EXACT)
    assert_allclose(ours.beta_given_existence[0, 1:], 0.9 * N / 1e-4 / ratio, rtol=EXACT)


def test_two_equal_tracks_share_one_measurement_evenly() -> None:
    ours = associate(np.full((2, 1), 0.01), p_gate=1.0, clutter_density=0.01)  # events .01, .09, .09
    assert_allclose(ours.beta, np.full((2, 2), [0.1 / 0.19, 0.09 / 0.19]), rtol=EXACT)


def test_nothing_detected_leaves_only_misses() -> None:
    ours = associate(np.empty((3, 0)), np.array([0.0, 0.5, 1.0]))
    assert_allclose(ours.beta, np.ones((3, 1)))
    assert_allclose(ours.existence, [0.0, 0.5 * 0.109 / (1 - 0.891 * 0.5), 1.0], rtol=EXACT)


def test_no_tracks_give_empty_tables() -> None:
    ours = associate(np.empty((0, 4)))
    assert ours.beta.shape == ours.beta_given_existence.shape == (0, 5)
    assert ours.exact and len(ours.existence) == 0


def test_a_track_that_does_not_exist_takes_no_measurement() -> None:
    ours = associate(np.full((2, 1), 1e-3), np.array([0.0, 0.5]))
    alone = associate(np.full((1, 1), 1e-3), np.array([0.5]))
    assert_allclose(ours.beta[0], [1.0, 0.0])
    assert_allclose(ours.beta_given_existence[0], 0.0)
    assert_allclose(ours.beta[1], alone.beta[0], rtol=EXACT)


def test_a_sensor_that_cannot_detect_leaves_existence_alone() -> None:
    ours = associate(np.full((1, 2), 1e-3), np.array([0.37]), p_detect=0.0)
    assert_allclose(ours.existence, 0.37, rtol=EXACT)
    assert_allclose(ours.beta, [[1.0, 0.0, 0.0]])


def test_a_certain_track_that_is_always_detected_may_still_lack_a_measurement() -> None:
    ours = associate(np.array([[1e-3], [0.0]]), p_detect=1.0, p_gate=1.0)
    assert_allclose(ours.beta, [[0.0, 1.0], [1.0, 0.0]], atol=1e-9)
    assert_allclose(ours.existence, [1.0, 0.0], atol=1e-9)


def test_p_detect_may_differ_by_track_and_clutter_by_measurement() -> None:
    N = np.array([[1e-3, 0.0], [0.0, 1e-3]])
    ours = joint_marginals(
        N, N > 0, p_detect=[0.5, 0.9], p_gate=1.0, clutter_density=[1e-4, 1e-3], existence=np.ones(2)
    )
    assert_allclose(ours.beta[:, 0], [0.5 / (0.5 + 5.0), 0.1 / (0.1 + 0.9)], rtol=EXACT)


@pytest.mark.parametrize(
    ("name", "value"),
    [("clutter_density", 0.0), ("clutter_density", np.nan), ("p_detect", 1.1), ("p_gate", 0.0), ("p_gate", 1.5)],
)
def test_numbers_out_of_range_are_errors(name: str, value: float) -> None:
    settings = {"p_detect": 0.9, "p_gate": 0.99, "clutter_density": 1e-4} | {name: value}
    with pytest.raises(ValueError, match=name):
        associate(np.full((1, 1), 1e-3), 1.0, **settings)


def test_existence_and_likelihood_out_of_range_are_errors() -> None:
    with pytest.raises(ValueError, match="existence"):
        associate(np.full((1, 1), 1e-3), np.array([1.2]))
    with pytest.raises(ValueError, match="likelihood"):
        associate(np.full((1, 1), np.inf))
    with pytest.raises(ValueError, match="log_missed"):
        sparse_marginals(NONE, NONE, np.empty(0), np.array([-np.inf]), 1, 0)


@pytest.mark.parametrize("size", [500.0, 3e5])
def test_huge_weights_neither_overflow_nor_starve_a_track(size: float) -> None:
    track, measurement = dense(3, 3)
    log_weight = np.where(track == measurement, size, 0.9 * size)  # all want the diagonal
    beta, missed, _ = sparse_marginals(track, measurement, log_weight, np.zeros(3), 3, 3)
    assert_allclose(beta.reshape(3, 3), np.eye(3), atol=EXACT)
    assert_allclose(missed, 0.0, atol=EXACT)


@pytest.mark.parametrize("size", [500.0, 3e5])
def test_tracks_that_all_want_one_measurement_get_equal_shares(size: float) -> None:
    track, measurement = dense(20, 1)
    beta, missed, _ = sparse_marginals(track, measurement, np.full(20, size), np.full(20, -20.0), 20, 1)
    assert_allclose(beta, 0.05, rtol=1e-9)
    assert_allclose(missed, 0.95, rtol=1e-9)


def test_a_hopeless_pair_gets_nothing() -> None:
    track, measurement = dense(2, 2)
    log_weight = np.array([1.0, -3e5, -np.inf, 2.0])
    beta, missed, _ = sparse_marginals(track, measurement, log_weight, np.zeros(2), 2, 2)
    assert_allclose(beta, [1 / (1 + np.exp(-1)), 0, 0, 1 / (1 + np.exp(-2))], atol=EXACT)
    assert_allclose(missed, [1 / (1 + np.e), 1 / (1 + np.e**2)], rtol=EXACT)


def test_a_large_dense_group_is_inexact_and_says_so() -> None:
    track, measurement = dense(13, 13)
    log_weight = np.sin(np.arange(169.0))
    assert sparse_marginals(track, measurement, log_weight, np.zeros(13), 13, 13)[2] == 1
    assert sparse_marginals(track, measurement, log_weight, np.zeros(13), 13, 13, exact_limit=13)[2] == 0


def test_a_long_chain_of_tracks_is_exact() -> None:
    track = np.repeat(np.arange(40), 2)
    measurement = track + np.tile([0, 1], 40)
    log_weight = np.cos(np.arange(80.0))
    exact = sparse_marginals(track, measurement, log_weight, np.zeros(40), 40, 41)
    tree = sparse_marginals(track, measurement, log_weight, np.zeros(40), 40, 41, exact_limit=0)
    assert exact[2] == 0 and tree[2] == 1
    assert_allclose(exact[0], tree[0], atol=1e-6)  # belief propagation is exact on a chain


def test_groups_share_neither_track_nor_measurement() -> None:
    groups = connected_groups(np.array([5, 0, 1, 5, 2]), np.array([1, 3, 3, 0, 0]))
    assert groups.group.tolist() == [1, 0, 0, 1, 1]
    assert groups.track.tolist() == [1, 0, 1, 1, 0]
    assert groups.measurement.tolist() == [1, 0, 0, 0, 0]
    assert groups.n_tracks.tolist() == [2, 2]
    assert groups.n_measurements.tolist() == [1, 2]


def test_no_pairs_make_no_groups() -> None:
    assert len(connected_groups(NONE, NONE)) == 0


@pytest.mark.parametrize("scale", [1.0, 8.0, 400.0])
def test_belief_propagation_ends_where_sweeps_over_all_messages_end(scale: float) -> None:
    """A ring of tight competitors, slow to settle, beside a loose crowd: asking the restless alone changes nothing."""
    rng = np.random.default_rng(3)
    crowd = np.nonzero(rng.random((60, 50)) < 0.15)
    ring = 60 + np.repeat(np.arange(20), 2), 50 + (np.repeat(np.arange(20), 2) + np.tile([0, 1], 20)) % 20
    row, col = (np.concatenate([a, b]) for a, b in zip(crowd, ring, strict=True))
    log_psi = np.concatenate([rng.normal(0.0, scale, len(crowd[0])), np.full(40, 4.0)])
    psi = np.full((80, 70), -np.inf)
    psi[row, col] = log_psi
    nu = np.zeros_like(psi)
    for _ in range(1500):
        mu = psi - log_of_others(psi + nu, axis=1)
        nu = -log_of_others(mu, axis=0)
    expected = np.exp(psi + nu - np.logaddexp(0.0, np.logaddexp.reduce(psi + nu, axis=1, keepdims=True)))
    mixed = rng.permutation(len(row))
    assert_allclose(loopy(row[mixed], col[mixed], log_psi[mixed]), expected[row, col][mixed], atol=1e-6)


def log_of_others(x: FloatArray, *, axis: int) -> FloatArray:
    """log(1 + sum of exp over the others along an axis): those before and those after."""
    x = np.moveaxis(x, axis, 0)
    edge = np.full((1, x.shape[1]), -np.inf)
    before = np.concatenate([edge, np.logaddexp.accumulate(x, axis=0)[:-1]])
    after = np.concatenate([np.logaddexp.accumulate(x[::-1], axis=0)[-2::-1], edge])
    return np.moveaxis(np.logaddexp(0.0, np.logaddexp(before, after)), 0, axis)
