"""`maritrack show`: archives, folders, recordings, and what is neither."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.calling import call, spawn
from tests.cli.conftest import SCANS


def test_an_archive_shows_manifest_counts_channels_and_time(finished_run: Path) -> None:
    shown = spawn("show", finished_run, "--json").json
    assert shown["what"] == "archive" and shown["complete"] and shown["damage"] == []
    assert shown["tracker"] == "jipda" and shown["preset"] == "radar" and shown["scans"] == SCANS
    channels = {row["topic"]: row["messages"] for row in shown["channels"]}
    assert channels["/input/cat240"] >= SCANS and channels["/tracks"] == SCANS
    assert shown["from"].startswith("2026-05-12T06:30:0") and shown["duration_s"] == pytest.approx(2.5 * (SCANS - 1))
    assert call("show", finished_run / "run.mcap", "--json").json["run_id"] == shown["run_id"]


def test_a_recording_shows_sensor_period_and_cells(sample: Path) -> None:
    shown = call("show", sample, "--json").json
    assert shown["what"] == "recording" and shown["kind"] == "cat240" and shown["scans"] == 42 and shown["truth"] == 10
    (sensor,) = shown["sensors"]
    assert sensor["id"] == "7-42" and sensor["period_s"] == pytest.approx(2.5) and sensor["gaps"] == 0
    assert sensor["spokes_per_turn"] == 512 and sensor["cell_m"] == pytest.approx(10.0)
    assert sensor["range_m"] == pytest.approx(6000.0)


def test_a_gap_is_shown_where_turns_are_missing(sample: Path, tmp_path: Path) -> None:
    from maritrack.io.dump import dump_records

    starts = [row["offset"] - 3 for row in dump_records([sample.read_bytes()]) if row.get("type") == 2]
    octets = sample.read_bytes()
    cut = tmp_path / "cut.cat240"
    cut.write_bytes(octets[: starts[10 * 512]] + octets[starts[14 * 512] :])
    (sensor,) = call("show", cut, "--json").json["sensors"]
    assert sensor["scans"] == 38 and sensor["gaps"] == 1
    assert sensor["gap_list"][0]["seconds"] == pytest.approx(10.0, abs=0.1)  # without a spoke


def test_points_are_shown_by_sensor(tmp_path: Path) -> None:
    path = tmp_path / "points.json"
    scans = ", ".join(f'{{"time_s": {t}, "points": [[1.0, 2.0], [3.0, 4.0]]}}' for t in (100, 102, 104, 111))
    path.write_text(f'{{"format": "maritrack-points/1", "frame": "enu", "scans": [{scans}]}}')
    shown = call("show", path, "--json").json
    (sensor,) = shown["sensors"]
    assert shown["kind"] == "points" and sensor["points"] == 8 and sensor["gaps"] == 1
    assert shown["from"] == "00:01:40.000"


def test_people_get_tables(finished_run: Path, sample: Path) -> None:
    assert "/input/cat240" in call("show", finished_run).out
    assert "7-42" in call("show", sample).out


def test_damage_of_an_archive_is_shown(run: Path) -> None:
    archive = run / "run.mcap"
    octets = bytearray(archive.read_bytes())
    octets[len(octets) // 2] ^= 0xFF
    archive.write_bytes(octets)
    done = call("show", archive, "--json")
    assert done.code == 0 and done.json["damage"] and done.json["scans"] < SCANS


def test_no_picture_is_told_in_one_line(run: Path, sample: Path) -> None:
    (run / "run.rrd").unlink()
    for path in (run, sample):
        done = call("show", path, "--view")
        assert done.code == 2 and str(path) in done.error


def test_what_can_not_be_shown_is_told_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "empty").write_bytes(b"")
    (tmp_path / "picture.mcap").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(64))
    for path in (tmp_path / "empty", tmp_path / "picture.mcap", tmp_path / "nowhere", tmp_path):
        done = call("show", path)
        assert done.code == 2 and str(path) in done.error
