"""Several radars of one scene: their recordings, read again, show the same world."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from maritrack.chain import detect
from maritrack.config import load_config
from maritrack.errors import ConfigError
from maritrack.io.ais import read_ais
from maritrack.io.cat240.encode import encode_video
from maritrack.recording import kinds_of, open_inputs, open_recording, side_documents
from maritrack.simulate.aistable import ais_table
from maritrack.simulate.record import simulate
from maritrack.simulate.scenery import Land, grounds
from maritrack.simulate.scenes import Scene, load_scene
from maritrack.simulate.turnrecords import encode_turn
from maritrack.simulate.vessels import arrive, depart, straight
from maritrack.types import FloatArray, Origin

RADAR = """
[[radar]]
name = "{name}"
sac = 1
sic = {sic}
turn_s = 2.5
spokes = 180
beam_deg = 2.0
cells = 120
cell_m = 10.0
pulse_m = 10.0
unit_range_m = 4000.0
floor_db = 0.0
full_db = 60.0
threshold = 90
sparse_noise = true
{place}
"""
VESSEL = """
[[vessel]]
id = "{id}"
length_m = {length}
width_m = 12.0
rcs_m2 = 3000.0
fade = 50.0
waypoints_m = {way}
speed_mps = {speed}
"""
WORLD = (
    'title = "reach"\nstart = 2026-03-01T08:00:00Z\nlat_deg = 54.0\nlon_deg = 8.0\nscans = 12\n'
    + RADAR.format(name="a", sic=1, place="east_m = -500.0\nnorth_m = 100.0")
    + RADAR.format(name="b", sic=2, place="east_m = 450.0\nnorth_m = -150.0")
    + RADAR.format(name="c", sic=3, place='aboard = "launch"\nhead_up = true\nfirst_cell = 3')
    + VESSEL.format(id="launch", length=20.0, way="[[-200, -300], [200, -320], [400, -100]]", speed=8.0)
    + VESSEL.format(id="ship", length=60.0, way="[[-300, 250], [300, 200]]", speed=6.0)
)


def world(tmp_path: Path, text: str = WORLD) -> Scene:
    path = tmp_path / "reach.toml"
    path.write_text(text, "utf-8")
    return load_scene(path)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the recordings of the world."""
    folder = tmp_path_factory.mktemp("reach")
    simulate(world(folder), folder / "rec.cat240", seed=3, labels=False)
    return folder


def places(folder: Path, names: str) -> dict[str, FloatArray]:
    """Middle of the strongest echo less the truth of the ship, (n, 2) by sensor, as a run sees it."""
    paths = [folder / f"rec-{name}.cat240" for name in names]
    side = side_documents(
        paths, truth=folder / "rec.truth.json", own_ship=folder / "rec.ais.csv", sensors=folder / "rec.sensors.toml"
    )
    octets = open_inputs(paths)
    config = load_config(preset="radar")
    ship = world(folder).vessel[1].course()
    found: dict[str, list[FloatArray]] = {}
    for frame in open_recording(octets, kinds_of(octets), side, config).frames:
        points = detect(frame.scan, config)
        t_s = points.t_ns * 1e-9 - world(folder).start_s
        off_m = points.position_m - ship.at(t_s).position_m
        near = np.hypot(off_m[:, 0], off_m[:, 1]) < 120.0
        if near.any():
            found.setdefault(frame.scan.sensor.id, []).append(off_m[near].mean(axis=0))
    return {sensor: np.array(rows) for sensor, rows in found.items()}


def test_all_radars_see_the_ship_where_it_is(recorded: Path) -> None:
    seen = places(recorded, "abc")
    assert set(seen) == {"1-1", "1-2", "1-3"}
    for sensor, off_m in seen.items():
        assert len(off_m) >= 10, sensor
        assert np.hypot(*off_m.mean(axis=0)) < 12.0, sensor  # the near side is the brighter one: half a width, a cell


def test_a_radar_aboard_runs_alone_as_well(recorded: Path) -> None:
    assert set(places(recorded, "c")) == {"1-3"}


def test_the_number_of_processes_changes_nothing(recorded: Path, tmp_path: Path) -> None:
    done = simulate(world(tmp_path), tmp_path / "rec.cat240", seed=3, labels=False, workers=2)
    assert [Path(p).name for p in done["recordings"]] == ["rec-a.cat240", "rec-b.cat240", "rec-c.cat240"]
    for path in sorted(recorded.glob("rec*")):
        assert (tmp_path / path.name).read_bytes() == path.read_bytes()


def test_labels_of_a_radar_aboard_are_never_of_the_vessel_that_carries_it(tmp_path: Path) -> None:
    from maritrack.simulate.labels import read_labels

    simulate(world(tmp_path), tmp_path / "rec.cat240", seed=3, scans=2)
    owners = {name: set(read_labels(tmp_path / f"rec-{name}.labels.parquet").object) for name in "abc"}
    assert owners == {"a": {"launch", "ship"}, "b": {"launch", "ship"}, "c": {"ship"}}


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('name = "b"', 'name = "a"', "each its own"),
        ('name = "b"', 'name = ""', "each its own"),
        ("sic = 2", "sic = 1", "sac and sic"),
        ('aboard = "launch"', 'aboard = "lunch"', "no vessel"),
        ('aboard = "launch"\n', "", "head_up"),
    ],
)
def test_radars_that_cannot_be_are_errors(tmp_path: Path, old: str, new: str, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        world(tmp_path, WORLD.replace(old, new))


def test_the_ground_is_one_map_for_all_radars() -> None:
    land = Land(outline_m=((0, 0), (300, 0), (300, 200)), spike=0.5)
    a, b = grounds([land], seed=1)[0], grounds([land], seed=1)[0]
    at = np.random.default_rng(0).uniform(0, 200, (50, 2))
    assert_allclose(a.at(at), b.at(at + 1e-9))
    assert_allclose(
        grounds([Land(outline_m=((0, 0), (9e3, 0), (9e3, 9e3)))], seed=1)[0].strength.mean(), 1.0, atol=0.01
    )


def test_records_filled_in_together_are_those_made_one_by_one(tmp_path: Path) -> None:
    scene = world(tmp_path)
    radar, rng = scene.radar, np.random.default_rng(0)
    video = np.where(rng.random((radar.spokes, radar.cells)) < rng.random((radar.spokes, 1)) ** 3, 200, 0)
    video = (video * (rng.random((radar.spokes, 1)) < 0.8)).astype(np.uint8)
    borders = np.rint(np.arange(radar.spokes + 1) * 65536 / radar.spokes).astype(int) % 65536
    ticks = np.rint((scene.start_s % 86400 + radar.times_s(2)) * 128).astype(int)
    alone = [
        encode_video(
            sac=1, sic=1, idx=2 * radar.spokes + j, start_az=int(borders[j]), end_az=int(borders[j + 1]), start_rg=0,
            cell_dur=round(2e15 * radar.cell_m / 299_792_458), cells=video[j], compress=True, tod=int(ticks[j]),
        )
        for j in range(radar.spokes)
    ]  # fmt: skip
    assert encode_turn(radar, video, 2, start_s=scene.start_s) == b"".join(alone)


def test_a_vessel_that_arrives_brakes_steadily_and_stays() -> None:
    course = depart(straight([0.0, 0.0], heading_rad=0.0, speed_mps=4.0), at_s=10.0, accel_mps2=0.1)
    course = arrive(course, at_m=np.array([0.0, 1000.0]), brake_mps2=0.02)
    # 80 m and 40 s to full speed, 400 m and 200 s to rest, 520 m and 130 s between
    state = course.at(np.array([0.0, 50.0, 179.9, 280.0, 380.0, 900.0]))
    assert_allclose(state.velocity_mps[:, 1], [0.0, 4.0, 4.0, 2.0, 0.0, 0.0], atol=1e-9)
    assert_allclose(state.position_m[:, 1], [0.0, 80.0, 599.6, 900.0, 1000.0, 1000.0], atol=1e-9)
    with pytest.raises(ConfigError, match="too short"):
        arrive(course, at_m=np.array([0.0, 300.0]), brake_mps2=0.02)


def test_reports_of_an_antenna_are_read_as_the_middle_of_the_hull(tmp_path: Path) -> None:
    scene = world(tmp_path)
    ship = replace(scene.vessel[1], antenna_m=(-20.0, 4.0))
    origin = Origin(scene.lat_deg, scene.lon_deg)
    table = ais_table(replace(scene, vessel=(scene.vessel[0], ship)), 12).encode()
    reference = read_ais(table, name="x", origin=origin).reference
    rows = slice(*reference.start[1:3].tolist())
    true = ship.course().at(reference.t_ns[rows] * 1e-9 - scene.start_s).position_m
    assert reference.ids[1] == "ship" and reference.length_m[1] == 60.0
    assert_allclose(reference.position_m[rows], true, atol=0.5)  # headings are whole degrees
    assert b"to_bow" not in ais_table(scene, 12).encode()
