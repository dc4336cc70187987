"""Many recordings: short ones as runs of a sweep, long ones in segments that are joined.

segments/<run id>/   archives of the segments of runs that are not joined yet
runs/<run id>/       archive and summary of joined runs, and of all where they are kept
"""

from __future__ import annotations

import hashlib
import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from maritrack.errors import InputError
from maritrack.fanout import fan_out
from maritrack.job import only_one
from maritrack.manifest import code_digest
from maritrack.sweep import drive
from maritrack.sweep.drive import Outcome, Tick
from maritrack.sweep.joining import Join, join
from maritrack.sweep.places import Index, index
from maritrack.sweep.plan import Run
from maritrack.sweep.segments import Segment, Task, forget_damaged, overlap_of, paths, read_report, run_segment, split
from maritrack.sweep.store import ROWS, RUNS, read_row, write_row, write_table
from maritrack.sweep.work import KILLED, Done, failed, results, row_of

SEGMENTS = "segments"
LEAST_OCTETS = 8 << 20  # smaller recordings are not looked at: they are run sooner than split


@dataclass(frozen=True, slots=True, kw_only=True)
class Cut:
    """How long recordings are split."""

    segment_s: float
    overlap_s: float = -1.0  # negative = by the memories of the settings
    run_on_s: float = math.inf  # behind its end, at most; 0 = the next counts from its beginning, whatever it tells

    def overlap_of(self, run: Run) -> float:
        return self.overlap_s if self.overlap_s >= 0 else overlap_of(run)


@dataclass(frozen=True, slots=True)
class Long:
    """A recording that is split."""

    run: Run  # its id is that of the joined run
    segments: tuple[Segment, ...]
    joined: str
    run_on_s: float


def batch(
    runs: Sequence[Run], out: Path, cut: Cut, *, sizes: Mapping[str, int], workers: int = 1, scheduler: str = "",
    keep: bool = False, retry: bool = False, tick: Tick | None = None,
) -> Outcome:  # fmt: skip
    """Run what is not finished in the folder; `sizes` (octets by name of input) say which may be long.

    The folder must be seen by the workers under the same path. A segment that is finished is not run again.
    """
    candidates = [run for run in runs if not run.error and sizes.get(run.source.name, 0) >= LEAST_OCTETS]
    indices = dict(fan_out(index, candidates, workers=workers, scheduler=scheduler))
    long = {run.run_id: found for i, run in enumerate(candidates) if (found := _long(run, indices[i], cut)) is not None}
    steps = len(runs) + sum(2 * len(one.segments) - 1 for one in long.values())
    short = drive.sweep(
        [run for run in runs if run.run_id not in long], out, workers=workers, scheduler=scheduler, keep=keep,
        retry=retry, tick=None if tick is None else lambda done, bad, _: tick(done, bad, steps),
    )  # fmt: skip
    todo = [one for one in long.values() if retry or read_row(out, one.run.run_id) is None]
    try:
        with only_one(out):
            _run_long(todo, out, workers, scheduler, _ticker(tick, len(short.rows), len(short.failed), steps))
            order = [long[run.run_id].run.run_id if run.run_id in long else run.run_id for run in runs]
            rows = [row for run_id in order if (row := read_row(out, run_id)) is not None]
            return Outcome(rows, short.reused + len(long) - len(todo), write_table(out, rows) if rows else {})
    except OSError as error:
        raise InputError(f"{error.filename or out}: {error.strerror or error}") from error


def _long(run: Run, found: Index | str, cut: Cut) -> Long | None:
    """How a run is split; None where it is not, or where reading it will tell what is wrong."""
    if isinstance(found, str):
        return None
    overlap_s = cut.overlap_of(run)
    segments = split(found, segment_s=cut.segment_s, overlap_s=overlap_s)
    if len(segments) < 2:
        return None
    most = "until the next tells the same" if math.isinf(cut.run_on_s) else f"for {cut.run_on_s:g} s at most"
    joined = f"{len(segments)} segments with overlaps of {overlap_s:g} s, run on {most}"
    run_id = hashlib.sha256(f"{run.run_id} {joined}".encode()).hexdigest()
    return Long(replace(run, run_id=run_id), tuple(segments), joined, cut.run_on_s)


def _run_long(todo: Sequence[Long], out: Path, workers: int, scheduler: str, step: Callable[[int, int], None]) -> None:
    """Run the segments of all recordings, whatever the order, then each on until the next tells the same, then join."""
    (out / ROWS).mkdir(parents=True, exist_ok=True)
    for one in todo:
        forget_damaged(_folder(out, one), one.segments)
    code, errors = code_digest(), dict[str, str]()
    tasks = [
        Task(run=one.run, segment=segment, folder=str(_folder(out, one)), code_sha256=code)
        for one in todo for segment in one.segments if read_report(_folder(out, one), segment.number) is None
    ]  # fmt: skip
    step(sum(len(one.segments) for one in todo) - len(tasks), 0)
    seen = set[tuple[str, int]]()
    while tasks := tasks or [
        task for one in todo if one.run.run_id not in errors for task in _due(one, _folder(out, one), code)
    ]:
        for number, failure in fan_out(run_segment, tasks, workers=workers, scheduler=scheduler, lost=lambda _: KILLED):
            task = tasks[number]
            if error := failure or _unseen(task):
                errors.setdefault(task.run.run_id, error)
            if not task.state or (task.run.run_id, task.segment.number) not in seen:  # not when it is run on anew
                step(1, 0)
                seen |= {(task.run.run_id, task.segment.number)} if task.state else set()
        tasks = []
    for one in todo:
        step(len(one.segments) - 1 - sum(run_id == one.run.run_id for run_id, _ in seen), 0)
        if one.run.run_id in errors:
            write_row(out, failed(one.run, errors[one.run.run_id]))
            step(1, 1)
    _join_all([one for one in todo if one.run.run_id not in errors], out, workers, scheduler, step)


def _unseen(task: Task) -> str:
    """Why nothing is to be had of a segment that a worker has run; "" where it is there."""
    if read_report(Path(task.folder), task.segment.number, on=bool(task.state)) is not None:
        return ""
    return f"{task.folder}: what a worker wrote is not there; all must see this folder under the same path"


def _due(one: Long, folder: Path, code: str) -> list[Task]:
    """Which segments are to be run on, from which memory: of the segment, or of what was run on through all of it.

    Where it is not known yet whether the latter comes, the former is taken, so that all may be run at once; but once
    only, so that what was in vain is no more than one run of each.
    """
    due, state, settled = list[Task](), paths(folder, one.segments[0].number).state, True
    for segment in one.segments[1:] if one.run_on_s > 0 else ():
        report = read_report(folder, segment.number, on=True)
        done = settled and report is not None and report["state"] == state.name
        if not done and (settled or report is None):
            due.append(Task(run=one.run, segment=segment, folder=str(folder), code_sha256=code, state=str(state),
                            run_on_s=one.run_on_s))  # fmt: skip
        through, settled = done and report is not None and report["end"] == segment.end, done
        state = paths(folder, segment.number, on=through).state
    return due


def _join_all(
    whole: Sequence[Long], out: Path, workers: int, scheduler: str, step: Callable[[int, int], None]
) -> None:  # fmt: skip
    """Join the segments of each recording, and write its row."""
    joins = [
        Join(run=one.run, run_id=one.run.run_id, joined=one.joined, segments=one.segments,
             folder=str(_folder(out, one)), out=str((out / RUNS / one.run.run_id[:16]).resolve()))
        for one in whole
    ]  # fmt: skip
    for number, summary in fan_out(join, joins, workers=workers, scheduler=scheduler, lost=lambda _: KILLED):
        one = whole[number]
        if isinstance(summary, str):
            write_row(out, failed(one.run, summary))
        else:
            seams = {name: summary["segments"][name] for name in ("tracks_at_seams", "tracks_kept")}
            row = row_of(one.run) | results(summary)
            row["counts"] |= {"segments": len(one.segments), **seams}
            write_row(out, Done(row, summary["timing"]))
            shutil.rmtree(_folder(out, one))
        step(1, int(isinstance(summary, str)))


def _folder(out: Path, one: Long) -> Path:
    return (out / SEGMENTS / one.run.run_id[:16]).resolve()


def _ticker(tick: Tick | None, done: int, bad: int, of: int) -> Callable[[int, int], None]:
    """Count on from what is done."""
    state = [done, bad]

    def step(more: int, worse: int) -> None:
        state[0], state[1] = state[0] + more, state[1] + worse
        if tick is not None:
            tick(state[0], state[1], of)

    return step
