"""One small run that the tests of all commands share."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.cli.calling import call
from tests.shared import ROOT

SCANS = 8


@pytest.fixture(scope="session")
def sample() -> Path:
    """The simulated harbour, with its truth beside it."""
    return ROOT / "data" / "samples" / "harbour.cat240"


@pytest.fixture(scope="session")
def finished_run(sample: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a run over the first scans. Not to be written to."""
    folder = tmp_path_factory.mktemp("finished") / "run"
    done = call("process", sample, "--limit", str(SCANS), "-o", folder, "-q")
    assert done.code == 0, done.err
    return folder


@pytest.fixture
def run(finished_run: Path, tmp_path: Path) -> Path:
    """A copy of the run's folder, to do with as one likes."""
    return Path(shutil.copytree(finished_run, tmp_path / "run"))
