"""Settings of radar images: where the radar is in them, what is interface, how colours mean echoes, what is a blob."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

from maritrack.errors import ConfigError
from maritrack.limits import in_unit, positive, require

COLOUR = re.compile(r"#([0-9a-fA-F]{6})(?:=([0-9.]{1,8}))?\Z")
MOST_POLYGONS, MOST_SIGMAS = 1000, 32


@dataclass(frozen=True, kw_only=True)
class ImageConfig:
    """Screenshots of a radar to points. Pixels count from 0 at the centre of the upper left one, x right, y down."""

    centre_px: tuple[float, ...] = ()  # x, y of the radar; () = not told
    pixel_m: float = 0.0  # metres a pixel; 0 = not told
    size_px: tuple[int, ...] = ()  # width, height: images of another size are left out; () = that of the first
    max_pixels: int = 40_000_000  # of an image; larger ones are left out before they are unpacked
    times: Literal["auto", "steps", "stamps", "rate"] = "auto"  # names are numbers of steps, or times; or none counts
    rate_hz: float = 1.0  # steps a second
    radius_px: float = math.inf  # the picture is within this disc
    inner_px: float = 0.0  # own ship's mark, within this of the centre
    annuli_px: tuple[tuple[float, ...], ...] = ()  # [from, to]: range rings
    polygons_px: tuple[tuple[float, ...], ...] = ()  # [x, y, x, y, ...]: panels
    lines_deg: tuple[float, ...] = ()  # bearing lines, clockwise from up
    line_width_px: float = 5.0
    palette: Literal["grey", "red", "green", "blue", "colours"] = "grey"  # what tells the strength of an echo
    colours: tuple[str, ...] = ()  # "#rrggbb=strength" of echoes, for palette = colours
    colour_distance: float = 80.0  # in RGB, 0..442: so far from its colour an echo's strength has fallen to 0
    interface: tuple[str, ...] = ()  # "#rrggbb" of lines and text: never echoes
    interface_distance: float = 30.0
    threshold: float = 0.4  # least strength of a point, 0..1; dataset, step (b)
    blob_min_m: float = 25.0  # of a blob across; dataset, step (c)
    blob_max_m: float = 150.0
    sigmas_px: tuple[float, ...] = ()  # scales of blobs; () = from blob_min_m to blob_max_m
    blob_threshold: float = 0.001  # least determinant of the Hessian, strength within 0..1
    blob_overlap: float = 0.5  # of two blobs that share more of the smaller one, this one goes
    blob_reach: float = 1.5  # points lie within so many sigma of a blob's centre
    min_pixels: int = 4  # that touch: echoes of fewer are specks

    def __post_init__(self) -> None:
        require(len(self.centre_px) in (0, 2), "images.centre_px is [x, y]")
        require(all(map(math.isfinite, self.centre_px)), "images.centre_px must be finite")
        require(0 <= self.pixel_m < math.inf, f"images.pixel_m = {self.pixel_m} must not be negative, and finite")
        require(len(self.size_px) in (0, 2), "images.size_px is [width, height]")
        require(1 <= self.max_pixels <= 400_000_000, "images.max_pixels is within 1..400000000")
        require(0 < self.rate_hz <= 1e6, "images.rate_hz is within 0..1e6")
        positive("images.radius_px", self.radius_px)
        require(0 <= self.inner_px < self.radius_px, "images.inner_px is within 0..radius_px")
        require(all(len(a) == 2 and a[0] < a[1] for a in self.annuli_px), "images.annuli_px: [[from, to], ...]")
        require(
            all(len(p) >= 6 and len(p) % 2 == 0 and all(map(math.isfinite, p)) for p in self.polygons_px),
            "images.polygons_px: [[x, y, x, y, x, y, ...], ...]",
        )
        marks = len(self.polygons_px) + len(self.annuli_px) + len(self.lines_deg)
        require(marks <= MOST_POLYGONS, f"images: at most {MOST_POLYGONS} annuli, polygons and lines")
        require(all(map(math.isfinite, self.lines_deg)), "images.lines_deg must be finite")
        require(0 < self.line_width_px < math.inf, "images.line_width_px must be greater than 0, and finite")
        require(self.palette != "colours" or len(self.colours) > 0, "images.palette = colours: images.colours = [...]")
        parse_colours(self.colours, "images.colours")
        parse_colours(self.interface, "images.interface")
        positive("images.colour_distance", self.colour_distance)
        require(self.interface_distance >= 0, "images.interface_distance must not be negative")
        in_unit("images.threshold", self.threshold)
        require(0 < self.blob_min_m <= self.blob_max_m < math.inf, "images: 0 < blob_min_m <= blob_max_m, finite")
        require(len(self.sigmas_px) <= MOST_SIGMAS, f"images.sigmas_px: at most {MOST_SIGMAS}")
        require(all(1 <= s <= 100 for s in self.sigmas_px), "images.sigmas_px are within 1..100")
        require(self.blob_threshold > 0, "images.blob_threshold must be greater than 0")
        in_unit("images.blob_overlap", self.blob_overlap)
        require(0 < self.blob_reach <= 10, "images.blob_reach is within 0..10")
        require(self.min_pixels >= 1, "images.min_pixels starts at 1")


def parse_colours(texts: tuple[str, ...], name: str) -> tuple[tuple[int, int, int, float], ...]:
    """Red, green, blue (0..255) and strength (0..1) of each `#rrggbb=strength`; without a strength it is 1."""
    found = []
    for text in texts:
        match = COLOUR.match(text)
        try:
            strength = float(match[2] or 1.0) if match else math.nan
        except ValueError:
            strength = math.nan
        if match is None or not 0 <= strength <= 1:
            raise ConfigError(f"{name}: '{text[:40]}' is not #rrggbb or #rrggbb=STRENGTH, with a strength within 0..1")
        code = int(match[1], 16)
        found.append((code >> 16, code >> 8 & 255, code & 255, strength))
    return tuple(found)
