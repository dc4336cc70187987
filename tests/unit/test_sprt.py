"""The sequential probability ratio test: counts of hits and misses, and nothing else."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.special import expit

from maritrack.errors import ConfigError
from maritrack.objects import giw
from maritrack.trackers import steps, tracklist
from maritrack.trackers.sprt import false_alarm, limits, log_ratio_step, with_limits_of_the_test
from maritrack.tracksettings import SprtConfig
from tests.unit.scans import clusters_of, plain_config, scan_of, step

HERE, NOTHING = [[300.0, 400.0]], np.zeros((0, 2))
HIT, MISS = math.log(0.8 * 0.99 / 0.01), math.log((1 - 0.8 * 0.99) / 0.99)
CONFIG = plain_config("sprt")


def after(pattern: str, *sets: str) -> tracklist.TrackList:
    """The state after a scan that starts one track and then hits (x) and misses (.) of it."""
    config, state = plain_config("sprt", *sets), None
    for k, sign in enumerate("x" + pattern):
        state = step(config, state, HERE if sign == "x" else NOTHING, float(k))
    assert state is not None
    return state


def ratio(state: tracklist.TrackList) -> float:
    (r,) = state.existence.tolist()
    return math.log(r / (1 - r))


def test_a_hit_and_a_miss_count_as_the_paper_s_numbers_say() -> None:
    """P_D = 0.8, P_FA = 0.01, P_G = 0.99."""
    hit, missed, unseen = np.array([True, False, False]), np.array([0.8, 0.8, 0.0]), np.zeros(1)
    got = log_ratio_step(hit, missed, 0.99, np.full(3, SprtConfig().p_false_alarm))
    assert_allclose(got, [4.372, -1.560, 0.0], atol=5e-4)
    assert_allclose(got, [HIT, MISS, *unseen], rtol=1e-12)


def test_the_false_alarm_of_a_gate_is_that_of_its_clutter() -> None:
    """1 - exp(-lambda A), A = pi 9.21 sqrt|S|, against gates counted in a field of clutter."""
    config = plain_config("sprt", "sprt.p_false_alarm=0.0", "model.clutter_density_per_m2=2e-4")
    scan, points = scan_of(HERE, 1.0)
    sight = steps.look(step(config, None, HERE, 0.0), scan, points, clusters_of(config, np.array(HERE), 1.0), config)
    P = sight.tracks.density.P[0, :2, :2]
    rng, n = np.random.default_rng(3), 4000
    counts = rng.poisson(2e-4 * 400.0**2, n)
    field = rng.uniform(-200, 200, (counts.sum(), 2))
    inside = np.einsum("ni,ij,nj->n", field, np.linalg.inv(P), field) < -2 * math.log(0.01)
    full = np.bincount(np.repeat(np.arange(n), counts), inside, n) > 0
    (p,) = false_alarm(sight, scan, config)
    assert 0.05 < p < 0.95
    assert_allclose(p, full.mean(), atol=4 * math.sqrt(p * (1 - p) / n))


def test_the_gate_of_a_hull_has_room_for_a_centre_anywhere_on_it() -> None:
    """A = pi 9.21 sqrt|P + X / 4|."""
    config = plain_config("sprt", "sprt.p_false_alarm=0.0", "model.clutter_density_per_m2=2e-5")
    scan, points = scan_of(HERE, 1.0)
    sight = steps.look(step(config, None, HERE, 0.0), scan, points, clusters_of(config, np.array(HERE), 1.0), config)
    d, X = sight.tracks.density, np.diag([80.0**2, 12.0**2])
    hull = replace(sight, tracks=replace(sight.tracks, density=replace(d, X=X[None])))
    area_m2 = math.pi * -2 * math.log(0.01) * math.sqrt(np.linalg.det(d.P[0, :2, :2] + X / 4))
    (p,) = false_alarm(hull, scan, config)
    assert_allclose(p, 1 - math.exp(-2e-5 * area_m2), rtol=1e-9)
    assert p > 1.5 * false_alarm(sight, scan, config)[0]


def test_a_hull_takes_the_cluster_that_looks_like_it() -> None:
    """A speck of clutter amidships, the hull itself a little off: by place alone the speck is taken."""
    rng = np.random.default_rng(0)
    hull = [500.0, 900.0] + rng.uniform(-1, 1, (300, 2)) * [60.0, 8.0]
    speck = [500.0, 907.0] + rng.uniform(-1, 1, (4, 2)) * 3.0
    scene = np.concatenate([hull - [0.0, 15.0], speck])
    taken = []
    for by_shape in ("false", "true"):
        config = plain_config("sprt", "model.extent=random-matrix", "cluster.method=cartesian-dbscan",
                              "cluster.eps_m=8.0", "cluster.min_points=3", f"sprt.assign_by_shape={by_shape}",
                              "model.accel_psd_m2ps3=10.0")  # fmt: skip
        state = None
        for k in range(3):
            state = step(config, state, hull, float(k))
        clusters = clusters_of(config, scene, 3.0)
        state = step(config, state, scene, 3.0)
        assert sorted(clusters.count.tolist()) == [4, 300]
        taken.append(int(clusters.count[state.cluster[0]]))
    assert taken == [4, 300]


def test_wald_s_limits_of_one_in_a_thousand_and_one_in_twenty() -> None:
    low, high = limits(SprtConfig(alpha=1e-3, beta=0.05))
    assert_allclose([low, high], [-2.995, 6.856], atol=1e-3)


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.text("x.", max_size=12))
def test_existence_is_the_clipped_sum_of_hits_and_misses(pattern: str) -> None:
    L, cap = 0.0, math.log(0.999 / 0.001)
    for k, sign in enumerate(pattern):
        L = min(L + (HIT if sign == "x" else MISS), cap)
        if math.log(0.05 / 0.999) >= L:
            pattern = pattern[: k + 1]
            assert len(after(pattern)) == 0
            return
    assert ratio(after(pattern)) == pytest.approx(L, abs=1e-9)


def test_two_hits_confirm_a_new_track_and_two_misses_end_it() -> None:
    assert not after("x").confirmed.any() and after("xx").confirmed.all()
    assert len(after(".")) == 1 and len(after("..")) == 0


@pytest.mark.parametrize("alpha", [0.1, 1e-2, 1e-3, 1e-6, 1e-9])
def test_hits_to_confirm_are_the_limit_over_the_gain(alpha: float) -> None:
    wanted = math.ceil(math.log(0.95 / alpha) / HIT)
    sets = (f"sprt.alpha={alpha}", "sprt.existence_max=0.9999999999")
    assert not after("x" * (wanted - 1), *sets).confirmed.any()
    assert after("x" * wanted, *sets).confirmed.all()


@pytest.mark.parametrize("beta", [0.2, 0.05, 1e-3, 1e-8])
def test_misses_to_end_an_old_track_are_the_way_from_the_cap_over_the_loss(beta: float) -> None:
    wanted = math.ceil((math.log(0.999 / 0.001) - math.log(beta / 0.999)) / -MISS)
    assert len(after("x" * 9 + "." * (wanted - 1), f"sprt.beta={beta}")) == 1
    assert len(after("x" * 9 + "." * wanted, f"sprt.beta={beta}")) == 0
    assert beta != 0.05 or wanted == 7


def test_an_old_track_never_exists_more_than_the_cap_says() -> None:
    assert_allclose(after("x" * 30).existence, 0.999)


def test_a_cap_below_the_limit_that_confirms_is_raised_to_it() -> None:
    state = after("xxxx", "sprt.existence_max=0.9")
    assert state.confirmed.all() and state.existence[0] == pytest.approx(0.95 / (0.95 + 1e-3))


def test_misses_in_a_row_end_a_track_before_the_ratio_does_where_the_settings_say_so() -> None:
    assert len(after("xxxxx...", "tracker.delete_misses=2")) == 0
    assert len(after("xxxxx..", "tracker.delete_misses=2")) == 1


def test_a_new_track_begins_at_the_start_ratio() -> None:
    assert ratio(after("", "sprt.start_ratio=1.5")) == pytest.approx(1.5)


def test_neither_place_nor_clutter_nor_survival_matter_to_existence() -> None:
    state = after("x")
    moved = [step(CONFIG, state, [[300.0 + e, 400.0]], 2.0).existence[0] for e in (0.0, 3.0, 9.0)]
    thick = plain_config("sprt", "model.clutter_density_per_m2=1.0", "model.p_survive=0.5")
    assert moved == [moved[0]] * 3 == [step(thick, state, HERE, 2.0).existence[0]] * 3


def test_a_scan_that_did_not_look_is_no_miss_and_gives_no_cluster() -> None:
    state = after("x")
    blind = replace(CONFIG, input=replace(CONFIG.input, roi_max_m=100.0))
    for z in (HERE, NOTHING):
        later = step(blind, state, z, 2.0)
        assert later.existence[0] == pytest.approx(state.existence[0])
        assert later.misses[0] == 1 and later.cluster[0] == -1


@pytest.mark.parametrize("sets", [(), ("model.extent=random-matrix", "cluster.method=cartesian-dbscan")])
def test_a_hit_updates_the_density_as_if_it_were_certain(sets: tuple[str, ...]) -> None:
    config, state = plain_config("sprt", *sets), None
    hull = (
        np.array([[300.0 + e, 400.0 + n] for e in (-40, -20, 0, 20, 40) for n in (-8, 8)]) if sets else np.array(HERE)
    )
    for k in range(3):
        state = step(config, state, hull, float(k))
    z = hull + np.array([6.0, -5.0])
    scan, points = scan_of(z, 3.0)
    clusters = clusters_of(config, z, 3.0)
    sight = steps.look(state, scan, points, clusters, config)
    want = giw.update(sight.tracks.density, clusters, sight.pairs, np.ones(1), np.zeros(1), config.model)
    got = step(config, state, z, 3.0)
    for name in ("x", "P", "X", "alpha"):
        assert_allclose(getattr(got.density, name), getattr(want, name), rtol=1e-12)


def test_of_two_clusters_in_one_gate_the_nearer_is_taken_and_the_other_starts_a_track() -> None:
    state = step(CONFIG, after("xxx"), [[300.0, 402.0], [300.0, 391.0]], 4.0)
    assert state.id.tolist() == [1, 2]
    assert_allclose(state.density.x[1, :2], [300.0, 391.0])
    assert state.misses.tolist() == [0, 0]


def test_one_cluster_serves_one_of_two_tracks() -> None:
    state = step(CONFIG, None, [[300.0, 400.0], [300.0, 425.0]], 0.0)
    state = step(CONFIG, state, [[300.0, 410.0]], 1.0)
    assert state.misses.tolist() == [1, 0]  # the second one has the smaller azimuth
    assert_allclose(state.existence, expit([MISS, HIT]))


@pytest.mark.parametrize(("how", "taken"), [("greedy", [1, -1]), ("optimal", [0, 1])])
def test_assignment_is_greedy_or_optimal_as_asked(how: str, taken: list[int]) -> None:
    """Both tracks reach the second cluster, only the first track the first one as well."""
    config = plain_config("sprt", f"sprt.assignment={how}", "model.sigma_velocity_mps=1.0", "model.p_gate=0.999")
    state = step(config, None, [[100.0, 1000.0], [120.0, 1000.0]], 0.0)
    state = step(config, state, [[88.0, 1000.0], [109.0, 1000.0]], 0.01)
    assert state.cluster[:2].tolist() == taken


def test_the_settings_of_the_test_replace_those_on_existence_alone() -> None:
    config = with_limits_of_the_test(CONFIG)
    low, high = limits(CONFIG.sprt)
    assert config.tracker.delete_existence == pytest.approx(expit(low))
    assert config.tracker.confirm_existence == pytest.approx(expit(high))
    back = replace(
        config.tracker, birth_existence=CONFIG.tracker.birth_existence, confirm_hits=CONFIG.tracker.confirm_hits,
        confirm_existence=CONFIG.tracker.confirm_existence, delete_existence=CONFIG.tracker.delete_existence,
    )  # fmt: skip
    assert back == CONFIG.tracker


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("sprt.alpha=0.0", "not between 0 and 1"),
        ("sprt.beta=1.0", "not between 0 and 1"),
        ("sprt.start_ratio=7.0", "start_ratio"),
        ("sprt.start_ratio=-3.0", "start_ratio"),
        ("sprt.existence_max=1.0", "not between 0 and 1"),
        ("sprt.assignment=best", "one of greedy, optimal"),
    ],
)
def test_settings_under_which_no_track_could_live_are_errors(setting: str, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        plain_config("sprt", setting)


def test_the_bias_of_a_centroid_counts_in_the_update() -> None:
    """25 m^2 of noise and 100 m^2 of bias on either side: half way, not 5/6 of it."""
    config = plain_config("sprt", "model.centroid_sigma_m=10.0")
    state = step(config, step(config, None, [[300.0, 400.0]], 0.0), [[308.0, 400.0]], 0.0)
    assert_allclose(state.density.x[:1, :2], [[304.0, 400.0]], rtol=1e-9)


def test_certainty_of_the_extent_is_capped() -> None:
    config = plain_config(
        "sprt", "model.extent=random-matrix", "cluster.method=cartesian-dbscan", "model.alpha_max=10.0"
    )
    hull, state = np.array([500.0, 900.0]) + np.random.default_rng(2).uniform(-20, 20, (60, 2)), None
    for k in range(3):
        state = step(config, state, hull, float(k))
    assert_allclose(state.density.alpha, [10.0])
