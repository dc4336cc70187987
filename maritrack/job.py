"""A run as people ask for it: an input, a configuration, a folder of outputs."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from maritrack.chain import Chain, build_chain, process
from maritrack.detect.snapshot import read_snapshot
from maritrack.errors import InputError, UsageError
from maritrack.io.source import Octets
from maritrack.manifest import make_manifest
from maritrack.recording import Recording, open_recording
from maritrack.run import Progress, Sink, Step, run
from maritrack.settings import Config
from maritrack.sinks.background import BackgroundSink
from maritrack.sinks.summary import write_summary
from maritrack.types import RunManifest

RRD, MCAP, SUMMARY = "run.rrd", "run.mcap", "summary.json"


@dataclass(frozen=True, kw_only=True)
class Job:
    """What is to be run, and what is to be written."""

    octets: Sequence[Octets]
    kinds: Sequence[str]
    input_sha256: Sequence[str]
    side: Mapping[str, bytes]
    config: Config
    name: str  # of the recording: for titles and the default folder
    out: Path | None = None  # None: runs/<name>-<tracker>-<id8>
    rrd: bool = True
    mcap: bool = True
    strict: bool = False
    workers: int = 1  # processes that inflate video; they change nothing but the time
    force: bool = False
    save_background: Path | None = None  # where to write what was learned of the background
    background_name: str = "background"  # what messages call the background among the side documents
    raster_px: int = field(default=1024)


def execute(
    job: Job, *, progress: Progress | None = None, step: Step = process, smoothed_from: str = ""
) -> tuple[dict[str, Any], bool]:
    """Run a job; its summary, and whether a finished equal run was found instead.

    `step` makes a result of each frame; with the id of the run in `smoothed_from` it takes that run's, in hindsight.
    """
    recording = open_recording(job.octets, job.kinds, job.side, job.config, strict=job.strict, workers=job.workers)
    manifest = make_manifest(
        job.config, input_sha256=job.input_sha256, input_kind=recording.kinds, side=job.side,
        origin=recording.origin, recording=job.name, smoothed_from=smoothed_from,
    )  # fmt: skip
    kind = "offline-" if smoothed_from else ""
    folder = job.out or Path("runs") / f"{_safe(job.name)}-{manifest.tracker}-{kind}{manifest.run_id[:8]}"
    again = job.force or job.save_background is not None
    if not again and all(job.input_sha256) and (old := finished(folder, manifest, job)) is not None:
        return old, True
    chain = _chain(job, recording)
    folder.mkdir(parents=True, exist_ok=True)
    with only_one(folder):
        keep = (folder / SUMMARY).exists()  # of a finished run: an interrupted one doesn't take its place
        try:
            summary = run(
                recording.frames, chain, _sinks(job, folder), manifest,
                reference=recording.reference, progress=progress, extra_damage=recording.damage,
                calibrated=recording.calibrated, keep_partial=keep, step=step,
            )  # fmt: skip
        except OSError as error:
            raise InputError(f"{error.filename or folder}: {error.strerror or error}") from error
        if summary["interrupted"] and keep:
            summary["outputs"] = {"partial": str(folder)}
            return summary, False
        unlink(folder, *(name for name, wanted in ((RRD, job.rrd), (MCAP, job.mcap)) if not wanted))
        names = [(name, folder / file) for name, file in (("rrd", RRD), ("mcap", MCAP)) if (folder / file).exists()]
        names += [("background", job.save_background)] if job.save_background is not None else []
        summary["outputs"] = {name: str(path) for name, path in names} | {"summary": str(folder / SUMMARY)}
        write_summary(folder / SUMMARY, summary)
    return summary, False


def run_silently(
    job: Job, sinks: Sequence[Sink], *, recording: Recording | None = None
) -> tuple[dict[str, Any], RunManifest]:
    """Run a job into given sinks, without a folder: replay, benchmarks, studies.

    `recording` is the job's own where it is open already.
    """
    if recording is None:
        recording = open_recording(job.octets, job.kinds, job.side, job.config, strict=job.strict, workers=job.workers)
    manifest = make_manifest(
        job.config, input_sha256=job.input_sha256, input_kind=recording.kinds, side=job.side,
        origin=recording.origin, recording=job.name,
    )  # fmt: skip
    chain = _chain(job, recording)
    summary = run(
        recording.frames, chain, sinks, manifest, reference=recording.reference, extra_damage=recording.damage,
        calibrated=recording.calibrated,
    )  # fmt: skip
    return summary, manifest


def finished(folder: Path, manifest: RunManifest, job: Job) -> dict[str, Any] | None:
    """The summary of a complete equal run with all wanted outputs in this folder, or None."""
    wanted = [SUMMARY] + [RRD] * job.rrd + [MCAP] * job.mcap
    if not all((folder / name).is_file() for name in wanted):
        return None
    try:
        summary = json.loads((folder / SUMMARY).read_text("utf-8"))
    except (OSError, ValueError):
        return None
    same = isinstance(summary, dict) and summary.get("run_id") == manifest.run_id and not summary.get("interrupted")
    return summary if same else None


def _chain(job: Job, recording: Recording) -> Chain:
    config, name = job.config, job.background_name
    reference, snapshot = recording.reference, recording.side.get("background")
    known = {}
    if snapshot is not None:
        if config.subtract.method == "none":
            raise UsageError(f"{name}: nothing is subtracted", hint="--set subtract.method=abs")
        known = read_snapshot(snapshot, config.subtract, recording.origin, name=name)
    return build_chain(config, unexplained=reference is not None and not reference.complete, background=known)


def _sinks(job: Job, folder: Path) -> list[Sink]:
    sinks: list[Sink] = []
    output = job.config.output
    if job.mcap:
        from maritrack.sinks.mcap import McapSink

        full = output.archive == "full"
        sinks.append(
            McapSink(
                folder / MCAP, full=full, side=job.side, chunk_scans=output.chunk_scans, points=output.archive_points
            )
        )
    if job.rrd:
        from maritrack.sinks.rerun import RerunSink  # a second of imports that other commands need not pay

        sinks.append(RerunSink(folder / RRD, flush_scans=output.chunk_scans, raster_px=job.raster_px))
    if job.save_background is not None:
        sinks.append(BackgroundSink(job.save_background, job.config.subtract))
    return sinks


@contextmanager
def only_one(folder: Path) -> Iterator[None]:
    """Hold the folder for one run at a time; the lock ends with the process, however it ends."""
    try:
        import fcntl
    except ImportError:  # not on this system: no lock
        yield
        return
    while True:
        with (folder / ".lock").open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                hint = "choose another folder with -o"
                raise UsageError(f"{folder}: another run is writing here", hint=hint) from None
            if os.fstat(lock.fileno()).st_nlink == 0:  # of a run that has just ended: who comes now opens another one
                continue
            try:
                yield
            finally:
                (folder / ".lock").unlink(missing_ok=True)
            return


def unlink(folder: Path, *names: str) -> None:
    """Remove files of an older run."""
    for name in names:
        (folder / name).unlink(missing_ok=True)


def _safe(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in name)[:60].strip(".") or "recording"
