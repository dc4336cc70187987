"""Hulls of point trackers: of the likeliest cluster, kept while a track is missed; births out of gates."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from shapely import MultiPoint, Polygon

from maritrack.cluster.stage import cluster_points
from maritrack.config import load_config
from maritrack.settings import Config
from maritrack.trackers import TRACKERS
from maritrack.trackers.hulls import convex
from maritrack.types import FloatArray, Tracks
from tests.cli.calling import call
from tests.unit.scans import scan_of

BOX = np.array([[-2.0, -1.0], [2.0, -1.0], [2.0, 1.0], [-2.0, 1.0], [0.0, 0.0], [1.0, 0.5]])


def config_of(*sets: str) -> Config:
    return load_config(preset="extended", sets=["tracker_name=jipda", "model.clutter_density_per_m2=1e-7", *sets])


def step(config: Config, state: Any, z: FloatArray, t_s: float) -> Any:
    tracker = TRACKERS[config.tracker_name](config)
    scan, points = scan_of(z, t_s)
    clusters = cluster_points(points, scan, config.cluster, config.input)
    return tracker.update(tracker.init() if state is None else state, scan, points, clusters)[0]


def tracks_of(config: Config, state: Any) -> Tracks:
    return TRACKERS[config.tracker_name](config).estimate(state)


def test_convex_hulls_are_those_of_shapely_and_few_points_are_their_own() -> None:
    z = np.random.default_rng(1).normal(size=(40, 2))
    assert Polygon(convex(z)).equals(MultiPoint(z).convex_hull)
    assert Polygon(convex(z)).exterior.is_ccw
    assert convex(BOX[:2]).tolist() == BOX[:2].tolist() and convex(BOX[:0]).shape == (0, 2)
    line = np.array([[0.0, 0.0], [1.0, -1.0], [3.0, -3.0], [-2.0, 2.0]])
    assert sorted(convex(line).tolist()) == [[-2.0, 2.0], [3.0, -3.0]]
    assert len(convex(np.zeros((5, 2)))) == 2


def test_a_track_draws_the_hull_of_its_cluster_and_takes_it_along_when_it_is_missed() -> None:
    config = config_of()
    state = None
    for k in range(6):
        state = step(config, state, BOX + np.array([50.0 + k, 20.0]), float(k))
    tracks = tracks_of(config, state)
    assert len(tracks) == 1 and len(tracks.contour_m) == 1
    assert_allclose(Polygon(tracks.contour_m[0]).bounds, [53.0, 19.0, 57.0, 21.0])
    missed = tracks_of(config, step(config, state, np.zeros((0, 2)), 6.0))
    moved = missed.position_m[0] - tracks.position_m[0]
    assert np.hypot(*moved) > 0.5
    assert_allclose(missed.contour_m[0], tracks.contour_m[0] + moved)


def test_of_two_clusters_the_likelier_one_is_drawn() -> None:
    config = config_of()
    state = None
    for k in range(6):
        state = step(config, state, BOX + np.array([50.0, 20.0]), float(k))
    near, far = BOX + np.array([50.5, 20.0]), BOX[:3] + np.array([50.0, 29.0])
    tracks = tracks_of(config, step(config, state, np.concatenate([far, near]), 6.0))
    assert_allclose(Polygon(tracks.contour_m[0]).centroid.coords[0], [50.5, 20.0], atol=1e-9)


def test_without_the_option_nothing_is_drawn() -> None:
    config = config_of("tracker.hull=none")
    assert tracks_of(config, step(config, None, BOX + np.array([50.0, 20.0]), 0.0)).contour_m == ()


@pytest.mark.parametrize(("birth_from", "born"), [("unexplained", 2), ("ungated", 1)])
def test_new_tracks_start_at_clusters_that_none_took_or_that_no_gate_held(birth_from: str, born: int) -> None:
    config = config_of(f"tracker.birth_from={birth_from}")
    state = None
    for k in range(8):
        state = step(config, state, np.array([[50.0, 20.0]]), float(k))
    both = np.array([[50.0, 20.0], [56.5, 20.0]])  # the second in the gate, but far less likely
    assert len(step(config, state, both, 8.0)) == born


def test_hulls_reach_the_archive_and_come_back_from_it(tmp_path: Path) -> None:
    rec, out = tmp_path / "rec.json", tmp_path / "run"
    call("simulate", "four-ships", "-o", rec, "--scans", "60")
    done = call("process", rec, "--preset", "extended", "-t", "jipda", "--no-rrd", "-o", out, "--json").json
    assert done["counts"]["track_ids_confirmed"] == 4
    assert call("replay", out / "run.mcap", "--verify", "--no-rrd").code == 0
