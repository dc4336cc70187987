"""From a screenshot to points: vessels are found, hardly anything else, and each pixel is at its range and bearing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from maritrack.detect.blobs import detect_blobs, find_blobs, scales_px, under
from maritrack.detect.hessian import Blobs
from maritrack.imagesettings import ImageConfig
from maritrack.io.images.mask import picture_mask
from maritrack.io.images.palette import Palette
from maritrack.simulate.ppi import Echoes, Look, render
from maritrack.types import Picture, Scan, Sensor
from tests.ppi_scenes import DAAN, MANV, fleet, judged, settings_of

RAMP = tuple(f"#{r:02x}{g:02x}{b:02x}={(k + 1) / 3:.2f}" for k, (r, g, b) in enumerate(MANV.ramp))
GREEN = Look(width=800, height=700, centre_px=(380.5, 351.2), radius_px=320.0, pixel_m=9.0, sea=(0, 0, 0),
             ramp=((0, 120, 0), (0, 190, 0), (60, 255, 60)), ring=(60, 60, 60), text=(150, 150, 150), line=(90, 90, 90),
             panels=((4, 4, 120, 50),))  # fmt: skip


@pytest.mark.parametrize(
    ("look", "more"),
    [(DAAN, {"palette": "red"}), (MANV, {"palette": "red"}), (GREEN, {"palette": "green"}),
     (MANV, {"palette": "colours", "colours": RAMP, "colour_distance": 60.0})],
    ids=["white on blue", "yellow on blue", "green on black", "named colours"],
)  # fmt: skip
def test_of_vessels_above_three_pixels_95_in_100_are_found_with_less_than_one_false_blob_a_frame(
    look: Look, more: dict[str, object]
) -> None:
    config = settings_of(look, **more)
    mask, palette = picture_mask(config, look.width, look.height), Palette(config)
    large = found = false = 0
    frames = 10
    for seed in range(frames):
        echoes = fleet(look, n=12, seed=seed)
        pixels = render(look, echoes, seed=seed, specks=60, sea_clutter=0.05)
        strength = palette.strength(np.concatenate([pixels, pixels[:, :, :1]], axis=2)) * mask
        blobs = find_blobs(strength, look.pixel_m, config)
        counts = judged(look, echoes, strength, blobs, least=math.ceil(255 * config.threshold))
        large, found, false = large + counts[0], found + counts[1], false + counts[2]
    assert large > 8 * frames
    assert found >= 0.95 * large
    assert false < frames


def boats(look: Look, *, seed: int) -> Echoes:
    """Small and weak vessels, most of them few pixels across the beam."""
    rng = np.random.default_rng(seed)
    length_m = rng.choice([8.0, 12.0, 15.0], 12)
    return replace(
        fleet(look, n=12, seed=seed), length_m=length_m, width_m=length_m / 4, strength=rng.uniform(0.5, 1.0, 12)
    )


@pytest.mark.parametrize("look", [DAAN, MANV], ids=["12 m a pixel", "6 m a pixel"])
def test_of_boats_above_three_pixels_95_in_100_are_found_too(look: Look) -> None:
    config = settings_of(look, palette="red")
    mask, palette = picture_mask(config, look.width, look.height), Palette(config)
    large = found = 0
    for seed in range(15):
        echoes = boats(look, seed=seed)
        pixels = render(look, echoes, seed=seed, specks=60)
        strength = palette.strength(np.concatenate([pixels, pixels[:, :, :1]], axis=2)) * mask
        blobs = find_blobs(strength, look.pixel_m, config)
        counts = judged(look, echoes, strength, blobs, least=math.ceil(255 * config.threshold))
        large, found = large + counts[0], found + counts[1]
    assert large > 50 and found >= 0.95 * large


def test_an_echo_of_few_pixels_that_two_blobs_share_is_found() -> None:
    strength = np.zeros((90, 100), np.uint8)
    strength[[40, 41, 42, 43, 44], [54, 53, 52, 51, 50]] = 240
    found = find_blobs(strength, 12.0, ImageConfig())
    assert len(found.blobs) == 2 and len(found.row) == 5


def scan_of(strength: np.ndarray, *, up_rad: float = 0.0) -> Scan:
    picture = Picture(strength, (50.0, 40.0), 10.0, up_rad)
    sensor = Sensor("radar", 10.0, 0.0, math.inf)
    return Scan(sensor, 5_000_000_000, 5_000_000_000, np.array([1000.0, 2000.0]), math.nan, picture=picture)


def square(row: int, column: int) -> np.ndarray:
    strength = np.zeros((90, 100), np.uint8)
    strength[row - 2 : row + 3, column - 2 : column + 3] = 200
    return strength


@pytest.mark.parametrize(
    ("row", "column", "bearing_deg", "range_m"),
    [(10, 50, 0, 300), (40, 80, 90, 300), (70, 50, 180, 300), (40, 20, 270, 300), (20, 70, 45, 200 * math.sqrt(2))],
)
def test_points_lie_at_their_pixels_range_and_bearing(
    row: int, column: int, bearing_deg: float, range_m: float
) -> None:
    points = detect_blobs(scan_of(square(row, column)), ImageConfig(), latency_ns=10**9, max_points=1000)
    assert len(points) == 25
    at = np.argmin(np.abs(points.range_m - range_m) + np.abs(points.position_m - points.position_m.mean(axis=0)).sum(1))
    assert points.range_m[at] == pytest.approx(range_m)
    assert math.degrees(points.azimuth_rad[at]) % 360 == pytest.approx(bearing_deg % 360, abs=1e-9)
    a = math.radians(bearing_deg)
    middle = [1000 + range_m * math.sin(a), 2000 + range_m * math.cos(a)]
    assert_allclose(points.position_m.mean(axis=0), middle, atol=1e-6)
    assert_allclose(points.azimuth_width_rad * points.range_m, 10.0)
    assert np.all(points.t_ns == 4_000_000_000)


def test_a_turned_picture_is_a_turned_world() -> None:
    north = detect_blobs(scan_of(square(20, 70)), ImageConfig(), max_points=1000)
    turned = detect_blobs(scan_of(square(20, 70), up_rad=1.0), ImageConfig(), max_points=1000)
    assert_allclose(turned.azimuth_rad, north.azimuth_rad + 1.0)
    assert_allclose(turned.range_m, north.range_m)


def test_specks_are_no_blobs_and_echoes_below_the_threshold_are_not_there() -> None:
    strength = np.zeros((90, 100), np.uint8)
    strength[20, 20:23] = 255
    strength[60:66, 60:66] = 90
    assert len(detect_blobs(scan_of(strength), ImageConfig(threshold=0.4), max_points=1000)) == 0
    assert len(detect_blobs(scan_of(strength), ImageConfig(threshold=0.3), max_points=1000)) > 30
    assert len(detect_blobs(scan_of(strength), ImageConfig(min_pixels=3), max_points=1000)) == 3


def test_of_too_many_points_the_strongest_stay() -> None:
    strength = square(20, 70)
    strength[20, 68:73] = 255
    points = detect_blobs(scan_of(strength), ImageConfig(), max_points=5)
    assert points.intensity.tolist() == [255.0] * 5


def test_a_scan_without_a_picture_has_no_points() -> None:
    assert len(detect_blobs(replace(scan_of(square(20, 70)), picture=None), ImageConfig(), max_points=9)) == 0


def test_a_pixel_under_two_blobs_is_of_the_nearer_one() -> None:
    strength = np.full((30, 40), 9, np.uint8)
    seen = Blobs(np.array([15, 15]), np.array([10, 18]), np.array([4.0, 4.0]), np.array([1.0, 1.0]))
    row, column, blob = under(strength, seen, 1.5)
    assert len(set(zip(row.tolist(), column.tolist(), strict=True))) == len(row)
    assert set(blob[column < 14].tolist()) == {0} and set(blob[column > 14].tolist()) == {1}


def test_scales_follow_the_size_of_a_pixel() -> None:
    assert scales_px(25.0, 150.0, 12.34)[0] == 2.0
    fine = scales_px(25.0, 150.0, 6.0)
    assert fine[0] == pytest.approx(25 / 2 / 6, abs=1e-3) and fine[-1] == pytest.approx(150 / 2 / 6, abs=1e-3)
    assert scales_px(25.0, 25.0, 1.0) == (12.5,)
    assert max(scales_px(25.0, 1e9, 0.001)) <= 40


def test_rendered_echoes_grow_with_range_across_the_beam() -> None:
    def width(range_m: float) -> float:
        echoes = Echoes(np.array([[range_m, 0.0]]), *(np.array([x]) for x in (10.0, 5.0, 0.0, 1.0)))
        red = render(DAAN, echoes, seed=0)[:, :, 0]
        return float(np.any(red[400:640, 540:] > 200, axis=1).sum())

    assert width(5000.0) > 2 * width(1000.0)
