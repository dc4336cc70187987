"""What a path that is compared stands for: an archive, the folder of a run, or a summary."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from maritrack.errors import InputError
from maritrack.io.archive import read_archive
from maritrack.io.containers.mcap_walk import MAGIC
from maritrack.io.runmeta import manifest_metadata


class Side(NamedTuple):
    """One of two runs."""

    archive: Path | None  # to be compared frame by frame
    n_scans: int
    summary: Mapping[str, Any]
    manifest: Mapping[str, Any]


def flat(table: Any, prefix: str = "") -> dict[str, Any]:
    """Nested tables as one, names joined by dots."""
    entries: dict[str, Any] = {}
    for name, value in table.items() if isinstance(table, Mapping) else ():
        entries |= flat(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {f"{prefix}{name}": value}
    return entries


def side_of(path: Path) -> Side:
    """What a path stands for: archive, folder of a run, or summary."""
    names = ("run.mcap", "run.mcap.partial", "summary.json")
    if path.is_dir():
        inside = next((path / name for name in names if (path / name).exists()), None)
        if inside is None:
            raise InputError(f"{path}: no run in this folder", f"looked for {', '.join(names)}")
        path = inside
    try:
        with path.open("rb") as file:
            is_archive = file.read(len(MAGIC)) == MAGIC
        if not is_archive:
            return Side(None, 0, _summary(path), {})
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    archive = read_archive(path)
    manifest = {name: text for name, text in manifest_metadata(archive.manifest).items() if name != "digest"}
    return Side(path, archive.n_scans, archive.summary, manifest | _config(archive.config_toml))


def _summary(path: Path) -> Mapping[str, Any]:
    try:
        document = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: neither an archive nor a summary: {error}") from None
    if not isinstance(document, dict) or not isinstance(document.get("metrics"), dict):
        raise InputError(f"{path}: no summary, it has no 'metrics'")
    return document


def _config(text: str) -> dict[str, Any]:
    try:
        return {f"config.{name}": value for name, value in flat(tomllib.loads(text)).items()}
    except (ValueError, RecursionError):
        return {"config": text}
