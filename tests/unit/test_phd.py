"""The PHD filter: weights, reduction and labels, births, what is reported."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from maritrack.config import load_config
from maritrack.errors import ConfigError
from maritrack.objects.giw import Giw
from maritrack.settings import Config
from maritrack.trackers import TRACKERS, phd, tracklist
from maritrack.trackers.tracklist import TrackList
from maritrack.types import COASTED, CONFIRMED, TENTATIVE
from tests.unit.scans import clusters_of, plain_config, scan_of, step

law = settings(derandomize=True, deadline=None, max_examples=60)
NAME = "cb-giw-phd"
CONFIG = plain_config(NAME)
OBJECT = np.array([[300.0, 400.0]])


def components(weights: list[float], labels: list[int], places: list[float]) -> TrackList:
    """Components at rest along a line, with a standard deviation of 5 m, at time 0."""
    n = len(weights)
    x = np.zeros((n, 4))
    x[:, 0] = places
    d = Giw(x, np.tile(np.diag([25.0, 25.0, 1.0, 1.0]), (n, 1, 1)), np.zeros((n, 2, 2)), np.full(n, 4.0))
    zero, one, no = np.zeros(n, np.int64), np.ones(n, np.int64), np.zeros(n, bool)
    return TrackList(
        d, zero, np.array(weights), np.array(labels, np.int64), one, zero, no, x[:, :2].copy(), no, np.zeros(n), zero,
        zero, np.zeros(n), next_id=100,
    )  # fmt: skip


def reduced(mixture: TrackList, config: Config = CONFIG) -> TrackList:
    return phd.relabel(phd.reduce_mixture(mixture, 0, config.cluster.eps_m, config)[0], config.phd)


@law
@given(st.integers(0, 10_000), st.integers(1, 5), st.integers(1, 4))
def test_weights_are_those_of_plain_loops_on_numbers_that_are_no_logarithms(seed: int, n: int, m: int) -> None:
    rng = np.random.default_rng(seed)
    w, likelihood = rng.uniform(0.01, 1.5, n), rng.uniform(0.0, 30.0, (n, m)) * (rng.random((n, m)) < 0.7)
    i, j = np.nonzero(likelihood)
    log_w, left = phd.detected_weights(np.log(w[i] * likelihood[i, j]), j, m)
    for k in range(len(i)):
        total = 1.0 + sum(w[a] * likelihood[a, j[k]] for a in range(n))
        assert_allclose(math.exp(log_w[k]), w[i[k]] * likelihood[i[k], j[k]] / total, rtol=1e-12)
    for b in range(m):
        taken = sum(math.exp(log_w[k]) for k in range(len(i)) if j[k] == b)
        assert_allclose(left[b], 1.0 - taken, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("log_wl", [-2000.0, 2000.0])
def test_weights_beyond_the_range_of_numbers_stay_finite_logarithms(log_wl: float) -> None:
    log_w, left = phd.detected_weights(np.array([log_wl, log_wl - 1.0]), np.zeros(2, int), 1)
    assert_allclose(log_w[1] - log_w[0], -1.0)
    assert_allclose(np.exp(log_w).sum() + left, 1.0, rtol=1e-12)


def test_the_whole_update_is_that_of_plain_loops() -> None:
    """Two components, two clusters in the gates of both, no merging: the weights of the sheet's formulas."""
    config = plain_config(
        NAME, "phd.merge_distance2=0.0", "phd.prune_weight=1e-12", "model.clutter_density_per_m2=1e-4"
    )
    state = replace(components([0.6, 0.3], [1, 2], [300.0, 306.0]), next_id=3)
    z = np.array([[298.0, 2.0], [309.0, -1.0]])
    after = step(config, state, z, 0.0)
    S = 25.0 + 25.0
    ell = np.array(
        [[0.8 * math.exp(-(np.sum((zj - [x, 0.0]) ** 2)) / 2 / S) / (2 * math.pi * S) / 1e-4 for zj in z]
         for x in (300.0, 306.0)]
    )  # fmt: skip
    w = np.array([0.6, 0.3])
    expected = [w[i] * ell[i, j] / (1 + sum(w[a] * ell[a, j] for a in range(2))) for i in range(2) for j in range(2)]
    expected += [w[i] * (1 - 0.8 * 0.99) for i in range(2)]
    assert_allclose(np.sort(after.existence), np.sort(expected), rtol=1e-9)


def test_a_component_is_missed_with_what_detection_and_gate_leave() -> None:
    state = step(CONFIG, components([1.0], [1], [300.0]), np.zeros((0, 2)), 10.0)
    assert_allclose(state.existence, [0.95 * (1 - 0.8 * 0.99)])
    assert state.misses.tolist() == [1]
    assert state.cluster.tolist() == [-1]


def test_out_of_sight_a_component_loses_only_what_does_not_survive() -> None:
    far = replace(CONFIG, input=replace(CONFIG.input, roi_max_m=200.0))
    state = step(far, components([0.8], [1], [300.0]), np.zeros((0, 2)), 10.0)
    assert_allclose(state.existence, [0.95 * 0.8])
    immortal = replace(far, phd=replace(far.phd, p_survive_scan=1.0))
    state = step(immortal, components([0.8], [1], [300.0]), np.zeros((0, 2)), 10.0)
    assert_allclose(state.existence, [0.8])


def test_a_scan_at_the_same_time_costs_no_survival() -> None:
    state = step(CONFIG, components([1.0], [1], [300.0]), np.zeros((0, 2)), 0.0)
    assert_allclose(state.existence, [1 - 0.8 * 0.99])


def test_survival_by_the_second_is_that_of_the_model() -> None:
    config = plain_config(NAME, "phd.p_survive_scan=0.0", "model.p_survive=0.9")
    state = step(config, components([1.0], [1], [300.0]), np.zeros((0, 2)), 2.0)
    assert_allclose(state.existence, [0.9**2 * (1 - 0.8 * 0.99)])


def test_a_cluster_that_nothing_explains_is_born_and_not_updated_in_the_same_scan() -> None:
    state = step(CONFIG, None, OBJECT, 0.0)
    assert_allclose(state.existence, [0.05])
    assert state.hits.tolist() == [1]
    again = step(CONFIG, state, OBJECT, 1.0)
    assert again.hits.max() == 2
    assert again.existence.max() > 0.5


def test_a_cluster_that_is_explained_bears_nothing() -> None:
    state = step(CONFIG, components([1.0], [1], [300.0]), np.array([[301.0, 0.0]]), 1.0)
    assert state.id.tolist() == [1]
    assert_allclose(state.existence, [1.0 + 0.95 * 0.208], atol=0.01)  # the missed copy has merged into the updated one


def test_a_cluster_that_is_explained_by_more_than_half_bears_nothing() -> None:
    """A light component explains 0.72 of it: 2.55 / (1 + 2.55)."""
    state = step(CONFIG, components([1e-3], [1], [300.0]), np.array([[300.0, 0.0]]), 0.0)
    assert state.id.tolist() == [1]
    assert 0.6 < state.existence[0] < 0.8


def test_what_is_alike_merges_under_the_label_of_the_heaviest() -> None:
    mixture = components([0.2, 0.9, 0.1], [1, 2, 3], [0.0, 2.0, 500.0])
    state = reduced(mixture)
    assert state.id.tolist() == [2, 3]
    assert_allclose(state.existence, [1.1, 0.1])
    assert_allclose(state.density.x[:, 0], [(0.2 * 0.0 + 0.9 * 2.0) / 1.1, 500.0])


def test_of_two_components_with_one_label_the_heavier_keeps_it() -> None:
    mixture = components([0.3, 0.7, 0.05], [5, 5, 5], [0.0, 400.0, 800.0])
    state = reduced(replace(mixture, confirmed=np.ones(3, bool)))
    assert state.id.tolist() == [5, 100, 101]
    assert_allclose(state.existence, [0.7, 0.3, 0.05])
    assert state.confirmed.tolist() == [True, False, False]  # under a new label nothing has been confirmed
    assert state.next_id == 102


def test_extents_that_differ_do_not_merge() -> None:
    mixture = components([0.9, 0.2], [1, 2], [0.0, 0.0])
    X = np.array([np.diag([400.0, 100.0]), np.diag([900.0, 100.0])])  # 10 m in one axis
    mixture = replace(mixture, density=replace(mixture.density, X=X))
    extended = replace(CONFIG, model=replace(CONFIG.model, extent="random-matrix"))
    for eps_m, left in ((36.0, 2), (44.0, 1)):
        assert len(phd.reduce_mixture(mixture, 0, eps_m, extended)[0]) == left
    for limit, left in ((0.5, 2), (25.0, 1)):
        kl = replace(extended, phd=replace(extended.phd, merge_extent="kl", merge_kl=limit))
        assert len(phd.reduce_mixture(mixture, 0, 36.0, kl)[0]) == left


HULLS = replace(CONFIG, model=replace(CONFIG.model, extent="random-matrix"))
UNITE = replace(HULLS, phd=replace(HULLS.phd, unite_distance2=4.0))


def hulls(weights: list[float], labels: list[int], places: list[float], lengths: list[float]) -> TrackList:
    """Components whose hulls lie along the line, 20 m wide."""
    mixture = components(weights, labels, places)
    X = np.array([np.diag([(length / 2) ** 2, 100.0]) for length in lengths])
    return replace(mixture, density=replace(mixture.density, X=X), confirmed=np.ones(len(X), bool))


def test_a_part_in_the_hull_of_an_older_one_joins_it_and_leaves_it_as_it_is() -> None:
    """A small hull 60 m from the middle of one of 200 m: within its half length, 100 m away it is not."""
    mixture = hulls([0.8, 0.9, 0.7], [1, 2, 3], [0.0, 60.0, 115.0], [200.0, 20.0, 20.0])
    state = reduced(mixture, UNITE)
    assert state.id.tolist() == [1, 3]
    assert_allclose(state.existence, [0.8 + 0.9, 0.7])
    assert_array_equal(state.density.x[0], mixture.density.x[0])
    assert_array_equal(state.density.P[0], mixture.density.P[0])
    assert_array_equal(state.density.X[0], mixture.density.X[0])
    assert reduced(mixture, HULLS).id.tolist() == [1, 2, 3]


def test_parts_of_one_label_are_the_heaviest_of_them() -> None:
    state = reduced(hulls([0.8, 0.9], [1, 1], [0.0, 60.0], [200.0, 200.0]), UNITE)
    assert state.id.tolist() == [1]
    assert_allclose(state.density.x[:, 0], [60.0])
    assert_allclose(state.existence, [1.7])


def test_what_is_not_reported_is_never_the_whole_of_what_is() -> None:
    mixture = hulls([0.4, 0.9], [1, 2], [0.0, 60.0], [200.0, 200.0])
    assert reduced(mixture, UNITE).id.tolist() == [2]


def test_what_crosses_a_hull_at_its_own_speed_is_no_part_of_it() -> None:
    mixture = hulls([0.8, 0.9], [1, 2], [0.0, 60.0], [200.0, 20.0])
    mixture.density.x[1, 3] = 5.0  # 3.5 standard deviations of the difference
    assert reduced(mixture, UNITE).id.tolist() == [1, 2]


def test_a_birth_weighs_what_the_densities_of_births_and_clutter_say() -> None:
    config = plain_config(NAME, "phd.birth_weight=0.0", "tracker.birth_density_per_m2=1e-7")
    born = 0.8 * 1e-7
    assert_allclose(step(config, None, OBJECT, 0.0).existence, [born / (1e-6 + born)])


def test_a_heavy_component_is_reported_after_as_many_hits_as_asked_for() -> None:
    config = plain_config(NAME, "phd.extract_hits=3")
    state, seen = None, []
    for k in range(4):
        state = step(config, state, OBJECT, float(k))
        status = TRACKERS[NAME](config).estimate(state).status
        seen.append((bool((state.existence > 0.5).any()), int((status == CONFIRMED).sum())))
    assert seen == [(False, 0), (True, 0), (True, 1), (True, 1)]


def test_components_are_compared_at_one_time() -> None:
    """On both sides of the azimuth at which a scan begins, one has been predicted a turn further than the other."""
    mixture = components([0.3, 0.9], [1, 2], [0.0, 25.0])
    v = np.tile([0.0, 0.0, 10.0, 0.0], (2, 1))
    mixture = replace(
        mixture,
        density=replace(mixture.density, x=mixture.density.x + v),
        t_ns=np.array([0, 2_500_000_000]),
    )
    state = reduced(mixture)
    assert_allclose(state.existence, [1.2])
    assert state.t_ns.tolist() == [2_500_000_000]
    assert_allclose(state.density.x, [[25.0, 0.0, 10.0, 0.0]], atol=1e-9)


def test_each_component_is_followed_over_its_own_time_and_knows_its_predecessor() -> None:
    """The judgement of motion settles with the seconds since each component's own last update."""
    state = components([0.3, 0.9, 0.5], [1, 2, 3], [300.0, 3000.0, 6000.0])
    state = replace(state, t_ns=np.array([0, 4, 8]) * 10**9)
    after = step(CONFIG, state, np.array([[6000.0, 0.0]]), 10.0)
    tau_s = CONFIG.tracker.moving_time_constant_s
    assert after.id.tolist() == [1, 2, 3]
    assert_allclose(after.settled, -np.expm1(-np.array([10.0, 6.0, 2.0]) / tau_s))
    mixture = components([0.2, 0.9, 0.1], [1, 2, 3], [0.0, 500.0, 1000.0])
    heaviest_first, kept = phd.reduce_mixture(mixture, 0, 55.0, CONFIG)
    assert heaviest_first.id.tolist() == [2, 1, 3]
    assert_array_equal(mixture.id[kept], heaviest_first.id)


@law
@given(st.integers(0, 10_000), st.integers(1, 12))
def test_the_cap_keeps_the_heaviest(seed: int, most: int) -> None:
    rng = np.random.default_rng(seed)
    w = rng.uniform(0.01, 1.0, 10)
    mixture = components(w.tolist(), list(range(10)), (500.0 * np.arange(10)).tolist())
    config = replace(CONFIG, phd=replace(CONFIG.phd, max_components=most))
    assert_allclose(np.sort(reduced(mixture, config).existence)[::-1], np.sort(w)[::-1][:most])


def test_new_components_take_the_room_of_lighter_ones_and_no_more() -> None:
    config = plain_config(NAME, "phd.max_components=3")
    state = components([0.9, 0.02], [1, 2], [3000.0, 6000.0])
    scan, points = scan_of(np.array([[0.0, 300.0], [0.0, 900.0], [0.0, 1500.0]]), 0.0)
    clusters = clusters_of(config, points.position_m, 0.0)
    after, left_out = phd.give_birth(state, scan, points, clusters, np.ones(3), config)
    assert left_out == 1
    assert len(after) == 3
    assert after.id[0] == 1
    assert_allclose(after.existence, [0.9, 0.05, 0.05])


def test_a_component_starts_where_more_than_half_of_a_cluster_is_unexplained() -> None:
    scan, points = scan_of(np.array([[0.0, 300.0], [0.0, 900.0], [0.0, 1500.0]]), 0.0)
    clusters = clusters_of(CONFIG, points.position_m, 0.0)
    after, _ = phd.give_birth(tracklist.empty(), scan, points, clusters, np.array([0.49, 0.51, 1.0]), CONFIG)
    assert_allclose(after.density.x[:, 1], [900.0, 1500.0])


def test_pruning_leaves_out_what_is_light() -> None:
    config = plain_config(NAME, "phd.p_survive_scan=1.0", "phd.prune_weight=0.01")
    state = step(config, components([1.0, 0.04], [1, 2], [300.0, 900.0]), np.zeros((0, 2)), 1.0)
    assert state.id.tolist() == [1]  # 0.04 * 0.208 is below


def test_confirmed_is_what_is_heavy_and_existence_never_exceeds_one() -> None:
    state = components([0.4, 0.6, 1.7], [1, 2, 3], [0.0, 500.0, 1000.0])
    tracks = TRACKERS[NAME](CONFIG).estimate(state)
    assert tracks.status.tolist() == [TENTATIVE, CONFIRMED, CONFIRMED]
    assert_allclose(tracks.existence, [0.4, 0.6, 1.0])


def test_a_missed_object_blinks_unless_it_is_held() -> None:
    shown: dict[int, list[int]] = {}
    for hold in (0, 2):
        config = plain_config(NAME, f"phd.hold_scans={hold}")
        state, shown[hold] = None, []
        for k in range(8):
            state = step(config, state, OBJECT if k < 5 else np.zeros((0, 2)), float(k))
            tracks = TRACKERS[NAME](config).estimate(state)
            shown[hold].append(int(tracks.status[np.argmax(state.existence)]))
    assert shown[0] == [TENTATIVE, *[CONFIRMED] * 4, TENTATIVE, TENTATIVE, TENTATIVE]
    assert shown[2] == [TENTATIVE, *[CONFIRMED] * 4, COASTED, COASTED, TENTATIVE]


def test_an_object_keeps_its_label_over_a_gap_of_two_scans() -> None:
    state, labels = None, []
    for k in range(14):
        state = step(CONFIG, state, np.zeros((0, 2)) if k in (7, 8) else OBJECT + np.array([4.0 * k, 0.0]), float(k))
        heaviest = int(np.argmax(state.existence))
        labels.append(int(state.id[heaviest]))
        assert state.misses[heaviest] == {7: 1, 8: 2}.get(k, 0)
    assert set(labels) == {1}


def test_an_object_under_way_is_judged_to_move() -> None:
    state = None
    for k in range(60):
        state = step(CONFIG, state, OBJECT + np.array([8.0 * k, 0.0]), float(k))
    assert state is not None
    heaviest = int(np.argmax(state.existence))
    assert state.moving[heaviest]
    assert_allclose(state.density.x[heaviest, 2:], [8.0, 0.0], atol=0.5)


def test_no_clusters_and_no_components_are_no_trouble() -> None:
    state = step(CONFIG, None, np.zeros((0, 2)), 0.0)
    assert len(state) == 0
    assert len(TRACKERS[NAME](CONFIG).estimate(state)) == 0
    assert_array_equal(tracklist.empty().id, state.id)


@pytest.mark.parametrize(
    "wrong", ["phd.prune_weight=0.1", "phd.birth_weight=1.0", "phd.max_components=0", "phd.extract_weight=0.0"]
)
def test_settings_that_make_no_sense_are_refused(wrong: str) -> None:
    with pytest.raises(ConfigError):
        load_config(preset="points", sets=[wrong])
