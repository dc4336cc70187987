"""`maritrack calibrate`, and what `process --calibration` makes of it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from maritrack.io.archive import read_archive
from tests.cli.calling import call
from tests.shared import shared

AZIMUTH, RANGE, LATENCY = 2.3, 35.0, 1.5  # what the radar is off by
WRONG = (
    "--set", f"input.azimuth_offset_deg={-AZIMUTH}", "--set", f"input.range_offset_m={-RANGE}", "--set",
    f"input.latency_s={-LATENCY}",
)  # fmt: skip
PLACE = "47.7350,-3.5550"


def offsets(sensor: dict[str, float]) -> list[tuple[float, float]]:
    """What it is off by and how sure that is."""
    return [
        (sensor["azimuth_offset_deg"], sensor["azimuth_sigma_deg"]),
        (sensor["range_offset_m"], sensor["range_sigma_m"]),
        (sensor["latency_s"], sensor["latency_sigma_s"]),
    ]  # fmt: skip


@pytest.fixture(scope="module")
def calibration(sample: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, object]]:
    """Of the sample, read with wrong settings that it has to find out."""
    file = tmp_path_factory.mktemp("calibration") / "c.toml"
    done = call("calibrate", sample, *WRONG, "--json", "-o", file)
    assert done.code == 0, done.err
    return file, done.json


def test_what_a_simulated_radar_is_off_by_comes_out(calibration: tuple[Path, dict[str, object]]) -> None:
    """Its true offsets are none, and it was read with others: the settings that come out are the true ones."""
    _, found = calibration
    (sensor,) = found["sensors"]  # type: ignore[misc]
    assert sensor["key"] == "7-42" and found["against"] == "truth" and sensor["associations"] > 100
    for (value, sigma), most in zip(offsets(sensor), (0.2, 4.0, 1.5), strict=True):
        assert abs(value) < 3 * sigma and sigma < most
    assert not any(ship["late"] for ship in found["ships"])  # type: ignore[attr-defined]


def test_a_calibrated_run_is_that_of_a_radar_that_is_true(
    sample: Path, calibration: tuple[Path, dict[str, object]], tmp_path: Path
) -> None:
    short = ("--limit", "10", "--no-rrd", "-q", "--json")
    gospa = {}
    for name, more in (("true", ()), ("wrong", WRONG), ("calibrated", (*WRONG, "--calibration", calibration[0]))):
        done = call("process", sample, *more, *short, "-o", tmp_path / name)
        gospa[name] = done.json["metrics"]["ospa_localisation"]
    assert gospa["wrong"] > 1.5 * gospa["true"] and abs(gospa["calibrated"] - gospa["true"]) < 0.2 * gospa["true"]
    archive = read_archive(tmp_path / "calibrated" / "run.mcap")
    assert archive.side["calibration"] == calibration[0].read_bytes()
    assert call("replay", tmp_path / "calibrated", "--verify", "-q").code == 0


def test_two_radars_are_calibrated_against_each_other(sample: Path, tmp_path: Path) -> None:
    first, second = (Path(shutil.copy(sample, tmp_path / f"{name}.cat240")) for name in ("first", "second"))
    sensors = tmp_path / "sensors.toml"
    sensors.write_text(
        f"[sensors.second]\nazimuth_offset_deg = {-AZIMUTH}\nrange_offset_m = {-RANGE}\nlatency_s = {-LATENCY}\n"
    )
    done = call("calibrate", first, second, "--position", PLACE, "--sensors", sensors, "--json")
    assert done.code == 0, done.err
    (sensor,) = done.json["sensors"]
    assert done.json["against"] == "first" and sensor["key"] == "second" and done.json["ships"] == []
    for (value, sigma), most in zip(offsets(sensor), (0.3, 5.0, 2.0), strict=True):
        assert abs(value) < 3 * sigma and sigma < most


def test_lags_of_a_calibration_are_settings_of_the_metrics(sample: Path, tmp_path: Path) -> None:
    file = tmp_path / "c.toml"
    file.write_text('[sensors."7-42"]\nazimuth_offset_deg = 0.5\n[score]\ntruth_lag_s = "boat-1=7.5"\n')
    short = ("--limit", "10", "--no-rrd", "-q", "--json")
    with_lag = call("process", sample, "--calibration", file, *short, "-o", tmp_path / "a").json
    without = call("process", sample, "--azimuth-offset", "0.5", *short, "-o", tmp_path / "b").json
    assert 'truth_lag_s = "boat-1=7.5"' in read_archive(tmp_path / "a" / "run.mcap").config_toml
    assert with_lag["counts"]["tracks"] == without["counts"]["tracks"]
    assert with_lag["metrics"]["gospa_localisation"] != without["metrics"]["gospa_localisation"]


def test_a_calibration_of_a_sensor_that_is_not_in_the_run_is_warned_of(sample: Path, tmp_path: Path) -> None:
    file, points = tmp_path / "c.toml", tmp_path / "plots.json"
    file.write_text("".join(f'[sensors."{name}"]\nlatency_s = 1.0\n' for name in ("7-42", "9-99", "harbour", "a")))
    short = ("--calibration", file, "--no-rrd", "-q", "-o", tmp_path / "run")
    done = call("process", sample, "--limit", "2", *short)
    assert done.code == 0 and "the calibration of '9-99' was of no use: this run is of '7-42'" in done.out
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["warnings"]["calibration-unused"]["count"] == 2
    points.write_text('{"format": "maritrack-points/1", "frame": "enu", "scans": '
                      '[{"time_s": 1.0, "sensor": "a", "points": [[100.0, 200.0]]}]}')  # fmt: skip
    told = json.loads(call("process", points, "--json", *short).out)["warnings"]["calibration-unused"]
    assert told["count"] == 3 and told["message"].endswith("was of no use: this run is of 'a'")


def test_a_calibration_of_points_is_laid_over_the_sensor_that_it_is_of(tmp_path: Path) -> None:
    """The document calls its sensors a and b; a is off by what comes out, b is true."""
    t_s, scans, truth = np.arange(60) * 3.0, [], []
    for name, at, v in (
        ("x", (2000.0, 500.0), (-6.0, 4.0)),
        ("y", (-1500.0, 1000.0), (5.0, 5.0)),
        ("z", (300.0, -1800.0), (7.0, 1.0)),
    ):
        way = np.array(at) + t_s[:, None] * np.array(v)
        truth += [{"id": name, "time_s": t, "east_m": e, "north_m": n} for t, (e, n) in zip(t_s, way, strict=True)]
    for t in t_s.tolist():
        ships = np.array([[one["east_m"], one["north_m"]] for one in truth if one["time_s"] == t])
        polar = np.stack([np.hypot(*ships.T), np.degrees(np.arctan2(*ships.T)) % 360.0], axis=-1)
        scans += [{"time_s": t, "sensor": "a", "points": (polar - [RANGE, AZIMUTH]).tolist()}]
        scans += [{"time_s": t + 1.0, "sensor": "b", "points": []}]
    points, file = tmp_path / "plots.json", tmp_path / "c.toml"
    header = {"format": "maritrack-points/1", "frame": "polar", "sensors": {"a": {"sigma_m": 10.0}}}
    points.write_text(json.dumps({**header, "scans": scans, "truth": truth}))
    (sensor,) = call("calibrate", points, "--sensor", "a", "-o", file, "--json").json["sensors"]
    assert sensor["key"] == "a" and '[sensors."a"]' in file.read_text()
    assert abs(sensor["azimuth_offset_deg"] - AZIMUTH) < 0.05 and abs(sensor["range_offset_m"] - RANGE) < 3.0
    short = ("--no-rrd", "-q", "--json")
    wrong = call("process", points, *short, "-o", tmp_path / "wrong").json
    right = call("process", points, "--calibration", file, *short, "-o", tmp_path / "right").json
    assert "calibration-unused" not in right["warnings"]
    assert right["metrics"]["gospa"] < 0.3 * wrong["metrics"]["gospa"]
    assert call("replay", tmp_path / "right", "--verify", "-q").code == 0
    sensors = tmp_path / "sensors.toml"
    for name in ("plots", "a"):  # what holds for the input as a whole, or for the sensor, stays under its key
        sensors.write_text(f"[sensors.{name}]\nazimuth_offset_deg = 1.0\n")
        (again,) = call("calibrate", points, "--sensor", "a", "--sensors", sensors, "--json").json["sensors"]
        assert again["key"] == name and abs(again["azimuth_offset_deg"] - AZIMUTH) < 0.05


def test_what_cannot_be_calibrated_is_told_in_one_line(sample: Path, tmp_path: Path) -> None:
    alone = Path(shutil.copy(sample, tmp_path / "alone.cat240"))
    assert call("calibrate", alone, "-q").error == f"{alone}: no truth to compare with"
    done = call("calibrate", sample, "--limit", "3", "-q")
    assert done.code == 2 and done.error.startswith("7-42: no ship of the truth is under way within ")
    assert "--search-azimuth is within" in call("calibrate", sample, "--search-azimuth", "0").error
    missing = call("process", sample, "--calibration", tmp_path / "none.toml", "-q")
    assert missing.code == 2 and missing.error == f"{tmp_path / 'none.toml'}: No such file or directory"
    wrong = tmp_path / "wrong.toml"
    wrong.write_text('[sensors."7-42"]\nlat_deg = 3.0\n')
    assert "'lat_deg' is no result of a calibration" in call("process", sample, "--calibration", wrong, "-q").error


def test_people_read_a_table(sample: Path, tmp_path: Path) -> None:
    done = call("calibrate", sample, "-o", tmp_path / "c.toml", "-q")
    assert done.out.splitlines()[0] == "offsets to add, against truth (1 sigma)"
    assert "reports are late by (1 sigma)" in done.out and f"calibration: {tmp_path / 'c.toml'}" in done.out


def test_a_ship_radar_is_turned_one_way_in_one_recording_and_the_other_in_another(tmp_path: Path) -> None:
    """Plots of a real radar. Ships at anchor, which no clock moves, say the same as ships under way."""
    found = {}
    for run in ("01_004", "01_005"):
        folder = f"data/marce_solent/run_{run}"
        done = call("calibrate", shared(f"{folder}/detections.csv"), "--truth", shared(f"{folder}/ais_tracks.csv"),
                    "--json", "-q", "-o", tmp_path / f"{run}.toml")  # fmt: skip
        assert done.code == 0, done.err
        found[run] = done.json
    first, second = (found[run]["sensors"][0] for run in ("01_004", "01_005"))
    assert first["key"] == "radar" and abs(first["azimuth_offset_deg"] - 2.5) < 1.0
    assert abs(second["azimuth_offset_deg"] + 2.4) < 0.6
    ships = {ship["id"]: ship for ship in found["01_005"]["ships"]}
    assert ships["210574000"]["late"] and 30.0 < ships["210574000"]["lag_s"] < 60.0
    assert not ships["367168640"]["late"]
    assert json.dumps(f"210574000={ships['210574000']['lag_s']:.1f}") in (tmp_path / "01_005.toml").read_text()
