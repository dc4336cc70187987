"""`maritrack batch` as from a shell."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.io import savemat

from tests.cli.calling import call
from tests.shared import ROOT

SAMPLES = ROOT / "data" / "samples"


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """A folder with two recordings, their truth, and what else lies in folders."""
    folder = tmp_path / "campaign"
    folder.mkdir()
    for name in ("autoferry13_detections.json", "autoferry13_groundTruth.json", "autoferry13_NOTICE.md"):
        shutil.copy(SAMPLES / name, folder)
    text = json.loads((folder / "autoferry13_detections.json").read_text())
    (folder / "b_detections.json").write_text(json.dumps(text[: len(text) // 2]))
    return folder


def test_a_folder_is_a_campaign(campaign: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = call("batch", campaign, "-o", out, "--workers", "1", "--json")
    assert done.code == 0 and [Path(row["input"]).name for row in done.json["rows"]] == [
        "autoferry13_detections.json", "b_detections.json"
    ]  # fmt: skip
    first, second = done.json["rows"]
    assert first["metrics"]["n_truth"] > 0 and second["metrics"]["n_truth"] is None
    assert "2 files are no recordings" in done.err
    again = call("batch", str(campaign / "*_detections.json"), "-o", out, "--workers", "1", "--json").json
    assert (again["runs"], again["reused"]) == (2, 2)
    assert call("table", out, "--by", "input").code == 0


def test_folders_of_the_dlr_layout_are_recordings_with_the_truth_that_is_chosen(tmp_path: Path) -> None:
    east, north = 1500.0 + 5.0 * np.arange(8), np.full(8, 900.0)
    ship = {"x": east, "y": north, "COG": np.full(8, 90.0), "SOG": np.full(8, 5.0)}
    for range_m, name in ((1700.0, "DAAN_"), (1750.0, "DARC_")):
        folder = tmp_path / "data" / name
        (folder / "radarImages").mkdir(parents=True)
        Image.new("RGB", (8, 8)).save(folder / "radarImages" / "001.png")
        steps = {str(k): [0, 0.0, [range_m + k, 1.0], [5000.0, 2.0]] for k in range(8)}
        (folder / "polarMeas.json").write_text(json.dumps(steps))
        savemat(folder / "referenceMeas.mat", {"target2": ship, "target3": ship | {"x": east + 300.0}})
    for place, names in (("data", ["DAAN_", "DARC_"]), ("data/DARC_", ["DARC_"])):
        out = tmp_path / names[0]
        done = call("batch", tmp_path / place, "--truth-match", "target3", "-o", out, "--workers", "1", "--json")
        assert [Path(row["input"]).name for row in done.json["rows"]] == names, done.err
        assert {(row["kind"], row["metrics"]["n_truth"]) for row in done.json["rows"]} == {("rwmr", 1.0)}
    assert call("batch", tmp_path / "data" / "DARC_" / "radarImages", "-o", tmp_path / "o", "--json").json["runs"] == 1


def test_places_without_a_recording_are_wrong_use(campaign: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for place in (tmp_path / "empty", campaign / "*.cat240"):
        assert "no recording there" in call("batch", place, "-o", tmp_path / "o").error
    for option in ("--segment", "--overlap", "--run-on"):
        assert {call("batch", campaign, "-o", tmp_path / "o", option, wrong).code for wrong in ("-1", "nan")} == {2}


def test_patterns_of_urls_find_recordings(tmp_path: Path) -> None:
    fsspec = pytest.importorskip("fsspec")
    octets = (SAMPLES / "autoferry13_detections.json").read_bytes()
    for name in ("a.json", "b.json"):
        with fsspec.open(f"memory://campaign/{name}", "wb") as file:
            file.write(octets)
    done = call("batch", "memory://campaign/*.json", "-o", tmp_path, "--workers", "1", "--json")
    assert done.code == 0, done.err
    assert [row["input"] for row in done.json["rows"]] == ["memory://campaign/a.json"]
    assert "1 inputs have the content of another one" in done.err
