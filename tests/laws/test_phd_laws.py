"""What must hold for the PHD filter whatever the scene, and what it is in its limits."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from maritrack.config import load_config
from maritrack.settings import Config
from maritrack.trackers import TRACKERS, tracklist
from maritrack.trackers.tracklist import TrackList
from maritrack.types import CONFIRMED, FloatArray, take
from tests.laws.test_tracker_laws import points_scan, scene, track
from tests.shared import ROOT
from tests.unit.scans import clusters_of, plain_config, scan_of, step

law = settings(derandomize=True, deadline=None, max_examples=15)
NAME = "cb-giw-phd"
CONFIG = load_config(preset="points", sets=[f"tracker_name={NAME}"])
EXTENDED = load_config(
    preset="points",
    sets=[f"tracker_name={NAME}", "cluster.method=cartesian-dbscan", "cluster.eps_m=30.0", "model.clutter=fixed",
          "model.extent=random-matrix", "model.clutter_density_per_m2=1e-7"],
)  # fmt: skip


def run(config: Config, frames: list[FloatArray], period_s: float = 1.0) -> TrackList:
    state: TrackList | None = None
    for k, z in enumerate(frames):
        state = step(config, state, z, k * period_s)
    assert state is not None
    return state


def hulls(seed: int, n_scans: int = 8) -> list[FloatArray]:
    """Three ships of 80 x 20 m that cross each other's way, 15 cells each, and a little clutter."""
    rng = np.random.default_rng(seed)
    x, v = rng.uniform(-300, 300, (3, 2)), rng.uniform(-8, 8, (3, 2))
    cells = [rng.uniform(-1, 1, (3, 15, 2)) * [40.0, 10.0] for _ in range(n_scans)]
    clutter = [rng.uniform(-500, 500, (rng.poisson(3), 2)) for _ in range(n_scans)]
    return [np.concatenate([((x + k * v)[:, None] + cells[k]).reshape(-1, 2), clutter[k]]) for k in range(n_scans)]


def same_mixture(a: TrackList, b: TrackList, rtol: float = 1e-8) -> None:
    assert_array_equal(a.id, b.id)
    assert_allclose(b.existence, a.existence, rtol=rtol)
    for name in ("x", "P", "X", "alpha"):
        assert_allclose(getattr(b.density, name), getattr(a.density, name), rtol=rtol, atol=1e-6)


@law
@given(seed=st.integers(0, 10_000), period_s=st.floats(0.5, 5.0))
def test_one_object_without_clutter_always_seen_is_the_kalman_filter(seed: int, period_s: float) -> None:
    """P_D = P_S = 1, clutter as good as none, points: one component, and it is the filter written out."""
    config = plain_config(
        NAME, "model.p_detect=1.0", "phd.p_survive_scan=1.0", "model.p_gate=0.999999999", "phd.birth_weight=0.5",
        "model.clutter_density_per_m2=1e-30",
    )  # fmt: skip
    rng = np.random.default_rng(seed)
    v = rng.uniform(-8, 8, 2)
    frames = [(np.array([400.0, 300.0]) + k * period_s * v + rng.normal(0, 5, 2))[None] for k in range(8)]
    state = run(config, frames, period_s)
    dt, q, R = round(period_s * 1e9) * 1e-9, config.model.accel_psd_m2ps3, 25.0 * np.eye(2)
    F, Q = np.eye(4), np.zeros((4, 4))
    F[0, 2] = F[1, 3] = dt
    for a in (0, 1):
        Q[np.ix_([a, a + 2], [a, a + 2])] = q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    x, P = np.append(frames[0][0], [0.0, 0.0]), np.diag([25.0, 25.0, *[config.model.sigma_velocity_mps**2] * 2])
    for z in frames[1:]:
        x, P = F @ x, F @ P @ F.T + Q
        K = P[:, :2] @ np.linalg.inv(P[:2, :2] + R)
        x, P = x + K @ (z[0] - x[:2]), P - K @ P[:2]
    assert state.id.tolist() == [1]
    assert_allclose(state.existence, [1.0], rtol=1e-9)
    assert_allclose(state.density.x[0], x, rtol=1e-6, atol=1e-5)
    assert_allclose(state.density.P[0], P, rtol=1e-6, atol=1e-6)


@law
@given(st.integers(0, 1000))
def test_the_order_of_the_points_does_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    frames = scene(seed)
    a = track([points_scan(z, k) for k, z in enumerate(frames)], CONFIG)
    b = track([points_scan(rng.permutation(z), k) for k, z in enumerate(frames)], CONFIG)
    assert a.id.tolist() == b.id.tolist()
    assert_allclose(b.position_m, a.position_m, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("config", [CONFIG, EXTENDED], ids=["points", "extended"])
@law
@given(seed=st.integers(0, 1000))
def test_the_order_of_the_clusters_does_not_matter(config: Config, seed: int) -> None:
    rng = np.random.default_rng(seed)
    frames = scene(seed) if config is CONFIG else hulls(seed)
    state, tracker, k = run(config, frames[:-1]), TRACKERS[NAME](config), len(frames) - 1
    scan, points = scan_of(frames[-1], k)
    clusters = clusters_of(config, frames[-1], k)
    turn = rng.permutation(len(clusters))
    a, _ = tracker.update(state, scan, points, clusters)
    b, _ = tracker.update(state, scan, points, take(clusters, turn, keep=("label",)))
    old = np.flatnonzero(a.existence != config.phd.birth_weight)  # new ones are numbered in the order of clusters
    assert_array_equal(a.id, b.id)
    same_mixture(tracklist.select(a, old), tracklist.select(b, old))
    assert_array_equal(np.where(b.cluster >= 0, turn[b.cluster], -1)[old], a.cluster[old])


@pytest.mark.parametrize("config", [CONFIG, EXTENDED], ids=["points", "extended"])
@law
@given(seed=st.integers(0, 1000))
def test_the_order_of_the_components_does_not_matter(config: Config, seed: int) -> None:
    rng = np.random.default_rng(seed)
    frames = scene(seed) if config is CONFIG else hulls(seed)
    state, k = run(config, frames[:-1]), len(frames) - 1
    same_mixture(
        step(config, state, frames[-1], k),
        step(config, tracklist.select(state, rng.permutation(len(state))), frames[-1], k),
    )


@pytest.mark.parametrize("config", [CONFIG, EXTENDED], ids=["points", "extended"])
@law
@given(seed=st.integers(0, 1000), angle=st.floats(0, 6.28))
def test_turning_and_shifting_the_world_turns_and_shifts_the_components(
    config: Config, seed: int, angle: float
) -> None:
    c, s = np.cos(angle), np.sin(angle)
    T, shift = np.array([[c, -s], [s, c]]), np.array([10_000.0, -3_000.0])
    config = replace(config, model=replace(config.model, clutter="fixed"))  # the box of the estimate doesn't turn
    frames = scene(seed) if config.model.extent == "point" else hulls(seed)
    a = track([points_scan(z, k) for k, z in enumerate(frames)], config)
    b = track([points_scan(z @ T.T + shift, k, at=shift) for k, z in enumerate(frames)], config)
    assert len(a) == len(b)
    gap = np.hypot(*(b.position_m[:, None] - (a.position_m @ T.T + shift)[None]).transpose(2, 0, 1))
    assert gap.min(axis=1).max(initial=0.0) < 1e-5
    twin = gap.argmin(axis=0)
    assert_allclose(b.existence[twin], a.existence, rtol=1e-6)
    assert_allclose(b.extent_m2[twin], T @ a.extent_m2 @ T.T, rtol=1e-5, atol=1e-5)


@law
@given(st.integers(0, 1000))
def test_labels_are_unique_ordered_and_given_out_once(seed: int) -> None:
    state, seen = None, 0
    for k, z in enumerate(hulls(seed)):
        before = 1 if state is None else state.next_id
        state = step(EXTENDED, state, z, float(k))
        assert (np.diff(state.id) > 0).all()
        assert state.id.max(initial=0) < state.next_id
        assert state.next_id >= before
        seen = max(seen, int(state.id.max(initial=0)))
    assert seen > 0


@law
@given(st.integers(0, 1000))
def test_weights_are_above_the_pruning_limit_and_no_more_than_the_clusters_and_the_missed(seed: int) -> None:
    """Each cluster adds at most one to the expected number, each component at most what was missed of it."""
    state = None
    for k, z in enumerate(hulls(seed)):
        had = 0.0 if state is None else float(state.existence.sum())
        n = len(clusters_of(EXTENDED, z, float(k)))
        state = step(EXTENDED, state, z, float(k))
        born = EXTENDED.phd.birth_weight * n
        assert (state.existence >= EXTENDED.phd.prune_weight).all()
        assert state.existence.sum() <= n + (1 - 0.9 * EXTENDED.model.p_gate) * had + born + 1e-9


def test_three_objects_in_light_clutter_are_three_confirmed_tracks() -> None:
    frames = scene(5, 25)
    t = track([points_scan(z, k) for k, z in enumerate(frames)], CONFIG)
    assert (t.status >= CONFIRMED).sum() == 3


@pytest.mark.parametrize("density", [1e-12, 1e3])
@pytest.mark.parametrize("p_detect", [0.0, 1.0])
def test_limits_of_clutter_and_detection_give_finite_tracks(density: float, p_detect: float) -> None:
    model = replace(CONFIG.model, clutter="fixed", clutter_density_per_m2=density, p_detect=p_detect)
    t = track([points_scan(z, k) for k, z in enumerate(scene(3))], replace(CONFIG, model=model))
    assert np.isfinite(t.position_m).all()
    assert np.isfinite(t.cov).all()
    assert ((t.existence >= 0) & (t.existence <= 1)).all()


def test_two_objects_that_keep_apart_do_not_touch_each_other() -> None:
    rng = np.random.default_rng(4)
    one = [np.array([[1000.0 + 5 * k, 0.0]]) + rng.normal(0, 5, (1, 2)) for k in range(10)]
    other = [np.array([[-9000.0, 4.0 * k]]) + rng.normal(0, 5, (1, 2)) for k in range(10)]
    config = replace(CONFIG, model=replace(CONFIG.model, clutter="fixed"))
    both = run(config, [np.concatenate(pair) for pair in zip(one, other, strict=True)])
    for alone in (run(config, one), run(config, other)):
        for x, w in zip(alone.density.x, alone.existence, strict=True):
            k = int(np.argmin(np.abs(both.density.x - x).sum(axis=1)))
            assert_allclose(both.density.x[k], x, rtol=1e-9, atol=1e-9)
            assert_allclose(both.existence[k], w, rtol=1e-9)


RUN = """
import hashlib
from tests.laws.test_phd_laws import EXTENDED, hulls, run
state = run(EXTENDED, hulls(7))
parts = (state.id, state.existence, state.density.x, state.density.P, state.density.X)
print(hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest())
"""


def test_a_run_is_the_same_to_the_last_bit_in_another_process() -> None:
    state = run(EXTENDED, hulls(7))
    parts = (state.id, state.existence, state.density.x, state.density.P, state.density.X)
    mine = hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()
    env = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONHASHSEED": "1"}
    other = subprocess.run([sys.executable, "-c", RUN], cwd=ROOT, env=env, capture_output=True, text=True, check=True)
    assert other.stdout.strip() == mine
