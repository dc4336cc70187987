"""Trackers over a grid of settings: every combination runs on every recording, and the scores say which is best."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from maritrack.chain import build_chain, detect
from maritrack.config import load_config, merge
from maritrack.errors import ConfigError, UsageError, told
from maritrack.fanout import Tick, fan_out
from maritrack.job import Job, run_silently
from maritrack.metrics.scores import KEYS
from maritrack.recording import Recording, default_preset, kinds_of, open_inputs, open_recording, side_documents
from maritrack.settings import Config
from maritrack.tune.grids import combinations, nested
from maritrack.types import Frame

TRACKER = "tracker_name"
SMALLER_IS_BETTER = (*(key for key in KEYS if not key.startswith("n_")), "gospa_unexplained", "switches")
TOGETHER = 8  # combinations that share one reading of a recording


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """A recording with the documents beside it."""

    path: Path
    kind: str
    side: Mapping[str, bytes]


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """Runs of one recording with the same input and the same points: it is read once for all of them."""

    subject: Subject
    number: int  # of the recording
    runs: tuple[tuple[int, Config], ...]  # number of the combination, and its configuration


@dataclass(frozen=True, slots=True)
class Row:
    """A combination, and its scores as means over recordings (switches: their sum); or why there are none."""

    number: int  # in the order of the grid
    values: Mapping[str, Any]
    metrics: Mapping[str, float]
    by_recording: tuple[Mapping[str, float], ...]
    error: str = ""


def subjects(
    paths: Sequence[Path], *, truth: Sequence[Path] = (), own_ship: Sequence[Path] = ()
) -> tuple[Subject, ...]:
    """The recordings, all of one kind; `truth` and `own_ship` are none or one for each."""
    for name, given in (("--truth", truth), ("--own-ship", own_ship)):
        if given and len(given) != len(paths):
            raise UsageError(f"{len(given)} {name} for {len(paths)} recordings", hint="one for each, in their order")
    if any(str(path) == "-" for path in paths):
        raise UsageError("a study reads a recording more than once: no standard input")
    kinds = [kinds_of(open_inputs([path]))[0] for path in paths]
    default_preset(kinds)  # all of one kind, and recordings
    return tuple(
        Subject(
            path=path,
            kind=kind,
            side=side_documents(
                [path], truth=truth[i] if truth else None, own_ship=own_ship[i] if own_ship else None, sensors=None
            ),
        )
        for i, (path, kind) in enumerate(zip(paths, kinds, strict=True))
    )


def configurations(
    axes: Mapping[str, Sequence[Any]], *, preset: str, file: Path | None, sets: Sequence[str], over: Mapping[str, Any]
) -> list[tuple[dict[str, Any], Config | str]]:
    """Each combination of the grid with its configuration, or with why the settings do not go together.

    ConfigError for a key or a value that is wrong by itself.
    """

    def load(values: Mapping[str, Any]) -> Config:
        config = load_config(preset=preset, file=file, sets=sets, over=merge(over, nested(values)))
        build_chain(config)
        return config

    load({})
    grid = combinations(axes)
    for key, tried in axes.items():
        for value in tried:
            try:
                load({key: value})
            except ConfigError as error:
                option = f"--tracker {value}" if key == TRACKER else f"--grid {key}={value}"
                raise ConfigError(f"{option}: {error}", hint=error.hint) from None
    found: list[tuple[dict[str, Any], Config | str]] = []
    for values in grid:
        try:
            found.append((values, load(values)))
        except ConfigError as error:
            found.append((values, str(error)))
    return found


def study(
    of: Sequence[Subject],
    grid: Sequence[tuple[Mapping[str, Any], Config | str]],
    *,
    by: str,
    workers: int = 1,
    tick: Tick | None = None,
) -> list[Row]:
    """A row for each combination, the best first: smallest mean of the metric `by`; what failed comes last."""
    if by not in SMALLER_IS_BETTER:
        raise UsageError(f"--by {by}: no such metric", hint="metrics: " + ", ".join(SMALLER_IS_BETTER))
    configs = {i: config for i, (_, config) in enumerate(grid) if isinstance(config, Config)}
    for subject in of:
        _require_truth(subject, next(iter(configs.values()), None))
    pieces = [piece for i, subject in enumerate(of) for piece in _pieces(i, subject, configs, workers)]
    scores: dict[tuple[int, int], Mapping[str, float] | str] = {}
    for number, answer in fan_out(run_piece, pieces, workers=workers, tick=tick):
        scores |= {(i, pieces[number].number): found for i, found in answer}
    rows = [
        _row(i, values, config, [scores[i, j] for j in range(len(of)) if (i, j) in scores])
        for i, (values, config) in enumerate(grid)
    ]
    return sorted(rows, key=lambda row: (bool(row.error), _last(row.metrics.get(by, math.nan)), row.number))


def _last(value: float) -> float:
    return math.inf if math.isnan(value) else value


def _require_truth(subject: Subject, config: Config | None) -> None:
    """UsageError where nothing tells the truth of a recording."""
    if config is not None and "truth" not in subject.side:
        recording = open_recording(open_inputs([subject.path]), [subject.kind], subject.side, config)
        if recording.reference is None:
            raise UsageError(f"{subject.path}: no truth beside it", hint="pass it with --truth")


def _pieces(number: int, subject: Subject, configs: Mapping[int, Config], workers: int) -> Iterator[Piece]:
    """The runs of a recording, those that read it in the same way together."""
    alike: dict[Any, list[tuple[int, Config]]] = {}
    for i, config in configs.items():
        alike.setdefault((config.input, config.detect), []).append((i, config))
    for runs in alike.values():
        size = min(TOGETHER, math.ceil(len(runs) / max(workers, 1)))
        for at in range(0, len(runs), size):
            yield Piece(subject=subject, number=number, runs=tuple(runs[at : at + size]))


def run_piece(piece: Piece) -> list[tuple[int, Mapping[str, float] | str]]:
    """Number and scores of each run, or its error in a line."""
    try:
        prepared = _prepared(piece)
    except Exception as error:  # whatever it is, the rest goes on
        return [(i, told(error)) for i, _ in piece.runs]
    return [(i, _scores(piece.subject, config, prepared)) for i, config in piece.runs]


def _prepared(piece: Piece) -> tuple[Recording, tuple[Frame, ...]]:
    """The recording, and its frames with their points in place of their video."""
    subject, config = piece.subject, piece.runs[0][1]
    recording = open_recording(open_inputs([subject.path]), [subject.kind], subject.side, config)
    return recording, tuple(_without_video(frame, config) for frame in recording.frames)


def _without_video(frame: Frame, config: Config) -> Frame:
    """The frame with its points detected; of the video only the times and azimuths of the spokes are left."""
    scan, video = frame.scan, frame.scan.video
    if video is None:
        return replace(frame, inputs=())
    bare = replace(video, intensity=video.intensity[:, :0].copy())
    return replace(frame, scan=replace(scan, points=detect(scan, config), video=bare), inputs=())


def _scores(
    subject: Subject, config: Config, prepared: tuple[Recording, tuple[Frame, ...]]
) -> Mapping[str, float] | str:
    recording, frames = prepared
    job = Job(
        octets=(), kinds=(subject.kind,), input_sha256=("",), side=subject.side, config=config, name=subject.path.stem
    )
    try:
        summary, _ = run_silently(job, (), recording=replace(recording, frames=iter(frames)))
    except Exception as error:  # whatever it is, the rest goes on
        return told(error)
    if summary["interrupted"]:
        raise KeyboardInterrupt
    metrics: dict[str, float] = summary["metrics"]
    objects = summary["objects"]
    seen = sum(o["frames"] for o in objects)
    held = sum(o["held_by_one"] * o["frames"] for o in objects) / seen if seen else math.nan
    return metrics | {"switches": float(sum(o["switches"] for o in objects)), "held_by_one": held}


def _row(
    number: int, values: Mapping[str, Any], config: Config | str, scores: Sequence[Mapping[str, float] | str]
) -> Row:
    if isinstance(config, str):
        return Row(number, values, {}, (), config)
    errors = [told for told in scores if isinstance(told, str)]
    if errors:
        return Row(number, values, {}, (), errors[0])
    by_recording = tuple(told for told in scores if not isinstance(told, str))
    return Row(number, values, _mean(by_recording), by_recording)


def _mean(scores: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Mean over recordings of each score that all of them have; of switches the sum."""
    names = [name for name in scores[0] if all(name in other for other in scores)]
    return {
        name: sum(other[name] for other in scores) / (1 if name == "switches" else len(scores)) for name in names
    }  # fmt: skip


def table(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """The rows flat: values of the keys, metrics, error."""
    return [{**row.values, **row.metrics, "error": row.error} for row in rows]


def document(
    rows: Sequence[Row], axes: Mapping[str, Sequence[Any]], *, by: str, recordings: Sequence[str], preset: str
) -> dict[str, Any]:
    """The study as a document, the best row first."""
    told = [_document(row) for row in rows]
    best = [one for one, row in zip(told, rows, strict=True) if not math.isnan(row.metrics.get(by, math.nan))]
    return {
        "recordings": list(recordings),
        "preset": preset,
        "by": by,
        "grid": {key: list(values) for key, values in axes.items()},
        "best": best[0] if best else None,
        "rows": told,
    }


def _document(row: Row) -> dict[str, Any]:
    return {
        "values": dict(row.values),
        "metrics": dict(row.metrics) or None,
        "by_recording": [dict(scores) for scores in row.by_recording],
        "error": row.error or None,
    }
