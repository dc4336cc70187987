"""`maritrack export`: files, standard output, wrong use."""

from __future__ import annotations

import csv
import json
from pathlib import Path

from tests.cli.calling import call, spawn


def test_tables_and_map_are_written(finished_run: Path, tmp_path: Path) -> None:
    names = ("tracks", "points", "clusters", "geojson")
    done = call("export", finished_run, *(part for name in names for part in (f"--{name}", tmp_path / name)))
    assert done.code == 0 and done.out == "" and str(tmp_path / "tracks") in done.err
    summary = json.loads((finished_run / "summary.json").read_text())["counts"]
    for name in ("tracks", "points", "clusters"):
        rows = list(csv.DictReader((tmp_path / name).read_text().splitlines()))
        assert len(rows) == summary[name] and rows[0]["sensor"] == "7-42"
    assert json.loads((tmp_path / "geojson").read_text())["type"] == "FeatureCollection"


def test_a_table_goes_to_standard_output_and_nothing_else(finished_run: Path) -> None:
    done = spawn("export", finished_run, "--tracks", "-")
    assert done.code == 0 and done.err == ""
    assert done.out.startswith("scan,time_s,sensor,track_id,status,moving,")


def test_moving_leaves_out_what_lies_still(finished_run: Path) -> None:
    everything, moving = (call("export", finished_run, "--tracks", "-", *more).out for more in ((), ("--moving",)))
    assert len(moving.splitlines()) < len(everything.splitlines())
    assert all(row["moving"] == "1" for row in csv.DictReader(moving.splitlines()))


def test_wrong_use_is_told_in_one_line(finished_run: Path, sample: Path, tmp_path: Path) -> None:
    assert "nothing to export" in call("export", finished_run).error
    assert call("export", finished_run, "--tracks", "-", "--points", "-").code == 2
    nowhere = tmp_path / "no" / "folder.csv"
    assert str(nowhere) in call("export", finished_run, "--tracks", nowhere).error
    for path in (sample, tmp_path / "nowhere.mcap", tmp_path):
        done = call("export", path, "--tracks", tmp_path / "tracks.csv")
        assert done.code == 2 and str(path) in done.error
    assert not list(tmp_path.iterdir())
