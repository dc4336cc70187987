"""What a run has learned of the background, written as a snapshot when it has ended."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from maritrack.detect.snapshot import snapshot_octets
from maritrack.errors import InputError
from maritrack.settings import SubtractConfig
from maritrack.types import Result, RunManifest


class BackgroundSink:
    """Writes the models after the last scan to PATH. A run that is aborted writes nothing."""

    def __init__(self, path: Path, rules: SubtractConfig) -> None:
        self._path, self._rules = path, rules
        self._last: Any = {}
        self._manifest: RunManifest | None = None

    def open(self, manifest: RunManifest) -> None:
        self._manifest = manifest

    def write(self, result: Result) -> None:
        self._last = result.background

    def close(self, summary: Mapping[str, Any]) -> None:
        """Write the file. Errors: InputError where its place can't be written."""
        origin = self._manifest.origin if self._manifest else None
        partial = self._path.with_name(self._path.name + ".partial")
        try:
            partial.write_bytes(snapshot_octets(self._last, self._rules, origin))
            partial.replace(self._path)
        except OSError as error:
            raise InputError(f"{self._path}: {error.strerror or error}") from None

    def abort(self) -> None:
        pass
