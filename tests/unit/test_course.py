"""Converted measurements against Monte Carlo, course and speed against finite differences, dispersion by definition."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from maritrack import geo
from maritrack.centroidsettings import CentroidConfig
from maritrack.cluster.statistics import cluster_statistics
from maritrack.objects import course
from maritrack.objects.converted import converted
from maritrack.objects.course import Courses
from maritrack.objects.dispersion import bodies, dispersion, paired
from maritrack.tracksettings import ModelConfig
from maritrack.types import FloatArray
from tests.unit.scans import scan_of

law = settings(derandomize=True, deadline=None, max_examples=25)
RULES, MODEL = CentroidConfig(), ModelConfig(extent="point")


@pytest.mark.eq("dataset-2")
@pytest.mark.parametrize("azimuth", [0.0, 0.7, 3.0, 5.5])
def test_converted_measurements_are_unbiased_and_as_uncertain_as_they_say(azimuth: float) -> None:
    """A wide beam far away: range 5 km +- 50 m, azimuth +- 5 degrees. Taken as it is it would be 19 m short.

    By the definition of the covariance: of what was measured truths are drawn, and of each truth the errors of a
    measurement about their mean, which is truth (exp(-s^2/2) - 1).
    """
    rng, n, sigma = np.random.default_rng(7), 1_000_000, (50.0, math.radians(5.0))

    def noisy(range_m: FloatArray, azimuth_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
        return range_m + sigma[0] * rng.normal(size=n), azimuth_rad + sigma[1] * rng.normal(size=n)

    one, at = np.array([5000.0]), np.array([azimuth])
    z, R = converted(one, at, sigma_range_m=sigma[0], sigma_azimuth_rad=sigma[1])
    true = noisy(one, at)
    truth = geo.polar_to_en(*true)
    error = geo.polar_to_en(*noisy(*true)) - truth
    bias = truth * (math.exp(-(sigma[1] ** 2) / 2) - 1)
    spread = 5000.0 * sigma[1] / math.sqrt(n)
    assert np.hypot(*bias.mean(axis=0)) > 10 * spread
    assert_allclose(error.mean(axis=0), bias.mean(axis=0), atol=5 * spread)
    assert_allclose(z[0], (geo.polar_to_en(one, at) - bias.mean(axis=0))[0], atol=5 * spread)
    about = error - bias
    assert_allclose(about.T @ about / n, R[0], atol=0.005 * np.linalg.eigvalsh(R[0])[1], rtol=0.01)


def test_converted_noise_of_a_narrow_beam_is_that_of_first_order() -> None:
    r, b = np.array([900.0, 4000.0]), np.array([0.3, 4.0])
    z, R = converted(r, b, sigma_range_m=3.0, sigma_azimuth_rad=1e-3)
    assert_allclose(z, geo.polar_to_en(r, b), atol=0.01)
    assert_allclose(R, geo.polar_cov_to_en(r, b, np.full(2, 9.0), np.full(2, 1e-6)), rtol=1e-4, atol=1e-3)


def some(seed: int, n: int = 3) -> Courses:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, 4, 4)) * np.array([10.0, 10.0, 0.1, 0.5])[:, None]
    x = np.column_stack([rng.uniform(-500, 500, (n, 2)), rng.uniform(-3.1, 3.1, n), rng.uniform(1, 12, n)])
    return Courses(x, root @ root.transpose(0, 2, 1), np.ones(n, bool))


@pytest.mark.eq("dataset-1")
@law
@given(st.integers(0, 10_000), st.floats(0.1, 20.0))
def test_the_jacobian_is_that_of_the_motion(seed: int, dt_s: float) -> None:
    c, still = some(seed), replace(RULES, sigma_position_m=0.0, sigma_course_deg=0.0, sigma_speed_mps=0.0)
    dt = np.full(3, dt_s)

    def moved(x: FloatArray) -> FloatArray:
        return course.predict(replace(c, x=x), dt, MODEL, still).x

    expected = c.x[:, :2] + (dt_s * c.x[:, 3])[:, None] * np.stack([np.sin(c.x[:, 2]), np.cos(c.x[:, 2])], 1)
    assert_allclose(moved(c.x)[:, :2], expected)
    numeric = np.stack([(moved(c.x + e) - moved(c.x - e)) / 2e-5 for e in 1e-5 * np.eye(4)], axis=-1)
    F = course.jacobian(c.x, dt)
    assert_allclose(F, numeric, atol=1e-4)
    assert_allclose(course.predict(c, dt, MODEL, still).P, F @ c.P @ F.transpose(0, 2, 1))
    noisy = course.predict(c, dt, MODEL, RULES).P - F @ c.P @ F.transpose(0, 2, 1)
    assert_allclose(noisy[0], dt_s * np.diag([0.25, 0.25, math.radians(2.0) ** 2, 0.04]), atol=1e-7)


@law
@given(st.integers(0, 10_000))
def test_course_and_speed_are_velocities_and_back(seed: int) -> None:
    c = some(seed)
    flat = course.cartesian(c)
    again = course.steered(flat.x, flat.P)
    assert_allclose(again.x, c.x, rtol=1e-9, atol=1e-9)
    assert_allclose(again.P, c.P, rtol=1e-6, atol=1e-9)


@law
@given(st.integers(0, 10_000))
def test_a_speed_below_zero_is_the_opposite_course(seed: int) -> None:
    c = some(seed)
    astern = replace(c, x=c.x * [1.0, 1.0, 1.0, -1.0])
    after = course.settled(astern, RULES)
    assert (after.x[:, 3] > 0).all() and (np.abs(after.x[:, 2]) <= math.pi).all()
    assert_allclose(course.cartesian(after).x, course.cartesian(astern).x, atol=1e-9)
    assert_allclose(course.cartesian(after).P, course.cartesian(astern).P, rtol=1e-7, atol=1e-7)


def test_a_velocity_becomes_a_course_once_it_is_known() -> None:
    x = np.array([[0.0, 0.0, -3.0, 0.0], [0.0, 0.0, 0.5, 0.5]])
    c = Courses(x, np.tile(np.diag([4.0, 4.0, 0.5, 0.5]), (2, 1, 1)), np.zeros(2, bool))
    after = course.settled(c, RULES)  # 9 / 0.5 is above 9, 0.5 / 0.5 is not
    assert after.steered.tolist() == [True, False]
    assert_allclose(after.x[0], [0.0, 0.0, -math.pi / 2, 3.0])
    assert_allclose(after.x[1], x[1])


def gate_of(seed: int, rules: CentroidConfig = RULES) -> tuple[object, ...]:
    """Three vessels near each other, five clusters of points among them, and their pairs."""
    rng = np.random.default_rng(seed)
    d = course.cartesian(replace(some(seed), x=some(seed).x * [0.1, 0.1, 1.0, 1.0]))
    label = rng.integers(0, 5, 60)
    label[:5] = np.arange(5)
    z = rng.uniform(-70, 70, (5, 2))[label] + rng.normal(0, 12, (60, 2))
    scan, points = scan_of(z, 0.0)
    clusters = cluster_statistics(points, label, scan, intensity_weighting=False, noise=(1.0, 1.0, 1.0))
    spread = np.tile(np.diag([200.0, 50.0]), (3, 1, 1))
    R, t_ns = clusters.noise_m2, np.zeros(3, np.int64)
    pairs, dt_s = paired(d, spread, t_ns, clusters.mean_m, R, clusters, 9.21, rules)
    return d, spread, points, clusters, pairs, dt_s


@pytest.mark.eq("dataset-3", "dataset-4", "dataset-6", "dataset-7")
@law
@given(st.integers(0, 10_000), st.sampled_from([0.8, 5.0]))
def test_a_pair_is_in_the_rectangle_and_in_the_ellipse(seed: int, sigmas: float) -> None:
    d, spread, _, clusters, pairs, _ = gate_of(seed, replace(RULES, gate_sigmas=sigmas))  # type: ignore[misc]
    expected = []
    for i, j in np.ndindex(3, len(clusters)):  # type: ignore[arg-type]
        S = d.P[i, :2, :2] + clusters.noise_m2[j] + spread[i]  # type: ignore[attr-defined,index]
        nu = clusters.mean_m[j] - d.x[i, :2]  # type: ignore[attr-defined]
        if (np.abs(nu) <= sigmas * np.sqrt(np.diag(S))).all() and nu @ np.linalg.solve(S, nu) < 9.21:
            expected.append((i, j))
    assert list(zip(pairs.i.tolist(), pairs.j.tolist(), strict=True)) == expected  # type: ignore[attr-defined]


@pytest.mark.eq("dataset-5")
@law
@given(st.integers(0, 10_000))
def test_dispersion_is_the_covariance_of_the_points_in_the_gate(seed: int) -> None:
    d, spread, points, clusters, pairs, dt_s = gate_of(seed)
    got = dispersion(spread, pairs, dt_s, d, points, clusters, 9.21, RULES)  # type: ignore[arg-type]
    for i in range(3):
        inside = []
        for k in np.flatnonzero(pairs.i == i):  # type: ignore[attr-defined]
            of = points.position_m[clusters.label == pairs.j[k]]  # type: ignore[attr-defined]
            nu = of - d.x[i, :2]  # type: ignore[attr-defined]
            d2 = np.einsum("ni,ij,nj->n", nu, np.linalg.inv(pairs.S[k]), nu)  # type: ignore[attr-defined]
            inside += of[d2 < 9.21].tolist()
        few = 0.9 * spread[i]  # type: ignore[index]
        assert_allclose(got[i], np.cov(np.array(inside).T, ddof=0) if len(inside) > 1 else few, atol=1e-7)


@pytest.mark.eq("dataset-5")
@law
@given(st.integers(0, 10_000), st.sampled_from([0.0, 5.0]))
def test_a_body_is_what_spreads_points_beyond_the_noise_by_their_weights(seed: int, memory_s: float) -> None:
    d, spread, points, clusters, pairs, dt_s = gate_of(seed)
    R = np.random.default_rng(seed).uniform(20.0, 200.0, len(clusters))[:, None, None] * np.eye(2)  # type: ignore[arg-type]
    weight = np.random.default_rng(seed + 1).dirichlet(np.ones(len(pairs.i) + 1))[1:]  # type: ignore[attr-defined]
    got = bodies(
        spread, pairs, dt_s, d, points, clusters, 9.21, replace(RULES, dispersion_memory_s=memory_s), R=R,  # type: ignore[arg-type]
        weight=weight, passed_s=np.array([1.0, 2.0, 3.0]),
    )  # fmt: skip
    for i in range(3):
        z, w, noise, seen = [np.zeros((0, 2))], [np.zeros(0)], np.zeros((2, 2)), 0.0
        for k in np.flatnonzero(pairs.i == i):  # type: ignore[attr-defined]
            of = points.position_m[clusters.label == pairs.j[k]]  # type: ignore[attr-defined]
            nu = of - d.x[i, :2]  # type: ignore[attr-defined]
            of = of[np.einsum("ni,ij,nj->n", nu, np.linalg.inv(pairs.S[k]), nu) < 9.21]  # type: ignore[attr-defined]
            if len(of):
                z, w = [*z, of], [*w, np.full(len(of), weight[k] / len(of))]
                noise, seen = noise + weight[k] * R[pairs.j[k]], seen + weight[k]  # type: ignore[attr-defined]
        expected = np.zeros((2, 2))
        if seen:
            cov = np.cov(np.concatenate(z).T, aweights=np.concatenate(w), ddof=0)
            values, axes = np.linalg.eigh(cov - noise / seen)
            expected = (axes * np.maximum(values, 0.0)) @ axes.T
        learned = seen * (1.0 - np.exp(-(i + 1.0) / memory_s) if memory_s else 1.0)
        assert_allclose(got[i], learned * expected + (1.0 - learned) * spread[i], atol=1e-7)  # type: ignore[index]


def test_the_echo_of_a_body_of_no_size_has_no_dispersion() -> None:
    d, spread, points, clusters, pairs, dt_s = gate_of(3)
    R, weight = np.tile(1e4 * np.eye(2), (5, 1, 1)), np.ones(len(pairs.i))  # type: ignore[attr-defined]
    weight /= np.bincount(pairs.i)[pairs.i]  # type: ignore[attr-defined]
    got = bodies(
        spread, pairs, dt_s, d, points, clusters, 9.21, replace(RULES, dispersion_memory_s=0.0), R=R, weight=weight,  # type: ignore[arg-type]
        passed_s=np.ones(3),
    )  # fmt: skip
    assert_allclose(got[np.unique(pairs.i)], 0.0, atol=1e-9)  # type: ignore[attr-defined]
