"""Where the recordings live that are not ours to ship; tests that need them skip, visibly, without."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


def shared(name: str) -> Path:
    """Path of a file of the shared material, or a skip that names it."""
    folder = Path(os.environ.get("MARITRACK_SHARED", ROOT.parent / "shared"))
    path = folder / name
    if not path.exists():
        pytest.skip(f"needs {name}, which is not part of the project (set MARITRACK_SHARED)")
    return path
