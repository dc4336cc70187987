"""What sweeps read: recordings by path and URL, scenes, and what changes while a sweep runs."""

from __future__ import annotations

import json
import os
import zlib
from pathlib import Path
from typing import Any

import pytest

from maritrack.errors import InputError
from maritrack.sweep import drive, plan, sources, work
from maritrack.sweep.batch import Cut, batch
from maritrack.sweep.plan import Settings, parse_axes
from maritrack.sweep.sources import Source, named
from tests.shared import ROOT
from tests.unit.test_sweep import FERRY, planned


def test_an_input_that_fails_for_no_reason_we_know_stops_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(source: Source) -> Any:
        if source.name == "b":
            raise zlib.error("as of a library")
        return sources.examine(source)

    monkeypatch.setattr(plan, "examine", broken)
    assert [run.error for run in planned("b", FERRY, grid=[])] == ["error: as of a library", ""]


@pytest.mark.parametrize("what", [FERRY.name, "autoferry13_groundTruth.json"])
def test_what_changes_after_the_plan_is_no_result_of_it(what: str, tmp_path: Path) -> None:
    for name in (FERRY.name, "autoferry13_groundTruth.json"):
        (tmp_path / name).write_bytes(FERRY.with_name(name).read_bytes())
    runs = planned(tmp_path / FERRY.name, grid=["tracker=sprt"])
    (tmp_path / what).write_bytes((tmp_path / what).read_bytes())  # another time, the same octets
    assert not drive.sweep(runs, tmp_path / "a").failed
    told = json.loads((tmp_path / what).read_text())
    (tmp_path / what).write_text(json.dumps(told[3:] if isinstance(told, list) else told))
    for keep in (False, True):
        (row,) = drive.sweep(runs, tmp_path / f"b{keep}", keep=keep).rows
        assert row["error"] == work.CHANGED and not row["metrics"]
    assert not list((tmp_path / "bTrue").glob("runs/*"))
    assert not drive.sweep(planned(tmp_path / FERRY.name, grid=["tracker=sprt"]), tmp_path / "a").failed


def test_a_long_recording_that_changes_leaves_neither_a_result_nor_segments(tmp_path: Path) -> None:
    recording, out = tmp_path / FERRY.name, tmp_path / "out"
    recording.write_bytes(FERRY.read_bytes())
    runs, sizes = planned(recording, grid=["tracker=sprt"], limit=0), {str(recording): 1 << 30}
    recording.write_text(json.dumps(json.loads(recording.read_text())[:-3]))
    cut = Cut(segment_s=60.0, overlap_s=5.0)
    assert [row["error"] for row in batch(runs, out, cut, sizes=sizes).rows] == [work.CHANGED]
    assert not list(out.glob("segments/*")) and not list(out.glob("runs/*"))
    recording.write_bytes(FERRY.read_bytes())
    (row,) = batch(runs, out, cut, sizes=sizes, retry=True).rows
    assert row["error"] == "" and row["counts"]["segments"] > 1


def test_a_folder_changes_with_its_files(tmp_path: Path) -> None:
    source, seen = Source(name=str(tmp_path)), list[str]()
    for name, octets in (("a.png", b"1"), ("a.png", b"12"), ("b.png", b"")):
        (tmp_path / name).write_bytes(octets)
        seen += [sources.stamp(source)]
        assert sources.stamp(source) == seen[-1]
    assert len(set(seen)) == 3


def test_a_scene_that_changes_after_the_plan_is_no_result_of_it(tmp_path: Path) -> None:
    scene = tmp_path / "s.toml"
    scene.write_bytes((ROOT / "maritrack" / "scenes" / "crossing-3d.toml").read_bytes())
    runs = planned(scene, grid=["tracker=engm-phd"], seeds=[1], scans=3)
    assert not drive.sweep(runs, tmp_path / "a").failed
    scene.write_text(scene.read_text() + "# another time, the same scene\n")
    assert not drive.sweep(runs, tmp_path / "b").failed
    scene.write_text(scene.read_text().replace("clutter_rate  = 10.0", "clutter_rate = 20.0"))
    (row,) = drive.sweep(runs, tmp_path / "c").failed
    assert row["error"] == work.CHANGED


def test_each_seed_is_another_noise_of_a_scene(tmp_path: Path) -> None:
    runs = planned("harbour", seeds=[1, 2], scans=2, grid=["tracker=sprt,jipda"], limit=0)
    assert [run.seed for run in runs] == [1, 1, 2, 2] and len(work.pieces(runs)) == 2
    points = [row["counts"]["points"] for row in drive.sweep(runs, tmp_path).rows]
    assert points[0] == points[1] != points[2] == points[3]
    again = planned("harbour", seeds=[2], scans=2, grid=["tracker=jipda"], limit=0)
    assert drive.sweep(again, tmp_path).reused == 1


@pytest.mark.parametrize(("scene", "preset"), [("four-ships", "extended"), ("crossing-3d", "engm")])
def test_scenes_of_points_are_swept_as_those_of_radars(scene: str, preset: str, tmp_path: Path) -> None:
    runs = plan.plan(
        named([scene], scans=25), axes=parse_axes([]), seeds=[1, 2], settings=Settings(preset=preset, over={})
    )  # fmt: skip
    rows = drive.sweep(runs, tmp_path).rows
    assert [row["error"] for row in rows] == ["", ""] and [row["metrics"]["n_truth"] > 0 for row in rows] == [
        True,
        True,
    ]
    assert rows[0]["counts"]["points"] != rows[1]["counts"]["points"]


def test_inputs_by_url_give_the_rows_of_files(tmp_path: Path) -> None:
    fsspec = pytest.importorskip("fsspec")
    for name in (FERRY.name, "autoferry13_groundTruth.json"):
        with fsspec.open(f"memory://bucket/{name}", "wb") as file:
            file.write(FERRY.with_name(name).read_bytes())
    rows = drive.sweep(planned(f"memory://bucket/{FERRY.name}"), tmp_path).rows
    assert {row["run_id"] for row in rows} == {run.run_id for run in planned(FERRY)}
    assert all(row["metrics"]["n_truth"] > 0 for row in rows)
    runs = planned(f"memory://bucket/{FERRY.name}", grid=["tracker=sprt"])
    with fsspec.open(f"memory://bucket/{FERRY.name}", "wb") as file:
        file.write(FERRY.read_bytes().replace(b'"sensorID":', b'"sensorID": '))
    assert [row["error"] for row in drive.sweep(runs, tmp_path / "changed").rows] == [work.CHANGED]
    with pytest.raises(InputError, match="no-such"):
        planned("memory://bucket/no-such.json")


def test_a_pipe_is_no_input_of_a_sweep(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="no file"):
        planned(tmp_path / "pipe")
