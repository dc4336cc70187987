"""What makes a run this run: digests of code, configuration and input, and the id they give."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import metadata
from pathlib import Path

from maritrack import __version__
from maritrack.config import to_toml
from maritrack.io.source import Octets
from maritrack.settings import Config
from maritrack.types import Origin, RunManifest

LIBRARIES = ("numpy", "scipy", "mcap", "protobuf")  # what the numbers and the octets of an archive rest on


@cache
def code_digest() -> str:
    """SHA-256 over the sources of the package: an edited tree never passes for another."""
    root = Path(__file__).parent
    digest = hashlib.sha256()
    for path in sorted(p for p in root.rglob("*") if p.suffix in (".py", ".toml")):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def file_digest(path: Path) -> str:
    """SHA-256 of a file, read in pieces."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def input_digest(octets: Octets, path: Path) -> str:
    """SHA-256 of an input; "" where it is a stream that can be read once only."""
    if octets.packed:
        digest = hashlib.sha256()
        for piece in octets.chunks:
            digest.update(piece)
        return digest.hexdigest()
    return file_digest(path) if octets.size >= 0 else ""


def versions() -> dict[str, str]:
    """Versions that a difference between two machines would be looked for in first."""
    found = {name: metadata.version(name) for name in LIBRARIES}
    return {"maritrack": __version__, "python": platform.python_version(), **found}


def id_of_run(
    code_sha256: str, config_toml: str, input_sha256: Sequence[str], side_sha256: Mapping[str, str], *,
    smoothed_from: str = "",
) -> str:  # fmt: skip
    """The id of a run: a digest of what decides its results, the digests of its inputs and side documents by name."""
    digest = hashlib.sha256(f"{code_sha256}\n{config_toml}\n{' '.join(input_sha256)}\n".encode())
    for name in sorted(side_sha256):
        digest.update(name.encode() + b"\0" + bytes.fromhex(side_sha256[name]))
    digest.update(smoothed_from.encode())
    return digest.hexdigest()


def make_manifest(
    config: Config,
    *,
    input_sha256: Sequence[str],
    input_kind: Sequence[str],
    side: Mapping[str, bytes],
    origin: Origin | None,
    recording: str,
    smoothed_from: str = "",
) -> RunManifest:
    """The manifest of a run. Its id covers code, configuration, inputs, side documents and the run it smooths."""
    toml, code = to_toml(config), code_digest()
    side_sha256 = {name: hashlib.sha256(octets).hexdigest() for name, octets in side.items()}
    run_id = id_of_run(code, toml, input_sha256, side_sha256, smoothed_from=smoothed_from)
    return RunManifest(
        run_id=run_id, tracker=config.tracker_name, preset=config.preset, code_sha256=code,
        config_toml=toml, input_sha256=tuple(input_sha256), input_kind=tuple(input_kind), seed=config.seed,
        versions=versions(), origin=origin, recording=recording, smoothed_from=smoothed_from,
    )  # fmt: skip
