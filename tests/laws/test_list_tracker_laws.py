"""What holds for the trackers with a list of tracks, between them and in their limits."""

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
from maritrack.trackers import TRACKERS
from maritrack.trackers.tracklist import TrackList, select
from maritrack.types import CONFIRMED, FloatArray, take
from tests.laws.test_tracker_laws import points_scan, scene, track
from tests.oracles import jpda_step
from tests.shared import ROOT
from tests.unit.scans import LIST_TRACKERS, clusters_of, plain_config, scan_of, step

law = settings(derandomize=True, deadline=None, max_examples=15)
each_tracker = pytest.mark.parametrize("name", LIST_TRACKERS)
each_other = pytest.mark.parametrize("name", ("sprt", "ipda"))  # than jipda, of which test_tracker_laws tells
WIDE = "model.p_gate=0.999999999"  # nothing of an object is beyond it
DENSITY = ("x", "P", "X", "alpha")


def config_of(name: str) -> Config:
    return load_config(preset="points", sets=[f"tracker_name={name}"])


def run(config: Config, frames: list[FloatArray], period_s: float = 1.0) -> TrackList:
    state = None
    for k, z in enumerate(frames):
        state = step(config, state, z, k * period_s)
    assert state is not None
    return state


def assert_same(a: TrackList, b: TrackList, rtol: float = 1e-9) -> None:
    assert a.id.tolist() == b.id.tolist()
    for name in DENSITY:
        assert_allclose(getattr(b.density, name), getattr(a.density, name), rtol=rtol, atol=1e-7)


def apart(seed: int, n_scans: int = 10) -> list[FloatArray]:
    """Five objects that never come near each other, nothing else, each seen in nearly every scan."""
    rng = np.random.default_rng(seed)
    x, v = 5000.0 * np.stack([np.arange(5.0), np.full(5, 1.0)], 1), rng.uniform(-6, 6, (5, 2))
    seen = rng.random((n_scans, 5)) < 0.9
    seen[:3] = True
    return [(x + k * v + rng.normal(0, 5, (5, 2)))[seen[k]] for k in range(n_scans)]


@each_other
@law
@given(seed=st.integers(0, 1000))
def test_the_order_of_the_points_does_not_matter(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    frames = scene(seed)
    a = track([points_scan(z, k) for k, z in enumerate(frames)], config_of(name))
    b = track([points_scan(rng.permutation(z), k) for k, z in enumerate(frames)], config_of(name))
    assert_allclose(b.position_m, a.position_m, rtol=1e-9, atol=1e-9)
    assert a.id.tolist() == b.id.tolist()


@each_tracker
@law
@given(seed=st.integers(0, 1000))
def test_the_order_of_the_clusters_does_not_matter(name: str, seed: int) -> None:
    """Clusters in any order move the same tracks in the same way; new ones are numbered in that order."""
    rng = np.random.default_rng(seed)
    frames = scene(seed)
    config = config_of(name)
    state, tracker = run(config, frames[:-1]), TRACKERS[name](config)
    scan, points = scan_of(frames[-1], len(frames) - 1)
    clusters = clusters_of(config, frames[-1], len(frames) - 1)
    turn = rng.permutation(len(clusters))
    a, _ = tracker.update(state, scan, points, clusters)
    b, _ = tracker.update(state, scan, points, take(clusters, turn, keep=("label",)))
    old = a.id < state.next_id
    assert_array_equal(a.id, b.id)
    assert_allclose(b.density.x[old], a.density.x[old], rtol=1e-9, atol=1e-9)
    assert_allclose(b.existence[old], a.existence[old], rtol=1e-9)
    assert_array_equal(np.where(b.cluster >= 0, turn[b.cluster], -1)[old], a.cluster[old])
    assert_allclose(np.sort(b.density.x[~old], axis=0), np.sort(a.density.x[~old], axis=0), rtol=1e-9)


@each_other
@law
@given(seed=st.integers(0, 1000), angle=st.floats(0, 6.28))
def test_turning_and_shifting_the_world_turns_and_shifts_the_tracks(name: str, seed: int, angle: float) -> None:
    c, s = np.cos(angle), np.sin(angle)
    T, shift = np.array([[c, -s], [s, c]]), np.array([10_000.0, -3_000.0])
    base = config_of(name)
    config = replace(base, model=replace(base.model, clutter="fixed"))  # the box of the estimate doesn't turn
    a = track([points_scan(z, k) for k, z in enumerate(scene(seed))], config)
    b = track([points_scan(z @ T.T + shift, k, at=shift) for k, z in enumerate(scene(seed))], config)
    near = np.hypot(*(b.position_m[:, None] - (a.position_m @ T.T + shift)[None]).transpose(2, 0, 1))
    assert len(a) == len(b)
    assert near.min(axis=1).max(initial=0.0) < 1e-5


@each_other
def test_three_objects_in_light_clutter_are_three_confirmed_tracks(name: str) -> None:
    t = track([points_scan(z, k) for k, z in enumerate(scene(5, 25))], config_of(name))
    assert (t.status >= CONFIRMED).sum() == 3


@each_other
@pytest.mark.parametrize("p_detect", [0.0, 1.0])
@pytest.mark.parametrize("density", [1e-12, 1e3])
def test_limits_of_clutter_and_detection_give_finite_tracks(name: str, density: float, p_detect: float) -> None:
    base = config_of(name)
    model = replace(base.model, clutter="fixed", clutter_density_per_m2=density, p_detect=p_detect)
    t = track([points_scan(z, k) for k, z in enumerate(scene(3))], replace(base, model=model))
    assert np.isfinite(t.position_m).all() and np.isfinite(t.cov).all()
    assert ((t.existence >= 0) & (t.existence <= 1)).all()


@pytest.mark.eq("polar-8")
@pytest.mark.parametrize("seed", range(6))
def test_jipda_of_certain_tracks_that_survive_is_jpda(seed: int) -> None:
    """Three objects side by side with clutter between them, against the joint events one by one."""
    rng = np.random.default_rng(seed)
    sets = ("tracker.birth_existence=1.0", "model.clutter_density_per_m2=1e-4", "model.sigma_velocity_mps=3.0")
    config = plain_config("jipda", *sets)
    start = np.array([[0.0, 900.0], [18.0, 900.0], [36.0, 905.0]])
    state = step(config, None, start, 0.0)
    F, q = np.eye(4), config.model.accel_psd_m2ps3
    F[0, 2] = F[1, 3] = 2.0
    Q = q * np.kron([[8 / 3, 2.0], [2.0, 2.0]], np.eye(2))
    for k in range(1, 4):
        z = np.concatenate([start + rng.normal(0, 6, (3, 2)), rng.uniform([0, 880], [40, 920], (2, 2))])[: 6 - k]
        x, P = state.density.x[:3] @ F.T, F @ state.density.P[:3] @ F.T + Q
        want = jpda_step(x, P, z, 25.0 * np.eye(2), p_detect=0.8, p_gate=0.99, density=1e-4)
        state = step(config, state, z, 2.0 * k)
        assert_allclose(state.density.x[:3], want[0], rtol=1e-9, atol=1e-9)
        assert_allclose(state.density.P[:3], want[1], rtol=1e-9, atol=1e-9)
        assert_allclose(state.existence[:3], 1.0)
        state = select(state, state.id <= 3)  # without what the scan has started


@law
@given(st.integers(0, 10_000))
def test_jipda_of_one_track_is_ipda(seed: int) -> None:
    """One object and clutter in its gate; births are held back, so that there is one track."""
    rng = np.random.default_rng(seed)
    frames = [np.concatenate([rng.normal([500, 400], 5, (1, 2)), rng.uniform([470, 370], [530, 430], (k % 4, 2))])
              for k in range(12)]  # fmt: skip
    sets = ("tracker.max_tracks=1", "model.clutter=estimated")
    a, b = (run(plain_config(name, *sets), frames) for name in ("jipda", "ipda"))
    assert len(a) == 1
    assert_allclose(b.clutter["p"].density_per_m2, a.clutter["p"].density_per_m2, rtol=1e-9)
    assert_same(a, b)
    assert_allclose(b.existence, a.existence, rtol=1e-9)
    assert a.hits.tolist() == b.hits.tolist() and a.misses.tolist() == b.misses.tolist()
    assert_array_equal(b.cluster, a.cluster)


@law
@given(st.integers(0, 10_000))
def test_objects_that_keep_apart_are_the_same_tracks_under_ipda_and_jipda(seed: int) -> None:
    a, b = (run(plain_config(name, WIDE), apart(seed)) for name in ("jipda", "ipda"))
    assert len(a) == 5
    assert_same(a, b)
    assert_allclose(b.existence, a.existence, rtol=1e-9)


@law
@given(st.integers(0, 10_000))
def test_without_clutter_soft_association_becomes_hard(seed: int) -> None:
    """With vanishing clutter and sure tracks what is in the gate is the object: the densities are those of sprt."""
    sets = (WIDE, "model.clutter_density_per_m2=1e-200", "tracker.delete_existence=0.0", "sprt.beta=1e-9")
    hard, soft, joint = (run(plain_config(name, *sets), apart(seed)) for name in LIST_TRACKERS)
    assert len(hard) == 5
    assert_same(hard, soft, rtol=1e-8)
    assert_same(hard, joint, rtol=1e-8)


def test_two_processes_give_the_same_octets() -> None:
    program = f"from tests.laws.test_list_tracker_laws import digest; print(*map(digest, {LIST_TRACKERS}))"
    for seed in ("1", "77"):
        environment = os.environ | {"PYTHONHASHSEED": seed, "PYTHONPATH": str(ROOT)}
        done = subprocess.run(
            [sys.executable, "-c", program], env=environment, cwd=ROOT, capture_output=True, text=True, check=True
        )
        assert done.stdout.split() == [digest(name) for name in LIST_TRACKERS]


def digest(name: str) -> str:
    """SHA-256 of the tracks of a scene."""
    t = track([points_scan(z, k) for k, z in enumerate(scene(11, 20))], config_of(name))
    return hashlib.sha256(
        b"".join(getattr(t, f).tobytes() for f in ("id", "position_m", "cov", "existence"))
    ).hexdigest()
