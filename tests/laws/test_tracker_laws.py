"""What must hold for the tracker as a whole, whatever the scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from maritrack import geo
from maritrack.associate.marginals import existence_update
from maritrack.chain import build_chain, process
from maritrack.config import load_config
from maritrack.settings import Config
from maritrack.trackers import TRACKERS
from maritrack.trackers.jipda import gate_limit
from maritrack.types import CONFIRMED, Frame, Points, Scan, Sensor, Tracks

CONFIG = load_config(preset="points")
SECOND = 10**9


def points_scan(z: np.ndarray, k: int, *, at: np.ndarray | None = None, sigma_m: float = 5.0) -> Scan:
    sensor = np.zeros(2) if at is None else at
    range_m, azimuth = geo.en_to_polar(z - sensor)
    n = len(z)
    points = Points(
        range_m=range_m, azimuth_rad=azimuth, position_m=z, intensity=np.ones(n), t_ns=np.full(n, k * SECOND),
        range_width_m=np.zeros(n), azimuth_width_rad=np.zeros(n), cov_m2=np.tile(sigma_m**2 * np.eye(2), (n, 1, 1)),
    )  # fmt: skip
    return Scan(Sensor("p", 0, 0, np.inf), k * SECOND, k * SECOND, sensor, np.nan, points=points)


def scene(seed: int, n_scans: int = 12) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    x, v = rng.uniform(-400, 400, (3, 2)), rng.uniform(-6, 6, (3, 2))
    clutter = [rng.uniform(-500, 500, (rng.poisson(3), 2)) for _ in range(n_scans)]
    return [np.concatenate([x + k * v + rng.normal(0, 5, (3, 2)), clutter[k]]) for k in range(n_scans)]


def track(scans: list[Scan], config: Config = CONFIG) -> Tracks:
    chain = build_chain(config)
    state = chain.init()
    for k, scan in enumerate(scans):
        state, result = process(chain, state, Frame(k, scan))
    return result.tracks


@settings(derandomize=True, deadline=None, max_examples=15)
@given(st.integers(0, 1000))
def test_order_of_points_does_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    frames = scene(seed)
    a = track([points_scan(z, k) for k, z in enumerate(frames)])
    b = track([points_scan(rng.permutation(z), k) for k, z in enumerate(frames)])
    assert_allclose(b.position_m, a.position_m, rtol=1e-9, atol=1e-9)
    assert a.id.tolist() == b.id.tolist()


@settings(derandomize=True, deadline=None, max_examples=15)
@given(st.integers(0, 1000), st.floats(0, 6.28))
def test_turning_and_shifting_the_world_turns_and_shifts_the_tracks(seed: int, angle: float) -> None:
    c, s = np.cos(angle), np.sin(angle)
    T, shift = np.array([[c, -s], [s, c]]), np.array([10_000.0, -3_000.0])
    config = replace(CONFIG, model=replace(CONFIG.model, clutter="fixed"))  # the box of the estimate doesn't turn
    a = track([points_scan(z, k) for k, z in enumerate(scene(seed))], config)
    b = track([points_scan(z @ T.T + shift, k, at=shift) for k, z in enumerate(scene(seed))], config)
    near = np.hypot(*(b.position_m[:, None] - (a.position_m @ T.T + shift)[None]).transpose(2, 0, 1))
    assert len(a) == len(b)
    assert near.min(axis=1).max(initial=0.0) < 1e-5


def test_three_objects_in_light_clutter_are_three_confirmed_tracks() -> None:
    t = track([points_scan(z, k) for k, z in enumerate(scene(5, 25))])
    assert (t.status >= CONFIRMED).sum() == 3


def test_a_missed_scan_out_of_sight_costs_no_existence() -> None:
    config = replace(CONFIG, input=replace(CONFIG.input, roi_max_m=300.0), model=replace(CONFIG.model, p_survive=1.0))
    tracker = TRACKERS["jipda"](config)
    z = np.array([[400.0, 0.0]])
    chain = build_chain(CONFIG)
    state, _ = process(chain, chain.init(), Frame(0, points_scan(z, 0)))
    empty = points_scan(np.zeros((0, 2)), 1)
    assert empty.points is not None
    from maritrack.cluster.stage import cluster_points

    clusters = cluster_points(empty.points, empty, config.cluster, config.input)
    after, _ = tracker.update(state.tracker, empty, empty.points, clusters)
    assert_allclose(after.existence, state.tracker.existence)
    assert after.misses.tolist() == [1]


@pytest.mark.eq("polar-8")
@settings(derandomize=True, deadline=None, max_examples=50)
@given(st.integers(0, 10_000))
def test_existence_and_weights_given_existence_are_probabilities(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, m = 4, 3
    w = rng.dirichlet(np.ones(m + 1), n)
    i = np.repeat(np.arange(n), m)
    r, given_pairs, given_missed = existence_update(
        i, w[:, 1:].ravel(), w[:, 0], rng.uniform(0, 1, n), p_detect=0.9, p_gate=1.0
    )
    assert ((r >= 0) & (r <= 1)).all()
    assert_allclose(np.bincount(i, given_pairs, n) + given_missed, 1.0)


def test_existence_of_a_certain_track_without_gate_loss_is_one() -> None:
    r, _, _ = existence_update(np.zeros(1, int), np.array([0.7]), np.array([0.3]), np.ones(1), p_detect=0.9, p_gate=1.0)
    assert_allclose(r, 1.0)


def test_the_gate_holds_its_share_of_a_gaussian() -> None:
    z = np.random.default_rng(0).normal(size=(200_000, 2))
    assert_allclose(((z**2).sum(1) <= gate_limit(0.99)).mean(), 0.99, atol=0.001)


@pytest.mark.parametrize("density", [1e-12, 1e3])
@pytest.mark.parametrize("p_detect", [0.0, 1.0])
def test_limits_of_clutter_and_detection_give_finite_tracks(density: float, p_detect: float) -> None:
    model = replace(CONFIG.model, clutter="fixed", clutter_density_per_m2=density, p_detect=p_detect)
    t = track([points_scan(z, k) for k, z in enumerate(scene(3))], replace(CONFIG, model=model))
    assert np.isfinite(t.position_m).all()
    assert np.isfinite(t.cov).all()
    assert ((t.existence >= 0) & (t.existence <= 1)).all()


def test_scans_without_time_between_them_do_not_predict() -> None:
    z = np.array([[100.0, 50.0]])
    t = track([points_scan(z, 0)] * 4)
    assert_allclose(t.position_m, z, atol=1e-9)


def test_a_clock_that_steps_back_leaves_tracks_where_they_are() -> None:
    chain = build_chain(CONFIG)
    state = chain.init()
    for k, t in enumerate([0, 1, 2, 1]):
        state, result = process(chain, state, Frame(k, points_scan(np.array([[10.0 * t, 0.0]]), t)))
    assert any("clock" in event.message for event in result.events)
    assert np.isfinite(result.tracks.position_m).all()


def test_an_hour_between_scans_is_only_a_wide_prediction() -> None:
    t = track([points_scan(np.array([[0.0, 0.0]]), k) for k in (0, 1, 2, 3, 3600)])
    assert np.isfinite(t.cov).all()


def test_a_thousand_tracks_on_one_spot_are_handled() -> None:
    rng = np.random.default_rng(4)
    z = rng.normal(0, 3, (1000, 2))
    config = replace(CONFIG, model=replace(CONFIG.model, p_gate=0.5))
    t = track([points_scan(z, 0), points_scan(z[:3], 1)], config)
    assert np.isfinite(t.position_m).all()
    assert len(t) >= 3


def test_extended_tracks_survive_a_line_of_points_and_a_single_one() -> None:
    config = load_config(preset="radar")
    line = np.stack([np.full(9, 500.0), np.arange(9) * 10.0], 1)
    scans = []
    for k in range(6):
        scan = points_scan(line + np.array([0.0, 5.0 * k]), k)
        assert scan.points is not None
        scans.append(replace(scan, points=replace(scan.points, cov_m2=None)))
    t = track(scans, config)
    assert np.isfinite(t.extent_m2).all()
    assert len(t) >= 1
    assert (np.linalg.eigvalsh(t.extent_m2) > 0).all()
