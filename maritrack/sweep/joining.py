"""The segments of a recording joined into one archive and one summary, as of a run in one piece."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from maritrack.chain import build_chain, reported
from maritrack.detect.cells import empty_points
from maritrack.errors import InputError, told
from maritrack.io.archive import Stored, assemble_scan, iter_messages, read_archive
from maritrack.io.messages import (
    OUTPUTS,
    decode_log,
    decode_scores,
    decode_tracks,
    decode_truth,
    encode_log,
    encode_scores,
    encode_tracks,
)
from maritrack.job import MCAP, SUMMARY
from maritrack.metrics.scores import ScoreSums, score_frame
from maritrack.run import Tally, summarise
from maritrack.settings import Config
from maritrack.sinks.mcap import McapSink
from maritrack.sinks.summary import write_summary
from maritrack.sweep.plan import Run
from maritrack.sweep.seams import Names, Piece, Seam, kept, pieces_of, seams
from maritrack.sweep.segments import Segment, damage_of, read_report
from maritrack.sweep.work import CHANGED, input_changed
from maritrack.types import COASTED, CONFIRMED, TENTATIVE, Damage, Event, Frame, Result, Tracks, take

NAMED = re.compile(r"track (\d+) ")  # the beginning of a line of the log about a track


@dataclass(frozen=True, slots=True, kw_only=True)
class Join:
    """Segments that have all been run, to be joined by a worker."""

    run: Run
    run_id: str  # of the joined run
    joined: str  # how, in a line
    segments: tuple[Segment, ...]
    folder: str  # of the segments
    out: str  # folder of the joined run


def join(job: Join) -> Mapping[str, Any] | str:
    """Write archive and summary of the joined run; the summary, or why that failed."""
    try:
        if input_changed(job.run):
            shutil.rmtree(job.folder)  # of either input
            return CHANGED
        return _join(job)
    except Exception as error:  # whatever it is, the rest goes on
        return told(error)


def _join(job: Join) -> Mapping[str, Any]:
    folder, out, config = Path(job.folder), Path(job.out), job.run.config
    assert config is not None
    out.mkdir(parents=True, exist_ok=True)
    pieces = pieces_of(folder, job.segments)
    found, names = seams(pieces)
    first = read_archive(pieces[0].archive)
    manifest = replace(first.manifest, run_id=job.run_id, joined=job.joined, recording=Path(job.run.source.name).stem)
    sink = McapSink(
        out / MCAP,
        full=False,
        side=first.side,
        chunk_scans=config.output.chunk_scans,
        points=config.output.archive_points,
    )
    reports = [
        report for one in job.segments for on in (False, True)
        if (report := read_report(folder, one.number, on=on)) is not None
    ]  # fmt: skip
    tally = Tally(ScoreSums(), config.score.hold_m)
    for damage in damage_of(reports):
        _note(tally, damage)
    sink.open(manifest)
    try:
        for piece, own in zip(pieces, names, strict=True):
            for parts in _scans(piece):
                named = _named(parts, own, config)
                sink.copy(parts[0].k, parts[0].t_ns, [(message.topic, message.data) for message in named])
                result = _result(named)
                tally.add(result, reported(result.tracks, config))
        summary = summarise(tally, build_chain(config), manifest, sum(r["timing"]["total_s"] for r in reports), False)
        scans = sum(r["scans"] for r in reports)
        stages = [name for name in summary["timing"] if name != "total_s"]
        for name in stages:  # of all scans that were worked on, those of the overlaps included
            summary["timing"][name] = sum(r["timing"][name] * r["scans"] for r in reports) / max(tally.frames, 1)
        summary["segments"] = _told(job, pieces, found) | {"scans_with_overlaps": scans}
        sink.close(summary)
    except BaseException:
        sink.abort()
        raise
    summary["outputs"] = {"mcap": str(out / MCAP), "summary": str(out / SUMMARY)}
    write_summary(out / SUMMARY, summary)
    return summary


def _note(tally: Tally, damage: Damage) -> None:
    tally.note(damage)
    key = f"{damage.sensor or '-'}:{damage.code}"
    tally.damage_sensor[key] = tally.damage_sensor.get(key, 0) + damage.count


def _scans(piece: Piece) -> Iterator[list[Stored]]:
    """The messages of each scan that counts."""
    parts: list[Stored] = []
    for message in iter_messages(piece.archive, OUTPUTS):
        if message.k >= piece.end:
            break
        if parts and message.k != parts[0].k:
            yield parts
            parts = []
        if message.k >= piece.begin:
            parts.append(message)
    if parts:
        yield parts


def _named(parts: Sequence[Stored], names: Names, config: Config) -> list[Stored]:
    """The messages of a scan with the ids of the whole run: of tracks, and of the log about them.

    A track that was confirmed before the seam is so behind it, though its segment is not sure yet; then the scores of
    the scan are made anew.
    """
    result = [_log_named(message, names) for message in parts]
    at = {message.topic: i for i, message in enumerate(parts)}
    own = decode_tracks(parts[at["/tracks"]].data)
    tracks = renamed(own, names)
    result[at["/tracks"]] = parts[at["/tracks"]]._replace(data=encode_tracks(tracks))
    if np.count_nonzero(own.status == TENTATIVE) > np.count_nonzero(tracks.status == TENTATIVE):
        message = parts[at["/scores"]]
        scores = decode_scores(message.data)
        truth = decode_truth(parts[at["/truth"]].data) if "/truth" in at else None
        anew = score_frame(
            truth, tracks, which=reported(tracks, config), c_m=config.score.c_m, p=config.score.p,
            unexplained="gospa_unexplained" in scores, velocity=config.score.velocity,
            bow_share=config.score.bow_share,
        )  # fmt: skip
        result[at["/scores"]] = message._replace(data=encode_scores(scores | anew))
    return result


def _log_named(message: Stored, names: Names) -> Stored:
    """A line of the log about a track, with its id in the whole run."""
    if message.topic != "/log":
        return message
    event = decode_log(message.data)
    about = NAMED.match(event.message) if event.stage == "track" else None
    if about is None:
        return message
    line = f"track {names.of(int(about[1])) or about[1]} {event.message[about.end() :]}"
    return message._replace(data=encode_log(Event(event.level, event.stage, line), t_ns=message.t_ns))


def renamed(tracks: Tracks, names: Names) -> Tracks:
    """The tracks with their ids in the whole run, ordered by them; those confirmed before are confirmed."""
    ids = np.array([names.of(i) for i in tracks.id.tolist()], np.int64)
    sure = (tracks.status == TENTATIVE) & np.isin(ids, np.fromiter(names.held, np.int64, len(names.held)))
    status = np.where(sure, np.where(tracks.cluster >= 0, CONFIRMED, COASTED), tracks.status)
    order = np.argsort(ids, kind="stable")
    contours = tuple(tracks.contour_m[i] for i in order.tolist()) if tracks.contour_m else ()
    return replace(take(replace(tracks, id=ids, status=status), order), contour_m=contours)


def _result(parts: Sequence[Stored]) -> Result:
    """What a scan's messages say, for the sums of the summary."""

    def refuse(damage: Damage) -> None:
        raise InputError(f"a segment is damaged: {damage.message}")

    scan = next(assemble_scan(parts, refuse))
    points, keep = scan.points, scan.keep
    if points is None or keep is None:
        points, keep = empty_points(), np.zeros(0, bool)
    frame = Frame(scan.k, scan.scan, scan.truth)
    return Result(frame, points, keep, scan.clusters, scan.tracks, scan.scores, scan.events, {})


def _told(job: Join, pieces: Sequence[Piece], found: Sequence[Seam]) -> dict[str, Any]:
    alive, same = kept(found)
    behind = [piece for piece in pieces[1:] if not piece.goes_on]
    starts = [segment.begin for segment in job.segments]
    return {
        "joined": job.joined,
        "tracks_at_seams": alive,
        "tracks_kept": same,
        "run_again": len(starts) - 1 - len(found),  # segments in which no scan agreed for long enough
        "seams": [
            {"scan": s.scan, "run_on": s.scan - max(start for start in starts if start <= s.scan), "agreed": b.agreed,
             "tracks": s.before, "kept": s.joined, "ended": s.ended, "begun": s.begun, "apart_m": s.apart_m}
            for s, b in zip(found, behind, strict=True)
        ],
    }  # fmt: skip
