"""Laws of the Poisson multi-Bernoulli mixture: JIPDA within it, and all its hypotheses by brute force."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.associate.murty import k_best
from maritrack.cluster.stage import cluster_points
from maritrack.trackers import TRACKERS
from maritrack.trackers.hypotheses import Factor, probability, product, tidy
from maritrack.types import FloatArray
from tests.unit.scans import plain_config, scan_of, step

ALL = ("pmbm.prune_hypothesis=0", "pmbm.prune_existence=0", "pmbm.most_hypotheses=100000", "pmbm.most_children=100000",
       "pmbm.group_limit=1000", "pmbm.most_in_scan=1000000", "tracker.delete_existence=0")  # fmt: skip
SURVIVE, Q, SIGMA_M, SIGMA_V, P_D, LAM, R0 = 0.97, 0.05, 5.0, 10.0, 0.8, 1e-4, 0.3
GATE = -2.0 * math.log(1.0 - 0.99)


def separated(seed: int) -> list[FloatArray]:
    """Scans of three points far from each other that are seen four times in five."""
    rng = np.random.default_rng(seed)
    start = np.array([[0.0, 0.0], [2000.0, 500.0], [-1500.0, 2500.0]])
    velocity = np.array([[3.0, 1.0], [-2.0, 2.0], [0.0, -4.0]])
    scans = []
    for k in range(12):
        seen = rng.random(3) < (1.0 if k < 2 else 0.8)
        scans.append((start + 2.0 * k * velocity)[seen] + rng.normal(0, 4.0, (int(seen.sum()), 2)))
    return scans


def run(config: Any, scans: list[FloatArray], dt_s: float = 2.0) -> Any:
    """The tracks after some scans."""
    state = None
    for k, z in enumerate(scans):
        state = step(config, state, z, dt_s * k)
    return TRACKERS[config.tracker_name](config).estimate(state), state


@pytest.mark.parametrize("seed", range(4))
def test_one_hypothesis_and_a_stationary_poisson_part_are_jipda_where_objects_are_apart(seed: int) -> None:
    """The clutter density of JIPDA counts new objects as well: lambda + P_D b, which is lambda / (1 - r0)."""
    same = ("tracker.birth_existence=0.1", "tracker.delete_existence=0.05", "pmbm.prune_existence=0.05",
            "pmbm.hypotheses=merged", "model.p_survive=0.99")  # fmt: skip
    scans = separated(seed)
    ours, _ = run(plain_config("giw-pmbm", *same), scans)
    jipda, _ = run(plain_config("jipda", *same, f"model.clutter_density_per_m2={1e-6 / 0.9}"), scans)
    assert len(jipda) == 3
    assert ours.id.tolist() == jipda.id.tolist()
    np.testing.assert_allclose(ours.existence, jipda.existence, rtol=1e-9)
    np.testing.assert_allclose(ours.position_m, jipda.position_m, atol=1e-7)
    np.testing.assert_allclose(ours.cov, jipda.cov, atol=1e-6)
    assert ours.status.tolist() == jipda.status.tolist()


def test_a_mixture_never_prunes_to_less_than_jipda_does() -> None:
    """Where nothing is ambiguous, the mixture has the same tracks, and is as sure of them."""
    same = ("tracker.birth_existence=0.1", "tracker.delete_existence=0.05", "pmbm.prune_existence=0.05")
    scans = separated(9)
    mixture, _ = run(plain_config("giw-pmbm", *same), scans)
    jipda, _ = run(plain_config("jipda", *same), scans)
    assert mixture.id.tolist() == jipda.id.tolist()
    np.testing.assert_allclose(mixture.existence, jipda.existence, atol=0.02)
    np.testing.assert_allclose(mixture.position_m, jipda.position_m, atol=1.0)


@dataclass
class Track:
    r: float
    x: FloatArray
    P: FloatArray


@dataclass
class World:
    """A hypothesis of everything, by brute force; tracks by scan and number of the point they began with."""

    log_w: float = 0.0
    tracks: dict[tuple[int, int], Track] = field(default_factory=dict)


def predicted(track: Track, dt: float) -> Track:
    F = np.eye(4)
    F[0, 2] = F[1, 3] = dt
    G = np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    return Track(track.r * SURVIVE**dt, F @ track.x, F @ track.P @ F.T + Q * np.kron(G, np.eye(2)))


def brute_force(scans: list[FloatArray], dt: float) -> list[World]:
    """Every association of every scan: the weights of the sheet, one hypothesis at a time."""
    worlds = [World()]
    for k, z in enumerate(scans):
        after = []
        for world in worlds:
            tracks = {label: predicted(t, dt if k else 0.0) for label, t in world.tracks.items()}
            labels = list(tracks)
            for choice in itertools.product(range(-1, len(z)), repeat=len(labels)):
                taken = [c for c in choice if c >= 0]
                if len(taken) != len(set(taken)):
                    continue
                new = World(world.log_w)
                for label, c in zip(labels, choice, strict=True):
                    t = tracks[label]
                    if c < 0:
                        q = 1.0 - P_D * 0.99
                        new.log_w += math.log(1.0 - t.r + t.r * q)
                        new.tracks[label] = Track(t.r * q / (1.0 - t.r + t.r * q), t.x, t.P)
                        continue
                    S = t.P[:2, :2] + SIGMA_M**2 * np.eye(2)
                    nu = z[c] - t.x[:2]
                    distance = float(nu @ np.linalg.solve(S, nu))
                    if distance > GATE:
                        break
                    log_n = -0.5 * distance - 0.5 * math.log(np.linalg.det(2 * math.pi * S))
                    new.log_w += math.log(t.r * P_D / LAM) + log_n
                    K = t.P[:, :2] @ np.linalg.inv(S)
                    new.tracks[label] = Track(1.0, t.x + K @ nu, t.P - K @ S @ K.T)
                else:
                    for c in range(len(z)):
                        if c not in taken:
                            new.log_w += math.log(1.0 / (1.0 - R0))
                            P = np.diag([SIGMA_M**2] * 2 + [SIGMA_V**2] * 2)
                            new.tracks[k, c] = Track(R0, np.array([*z[c], 0.0, 0.0]), P)
                    after.append(new)
        worlds = after
    top = max(w.log_w for w in worlds)
    total = math.log(sum(math.exp(w.log_w - top) for w in worlds)) + top
    for w in worlds:
        w.log_w -= total
    return worlds


def close_scans(seed: int, counts: tuple[int, ...]) -> list[FloatArray]:
    rng = np.random.default_rng(seed)
    return [rng.normal(0, 18, (n, 2)) for n in counts]


@pytest.mark.parametrize(
    ("seed", "counts"), [(0, (1, 1, 1)), (1, (2, 2, 1)), (2, (2, 1, 2)), (3, (1, 2, 2)), (4, (2, 0, 2))]
)
def test_all_hypotheses_weigh_what_brute_force_says(seed: int, counts: tuple[int, ...]) -> None:
    scans = close_scans(seed, counts)
    worlds = brute_force(scans, 2.0)
    config = plain_config(
        "giw-pmbm", *ALL, f"model.p_survive={SURVIVE}", f"model.accel_psd_m2ps3={Q}", f"model.p_detect={P_D}",
        f"model.clutter_density_per_m2={LAM}", f"tracker.birth_existence={R0}", "model.max_speed_mps=1e9",
    )  # fmt: skip
    tracks, state = run(config, scans)
    expected: dict[tuple[float, ...], float] = {}
    for world in worlds:
        for t in world.tracks.values():
            key = tuple(np.round([*t.x, t.r], 5) + 0.0)
            expected[key] = expected.get(key, 0.0) + math.exp(world.log_w)
    found: dict[tuple[float, ...], float] = {}
    p, _ = probability(state.factors, len(state.rows))
    for x, r, weight in zip(state.rows.tracks.density.x, state.rows.tracks.existence, p, strict=True):
        key = tuple(np.round([*x, r], 5) + 0.0)
        found[key] = found.get(key, 0.0) + float(weight)
    assert {k for k, v in found.items() if v > 1e-9} == {k for k, v in expected.items() if v > 1e-9}
    for key, weight in found.items():
        assert weight == pytest.approx(expected.get(key, 0.0), abs=1e-9), key
    expected_objects = sum(math.exp(w.log_w) * sum(t.r for t in w.tracks.values()) for w in worlds)
    assert tracks.existence.sum() == pytest.approx(expected_objects, rel=1e-9)


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(0, 4))
def test_the_best_assignments_are_those_of_brute_force(seed: int, t: int, m: int) -> None:
    rng = np.random.default_rng(seed)
    gain = np.where(rng.random((t, m)) < 0.8, rng.normal(0, 3, (t, m)), -np.inf)
    every = []
    for choice in itertools.product(range(-1, m), repeat=t):
        taken = [c for c in choice if c >= 0]
        value = sum(gain[row, c] for row, c in enumerate(choice) if c >= 0)
        if len(taken) == len(set(taken)) and np.isfinite(value):
            every.append(value)
    every.sort(reverse=True)
    place, total = k_best(gain, np.zeros(t), 7)
    np.testing.assert_allclose(total, every[: min(7, len(every))], atol=1e-9)
    assert len({tuple(row) for row in place.tolist()}) == len(place)
    for value, row in zip(total, place, strict=True):
        assert value == pytest.approx(sum(gain[k, c] for k, c in enumerate(row) if c >= 0))
    near = k_best(gain, np.zeros(t), 100, span=2.0)
    assert len(near.gain) == min(100, sum(v >= every[0] - 2.0 for v in every))


def test_the_product_of_factors_has_the_likeliest_pairs_first() -> None:
    a = Factor(np.log([0.7, 0.3]), np.array([[0], [1]]))
    b = Factor(np.log([0.6, 0.4]), np.array([[2], [3]]))
    both = product([a, b], 3)
    np.testing.assert_allclose(np.exp(both.log_w), [0.42, 0.28, 0.18])
    assert both.row.tolist() == [[0, 2], [0, 3], [1, 2]]


def test_equal_hypotheses_are_one_and_a_track_that_is_the_same_in_all_is_on_its_own() -> None:
    log_w = np.log([0.4, 0.3, 0.2, 0.001])
    row = np.array([[5, 1], [5, 2], [5, 1], [5, 3]])
    single, factor = tidy(log_w, row, least=0.01, most=10)
    assert single == [5] and factor is not None
    np.testing.assert_allclose(np.exp(factor.log_w), [2 / 3, 1 / 3])
    assert factor.row.tolist() == [[1], [2]]
    assert tidy(log_w, row, least=0.01, most=1) == ([5, 1], None)


def crowd(seed: int, n: int, spread_m: float, scans: int) -> list[FloatArray]:
    """Objects that stay, so near each other that the gates of all overlap."""
    rng = np.random.default_rng(seed)
    at = rng.uniform(-spread_m, spread_m, (n, 2))
    return [at + rng.normal(0, 5.0, at.shape) for _ in range(scans)]


def test_hypotheses_of_a_crowd_keep_to_their_limits() -> None:
    config = plain_config(
        "giw-pmbm", "pmbm.most_hypotheses=30", "pmbm.most_in_scan=200", "pmbm.group_limit=1000",
        "pmbm.prune_hypothesis=0.0", "pmbm.prune_existence=1e-3",
    )  # fmt: skip
    _, state = run(config, crowd(0, 25, 250.0, 6))
    assert state.factors
    assert max(len(f.log_w) for f in state.factors) <= 30
    rows = [f.row[f.row >= 0] for f in state.factors]
    assert np.concatenate(rows).max() < len(state.rows)
    for factor in state.factors:
        assert np.exp(factor.log_w).sum() == pytest.approx(1.0)
        assert (np.diff(factor.log_w) <= 1e-12).all()
        labels = [{int(state.rows.tracks.id[r]) for r in column if r >= 0} for column in factor.row.T]
        assert all(len(one) <= 1 for one in labels), "a column is one track"


def test_a_group_beyond_the_limit_is_merged_and_has_the_marginals_of_jipda() -> None:
    same = ("tracker.birth_existence=0.1", "tracker.delete_existence=0.01", "pmbm.prune_existence=0.01")
    scans = crowd(1, 12, 100.0, 4)
    _, state = run(plain_config("giw-pmbm", *same, "pmbm.group_limit=1"), scans)
    _, merged = run(plain_config("giw-pmbm", *same, "pmbm.hypotheses=merged"), scans)
    assert not state.factors and not merged.factors
    np.testing.assert_allclose(state.rows.tracks.existence, merged.rows.tracks.existence, rtol=1e-9)
    np.testing.assert_allclose(state.rows.tracks.density.x, merged.rows.tracks.density.x, atol=1e-9)


def test_rows_of_a_track_that_are_alike_become_one_and_their_weights_add_up() -> None:
    sets = (*ALL[:-1], "tracker.delete_existence=0", "model.clutter_density_per_m2=1e-4", "tracker.birth_existence=0.3")
    scans = [np.array([[0.0, 0.0], [7.0, 0.0]])] * 3
    apart, before = run(plain_config("giw-pmbm", *sets), scans)
    alike, after = run(plain_config("giw-pmbm", *sets, "pmbm.merge_distance2=4.0"), scans)
    assert len(after.rows) < len(before.rows)
    assert set(alike.id.tolist()) <= set(apart.id.tolist())
    assert alike.existence.sum() == pytest.approx(apart.existence.sum(), rel=0.05)


def test_a_scan_without_room_for_new_tracks_starts_none_and_says_so() -> None:
    config = plain_config("giw-pmbm", "tracker.max_tracks=2")
    tracker = TRACKERS["giw-pmbm"](config)
    state, info = tracker.init(), None
    for k in range(2):
        scan, points = scan_of(np.array([[0.0, 0.0], [900.0, 0.0], [1800.0, 0.0]]), 2.0 * k)
        clusters = cluster_points(points, scan, config.cluster, config.input)
        state, info = tracker.update(state, scan, points, clusters)
    assert len(state.rows) == 2 and info is not None and info.n_left_out == 1
