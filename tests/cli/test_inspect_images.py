"""`maritrack inspect-images`: its proposal is a file that `process` takes."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from tests.cli.calling import call
from tests.unit.test_imageguess import SMALL, pictures, voyage


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("frames")
    for k, pixels in enumerate(pictures(*voyage(SMALL, n=6))):
        Image.fromarray(pixels).save(path / f"{k:03d}.png")
    return path


def test_a_proposal_goes_straight_into_a_run(frames: Path, tmp_path: Path) -> None:
    done = call("inspect-images", frames, "--range", "4100m", "-o", tmp_path / "proposal.png")
    assert done.code == 0, done.err
    with Image.open(tmp_path / "proposal.png") as drawn:
        assert drawn.size == (640, 480)
    (tmp_path / "images.toml").write_text(done.out)
    run = call("process", frames, "-c", tmp_path / "images.toml", "-o", tmp_path / "run", "--no-rrd", "--json")
    assert run.code == 0, run.err
    assert run.json["counts"]["clusters"] >= 6 * 4


def test_as_json_it_says_what_it_is_not_sure_of(frames: Path) -> None:
    document = call("inspect-images", frames, "--json").json
    unsure = [note["about"] for note in document["notes"] if not note["sure"]]
    assert "pixel_m" in unsure and "centre_px" not in unsure
    assert document["frames"] == document["looked_at"] == 6
    assert document["spacing_px"] == pytest.approx(205 / 3, abs=0.5)


def test_what_is_no_folder_of_images_is_told_so(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("hello")
    assert "without images" in call("inspect-images", tmp_path).error
    wrong = call("inspect-images", tmp_path, "--range", "3 miles")
    assert wrong.code == 2 and "3 miles" in wrong.error
