"""Scenes before a LiDAR: who is hidden by whom, what is clutter, how they are written and read back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from shapely import Point, Polygon

from maritrack.errors import ConfigError
from maritrack.io.octets import octets_from_bytes
from maritrack.io.pointjson import PointSource
from maritrack.settings import InputConfig
from maritrack.simulate.lidar import Boat, Lidar, outline, sweep, wake
from maritrack.simulate.lidarscene import LidarScene, present, reference_of, scans_of, simulate_lidar
from maritrack.simulate.scenes import load_any
from maritrack.simulate.vessels import State
from tests.cli.calling import call

SCENES = ("four-ships", "canal-1", "canal-2")


def scene_of(name: str) -> LidarScene:
    scene = load_any(name)
    assert isinstance(scene, LidarScene)
    return scene


def boat_at(east_m: float, north_m: float, heading_deg: float = 90.0, **kind: float) -> tuple[Boat, State]:
    boat = Boat(
        id="b", length_m=6.0, width_m=3.0, bow_m=2.0, waypoints_m=((0.0, 0.0), (1.0, 0.0)), speed_mps=1.0,
        turn_deg_per_s=5.0, **kind,
    )  # fmt: skip
    return boat, State(np.array([[east_m, north_m]]), np.zeros((1, 2)), np.deg2rad([heading_deg]))


def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def test_a_hull_is_a_box_with_a_pointed_bow() -> None:
    boat, state = boat_at(10.0, 20.0)
    shape = Polygon(outline(state, boat)[0])
    assert shape.area == pytest.approx(4 * 3 + 2 * 3 / 2) and shape.exterior.is_ccw
    assert_allclose(outline(state, boat)[0, 0], [13.0, 20.0])
    assert shape.covers(Point(11.0, 21.4)) and not shape.covers(Point(12.0, 21.4))


@pytest.mark.parametrize("name", SCENES)
def test_without_noise_every_return_of_a_boat_lies_on_its_hull(name: str) -> None:
    scene = scene_of(name)
    scene = replace(scene, lidar=tuple(replace(x, sigma_range_m=0.0) for x in scene.lidar))
    for k in (60, 140, 220):
        hulls = {number: Polygon(outline(state, boat)[0]) for number, boat, state in present(scene, k)}
        for scan in scans_of(scene, k, seed=3):
            points = scan.points
            assert points is not None and points.truth_label is not None and (points.truth_label >= 0).any()
            for at, number in zip(points.position_m, points.truth_label.tolist(), strict=True):
                assert number < 0 or hulls[number].exterior.distance(Point(at)) < 1e-9


def test_a_ship_hides_what_is_behind_it() -> None:
    near, far = boat_at(0.0, 20.0), boat_at(0.0, 30.0)
    seen = sweep(Lidar(), np.zeros(2), [(0, *far), (1, *near)], rng())
    alone = sweep(Lidar(), np.zeros(2), [(0, *far)], rng())
    assert (alone.label == 0).sum() > 40 and (seen.label == 1).sum() > 60
    assert not (seen.label == 0).any()  # as wide as the one before it, and farther
    assert len(np.unique(np.rint(np.rad2deg(seen.azimuth_rad) / 0.25))) == len(seen.azimuth_rad)  # one a ray


def test_a_wake_lies_behind_the_stern_and_is_hidden_by_a_hull() -> None:
    boat, state = boat_at(0.0, 20.0, wake_rate=500.0, wake_length_m=4.0)
    at = wake(boat, state, rng())  # the boat heads east: astern is west
    assert 400 < len(at) < 600 and at[:, 0].max() < -3.0
    assert np.mean(-3.0 - at[:, 0]) == pytest.approx(4.0, rel=0.15)
    before, _ = boat_at(-6.0, 10.0)
    hider = State(np.array([[-6.0, 10.0]]), np.zeros((1, 2)), np.array([np.pi / 2]))
    seen = sweep(Lidar(), np.zeros(2), [(0, boat, state), (1, replace(before, length_m=30.0), hider)], rng())
    assert not (seen.label == -1).any()
    open_sea = sweep(Lidar(), np.zeros(2), [(0, boat, state)], rng())
    assert (open_sea.label == -1).sum() > 30


def test_clutter_is_poisson_and_even_over_the_disc() -> None:
    lidar = Lidar(clutter_rate=20.0)
    draws = [sweep(lidar, np.zeros(2), [], np.random.default_rng(i)) for i in range(400)]
    count = np.array([len(d.range_m) for d in draws])
    assert count.mean() == pytest.approx(20.0, rel=0.05) and count.var() == pytest.approx(20.0, rel=0.25)
    range_m = np.concatenate([d.range_m for d in draws])
    assert np.mean(range_m < 50.0) == pytest.approx(0.25, abs=0.02)  # a quarter of the area


def test_ships_of_the_paper_enter_two_at_a_time() -> None:
    scene = scene_of("four-ships")
    assert [len(list(present(scene, k))) for k in (0, 19, 20, 39, 40, 249)] == [0, 0, 2, 2, 4, 4]
    reference = reference_of(scene, scene.scans)
    assert np.diff(reference.start).tolist() == [230, 230, 210, 210]
    assert {(float(a), float(b)) for a, b in zip(reference.length_m, reference.width_m, strict=True)} == {(6.0, 3.0)}
    range_m = np.hypot(*reference.position_m.T)
    assert range_m.max() < 100.0 and (range_m[reference.start[:-1]] > 90.0).all()


@pytest.mark.parametrize("name", SCENES)
def test_what_is_written_is_what_is_read(name: str, tmp_path: Path) -> None:
    """Poses of the platform and mounts of the sensors give every point its place again."""
    scene = scene_of(name)
    told = simulate_lidar(scene, tmp_path / "a.json", seed=2, scans=45)
    data = (tmp_path / "a.json").read_bytes()
    frames = list(PointSource(octets_from_bytes(data, name="a", channel="/input/a"), InputConfig()).frames())
    wanted = [scan for k in range(45) for scan in scans_of(scene, k, seed=2)]
    assert len(frames) == len(wanted) == 45 * len(scene.lidar)
    for frame, scan in zip(frames, wanted, strict=True):
        assert scan.points is not None and frame.scan.points is not None
        assert_allclose(frame.scan.points.position_m, scan.points.position_m, atol=1e-9)
        assert_allclose(frame.scan.position_m, scan.position_m, atol=1e-12)
        assert frame.scan.sensor.id == scan.sensor.id
        assert frame.scan.points.truth_label is not None and scan.points.truth_label is not None
        assert frame.scan.points.truth_label.tolist() == scan.points.truth_label.tolist()
    assert told["points"] == sum(len(f.scan.points) for f in frames if f.scan.points is not None)
    again = simulate_lidar(scene, tmp_path / "b.json", seed=2, scans=45)
    other = simulate_lidar(scene, tmp_path / "c.json", seed=3, scans=45)
    a, b, c = ((tmp_path / f"{x}.json").read_bytes() for x in "abc")
    assert a == b and a != c and again["octets"] != 0 and other["seed"] == 3


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"length_m": 1.0}, "bow_m within"),
        ({"waypoints_m": ((0.0, 0.0),)}, "two or more"),
        ({"speed_mps": 0.0}, "speed_mps"),
        ({"wake_rate": 1.0}, "belong together"),
    ],
)
def test_a_boat_that_makes_no_sense_is_named(change: dict[str, object], told: str) -> None:
    boat, _ = boat_at(0.0, 0.0)
    with pytest.raises(ConfigError, match=told):
        replace(boat, **change)  # type: ignore[arg-type]


def test_the_command_writes_a_scene_with_its_truth(tmp_path: Path) -> None:
    told = call("simulate", "canal-1", "-o", tmp_path / "x.json", "--scans", "30", "--json").json
    assert told["objects"] == 1 and told["truth_rows"] == 30 and told["scans"] == 30
    assert "four-ships" in call("simulate", "--list").out
