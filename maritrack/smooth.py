"""Offline tracks of an archived run: its tracks in hindsight, as an archive of their own.

The causal run's filtered states, truth, points and clusters come from its archive. The recording is read again
for its own octets, which the new archive holds as well, and for the picture; nothing is tracked anew.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from maritrack import retrospect
from maritrack.chain import Chain, ChainState, reported
from maritrack.detect.cells import empty_points
from maritrack.errors import InputError, UsageError
from maritrack.io.archive import ArchivedScan, iter_results
from maritrack.job import execute
from maritrack.metrics.background import background_scores
from maritrack.metrics.scores import score_frame
from maritrack.replay import Replay, prepare
from maritrack.run import Progress, Step
from maritrack.types import Damage, Event, Frame, Result, Tracks

MAY_CHANGE = ("smooth.", "score.")  # settings that do not change what the causal run was


def ready(
    path: Path, *, sets: Sequence[str] = (), inputs: Sequence[Path] = (), out: Path | None = None, rrd: bool = True,
    mcap: bool = True, force: bool = False,
) -> Replay:  # fmt: skip
    """An archived causal run that is ready to be smoothed; `sets` are of smooth.* and score.*."""
    for assignment in sets:
        if not assignment.strip().startswith(MAY_CHANGE):
            hint = "run again with `maritrack replay --set`, then smooth that run"
            raise UsageError(f"--set {assignment}: only smooth.* and score.* can change what is smoothed", hint=hint)
    return prepare(path, sets=sets, inputs=inputs, out=out, rrd=rrd, mcap=mcap, force=force)


def smooth(run: Replay, *, progress: Progress | None = None) -> tuple[dict[str, Any], bool]:
    """Write the offline tracks of a run; the summary, and whether they were there already.

    All its track rows are held in memory, some 400 octets each; everything else streams. Of an archive that breaks
    off the scans that are there are taken for all.
    """
    archive, job = run.archive, run.job
    if not archive.complete:
        window = replace(job.config.input, limit=archive.n_scans)
        job = replace(job, config=replace(job.config, input=window))
    told = iter_results(archive.path, on_damage=None if archive.complete else run.damage.append)
    history = retrospect.gather((scan.k, scan.tracks) for scan in told)
    offline = retrospect.hindsight(history, job.config)
    known: list[Damage] = []  # the first reading has told it
    again = iter_results(archive.path, on_damage=None if archive.complete else known.append)
    step = in_hindsight(again, offline.by_scan(), offline.rows(np.zeros(0, np.int64)).tracks)
    return execute(job, progress=progress, step=step, smoothed_from=archive.manifest.run_id)


def in_hindsight(archived: Iterator[ArchivedScan], tracks: Mapping[int, Tracks], none: Tracks) -> Step:
    """What makes a result of each frame: points and clusters as archived, these tracks by scan (`none` else)."""

    def step(chain: Chain, state: ChainState, frame: Frame) -> tuple[ChainState, Result]:
        scan = next(archived, None)
        if scan is None or (scan.k, scan.t_ns) != (frame.k, frame.t_ns):
            raise InputError(f"scan {frame.k}: the recording is read otherwise than when it was archived")
        return told(chain, state, frame, scan, tracks.get(scan.k, none))

    return step


def told(
    chain: Chain, state: ChainState, frame: Frame, scan: ArchivedScan, tracks: Tracks
) -> tuple[ChainState, Result]:
    """The result of a frame with tracks in hindsight."""
    settings = chain.config.score
    scores = score_frame(
        frame.truth, tracks, c_m=settings.c_m, p=settings.p, which=reported(tracks, chain.config),
        unexplained=chain.unexplained, velocity=settings.velocity, bow_share=settings.bow_share,
    )  # fmt: skip
    clusters, points, keep = scan.clusters, scan.points, scan.keep
    if points is None or keep is None:  # the run did not archive them
        points, keep = empty_points(), np.zeros(0, bool)
        clusters = replace(clusters, label=np.zeros(0, np.int64))
    elif chain.config.subtract.method != "none":
        scores |= background_scores(points, keep, frame.truth, margin_m=settings.box_margin_m)
    alive = tuple(tracks.id.tolist())
    before, now = set(state.alive), set(alive)
    events = [Event("info", "track", f"track {i} begins") for i in alive if i not in before]
    events += [Event("info", "track", f"track {i} has ended") for i in state.alive if i not in now]
    result = Result(frame, points, keep, clusters, tracks, scores, tuple(events), {})
    return ChainState(state.tracker, alive), result
