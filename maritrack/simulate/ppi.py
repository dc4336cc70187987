"""Screenshots of a radar: echoes in their colours under the interface of a display.

The picture is drawn in pixels: background, disc, echoes smeared by beam and pulse, range rings, compass frame with
numbers, heading and bearing lines, own ship's mark, panels of text. Equal input, seed and Pillow give equal images.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from maritrack.types import FloatArray, check_lengths

Colour = tuple[int, int, int]
REACH = 3.0  # standard deviations of an echo that are drawn


@dataclass(frozen=True, slots=True, eq=False)
class Echoes:
    """What the radar sees in one turn: bodies as ellipses, from the radar, east-north."""

    position_m: FloatArray  # (n, 2)
    length_m: FloatArray  # (n,)
    width_m: FloatArray  # (n,)
    heading_rad: FloatArray  # (n,)
    strength: FloatArray  # (n,) at the centre, 0..1; above 1 the receiver is saturated

    def __post_init__(self) -> None:
        check_lengths(self, len(self.position_m), "length_m", "width_m", "heading_rad", "strength")

    def __len__(self) -> int:
        return len(self.position_m)


@dataclass(frozen=True, kw_only=True)
class Look:
    """How a display looks. Pixels: x right, y down, from the upper left pixel's centre."""

    width: int = 1050
    height: int = 1024
    centre_px: tuple[float, float] = (512.0, 516.0)
    radius_px: float = 466.0  # of the picture; the compass frame is around it
    pixel_m: float = 12.34
    rings: int = 4  # evenly spaced, the last one at radius_px
    frame: Colour = (24, 24, 32)  # around the disc
    sea: Colour = (0, 0, 48)  # of the disc
    ramp: tuple[Colour, ...] = ((70, 70, 110), (150, 150, 170), (240, 240, 245))  # echoes, weak to strong
    ring: Colour = (0, 90, 60)
    text: Colour = (0, 170, 110)
    heading_line_deg: float | None = 0.0  # clockwise from up
    bearing_line_deg: float | None = None
    line: Colour = (0, 140, 90)
    panels: tuple[tuple[int, int, int, int], ...] = ((4, 4, 150, 60), (900, 940, 1045, 1018))  # x0, y0, x1, y1
    up_deg: float = 0.0  # bearing of what is up: 0 north-up, the heading for head-up
    beam_deg: float = 1.0  # width between half powers
    pulse_m: float = 20.0

    @property
    def sigma_range_m(self) -> float:
        """Standard deviation that the range of an echo has of its pixel and its pulse, each evenly spread."""
        return math.hypot(self.pixel_m, self.pulse_m) / math.sqrt(12.0)


def render(
    look: Look, echoes: Echoes, *, seed: int, specks: int = 0, sea_clutter: float = 0.0, caption: str = ""
) -> NDArray[np.uint8]:
    """One screenshot (h, w, 3).

    `specks` single pixels of noise anywhere; `sea_clutter` is the share of pixels near the radar that returns,
    falling off with range. `caption` stands in the first panel.
    """
    rng = np.random.default_rng(seed)
    strength = echo_strength(look, echoes)
    radius = _radius(look)
    inside = radius <= look.radius_px
    if sea_clutter > 0:
        near = rng.random(radius.shape) < sea_clutter * np.exp(-radius / (0.12 * look.radius_px))
        strength = np.maximum(strength, np.where(near, rng.uniform(0.2, 0.8, radius.shape), 0.0))
    if specks:
        angle, away = rng.uniform(0, 2 * np.pi, specks), look.radius_px * np.sqrt(rng.random(specks)) * 0.98
        row = np.rint(look.centre_px[1] + away * np.sin(angle)).astype(int)
        column = np.rint(look.centre_px[0] + away * np.cos(angle)).astype(int)
        there = (row >= 0) & (row < look.height) & (column >= 0) & (column < look.width)
        strength[row[there], column[there]] = np.maximum(
            strength[row[there], column[there]], rng.uniform(0.4, 1.0, int(there.sum()))
        )
    levels = len(look.ramp)
    level = np.minimum((np.clip(strength, 0, 1) * (levels + 1)).astype(int), levels)
    table = np.array([look.sea, *look.ramp], np.uint8)
    picture = np.where(inside[:, :, None], table[level], np.array(look.frame, np.uint8))
    return _interface(picture.astype(np.uint8), look, caption)


def echo_strength(look: Look, echoes: Echoes) -> FloatArray:
    """Echo strength (h, w) by pixel: bodies smeared across by the beam and along the range by the pulse."""
    strength = np.zeros((look.height, look.width))
    for k in range(len(echoes)):
        centre, cov = echo_pixels(look, echoes, k)
        half = REACH * np.sqrt(np.diag(cov))
        x0, y0 = np.maximum(np.floor(centre - half).astype(int), 0)
        x1 = min(int(np.ceil(centre[0] + half[0])) + 1, look.width)
        y1 = min(int(np.ceil(centre[1] + half[1])) + 1, look.height)
        if x0 >= x1 or y0 >= y1:
            continue
        d = np.stack(np.meshgrid(np.arange(x0, x1), np.arange(y0, y1)), axis=-1) - centre
        square = np.einsum("hwi,ij,hwj->hw", d, np.linalg.inv(cov), d)
        patch = float(echoes.strength[k]) * np.exp(-0.5 * square)
        strength[y0:y1, x0:x1] = np.maximum(strength[y0:y1, x0:x1], patch)
    return strength


def echo_pixels(look: Look, echoes: Echoes, k: int) -> tuple[FloatArray, FloatArray]:
    """Centre (2,) and covariance (2, 2) of an echo in pixels, x right and y down."""
    up = math.radians(look.up_deg)
    east, north = echoes.position_m[k]
    range_m, azimuth = math.hypot(east, north), math.atan2(east, north) - up
    ahead = float(echoes.heading_rad[k]) - up
    across_m = range_m * math.radians(look.beam_deg) / 2.355

    def spread(angle: float, along: float, across: float) -> FloatArray:
        axis = np.array([[math.sin(angle), math.cos(angle)], [-math.cos(angle), math.sin(angle)]])  # x right, y down
        return np.asarray(axis @ np.diag([along**2, across**2]) @ axis.T)

    cov = spread(ahead, float(echoes.length_m[k]) / 4, float(echoes.width_m[k]) / 4)
    cov = cov + spread(azimuth, look.pulse_m / 3.46, across_m)
    centre = np.array(look.centre_px) + range_m / look.pixel_m * np.array([math.sin(azimuth), -math.cos(azimuth)])
    return centre, cov / look.pixel_m**2 + np.eye(2) / 12


def _radius(look: Look) -> FloatArray:
    x = np.arange(look.width) - look.centre_px[0]
    y = np.arange(look.height) - look.centre_px[1]
    return np.asarray(np.hypot(x[None, :], y[:, None]))


def _interface(picture: NDArray[np.uint8], look: Look, caption: str) -> NDArray[np.uint8]:
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default()
    x, y = look.centre_px
    for k in range(1, look.rings + 1):
        r = look.radius_px * k / look.rings
        draw.ellipse((x - r, y - r, x + r, y + r), outline=look.ring)
    for degree in range(0, 360, 5):
        sin, cos = math.sin(math.radians(degree)), math.cos(math.radians(degree))
        long = 12 if degree % 10 == 0 else 6
        begin, end = look.radius_px + 2, look.radius_px + 2 + long
        draw.line((x + begin * sin, y - begin * cos, x + end * sin, y - end * cos), fill=look.text)
        if degree % 30 == 0:
            told = f"{round(degree + look.up_deg) % 360:03d}"
            draw.text((x + (end + 12) * sin, y - (end + 12) * cos), told, fill=look.text, font=font, anchor="mm")
    for line_deg, reach in ((look.heading_line_deg, 1.0), (look.bearing_line_deg, 1.0)):
        if line_deg is not None:
            sin, cos = math.sin(math.radians(line_deg)), math.cos(math.radians(line_deg))
            end = look.radius_px * reach
            draw.line((x, y, x + end * sin, y - end * cos), fill=look.line)
    draw.ellipse((x - 4, y - 4, x + 4, y + 4), outline=look.line)
    for k, (x0, y0, x1, y1) in enumerate(look.panels):
        draw.rectangle((x0, y0, x1, y1), fill=look.frame, outline=look.text)
        range_m = look.radius_px * look.pixel_m
        told = caption if k == 0 else f"RANGE {range_m / 1852:.2f} NM\nRINGS {range_m / look.rings / 1852:.2f} NM"
        draw.multiline_text((x0 + 6, y0 + 5), told or "RADAR 1  X-BAND\nGAIN 62  SEA 40", fill=look.text, font=font)
    return np.asarray(image)
