"""A sweep from its plan to its table: what is finished stays, the rest runs, the table holds all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from maritrack.errors import InputError
from maritrack.fanout import fan_out
from maritrack.job import only_one
from maritrack.sweep.plan import Run
from maritrack.sweep.store import ROWS, RUNS, read_row, write_row, write_table
from maritrack.sweep.work import Row, lost, pieces, work

Tick = Callable[[int, int, int], None]  # runs done, of these failed, of how many


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a sweep."""

    rows: Sequence[Row]  # in the order of the plan
    reused: int  # of these, finished before
    outputs: dict[str, str]

    @property
    def failed(self) -> list[Row]:
        return [row for row in self.rows if row["error"]]


def sweep(
    runs: Sequence[Run],
    out: Path,
    *,
    workers: int = 1,
    scheduler: str = "",
    keep: bool = False,
    retry: bool = False,
    tick: Tick | None = None,
) -> Outcome:
    """Run what is not finished in the folder, and write the table of all these runs.

    Rows are written as they come, so that a sweep that is killed goes on where it was. With `keep` each run leaves an
    archive, in a folder that the workers must see under the same path; `retry` runs again what failed.
    """
    try:
        (out / ROWS).mkdir(parents=True, exist_ok=True)
        with only_one(out):
            return _sweep(runs, out, workers, scheduler, keep, retry, tick)
    except OSError as error:
        raise InputError(f"{error.filename or out}: {error.strerror or error}") from error


def _sweep(
    runs: Sequence[Run], out: Path, workers: int, scheduler: str, keep: bool, retry: bool, tick: Tick | None
) -> Outcome:
    done: dict[str, bool] = {}  # by run: whether it failed; rows are left on the disk until the table is made
    for run in runs:
        old = read_row(out, run.run_id)
        lacks = keep and old is not None and not old["error"] and not (out / RUNS / run.run_id[:16]).is_dir()
        if old is not None and not lacks and not (retry and old["error"]):
            done[run.run_id] = bool(old["error"])
    reused, failed = len(done), sum(done.values())
    left = pieces([run for run in runs if run.run_id not in done], keep=str((out / RUNS).resolve()) if keep else "")
    if tick is not None:
        tick(reused, failed, len(runs))
    try:
        for _, answer in fan_out(work, left, workers=workers, scheduler=scheduler, lost=lost):
            for one in answer:
                write_row(out, one)
                done[one.row["run_id"]] = bool(one.row["error"])
                failed += bool(one.row["error"])
            if tick is not None:
                tick(len(done), failed, len(runs))
    finally:  # also of one that was interrupted: what is done is in the table
        found = [row for run in runs if (row := read_row(out, run.run_id)) is not None]
        outputs: dict[str, Any] = write_table(out, found) if found else {}
    return Outcome(found, reused, outputs)
