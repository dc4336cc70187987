"""Scenes of points in space: what they hold, how they are written and read, and what is tracked of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from maritrack.errors import ConfigError
from maritrack.simulate.pointscene import PointScene, scan_of, simulate_points, truth_of
from maritrack.simulate.scenes import load_any, load_scene
from maritrack.types import FloatArray
from tests.cli.calling import call


@pytest.fixture(name="scene")
def crossing() -> PointScene:
    scene = load_any("crossing-3d")
    assert isinstance(scene, PointScene)
    return scene


@pytest.mark.eq("engm-40", "engm-41")
def test_the_two_objects_begin_apart_and_meet_after_fifty_seconds(scene: PointScene) -> None:
    assert_allclose(truth_of(scene, 0), [[50, 50, 50, 0.5, 0.5, 2], [100, 100, 50, -0.5, -0.5, 2]])
    assert_allclose(truth_of(scene, 50)[:, :3], [[75, 75, 150]] * 2)


def in_space(scene: PointScene, k: int, seed: int) -> tuple[FloatArray, FloatArray]:
    points = scan_of(scene, k, seed=seed).points
    assert points is not None and points.up_m is not None and points.truth_label is not None
    return np.column_stack([points.position_m, points.up_m]), points.truth_label


@pytest.mark.eq("engm-43")
def test_points_are_as_many_and_where_the_scene_says(scene: PointScene) -> None:
    found = [in_space(scene, k, seed) for seed in range(3) for k in range(0, 100, 2)]
    label = np.concatenate([one[1] for one in found])
    at = np.concatenate([one[0] for one in found])
    assert abs((label >= 0).sum() / 300 - 0.98) < 0.03
    assert abs((label < 0).sum() / 150 - 10.0) < 1.0
    clutter = at[label < 0]
    assert clutter.min() > -1e-9 and (clutter.max(axis=0) < [200.1, 200.1, 400.1]).all()
    assert_allclose(clutter.mean(axis=0), [100, 100, 200], rtol=0.08)


def test_a_scan_depends_on_seed_and_number_alone(scene: PointScene) -> None:
    a, b, c = in_space(scene, 7, 1)[0], in_space(scene, 7, 1)[0], in_space(scene, 7, 2)[0]
    assert np.array_equal(a, b) and not np.array_equal(a[:1], c[:1])


def test_a_scene_of_points_is_no_scene_of_radars() -> None:
    with pytest.raises(ConfigError, match="without radar video"):
        load_scene("crossing-3d")


def test_a_scene_that_makes_no_sense_is_named(tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text('title = "x"\nobjects = [[1.0]]\n')
    with pytest.raises(ConfigError, match="missing key"):
        load_any(path)


@pytest.mark.parametrize("tracker", ["gm-phd", "engm-phd"])
def test_what_is_simulated_is_processed_in_space_and_replayed(tmp_path: Path, tracker: str) -> None:
    """The command line from scene to tracks: heights reach the scores, the archive and the table."""
    rec, out = tmp_path / "rec.json", tmp_path / "run"
    assert call("simulate", "crossing-3d", "-o", rec, "--scans", "40", "--json").json["objects"] == 2
    done = call(
        "process", rec, "--preset", "engm", "-t", tracker, "--set", "intensity.clutter_space=jacobian", "--no-rrd",
        "-o", out, "--json",
    )  # fmt: skip
    assert done.code == 0 and done.json["metrics"]["ospa"] < 50.0
    assert call("replay", out / "run.mcap", "--verify", "--no-rrd").code == 0
    rows = call("export", out / "run.mcap", "--tracks", "-").out.splitlines()
    column = rows[0].split(",").index("up_m")
    up_m = [float(row.split(",")[column]) for row in rows[1:] if ",confirmed," in row]
    assert len(up_m) > 20 and 40 < np.median(up_m) < 140


def test_equal_seeds_write_equal_octets(scene: PointScene, tmp_path: Path) -> None:
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        simulate_points(scene, tmp_path / name, seed=seed, scans=3)
    a, b, c = ((tmp_path / name).read_bytes() for name in "abc")
    assert a == b and a != c
