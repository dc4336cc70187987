"""Which runs a sweep is made of: inputs, combinations of settings, seeds, each with an id from its content."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from maritrack.config import to_toml
from maritrack.errors import InputError, UsageError, told
from maritrack.fanout import fan_out
from maritrack.manifest import code_digest, id_of_run
from maritrack.recording import default_preset
from maritrack.settings import Config
from maritrack.sweep.sources import Known, Source, examine
from maritrack.tune.grids import parse_axis, parse_numbers
from maritrack.tune.tracking import TRACKER, configurations

MOST_RUNS = 1_000_000
MOST_SEED = 1 << 53  # from here on not all whole numbers are floats


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One row of the table to be."""

    run_id: str  # digest of code, configuration, input, documents beside it, seed
    source: Source
    kind: str
    input_sha256: str  # of a scene: of what it shows and of the seed of its noise
    seed: int
    values: Mapping[str, Any]  # of the grid
    config: Config | None  # None: there is none, see error
    error: str = ""
    stamp: str = ""  # of the input, when it was read for its digest


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Where configurations come from, in this order: preset ("" = by content), file, assignments, named options."""

    preset: str = ""
    file: Path | None = None
    sets: Sequence[str] = ()
    over: Mapping[str, Any]


def parse_axes(texts: Sequence[str]) -> dict[str, tuple[Any, ...]]:
    """The keys of a grid with their values; `tracker=a,b` means the names of trackers."""
    parsed = [parse_axis(text) for text in texts]
    axes = {TRACKER if key == "tracker" else key: values for key, values in parsed}
    if len(axes) < len(parsed) or "seed" in axes:
        raise UsageError("--grid: each key once, and seeds with --seeds")
    if "preset" in axes:
        raise UsageError("--grid preset: a sweep has one preset", hint="one sweep for each, into folders of their own")
    return axes


def parse_seeds(text: str) -> tuple[int, ...]:
    """`FROM:TO` and `FROM:TO:STEP` as Python counts, without TO (0:100 are a hundred), or a list with commas.

    UsageError where that is none, or not of whole numbers from 0 on.
    """
    values = parse_numbers(text, name="--seeds")
    if not all(value == int(value) and 0 <= value < MOST_SEED for value in values):
        raise UsageError(f"--seeds {text}: whole numbers from 0 on, below 2^53")
    stop = float(text.split(":")[1]) if ":" in text else math.inf
    seeds = tuple(int(value) for value in values if value < stop)
    if not seeds:
        raise UsageError(f"--seeds {text}: no seed, the last number does not count")
    return seeds


def look(source: Source) -> Known:
    """What an input is, or why it can't be told."""
    try:
        return examine(source)
    except Exception as error:  # whatever it is, the rest goes on
        return Known("", "", {}, told(error))


def plan(
    sources: Sequence[Source], *, axes: Mapping[str, Sequence[Any]], seeds: Sequence[int], settings: Settings,
    workers: int = 1, scheduler: str = "",
) -> list[Run]:  # fmt: skip
    """Every combination of input, settings and seed, each once; an input that can't be read is one failed run.

    Inputs are read by the workers to know their digests. InputError where none of them can be read, ConfigError for a
    key or value that is wrong by itself.
    """
    found = dict(fan_out(look, sources, workers=workers, scheduler=scheduler))
    known = [found[i] for i in range(len(sources))]
    if known and all(one.error for one in known):
        raise InputError(known[0].error)
    code, grids = code_digest(), dict[str, Any]()
    for kind in dict.fromkeys(one.kind for one in known if not one.error):
        chosen = settings.preset or default_preset([kind])
        grids[kind] = configurations(
            axes, preset=chosen, file=settings.file, sets=settings.sets, over=settings.over
        )  # fmt: skip
    if len(sources) * max(map(len, grids.values())) * max(len(seeds), 1) > MOST_RUNS:
        raise UsageError(f"more than {MOST_RUNS} runs")
    runs: dict[str, Run] = {}
    for source, one in zip(sources, known, strict=True):
        made = _runs(source, one, grids[one.kind], seeds, code) if not one.error else [_unread(source, one)]
        for run in made:
            runs.setdefault(run.run_id, run)
    return list(runs.values())


def _runs(
    source: Source, known: Known, grid: Sequence[tuple[Mapping[str, Any], Config | str]], seeds: Sequence[int],
    code: str,
) -> Iterator[Run]:  # fmt: skip
    """The runs of an input: all settings of a seed, then those of the next."""
    for seed in seeds or (None,):
        for values, found in grid:
            config = replace(found, seed=seed) if isinstance(found, Config) and seed is not None else found
            of = config.seed if isinstance(config, Config) else seed or 0
            sha256 = digest_of(known, source, seed=of)
            if isinstance(config, Config):
                run_id, error = id_of_run(code, to_toml(config), [sha256], known.side), ""
            else:
                run_id, error = _sha256(f"{code} {sha256} {of} {sorted(values.items())!r}"), config
            yield Run(
                run_id=run_id, source=source, kind=known.kind, input_sha256=sha256, seed=of, values=values,
                config=config if isinstance(config, Config) else None, error=error, stamp=known.stamp,
            )  # fmt: skip


def digest_of(known: Known, source: Source, *, seed: int) -> str:
    """SHA-256 of what a run reads: of a recording, or of what a scene shows and of the seed of its noise."""
    return _sha256(f"{known.sha256} {seed}") if source.scene else known.sha256


def _unread(source: Source, known: Known) -> Run:
    return Run(
        run_id=_sha256(f"{source!r} {known.error}"), source=source, kind="", input_sha256="", seed=0, values={},
        config=None, error=known.error,
    )  # fmt: skip


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
