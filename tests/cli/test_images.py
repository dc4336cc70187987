"""Radar images through the whole program: a folder, its ZIP and its archive are one run."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from maritrack.simulate.ppi import Look, render
from tests.cli.calling import call
from tests.ppi_scenes import fleet

LOOK = Look(width=420, height=400, centre_px=(205.0, 200.0), radius_px=180.0, pixel_m=15.0, panels=())
SETTINGS = """
[images]
centre_px = [205.0, 200.0]
pixel_m = 15.0
radius_px = 178.0
inner_px = 8.0
annuli_px = [[43.5, 46.5], [88.5, 91.5], [133.5, 136.5]]
lines_deg = [0.0]
palette = "red"
"""


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Fifteen seconds of four vessels under way."""
    path = tmp_path_factory.mktemp("frames")
    echoes, way = fleet(LOOK, n=4, seed=5), np.random.default_rng(1).uniform(-9, 9, (4, 2))
    for step in range(15):
        there = replace(echoes, position_m=echoes.position_m + step * way)
        Image.fromarray(render(LOOK, there, seed=step, specks=20)).save(path / f"{step + 1:03d}.png")
    (path / "images.toml").write_text(SETTINGS)
    return path


def test_a_folder_of_images_becomes_tracks_and_its_archive_gives_the_same(frames: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    done = call("process", frames, "-c", frames / "images.toml", "-o", out, "--json")
    assert done.code == 0, done.err
    summary = done.json
    assert summary["preset"] == "dataset" and summary["counts"]["scans"] == 15
    assert summary["counts"]["warnings"]["no-image"] == 1  # the settings lie among the images
    assert summary["counts"]["track_ids_confirmed"] >= 3
    assert call("replay", out, "--verify").code == 0


def test_a_zip_of_the_folder_is_the_same_run(frames: Path, tmp_path: Path) -> None:
    path = tmp_path / "frames.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for file in sorted(frames.iterdir(), reverse=True):
            archive.write(file, file.name)
    ids = []
    for input_ in (frames, path):
        done = call("process", input_, "-c", frames / "images.toml", "-o", tmp_path / "run", "--no-rrd", "--json")
        ids.append(done.json["run_id"])
    assert ids[0] == ids[1]


def test_an_archive_of_digests_is_replayed_from_the_folder(frames: Path, tmp_path: Path) -> None:
    hashed = ("-o", tmp_path / "run", "--no-rrd", "--set", "output.archive=hash")
    assert call("process", frames, "-c", frames / "images.toml", *hashed).code == 0
    assert call("replay", tmp_path / "run", "--verify", "--input", frames).code == 0
    other = tmp_path / "other"
    other.mkdir()
    (other / "001.png").write_bytes((frames / "001.png").read_bytes())
    wrong = call("replay", tmp_path / "run", "--verify", "--input", other)
    assert wrong.code == 2 and "not the recording of this run" in wrong.err


def test_images_without_a_centre_say_what_finds_it(frames: Path) -> None:
    wrong = call("process", frames)
    assert wrong.code == 2
    assert "images.centre_px is not told" in wrong.err and "inspect-images" in wrong.err


def test_a_folder_of_images_is_shown_without_its_settings(frames: Path) -> None:
    told = call("show", frames, "--json").json
    assert told["kind"] == "images" and told["scans"] == 15
    assert told["sensors"][0]["period_s"] == 1.0
    assert told["warnings"] == {"no-image": 1}


def test_the_images_of_the_dlr_data_set_have_presets_of_their_own(frames: Path) -> None:
    for name in ("daan", "darc", "manv"):
        told = call("process", frames, "-p", f"dataset-{name}", "--limit", "1")
        assert told.code == 2 and "image-size" in told.err  # these are smaller ones
