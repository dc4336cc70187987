"""Sweeps: ids from content, the same octets whoever runs what and when, resume, failures as rows."""

from __future__ import annotations

import json
import tomllib
import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from maritrack.errors import InputError, UsageError
from maritrack.job import Job, execute, run_silently
from maritrack.manifest import file_digest
from maritrack.recording import kinds_of, open_inputs, side_documents
from maritrack.sweep import drive, plan, sources, work
from maritrack.sweep.plan import Run, Settings, parse_axes, parse_seeds
from maritrack.sweep.sources import Source, named
from maritrack.sweep.store import read_table
from tests.shared import ROOT

FERRY = ROOT / "data" / "samples" / "autoferry13_detections.json"
GRID = ("tracker=sprt,jipda", "model.p_detect=0.7,0.9")


def planned(
    *names: Path | str, grid: Sequence[str] = GRID, seeds: Sequence[int] = (), scans: int = 0, limit: int = 5
) -> list[Run]:
    settings = Settings(over={"input": {"limit": limit}})
    return plan.plan(
        named([str(name) for name in names], scans=scans), axes=parse_axes(grid), seeds=seeds, settings=settings
    )


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (folder / "rows").iterdir()}


def untimed(folder: Path) -> list[dict[str, Any]]:
    return [{k: repr(v) for k, v in row.items() if not k.startswith("timing.")} for row in read_table(folder)]


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("swept")
    drive.sweep(planned(FERRY), folder)
    return folder


def test_a_row_says_what_process_says(swept: Path, tmp_path: Path) -> None:
    run = planned(FERRY)[2]
    assert run.config is not None and run.config.tracker_name == "jipda" and run.config.model.p_detect == 0.7
    octets = open_inputs([FERRY])
    side = side_documents([FERRY], truth=None, own_ship=None, sensors=None)
    job = Job(octets=octets, kinds=kinds_of(octets), input_sha256=[file_digest(FERRY)], side=side, config=run.config,
              name="a", out=tmp_path, rrd=False, mcap=False)  # fmt: skip
    summary, _ = execute(job)
    row = json.loads((swept / "rows" / f"{run.run_id}.json").read_text())
    assert summary["run_id"] == run.run_id
    assert {name: row["metrics"][name] for name in summary["metrics"]} == summary["metrics"]
    assert row["counts"]["points"] == summary["counts"]["points"] and row["metrics"]["held"] > 0


def test_neither_workers_nor_order_change_an_octet(swept: Path, tmp_path: Path) -> None:
    drive.sweep(planned(FERRY)[::-1], tmp_path / "b", workers=2)
    assert files(tmp_path / "b") == files(swept)
    drive.sweep(planned(FERRY), tmp_path / "b")  # nothing to run: the table in the order of this plan
    assert untimed(tmp_path / "b") == untimed(swept)


def test_what_is_finished_is_not_run_again(swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drive.sweep(planned(FERRY)[:3], tmp_path)
    (tmp_path / "rows" / "half.json.partial").write_bytes(b"{")
    ran: list[str] = []
    monkeypatch.setattr(drive, "work", lambda piece: ran.extend(r.run_id for r in piece.runs) or work.work(piece))
    told: list[tuple[int, int, int]] = []
    found = drive.sweep(planned(FERRY), tmp_path, tick=lambda *counts: told.append(counts))
    assert told == [(3, 0, 4), (4, 0, 4)]
    assert ran == [planned(FERRY)[3].run_id] and found.reused == 3
    assert untimed(tmp_path) == untimed(swept)


def test_a_sweep_that_is_interrupted_leaves_a_table_of_what_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def two(piece: work.Piece) -> list[work.Done]:
        if len(list((tmp_path / "rows").iterdir())) == 2:
            raise KeyboardInterrupt
        return work.work(piece)

    monkeypatch.setattr(drive, "work", two)
    with pytest.raises(KeyboardInterrupt):
        drive.sweep(planned(FERRY), tmp_path)
    assert len(read_table(tmp_path)) == 2


def test_a_run_that_fails_is_a_row_and_stops_nothing(tmp_path: Path) -> None:
    broken = tmp_path / "broken.json"
    broken.write_text("no recording")
    ends = tmp_path / "ends.json"
    ends.write_text(FERRY.read_text()[:-2000])
    found = drive.sweep(planned(broken, ends, FERRY, grid=["tracker=sprt"], limit=0), tmp_path / "out", workers=2)
    errors = [row["error"] for row in found.rows]
    assert "broken.json" in errors[0] and "ends.json" in errors[1] and errors[2] == ""
    assert [bool(row["error"]) for row in read_table(tmp_path / "out")] == [True, True, False]
    ends.write_bytes(FERRY.read_bytes())


def test_a_run_that_fails_for_no_reason_we_know_is_a_row_as_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(job: Job, sinks: Sequence[Any]) -> Any:
        if job.config.tracker_name == "sprt":
            raise zlib.error("as of a library")
        return run_silently(job, sinks)

    monkeypatch.setattr(work, "run_silently", broken)
    rows = drive.sweep(planned(FERRY, grid=["tracker=sprt,jipda"], limit=2), tmp_path).rows
    assert [row["error"] for row in rows] == ["error: as of a library", ""]


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


def test_settings_that_do_not_go_together_are_failed_rows(tmp_path: Path) -> None:
    grid = ["phd.birth_weight=0.05,0.01", "phd.prune_weight=0.001,0.02"]
    found = drive.sweep(planned(FERRY, grid=grid, limit=2), tmp_path)
    assert [bool(row["error"]) for row in found.rows] == [False, False, False, True]
    assert "prune_weight" in found.failed[0]["error"] and found.failed[0]["values"]["phd.birth_weight"] == 0.01


def test_failed_runs_run_again_when_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = planned(FERRY, grid=["tracker=sprt"])
    monkeypatch.setattr(drive, "work", work.lost)
    assert drive.sweep(runs, tmp_path).failed
    monkeypatch.setattr(drive, "work", work.work)
    assert drive.sweep(runs, tmp_path).failed
    assert not drive.sweep(runs, tmp_path, retry=True).failed


@pytest.mark.parametrize("damage", [b"", b"[]", b'{"run_id": "%s"}', b"\0\xff"])
def test_a_row_that_was_damaged_is_run_again(tmp_path: Path, damage: bytes) -> None:
    runs = planned(FERRY, grid=["tracker=sprt,ipda"], limit=2)
    before = drive.sweep(runs, tmp_path).rows
    row = tmp_path / "rows" / f"{runs[0].run_id}.json"
    row.write_bytes(damage.replace(b"%s", runs[0].run_id.encode()))
    again = drive.sweep(runs, tmp_path)
    assert again.reused == 1 and list(again.rows) == list(before)


def test_a_table_has_each_setting_and_number_of_each_row(tmp_path: Path) -> None:
    broken = tmp_path / "broken.json"
    broken.write_text("no recording")
    runs = planned(broken, FERRY, grid=["tracker=sprt,ipda"], seeds=[1, 2], limit=2)
    rows = drive.sweep(runs, tmp_path / "out").rows
    table = read_table(tmp_path / "out")
    assert [row["run_id"] for row in table] == [run.run_id for run in runs] and len(table) == 5
    assert [row["seed"] for row in table] == [0, 1, 1, 2, 2]
    assert table[0]["gospa"] is None and "broken" in table[0]["error"] and table[0]["model.p_detect"] is None
    for told, flat in zip(rows[1:], table[1:], strict=True):
        config = tomllib.loads(told["config"])
        assert flat["model.p_detect"] == config["model"]["p_detect"] and flat["tracker"] == config["tracker_name"]
        assert flat["gospa"] == told["metrics"]["gospa"] and flat["counts.points"] == told["counts"]["points"]
        assert flat["timing.total_s"] > 0


def test_a_line_of_times_that_broke_off_takes_no_other_with_it(tmp_path: Path) -> None:
    runs = planned(FERRY, grid=["tracker=sprt,ipda"], limit=2)
    drive.sweep(runs[:1], tmp_path)
    times = tmp_path / "timings.jsonl"
    times.write_text(times.read_text() + '{"run_id": "')
    drive.sweep(runs, tmp_path)
    assert [row["timing.total_s"] > 0 for row in read_table(tmp_path)] == [True, True]


def test_a_configuration_that_was_damaged_is_run_again(tmp_path: Path) -> None:
    runs = planned(FERRY, grid=["tracker=sprt"], limit=2)
    before = drive.sweep(runs, tmp_path).rows
    row = tmp_path / "rows" / f"{runs[0].run_id}.json"
    row.write_text(json.dumps(json.loads(row.read_text()) | {"config": "= ="}))
    assert list(drive.sweep(runs, tmp_path).rows) == list(before)


def test_an_id_is_that_of_configuration_input_and_seed() -> None:
    ids = [run.run_id for run in planned(FERRY)]
    assert ids == [run.run_id for run in planned(FERRY)] and len(set(ids)) == 4
    assert set(ids).isdisjoint(run.run_id for run in planned(FERRY, seeds=[5]))
    assert set(ids).isdisjoint(run.run_id for run in planned(FERRY, limit=6))
    assert [run.run_id for run in planned(FERRY, FERRY)] == ids


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


def test_archives_are_kept_where_asked_for(tmp_path: Path) -> None:
    runs = planned(FERRY, grid=["tracker=sprt"])
    drive.sweep(runs, tmp_path)
    found = drive.sweep(runs, tmp_path, keep=True)
    assert found.reused == 0 and (tmp_path / "runs" / runs[0].run_id[:16] / "run.mcap").is_file()
    assert drive.sweep(runs, tmp_path, keep=True).reused == 1


def test_inputs_by_url_give_the_rows_of_files(swept: Path, tmp_path: Path) -> None:
    fsspec = pytest.importorskip("fsspec")
    for name in (FERRY.name, "autoferry13_groundTruth.json"):
        with fsspec.open(f"memory://bucket/{name}", "wb") as file:
            file.write(FERRY.with_name(name).read_bytes())
    rows = drive.sweep(planned(f"memory://bucket/{FERRY.name}"), tmp_path).rows
    assert {row["run_id"] for row in rows} == {path.stem for path in (swept / "rows").iterdir()}
    assert all(row["metrics"]["n_truth"] > 0 for row in rows)
    runs = planned(f"memory://bucket/{FERRY.name}", grid=["tracker=sprt"])
    with fsspec.open(f"memory://bucket/{FERRY.name}", "wb") as file:
        file.write(FERRY.read_bytes().replace(b'"sensorID":', b'"sensorID": '))
    assert [row["error"] for row in drive.sweep(runs, tmp_path / "changed").rows] == [work.CHANGED]
    with pytest.raises(InputError, match="no-such"):
        planned("memory://bucket/no-such.json")


def test_a_worker_of_other_code_is_an_error() -> None:
    piece = work.pieces(planned(FERRY)[:1])[0]
    with pytest.raises(UsageError, match="other code"):
        work.work(replace(piece, code_sha256="0"))


def test_wrong_use_is_told() -> None:
    assert parse_seeds("0:3") == (0, 1, 2)
    assert (parse_seeds("0:7:3"), parse_seeds("4,2"), len(parse_seeds("0:100"))) == ((0, 3, 6), (2, 4), 100)
    for text in ("-1:2", "0.5", "x", "3:3", str(2**53 + 1)):
        with pytest.raises(UsageError):
            parse_seeds(text)
    with pytest.raises(UsageError, match="once"):
        parse_axes(["seed=1,2"])
    with pytest.raises(UsageError, match="one preset"):
        parse_axes(["preset=radar,points"])
    with pytest.raises(UsageError, match="1000000 combinations"):
        planned(FERRY, grid=[f"{key}=0.001:1:0.001" for key in ("model.p_detect", "model.gate_probability")])
    with pytest.raises(UsageError, match="1 --truth for 2"):
        named(["a", "b"], truth=["t"])
    with pytest.raises(UsageError, match="--scans is of scenes, harbor is none"):
        named(["harbour", "harbor"], scans=3)
    assert named(["harbour"], scans=3) == (Source(name="harbour", scene=True, scans=3),)
