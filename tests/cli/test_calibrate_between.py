"""`maritrack calibrate` between two radars that look at the same hulls from two sides."""

from __future__ import annotations

from pathlib import Path

import pytest

from maritrack.simulate.record import simulate
from maritrack.simulate.scenes import load_scene
from tests.cli.calling import call
from tests.cli.test_calibrate import AZIMUTH, LATENCY, RANGE, offsets
from tests.unit.test_simulate_stations import RADAR, VESSEL

SHIPS = {  # id: length in m, speed in m/s and way; all go east, so that the west sees their sterns, the east their bows
    "long": (220.0, 3.0, "[[-700, 250], [1500, 200]]"), "tanker": (150.0, 2.5, "[[-500, -250], [1500, -200]]"),
    "coaster": (80.0, 3.0, "[[-400, -600], [1500, -500]]"), "ferry": (60.0, 4.0, "[[-700, 700], [900, 500]]"),
}  # fmt: skip


def record(folder: Path, ships: tuple[str, ...], scans: int, seed: int) -> tuple[Path, Path]:
    """Two recordings of these ships; beside them a file of sensors by which the second is off."""
    head = f'title = "two"\nstart = 2026-03-01T08:00:00Z\nlat_deg = 54.0\nlon_deg = 8.0\nscans = {scans}\n'
    radar = RADAR.replace("cells = 120", "cells = 280").replace("threshold = 90", "threshold = 110")
    text = head + radar.format(name="west", sic=1, place="east_m = -1100.0\nnorth_m = 40.0")
    text += radar.format(name="east", sic=2, place="east_m = 1150.0\nnorth_m = -60.0")
    for name in ships:
        length, speed, way = SHIPS[name]
        text += VESSEL.format(id=name, length=length, way=way, speed=speed)
    (folder / "two.toml").write_text(text, "utf-8")
    simulate(load_scene(folder / "two.toml"), folder / "rec.cat240", seed=seed, labels=False, ais=False)
    wrong = f"azimuth_offset_deg = {-AZIMUTH}\nrange_offset_m = {-RANGE}\nlatency_s = {-LATENCY}"
    told = (folder / "rec.sensors.toml").read_text("utf-8").replace('[sensors."1-2"]', f'[sensors."1-2"]\n{wrong}')
    (folder / "wrong.toml").write_text(told, "utf-8")
    return folder / "rec-west.cat240", folder / "rec-east.cat240"


@pytest.mark.parametrize("seed", [1, 2])
def test_offsets_between_radars_on_two_sides_of_hulls_come_out_within_their_uncertainty(
    seed: int, tmp_path: Path
) -> None:
    done = call("calibrate", *record(tmp_path, tuple(SHIPS), 110, seed), "--sensors", tmp_path / "wrong.toml", "--json")
    assert done.code == 0, done.err
    (sensor,) = done.json["sensors"]
    assert sensor["key"] == "1-2" and sensor["ships"] >= 3
    for (value, sigma), most in zip(offsets(sensor), (1.0, 30.0, 8.0), strict=True):
        assert abs(value) < 3 * sigma and sigma < most, offsets(sensor)


def test_two_ships_are_not_enough_between_radars(tmp_path: Path) -> None:
    paths = record(tmp_path, ("tanker", "ferry"), 80, 1)
    done = call("calibrate", *paths, "--sensors", tmp_path / "wrong.toml", "-q")
    assert done.code == 2 and "not enough ships" in done.error, done.error
