"""The near and the far field: courses, sparse noise, closed-form hulls, labels and AIS agree with truth."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from maritrack.errors import ConfigError
from maritrack.geo import TWO_PI, wrap
from maritrack.io.ais import read_ais
from maritrack.io.cat240.encode import encode_video
from maritrack.simulate.aistable import ais_path, report_times_s
from maritrack.simulate.antenna import RadarSettings
from maritrack.simulate.echoes import Mover, echoes, fades, movers
from maritrack.simulate.hulls import chords, hear
from maritrack.simulate.labels import labels_path, read_labels
from maritrack.simulate.radar import Turn, labelled_turn, turn
from maritrack.simulate.rays import BEAM_REACH, inside_length
from maritrack.simulate.record import simulate, turns
from maritrack.simulate.scenery import Land, Sea, scenery
from maritrack.simulate.scenes import LAND_ID, Scene, load_scene
from maritrack.simulate.sparse import backdrop, noise_shown, sparse_turn
from maritrack.simulate.turnrecords import encode_turn
from maritrack.simulate.vessels import Vessel
from maritrack.types import Origin

HOUR_S = 3600.0
FIELDS = ("near-field", "far-field")
RADAR = RadarSettings(
    turn_s=2.5, spokes=720, beam_deg=0.8, cells=300, cell_m=10.0, pulse_m=20.0, unit_range_m=6000.0,
    floor_db=0.0, full_db=25.5, threshold=50, sparse_noise=True,
)  # fmt: skip
SCENE = """
title = "small"
start = 2026-03-01T23:59:58Z
lat_deg = 54.0
lon_deg = 8.0
scans = 4
[radar]
sac = 7
sic = 9
turn_s = 2.5
spokes = 720
beam_deg = 1.0
cells = 200
cell_m = 10.0
pulse_m = 20.0
unit_range_m = 3000.0
floor_db = 0.0
full_db = 40.0
threshold = 50
sparse_noise = {sparse}
[[land]]
name = "rock"
outline_m = [[800, 800], [900, 800], [900, 900], [800, 900]]
[[vessel]]
id = "ship"
name = "SHIP"
length_m = 80.0
width_m = 12.0
rcs_m2 = 2000.0
waypoints_m = [[300, 700], [300, -700]]
speed_mps = 10.0
[[vessel]]
id = "silent"
length_m = 30.0
width_m = 8.0
rcs_m2 = 500.0
waypoints_m = [[-600, 20], [-600, -700]]
speed_mps = 5.0
ais = false
[[vessel]]
id = "moored"
length_m = 40.0
width_m = 8.0
rcs_m2 = 500.0
waypoints_m = [[-200, -500]]
"""


def small(folder: Path, *, sparse: bool = True) -> Scene:
    path = folder / "small.toml"
    path.write_text(SCENE.format(sparse=str(sparse).lower()), "utf-8")
    return load_scene(path)


def positions_m(scene: Scene, step_s: float = 2.5) -> np.ndarray:
    """Midships of all vessels through the hour, (n, t, 2)."""
    t_s = np.arange(0.0, HOUR_S + step_s, step_s)
    return np.stack([v.course().at(t_s).position_m for v in scene.vessel])


@pytest.mark.parametrize("name", FIELDS)
def test_a_field_is_an_hour_of_sixteen_vessels_of_several_sizes_with_and_without_ais(name: str) -> None:
    scene = load_scene(name)
    under_way = [v for v in scene.vessel if v.speed_mps > 0.0]
    assert scene.scans * scene.radar.turn_s == HOUR_S
    assert scene.radar.spokes == 2048 and scene.radar.cell_m <= 15.0
    assert len(under_way) == 16
    assert len([v for v in scene.vessel if v.id.startswith("buoy")]) >= 3
    assert len({v.length_m for v in under_way}) >= 10
    assert max(v.length_m for v in under_way) > 5.0 * min(v.length_m for v in under_way)
    assert 4 <= sum(v.ais for v in scene.vessel) <= len(scene.vessel) - 4


@pytest.mark.parametrize(
    ("name", "low_m", "high_m"), [("near-field", 250.0, 5000.0), ("far-field", 20_000.0, 30_000.0)]
)
def test_vessels_stay_in_their_field_for_the_hour(name: str, low_m: float, high_m: float) -> None:
    scene = load_scene(name)
    range_m = np.hypot(*np.moveaxis(positions_m(scene), 2, 0))
    assert range_m.min() >= low_m and range_m.max() <= high_m
    half_m = max(v.length_m for v in scene.vessel) / 2
    assert scene.radar.edges_m[0] <= max(low_m - half_m, 0.0)
    assert scene.radar.edges_m[-1] >= range_m.max() + half_m


@pytest.mark.parametrize("name", FIELDS)
def test_no_two_hulls_touch_and_several_pairs_pass_near_at_different_times(name: str) -> None:
    scene = load_scene(name)
    at_m, length_m = positions_m(scene, 1.0), np.array([v.length_m for v in scene.vessel])
    met_s = []
    for i, j in itertools.combinations(range(len(at_m)), 2):
        apart_m = np.hypot(*(at_m[i] - at_m[j]).T)
        assert apart_m.min() > (length_m[i] + length_m[j]) / 2, (scene.vessel[i].id, scene.vessel[j].id)
        if apart_m.min() < 300.0 and scene.vessel[j].speed_mps > 0.0:
            met_s.append(float(apart_m.argmin()))
    assert len(met_s) >= 4
    assert np.count_nonzero(np.diff(sorted(met_s)) > 60.0) >= 3


@pytest.mark.parametrize("name", FIELDS)
def test_a_vessel_passes_behind_another(name: str) -> None:
    """The nearer hull covers the bearing of the farther one's midships."""
    scene = load_scene(name)
    ships = [v for v in scene.vessel if v.speed_mps > 0.0]
    at_m = positions_m(scene)[: len(ships)]
    range_m, bearing_rad = np.hypot(at_m[..., 0], at_m[..., 1]), np.arctan2(at_m[..., 0], at_m[..., 1])
    behind = [
        (i, j)
        for i, j in itertools.permutations(range(len(ships)), 2)
        if np.any(
            (np.abs(wrap(bearing_rad[i] - bearing_rad[j])) < ships[i].width_m / 2 / range_m[i])
            & (range_m[j] > range_m[i])
        )
    ]
    assert len(behind) >= 2


def test_vessels_of_the_near_field_keep_off_the_land() -> None:
    scene = load_scene("near-field")
    at_m = positions_m(scene, 5.0)
    for piece in scene.land:
        ashore = shapely.contains_xy(shapely.Polygon(piece.outline_m).buffer(20.0), at_m[..., 0], at_m[..., 1])
        assert not ashore.any(), piece.name


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.floats(300, 3000), st.floats(0, 6.28), st.floats(0, 6.28), st.floats(-0.1, 0.1))
def test_a_chord_is_as_long_as_the_ray_inside_the_hull(range_m: float, at_rad: float, h_rad: float, d: float) -> None:
    position_m = (range_m * np.sin(at_rad), range_m * np.cos(at_rad))
    end = (position_m[0] + 100 * np.sin(h_rad), position_m[1] + 100 * np.cos(h_rad))
    boat = Vessel(id="v", length_m=120.0, width_m=20.0, rcs_m2=1.0, waypoints_m=(position_m, end), speed_mps=1.0)
    mover = Mover(boat, boat.course())
    outline_m = mover.hull_m(mover.course.at(np.zeros(1)))
    near_m, far_m = chords(outline_m, np.array([[at_rad + d]]))
    expected_m = inside_length(outline_m, np.array([at_rad + d]), np.array([9000.0]))[0, 0]
    assert_allclose((far_m - near_m)[0, 0], expected_m, atol=1e-6)


def heard_image(radar: RadarSettings, fleet: tuple[Mover, ...], k: int) -> np.ndarray:
    power = np.zeros((radar.spokes, radar.cells))
    for h in hear(radar, fleet, None, k, seed=5):
        power[h.spokes, h.first_cell : h.first_cell + h.power.shape[1]] += h.power
    return power


@pytest.mark.parametrize("azimuth_deg", [0.0, 40.0, 200.0, 359.9])
def test_hulls_in_closed_form_give_the_echoes_of_the_fine_grid(azimuth_deg: float) -> None:
    a = np.radians(azimuth_deg)

    def going(id_: str, range_m: float, length_m: float) -> Vessel:
        start = (range_m * np.sin(a), range_m * np.cos(a))
        end = (start[0] + 500.0, start[1] + 300.0)
        return Vessel(
            id=id_, length_m=length_m, width_m=length_m / 6, rcs_m2=1e3, waypoints_m=(start, end), speed_mps=9.0
        )

    fleet = movers(RADAR, [going("a", 1500.0, 90.0), going("behind", 1800.0, 60.0), going("c", 2500.0, 12.0)])
    still = scenery(RADAR, (), Sea(), seed=0)
    for k in (0, 3):
        exact = np.zeros((RADAR.spokes, RADAR.cells))
        for i, echo in enumerate(echoes(RADAR, fleet, still, k)):
            cells = slice(echo.first_cell, echo.first_cell + echo.power.shape[1])
            exact[echo.spokes, cells] += fades(RADAR, fleet, i, echo, k, seed=5)[:, None] * echo.power
        ours = heard_image(RADAR, fleet, k)
        assert_allclose(ours.sum(), exact.sum(), rtol=0.01)
        assert_allclose(ours, exact, atol=0.04 * exact.max())


@pytest.mark.parametrize(("looks", "stc_range_m"), [(1.0, 0.0), (3.0, 0.0), (1.0, 1500.0)])
def test_sparse_noise_passes_the_threshold_as_the_dense_noise_does(looks: float, stc_range_m: float) -> None:
    radar = dataclasses.replace(RADAR, looks=looks, stc_range_m=stc_range_m, threshold=30)
    still = scenery(radar, (), Sea(), seed=0)
    dense = np.stack([turn(radar, (), still, Sea(), k, seed=1) for k in range(8)])
    quiet = backdrop(radar, still)
    sparse = np.stack([sparse_turn(radar, (), quiet, Sea(), k, seed=2).video for k in range(8)])
    assert np.count_nonzero(dense) > 500
    for level in (radar.threshold, 40, 55, 70):
        a, b = np.count_nonzero(dense >= level), np.count_nonzero(sparse >= level)
        assert abs(a - b) <= 4.0 * np.sqrt(a + b + 1.0), level
    a, b = (np.count_nonzero(v[:, :, :100]) for v in (dense, sparse))  # where the gain is least
    assert abs(a - b) <= 4.0 * np.sqrt(a + b + 1.0)
    assert sparse[sparse > 0].min() == radar.threshold


def test_noise_cells_are_drawn_once_each_and_evenly_over_the_turn() -> None:
    cells, power = noise_shown(dataclasses.replace(RADAR, threshold=30), np.random.default_rng(3))
    assert np.all(np.diff(cells) > 0) and cells[-1] < RADAR.spokes * RADAR.cells
    counts = np.histogram(cells, bins=10, range=(0, RADAR.spokes * RADAR.cells))[0]
    assert np.all(np.abs(counts - counts.mean()) < 4.5 * np.sqrt(counts.mean()))
    assert power.min() >= dataclasses.replace(RADAR, threshold=30).least_power.min()


def test_land_and_clutter_pass_the_threshold_as_often_sparse_as_dense() -> None:
    """Land's own texture differs from cell to cell, clutter's from turn to turn."""
    sea = Sea(level_db=8.0, decay=4.0, spike=0.5)
    wall = Land(outline_m=((-300.0, 2000.0), (300.0, 2000.0), (300.0, 2100.0), (-300.0, 2100.0)), rcs_m2_per_m=2.0)
    still = scenery(RADAR, [wall], sea, seed=0)
    quiet = backdrop(RADAR, still)
    dense = np.stack([turn(RADAR, (), still, sea, k, seed=1) for k in range(6)])
    sparse = np.stack([sparse_turn(RADAR, (), quiet, sea, k, seed=2).video for k in range(6)])
    for part in (np.s_[:, :, :60], np.s_[:, :, 60:150], np.s_[:, :60, 195:215], np.s_[:, 100:600, 150:]):
        a, b = np.count_nonzero(dense[part]), np.count_nonzero(sparse[part])
        assert a > 50
        assert abs(a - b) < 4.0 * np.sqrt(a + b) + 0.06 * a, part  # spikes of the sea come in clumps


@pytest.mark.parametrize("sparse", [True, False])
def test_labelled_cells_of_a_vessel_lie_within_its_hull_grown_by_beam_and_pulse(tmp_path: Path, sparse: bool) -> None:
    scene = small(tmp_path, sparse=sparse)
    radar, seen = scene.radar, set()
    for k, heard in enumerate(turns(scene, 4, seed=1)):
        spoke, cell = np.divmod(heard.cells, radar.cells)
        assert np.all(heard.video[spoke, cell] > 0)
        assert np.all(np.diff(heard.cells) > 0)
        for i, mover in enumerate(movers(radar, scene.vessel)):
            mine = heard.owners == i
            seen |= {i} if mine.any() else set()
            outline_m = mover.hull_m(mover.course.at(radar.times_s(k)[spoke[mine]]))
            range_m = np.hypot(outline_m[..., 0], outline_m[..., 1])
            assert np.all(radar.edges_m[cell[mine] + 1] >= range_m.min(axis=1, initial=9e9) - 1.1 * radar.pulse_m)
            assert np.all(radar.edges_m[cell[mine]] <= range_m.max(axis=1, initial=0.0) + 1.1 * radar.pulse_m)
            off_rad = wrap(
                np.arctan2(outline_m[..., 0], outline_m[..., 1]) - radar.azimuths_rad()[spoke[mine]][:, None]
            )
            reach_rad = BEAM_REACH * radar.beam_rad
            assert np.all((off_rad.min(axis=1, initial=9) < reach_rad) & (off_rad.max(axis=1, initial=-9) > -reach_rad))
        land = heard.owners == len(scene.vessel)
        place_m = radar.centres_m[cell[land]] * np.exp(1j * radar.azimuths_rad()[spoke[land]])
        rock = shapely.box(800, 800, 900, 900).buffer(60.0)
        assert land.any() and shapely.contains_xy(rock, place_m.imag, place_m.real).all()
    assert seen == {0, 1, 2}


def test_dense_and_sparse_turns_label_the_same_amount(tmp_path: Path) -> None:
    """Same fades, other speckle: per object within a few tenths."""

    def counts(sparse: bool) -> np.ndarray:
        found = [np.bincount(t.owners, minlength=4) for t in turns(small(tmp_path, sparse=sparse), 12, seed=1)]
        return np.sum(found, axis=0).astype(float)

    assert_allclose(counts(True), counts(False), rtol=0.15)


def test_the_labels_beside_a_recording_are_those_of_its_turns(tmp_path: Path) -> None:
    scene = small(tmp_path)
    said = simulate(scene, tmp_path / "rec.cat240", seed=1)
    read = read_labels(labels_path(tmp_path / "rec.cat240"))
    heard = list(turns(scene, 4, seed=1))
    assert said["labelled_cells"] == len(read.object) == sum(len(t.cells) for t in heard)
    assert_array_equal(read.spoke * scene.radar.cells + read.cell, np.concatenate([t.cells for t in heard]))
    assert_array_equal(read.scan, np.repeat(np.arange(4), [len(t.cells) for t in heard]))
    names = [*(v.id for v in scene.vessel), LAND_ID]
    assert list(read.object) == [names[i] for t in heard for i in t.owners]


def test_a_turn_without_labels_is_the_same_video(tmp_path: Path) -> None:
    scene = small(tmp_path)
    still, fleet = scenery(scene.radar, scene.land, scene.sea, seed=1), movers(scene.radar, scene.vessel)
    quiet = backdrop(scene.radar, still)
    both: list[tuple[Turn, Turn]] = [
        tuple(labelled_turn(scene.radar, fleet, still, scene.sea, 1, seed=1, labels=x) for x in (True, False)),
        tuple(sparse_turn(scene.radar, fleet, quiet, scene.sea, 1, seed=1, labels=x) for x in (True, False)),
    ]  # type: ignore[assignment]
    for with_labels, without in both:
        assert_array_equal(with_labels.video, without.video)
        assert len(with_labels.cells) > len(without.cells) == 0


def test_ais_tells_of_those_that_have_it_alone_and_where_they_are(tmp_path: Path) -> None:
    scene = small(tmp_path)
    simulate(scene, tmp_path / "rec.cat240", seed=1, scans=200)
    origin = Origin(scene.lat_deg, scene.lon_deg)
    reference = read_ais(ais_path(tmp_path / "rec.cat240").read_bytes(), name="ais", origin=origin).reference
    assert reference.damage == ()
    assert reference.ids == ("moored", "ship")
    assert reference.names == ("", "SHIP")
    assert_array_equal(reference.length_m, [40.0, 80.0])
    by_id = {v.id: v for v in scene.vessel}
    for i, id_ in enumerate(reference.ids):
        rows = slice(reference.start[i], reference.start[i + 1])
        since_s = reference.t_ns[rows] / 1e9 - scene.start_s
        state = by_id[id_].course().at(since_s)
        assert_allclose(reference.position_m[rows], state.position_m, atol=0.3)
        assert_allclose(reference.velocity_mps[rows], state.velocity_mps, atol=0.1)
        assert since_s[0] < 2.0 and since_s[-1] < 500.0
        assert_allclose(np.diff(since_s), 180.0 if id_ == "moored" else 6.0, atol=2e-3)


@pytest.mark.parametrize(("knots", "interval_s"), [(8.0, 10.0), (18.0, 6.0), (28.0, 2.0)])
def test_a_vessel_reports_the_more_often_the_faster_it_is(knots: float, interval_s: float) -> None:
    fast = Vessel(
        id="v", length_m=50, width_m=9, rcs_m2=1, waypoints_m=((0.0, 0.0), (0.0, 9e4)), speed_mps=knots * 1852 / 3600
    )
    assert_allclose(np.diff(report_times_s(fast.course(), 0.5, 600.0)), interval_s)


def test_a_vessel_that_departs_reports_soon_after() -> None:
    late = Vessel(
        id="v", length_m=50, width_m=9, rcs_m2=1, waypoints_m=((0.0, 0.0), (0.0, 9e4)), speed_mps=5.0, depart_s=200.0
    )
    times_s = report_times_s(late.course(), 0.0, 400.0)
    assert np.any((times_s >= 200.0) & (times_s < 205.0))
    assert_allclose(np.diff(times_s)[-5:], 10.0)


def test_equal_seeds_give_equal_octets_of_all_four_files(tmp_path: Path) -> None:
    scene = load_scene("far-field")
    for name in ("a", "b"):
        simulate(scene, tmp_path / f"{name}.cat240", seed=3, scans=2)
    simulate(scene, tmp_path / "c.cat240", seed=4, scans=2)
    for kind in ("cat240", "truth.json", "ais.csv", "labels.parquet"):
        a, b, c = ((tmp_path / f"{name}.{kind}").read_bytes() for name in "abc")
        assert a == b
        assert (a == c) == (kind in ("truth.json", "ais.csv"))
    assert sorted(p.suffix for p in tmp_path.iterdir() if ".partial" in p.name) == []


def test_empty_spokes_are_encoded_as_all_others(tmp_path: Path) -> None:
    """Field by field, over midnight and the end of the index."""
    scene = small(tmp_path)
    video = np.zeros((720, 200), dtype=np.uint8)
    video[[0, 7, 300]] = 99
    k = 2**32 // 720
    octets, at = encode_turn(scene.radar, video, k, start_s=scene.start_s), 0
    times_s = scene.start_s % 86400.0 + scene.radar.times_s(k)
    for j in range(720):
        expected = encode_video(
            sac=7, sic=9, idx=(k * 720 + j) % 2**32, start_az=round(j * 65536 / 720),
            end_az=round((j + 1) * 65536 / 720) % 65536, start_rg=0, cell_dur=66_712_819, cells=video[j],
            compress=True, tod=round(times_s[j] * 128) % (86400 * 128),
        )  # fmt: skip
        assert octets[at : at + len(expected)] == expected, j
        at += len(expected)
    assert at == len(octets)


def test_the_far_field_hears_its_vessels_where_they_are() -> None:
    """Labelled cells of each ship about the bearing and range at which the beam passes it."""
    scene = load_scene("far-field")
    radar, fleet = scene.radar, movers(scene.radar, scene.vessel)
    quiet = backdrop(radar, scenery(radar, scene.land, scene.sea, seed=1))
    heard: set[int] = set()
    for k in (0, 500, 1000, 1439):
        seen = sparse_turn(radar, fleet, quiet, scene.sea, k, seed=1)
        spoke, cell = np.divmod(seen.cells, radar.cells)
        for i in np.unique(seen.owners):
            mine, v = seen.owners == i, scene.vessel[i]
            state = fleet[i].course.at(radar.times_s(k)[spoke[mine]]).position_m
            off_m = radar.centres_m[cell[mine]] - np.hypot(state[:, 0], state[:, 1])
            off_rad = wrap(TWO_PI * (spoke[mine] + 0.5) / radar.spokes - np.arctan2(state[:, 0], state[:, 1]))
            assert np.all(np.abs(off_m) < 0.5 * v.length_m + radar.pulse_m)
            assert np.all(np.abs(off_rad) < 0.5 * v.length_m / 20_000.0 + BEAM_REACH * radar.beam_rad)
            heard.add(int(i))
    assert len(heard) >= 16


def test_sparse_noise_without_a_threshold_and_a_vessel_called_land_are_errors(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="sparse_noise"):
        dataclasses.replace(RADAR, threshold=0)
    path = tmp_path / "bad.toml"
    path.write_text(SCENE.format(sparse="true").replace('id = "moored"', 'id = "land"'), "utf-8")
    with pytest.raises(ConfigError, match="called 'land'"):
        load_scene(path)
