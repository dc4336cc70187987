"""The archive: inputs as they came, and what the run made of them, as an MCAP file.

Equal manifests and results give equal octets: every time is of the data, every order is fixed. A
chunk is finished every few scans, so that a run that is killed keeps all but the last of them.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

from mcap.writer import CompressionType, Writer

from maritrack.io.archive import (
    CONFIG,
    FORMAT,
    META_ARCHIVE,
    META_CHANNELS,
    META_INPUTS,
    META_RUN,
    SIDE,
    SUMMARY,
    input_topics,
)
from maritrack.io.cloud import Constants, encode_points
from maritrack.io.messages import (
    OUTPUTS,
    encode_clusters,
    encode_log,
    encode_scan,
    encode_scores,
    encode_tracks,
    encode_truth,
    schema,
)
from maritrack.io.runmeta import manifest_metadata
from maritrack.sinks.summary import json_octets
from maritrack.types import Result, RunManifest

LIBRARY = "maritrack"
_CHUNK = 8 << 20  # octets; the count of scans ends a chunk earlier, as a rule
_PIECE = 4 << 20  # octets of an input message: a large input that comes at once is cut into several
_ENCODING = {"cat240": "x-asterix-cat240", "points": "json", "autoferry": "json"}


class McapSink:
    """Writes PATH.partial, which becomes PATH when the run has ended.

    `full` archives the inputs' octets, otherwise their size and digest. `side` are documents that a
    replay needs, by name ("truth", "own-ship"). Without `points` the points are left out.
    """

    def __init__(
        self,
        path: Path,
        *,
        full: bool = True,
        side: Mapping[str, bytes] | None = None,
        chunk_scans: int = 20,
        points: bool = True,
    ) -> None:
        self._path, self._full, self._side, self._points = path, full, dict(side or {}), points
        self._chunk_scans = chunk_scans
        self._partial = path.with_name(path.name + ".partial")
        self._channels: dict[str, int] = {}
        self._digests: dict[str, Any] = {}
        self._sizes: dict[str, int] = {}
        self._n_scans = 0
        self._last_ns = 0
        self._file: BinaryIO | None = None
        self._writer: Writer

    def open(self, manifest: RunManifest) -> None:
        """Begin the file: manifest, configuration and side documents come first."""
        self._file = self._partial.open("wb")
        self._writer = Writer(
            self._file, chunk_size=_CHUNK, compression=CompressionType.ZSTD, enable_crcs=True, enable_data_crcs=True
        )
        self._writer.start(profile="", library=LIBRARY)
        told = {"inputs": "full" if self._full else "hash", "points": "yes" if self._points else "no"}
        self._writer.add_metadata(META_ARCHIVE, {"format": FORMAT} | told)
        self._writer.add_metadata(META_RUN, manifest_metadata(manifest))
        self._register(manifest)
        self._attach(CONFIG, "application/toml", manifest.config_toml.encode())
        for name in sorted(self._side):
            self._attach(SIDE + name, "application/octet-stream", self._side[name])
        self._file.flush()

    def write(self, result: Result) -> None:
        """Archive a frame: inputs first, then what came of them."""
        k, t_ns = result.frame.k, max(self._last_ns, result.frame.t_ns)
        self._last_ns = t_ns
        for topic, octets in result.frame.inputs:
            self._input(topic, octets, k=k, t_ns=t_ns)
        for topic, data in encode_result(result, points=self._points):
            self._writer.add_message(self._channels[topic], t_ns, data, t_ns, k)
        self._count()

    def copy(self, k: int, t_ns: int, messages: Sequence[tuple[str, bytes]]) -> None:
        """Archive a frame whose messages are those of another archive: (topic, octets), the scan first."""
        t_ns = self._last_ns = max(self._last_ns, t_ns)
        for topic, data in messages:
            self._writer.add_message(self._channels[topic], t_ns, data, t_ns, k)
        self._count()

    def _count(self) -> None:
        self._n_scans += 1
        if self._n_scans % self._chunk_scans == 0:
            self._writer.flush()  # type: ignore[no-untyped-call]

    def close(self, summary: Mapping[str, Any]) -> None:
        """End the file with the summary's metrics and counts, and give it its name."""
        if not self._full:
            rows = {topic: f"{self._sizes[topic]} {self._digests[topic].hexdigest()}" for topic in sorted(self._sizes)}
            self._writer.add_metadata(META_INPUTS, rows)
        kept = {name: summary[name] for name in ("metrics", "counts", "interrupted") if summary.get(name)}
        self._attach(SUMMARY, "application/json", json_octets(kept))
        self.abort()
        os.replace(self._partial, self._path)

    def abort(self) -> None:
        """End the file so that it can be read, but leave it PATH.partial. Once is enough."""
        if self._file is not None:
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._file.close()
            self._file = None

    def _register(self, manifest: RunManifest) -> None:
        """All channels at once, and their numbers as metadata for when the first chunk is lost."""
        if self._full:
            for topic, kind in zip(input_topics(manifest.input_kind), manifest.input_kind, strict=True):
                encoding = _ENCODING.get(kind, "application/octet-stream")
                self._channels[topic] = self._writer.register_channel(topic, encoding, 0)
        for topic in OUTPUTS:
            if self._points or topic != "/points":
                id_ = self._writer.register_schema(schema(topic)[0], "protobuf", schema(topic)[1])
                self._channels[topic] = self._writer.register_channel(topic, "protobuf", id_)
        self._writer.add_metadata(META_CHANNELS, {topic: str(id_) for topic, id_ in self._channels.items()})

    def _input(self, topic: str, octets: bytes, *, k: int, t_ns: int) -> None:
        if not self._full:
            self._digests.setdefault(topic, hashlib.sha256()).update(octets)
            self._sizes[topic] = self._sizes.get(topic, 0) + len(octets)
            return
        for start in range(0, len(octets), _PIECE):
            self._writer.add_message(self._channels[topic], t_ns, octets[start : start + _PIECE], t_ns, k)

    def _attach(self, name: str, media_type: str, octets: bytes) -> None:
        self._writer.add_attachment(0, 0, name, media_type, octets)


def encode_result(result: Result, *, points: bool = True) -> list[tuple[str, bytes]]:
    """(topic, octets) of the messages of a frame, the scan first."""
    scan = result.frame.scan
    constants: Constants = {}
    rest: list[tuple[str, bytes]] = []
    if result.frame.truth is not None:
        rest.append(("/truth", encode_truth(result.frame.truth)))
    if points:
        cloud, constants = encode_points(result.points, keep=result.keep, label=result.clusters.label, t_ns=scan.t_ns)
        rest.append(("/points", cloud))
    rest += [
        ("/clusters", encode_clusters(result.clusters)),
        ("/tracks", encode_tracks(result.tracks)),
        ("/scores", encode_scores(result.scores)),
    ]
    rest += [("/log", encode_log(event, t_ns=scan.t_ns)) for event in result.events]
    return [("/scan", encode_scan(scan, constants=constants, n_messages=len(rest) + 1)), *rest]
