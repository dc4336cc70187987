"""An archive as a value, and its inputs and results one after the other.

The archive is an MCAP file that `sinks/mcap.py` writes. Reading survives damage: what can't be read
is handed to `on_damage` as `Damage` and left out. Without `on_damage` it is an InputError, so that
nobody takes half a run for a whole one. Memory is bounded by the largest chunk.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from maritrack.errors import InputError
from maritrack.io.cloud import decode_points
from maritrack.io.containers import mcap_walk as mcap
from maritrack.io.containers.mcap_walk import OnDamage
from maritrack.io.messages import (
    OUTPUTS,
    decode_clusters,
    decode_log,
    decode_scan,
    decode_scores,
    decode_tracks,
    decode_truth,
)  # fmt: skip
from maritrack.io.runmeta import manifest_from_metadata
from maritrack.types import (
    BoolArray,
    Clusters,
    Damage,
    Event,
    Points,
    RunManifest,
    Scan,
    Tracks,
    Truth,
)  # fmt: skip

FORMAT = "maritrack-archive/1"
META_ARCHIVE, META_RUN, META_CHANNELS, META_INPUTS = (
    "maritrack.archive", "maritrack.run", "maritrack.channels", "maritrack.inputs",
)  # fmt: skip
CONFIG, SUMMARY, SIDE = "config.toml", "summary.json", "side/"  # names of attachments


@dataclass(frozen=True, slots=True, eq=False)
class Archive:
    """What an archive says of its run, without its scans."""

    path: Path
    manifest: RunManifest
    side: Mapping[str, bytes]  # name ("truth", "own-ship") -> octets of the document
    summary: Mapping[str, Any]  # "metrics" and "counts"; empty where the run was killed
    inputs: tuple[str, ...]  # channels
    full: bool  # the inputs' octets are in the archive, not only their digests
    points: bool  # points are archived
    digests: Mapping[str, tuple[int, str]]  # channel -> (octets, sha256), where not full
    n_scans: int  # written, also where they are damaged now
    complete: bool  # the run came to its end, and the archive is whole as far as can be told without unpacking
    damage: tuple[Damage, ...]

    @property
    def config_toml(self) -> str:
        return self.manifest.config_toml

    @property
    def counts(self) -> Mapping[str, Any]:
        counts = self.summary.get("counts")
        return counts if isinstance(counts, Mapping) else {}


@dataclass(frozen=True, slots=True, eq=False)
class ArchivedScan:
    """What the archive holds of one frame."""

    k: int
    scan: Scan  # without video and points
    n_spokes: int
    truth: Truth | None
    points: Points | None  # None = the run did not archive points
    keep: BoolArray | None  # (n,) of the points
    clusters: Clusters
    tracks: Tracks
    scores: Mapping[str, float]
    events: tuple[Event, ...]

    @property
    def t_ns(self) -> int:
        return self.scan.t_ns


class Stored(NamedTuple):
    """A message as it stands in the archive."""

    topic: str
    k: int
    t_ns: int  # log time: that of the scan, but never going back
    data: bytes
    offset: int  # of its chunk in the file


def input_topics(kinds: Sequence[str]) -> tuple[str, ...]:
    """Channels of a run's inputs: "/input/<kind>", numbered from 0 where there are several."""
    return tuple(f"/input/{kind}" if len(kinds) == 1 else f"/input/{kind}-{i}" for i, kind in enumerate(kinds))


def read_archive(path: Path) -> Archive:
    """The archive's manifest, documents and summary. InputError where it is none of ours."""
    damage: list[Damage] = []
    tables: dict[str, dict[str, str]] = {}
    files: dict[str, bytes] = {}
    topics: dict[int, str] = {}
    counts: dict[int, int] = {}
    report, ended = mcap.reporter(path, damage.append), False
    for record in mcap.walk(path, report, skip_chunks=True):
        ended |= record.opcode == mcap.FOOTER
        try:
            _note(record, tables, files, topics, counts)
        except ValueError as error:
            report(Damage("archive-record", record.offset, str(error)))
    if META_RUN not in tables or tables.get(META_ARCHIVE, {}).get("format") != FORMAT:
        raise InputError(f"{path}: not an archive of maritrack", "a run's archive is called run.mcap")
    try:
        channels = topics or _channels(tables.get(META_CHANNELS, {}))
    except ValueError as error:
        channels = {}
        report(Damage("archive-record", -1, f"the table of channels can't be read: {error}"))
    manifest = manifest_from_metadata(path, tables[META_RUN], files.get(CONFIG, b""), report)
    summary = _summary(files.get(SUMMARY), report)
    return Archive(
        path=path, manifest=manifest, inputs=input_topics(manifest.input_kind),
        side={name[len(SIDE) :]: files[name] for name in files if name.startswith(SIDE)}, summary=summary,
        full=tables[META_ARCHIVE].get("inputs") == "full",
        points=tables[META_ARCHIVE].get("points") == "yes", digests=_digests(tables.get(META_INPUTS, {}), report),
        n_scans=sum(counts.get(id_, 0) for id_, topic in channels.items() if topic == "/scan"),
        complete=ended and SUMMARY in files and not summary.get("interrupted") and not damage, damage=tuple(damage),
    )  # fmt: skip


def input_channels(path: Path) -> tuple[str, ...]:
    """Channels of the archive's inputs, in the order of the run's inputs."""
    return read_archive(path).inputs


def iter_messages(path: Path, topics: Collection[str], *, on_damage: OnDamage | None = None) -> Iterator[Stored]:
    """Messages of the topics, in the order of the file."""
    report = mcap.reporter(path, on_damage)
    told: dict[int, str] = {}  # by the metadata, for when the chunk that begins a channel is lost
    channels: dict[int, str] = {}
    for record in mcap.walk(path, report):
        try:
            for opcode, content in _unpacked(record):
                if opcode == mcap.METADATA:
                    name, table = mcap.metadata(content)
                    told |= _channels(table) if name == META_CHANNELS else {}
                elif opcode == mcap.CHANNEL:
                    channels |= mcap.channel(content)
                elif opcode == mcap.MESSAGE:
                    id_ = int.from_bytes(content[:2], "little")
                    topic = channels.get(id_) or told.get(id_)
                    if topic is None:
                        raise ValueError(f"no channel {id_}")
                    if topic in topics:
                        yield _message(content, topic, record.offset)
        except ValueError as error:
            code = "archive-chunk" if record.opcode == mcap.CHUNK else "archive-record"
            report(Damage(code, record.offset, str(error)))


def iter_inputs(path: Path, channel: str, *, on_damage: OnDamage | None = None) -> Iterator[bytes]:
    """Octets of an input, piece by piece; put together they are the input file."""
    for message in iter_messages(path, {channel}, on_damage=on_damage):
        yield message.data


def iter_results(path: Path, *, on_damage: OnDamage | None = None) -> Iterator[ArchivedScan]:
    """What the run made of each frame, in order. Scans that are not whole are damage."""
    report = mcap.reporter(path, on_damage)
    parts: list[Stored] = []
    for message in iter_messages(path, OUTPUTS, on_damage=report):
        if parts and message.k != parts[-1].k:
            yield from assemble_scan(parts, report)
            parts = []
        parts.append(message)
    yield from assemble_scan(parts, report)


def _summary(octets: bytes | None, report: OnDamage) -> Mapping[str, Any]:
    try:
        summary = json.loads(octets) if octets is not None else {}
    except (ValueError, RecursionError) as error:
        report(Damage("archive-summary", -1, f"the summary can't be read: {error}"))
        return {}
    return summary if isinstance(summary, dict) else {}


def _digests(table: Mapping[str, str], report: OnDamage) -> dict[str, tuple[int, str]]:
    """Octets and digest of each input, from "<octets> <sha256>"."""
    try:
        return {topic: (int(text.split()[0]), text.split()[1]) for topic, text in table.items()}
    except (ValueError, IndexError):
        report(Damage("archive-record", -1, "the digests of the inputs can't be read"))
        return {}


def _note(
    record: mcap.Record,
    tables: dict[str, dict[str, str]],
    files: dict[str, bytes],
    topics: dict[int, str],
    counts: dict[int, int],
) -> None:
    """Put what a record outside of the chunks says where it belongs."""
    if record.opcode == mcap.METADATA:
        name, table = mcap.metadata(record.content)
        tables[name] = table
    elif record.opcode == mcap.ATTACHMENT:
        name, data = mcap.attachment(record.content)
        files[name] = data
    elif record.opcode == mcap.CHANNEL:
        topics |= mcap.channel(record.content)
    elif record.opcode == mcap.MESSAGE_INDEX:
        id_ = int.from_bytes(record.content[:2], "little")
        counts[id_] = counts.get(id_, 0) + len(record.content[6:]) // 16


def _unpacked(record: mcap.Record) -> Iterator[tuple[int, bytes]]:
    if record.opcode == mcap.CHUNK:
        return mcap.records_of(mcap.unpack_chunk(record.content))
    return iter([(record.opcode, record.content)])


def _channels(table: Mapping[str, str]) -> dict[int, str]:
    return {int(id_): topic for topic, id_ in table.items()}


def _message(content: bytes, topic: str, offset: int) -> Stored:
    cursor = mcap.Cursor(content)
    _, k, t_ns, _ = cursor.number(2), cursor.number(4), cursor.number(8), cursor.number(8)
    return Stored(topic, k, t_ns, cursor.take(cursor.left), offset)


def assemble_scan(parts: Sequence[Stored], report: OnDamage) -> Iterator[ArchivedScan]:
    """The scan that the messages make up: one, or none where they are not all there."""
    if not parts:
        return
    by_topic = {message.topic: message.data for message in parts}
    try:
        told = decode_scan(by_topic.get("/scan", b""))
        if told.n_messages != len(parts):
            raise ValueError(f"{len(parts)} messages where {told.n_messages} belong")
        clusters, points, keep = decode_clusters(by_topic["/clusters"]), None, None
        if "/points" in by_topic:
            points, keep = decode_points(by_topic["/points"], told.constants, t_ns=told.scan.t_ns)
            if keep.sum() != len(clusters.label):
                raise ValueError(f"{len(clusters.label)} points have clusters, {keep.sum()} were kept")
        yield ArchivedScan(
            k=parts[0].k, scan=told.scan, n_spokes=told.n_spokes,
            truth=decode_truth(by_topic["/truth"]) if "/truth" in by_topic else None, points=points, keep=keep,
            clusters=clusters, tracks=decode_tracks(by_topic["/tracks"]),
            scores=decode_scores(by_topic["/scores"]),
            events=tuple(decode_log(message.data) for message in parts if message.topic == "/log"),
        )  # fmt: skip
    except (ValueError, KeyError) as error:
        report(Damage("archive-scan", parts[0].offset, f"scan {parts[0].k} is not whole: {error}"))
