"""Tracks in hindsight: the smoother against the joint Gaussian of all times, and judgements of whole tracks."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from maritrack import retrospect
from maritrack.objects import giw
from maritrack.objects.giw import Giw
from maritrack.retrospect import History
from maritrack.settings import Config
from maritrack.tracksettings import ModelConfig, SmoothConfig
from maritrack.types import COASTED, CONFIRMED, STATIONARY, TENTATIVE, Clusters, Tracks
from tests import runs

EXACT = 1e-9
POINT = ModelConfig(extent="point", centroid_n_max=0, accel_psd_m2ps3=0.1)
RIGID = ModelConfig(
    centroid_n_max=0, extent_time_constant_s=1e12, alpha_max=1e9, min_axis_m=1e-6, max_axis_m=1e6, rho=0.25
)


def clusters(z: np.ndarray, R: np.ndarray, scatter: np.ndarray | None = None, count: int = 1) -> Clusters:
    c = len(z)
    return Clusters(
        mean_m=z, scatter_m2=np.zeros((c, 2, 2)) if scatter is None else scatter, count=np.full(c, count),
        weight_sq=np.full(c, 1.0 / count), noise_m2=np.broadcast_to(R, (c, 2, 2)), t_ns=np.zeros(c, np.int64),
        range_m=np.zeros(c), azimuth_rad=np.zeros(c), intensity=np.ones(c), label=np.zeros(0, np.int64),
    )  # fmt: skip


def filtered(
    first: Giw, z: np.ndarray, t_s: np.ndarray, hit: np.ndarray, R: np.ndarray, model: ModelConfig, **shape: Any
) -> History:
    """n objects that are filtered side by side: object i gets the cluster z[k, i] at t_s[k] where hit[k, i]."""
    n, d, rows = len(first), first, []
    for k, at in enumerate(t_s):
        if k:
            d = giw.predict(d, np.full(n, at - t_s[k - 1]), model)
        i = np.flatnonzero(hit[k])
        pairs = giw.pair_up(d, clusters(z[k], R, **shape), i, i, np.zeros(len(i)), model)
        d = giw.update(d, clusters(z[k], R, **shape), pairs, np.ones(len(i)), np.where(hit[k], 0.0, 1.0), model)
        rows.append((k, tracks_of(d, at, hit[k])))
    return retrospect.gather(rows)


def tracks_of(d: Giw, t_s: float, hit: np.ndarray, *, status: int = CONFIRMED) -> Tracks:
    n = len(d)
    return Tracks(
        np.arange(n), np.full(n, round(t_s * 1e9)), d.x[:, :2].copy(), d.x[:, 2:].copy(), d.P.copy(), d.X.copy(),
        np.full(n, 0.9), np.full(n, status), np.zeros(n, bool), np.where(hit, np.arange(n), -1),
        extent_dof=d.alpha.copy(),
    )  # fmt: skip


def moves(t_s: np.ndarray, q: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """F and Q of each step."""
    out = []
    for dt in np.diff(t_s):
        F = np.eye(4)
        F[0, 2] = F[1, 3] = dt
        out.append((F, q * np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(2))))
    return out


def joint(first: Giw, z: np.ndarray, t_s: np.ndarray, hit: np.ndarray, R: np.ndarray, q: float) -> Any:
    """Means (k, 4) and covariances (k, 4, 4) of the posterior of all times at once, from its precision matrix."""
    k = len(t_s)
    L, b = np.zeros((4 * k, 4 * k)), np.zeros(4 * k)
    L[:4, :4] = np.linalg.inv(first.P[0])
    b[:4] = L[:4, :4] @ first.x[0]
    for i, (F, Q) in enumerate(moves(t_s, q)):
        A = np.concatenate([-F, np.eye(4)], axis=1)
        L[4 * i : 4 * i + 8, 4 * i : 4 * i + 8] += A.T @ np.linalg.inv(Q) @ A
    for i in np.flatnonzero(hit):
        L[4 * i : 4 * i + 2, 4 * i : 4 * i + 2] += np.linalg.inv(R)
        b[4 * i : 4 * i + 2] += np.linalg.inv(R) @ z[i]
    C = np.linalg.inv(L)
    return (C @ b).reshape(k, 4), np.stack([C[4 * i : 4 * i + 4, 4 * i : 4 * i + 4] for i in range(k)])


def prior(n: int, *, sigma_m: float = 30.0, sigma_mps: float = 8.0) -> Giw:
    P = np.diag([sigma_m**2, sigma_m**2, sigma_mps**2, sigma_mps**2])
    return Giw(np.zeros((n, 4)), np.tile(P, (n, 1, 1)), np.zeros((n, 2, 2)), np.full(n, 4.0))


@settings(derandomize=True, deadline=None, max_examples=20)
@given(st.integers(0, 10_000), st.integers(2, 9))
def test_the_smoother_is_the_joint_gaussian_of_all_times(seed: int, k: int) -> None:
    rng = np.random.default_rng(seed)
    t_s = np.round(np.cumsum(rng.uniform(0.8, 9.0, k)), 9)
    hit = rng.random((k, 1)) < 0.7
    z, R = rng.normal(0, 60, (k, 1, 2)), np.diag([30.0, 200.0]) + 20.0
    smooth = retrospect.smoothed(filtered(prior(1), z, t_s, hit, R, POINT), POINT).tracks
    x, P = joint(prior(1), z[:, 0], t_s, hit[:, 0], R, POINT.accel_psd_m2ps3)
    assert_allclose(np.concatenate([smooth.position_m, smooth.velocity_mps], axis=1), x, rtol=EXACT, atol=1e-7)
    assert_allclose(smooth.cov, P, rtol=1e-7, atol=1e-7)


def test_smoothed_errors_are_smaller_by_the_margin_that_the_theory_gives() -> None:
    rng, n, k, q = np.random.default_rng(5), 400, 24, POINT.accel_psd_m2ps3
    t_s, R = np.round(np.cumsum(rng.uniform(1.5, 3.5, k)), 9), 100.0 * np.eye(2)
    start = prior(n)
    state = rng.multivariate_normal(np.zeros(4), start.P[0], n)
    truth = [state]
    for F, Q in moves(t_s, q):
        truth.append(truth[-1] @ F.T + rng.multivariate_normal(np.zeros(4), Q, n))
    x = np.stack(truth)
    z = x[:, :, :2] + rng.multivariate_normal(np.zeros(2), R, (k, n))
    history = filtered(start, z, t_s, rng.random((k, n)) < 0.85, R, POINT)
    rows = {name: value.tracks for name, value in (("filter", history), ("all", retrospect.smoothed(history, POINT)))}
    said, found, sharp = {}, {}, {}
    for name, tracks in rows.items():
        error = tracks.position_m - x[history.scan, tracks.id, :2]
        said[name] = float(np.trace(tracks.cov[:, :2, :2], axis1=1, axis2=2).mean())
        found[name] = float((error**2).sum(axis=1).mean())
        form = np.einsum("ni,nij,nj->n", error, np.linalg.inv(tracks.cov[:, :2, :2]), error)
        sharp[name] = float(form.reshape(n, k).mean(axis=1).mean())
    assert said["all"] < 0.7 * said["filter"]
    for name in rows:
        assert_allclose(found[name], said[name], rtol=0.06), name  # 400 tracks: 3 sigma of the mean square is 6 %
        assert_allclose(sharp[name], 2.0, rtol=0.06), name
    assert_allclose(found["all"] / found["filter"], said["all"] / said["filter"], rtol=0.06)


def test_the_last_row_and_a_track_of_one_scan_stay_what_the_filter_said() -> None:
    rng, t_s = np.random.default_rng(1), np.array([0.0, 2.0, 4.5])
    history = filtered(prior(3), rng.normal(0, 40, (3, 3, 2)), t_s, np.ones((3, 3), bool), 50 * np.eye(2), POINT)
    last = history.rows(history.scan == 2)
    assert runs.differences(last.tracks, retrospect.smoothed(history, POINT).rows(history.scan == 2).tracks) == []
    assert runs.differences(last.tracks, retrospect.smoothed(last, POINT).tracks) == []


def test_scans_without_a_hit_at_the_end_change_nothing() -> None:
    rng, t_s = np.random.default_rng(2), np.array([0.0, 2.0, 4.5, 7.0, 20.0])
    hit = np.array([[True], [True], [True], [False], [False]])
    z, R = rng.normal(0, 40, (5, 1, 2)), 50 * np.eye(2)
    long = retrospect.smoothed(filtered(prior(1), z, t_s, hit, R, POINT), POINT)
    short = retrospect.smoothed(filtered(prior(1), z[:3], t_s[:3], hit[:3], R, POINT), POINT)
    assert_allclose(long.tracks.position_m[:3], short.tracks.position_m, atol=1e-8)
    assert_allclose(long.tracks.cov[:3], short.tracks.cov, atol=1e-7)


def test_a_gap_is_bridged_from_both_sides() -> None:
    t_s = np.arange(20.0)
    hit = ((t_s < 6) | (t_s > 14))[:, None]
    z = np.stack([5.0 * t_s, 100 - 3.0 * t_s], axis=1)[:, None]
    history = filtered(prior(1), z, t_s, hit, 4 * np.eye(2), POINT)
    smooth = retrospect.smoothed(history, POINT)
    inside = ~hit[:, 0]
    assert np.abs(smooth.tracks.position_m - z[:, 0])[inside].max() < 2.0
    deviation = np.sqrt([history.tracks.cov[14, 0, 0], smooth.tracks.cov[14, 0, 0]])
    assert deviation[1] < deviation[0] / 3


def test_rows_of_one_time_are_one_state() -> None:
    z = np.array([[[3.0, 1.0]], [[5.0, -2.0]]])
    history = filtered(prior(1), z, np.zeros(2), np.ones((2, 1), bool), 9 * np.eye(2), POINT)
    smooth = retrospect.smoothed(history, POINT).tracks
    assert_allclose(smooth.position_m[0], smooth.position_m[1], atol=EXACT)
    assert_allclose(smooth.cov[0], smooth.cov[1], atol=1e-8)


def extended(seed: int, model: ModelConfig, k: int = 6) -> History:
    rng = np.random.default_rng(seed)
    first = replace(prior(1), X=np.diag([900.0, 100.0])[None], alpha=np.full(1, 8.0))
    scatter = np.diag([500.0, 60.0])[None] * 9 * rng.uniform(0.5, 1.5)
    z = rng.normal(0, 5, (k, 1, 2))
    return filtered(first, z, 2.5 * np.arange(k), rng.random((k, 1)) < 0.8, 25 * np.eye(2), model, scatter=scatter,
                    count=10)  # fmt: skip


@pytest.mark.parametrize("seed", range(4))
def test_a_rigid_extent_is_at_all_times_what_it_is_at_the_end(seed: int) -> None:
    smooth = retrospect.smoothed(extended(seed, RIGID), RIGID).tracks
    assert smooth.extent_dof is not None
    assert_allclose(smooth.extent_m2, np.broadcast_to(smooth.extent_m2[-1], (6, 2, 2)), rtol=1e-7)
    assert_allclose(smooth.extent_dof, smooth.extent_dof[-1], rtol=1e-7)


def test_an_extent_that_changes_at_once_is_what_the_filter_said() -> None:
    quick = replace(RIGID, extent_time_constant_s=1e-3)
    history = extended(0, quick)
    assert_allclose(retrospect.smoothed(history, quick).tracks.extent_m2, history.tracks.extent_m2, rtol=1e-9)


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.integers(0, 10_000), st.floats(1.0, 300.0))
def test_smoothed_extents_lie_between_filtered_ones_and_know_more(seed: int, tau_s: float) -> None:
    model = replace(RIGID, extent_time_constant_s=tau_s, alpha_max=40.0)
    history = extended(seed, model)
    smooth = retrospect.smoothed(history, model).tracks
    for axis in (0, 1):
        said = history.tracks.extent_m2[:, axis, axis]
        assert (smooth.extent_m2[:, axis, axis] <= said.max() * (1 + EXACT)).all()
        assert (smooth.extent_m2[:, axis, axis] >= said.min() * (1 - EXACT)).all()
    assert smooth.extent_dof is not None and history.tracks.extent_dof is not None
    assert (smooth.extent_dof >= history.tracks.extent_dof * (1 - EXACT)).all()


def test_extents_without_degrees_of_freedom_stay_and_contours_go_along() -> None:
    history = extended(3, RIGID)
    outline = tuple(
        row + np.array([[0.0, 9.0], [4.0, -5.0], [-4.0, -5.0]]) for row in history.tracks.position_m[:, None]
    )
    told = [
        (int(k), replace(history.rows(history.scan == k).tracks, extent_dof=None, contour_m=(outline[int(k)],)))
        for k in history.scan
    ]
    smooth = retrospect.smoothed(retrospect.gather(told), RIGID).tracks
    assert (smooth.extent_m2 == history.tracks.extent_m2).all()
    for before, after, a, b in zip(
        outline, smooth.contour_m, history.tracks.position_m, smooth.position_m, strict=True
    ):
        assert_allclose(after - before, np.broadcast_to(b - a, (3, 2)), atol=EXACT)


@settings(derandomize=True, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 6))
def test_existence_is_that_of_the_two_state_chain(seed: int, k: int) -> None:
    """Against the sum over all lives: existing to the end, or ended after step i."""
    rng = np.random.default_rng(seed)
    survive, ratio = rng.uniform(0.5, 1.0, k - 1), rng.uniform(0.05, 8.0, k)  # likelihood existing / not existing
    r, forward = 0.3, []
    for i in range(k):
        r = r * survive[i - 1] if i else r
        r = ratio[i] * r / (1 - r + ratio[i] * r)
        forward.append(r)
    back = [forward[-1]]
    for i in range(k - 2, -1, -1):
        back.insert(
            0, float(retrospect.smooth_existence(np.array([forward[i]]), np.array([back[0]]), survive[i : i + 1])[0])
        )
    never, lives = 0.7, []
    for end in range(k):  # exists in 0..end
        ends = 1.0 if end == k - 1 else 1 - survive[end]
        lives.append(0.3 * np.prod(survive[:end]) * ends * np.prod(ratio[: end + 1]))
    total = never + sum(lives)
    assert_allclose(back, [sum(lives[i:]) / total for i in range(k)], rtol=1e-9)


@settings(derandomize=True, deadline=None)
@given(st.integers(0, 10_000))
def test_tracks_are_cut_to_their_hits(seed: int) -> None:
    rng = np.random.default_rng(seed)
    hit = rng.random((7, 5)) < 0.3
    history = filtered(prior(5), np.zeros((7, 5, 2)), np.arange(7.0), hit, np.eye(2), POINT)
    kept = retrospect.between_hits(history)
    expected = [
        (i, k) for i in range(5) if hit[:, i].any()
        for k in range(int(np.argmax(hit[:, i])), 7 - int(np.argmax(hit[::-1, i])))
    ]  # fmt: skip
    assert list(zip(kept.tracks.id.tolist(), kept.scan.tolist(), strict=True)) == expected


@settings(derandomize=True, deadline=None)
@given(st.lists(st.integers(1, 7), min_size=1, max_size=6), st.integers(0, 10_000))
def test_medians_and_greatest_distances_are_those_of_each_track(sizes: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    group = np.repeat(np.arange(len(sizes)), sizes)
    first = np.searchsorted(group, np.arange(len(sizes)))
    value, position = rng.normal(size=len(group)), rng.normal(0, 50, (len(group), 2))
    parts = [group == i for i in range(len(sizes))]
    assert_allclose(retrospect.median(value, first, group), [np.median(value[part]) for part in parts])
    exact = [np.linalg.norm(position[p][:, None] - position[p][None], axis=2).max() for p in parts]
    found = retrospect.greatest_distance(position, first)
    assert (found <= np.array(exact) + EXACT).all() and (found >= 0.995 * np.array(exact) - EXACT).all()


def straight(speed_mps: float, *, hits: int = 15, confirmed: bool = True, wander_m: float = 0.0) -> History:
    """A track of 15 scans, 2.5 s apart, with hits in the first of them."""
    rng, t_s = np.random.default_rng(7), 2.5 * np.arange(15.0)
    rows = []
    for k, at in enumerate(t_s):
        x = np.array([[speed_mps * at + wander_m * rng.normal(), wander_m * rng.normal(), speed_mps, 0.0]])
        d = Giw(x, np.eye(4)[None] * 0.01, np.diag([100.0, 25.0])[None], np.full(1, 20.0))
        status = CONFIRMED if confirmed and k == 5 else TENTATIVE
        rows.append((k, tracks_of(d, at, np.array([k < hits]), status=status)))
    return retrospect.gather(rows)


CONFIG = Config(smooth=SmoothConfig(min_hits=8, moving_speed_mps=1.0, moving_displacement_m=20.0, moving_lengths=1.0))


def test_a_track_is_told_whole_or_not_at_all() -> None:
    offline = retrospect.hindsight(straight(5.0), CONFIG)
    assert offline.scan.tolist() == list(range(15))
    assert (offline.tracks.status == CONFIRMED).all() and offline.tracks.moving.all()
    assert retrospect.hindsight(straight(5.0, hits=9), CONFIG).scan.tolist() == list(range(9))
    assert len(retrospect.hindsight(straight(5.0, hits=7), CONFIG)) == 0
    assert len(retrospect.hindsight(straight(5.0, confirmed=False), CONFIG)) == 0


def test_what_lies_at_rest_or_wanders_about_its_place_does_not_move() -> None:
    assert not retrospect.hindsight(straight(0.0), CONFIG).tracks.moving.any()
    assert not retrospect.hindsight(straight(0.0, wander_m=4.0), CONFIG).tracks.moving.any()
    long = replace(CONFIG, smooth=replace(CONFIG.smooth, moving_lengths=20.0))
    assert not retrospect.hindsight(straight(5.0), long).tracks.moving.any()
    shore = replace(CONFIG, smooth=replace(CONFIG.smooth, moving_length_max_m=10.0))
    assert not retrospect.hindsight(straight(5.0), shore).tracks.moving.any()


def test_a_scan_without_a_hit_is_coasted_also_in_hindsight() -> None:
    t_s, hit = np.arange(12.0), np.ones((12, 1), bool)
    hit[4:6] = False
    history = filtered(prior(1), np.stack([9 * t_s, 0 * t_s], 1)[:, None], t_s, hit, np.eye(2), POINT)
    status = retrospect.hindsight(history, replace(CONFIG, model=POINT)).tracks.status
    assert status.tolist() == [CONFIRMED] * 4 + [COASTED] * 2 + [CONFIRMED] * 6


def test_nothing_comes_of_nothing() -> None:
    for history in (retrospect.gather([]), retrospect.gather([(0, retrospect.gather([]).tracks)])):
        assert len(retrospect.hindsight(history, CONFIG)) == 0
        assert retrospect.hindsight(history, CONFIG).by_scan() == {}


def test_what_the_background_held_is_stationary_also_in_hindsight() -> None:
    history = straight(5.0, hits=15)
    status = np.where(np.arange(15) == 7, STATIONARY, history.tracks.status)
    offline = retrospect.hindsight(replace(history, tracks=replace(history.tracks, status=status)), CONFIG)
    assert np.flatnonzero(offline.tracks.status == STATIONARY).tolist() == [7]


def test_what_goes_slower_than_asked_for_does_not_move_however_far_it_comes() -> None:
    far = replace(CONFIG, smooth=replace(CONFIG.smooth, moving_displacement_m=5.0, moving_lengths=0.0))
    assert not retrospect.hindsight(straight(0.9), far).tracks.moving.any()
    assert retrospect.hindsight(straight(1.2), far).tracks.moving.all()
