"""Integrated PDA: one track by its formulas, many tracks by one-to-many assignment."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from maritrack.associate import joint_marginals
from maritrack.associate.marginals import log_missed_weight
from maritrack.trackers import steps, tracklist
from maritrack.trackers.ipda import integrated_pda
from maritrack.trackers.tracklist import TrackList
from tests.unit.scans import clusters_of, plain_config, scan_of, step

law = settings(derandomize=True, deadline=None, max_examples=60)
CONFIG = plain_config("ipda")
P_D, P_G = 0.8, 0.99


@law
@given(st.integers(0, 10_000), st.integers(0, 5), st.floats(0, 1))
def test_one_track_follows_the_formulas_of_integrated_pda(seed: int, m: int, r: float) -> None:
    N_over_lam = np.random.default_rng(seed).uniform(0, 5, m)
    delta = 1 - P_D * P_G + P_D * N_over_lam.sum()
    existence, beta, beta0 = integrated_pda(
        np.zeros(m, int), np.log(P_D * N_over_lam), np.array([r]), p_detect=np.array([P_D]), p_gate=P_G
    )
    assert_allclose(existence, delta * r / (1 - r + delta * r), rtol=1e-12)
    assert_allclose(beta, P_D * N_over_lam / delta, rtol=1e-12)
    assert_allclose(beta0, (1 - P_D * P_G) / delta, rtol=1e-12)


@law
@given(st.integers(0, 10_000), st.integers(1, 5), st.floats(0.01, 1))
def test_one_track_is_jipda_of_one_track(seed: int, m: int, r: float) -> None:
    N = np.random.default_rng(seed).uniform(0.01, 5, (1, m))
    joint = joint_marginals(N, N > 0, p_detect=P_D, p_gate=P_G, clutter_density=0.7, existence=[r])
    existence, beta, beta0 = integrated_pda(
        np.zeros(m, int), np.log(P_D * N[0] / 0.7), np.array([r]), p_detect=np.array([P_D]), p_gate=P_G
    )
    assert_allclose(existence, joint.existence, rtol=1e-12)
    assert_allclose(np.append(beta0, beta), joint.beta_given_existence[0], rtol=1e-10)


def test_weights_sum_to_one_and_tracks_do_not_touch_each_other() -> None:
    rng = np.random.default_rng(2)
    track, log_ratio, r = np.array([0, 0, 2, 2, 2, 3]), rng.normal(0, 3, 6), rng.uniform(0, 1, 4)
    p_detect = np.array([0.8, 0.8, 0.6, 0.9])
    existence, beta, beta0 = integrated_pda(track, log_ratio, r, p_detect=p_detect, p_gate=P_G)
    assert_allclose(np.bincount(track, beta, 4) + beta0, 1.0, rtol=1e-12)
    for t in range(4):
        mine = track == t
        alone = integrated_pda(
            np.zeros(mine.sum(), int), log_ratio[mine], r[t : t + 1], p_detect=p_detect[t : t + 1], p_gate=P_G
        )
        assert_allclose(alone[0], existence[t], rtol=1e-12)
        assert_allclose(alone[1], beta[mine], rtol=1e-12)


@pytest.mark.parametrize("log_ratio", [-np.inf, -2000.0, 2000.0])
@pytest.mark.parametrize("r", [0.0, 1e-300, 1.0])
def test_extremes_stay_probabilities(log_ratio: float, r: float) -> None:
    existence, beta, beta0 = integrated_pda(
        np.zeros(1, int), np.array([log_ratio]), np.array([r]), p_detect=np.array([P_D]), p_gate=P_G
    )
    assert_allclose(beta + beta0, 1.0)
    assert existence[0] == r if r in (0.0, 1.0) else 0.0 <= existence[0] <= 1.0


def test_out_of_sight_nothing_changes() -> None:
    existence, _, beta0 = integrated_pda(
        np.zeros(0, int), np.zeros(0), np.array([0.3, 0.9]), p_detect=np.zeros(2), p_gate=P_G
    )
    assert_allclose(existence, [0.3, 0.9], rtol=1e-12)
    assert_allclose(beta0, 1.0)


def tracks_at(*places: tuple[float, float]) -> TrackList:
    """Tracks of the default numbers that have been seen three times at places in order of azimuth."""
    state = None
    for k in range(3):
        state = step(CONFIG, state, np.array(places), float(k))
    assert state is not None and len(state) == len(places)
    return state


def test_a_cluster_serves_the_nearest_track_alone() -> None:
    state = tracks_at((0.0, 1000.0), (30.0, 1000.0))
    after = step(CONFIG, state, [[10.0, 1000.0]], 3.0)
    r = state.existence[1]
    assert after.hits.tolist() == [4, 3] and after.cluster.tolist() == [0, -1]
    assert after.existence[1] == pytest.approx((1 - P_D * P_G) * r / (1 - P_D * P_G * r), rel=1e-9)
    assert after.density.x[0, 0] > 1.0


def test_a_track_may_use_several_clusters() -> None:
    state = tracks_at((0.0, 1000.0))
    one = step(CONFIG, state, [[0.0, 1008.0]], 3.0)
    both = step(CONFIG, state, [[0.0, 1008.0], [0.0, 992.0]], 3.0)
    assert one.density.x[0, 1] > both.density.x[0, 1] + 1.0
    assert both.density.x[0, 1] == pytest.approx(1000.0, abs=0.5)


def test_a_cluster_goes_to_the_likeliest_track_or_to_the_nearest_as_asked() -> None:
    """A little nearer to a track that hardly exists than to one that does."""
    state = tracks_at((0.0, 1000.0), (30.0, 1000.0))
    faint = np.array([1e-9, 0.999])
    state = TrackList(**{name: getattr(state, name) for name in TrackList.__slots__} | {"existence": faint})
    for how, misses in (("likeliest", [1, 0]), ("nearest", [1, 1])):  # the faint one takes it and still is a miss
        config = plain_config("ipda", f"tracker.assign_by={how}", "tracker.delete_existence=0.0")
        assert step(config, state, [[14.0, 1000.0]], 3.0).misses.tolist()[:2] == misses


@pytest.mark.parametrize("name", ["sprt", "ipda"])
def test_a_track_out_of_sight_takes_no_cluster_from_one_in_sight(name: str) -> None:
    state = tracks_at((0.0, 985.0), (2.0, 1003.0))
    config = plain_config(name, "tracker.delete_existence=0.0", "input.roi_max_m=1000.0")
    after = step(config, state, [[1.0, 998.0]], 3.0)
    assert after.misses.tolist() == [0, 1] and after.id.tolist() == [1, 2]
    assert after.existence[1] == pytest.approx(min(state.existence[1], 0.999), abs=1.1e-3)  # sprt has a cap


@pytest.mark.parametrize("name", ["sprt", "ipda", "jipda"])
def test_a_limit_of_pairs_keeps_the_cheapest_clusters_of_each_track(name: str) -> None:
    state = tracks_at((0.0, 1000.0), (500.0, 1000.0))
    z = np.array([[0.0, 1002.0], [0.0, 994.0], [0.0, 1009.0], [500.0, 1001.0]])
    scan, points = scan_of(z, 3.0)
    config = plain_config(name)
    clusters = clusters_of(CONFIG, z, 3.0)
    every = steps.look(state, scan, points, clusters, config)
    assert len(every.pairs.i) == 4
    for most, kept in ((1, [1002.0, 1001.0]), (2, [994.0, 1002.0, 1001.0]), (9, [994.0, 1002.0, 1009.0, 1001.0])):
        some = steps.look(state, scan, points, clusters, plain_config(name, f"tracker.pairs_per_track={most}"))
        assert_allclose(np.sort(clusters.mean_m[some.pairs.j, 1]), np.sort(kept))
        assert len(some.dt_s) == len(kept) == len(some.pairs.nu)
    nothing_else = step(plain_config(name, "tracker.pairs_per_track=9"), state, z, 3.0)
    assert_allclose(nothing_else.density.x, step(config, state, z, 3.0).density.x, rtol=1e-12)


def test_a_track_starts_where_more_than_half_of_a_cluster_is_unexplained() -> None:
    z, none = np.array([[0.0, 300.0], [0.0, 900.0], [0.0, 1500.0]]), np.zeros(0)
    scan, points = scan_of(z, 0.0)
    clusters, state = clusters_of(CONFIG, z, 0.0), tracklist.empty()
    sight = steps.look(state, scan, points, clusters, CONFIG)
    outcome = steps.Outcome(
        density=state.density, existence=none, hit=none.astype(bool), cluster=none.astype(np.int64),
        unexplained=np.array([0.49, 0.51, 1.0]),
    )  # fmt: skip
    after, _ = steps.carry_on(state, sight, outcome, scan, points, clusters, CONFIG)
    assert_allclose(after.density.x[:, 1], [900.0, 1500.0])


def test_the_cost_of_a_pair_is_minus_twice_its_log_density_with_the_full_extent() -> None:
    state = tracks_at((0.0, 1000.0))
    z = np.array([[3.0, 1004.0]])
    scan, points = scan_of(z, 3.0)
    config = plain_config("ipda", "tracker.assign_by=nearest")
    sight = steps.look(state, scan, points, clusters_of(CONFIG, z, 3.0), config)
    S = sight.tracks.density.P[0, :2, :2] + 25.0 * np.eye(2)
    nu = z[0] - sight.tracks.density.x[0, :2]
    want = nu @ np.linalg.solve(S, nu) + np.log(np.linalg.det(S))
    assert_allclose(steps.gate_cost(sight, config), want, rtol=1e-9)
    with_existence = steps.gate_cost(sight, plain_config("ipda"))
    assert_allclose(with_existence, want - 2 * np.log(sight.tracks.existence), rtol=1e-9)
    assert_allclose(log_missed_weight(np.ones(1), p_detect=P_D, p_gate=P_G), np.log(1 - P_D * P_G))


def test_the_density_of_clutter_follows_its_scans_by_a_twentieth() -> None:
    """Four clusters at the corners of a square, then of a larger one: 4 a km^2, then 1."""
    corners = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]])
    config, state = plain_config("ipda", "model.clutter=estimated"), None
    for k, (side_m, begin_m) in enumerate(((1000.0, 500.0), (2000.0, 5000.0))):
        state = step(config, state, begin_m + side_m * corners, float(k))
    assert_allclose(state.clutter["p"].density_per_m2, [0.95 * 4e-6 + 0.05 * 1e-6], rtol=1e-6)
