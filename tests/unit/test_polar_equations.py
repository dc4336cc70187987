"""Equations of the polar paper against themselves, written out as they stand there."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import multivariate_normal, wishart
from sklearn.cluster import DBSCAN

from maritrack import geo
from maritrack.associate.marginals import sparse_marginals
from maritrack.cluster.stage import cylinder_radius_m, labels
from maritrack.cluster.statistics import cluster_statistics
from maritrack.objects import giw
from maritrack.settings import ClusterConfig, Config
from maritrack.trackers import jipda
from maritrack.tracksettings import ModelConfig, TrackerConfig
from maritrack.types import Clusters, FloatArray, Points, Scan, Sensor

EXACT = 1e-10
PAPER = ModelConfig(
    shape="plugin", shape_n_max=0, centroid_n_max=0, centroid_sigma_m=0.0, p_detect=0.8, p_gate=0.99,
    clutter="fixed", clutter_density_per_m2=1e-4, rho=0.25,
)  # fmt: skip


def scan_at(t_s: float = 0.0) -> Scan:
    t_ns = round(t_s * 1e9)
    return Scan(Sensor("7-42", 7.5, 2 * np.pi / 2048, 20_000.0), t_ns, t_ns, np.zeros(2), np.nan)


def points_at(range_m: FloatArray, azimuth_rad: FloatArray, intensity: FloatArray, t_s: float = 0.0) -> Points:
    n = len(range_m)
    return Points(
        range_m=range_m, azimuth_rad=azimuth_rad, position_m=geo.polar_to_en(range_m, azimuth_rad), intensity=intensity,
        t_ns=np.full(n, round(t_s * 1e9)), range_width_m=np.full(n, 7.5),
        azimuth_width_rad=np.full(n, 2 * np.pi / 2048),
    )  # fmt: skip


def clusters_of(points: Points, scan: Scan) -> Clusters:
    one = np.zeros(len(points.range_m), np.int64)
    return cluster_statistics(points, one, scan, intensity_weighting=False, noise=(2.0, 0.001, 0.0))


@pytest.mark.eq("polar-1")
def test_a_detection_lies_where_the_mathematical_angle_says() -> None:
    rng = np.random.default_rng(1)
    r, azimuth = rng.uniform(0, 2e4, 50), rng.uniform(0, 2 * np.pi, 50)
    phi = np.pi / 2 - azimuth  # counted from east, against the clock
    assert_allclose(geo.polar_to_en(r, azimuth), np.stack([r * np.cos(phi), r * np.sin(phi)], 1), atol=1e-8)


@pytest.mark.eq("polar-2", "polar-3", "polar-4")
@pytest.mark.parametrize("seed", range(5))
def test_clusters_are_those_of_the_cylinder_in_space(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centre_r, centre_azimuth = rng.uniform(2e3, 18e3, 40), np.append(rng.uniform(0, 2 * np.pi, 38), [0.0, 2e-4])
    r = np.repeat(centre_r, 8) + rng.normal(0, 25, 320)
    azimuth = geo.wrap_positive(np.repeat(centre_azimuth, 8) + rng.normal(0, 0.008, 320))
    points, scan = points_at(r, azimuth, np.ones(320)), scan_at()
    label = labels(points, scan, ClusterConfig(eps_m=55.0, min_points=3))
    R = scan.sensor.range_res_m / scan.sensor.azimuth_res_rad
    in_space = DBSCAN(eps=55.0, min_samples=3).fit_predict(np.stack([R * np.cos(azimuth), R * np.sin(azimuth), r], 1))
    core = np.flatnonzero((label >= 0) & (in_space >= 0))
    assert_allclose(label < 0, in_space < 0)
    pairs = {(int(label[i]), int(in_space[i])) for i in core}
    assert len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs}) > 10
    assert cylinder_radius_m(points, scan) == pytest.approx(R)


@pytest.mark.eq("polar-5", "polar-6")
@pytest.mark.parametrize("weighted", [True, False])
def test_centroid_and_scatter_are_the_weighted_sums(weighted: bool) -> None:
    rng = np.random.default_rng(3)
    points = points_at(rng.uniform(990, 1010, 30), rng.uniform(0.99, 1.01, 30), rng.uniform(1, 255, 30))
    label = rng.integers(-1, 4, 30)
    clusters = cluster_statistics(points, label, scan_at(), intensity_weighting=weighted, noise=(2.0, 0.001, 0.0))
    assert len(clusters) == 4
    for row in range(4):
        mine = clusters.label == row
        z, l = points.position_m[mine], points.intensity[mine] if weighted else np.ones(mine.sum())  # noqa: E741
        n, zbar = int(mine.sum()), sum(l[i] * z[i] for i in range(mine.sum())) / sum(l)
        Zbar = n / sum(l) * sum(l[i] * np.outer(z[i] - zbar, z[i] - zbar) for i in range(n))
        assert_allclose(clusters.mean_m[row], zbar, rtol=EXACT)
        assert_allclose(clusters.scatter_m2[row], Zbar, rtol=1e-8, atol=1e-8)
        assert clusters.count[row] == n


@pytest.mark.eq("polar-8")
def test_marginals_are_sums_over_the_joint_events() -> None:
    rng = np.random.default_rng(4)
    weight, missed = rng.uniform(0, 3, (3, 4)), rng.uniform(0.1, 1, 3)
    total, beta = 0.0, np.zeros((3, 5))
    for event in itertools.product(range(-1, 4), repeat=3):
        taken = [j for j in event if j >= 0]
        if len(taken) == len(set(taken)):
            p = np.prod([weight[t, j] if j >= 0 else missed[t] for t, j in enumerate(event)])
            total += p
            for t, j in enumerate(event):
                beta[t, j] += p  # column -1 is the miss
    i, j = np.divmod(np.arange(12), 4)
    pairs, misses, inexact = sparse_marginals(i, j, np.log(weight.ravel()), np.log(missed), 3, 4)
    assert inexact == 0
    assert_allclose(pairs.reshape(3, 4), beta[:, :4] / total, rtol=EXACT)
    assert_allclose(misses, beta[:, -1] / total, rtol=EXACT)
    assert_allclose(misses, 1 - pairs.reshape(3, 4).sum(axis=1), rtol=1e-8)


@pytest.mark.eq("polar-11")
def test_covariance_of_the_innovation_shrinks_with_the_size_of_the_cluster() -> None:
    rng = np.random.default_rng(5)
    scan = scan_at()
    A = rng.normal(size=(4, 4))
    d = giw.Giw(rng.normal(size=(1, 4)), (A @ A.T)[None], np.array([[[900.0, 200.0], [200.0, 400.0]]]), np.array([9.0]))
    for n in (1, 2, 7, 100):
        points = points_at(rng.uniform(990, 1010, n), rng.uniform(0.99, 1.01, n), np.ones(n))
        clusters = clusters_of(points, scan)
        zero = np.zeros(1, np.int64)
        pairs = giw.pair_up(d, clusters, zero, zero, np.zeros(1), PAPER)
        want = d.P[0, :2, :2] + (PAPER.rho * d.X[0] + clusters.noise_m2[0]) / n
        assert_allclose(pairs.S[0], want, rtol=EXACT)


@pytest.mark.eq("polar-9", "polar-8", "polar-10")
def test_existence_after_one_cluster_follows_the_likelihood_ratio() -> None:
    config = Config(model=PAPER, tracker=TrackerConfig(birth_existence=0.6), cluster=ClusterConfig(eps_m=55.0))
    tracker = jipda.Jipda(config)
    rng = np.random.default_rng(6)

    def seen(t_s: float, n: int) -> tuple[Scan, Points, Clusters]:
        r, azimuth = rng.uniform(2970, 3030, n), rng.uniform(0.99, 1.01, n)
        points, scan = points_at(r, azimuth, np.ones(n), t_s), scan_at(t_s)
        return scan, points, clusters_of(points, scan)

    state, _ = tracker.update(tracker.init(), *seen(0.0, 9))
    scan, points, clusters = seen(2.5, 6)
    predicted, _ = jipda.predict(state, scan, points, config)
    after, _ = tracker.update(state, scan, points, clusters)
    d, n, r = predicted.density, 6, float(predicted.existence[0])
    V1 = PAPER.rho * d.X[0] + clusters.noise_m2[0]
    S = d.P[0, :2, :2] + V1 / n
    u = clusters.mean_m[0] / np.linalg.norm(clusters.mean_m[0])
    R_cyl = scan.sensor.range_res_m / scan.sensor.azimuth_res_rad
    stretch = float(clusters.range_m[0]) / R_cyl
    V0 = 27.5**2 * (np.outer(u, u) + stretch**2 * (np.eye(2) - np.outer(u, u)))
    Z = clusters.scatter_m2[0]
    p_centroid = multivariate_normal(d.x[0, :2], S).pdf(clusters.mean_m[0])
    p_shape = [wishart(n - 1, V).pdf(Z) for V in (V1, V0)]
    Lam = p_centroid * p_shape[0] / (PAPER.p_gate * 1e-4 * p_shape[1])
    weight, missed = PAPER.p_detect * PAPER.p_gate * r * Lam, 1 - PAPER.p_detect * PAPER.p_gate * r
    beta = weight / (weight + missed)
    want = beta + (1 - beta) * (1 - PAPER.p_detect * PAPER.p_gate) * r / missed
    assert 0.01 < beta < 0.9999999
    assert_allclose(after.existence[0], want, rtol=1e-9)


def test_a_track_without_cluster_keeps_what_a_miss_leaves() -> None:
    config = Config(model=PAPER)
    tracker, scan = jipda.Jipda(config), scan_at()
    points = points_at(np.array([3000.0, 3004.0]), np.array([1.0, 1.0]), np.ones(2))
    state, _ = tracker.update(tracker.init(), scan, points, clusters_of(points, scan))
    nothing = points_at(np.zeros(0), np.zeros(0), np.zeros(0))
    later = replace(scan_at(2.5))
    empty = clusters_of(nothing, later)
    r = float(jipda.predict(state, later, nothing, config)[0].existence[0])
    q = PAPER.p_detect * PAPER.p_gate
    after, _ = tracker.update(state, later, nothing, empty)
    assert_allclose(after.existence, [(1 - q) * r / (1 - q * r)], rtol=EXACT)


def uneven_cluster() -> tuple[Clusters, int]:
    """A cluster whose points weigh unequally, and how many they are."""
    rng = np.random.default_rng(3)
    n = 12
    points = points_at(5000.0 + rng.normal(0, 20, n), 1.0 + rng.normal(0, 0.004, n), rng.uniform(1, 200, n))
    one = np.zeros(n, np.int64)
    return cluster_statistics(points, one, scan_at(), intensity_weighting=True, noise=(2.0, 0.001, 0.0)), n


@pytest.mark.eq("polar-11")
def test_the_papers_size_of_a_cluster_is_its_count_whatever_the_weights() -> None:
    clusters, n = uneven_cluster()
    one = np.zeros(1, np.int64)
    count, effective = (
        giw.centroid_weight(clusters, one, replace(PAPER, cluster_size=size)) for size in ("count", "effective")
    )
    assert count[0] == 1.0 / n and effective[0] == clusters.weight_sq[0] > 1.0 / n


@pytest.mark.eq("polar-10")
def test_the_papers_shape_of_a_weighted_cluster_has_one_degree_of_freedom_less_than_points() -> None:
    clusters, n = uneven_cluster()
    model, one, V0 = replace(PAPER, cluster_size="count"), np.zeros(1, np.int64), np.diag([900.0, 400.0])
    d = giw.birth(clusters, model)
    pairs = giw.pair_up(d, clusters, one, one, np.zeros(1), model)
    Z, V1 = clusters.scatter_m2[0], pairs.Y[0]
    expected = wishart.logpdf(Z, n - 1, V1) - wishart.logpdf(Z, n - 1, V0)
    assert_allclose(giw.log_shape_ratio(d, clusters, pairs, V0[None], model), expected, atol=1e-8)
