"""A long recording in segments: which turns a segment has, and the run of one of them.

A segment begins with an overlap before its first turn that counts, to learn most of what the run in one piece knew by
then: the background, the clutter, the tracks, and which tracks on land and at berths the background has taken and
ended. How long that takes is a matter of the memories in the settings (`overlap_of`). To learn the background alone
first does not do: without tracks nothing under way is spared, slow ships become background, and their tracks start
late. What is still not the same then is left to the segment before, which is run on behind its end, with the memory it
has there (`maritrack.sweep.runon`).
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from maritrack.chain import Chain, build_chain
from maritrack.errors import InputError, UsageError, told
from maritrack.manifest import code_digest, make_manifest
from maritrack.recording import Recording
from maritrack.run import run
from maritrack.sinks.mcap import McapSink
from maritrack.sinks.summary import json_octets
from maritrack.sweep.handover import read_state, state_octets
from maritrack.sweep.places import Index, Place, place_of, positioned
from maritrack.sweep.plan import Run
from maritrack.sweep.runon import AGREED, Keeper, told_by
from maritrack.sweep.sources import Opened, opened
from maritrack.types import Damage, Frame, RunManifest

FORGOTTEN = 3.0  # time constants after which a memory has forgotten what it did not see
TURN_S, CLUTTER_SCANS = 2.5, 20


@dataclass(frozen=True, slots=True)
class Segment:
    """Scans of a recording that are run together."""

    number: int
    start: Place  # where the overlap begins
    seam: Place  # first scan that counts
    end: int  # the scan after the last

    @property
    def first(self) -> int:
        return self.start.scan

    @property
    def begin(self) -> int:
        return self.seam.scan


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """A segment of a run, or the one before it run on behind its beginning, to be run by a worker."""

    run: Run
    segment: Segment
    folder: str  # as the workers see it
    code_sha256: str
    state: str = ""  # file of the memory that is gone on with; "" = the segment itself, without any
    run_on_s: float = math.inf  # at most


@dataclass(slots=True)
class _Log:
    """Damage of the scans that count, noted while frames pass."""

    damage: list[Damage] = field(default_factory=list)


def overlap_of(run: Run) -> float:
    """Seconds that a segment of this run needs before it counts; turns are taken for 2.5 s long.

    Three time constants of clutter and of the judgement of motion. With background subtraction three half-lives of it,
    and the time for which a track that it has taken is kept: by then what it took at the beginning has ended.
    """
    config = run.config
    if config is None:
        return 0.0
    map_s = config.clutter_map.memory_s if config.clutter_map.method != "none" else 0.0
    tracks_s = FORGOTTEN * max(CLUTTER_SCANS * TURN_S, config.tracker.moving_time_constant_s, map_s)
    rules = config.subtract
    if rules.method == "none":
        return tracks_s
    scans = rules.half_life_scans or math.log(0.5) / math.log(rules.learning_rate)
    return max(tracks_s, FORGOTTEN * (rules.half_life_s or TURN_S * scans) + config.tracker.stationary_s)


def split(found: Index, *, segment_s: float, overlap_s: float) -> list[Segment]:
    """Segments of equal length, at most `segment_s` or one scan each; one where the recording is no longer."""
    t = found.t_ns
    if len(t) == 0:
        return []
    span_s = float(t.max() - t[0]) * 1e-9
    n = max(1, math.ceil(min(span_s / segment_s - 1e-9, len(t))))
    at_ns = t[0] + np.rint(np.arange(n) * (span_s / n) * 1e9).astype(np.int64)
    ordered = np.maximum.accumulate(t)  # a clock that steps back doesn't reorder scans
    begin = np.searchsorted(ordered, at_ns)
    first = np.searchsorted(ordered, np.maximum(at_ns - round(min(overlap_s, span_s) * 1e9), t[0]))
    end = np.append(begin[1:], len(t))
    rows = [i for i in range(n) if begin[i] < end[i]]
    return [
        Segment(number, place_of(found, int(first[i])), place_of(found, int(begin[i])), int(end[i]))
        for number, i in enumerate(rows)
    ]


class Paths(NamedTuple):
    """Where a part of a run is: archive, report, which is written last, and memory at its end."""

    archive: Path
    report: Path
    state: Path


def paths(folder: Path, number: int, *, on: bool = False) -> Paths:
    """Of a segment, or of the one before it run `on` behind its beginning."""
    stem = f"{number:04d}-on" if on else f"{number:04d}"
    return Paths(*(folder / f"{stem}.{kind}" for kind in ("mcap", "json", "state")))


def run_segment(task: Task) -> str:
    """Run a segment into its folder; "" or why that failed."""
    if task.code_sha256 != code_digest():
        raise UsageError("a worker has other code than this process", hint="install the same version on all machines")
    try:
        with opened(task.run.source, seed=task.run.seed) as found:
            return _run(task, found)
    except Exception as error:  # whatever it is, the rest goes on
        return told(error)


def _run(task: Task, found: Opened) -> str:
    """Run a segment, or the one before it on behind its beginning."""
    config, segment, log, on = task.run.config, task.segment, _Log(), bool(task.state)
    assert config is not None
    folder = Path(task.folder)
    folder.mkdir(parents=True, exist_ok=True)
    out, place = paths(folder, segment.number, on=on), segment.seam if on else segment.start
    recording, shift = positioned(task.run, found, place)
    reference = recording.reference
    stages = build_chain(config, unexplained=reference is not None and not reference.complete)
    keeper = _going_on(task, stages) if on else Keeper(begin=segment.begin)
    window = _window(recording.frames, place.scan, segment, log)
    end_ns = place.t_ns + max(1, round(task.run_on_s * 1e9)) if on and task.run_on_s < math.inf else math.inf
    frames = keeper.until(window, segment.end, end_ns)
    sink = McapSink(
        out.archive, full=False, side=found.side, chunk_scans=config.output.chunk_scans,
        points=config.output.archive_points,
    )  # fmt: skip
    manifest = manifest_of(task.run, found, recording)
    summary = run(frames, stages, [sink], manifest, reference=reference, step=keeper.step)
    if summary["interrupted"]:
        raise KeyboardInterrupt
    if (not on and keeper.end != segment.end) or keeper.state is None:
        raise InputError(f"{found.octets.name}: read otherwise than when it was split")
    told_damage = [asdict(damage) for damage in (*(recording.damage if segment.number == 0 else ()), *log.damage)]
    moved = [one | {"offset": one["offset"] + shift if one["offset"] >= 0 else -1} for one in told_damage]
    if keeper.end == segment.end:
        _replace(out.state, state_octets(keeper.state))
    report = {"damage": [] if on else moved, "timing": summary["timing"], "scans": summary["counts"]["scans"],
              "end": keeper.end, "agreed": keeper.agreed >= AGREED, "state": Path(task.state).name}  # fmt: skip
    written = [out.archive] + [out.state] * (keeper.end == segment.end)
    digests = {path.name: _sha256(path) for path in written}
    _replace(out.report, json_octets({**report, "sha256": {**digests, "": _sha256_of(report)}}))
    return ""


def _going_on(task: Task, stages: Chain) -> Keeper:
    """What goes on from a memory, beside the archive of the segment that is behind the seam."""
    state = read_state(Path(task.state).read_bytes(), stages, name=task.state)
    segment = task.segment
    other = told_by(paths(Path(task.folder), segment.number).archive, segment.begin)
    return Keeper(state, other, end=segment.begin)


def manifest_of(run_: Run, found: Opened, recording: Recording) -> RunManifest:
    """The manifest of the run in one piece."""
    assert run_.config is not None
    return make_manifest(
        run_.config, input_sha256=(run_.input_sha256,), input_kind=(found.kind,), side=found.side,
        origin=recording.origin, recording=Path(run_.source.name).stem,
    )  # fmt: skip


def _window(frames: Iterator[Frame], first: int, segment: Segment, log: _Log) -> Iterator[Frame]:
    """The frames of a segment from `first` on with their numbers in the recording; what was wrong is noted where it
    counts."""
    for k, frame in enumerate(frames, first):
        if k >= segment.end:
            return
        if k >= segment.begin:
            log.damage.extend(frame.damage)
        yield replace(frame, k=k, inputs=())


def read_report(folder: Path, number: int, *, on: bool = False) -> Mapping[str, Any] | None:
    """The report of a segment that has been run, None where it has not."""
    own = paths(folder, number, on=on)
    try:
        document = json.loads(own.report.read_bytes())
    except (OSError, ValueError):
        return None
    return document if isinstance(document, dict) and own.archive.is_file() else None


def forget_damaged(folder: Path, segments: Sequence[Segment]) -> None:
    """Take away the reports of what is no longer as it was written, so that it is run again."""
    for number, on in itertools.product((segment.number for segment in segments), (False, True)):
        report = read_report(folder, number, on=on)
        if report is not None and not _intact(folder, report):
            paths(folder, number, on=on).report.unlink()


def _intact(folder: Path, report: Mapping[str, Any]) -> bool:
    """Whether a report, and each file that it tells of, is what was written."""
    digests = report.get("sha256")
    if not isinstance(digests, dict) or digests.get("") != _sha256_of(report):
        return False
    try:
        return all(_sha256(folder / name) == digest for name, digest in digests.items() if name)
    except OSError:
        return False


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _sha256_of(report: Mapping[str, Any]) -> str:
    """Of a report, but for what it tells of digests."""
    own = {name: value for name, value in report.items() if name != "sha256"}
    return hashlib.sha256(json_octets(own)).hexdigest()


def damage_of(reports: Sequence[Mapping[str, Any]]) -> Iterator[Damage]:
    """What was wrong with the recording, in its order."""
    for report in reports:
        yield from (Damage(**one) for one in report["damage"])


def _replace(path: Path, octets: bytes) -> None:
    partial = path.with_name(path.name + ".partial")
    partial.write_bytes(octets)
    os.replace(partial, path)
