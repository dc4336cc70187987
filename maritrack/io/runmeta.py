"""The manifest of a run as MCAP metadata and back."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

from maritrack.errors import InputError
from maritrack.io.containers.mcap_walk import OnDamage
from maritrack.types import Damage, Origin, RunManifest


def manifest_metadata(manifest: RunManifest) -> dict[str, str]:
    """The manifest as MCAP metadata, without configuration (an attachment) and title, with a digest."""
    origin = manifest.origin and [manifest.origin.lat_deg, manifest.origin.lon_deg]
    table = {
        "run_id": manifest.run_id,
        "tracker": manifest.tracker,
        "preset": manifest.preset,
        "code_sha256": manifest.code_sha256,
        "input_sha256": json.dumps(list(manifest.input_sha256)),
        "input_kind": json.dumps(list(manifest.input_kind)),
        "seed": str(manifest.seed),
        "versions": json.dumps(dict(manifest.versions), sort_keys=True),
        "origin": json.dumps(origin),
    }
    if manifest.smoothed_from:
        table["smoothed_from"] = manifest.smoothed_from
    if manifest.joined:
        table["joined"] = manifest.joined
    return table | {"digest": _digest(table, manifest.config_toml.encode())}


def _digest(table: Mapping[str, str], config: bytes) -> str:
    """Metadata of an MCAP file have no CRC of their own."""
    rows = sorted((key, value) for key, value in table.items() if key != "digest")
    return hashlib.sha256(json.dumps(rows).encode() + config).hexdigest()


def manifest_from_metadata(path: Path, table: Mapping[str, str], config: bytes, report: OnDamage) -> RunManifest:
    """The manifest that `manifest_metadata` got; `config` is the attachment. InputError where it can't be read."""
    if table.get("digest") != _digest(table, config):
        report(Damage("archive-manifest", -1, "manifest and configuration do not match their digest"))
    try:
        origin = json.loads(table["origin"])
        return RunManifest(
            run_id=table["run_id"], tracker=table["tracker"], preset=table["preset"],
            code_sha256=table["code_sha256"], config_toml=config.decode("utf-8", "replace"),
            input_sha256=tuple(map(str, json.loads(table["input_sha256"]))),
            input_kind=tuple(map(str, json.loads(table["input_kind"]))), seed=int(table["seed"]),
            versions={str(k): str(v) for k, v in dict(json.loads(table["versions"])).items()},
            origin=origin if origin is None else Origin(float(origin[0]), float(origin[1])),
            smoothed_from=table.get("smoothed_from", ""), joined=table.get("joined", ""),
        )  # fmt: skip
    except (KeyError, IndexError, TypeError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: the run's manifest can't be read: {error}") from None
