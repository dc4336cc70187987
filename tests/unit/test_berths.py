"""What PHD filters do with those that the background takes: whom they set aside, and how those come back."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from maritrack.cluster.stage import cluster_points
from maritrack.settings import Config
from maritrack.trackers import TRACKERS, intensity, phd
from maritrack.trackers.intensity import Intensity, IntensityState
from maritrack.trackers.steps import Sight
from maritrack.trackers.tracklist import TrackList
from maritrack.types import FloatArray, IntArray, Mask, take
from tests.unit.scans import plain_config, scan_of
from tests.unit.test_phd import components
from tests.unit.test_stationary import NOTHING, confirmed, mask_at, run, settings

BERTH = np.array([[300.0, 0.0]])


def set_aside(share: FloatArray, *, held_s: float = 0.0) -> tuple[TrackList, IntArray, FloatArray, FloatArray]:
    """Two components at one berth, and three clusters that each of them explains by `share` (2, 3)."""
    config = plain_config("cb-giw-phd", "tracker.stationary_s=100.0")
    state = components([0.9, 0.9], [1, 2], [300.0, 304.0])
    state = replace(state, confirmed=np.ones(2, bool), held_s=np.full(2, held_s))
    scan, points = scan_of([[300.0, -4.0], [300.0, 0.0], [300.0, 4.0]], 2.0)
    scan = replace(scan, covered=mask_at(BERTH))
    clusters = cluster_points(points, scan, config.cluster, config.input)
    sight = in_order(phd.look(state, scan, points, clusters, config))
    assert len(sight.pairs.i) == 6
    with np.errstate(divide="ignore"):
        log_wl = np.log(share / (1.0 - share.sum(axis=0))).ravel()
    return phd.set_aside(state, sight, log_wl, 3, scan, config)


def in_order(sight: Sight) -> Sight:
    order = np.lexsort((sight.pairs.j, sight.pairs.i))
    return replace(sight, pairs=take(sight.pairs, order), dt_s=sight.dt_s[order])


def test_of_two_that_share_a_cluster_the_one_that_wins_it_leaves_the_berth() -> None:
    """Neither is seen by more than a half; one has to be the first that leaves."""
    held, rows, log_wl, log_w0 = set_aside(np.array([[0.3, 0.0, 0.0], [0.45, 0.0, 0.0]]), held_s=10.0)
    assert held.id.tolist() == [1] and rows.tolist() == [0]
    assert held.held_s.tolist() == [12.0] and held.cluster.tolist() == [-1] and held.misses.tolist() == [0]
    assert_array_equal(np.isneginf(log_wl), [True] * 3 + [False, True, True])  # the shares of 0 are -inf before
    assert_array_equal(np.isneginf(log_w0), [True, True])  # neither is anywhere else


def test_what_is_seen_by_parts_of_several_clusters_is_not_held() -> None:
    """No cluster is explained by more than half, and yet one vessel of three parts is there."""
    held, rows, log_wl, log_w0 = set_aside(np.array([[0.0, 0.0, 0.0], [0.4, 0.4, 0.4]]))
    assert held.id.tolist() == [1] and rows.tolist() == [0]
    assert_allclose(np.exp(log_wl[3:]), 2.0 / 3.0)
    assert np.isfinite(log_w0[1])  # it was not held: it may have been missed


@pytest.mark.parametrize("name", ["gm-phd", "smc-phd", "engm-phd"])
def test_what_is_not_hidden_any_more_and_not_seen_is_missed_and_found_again(name: str) -> None:
    config = settings(name, "intensity.p_survive_scan=1.0")
    before = after_scans(config, [(BERTH, None)] * 12 + [(NOTHING, mask_at(BERTH))] * 4)
    assert before.tracks.held_s.tolist() == [8.0] and before.tracks.misses.tolist() == [0]
    elsewhere = mask_at(BERTH + 1000.0)
    after = after_scans(config, [(NOTHING, elsewhere)], state=before, t_s=32.0)
    assert after.tracks.id.tolist() == before.tracks.id.tolist() and after.tracks.held_s.tolist() == [0.0]
    assert_allclose(after.tracks.existence, (1.0 - 0.8 * 0.99) * before.tracks.existence, rtol=1e-9)
    again = after_scans(config, [(BERTH, elsewhere)] * 2, state=after, t_s=34.0)
    assert again.tracks.id[np.argmax(again.tracks.existence)] == before.tracks.id[0]


@pytest.mark.parametrize("name", ["gm-phd", "smc-phd", "engm-phd"])
def test_what_leaves_a_berth_may_have_any_speed(name: str) -> None:
    """200 m in 20 s, where it was known to lie still and is known to within a pixel of 50 m."""
    config = settings(name, "model.accel_psd_m2ps3=1e-4", "model.sigma_velocity_mps=8.0")
    hidden = mask_at(BERTH)
    scans = [(BERTH, None)] * 30 + [(NOTHING, hidden)] * 4 + [(np.array([[500.0, 0.0]]), hidden)]
    told = [confirmed(t) for t in run(config, scans, times_s=[*(2.0 * k for k in range(34)), 86.0])]
    (mine,) = told[33]
    assert_allclose(told[34][mine][1], [500.0, 0.0], atol=60.0)


def after_scans(
    config: Config, scans: list[tuple[FloatArray, Mask | None]], *, state: Any = None, t_s: float = 0.0
) -> IntensityState:
    """The state after scans, 2 s apart, with what is seen and what is covered in each."""
    tracker = TRACKERS[config.tracker_name](config)
    state = tracker.init() if state is None else state
    for k, (at, mask) in enumerate(scans):
        scan, points = scan_of(at, t_s + 2.0 * k)
        scan = replace(scan, covered=mask)
        state, _ = tracker.update(state, scan, points, cluster_points(points, scan, config.cluster, config.input))
    assert isinstance(state, IntensityState)
    return state


def test_what_left_a_berth_joins_the_births_of_a_mixture() -> None:
    births = "intensity.births=[{mean_m=[1,2],mean_mps=[0,0],sigma_m=[1,1],sigma_mps=[1,1],weight=0.1}]"
    config = plain_config("gm-phd", births, "intensity.birth=mixture")
    left = Intensity(np.full((1, 4), 5.0), np.eye(4)[None], np.array([0.7]), np.array([3]))
    state = replace(intensity.begin(config), born=left, k=1)
    new = intensity.newborn(state, 0.0, config)
    assert new.label.tolist() == [-1, 3] and new.w.tolist() == [0.1, 0.7]
    assert_array_equal(new.x[1], left.x[0])
