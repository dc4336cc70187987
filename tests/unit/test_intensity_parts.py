"""The parts of the intensity filters, each against what it must be, written slowly."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from maritrack.cluster.stage import cluster_points
from maritrack.config import config_from_toml, load_config, to_toml
from maritrack.errors import ConfigError
from maritrack.objects import cv, mixture, sensing
from maritrack.trackers import capped, gm_phd, intensity, kernels, labels, links, particles, readings
from maritrack.trackers.intensity import Intensity
from maritrack.types import FloatArray
from tests.unit.scans import scan_of
from tests.unit.scans3 import plane_config, space_scan

KINDS: tuple[sensing.Measurement, ...] = ("clusters", "range-azimuth", "range-azimuth-elevation")
law = settings(derandomize=True, deadline=None, max_examples=25)


def spots(kind: sensing.Measurement, n: int = 20) -> FloatArray:
    return np.random.default_rng(1).uniform(-300, 300, (n, sensing.AXES[kind])) + 5.0


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_measured_at_a_place_is_located_there(kind: sensing.Measurement) -> None:
    at = spots(kind)
    assert_allclose(sensing.locate(kind, sensing.measure(kind, at)), at, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_the_jacobian_is_that_of_differences_and_its_inverse_has_the_volume(kind: sensing.Measurement) -> None:
    at, step = spots(kind), 1e-4
    moved = [at + step * e for e in np.eye(at.shape[1])]
    rows = [(sensing.measure(kind, m) - sensing.measure(kind, at)) / step for m in moved]
    J = sensing.jacobian(kind, at)
    assert_allclose(J, np.stack(rows, axis=-1), atol=1e-4)
    assert_allclose(sensing.volume(kind, sensing.measure(kind, at)) * np.abs(np.linalg.det(J)), 1.0, rtol=1e-9)


def test_azimuth_counts_clockwise_from_north_and_innovations_go_the_short_way() -> None:
    z = sensing.measure("range-azimuth-elevation", np.array([[3.0, 0.0, 4.0]]))
    assert_allclose(z, [[5.0, np.pi / 2, np.arctan2(4, 3)]])
    nu = sensing.innovation("range-azimuth", np.array([[5.0, 3.1]]), np.array([[4.0, -3.1]]))
    assert_allclose(nu, [[1.0, 6.2 - 2 * np.pi]])


def test_over_the_sensor_nothing_is_infinite() -> None:
    for kind in KINDS:
        zero = np.zeros((1, sensing.AXES[kind]))
        assert np.isfinite(sensing.measure(kind, zero)).all() and np.isfinite(sensing.jacobian(kind, zero)).all()


def greedy(x: FloatArray, P: FloatArray, distance2: float) -> list[int]:
    into = list(range(len(x)))
    left = list(range(len(x)))
    while left:
        i = left.pop(0)
        for j in list(left):
            gap = x[j] - x[i]
            if gap @ np.linalg.solve(P[i], gap) < distance2:
                into[j] = i
                left.remove(j)
    return into


@law
@given(n=st.integers(0, 150), seed=st.integers(0, 1000), distance2=st.sampled_from([0.0, 0.5, 4.0]))
def test_leaders_are_those_of_the_greedy_loop(n: int, seed: int, distance2: float) -> None:
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n, 4)) * 2
    A = rng.normal(size=(n, 4, 4))
    P = A @ A.transpose(0, 2, 1) + 0.1 * np.eye(4)
    assert mixture.leaders(x, P, distance2).tolist() == greedy(x, P, distance2)


@pytest.mark.parametrize("spread", [True, False])
def test_merging_keeps_the_moments_of_the_mixture(spread: bool) -> None:
    rng = np.random.default_rng(0)
    x, w = rng.normal(size=(5, 4)) + 1e4, rng.uniform(0.1, 1, 5)
    P = np.tile(np.eye(4), (5, 1, 1)) * rng.uniform(1, 2, 5)[:, None, None]
    mean, cov, total, lead = mixture.merge(x, P, w, np.array([0, 0, 2, 0, 2]), spread=spread)
    assert lead.tolist() == [0, 2]
    for g, rows in ((0, [0, 1, 3]), (1, [2, 4])):
        share = w[rows] / w[rows].sum()
        m = share @ x[rows]
        gap = x[rows] - m
        outer = np.einsum("n,ni,nj->ij", share, gap, gap) if spread else 0.0
        assert_allclose(mean[g], m)
        assert_allclose(cov[g], np.einsum("n,nij->ij", share, P[rows]) + outer, atol=1e-8)
        assert total[g] == pytest.approx(w[rows].sum())


def test_capping_keeps_the_weight_and_the_heaviest() -> None:
    config = plane_config("gm-phd", "intensity.components=2", "intensity.merge_distance2=0.0")
    w = np.array([0.9, 0.5, 0.2])
    d = Intensity(np.arange(12.0).reshape(3, 4), np.tile(np.eye(4), (3, 1, 1)), w, np.array([4, 5, 6]))
    kept, lead = gm_phd.reduce(d, config)
    assert lead.tolist() == [0, 1] and kept.label.tolist() == [4, 5]
    assert_allclose(kept.w, w[:2] * 1.6 / 1.4)


@pytest.mark.parametrize("spread", [True, False])
def test_the_distance_of_merged_means_is_in_the_covariance_as_set(spread: bool) -> None:
    config = plane_config("gm-phd", f"intensity.merge_spread={str(spread).lower()}", "intensity.merge_distance2=4.0")
    x = np.array([[0.0, 0, 0, 0], [1.0, 0, 0, 0]])
    merged, _ = gm_phd.reduce(Intensity(x, np.tile(np.eye(4), (2, 1, 1)), np.full(2, 0.5), np.array([1, 2])), config)
    assert_allclose(merged.P, [np.diag([1.25 if spread else 1.0, 1, 1, 1])])


def test_an_object_is_reported_beyond_the_weight_and_from_the_hits_on() -> None:
    config = plane_config("gm-phd", "intensity.extract_weight=0.5", "intensity.extract_hits=2")
    tracks: Any = SimpleNamespace(existence=np.array([0.5, 0.501, 0.9, 0.45]), hits=np.array([2, 2, 1, 9]))
    assert labels.reported(tracks, config).tolist() == [False, True, False, False]


def test_a_component_of_weight_two_is_two_objects_whose_ids_stay() -> None:
    d = Intensity(np.zeros((2, 4)), np.tile(np.eye(4), (2, 1, 1)), np.array([2.2, 0.6]), np.array([7, 7]))
    config = plane_config("gm-phd", "intensity.copies=true")
    found, copies, free = gm_phd.objects(d, np.array([0, -1]), {}, 10, config)
    assert found.label.tolist() == [7, 10, 11] and free == 12
    again, _, _ = gm_phd.objects(d, np.array([0, -1]), copies, 12, config)
    assert again.label.tolist() == [7, 12, 11]
    once, _, _ = gm_phd.objects(d, np.array([0, -1]), copies, 12, plane_config("gm-phd"))
    assert once.label.tolist() == [7, 12]


def one_after_the_other(cost: FloatArray, room: int) -> list[int]:
    used, found = [0] * cost.shape[1], []
    for row in cost:
        column = next(c for c in np.argsort(row, kind="stable").tolist() if used[c] < room)
        used[column] += 1
        found.append(column)
    return found


@law
@given(n=st.integers(1, 60), room=st.integers(1, 20), seed=st.integers(0, 1000))
def test_asking_all_at_once_gives_what_asking_in_turn_gives(n: int, room: int, seed: int) -> None:
    cost = np.random.default_rng(seed).integers(0, 9, (n, -(-n // room) + 1)).astype(float)
    assert capped.nearest_with_room(cost, room).tolist() == one_after_the_other(cost, room)


def test_clusters_of_particles_hold_one_object_each() -> None:
    rng = np.random.default_rng(3)
    x = np.concatenate([rng.normal(size=(100, 4)) + centre for centre in (0.0, 50.0)])
    part = capped.capped_clusters(x, 2.0 / 200, rng)
    assert sorted(np.bincount(part).tolist()) == [100, 100]
    assert len(set(part[:100].tolist())) == 1
    uneven = np.concatenate([rng.normal(size=(n, 4)) + centre for n, centre in ((103, 0.0), (97, 50.0))])
    assert np.bincount(capped.capped_clusters(uneven, 2.0 / 200, rng)).max() == 100
    light = capped.capped_clusters(x, 1e-12, rng)
    assert light.max() == 0


@pytest.mark.eq("engm-13", "engm-29")
def test_silvermans_bandwidth_in_six_dimensions() -> None:
    assert_allclose(kernels.bandwidth(np.array([250.0, 260.0]), 6), [0.2885, 0.2863], atol=5e-5)


def test_covariances_of_groups_are_those_of_their_particles() -> None:
    x, group = np.random.default_rng(4).normal(size=(50, 4)) + 1e3, np.arange(50) % 3
    mean, cov = kernels.sample_covariance(x, np.full(50, 0.1), group, 3)
    for g in range(3):
        assert_allclose(mean[g], x[group == g].mean(axis=0))
        assert_allclose(cov[g], np.cov(x[group == g].T), atol=1e-8)


def test_one_particle_has_a_kernel_that_is_hardly_any() -> None:
    _, K = kernels.kernels(np.ones((1, 4)), np.ones(1), np.zeros(1, np.int64), 1)
    assert_allclose(K[0], 1e-6 * np.eye(4))


def test_rows_are_drawn_by_weight_within_their_groups() -> None:
    w, group = np.array([1.0, 3.0, 0.0, 5.0, 5.0]), np.array([0, 0, 0, 1, 1])
    row = kernels.draw(w, group, np.array([8000, 100]), np.random.default_rng(0))
    share = np.bincount(row[:8000], minlength=5) / 8000
    assert_allclose(share[:3], [0.25, 0.75, 0.0], atol=0.02)
    assert set(row[8000:].tolist()) == {3, 4}


def test_samples_of_a_gaussian_have_its_moments() -> None:
    P = np.array([[4.0, 1.0], [1.0, 2.0]])
    x = kernels.gaussian(np.full((50_000, 2), 7.0), np.tile(P, (50_000, 1, 1)), np.random.default_rng(0))
    assert_allclose(x.mean(axis=0), 7.0, atol=0.05)
    assert_allclose(np.cov(x.T), P, atol=0.1)


def test_labels_are_made_different_the_heaviest_keeps_its_own() -> None:
    label, free = labels.unique_labels(np.array([3, 3, 5, 3]), np.array([0.1, 0.9, 0.4, 0.9]), 20)
    assert label[1] == 3 and label[2] == 5 and set(label.tolist()) == {3, 5, 20, 21} and free == 22


def test_the_value_with_the_most_weight_wins_its_part() -> None:
    part, value = np.array([0, 0, 0, 1, 1]), np.array([8, 9, 9, 2, 1])
    w = np.array([0.5, 0.3, 0.3, 1.0, 1.0])
    assert particles.dominant(part, value, w, 2).tolist() == [9, 1]


@pytest.mark.parametrize("measurement", ["clusters", "range-azimuth"])
def test_the_gate_keeps_the_pairs_within_the_ellipse_and_no_others(measurement: str) -> None:
    config = plane_config("gm-phd", f"intensity.measurement={measurement}")
    rng = np.random.default_rng(6)
    x = np.concatenate([rng.uniform(-300, 300, (40, 2)), rng.normal(0, 3, (40, 2))], axis=1)
    P = np.tile(np.diag([200.0, 90.0, 4.0, 4.0]), (40, 1, 1))
    scan, points = scan_of(rng.uniform(-300, 300, (30, 2)), 1.0)
    clusters = cluster_points(points, scan, config.cluster, config.input)
    seen = readings.read(scan, points, clusters, intensity.begin(config).tracks, config)
    i, j = links.all_pairs(40, 30)
    every = links.link(x, P, seen, i, j, scan.t_ns, np.zeros(40))
    inside = links.distance2(every) <= -2 * np.log(1 - 0.95)
    got = links.gated(x, P, seen, scan.t_ns, np.zeros(40), 0.95)
    assert 0 < inside.sum() < 300
    assert_array_equal(np.stack(got), np.stack([i[inside], j[inside]]))


@pytest.mark.eq("engm-43")
def test_the_density_of_clutter_in_range_and_angles_integrates_to_the_clutter_of_the_box() -> None:
    """kappa over all measurements of a cube is lambda times its volume; the constant one is far from it."""
    sets = ("intensity.measurement=range-azimuth-elevation", "intensity.clutter_density_per_m3=1e-3")
    rng = np.random.default_rng(0)
    z = np.stack([rng.uniform(80, 180, 4000), rng.uniform(0.4, 1.2, 4000), rng.uniform(0.2, 1.3, 4000)], axis=-1)
    scan, box = space_scan(z, 0.0), 100 * 0.8 * 1.1
    shell = (180**3 - 80**3) / 3 * 0.8 * (np.sin(1.3) - np.sin(0.2))
    assert scan.points is not None
    found = {}
    for space in ("jacobian", "cartesian"):
        config = plane_config("gm-phd", *sets, f"intensity.clutter_space={space}")
        clusters = cluster_points(scan.points, scan, config.cluster, config.input)
        seen = readings.read(scan, scan.points, clusters, intensity.begin(config).tracks, config)
        found[space] = np.exp(seen.log_kappa).mean() * box
    assert found["jacobian"] == pytest.approx(1e-3 * shell, rel=0.05)
    assert found["cartesian"] == pytest.approx(1e-3 * box)


@pytest.mark.eq("engm-44", "engm-45", "engm-42")
def test_births_of_the_experiment_have_its_mean_and_are_as_wide_again() -> None:
    config = load_config(preset="engm", sets=["intensity.birth_draws=4000"])
    state = intensity.begin(config)
    assert len(state.intensity) == 0
    born = intensity.newborn(state, 0.0, config)
    assert born.w.sum() == pytest.approx(0.01)
    assert_allclose(born.x.mean(axis=0), [75, 75, 150, 0, 0, 0], atol=3.0)
    assert_allclose(born.x.std(axis=0), [50, 50, 50, 5, 5, 5], rtol=0.05)
    assert_allclose(born.P[0], np.diag([2500.0] * 3 + [25.0] * 3))


def test_births_at_clusters_are_where_nothing_explains_them() -> None:
    config = plane_config("gm-phd", "intensity.measurement=range-azimuth", "model.sigma_velocity_mps=4.0")
    scan, points = scan_of([[300.0, 400.0], [10.0, 20.0]], 1.0)
    clusters = cluster_points(points, scan, config.cluster, config.input)
    tracks = intensity.begin(config).tracks
    seen = readings.read(scan, points, clusters, tracks, config)
    far = np.array([0.9, 0.2])[np.argsort(clusters.range_m)[::-1].argsort()]
    born = intensity.born_at_clusters(tracks, seen, far, scan, clusters, scan.t_ns - 2 * 10**9, config)
    assert_allclose(born.x, [[300.0, 400.0, 0.0, 0.0]])
    assert_allclose(
        born.P[0], np.block([[(25 + 64) * np.eye(2), -32 * np.eye(2)], [-32 * np.eye(2), 16 * np.eye(2)]]), atol=1e-9
    )


def test_a_component_seen_later_is_as_uncertain_as_its_velocity_makes_it() -> None:
    config = plane_config("gm-phd")
    scan, points = scan_of([[40.0, 50.0]], 1.0)
    clusters = cluster_points(points, scan, config.cluster, config.input)
    seen = readings.read(scan, points, clusters, intensity.begin(config).tracks, config)
    x, P = np.array([[40.0, 50.0, 1.0, 2.0]]), np.diag([200.0, 90.0, 4.0, 9.0])[None]
    pair = links.link(x, P, seen, np.array([0]), np.array([0]), scan.t_ns, np.array([2.0]))
    S = np.linalg.inv(pair.L_inv[0].T @ pair.L_inv[0])
    assert_allclose(S, np.diag([200.0 + 4 * 4.0, 90.0 + 4 * 9.0]) + seen.R[0], rtol=1e-9)


def test_what_is_outside_of_the_gate_counts_as_missed() -> None:
    config = plane_config("gm-phd", "intensity.gate=ellipse", "model.p_gate=0.9")
    assert_allclose(intensity.missed(np.array([2.0]), np.array([0.8]), config), [2.0 * (1 - 0.8 * 0.9)])


def test_components_out_of_sight_lose_nothing_when_they_are_missed() -> None:
    config = plane_config("gm-phd", "input.roi_max_m=500.0", "model.p_detect=0.9")
    at = np.array([[100.0, 0.0], [900.0, 0.0]])
    p = readings.visible(scan_of([], 0.0)[0], at, config)
    assert p.tolist() == [0.9, 0.0]
    assert_allclose(intensity.missed(np.ones(2), p, config), [0.1, 1.0])


def test_settings_with_births_survive_their_own_text() -> None:
    config = load_config(preset="engm")
    assert config_from_toml(to_toml(config)).intensity == config.intensity


@pytest.mark.parametrize(
    ("assignment", "told"),
    [
        ("intensity.birth=mixture", "needs intensity.births"),
        ("intensity.births=[{mean_m=[1,2],mean_mps=[0,0],sigma_m=[1,0],sigma_mps=[1,1],weight=1}]", "sigmas"),
        ("intensity.births=[{mean_m=[1],mean_mps=[0],sigma_m=[1],sigma_mps=[1],weight=1}]", "2 or 3"),
        ("intensity.measurement=range-azimuth-elevation", "birth_weight must be given"),
        ("intensity.group_particles=3", "starts at 10"),
    ],
)
def test_settings_that_make_no_sense_are_named(assignment: str, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        load_config(preset="points", sets=[assignment])


def test_motion_of_a_second_twice_is_motion_of_two() -> None:
    F, Q = cv.transition(1.0, 3), cv.process_noise(1.0, 3, accel_psd_m2ps3=0.3)
    assert_allclose(F @ F, cv.transition(2.0, 3))
    assert_allclose(F @ Q @ F.T + Q, cv.process_noise(2.0, 3, accel_psd_m2ps3=0.3))
