"""A run again, from its archive alone: inputs, configuration and side documents are in it."""

from __future__ import annotations

import hashlib
import tempfile
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from maritrack.config import build, merge, parse_set, toml_table
from maritrack.errors import InputError, ReplayMismatch, UsageError
from maritrack.io.archive import Archive, iter_inputs, read_archive
from maritrack.io.octets import HEAD
from maritrack.io.source import Octets
from maritrack.job import MCAP, Job, run_silently
from maritrack.manifest import code_digest, input_digest, versions
from maritrack.recording import open_inputs
from maritrack.run import Progress
from maritrack.settings import Config
from maritrack.sinks.mcap import McapSink
from maritrack.types import Damage, Result, RunManifest
from maritrack.verify import Verification, verify


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """An archived run that is ready to run again."""

    archive: Archive
    job: Job
    notes: tuple[str, ...]  # what the person should know before
    damage: list[Damage] = field(default_factory=list)  # of the archived inputs; known when they have been read


@dataclass(frozen=True, slots=True)
class ArchivedChunks:
    """The pieces of an archived input, read anew by each loop."""

    path: Path
    channel: str
    damage: list[Damage]

    def __iter__(self) -> Iterator[bytes]:
        return iter_inputs(self.path, self.channel, on_damage=self._note)

    def _note(self, damage: Damage) -> None:
        if damage not in self.damage:
            self.damage.append(damage)


@dataclass(frozen=True, slots=True)
class _Ticks:
    """A sink that only tells how far the run is."""

    progress: Progress | None

    def open(self, manifest: RunManifest) -> None:
        pass

    def write(self, result: Result) -> None:
        if self.progress is not None:
            self.progress(result)

    def close(self, summary: Mapping[str, Any]) -> None:
        pass

    def abort(self) -> None:
        pass


def archive_path(path: Path) -> Path:
    """The archive itself, or the one in a run's folder, finished or not."""
    if not path.is_dir():
        return path
    for name in (MCAP, MCAP + ".partial"):
        if (path / name).is_file():
            return path / name
    raise InputError(f"{path}: no {MCAP} in this folder")


def prepare(
    path: Path, *, tracker: str = "", sets: Sequence[str] = (), inputs: Sequence[Path] = (), out: Path | None = None,
    rrd: bool = True, mcap: bool = True, force: bool = False,
) -> Replay:  # fmt: skip
    """The job that an archive holds, with another tracker or other settings where asked for.

    `inputs` are the recordings, for archives that hold only their digests. An archive that breaks off is
    replayed as far as it goes.
    """
    archive = read_archive(path)
    if archive.manifest.smoothed_from:
        told = f"offline tracks, smoothed from run {archive.manifest.smoothed_from[:8]}"
        raise UsageError(f"{path}: {told}, not a run of their own", hint="replay that run, then `maritrack smooth` it")
    return archived_job(archive, tracker=tracker, sets=sets, inputs=inputs, out=out, rrd=rrd, mcap=mcap, force=force)


def archived_job(
    archive: Archive, *, tracker: str = "", sets: Sequence[str] = (), inputs: Sequence[Path] = (),
    out: Path | None = None, rrd: bool = True, mcap: bool = True, force: bool = False,
) -> Replay:  # fmt: skip
    """The same for an archive of any kind of tracks: its recording and configuration."""
    damage: list[Damage] = []
    path, manifest = archive.path, archive.manifest
    if out is not None and out.resolve() == path.resolve().parent:
        raise UsageError(f"{out}: the archive that is read lies there", hint="choose another folder with -o")
    octets = _given(archive, inputs) if inputs else _archived(archive, damage)
    job = Job(
        octets=octets, kinds=manifest.input_kind, side=archive.side, name=_name(archive),
        input_sha256=manifest.input_sha256 if archive.complete or inputs else [_digest(o) for o in octets],
        config=archived_config(archive, tracker=tracker, sets=sets), out=out, rrd=rrd, mcap=mcap, force=force,
    )  # fmt: skip
    return Replay(archive, job, tuple(_notes(archive)), damage)


def archived_config(archive: Archive, *, tracker: str = "", sets: Sequence[str] = ()) -> Config:
    """The configuration of an archived run, other settings laid over it."""
    try:
        table: dict[str, Any] = toml_table(archive.config_toml)
    except tomllib.TOMLDecodeError as error:
        raise ReplayMismatch(f"{archive.path}: the configuration can't be read: {error}") from None
    for assignment in sets:
        table = merge(table, parse_set(assignment))
    config: Config = build(Config, merge(table, {"tracker_name": tracker} if tracker else {}), "")
    return config


def verify_run(replay: Replay, *, progress: Progress | None = None) -> Verification:
    """Run again, and compare what comes out with what is archived, octet by octet."""
    output = replay.job.config.output
    with tempfile.TemporaryDirectory(prefix="maritrack-") as folder:
        again = Path(folder) / MCAP
        sink = McapSink(again, full=False, chunk_scans=output.chunk_scans, points=replay.archive.points)
        summary, _ = run_silently(replay.job, [sink, _Ticks(progress)])
        if summary["interrupted"]:
            raise KeyboardInterrupt
        return verify(replay.archive.path, again)


def _given(archive: Archive, paths: Sequence[Path]) -> list[Octets]:
    """Recordings instead of archived octets: the very same ones."""
    digests = archive.manifest.input_sha256
    if len(paths) != len(digests):
        raise UsageError(f"{archive.path}: a run of {len(digests)} recordings, {len(paths)} are given")
    for path in paths:
        if not path.is_file() and not path.is_dir():
            raise InputError(f"{path}: no such file")
    octets = open_inputs(paths)
    for one, path, digest in zip(octets, paths, digests, strict=True):
        if input_digest(one, path) != digest:
            raise UsageError(f"{path}: not the recording of this run, its SHA-256 is another one")
    return octets


def _archived(archive: Archive, damage: list[Damage]) -> list[Octets]:
    if not archive.full:
        hint = "pass it with --input REC; its SHA-256 begins " + ", ".join(
            d[:12] for d in archive.manifest.input_sha256
        )
        raise UsageError(f"{archive.path}: only the digest of the recording is archived", hint=hint)
    stems = archive.side.get("names", b"").decode("utf-8", "replace").split("\n")
    names = [f"{archive.path}{channel}" for channel in archive.inputs]
    if len(stems) == len(archive.inputs) and stems[0]:  # as files: sensors may go by what is before the last dot
        names = [f"{stem}.{kind}" for stem, kind in zip(stems, archive.manifest.input_kind, strict=True)]
    chunks = [ArchivedChunks(archive.path, channel, damage) for channel in archive.inputs]
    return [_octets(name, c) for name, c in zip(names, chunks, strict=True)]


def _octets(name: str, chunks: ArchivedChunks) -> Octets:
    head = b""
    for chunk in chunks:
        head += chunk[: HEAD - len(head)]
        if len(head) >= HEAD:
            break
    return Octets(name, chunks.channel, chunks, head, -1)


def _digest(octets: Octets) -> str:
    digest = hashlib.sha256()
    for chunk in octets.chunks:
        digest.update(chunk)
    return digest.hexdigest()


def _name(archive: Archive) -> str:
    """The recording's name, as far as the archive's place tells it."""
    path, manifest = archive.path.resolve(), archive.manifest
    if not path.name.startswith(MCAP):
        return path.name.partition(".")[0]
    return path.parent.name.removesuffix(f"-{manifest.tracker}-{manifest.run_id[:8]}")


def _notes(archive: Archive) -> Iterator[str]:
    """What makes this replay another one than the run."""
    manifest = archive.manifest
    if manifest.code_sha256 != code_digest():
        yield "the code of maritrack is another one than that of the run"
    now = versions()
    for name, old in manifest.versions.items():
        if now.get(name) != old:
            yield f"{name} {now.get(name, '-')} instead of {old}"
    if manifest.joined:
        yield f"the run was joined of {manifest.joined}: in one piece it differs a little behind the seams"
    if archive.damage:
        yield f"{archive.damage[0].message}; {archive.n_scans} scans are archived" + _lost(archive)
    elif archive.summary.get("interrupted"):
        yield f"the run was interrupted after {archive.n_scans} scans"
    elif not archive.complete:
        yield f"the run did not end: {archive.n_scans} scans are archived"


def _lost(archive: Archive) -> str:
    """How much of a run that was killed is gone."""
    if archive.summary:
        return ""
    most = archived_config(archive).output.chunk_scans
    return f", at most {most} after them are lost"
