"""What the writers of simulated recordings share: the number of scans, and files that are whole or not there."""

from __future__ import annotations

from pathlib import Path

from maritrack.errors import InputError, UsageError


def scans_asked(of_scene: int, scans: int | None, *, seed: int) -> int:
    """How many to write: `scans`, or where it is None those of the scene. UsageError for none, or a seed below 0."""
    n_scans = of_scene if scans is None else scans
    if n_scans < 1 or seed < 0:
        raise UsageError(f"scans = {n_scans} starts at 1, seed = {seed} at 0")
    return n_scans


def write_octets(out: Path, octets: bytes) -> None:
    """The whole file or none of it. InputError where it can't be written."""
    partial = out.with_name(out.name + ".partial")
    try:
        partial.write_bytes(octets)
        partial.replace(out)
    except OSError as error:
        raise InputError(f"{out}: {error.strerror or error}") from None
