"""Rows and Poisson components of point trackers by themselves: what a miss, a hit and a birth leave, what is shown."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expit

from maritrack.objects import contour, iekf, rate
from maritrack.trackers import bernoullis, pointevidence, undetected
from maritrack.trackers.pmbm import PmbmState, gp_pmbm, pruned
from maritrack.trackers.pointevidence import fullest
from maritrack.trackers.pointmodels import HullModel
from maritrack.types import CONFIRMED, TENTATIVE, Clusters, FloatArray
from tests.laws.test_contour_laws import RULES, hulls, points_on
from tests.unit.test_pmbm_points import config_of, rows_of, scan_of


def evidence(z: FloatArray, existence: float, *sets: str) -> tuple[pointevidence.PointEvidence, bernoullis.Bernoullis]:
    """One hull and points, all of them one cluster, at the hull's own time."""
    config = config_of("gp-pmbm", *sets)
    model = HullModel(config)
    x, P = hulls(1, 3, config.contour)
    rows = rows_of(model, x, P, existence)
    scan = scan_of(z, 0)
    n = len(z)
    clusters = Clusters(
        mean_m=z.mean(axis=0)[None], scatter_m2=np.eye(2)[None], count=np.array([n]), weight_sq=np.ones(1) / n,
        noise_m2=np.eye(2)[None], t_ns=np.zeros(1, np.int64), range_m=np.ones(1), azimuth_rad=np.zeros(1),
        intensity=np.ones(1), label=np.zeros(n, np.int64),
    )  # fmt: skip
    none = bernoullis.nothing(model.states)
    assert scan.points is not None
    return pointevidence.look(rows, none, scan, scan.points, clusters, config, 0, model), rows


def test_a_miss_of_points_leaves_what_the_formula_says() -> None:
    ev, rows = evidence(np.array([[70.0, 70.0], [70.5, 70.0]]), 0.7, "model.p_detect=0.6")
    q, rates = rate.missed(rows.rate, np.array([0.6]))
    assert ev.log_miss[0] == pytest.approx(math.log(0.3 + 0.7 * q[0]))
    assert ev.missed.tracks.existence[0] == pytest.approx(0.7 * q[0] / (0.3 + 0.7 * q[0]))
    np.testing.assert_allclose(ev.missed.rate, rates)


def test_hits_and_births_learn_the_number_of_points() -> None:
    x, _ = hulls(1, 3)
    z = points_on(x, 9, 4)[0]
    ev, rows = evidence(z, 0.7, "pmbm.rate_shape=30", "pmbm.rate_scale=3")
    cell = np.array([0])
    hit = ev.hit(np.array([0]), cell)
    assert hit.tracks.existence.tolist() == [1.0]
    np.testing.assert_allclose(hit.rate, rows.rate + np.array([9.0, 1.0]))
    ev.try_new([0])
    born = ev.newborn(cell)
    np.testing.assert_allclose(born.rate, [[39.0, 4.0]])
    assert born.tracks.existence[0] == pytest.approx(float(expit(ev.log_u[0])))


def test_a_confirmed_row_that_hardly_exists_is_shown_as_tentative() -> None:
    tracker = gp_pmbm(config_of("gp-pmbm", "pmbm.extract_existence=0.6"))
    x, P = hulls(2, 3)
    rows = rows_of(HullModel(tracker.config), x, P)
    tracks = replace(rows.tracks, existence=np.array([0.59, 0.61]), confirmed=np.ones(2, bool))
    state = PmbmState(replace(rows, tracks=tracks), (), bernoullis.nothing(tracker.states))
    assert tracker.estimate(state).status.tolist() == [TENTATIVE, CONFIRMED]


def test_poisson_components_below_the_limit_are_left_out_and_the_heaviest_stay() -> None:
    config = config_of("gp-pmbm", "pmbm.prune_poisson=0.02", "pmbm.most_poisson=2")
    x, P = hulls(4, 3)
    rows = rows_of(HullModel(config), x, P)
    rows = replace(rows, tracks=replace(rows.tracks, existence=np.array([0.05, 0.019, 0.03, 0.04])))
    assert undetected.pruned(rows, config.pmbm).tracks.existence.tolist() == [0.05, 0.04]
    more = undetected.pruned(rows, replace(config.pmbm, most_poisson=9))
    assert more.tracks.existence.tolist() == [0.05, 0.03, 0.04]


def test_the_iterations_never_end_dearer_than_they_began() -> None:
    x, P = hulls(60, 21)
    z = points_on(x, 12, 22)
    use = np.ones(z.shape[:2], bool)
    start = x.copy()
    rng = np.random.default_rng(23)
    start[:, :2] += rng.normal(0.0, 4.0, (60, 2))
    start[:, contour.HEADING] += rng.uniform(-2.0, 2.0, 60)
    info = np.linalg.inv(P)

    def cost(s: FloatArray) -> FloatArray:
        found = contour.residuals(s, z, RULES)
        gap = s - x
        return np.asarray((found.e**2 / found.var[..., 0]).sum(axis=1) + np.einsum("ki,kij,kj->k", gap, info, gap))

    for iterations in (2, 3, 50):
        got = iekf.fit(x, P, z, use, start, replace(RULES, iterations=iterations))
        assert (cost(got.x) <= cost(start) + 1e-6).all()


def test_only_the_rows_that_are_pruned_are_recycled() -> None:
    config = config_of("gp-pmbm", "pmbm.recycle=true", "pmbm.prune_existence=0.01", "pmbm.prune_poisson=0.001")
    x, P = hulls(4, 3)
    rows = rows_of(HullModel(config), x, P)
    rows = replace(rows, tracks=replace(rows.tracks, existence=np.array([0.5, 0.008, 0.9, 0.006])))
    none = bernoullis.nothing(rows.x.shape[1])
    left, _, poisson = pruned(rows, (), rows.tracks.id, rows.tracks, none, config)
    assert left.tracks.id.tolist() == [1, 3]
    assert poisson.tracks.existence.tolist() == [0.008, 0.006]
    np.testing.assert_array_equal(poisson.x, rows.x[[1, 3]])


def test_of_a_crowd_each_row_is_tried_with_its_largest_cells() -> None:
    row, size = np.array([0, 0, 0, 1, 2, 2]), np.array([1, 5, 3, 1, 2, 7])
    assert fullest(row, size, 6).all()
    assert fullest(row, size, 5).tolist() == [False, True, False, True, False, True]
    assert fullest(row, size, 1).sum() == 3  # each row keeps one
