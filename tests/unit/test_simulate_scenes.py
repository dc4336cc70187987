"""Scenes load strictly, and a recording of one is the same each time and says what is true."""

from __future__ import annotations

import dataclasses
import json
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from maritrack.errors import ConfigError, InputError, UsageError
from maritrack.geo import C_MPS
from maritrack.simulate.record import simulate, truth_path
from maritrack.simulate.scenes import Scene, load_any, load_scene, scene_names

SAMPLES = Path(__file__).resolve().parents[2] / "data" / "samples"
SMALL = """
title = "small"
start = 2026-03-01T23:59:58Z
lat_deg = 54.0
lon_deg = 8.0
scans = 3
[radar]
sac = 7
sic = 9
turn_s = 2.5
spokes = 90
beam_deg = 4.0
cells = 100
cell_m = 10.0
pulse_m = 20.0
unit_range_m = 3000.0
floor_db = 0.0
full_db = 40.0
threshold = 60
[[vessel]]
id = "one"
length_m = 30.0
width_m = 8.0
rcs_m2 = 100.0
waypoints_m = [[300, 400], [300, -400]]
speed_mps = 10.0
[[vessel]]
id = "buoy"
length_m = 3.0
width_m = 3.0
rcs_m2 = 20.0
waypoints_m = [[-200, -200]]
"""


@pytest.fixture
def small(tmp_path: Path) -> Scene:
    path = tmp_path / "small.toml"
    path.write_text(SMALL, "utf-8")
    return load_scene(path)


def records(octets: bytes) -> list[dict[str, object]]:
    """The records of a recording as this package writes them, read by the letter of edition 1.3."""
    found, at = [], 0
    while at < len(octets):
        cat, length = struct.unpack_from(">BH", octets, at)
        f1, f2, sac, sic, kind, idx, start, end, first, dur, c, res, nb, high, low, rep = struct.unpack_from(
            ">BBBBBIHHIIBBHBHB", octets, at + 3
        )
        assert (cat, f1, kind, c & 0x80, res) == (240, 0xE7, 2, 0x80, 4)
        unit = {0xC8: 4, 0xA8: 64, 0x98: 256}[f2]
        body = octets[at + 32 : at + 32 + rep * unit]
        tod = int.from_bytes(octets[at + 32 + rep * unit : at + 35 + rep * unit], "big")
        cells = np.frombuffer(zlib.decompress(body[:nb]), np.uint8)
        assert len(cells) == (high << 16) + low
        assert length == 35 + rep * unit
        head = {"id": (sac, sic), "idx": idx, "start": start, "end": end, "first": first, "dur": dur}
        found.append(head | {"tod": tod, "cells": cells})
        at += length
    return found


def test_every_scene_of_the_package_loads() -> None:
    assert "harbour" in scene_names()
    for name in scene_names():
        scene = load_any(name)
        assert scene.title == name
        if isinstance(scene, Scene):
            assert load_scene(name) == scene and scene.vessel


def test_an_unknown_scene_is_an_error_that_lists_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="no scene 'harbor'") as caught:
        load_scene("harbor")
    assert "harbour" in caught.value.hint


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("turn_s = 2.5", "turns_s = 2.5", "unknown key 'radar.turns_s', did you mean 'turn_s'"),
        ("length_m = 3.0", "lenght_m = 3.0", "did you mean 'length_m'"),
        ("scans = 3", "scans = 0", "scans starts at 1"),
        ("scans = 3", 'scans = "many"', "not of type int"),
        ("23:59:58Z", "23:59:58", "has no time zone"),
        ("lat_deg = 54.0", "lat_deg = 540.0", "no such place"),
        ('id = "buoy"', 'id = "one"', "two vessels are called 'one'"),
        ("beam_deg = 4.0", "beam_deg = 0.0", "beam_deg must be greater than 0"),
        ("sac = 7", "sac = ", "small.toml"),
    ],
)
def test_a_scene_that_is_wrong_is_an_error_that_names_file_and_key(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    path = tmp_path / "small.toml"
    assert old in SMALL
    path.write_text(SMALL.replace(old, new), "utf-8")
    with pytest.raises(ConfigError, match=message) as caught:
        load_scene(path)
    assert "small.toml" in str(caught.value)


def test_a_missing_scene_file_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.toml"):
        load_scene(tmp_path / "none.toml")


def test_records_follow_the_turn_in_azimuth_time_and_index(small: Scene, tmp_path: Path) -> None:
    out = tmp_path / "rec.cat240"
    said = simulate(small, out, seed=1)
    found = records(out.read_bytes())
    assert said["records"] == len(found) == 270
    assert said["octets"] == out.stat().st_size
    assert [r["idx"] for r in found] == list(range(270))
    assert {r["id"] for r in found} == {(7, 9)}
    assert {r["dur"] for r in found} == {66_712_819}  # 10 m
    starts, ends = (np.array([r[key] for r in found]) for key in ("start", "end"))
    assert np.all(ends[:-1] == starts[1:])
    assert np.all((ends - starts) % 65536 > 0)
    ticks = np.array([r["tod"] for r in found])
    assert ticks[0] == round((86398.0 + 2.5 / 180) * 128)
    assert_allclose(np.unwrap(ticks, period=86400 * 128) - ticks[0], np.arange(270) * 2.5 / 90 * 128, atol=1.0)
    assert ticks.min() < 128  # midnight passed


def test_equal_seeds_give_equal_octets_and_shorter_runs_their_beginning(small: Scene, tmp_path: Path) -> None:
    a, b, c, d = (tmp_path / f"{name}.cat240" for name in "abcd")
    for path, seed, scans in ((a, 1, None), (b, 1, None), (c, 1, 2), (d, 2, None)):
        simulate(small, path, seed=seed, scans=scans)
    assert a.read_bytes() == b.read_bytes()
    assert truth_path(a).read_bytes() == truth_path(b).read_bytes()
    assert a.read_bytes()[: c.stat().st_size] == c.read_bytes()
    assert a.read_bytes() != d.read_bytes()


def test_truth_is_a_document_of_points_with_one_row_a_turn_for_each_object(small: Scene, tmp_path: Path) -> None:
    simulate(small, tmp_path / "rec.cat240", seed=1)
    document = json.loads((tmp_path / "rec.truth.json").read_text("utf-8"))
    assert (document["format"], document["frame"], document["scans"]) == ("maritrack-points/1", "enu", [])
    assert document["origin"] == {"lat_deg": 54.0, "lon_deg": 8.0}
    assert document["sensors"]["7-9"]["east_m"] == 0.0
    one = [row for row in document["truth"] if row["id"] == "one"]
    assert len(one) == 4  # three turns, and the pass after them
    for row in one:
        since_s = row["time_s"] - 1772409598.0  # 2026-03-01T23:59:58Z
        assert_allclose([row["east_m"], row["north_m"]], [300.0, 400.0 - 10.0 * since_s], atol=2e-3)
        assert_allclose(since_s % 2.5 / 2.5 * 360, np.degrees(np.arctan2(row["east_m"], row["north_m"])), atol=0.02)
        assert (row["vel_north_mps"], row["heading_deg"], row["length_m"]) == (-10.0, 180.0, 30.0)
    assert all(row["vel_east_mps"] == row["vel_north_mps"] == 0.0 for row in document["truth"] if row["id"] == "buoy")
    assert [row["time_s"] for row in document["truth"]] == sorted(row["time_s"] for row in document["truth"])


def test_truth_ends_where_the_radar_does(small: Scene, tmp_path: Path) -> None:
    short = dataclasses.replace(small, radar=dataclasses.replace(small.radar, cells=40))
    simulate(short, tmp_path / "rec.cat240", seed=1)
    ids = {row["id"] for row in json.loads((tmp_path / "rec.truth.json").read_text("utf-8"))["truth"]}
    assert ids == {"buoy"}


def test_an_interrupted_simulation_leaves_no_recording(small: Scene, tmp_path: Path) -> None:
    def stop(done: int, of: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(small, tmp_path / "rec.cat240", seed=1, progress=stop)
    assert not (tmp_path / "rec.cat240").exists()
    assert not (tmp_path / "rec.truth.json").exists()


def test_progress_counts_the_scans(small: Scene, tmp_path: Path) -> None:
    calls: list[tuple[int, int]] = []
    simulate(small, tmp_path / "rec.cat240", seed=1, scans=2, progress=lambda done, of: calls.append((done, of)))
    assert calls == [(1, 2), (2, 2)]


def test_impossible_requests_are_errors(small: Scene, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="scans"):
        simulate(small, tmp_path / "rec.cat240", seed=1, scans=0)
    with pytest.raises(UsageError, match="seed"):
        simulate(small, tmp_path / "rec.cat240", seed=-1)
    with pytest.raises(InputError, match="nowhere"):
        simulate(small, tmp_path / "nowhere" / "rec.cat240", seed=1)


def test_the_sample_is_what_the_scene_gives(tmp_path: Path) -> None:
    """Cells, not octets: another zlib may pack them differently, another libm may round a cell differently."""
    simulate(load_scene("harbour"), tmp_path / "harbour.cat240", seed=1, scans=2)
    again = records((tmp_path / "harbour.cat240").read_bytes())
    sample = records((SAMPLES / "harbour.cat240").read_bytes())
    assert len(again) == 2 * load_scene("harbour").radar.spokes
    differ = np.mean([np.mean(a["cells"] != b["cells"]) for a, b in zip(again, sample[: len(again)], strict=True)])
    assert differ < 1e-4
    truth = json.loads((SAMPLES / "harbour.truth.json").read_text("utf-8"))["truth"]
    assert {row["id"] for row in truth} == {v.id for v in load_scene("harbour").vessel}


def test_the_sample_shows_each_object_where_truth_says(tmp_path: Path) -> None:
    scene = load_scene("harbour")
    radar = scene.radar
    found = records((SAMPLES / "harbour.cat240").read_bytes())
    cells = np.array([r["cells"] for r in found]).reshape(-1, radar.spokes, radar.cells)
    truth = json.loads((SAMPLES / "harbour.truth.json").read_text("utf-8"))["truth"]
    seen: dict[str, list[bool]] = {v.id: [] for v in scene.vessel}
    for row in truth:
        turns = (row["time_s"] - scene.start_s) / radar.turn_s
        k, spoke = int(turns), int(turns % 1 * radar.spokes)
        if k == len(cells):  # the pass beyond the end
            continue
        cell = int(np.hypot(row["east_m"], row["north_m"]) / (found[0]["dur"] * 1e-15 * C_MPS / 2))  # type: ignore[operator]
        reach = 2 + int(row["length_m"] / 20)
        window = cells[k, (spoke + np.arange(-1, 2)) % radar.spokes, cell - reach : cell + reach]
        seen[row["id"]].append(bool(window.max() > 127))
    share = {name: np.mean(hits) for name, hits in seen.items()}
    assert all(share[name] > 0.95 for name in ("ferry", "container", "coaster")), share
    assert all(s > 0.6 for s in share.values()), share
    assert share["trawler"] < 0.9  # hidden behind the outer mole for a while
