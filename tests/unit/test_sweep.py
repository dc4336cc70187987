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

from maritrack.errors import UsageError
from maritrack.job import Job, execute, run_silently
from maritrack.manifest import file_digest
from maritrack.recording import kinds_of, open_inputs, side_documents
from maritrack.sweep import drive, plan, work
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


def test_objects_count_by_the_frames_in_which_they_were() -> None:
    objects = [
        {"frames": 30, "held": 30, "held_by_one": 1.0, "switches": 2},
        {"frames": 10, "held": 6, "held_by_one": 0.2, "switches": 1},
    ]
    counts = {"points": 5, "warnings": {"a": 2, "b": 1}}
    found = work.results({"metrics": {"gospa": 7.0}, "objects": objects, "counts": counts})
    assert found["metrics"] == {"gospa": 7.0, "held": 0.9, "held_by_one": 0.8, "switches": 3.0}
    assert found["counts"] == {"points": 5, "warnings": 3}
    assert work.results({"metrics": {}, "objects": [], "counts": counts})["metrics"] == {}


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


def test_settings_that_do_not_go_together_are_failed_rows(tmp_path: Path) -> None:
    grid = ["phd.birth_weight=0.05,0.01", "phd.prune_weight=0.001,0.02"]
    told: list[tuple[int, int, int]] = []
    found = drive.sweep(planned(FERRY, grid=grid, limit=2), tmp_path, tick=lambda *counts: told.append(counts))
    drive.sweep(planned(FERRY, grid=grid, limit=2), tmp_path, tick=lambda *counts: told.append(counts))
    assert told == [(0, 0, 4), (1, 0, 4), (2, 0, 4), (3, 0, 4), (4, 1, 4), (4, 1, 4)]
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


def test_archives_are_kept_where_asked_for(tmp_path: Path) -> None:
    runs = planned(FERRY, grid=["tracker=sprt"])
    drive.sweep(runs, tmp_path)
    found = drive.sweep(runs, tmp_path, keep=True)
    assert found.reused == 0 and (tmp_path / "runs" / runs[0].run_id[:16] / "run.mcap").is_file()
    assert drive.sweep(runs, tmp_path, keep=True).reused == 1


def test_a_worker_of_other_code_is_an_error() -> None:
    piece = work.pieces(planned(FERRY)[:1])[0]
    with pytest.raises(UsageError, match="other code"):
        work.work(replace(piece, code_sha256="0"))


def test_wrong_use_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    assert parse_seeds("0:3") == (0, 1, 2)
    assert (parse_seeds("0:7:3"), parse_seeds("4,2"), len(parse_seeds("0:100"))) == ((0, 3, 6), (2, 4), 100)
    for text in ("-1:2", "0.5", "x", "3:3", str(2**53 + 1)):
        with pytest.raises(UsageError):
            parse_seeds(text)
    with pytest.raises(UsageError, match="once"):
        parse_axes(["seed=1,2"])
    with pytest.raises(UsageError, match="one preset"):
        parse_axes(["preset=radar,points"])
    monkeypatch.setattr(plan, "MOST_RUNS", 7)
    with pytest.raises(UsageError, match="more than 7 runs"):
        planned(FERRY, seeds=[1, 2])
    with pytest.raises(UsageError, match="1000000 combinations"):
        planned(FERRY, grid=[f"{key}=0.001:1:0.001" for key in ("model.p_detect", "model.gate_probability")])
    with pytest.raises(UsageError, match="1 --truth for 2"):
        named(["a", "b"], truth=["t"])
    with pytest.raises(UsageError, match="--scans is of scenes, harbor is none"):
        named(["harbour", "harbor"], scans=3)
    assert named(["harbour"], scans=3) == (Source(name="harbour", scene=True, scans=3),)
