"""A sweep over a real Dask cluster on loopback: a scheduler and two workers, one of which is killed in mid-sweep."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from maritrack.errors import UsageError
from maritrack.fanout import fan_out
from maritrack.sweep import drive
from maritrack.sweep.plan import Run, Settings, parse_axes, plan
from maritrack.sweep.sources import named
from tests.shared import ROOT
from tests.unit.test_fanout import fatal

pytest.importorskip("distributed", reason="no distributed: pip install 'maritrack[dask]'")
FERRY = ROOT / "data" / "samples" / "autoferry13_detections.json"
PATIENCE_S = 120
ALONE = ("--no-dashboard", "--host", "127.0.0.1")
WORKER = ("--nthreads", "1", "--no-nanny", "--death-timeout", "60")
QUICK = {"DASK_DISTRIBUTED__COMM__RETRY__COUNT": "0", "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}


@contextmanager
def program(name: str, *arguments: str, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A part of the cluster, which ends with the test."""
    command = (sys.executable, "-m", f"distributed.cli.dask_{name}", *arguments)
    with (
        log.open("wb") as file,
        subprocess.Popen(command, env=os.environ | QUICK, stdout=file, stderr=file, cwd=ROOT) as process,
    ):
        try:
            yield process
        finally:
            process.kill()


def wait_for(text: str, log: Path) -> str:
    """The line of a log that has this text, when it has come."""
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until:
        found = (
            [line for line in log.read_text("utf-8", "replace").splitlines() if text in line] if log.exists() else []
        )
        if found:
            return found[0]
        time.sleep(0.05)
    raise AssertionError(f"{text!r} has not come: {log.read_text() if log.exists() else 'no log'}")


def planned(scheduler: str = "", name: str = str(FERRY), folder: str = "") -> list[Run]:
    axes = parse_axes(["tracker=sprt,jipda,ipda", "model.p_detect=0.6,0.7,0.8,0.9"])
    return plan(
        named([name], folder=folder), axes=axes, seeds=(), settings=Settings(over={"input": {"limit": 150}}),
        scheduler=scheduler,
    )  # fmt: skip


@contextmanager
def cluster(folder: Path, n: int) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Address of a scheduler, and its process with those of n workers, who stand in another folder than the test."""
    with ExitStack() as stack:
        log = folder / "scheduler.log"
        scheduler = stack.enter_context(program("scheduler", *ALONE, "--port", "0", log=log))
        address = wait_for("Scheduler at:", log).split()[-1]
        logs = [folder / f"worker-{i}.log" for i in range(n)]
        arguments = (address, *ALONE, *WORKER, "--local-directory", str(folder))
        workers = [stack.enter_context(program("worker", *arguments, log=log)) for log in logs]
        for worker_log in logs:
            wait_for("Registered to", worker_log)
        yield address, [scheduler, *workers]


@pytest.mark.filterwarnings("default")  # of the cluster's own libraries
def test_a_worker_that_is_killed_loses_nothing(tmp_path: Path) -> None:
    with cluster(tmp_path, 2) as (address, (_, *workers)):
        done: list[int] = []

        def tick(n: int, _failed: int, _of: int) -> None:
            done.append(n)
            if n == 3:
                workers[0].kill()

        found = drive.sweep(planned(address), tmp_path / "out", scheduler=address, tick=tick)
        assert workers[0].wait(PATIENCE_S) != 0 and workers[1].poll() is None
    assert done == list(range(13)) and not found.failed and len(found.rows) == 12
    drive.sweep(planned(), tmp_path / "alone")
    assert {p.name: p.read_bytes() for p in (tmp_path / "out" / "rows").iterdir()} == {
        p.name: p.read_bytes() for p in (tmp_path / "alone" / "rows").iterdir()
    }


@pytest.mark.filterwarnings("default")
def test_relative_paths_are_of_who_asks_and_a_scheduler_that_ends_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "rec.json").write_bytes(FERRY.read_bytes())
    with cluster(tmp_path, 1) as (address, (scheduler, _)):
        monkeypatch.chdir(tmp_path)
        plain = planned("", "rec.json")
        runs = planned(address, "rec.json", folder=str(tmp_path))
        assert [run.run_id for run in runs] == [run.run_id for run in plain]

        def tick(n: int, _failed: int, _of: int) -> None:
            if n == 2:
                scheduler.kill()

        with pytest.raises(UsageError, match="lost"):
            drive.sweep(runs, Path("out"), scheduler=address, tick=tick)
        assert not [record for record in caplog.records if record.name == "distributed.client"]
    found = drive.sweep(plain, Path("out"))
    assert found.reused >= 2 and not found.failed and {row["input"] for row in found.rows} == {"rec.json"}


@pytest.mark.filterwarnings("default")
def test_a_piece_that_kills_its_workers_costs_itself_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES", "0")
    with cluster(tmp_path, 3) as (address, _):
        answers = dict(fan_out(fatal, [3, 1, 2, 4, 5, 6, 7, 8], scheduler=address, lost=lambda x: -x))
    assert answers == {0: -3, 1: 1, 2: 4, 3: 16, 4: 25, 5: 36, 6: 49, 7: 64}
