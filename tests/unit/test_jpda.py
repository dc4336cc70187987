"""The trackers of centroids: event by event, turned about North, and what they are without dispersion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from maritrack.chain import build_chain, process
from maritrack.cluster.stage import cluster_points
from maritrack.config import load_config
from maritrack.geo import pixel_key
from maritrack.objects import course
from maritrack.settings import Config
from maritrack.trackers import TRACKERS
from maritrack.trackers.jpda import Following
from maritrack.types import COASTED, CONFIRMED, FloatArray, Frame, Mask, Points, Scan, Truth
from tests.oracles import joint_event_marginals
from tests.unit.scans import plain_config, scan_of

law = settings(derandomize=True, deadline=None, max_examples=15)
CLOUDS = ("cluster.method=cartesian-dbscan", "cluster.eps_m=40.0", "cluster.min_points=1")


def config_of(name: str, *sets: str) -> Config:
    return plain_config(name, *CLOUDS, "tracker.confirm_hits=3", *sets)


def echoes(seed: int, k: int, *, size: int = 8, turn: float = 0.0, clutter: int = 2) -> tuple[Scan, Points]:
    """Two ships that pass each other 150 m apart, northwards and back, and clutter; points about each."""
    rng = np.random.default_rng([seed, k])
    ships = np.array([[0.0, -40.0 + 8.0 * k], [150.0, 80.0 - 8.0 * k]])
    middle = np.concatenate([ships, rng.uniform(-400, 400, (clutter, 2))])
    n = len(middle)
    along = rng.normal(size=(n, size, 2)) * [4.0, 14.0] if size > 1 else rng.normal(size=(n, 1, 2)) * 4.0
    z = (middle[:, None] + along).reshape(-1, 2)
    c, s = np.cos(turn), np.sin(turn)
    return scan_of(z @ np.array([[c, s], [-s, c]]), float(k), sigma_m=4.0)


def followed(
    config: Config, seed: int, *, n: int = 15, size: int = 8, turn: float = 0.0, clutter: int = 2
) -> Following:
    tracker = TRACKERS[config.tracker_name](config)
    state = tracker.init()
    for k in range(n):
        scan, points = echoes(seed, k, size=size, turn=turn, clutter=clutter)
        clusters = cluster_points(points, scan, config.cluster, config.input)
        state, _ = tracker.update(state, scan, points, clusters)
    assert isinstance(state, Following)
    return state


@pytest.mark.parametrize("size", [1, 8])
@law
@given(seed=st.integers(0, 1000))
def test_without_dispersion_ec_jpda_is_jpda(size: int, seed: int) -> None:
    a = followed(config_of("jpda"), seed, size=size)
    b = followed(config_of("ec-jpda", "centroid.dispersion=none"), seed, size=size)
    assert a.tracks.id.tolist() == b.tracks.id.tolist()
    assert (a.courses.x == b.courses.x).all() and (a.courses.P == b.courses.P).all()
    assert not a.dispersion_m2.any()


def test_echoes_of_one_point_have_no_dispersion_and_others_have() -> None:
    a, b = (followed(config_of(name), 3, size=1, clutter=0) for name in ("jpda", "ec-jpda"))
    assert (a.courses.x == b.courses.x).all() and not b.dispersion_m2.any()
    a, b = (followed(config_of(name), 3, n=30, clutter=0) for name in ("jpda", "ec-jpda"))
    east, north = b.dispersion_m2[:2, 0, 0], b.dispersion_m2[:2, 1, 1]  # as wide as the noise, and 14 m along
    assert east.max() < 10.0 and north.min() > 20.0
    assert not np.allclose(a.courses.x[:2], b.courses.x[:2])


@pytest.mark.parametrize("seed", range(3))
def test_after_passing_a_buoy_a_ship_is_followed_and_not_the_middle_of_both(seed: int) -> None:
    """Once as wide as both are apart, a dispersion of all points in the gate keeps both there, and itself wide."""
    off = {}
    for dispersion in ("body", "adaptive"):
        sets = (f"centroid.dispersion={dispersion}", "centroid.gain=dispersion", "tracker.birth_from=none")
        config = config_of("ec-jpda", *sets)
        tracker, state = TRACKERS["ec-jpda"](config), followed(config_of("ec-jpda"), 2, n=1, clutter=0)
        rng = np.random.default_rng(seed)
        for k in range(1, 57):
            ship, buoy = np.array([0.0, -40.0 + 6.0 * k]), np.array([10.0, 110.0])
            z = (np.stack([ship, buoy])[:, None] + rng.normal(size=(2, 8, 2)) * 12.0).reshape(-1, 2)
            scan, points = scan_of(z, float(k), sigma_m=12.0)
            clusters = cluster_points(points, scan, config.cluster, config.input)
            state, _ = tracker.update(state, scan, points, clusters)
        off[dispersion] = np.hypot(*(state.tracks.density.x[:, :2] - ship).T).min()
    assert off["body"] < 10.0 and off["adaptive"] > 30.0


def test_courses_are_those_of_the_ships() -> None:
    state = followed(config_of("ec-jpda"), 1, n=40)
    ships = np.flatnonzero(state.tracks.hits > 30)
    assert state.courses.steered[ships].all()
    order = np.argsort(state.courses.x[ships, 0])
    off = np.abs(np.exp(1j * state.courses.x[ships[order], 2]) - np.array([1.0, -1.0]))
    assert off.max() < 0.1
    assert_allclose(state.courses.x[ships, 3], 8.0, atol=1.0)


@law
@given(st.integers(0, 1000), st.floats(0.0, 6.28))
def test_turning_the_world_turns_the_tracks(seed: int, turn: float) -> None:
    """Also over North, where courses jump from pi to -pi."""
    config = config_of("ec-jpda", "centroid.gate_sigmas=1e6")  # the rectangle has sides to north and east
    a, b = followed(config, seed), followed(config, seed, turn=turn)
    c, s = np.cos(turn), np.sin(turn)
    turned = a.tracks.density.x[:, :2] @ np.array([[c, s], [-s, c]])
    near = np.hypot(*(b.tracks.density.x[None, :, :2] - turned[:, None]).transpose(2, 0, 1))
    assert len(a.tracks) == len(b.tracks) and near.min(axis=1).max() < 1e-5


def three(seed: int) -> tuple[Following, FloatArray]:
    """Three steered tracks near each other at one second, with dispersion, and three single echoes at two."""
    rng = np.random.default_rng(seed)
    config = config_of("ec-jpda")
    tracker = TRACKERS["ec-jpda"](config)
    scan, points = scan_of([[0.0, 0.0], [90.0, 0.0], [45.0, 70.0]], 1.0)
    state, _ = tracker.update(tracker.init(), scan, points, cluster_points(points, scan, config.cluster, config.input))
    x = np.column_stack([state.tracks.density.x[:, :2], rng.uniform(-3.1, 3.1, 3), rng.uniform(1.0, 9.0, 3)])
    root = rng.normal(size=(3, 4, 4)) * np.array([20.0, 20.0, 0.1, 0.5])[:, None]
    courses = course.Courses(x, root @ root.transpose(0, 2, 1) + 1e-3 * np.eye(4), np.ones(3, bool))
    tracks = replace(state.tracks, density=course.cartesian(courses))
    spread = np.tile(np.diag([300.0, 100.0]), (3, 1, 1))
    return Following(tracks, courses, spread), x[:, :2] + rng.normal(0, 25, (3, 2)) + [0.0, 4.0]


@pytest.mark.eq("dataset-8", "dataset-9", "dataset-10", "dataset-11", "dataset-12")
@pytest.mark.parametrize("gain", ["noise", "mean", "dispersion"])
@pytest.mark.parametrize("clutter", ["density", "density-and-volume"])
@law
@given(seed=st.integers(0, 10_000))
def test_the_update_is_that_of_all_joint_events(gain: str, clutter: str, seed: int) -> None:
    config = config_of(
        "ec-jpda", f"centroid.gain={gain}", f"centroid.clutter={clutter}", "cluster.method=singletons",
        "tracker.birth_from=none", "model.p_detect=0.85",
    )  # fmt: skip
    state, z = three(seed)
    before = course.predict(state.courses, np.ones(3), config.model, config.centroid)
    limit, R, weight = -2.0 * np.log(0.01), 25.0 * np.eye(2), np.zeros((3, 3))
    for t, j in np.ndindex(3, 3):
        S = before.P[t, :2, :2] + R + state.dispersion_m2[t]
        nu = z[j] - before.x[t, :2]
        d2 = nu @ np.linalg.solve(S, nu)
        if d2 < limit and (np.abs(nu) <= 5.0 * np.sqrt(np.diag(S))).all():
            N = np.exp(-d2 / 2) / (2 * np.pi * np.sqrt(np.linalg.det(S)))
            V = np.pi * limit * np.sqrt(np.linalg.det(S)) if clutter == "density-and-volume" else 1.0
            weight[t, j] = 0.85 * N / 1e-6 * V
    beta = joint_event_marginals(np.full(3, 0.15), weight)
    scan, points = scan_of(z, 2.0)
    tracker = TRACKERS["ec-jpda"](config)
    after, _ = tracker.update(state, scan, points, cluster_points(points, scan, config.cluster, config.input))
    for t in range(3):
        extra = {"noise": 0.0, "mean": 1.0, "dispersion": 1.0}[gain] * state.dispersion_m2[t]
        S = before.P[t, :2, :2] + R + extra
        K = before.P[t, :, :2] @ np.linalg.inv(S)
        steps = np.array([np.zeros(4), *(K @ (z[j] - before.x[t, :2]) for j in range(3))])
        mean = beta[t] @ steps
        covs = [before.P[t], *[before.P[t] - K @ before.P[t, :2]] * 3]
        P = sum(b * (C + np.outer(m - mean, m - mean)) for b, C, m in zip(beta[t], covs, steps, strict=True))
        expected = course.settled(
            course.Courses((before.x[t] + mean)[None], np.array([P]), np.ones(1, bool)), config.centroid
        )
        assert_allclose(after.courses.x[t], expected.x[0], rtol=1e-7, atol=1e-7)
        assert_allclose(after.courses.P[t], expected.P[0], rtol=1e-6, atol=1e-6)


def truth_at(k: int, ids: tuple[str, ...]) -> Truth:
    n, nan = len(ids), np.full(len(ids), np.nan)
    position = np.array([[0.0, -40.0 + 8.0 * k], [150.0, 80.0 - 8.0 * k]])[:n]
    velocity = np.array([[0.0, 8.0], [0.0, -8.0]])[:n]
    return Truth(ids, ("",) * n, k * 10**9, position, velocity, nan, nan, nan)


@pytest.mark.parametrize(("start", "n"), [("reference", 2), ("both", 2), ("clusters", 0)])
def test_tracks_start_at_the_first_words_of_ais(start: str, n: int) -> None:
    chain = build_chain(config_of("ec-jpda", f"centroid.start={start}"))
    state = chain.init()
    for k in range(20):
        scan, _ = echoes(5, k)
        ids = ("a",) if k < 3 else ("a", "b")
        state, result = process(chain, state, Frame(k, scan, truth_at(k, ids)))
        if k == 0:
            assert (result.tracks.status >= CONFIRMED).sum() == min(n, 1)
    ships = truth_at(19, ("a", "b")).position_m
    told = state.tracker.tracks
    assert len(state.tracker.told) == n
    near = np.hypot(*(told.density.x[:, None, :2] - ships[None]).transpose(2, 0, 1))
    assert (near.min(axis=0) < 25.0).all()
    assert (len(told) == 2) == (start == "reference")


def test_a_certain_track_stays_through_an_occlusion_and_an_integrated_one_ends() -> None:
    left = {}
    for existence in ("certain", "integrated"):
        config = config_of("ec-jpda", f"centroid.existence={existence}", "model.p_survive=0.99")
        tracker = TRACKERS["ec-jpda"](config)
        state = followed(config, 2, n=20)
        for k in range(20, 50):
            scan, points = scan_of(np.zeros((0, 2)), float(k))
            clusters = cluster_points(points, scan, config.cluster, config.input)
            state, _ = tracker.update(state, scan, points, clusters)
        tracks = tracker.estimate(state)
        left[existence] = int((tracks.status == COASTED).sum())
    assert left["integrated"] == 0 and left["certain"] >= 2


def test_the_same_scans_give_the_same_tracks_and_no_points_none() -> None:
    config = load_config(preset="points", sets=["tracker_name=ec-jpda"])
    a, b = followed(config, 4), followed(config, 4)
    assert (a.courses.x == b.courses.x).all()
    tracker = TRACKERS["ec-jpda"](config)
    scan, points = scan_of(np.zeros((0, 2)), 0.0)
    empty = cluster_points(points, scan, config.cluster, config.input)
    state, _ = tracker.update(tracker.init(), scan, points, empty)
    assert len(tracker.estimate(state)) == 0


@pytest.mark.parametrize("name", ["jpda", "ec-jpda"])
def test_a_track_that_the_background_covers_is_held_where_it_lay(name: str) -> None:
    """Without a course, for its stated time and no longer, also over a gap after which nobody would know its place."""
    config = config_of(name, "tracker.stationary_s=200.0", "tracker.delete_misses=5", "tracker.birth_from=none",
                       "tracker.delete_sigma_m=60.0")  # fmt: skip
    tracker = TRACKERS[name](config)
    state = followed(replace(config, tracker=replace(config.tracker, birth_from="unexplained")), 2, n=20, clutter=0)
    ids = state.tracks.id[state.tracks.confirmed].tolist()
    before = state.tracks.density.x[state.tracks.confirmed, :2].copy()
    every = np.array([[e, n] for e in np.arange(-1000.0, 1000.0, 50.0) for n in np.arange(-1000.0, 1000.0, 50.0)])
    mask = Mask(np.sort(pixel_key(every + 25.0, 50.0)), 50.0)
    left = []
    for k in (*range(20, 30), 130, 140, 231):
        scan, points = scan_of(np.zeros((0, 2)), float(k))
        clusters = cluster_points(points, scan, config.cluster, config.input)
        state, _ = tracker.update(state, replace(scan, covered=mask), points, clusters)
        left.append(len(state.tracks))
        if k == 140:
            assert state.tracks.id.tolist() == ids and not state.courses.steered.any()
            assert np.abs(state.tracks.density.x[:, :2] - before).max() < 25.0
            assert not state.tracks.density.x[:, 2:].any()
    assert left[-2] == len(ids) == 2 and left[-1] == 0
