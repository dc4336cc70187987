"""`maritrack replay`: the same again, something else, and archives that are not whole."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from tests.cli.calling import call, spawn
from tests.cli.conftest import SCANS


def test_a_replay_makes_the_same_octets(finished_run: Path) -> None:
    done = spawn("replay", finished_run, "--verify", "--json")
    assert done.code == 0
    assert done.json["equal"] and done.json["scans"] == SCANS and done.json["messages"] >= 5 * SCANS


def test_a_replayed_archive_is_that_of_the_run_octet_by_octet(finished_run: Path, tmp_path: Path) -> None:
    assert call("replay", finished_run, "-o", tmp_path, "--no-rrd", "-q").code == 0
    assert (tmp_path / "run.mcap").read_bytes() == (finished_run / "run.mcap").read_bytes()


def test_other_settings_make_another_run(finished_run: Path, tmp_path: Path) -> None:
    done = call("replay", finished_run, "--set", "model.p_detect=0.5", "-o", tmp_path, "--no-rrd", "--json", "-q")
    old = json.loads((finished_run / "summary.json").read_text())
    assert done.code == 0 and done.json["run_id"] != old["run_id"]
    assert done.json["counts"]["points"] == old["counts"]["points"]
    assert done.json["counts"]["tracks"] != old["counts"]["tracks"]


def test_an_archive_of_another_run_does_not_verify(finished_run: Path, run: Path) -> None:
    archive = run / "run.mcap"
    octets = archive.read_bytes()
    at = octets.index(b"p_detect = 0.85")
    archive.write_bytes(octets[:at] + b"p_detect = 0.35" + octets[at + 15 :])
    done = call("replay", archive, "--verify", "-q")
    assert done.code in (1, 2)  # 2: the configuration's own digest told it before
    assert call("replay", finished_run, "--verify", "-q").code == 0


def test_the_first_difference_is_told_in_one_line(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from maritrack.settings import Config
    from maritrack.trackers import TRACKERS, jipda

    def nervous(config: Config) -> jipda.Jipda:
        from dataclasses import replace

        return jipda.Jipda(replace(config, model=replace(config.model, p_detect=0.5)))

    monkeypatch.setitem(TRACKERS, "jipda", nervous)
    done = call("replay", run, "--verify", "-q")
    assert done.code == 1
    assert done.out.startswith("different: scan ") and len(done.out.splitlines()) == 1


def test_verify_takes_no_other_settings(run: Path) -> None:
    assert call("replay", run, "--verify", "--set", "model.p_detect=0.5").code == 2


def test_an_archive_without_octets_asks_for_the_recording(sample: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    arguments = ("process", sample, "--limit", "2", "-o", folder, "--no-rrd", "-q", "--set", "output.archive='hash'")
    assert call(*arguments).code == 0
    done = call("replay", folder, "--verify", "-q")
    assert done.code == 2 and "digest" in done.error and "--input" in done.err
    assert call("replay", folder, "--verify", "--input", sample, "-q").code == 0
    other = tmp_path / "other.cat240"
    other.write_bytes(sample.read_bytes()[:-1])
    done = call("replay", folder, "--verify", "--input", other, "-q")
    assert done.code == 2 and str(other) in done.error and "SHA-256" in done.error


def test_settings_by_the_name_of_a_file_are_replayed_without_the_file(sample: Path, tmp_path: Path) -> None:
    sensors = tmp_path / "sensors.toml"
    sensors.write_text("[sensors.harbour]\nazimuth_offset_deg = 3.0\n")
    arguments = ("process", sample, "--limit", "2", "--sensors", sensors, "-o", tmp_path / "run", "--no-rrd", "-q")
    assert call(*arguments).code == 0
    assert call("replay", tmp_path / "run", "--verify", "-q").code == 0


def test_a_replay_does_not_write_over_the_archive_that_it_reads(run: Path) -> None:
    done = call("replay", run, "-o", run, "--force")
    assert done.code == 2 and str(run) in done.error


def test_a_cut_archive_is_replayed_as_far_as_it_goes(run: Path, tmp_path: Path) -> None:
    octets = (run / "run.mcap").read_bytes()
    cut = tmp_path / "run.mcap.partial"
    cut.write_bytes(octets[:-100])
    done = call("replay", cut, "-o", tmp_path / "out", "--no-rrd", "--json")
    assert done.code == 0 and done.json["counts"]["scans"] == SCANS and "note: " in done.err


def test_what_is_no_archive_is_told_in_one_line(sample: Path, tmp_path: Path) -> None:
    empty = tmp_path / "run.mcap"
    empty.write_bytes(b"")
    for path in (sample, empty, tmp_path / "nowhere.mcap", tmp_path / "nowhere"):
        done = call("replay", path)
        assert done.code == 2 and str(path) in done.error
    (tmp_path / "folder").mkdir()
    assert "no run.mcap" in call("replay", tmp_path / "folder").error


def test_a_sensor_that_goes_by_a_file_name_with_dots_is_found_again(sample: Path, tmp_path: Path) -> None:
    recording, sensors = Path(shutil.copy(sample, tmp_path / "port.a.cat240")), tmp_path / "sensors.toml"
    sensors.write_text('[sensors."port.a"]\nazimuth_offset_deg = 5.0\n')
    told = ("--sensors", sensors, "--limit", "2", "--no-rrd", "-q", "-o", tmp_path / "run")
    assert call("process", recording, *told).code == 0
    assert call("replay", tmp_path / "run", "--verify", "-q").code == 0
