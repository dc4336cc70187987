"""A piece of a sweep: runs that read one input, each with a row of what came of it, or of why nothing came."""

from __future__ import annotations

import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from maritrack.config import to_toml
from maritrack.errors import UsageError, told
from maritrack.job import Job, execute, run_silently
from maritrack.manifest import code_digest
from maritrack.settings import Config
from maritrack.sweep.plan import Run, digest_of
from maritrack.sweep.sources import Opened, Source, examine, opened, stamp

TOGETHER = 8  # runs that share one simulation of a scene
CHANGED = "the input, or a document beside it, is not what it was when the sweep began"
KILLED = "its process was killed, or ran out of memory"
Row = dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """Runs of one input and one seed; of a recording a single one."""

    source: Source
    seed: int
    runs: tuple[Run, ...]
    code_sha256: str  # of the code that planned them
    keep: str = ""  # folder for the archives of runs, as the workers see it; "" = none


@dataclass(frozen=True, slots=True)
class Done:
    """A finished run: its row, and CPU times, which no two runs have in common."""

    row: Row
    timing: Mapping[str, float]


def pieces(runs: Sequence[Run], *, keep: str = "") -> list[Piece]:
    """The runs as pieces of work, in their order."""
    code = code_digest()
    alike: dict[Any, list[Run]] = {}
    for run in runs:
        alike.setdefault((run.source, run.seed) if run.source.scene else run.run_id, []).append(run)
    return [
        Piece(source=group[0].source, seed=group[0].seed, runs=tuple(group[at : at + TOGETHER]), code_sha256=code,
              keep=keep)
        for group in alike.values() for at in range(0, len(group), TOGETHER)
    ]  # fmt: skip


def work(piece: Piece) -> list[Done]:
    """Run a piece. What fails is a row with its error; UsageError where this code is not that of the plan."""
    if piece.code_sha256 != code_digest():
        raise UsageError("a worker has other code than this process", hint="install the same version on all machines")
    able = [run for run in piece.runs if not run.error]
    if not able:
        return [failed(run, run.error) for run in piece.runs]
    try:
        with opened(piece.source, seed=piece.seed) as found:
            return [_run(run, found, piece.keep) for run in piece.runs]
    except Exception as error:  # whatever it is, the rest goes on
        return [failed(run, run.error or told(error)) for run in piece.runs]


def lost(piece: Piece) -> list[Done]:
    """The rows of a piece that nobody could finish."""
    return [failed(run, run.error or KILLED) for run in piece.runs]


def failed(run: Run, error: str) -> Done:
    """The row of a run that came to nothing."""
    return Done(row_of(run) | {"metrics": {}, "counts": {}, "error": error}, {})


def _run(run: Run, found: Opened, keep: str) -> Done:
    if run.config is None:
        return failed(run, run.error)
    job = Job(
        octets=(found.octets,), kinds=(found.kind,), input_sha256=(run.input_sha256,), side=found.side,
        config=run.config, name=Path(run.source.name).stem, out=Path(keep) / run.run_id[:16] if keep else None,
        rrd=False,
    )  # fmt: skip
    try:
        summary, _ = execute(job) if keep else run_silently(job, ())
        changed = _changed(run, summary["run_id"])
    except Exception as error:  # whatever it is, the rest goes on
        return failed(run, told(error))
    if summary["interrupted"]:
        raise KeyboardInterrupt
    if changed:  # its results are of another run than that of this id
        if job.out is not None:
            shutil.rmtree(job.out)
        return failed(run, CHANGED)
    return Done(row_of(run) | results(summary), summary["timing"])


def _changed(run: Run, ran: str) -> bool:
    """Whether a run read another input than was planned with, or other documents beside it.

    The id of what `ran` tells it of the documents beside a recording; a scene has none, its truth is of the same seed.
    """
    return (ran != run.run_id and not run.source.scene) or input_changed(run)


def input_changed(run: Run) -> bool:
    """Whether the input is another one than was planned with: by its files, and where these are new, by its octets."""
    if stamp(run.source) == run.stamp:
        return False
    return digest_of(examine(run.source), run.source, seed=run.seed) != run.input_sha256


def results(summary: Mapping[str, Any]) -> Row:
    """What a row holds of a summary: the metrics, how objects were held, counts."""
    objects = summary["objects"]
    seen = sum(o["frames"] for o in objects)
    held = {
        "held": sum(o["held"] for o in objects) / seen,
        "held_by_one": sum(o["held_by_one"] * o["frames"] for o in objects) / seen,
        "switches": float(sum(o["switches"] for o in objects)),
    } if seen else {}  # fmt: skip
    counts = {name: n for name, n in summary["counts"].items() if not isinstance(n, Mapping)}
    warnings = sum(summary["counts"]["warnings"].values())
    return {"metrics": {**summary["metrics"], **held}, "counts": {**counts, "warnings": warnings}, "error": ""}


def row_of(run: Run) -> Row:
    """Who a run is: the part of its row that is known before it runs."""
    config = run.config
    return {
        "run_id": run.run_id,
        "input": run.source.name,
        "input_sha256": run.input_sha256,
        "kind": run.kind,
        "seed": run.seed,
        "tracker": config.tracker_name if config is not None else run.values.get("tracker_name", ""),
        "preset": config.preset if config is not None else "",
        "values": {name: _plain(value) for name, value in run.values.items()},
        "config": to_toml(config) if isinstance(config, Config) else "",
    }


def _plain(value: Any) -> Any:
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value
