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

from maritrack.sweep import drive
from maritrack.sweep.plan import Run, Settings, parse_axes, plan
from maritrack.sweep.sources import named
from tests.shared import ROOT

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
    with log.open("wb") as file, subprocess.Popen(command, env=os.environ | QUICK, stdout=file, stderr=file) as process:
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


def planned(scheduler: str = "") -> list[Run]:
    axes = parse_axes(["tracker=sprt,jipda,ipda", "model.p_detect=0.6,0.7,0.8,0.9"])
    return plan(
        named([str(FERRY)]), axes=axes, seeds=(), settings=Settings(over={"input": {"limit": 150}}), scheduler=scheduler
    )


@pytest.mark.filterwarnings("default")  # of the cluster's own libraries
def test_a_worker_that_is_killed_loses_nothing(tmp_path: Path) -> None:
    with ExitStack() as stack:
        log = tmp_path / "scheduler.log"
        stack.enter_context(program("scheduler", *ALONE, "--port", "0", log=log))
        address = wait_for("Scheduler at:", log).split()[-1]
        logs = [tmp_path / f"worker-{i}.log" for i in range(2)]
        arguments = (address, *ALONE, *WORKER, "--local-directory", str(tmp_path))
        workers = [stack.enter_context(program("worker", *arguments, log=log)) for log in logs]
        for worker_log in logs:
            wait_for("Registered to", worker_log)
        done: list[int] = []

        def tick(n: int, _failed: int, _of: int) -> None:
            done.append(n)
            if len(done) == 3:
                workers[0].kill()

        found = drive.sweep(planned(address), tmp_path / "out", scheduler=address, tick=tick)
        assert workers[0].wait(PATIENCE_S) != 0 and workers[1].poll() is None
    assert done == list(range(1, 13)) and not found.failed and len(found.rows) == 12
    drive.sweep(planned(), tmp_path / "alone")
    assert {p.name: p.read_bytes() for p in (tmp_path / "out" / "rows").iterdir()} == {
        p.name: p.read_bytes() for p in (tmp_path / "alone" / "rows").iterdir()
    }
