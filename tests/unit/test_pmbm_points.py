"""Objects that give many points: their likelihoods, the search of associations, and trackers on simulated LiDAR."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from maritrack import geo
from maritrack.associate import sampling
from maritrack.chain import build_chain, process
from maritrack.cluster.stage import cluster_points
from maritrack.config import load_config
from maritrack.errors import ConfigError
from maritrack.objects import iekf, rate
from maritrack.objects.giw import Giw
from maritrack.settings import Config
from maritrack.trackers import bernoullis, pointevidence, pointsearch, undetected
from maritrack.trackers.bernoullis import Bernoullis
from maritrack.trackers.pmbm import PmbmState
from maritrack.trackers.pointmodels import HullModel, MatrixModel, PointModel, Sets
from maritrack.trackers.sources import blank_tracks
from maritrack.types import CONFIRMED, FloatArray, Frame, IntArray, Points, Scan, Sensor, Tracks
from tests.laws.test_contour_laws import hulls, points_on

PERIOD_S = 0.5


def config_of(tracker: str, *sets: str) -> Config:
    return load_config(preset="extended", sets=[f"tracker_name={tracker}", *sets])


def points_at(z: Any, t_s: float) -> Points:
    z = np.asarray(z, float).reshape(-1, 2)
    n = len(z)
    range_m, azimuth = geo.en_to_polar(z)
    return Points(
        range_m=range_m, azimuth_rad=azimuth, position_m=z, intensity=np.ones(n), t_ns=np.full(n, round(t_s * 1e9)),
        range_width_m=np.zeros(n), azimuth_width_rad=np.zeros(n), cov_m2=np.tile(0.01 * np.eye(2), (n, 1, 1)),
    )  # fmt: skip


def scan_of(z: Any, k: int) -> Scan:
    t_ns = round(k * PERIOD_S * 1e9)
    return Scan(
        Sensor("lidar", 0.0, 0.0, 100.0), t_ns, t_ns, np.zeros(2), np.nan, points=points_at(z, k * PERIOD_S)
    )  # fmt: skip


def rows_of(model: PointModel, x: FloatArray, P: FloatArray, existence: float = 0.9) -> Bernoullis:
    """Hulls as rows with ten points expected, or ellipses of 4 x 2 m where the state has no radii."""
    n = len(x)
    tracks = replace(blank_tracks(n, 0, np.full(n, existence)), id=np.arange(1, n + 1))
    rates = np.tile([20.0, 2.0], (n, 1))
    if model.states:
        return model.predict(Bernoullis(tracks, rates, x, P), np.zeros(n))
    X = np.broadcast_to(np.diag([16.0, 4.0]), (n, 2, 2)).copy()
    tracks = replace(tracks, density=Giw(x, P, X, np.full(n, 20.0)))
    return Bernoullis(tracks, rates, np.zeros((n, 0)), np.zeros((n, 0, 0)))


def sets_of(z: FloatArray) -> Sets:
    k, n, _ = z.shape
    return Sets(z, np.broadcast_to(0.25 * np.eye(2), (k, n, 2, 2)), np.ones((k, n), bool))


def test_points_of_an_ellipse_that_is_known_are_jointly_gaussian() -> None:
    """As the degrees of freedom grow: n points about a centre that is not known, of covariance rho X + R."""
    model = MatrixModel(config_of("giw-pmbm", "model.extent=random-matrix"))
    x = np.array([[1.0, 2.0, 0.0, 0.0]])
    P = np.diag([4.0, 3.0, 1.0, 1.0])[None]
    rows = rows_of(model, x, P)
    d = rows.tracks.density
    sure = replace(rows, tracks=replace(rows.tracks, density=replace(d, alpha=np.array([1e7]))))
    z = x[0, :2] + np.random.default_rng(0).normal(0, 2.0, (1, 5, 2))
    _, got = model.fit(sure, sets_of(z), np.zeros(2), 1)
    Y = 0.25 * d.X[0] + 0.25 * np.eye(2)
    S = np.kron(np.ones((5, 5)), P[0, :2, :2]) + np.kron(np.eye(5), Y)
    gap = (z[0] - x[0, :2]).ravel()
    expected = -0.5 * (gap @ np.linalg.solve(S, gap) + np.linalg.slogdet(2 * math.pi * S)[1])
    assert got[0] == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("kind", ["hull", "matrix"])
def test_the_linear_picture_of_an_object_weighs_its_own_points_as_its_fit_does(kind: str) -> None:
    config = config_of("gp-pmbm", "contour.tolerance=1e-9", "model.extent=random-matrix")
    x, P = hulls(2, 1, config.contour)
    model: PointModel = HullModel(config) if kind == "hull" else MatrixModel(config)
    rows = rows_of(model, x, P) if kind == "hull" else rows_of(model, x[:, :4], P[:, :4, :4])
    z = points_on(x, 9, 2, config.contour)
    sets = sets_of(z)
    fitted, log_l = model.fit(rows, sets, np.zeros(2), 1)
    for k in range(2):
        one, fit = bernoullis.rows(rows, np.array([k])), bernoullis.rows(fitted, np.array([k]))
        A, y, log_noise, info = model.linear(one, fit, z[k], sets.R[k])
        slots = sampling.Slots(A, y, log_noise, info, np.zeros(1), one.rate)
        total = sampling.totals(slots, np.zeros(1, np.int64), np.ones((1, 9), bool))[0]
        total -= rate.log_count(one.rate, np.full(1, 9.0))[0]
        assert total == pytest.approx(log_l[k], abs=0.01 if kind == "hull" else 12.0)  # the latter knows its extent


def test_a_point_may_be_anywhere_on_the_perimeter() -> None:
    """The densities of the two readings differ by that of the noise across, times the perimeter."""
    log_l = {}
    for density in ("implicit", "perimeter"):
        model = HullModel(config_of("gp-pmbm", f"contour.density={density}"))
        x, P = hulls(1, 8, model.rules)
        fitted, found = model.fit(rows_of(model, x, P), sets_of(points_on(x, 12, 9, model.rules)), np.zeros(2), 1)
        log_l[density] = float(found[0])
    around = iekf.perimeter(fitted.x, model.rules)[0]
    each = math.log(around / (math.sqrt(2 * math.pi) * model.rules.sigma_point_m))
    assert log_l["implicit"] - log_l["perimeter"] == pytest.approx(12 * each)
    assert 12.0 < around < 18.0


def test_thinned_points_weigh_as_many_as_they_stand_for() -> None:
    full, thin = (HullModel(config_of("gp-pmbm", f"contour.most_points={most}")) for most in (0, 20))
    x, P = hulls(1, 3, full.rules)
    rows = rows_of(full, x, P)
    z = points_on(x, 60, 4, full.rules)
    order = np.argsort(np.arctan2(z[0, :, 0], z[0, :, 1]))
    a, log_a = full.fit(rows, sets_of(z[:, order]), np.zeros(2), 1)
    b, log_b = thin.fit(rows, sets_of(z[:, order]), np.zeros(2), 1)
    assert log_b[0] == pytest.approx(log_a[0], abs=12.0)
    assert np.hypot(*(a.x[0, :2] - b.x[0, :2])) < 0.3
    assert np.trace(b.P[0]) > np.trace(a.P[0])


def evidence_of(seed: int, association: str) -> tuple[pointevidence.PointEvidence, IntArray]:
    """Two ellipses near each other and seven points of them or of nothing, in one cell."""
    config = config_of(
        "giw-pmbm", "model.extent=random-matrix", "cluster.eps_m=30.0", f"pmbm.association={association}",
        "pmbm.birth=uniform", "tracker.birth_density_per_m2=1e-30", "model.clutter_density_per_m2=0.01",
        "pmbm.prune_hypothesis=0.0", "pmbm.most_children=3000", "model.p_gate=0.9999999",
    )  # fmt: skip
    model = MatrixModel(config)
    rng = np.random.default_rng(seed)
    at = np.array([[0.0, 20.0], [4.5, 22.0]])
    x = np.concatenate([at, np.zeros((2, 2))], axis=1)
    rows = rows_of(model, x, np.tile(0.2 * np.eye(4), (2, 1, 1)))
    z = np.concatenate([at[rng.integers(0, 2, 6)] + rng.normal(0, 1.5, (6, 2)), rng.uniform([-4, 16], [8, 28], (1, 2))])
    scan = scan_of(z, 0)
    assert scan.points is not None
    clusters = cluster_points(scan.points, scan, config.cluster, config.input)
    empty = bernoullis.nothing(0)
    return pointevidence.look(rows, empty, scan, scan.points, clusters, config, 0, model), np.arange(2)


def every_association(ev: pointevidence.PointEvidence) -> dict[tuple[int, ...], float]:
    """Each point to one of the two, where it is in the gate, or to clutter."""
    n = len(ev.cells.z)
    weight: list[dict[tuple[int, ...], float]] = []
    for r in (0, 1):
        near = np.sort(np.concatenate([p for (row, _), p in ev.inside.items() if row == r])).tolist()
        sets = [one for size in range(1, len(near) + 1) for one in itertools.combinations(near, size)]
        pairs = [(r, ev.cells.number(np.array(one))) for one in sets]
        weight.append(dict(zip(sets, (ev.log_hit(pairs) - ev.log_miss[r]).tolist(), strict=True)) | {(): 0.0})
    found = {}
    for state in itertools.product((-1, 0, 1), repeat=n):
        mine = [tuple(i for i, s in enumerate(state) if s == r) for r in (0, 1)]
        if all(one in weight[r] for r, one in enumerate(mine)):
            found[state] = weight[0][mine[0]] + weight[1][mine[1]]
    return found


def test_searches_find_the_best_association_of_points() -> None:
    """Of 2,187: stochastic optimisation in 18 of 20 problems, partitions, which cannot make all of them, in 14."""
    best = {"stochastic": 0, "murty": 0}
    for seed in range(20):
        for how in best:
            ev, rows = evidence_of(seed, how)
            assert ev.n_elements == 1
            search = pointsearch.stochastic if how == "stochastic" else pointsearch.partitions
            found = search(ev, rows, np.array([0]), most=50)
            every = every_association(ev)
            top = max(every.values())
            best[how] += found.log_w[0] >= top - 1e-6
            assert found.log_w[0] <= top + 1e-6
            for log_w, cells in zip(found.log_w.tolist(), found.cell.tolist(), strict=True):
                state = [-1] * len(ev.cells.z)
                for row, c in enumerate(cells):
                    for point in ev.cells.points[c] if c >= 0 else []:
                        state[point] = row
                assert log_w == pytest.approx(every[tuple(state)], abs=1e-6)
    assert best["stochastic"] >= 17, best
    assert best["murty"] < best["stochastic"]


def ship(at: FloatArray, heading_rad: float, rng: np.random.Generator, n: int = 14) -> FloatArray:
    """Points of the outline of a 6 x 3 m box that a sensor at the origin sees, with a noise of 0.1 m."""
    u = rng.uniform(-0.5, 0.5, (6 * n, 2)) * [6.0, 3.0]
    side = rng.integers(0, 2, 6 * n).astype(bool)
    u[side, 1] = 1.5 * np.sign(u[side, 1])
    u[~side, 0] = 3.0 * np.sign(u[~side, 0])
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    normal = np.where(side[:, None], [0.0, 1.0], [1.0, 0.0]) * np.sign(u)
    turn = np.array([[c, -s], [s, c]])
    z, normal = at + u @ turn.T, normal @ turn.T
    near = (z * normal).sum(axis=1) < 0
    return z[near][:n] + rng.normal(0, 0.1, (min(n, int(near.sum())), 2))


def watch(config: Config, scans: list[FloatArray]) -> list[Tracks]:
    chain = build_chain(config)
    state, seen = chain.init(), []
    for k, z in enumerate(scans):
        state, result = process(chain, state, Frame(k, scan_of(z, k)))
        seen.append(result.tracks)
    return seen


def passing(seed: int, n_scans: int, *, gap_m: float = 0.0) -> tuple[list[FloatArray], list[list[FloatArray]]]:
    """Two ships that pass each other with so much between their centres (one ship: 0), ten stray points a scan."""
    rng, scans, truth = np.random.default_rng(seed), [], []
    for k in range(n_scans):
        way = 1.5 * PERIOD_S * k - 12.0
        at = [np.array([way, 30.0])]
        if gap_m > 0:
            at.append(np.array([-way, 30.0 + gap_m]))
        z = [ship(place, math.pi * number, rng) for number, place in enumerate(at)]
        scans.append(np.concatenate([*z, rng.uniform(-70, 70, (10, 2))]))
        truth.append(at)
    return scans, truth


def confirmed(tracks: Tracks) -> IntArray:
    return np.flatnonzero(tracks.status >= CONFIRMED)


@pytest.mark.parametrize("association", ["stochastic", "murty"])
def test_a_ship_amid_stray_points_is_one_track_with_its_outline(association: str) -> None:
    shapely = pytest.importorskip("shapely")
    scans, truth = passing(1, 24)
    seen = watch(config_of("gp-pmbm", f"pmbm.association={association}"), scans)
    ids, held = set(), 0
    for tracks, at in zip(seen[5:], truth[5:], strict=True):
        rows = confirmed(tracks)
        assert len(rows) <= 1
        held += len(rows)
        if len(rows) == 0:
            continue
        row = rows[0]
        ids.add(int(tracks.id[row]))
        assert np.hypot(*(tracks.position_m[row] - at[0])) < 2.0
        true = shapely.box(at[0][0] - 3, at[0][1] - 1.5, at[0][0] + 3, at[0][1] + 1.5)
        found = shapely.Polygon(tracks.contour_m[row])
        assert true.intersection(found).area / true.union(found).area > 0.45
    assert len(ids) == 1 and held >= 18  # of 19
    assert np.hypot(*(seen[-1].velocity_mps[confirmed(seen[-1])[0]] - [1.5, 0.0])) < 0.5


def test_ships_that_pass_and_are_one_cluster_meanwhile_keep_their_ids() -> None:
    scans, truth = passing(2, 28, gap_m=7.0)
    seen = watch(config_of("gp-pmbm", "contour.density=perimeter"), scans)
    ids: list[set[int]] = [set(), set()]
    for tracks, at in zip(seen[6:], truth[6:], strict=True):
        rows = confirmed(tracks)
        for number, place in enumerate(at):
            away = np.hypot(*(tracks.position_m[rows] - place).T)
            assert away.min() < 3.0
            ids[number].add(int(tracks.id[rows[away.argmin()]]))
    assert [len(one) for one in ids] == [1, 1] and ids[0] != ids[1]


def test_an_ellipse_on_points_follows_a_ship_as_well() -> None:
    scans, truth = passing(3, 20)
    config = config_of("giw-pmbm", "pmbm.measurement=points", "model.extent=random-matrix", "model.min_axis_m=0.5")
    seen = watch(config, scans)
    for tracks, at in zip(seen[6:], truth[6:], strict=True):
        away = np.hypot(*(tracks.position_m[confirmed(tracks)] - at[0]).T)
        assert away.min() < 3.0
    assert not seen[-1].contour_m


def test_stray_points_alone_make_no_track_and_nothing_at_all_is_no_error() -> None:
    rng = np.random.default_rng(4)
    seen = watch(config_of("gp-pmbm"), [rng.uniform(-70, 70, (20, 2)) for _ in range(15)] + [np.zeros((0, 2))] * 3)
    assert not any(len(confirmed(tracks)) for tracks in seen)


@pytest.mark.parametrize("association", ["stochastic", "murty"])
def test_points_all_in_one_place_are_no_error(association: str) -> None:
    config = config_of("gp-pmbm", f"pmbm.association={association}")
    seen = watch(config, [np.full((40, 2), [8.68, 49.24])] * 4)
    assert all(np.isfinite(tracks.cov).all() for tracks in seen)


def test_equal_scans_give_equal_tracks_and_the_order_of_points_is_no_matter() -> None:
    scans, _ = passing(5, 10)
    config = config_of("gp-pmbm")
    a, b = watch(config, scans)[-1], watch(config, scans)[-1]
    assert a.position_m.tobytes() == b.position_m.tobytes() and a.cov.tobytes() == b.cov.tobytes()
    rng = np.random.default_rng(0)
    c = watch(config, [z[rng.permutation(len(z))] for z in scans])[-1]
    np.testing.assert_allclose(a.position_m[confirmed(a)], c.position_m[confirmed(c)], atol=0.15)


def test_an_object_that_is_gone_ends_and_its_mass_is_recycled() -> None:
    scans, _ = passing(6, 12)
    config = config_of("gp-pmbm", "pmbm.recycle=true", "pmbm.prune_poisson=1e-6", "pmbm.prune_existence=0.05",
                       "tracker.delete_sigma_m=500.0")  # fmt: skip
    chain = build_chain(config)
    state, mass = chain.init(), []
    for k, z in enumerate([*scans, *[np.zeros((0, 2))] * 12]):
        state, _ = process(chain, state, Frame(k, scan_of(z, k)))
        after: PmbmState = state.tracker
        mass.append(float(after.poisson.tracks.existence.sum()))
    assert len(after.rows) == 0
    assert 0.0 < max(mass[len(scans) :]) < 0.05
    assert mass[-1] < 0.01 * max(mass)  # it is not seen there, scan after scan


def test_what_is_recycled_weighs_what_it_was_likely_to_exist() -> None:
    config = config_of("giw-pmbm", "pmbm.recycle=true", "pmbm.prune_poisson=0.001", "pmbm.most_poisson=2")
    model = MatrixModel(config_of("giw-pmbm", "model.extent=random-matrix"))
    rows = rows_of(model, np.zeros((4, 4)), np.tile(np.eye(4), (4, 1, 1)), existence=0.008)
    p = np.array([1.0, 0.5, 0.01, 0.75])
    back = undetected.recycled(bernoullis.nothing(0), rows, np.array([0, 1, 2, 3]), p, config.pmbm)
    assert back.tracks.existence.tolist() == pytest.approx([0.008, 0.006])
    off = replace(config.pmbm, recycle=False)
    assert len(undetected.recycled(bernoullis.nothing(0), rows, np.arange(4), p, off)) == 0


def test_the_ring_of_births_holds_the_weight_of_a_scan() -> None:
    config = config_of("gp-pmbm", "pmbm.birth_components=12", "pmbm.birth_weight=0.3")
    at, mu = undetected.ring(np.array([5.0, -3.0]), config.pmbm)
    assert len(at) == 15 and mu.sum() == pytest.approx(0.3)
    away = np.hypot(*(at - [5.0, -3.0]).T)
    assert away[:12] == pytest.approx(np.full(12, 100.0)) and away[12:] == pytest.approx(np.full(3, 50.0))


@pytest.mark.parametrize(
    ("tracker", "sets"),
    [("gp-pmbm", ["model.clutter=estimated"]), ("gp-pmbm", ["clutter_map.method=cells"]),
     ("giw-pmbm", ["pmbm.measurement=points"])],
)  # fmt: skip
def test_settings_that_points_cannot_have_are_errors(tracker: str, sets: list[str]) -> None:
    with pytest.raises(ConfigError):
        build_chain(config_of(tracker, *sets))
