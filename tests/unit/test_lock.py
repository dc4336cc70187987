"""One run at a time in a folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from maritrack.errors import UsageError
from maritrack.job import only_one
from maritrack.sweep import drive, plan
from maritrack.sweep.sources import named
from tests.shared import ROOT

fcntl = pytest.importorskip("fcntl", reason="this system has no locks of files")


def test_a_folder_is_of_one_run_and_free_when_it_ends(tmp_path: Path) -> None:
    with only_one(tmp_path), pytest.raises(UsageError, match="another run is writing here"), only_one(tmp_path):
        pass
    with pytest.raises(ZeroDivisionError), only_one(tmp_path):
        1 / 0  # noqa: B018
    with only_one(tmp_path):
        pass
    assert not list(tmp_path.iterdir())


def test_who_waited_for_the_end_of_another_run_holds_a_lock_that_others_see(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between opening the file and locking it the other run ends, and takes the file with it."""
    locking, times = fcntl.flock, []

    def late(file: Any, how: int) -> None:
        if not times:
            (tmp_path / ".lock").unlink()
        times.append(how)
        locking(file, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with only_one(tmp_path), pytest.raises(UsageError), only_one(tmp_path):
        pass
    assert len(times) == 3


def test_a_sweep_that_runs_keeps_another_out(tmp_path: Path) -> None:
    sources = named([str(ROOT / "data" / "samples" / "autoferry13_detections.json")])
    settings = plan.Settings(over={"input": {"limit": 2}})
    runs = plan.plan(sources, axes={}, seeds=(), settings=settings)
    with only_one(tmp_path), pytest.raises(UsageError, match="another run"):
        drive.sweep(runs, tmp_path)
    assert not drive.sweep(runs, tmp_path).failed
