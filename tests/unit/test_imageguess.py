"""Proposals for screenshots of many displays: right where they are sure, and not sure where they can't know."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from PIL import Image

from maritrack.config import toml_table
from maritrack.detect.blobs import find_blobs
from maritrack.errors import InputError, UsageError
from maritrack.imageguess.draw import as_toml, overlay
from maritrack.imageguess.proposal import Proposal, parse_distance, propose, spacing_of
from maritrack.imageguess.sample import Sample, sample
from maritrack.imagesettings import ImageConfig
from maritrack.io.images.mask import picture_mask
from maritrack.io.images.pack import _entry
from maritrack.io.images.palette import Palette
from maritrack.io.octets import octets_from_bytes
from maritrack.simulate.ppi import Echoes, Look, render
from tests.ppi_scenes import DAAN, MANV, fleet, judged

SMALL = Look(width=640, height=480, centre_px=(250.5, 240.25), radius_px=205.0, pixel_m=20.0, rings=3,
             panels=((470, 10, 630, 110), (470, 360, 630, 470)))  # fmt: skip
GREEN = replace(SMALL, sea=(0, 0, 0), frame=(30, 30, 30), ring=(70, 70, 70), line=(110, 110, 110), text=(140, 140, 140),
                ramp=((0, 110, 0), (0, 180, 0), (60, 255, 60)))  # fmt: skip
DAY = replace(SMALL, sea=(190, 205, 225), frame=(225, 225, 225), ring=(120, 140, 150), text=(60, 60, 60),
              line=(90, 90, 90), ramp=((170, 120, 30), (150, 80, 10), (120, 50, 0)))  # fmt: skip
OFF_CENTRE = replace(SMALL, centre_px=(330.0, 400.0), radius_px=300.0, rings=4, panels=())
ONE_RING = replace(SMALL, rings=1)
INNER_PANEL = replace(SMALL, panels=((270, 300, 350, 340), (470, 10, 630, 110)), bearing_line_deg=37.0)


def stream(pictures: Sequence[np.ndarray], *, fmt: str = "PNG", **how: Any) -> Sample:
    data = b""
    for k, pixels in enumerate(pictures):
        out = io.BytesIO()
        Image.fromarray(pixels).save(out, fmt, **how)
        data += b"".join(_entry(f"{k:03d}.png", out.getvalue(), ""))
    return sample(octets_from_bytes(data + bytes(1024), name="frames", channel=""))


def voyage(look: Look, *, n: int = 8, seed: int = 0) -> tuple[list[Look], list[Echoes]]:
    """Frames a minute apart of vessels under way."""
    way = np.random.default_rng(seed).uniform(-8, 8, (8, 2))
    echoes = fleet(look, n=8, seed=seed)
    there = [replace(echoes, position_m=echoes.position_m + way * 60 * k) for k in range(n)]
    return [look] * n, there


def pictures(looks: Sequence[Look], echoes: Sequence[Echoes]) -> list[np.ndarray]:
    return [render(look, e, seed=k, specks=30) for k, (look, e) in enumerate(zip(looks, echoes, strict=True))]


def sure(proposal: Proposal, about: str) -> bool:
    return all(note.sure for note in proposal.notes if note.about == about)


def found_share(look: Look, echoes: Echoes, pixels: np.ndarray, settings: dict[str, Any]) -> tuple[float, int]:
    """Share of the vessels within the disc that the proposed settings find, and false blobs."""
    config = ImageConfig(**(settings | {"pixel_m": look.pixel_m}))
    strength = Palette(config).strength(np.concatenate([pixels, pixels[:, :, :1]], axis=2))
    strength = strength * picture_mask(config, look.width, look.height)
    blobs = find_blobs(strength, look.pixel_m, config)
    large, found, false = judged(look, echoes, strength, blobs, least=math.ceil(255 * config.threshold))
    return found / max(large, 1), false if large else 99


@pytest.mark.parametrize(
    "look", [DAAN, MANV, SMALL, GREEN, DAY, OFF_CENTRE, ONE_RING, INNER_PANEL],
    ids=["daan", "manv", "small", "green", "day", "off-centre", "one ring", "panel within"],
)  # fmt: skip
def test_centre_disc_and_colours_are_proposed_so_that_vessels_are_found(look: Look) -> None:
    looks, echoes = voyage(look)
    frames = pictures(looks, echoes)
    proposal = propose(stream(frames), range_m=look.radius_px * look.pixel_m)
    settings = proposal.settings
    assert sure(proposal, "centre_px") and sure(proposal, "pixel_m") and sure(proposal, "palette")
    assert np.hypot(*np.subtract(settings["centre_px"], look.centre_px)) < 1.0
    assert settings["radius_px"] + 2 == pytest.approx(look.radius_px, abs=1.5)
    assert settings["pixel_m"] == pytest.approx(look.pixel_m, rel=0.01)
    assert len(settings.get("annuli_px", ())) == look.rings - 1
    shares = [found_share(look, e, f, settings) for e, f in zip(echoes, frames, strict=True)]
    assert np.mean([share for share, _ in shares]) > 0.9
    assert np.mean([false for _, false in shares]) < 1.0


def test_rings_tell_the_scale_where_their_distance_is_told() -> None:
    proposal = propose(stream(pictures(*voyage(SMALL))), ring_m=205.0 * 20.0 / 3)
    assert proposal.spacing_px == pytest.approx(205.0 / 3, abs=0.5)
    assert proposal.settings["pixel_m"] == pytest.approx(20.0, rel=0.01)


def test_without_a_distance_the_scale_is_left_open() -> None:
    proposal = propose(stream(pictures(*voyage(SMALL))))
    assert "pixel_m" not in proposal.settings and not sure(proposal, "pixel_m")
    (note,) = (note for note in proposal.notes if note.about == "pixel_m")
    assert "--range" in note.text and "0.75 NM: 6.7" in note.text


def test_lines_that_stand_still_are_masked_and_panels_too() -> None:
    settings = propose(stream(pictures(*voyage(INNER_PANEL)))).settings
    assert np.allclose(settings["lines_deg"], [0.0, 37.0], atol=0.5) or np.allclose(
        sorted((x + 180) % 360 for x in settings["lines_deg"]), [180.0, 217.0], atol=0.5
    )
    (panel,) = settings["polygons_px"]
    assert np.allclose(panel[:4], [270, 300, 350, 300], atol=5)


def test_a_line_that_turns_is_told_by_its_colour_and_does_not_pass_for_echoes() -> None:
    looks, echoes = voyage(replace(SMALL, line=(200, 60, 200)))
    looks = [replace(look, heading_line_deg=20.0 * k + 7.0) for k, look in enumerate(looks)]
    frames = pictures(looks, echoes)
    proposal = propose(stream(frames))
    assert not sure(proposal, "lines_deg")
    assert proposal.settings["interface"] == ("#c83cc8",)
    assert (
        np.mean([found_share(looks[0], e, f, proposal.settings)[0] for e, f in zip(echoes, frames, strict=True)]) > 0.85
    )


def test_jpeg_frames_are_read_as_well() -> None:
    proposal = propose(stream(pictures(*voyage(SMALL)), fmt="JPEG", quality=85))
    assert sure(proposal, "centre_px")
    assert np.hypot(*np.subtract(proposal.settings["centre_px"], SMALL.centre_px)) < 1.5


def test_where_nothing_moves_the_colours_are_not_sure() -> None:
    _, echoes = voyage(SMALL)
    for n in (1, 6):
        proposal = propose(stream([render(SMALL, echoes[0], seed=0)] * n))
        assert not sure(proposal, "palette")
        assert sure(proposal, "centre_px")
    assert not sure(proposal, "polygons_px") or proposal.settings.get("polygons_px", ()) == ()


def test_without_circles_the_centre_is_not_sure() -> None:
    rng = np.random.default_rng(0)
    plain = [np.full((200, 300, 3), 20, np.uint8) for _ in range(5)]
    for frame in plain:
        y, x = rng.integers(10, 180, 2)
        frame[y : y + 6, x : x + 6] = 200
    proposal = propose(stream(plain))
    assert not sure(proposal, "centre_px") and not sure(proposal, "radius_px")
    noise = [rng.integers(0, 255, (120, 160, 3)).astype(np.uint8) for _ in range(5)]
    assert not sure(propose(stream(noise)), "centre_px")


def test_the_proposal_is_toml_that_loads_and_can_be_drawn() -> None:
    of = stream(pictures(*voyage(INNER_PANEL)))
    proposal = propose(of, range_m=4100.0)
    table = toml_table(as_toml(proposal))["images"]
    assert tuple(table["centre_px"]) == proposal.settings["centre_px"]
    assert set(table) == set(proposal.settings)
    assert overlay(of, proposal).size == (640, 480)


def test_few_frames_are_taken_of_many_and_only_of_the_commonest_size() -> None:
    small = [np.full((20, 30, 3), k, np.uint8) for k in range(40)]
    of = stream([np.zeros((25, 30, 3), np.uint8), *small])
    assert of.count == 41 and len(of.frames) <= 12 and of.size_px == (30, 20)


def test_no_image_at_all_is_an_error() -> None:
    with pytest.raises(InputError, match="no image"):
        sample(octets_from_bytes(bytes(1024), name="x", channel=""))


@pytest.mark.parametrize(
    ("rings", "expected"),
    [((100.0, 200.0, 300.0), 100.0), ((100.4, 200.1, 299.8, 400.0), 100.0), ((150.0,), 0.0), ((), 0.0),
     ((100.0, 250.0), 0.0)],
)  # fmt: skip
def test_rings_are_evenly_spaced_or_not(rings: tuple[float, ...], expected: float) -> None:
    assert spacing_of(rings) == pytest.approx(expected, abs=0.6)


def test_distances_have_units() -> None:
    assert parse_distance("0.75NM", "--range") == 1389.0
    assert parse_distance("3 km", "--range") == 3000.0
    assert parse_distance("500", "--range") == parse_distance("500m", "--range") == 500.0
    for wrong in ("three", "-1m", "3 miles", "0", "1e9m"):
        with pytest.raises(UsageError, match="--range"):
            parse_distance(wrong, "--range")
