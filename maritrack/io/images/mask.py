"""Which pixels of a screenshot are radar picture, and which are interface."""

from __future__ import annotations

import math

import numpy as np
from PIL import Image, ImageDraw

from maritrack.imagesettings import ImageConfig
from maritrack.types import BoolArray


def picture_mask(config: ImageConfig, width: int, height: int) -> BoolArray:
    """Pixels (h, w) that are left: inside the disc, off the centre, annuli, panels and bearing lines.

    Source: dataset, sec. 3.1, step (a)
    """
    x0, y0 = config.centre_px
    x = (np.arange(width) - x0)[None, :]
    y = (np.arange(height) - y0)[:, None]
    radius = np.hypot(x, y)
    keep = (radius <= config.radius_px) & (radius >= config.inner_px)
    for begin, end in config.annuli_px:
        keep &= (radius < begin) | (radius > end)
    for bearing_deg in config.lines_deg:
        east, north = math.sin(math.radians(bearing_deg)), math.cos(math.radians(bearing_deg))
        along, across = x * east - y * north, x * north + y * east
        keep &= (along < 0) | (np.abs(across) > config.line_width_px / 2)
    if config.polygons_px:
        panels = Image.new("1", (width, height))
        draw = ImageDraw.Draw(panels)
        for polygon in config.polygons_px:
            draw.polygon(polygon, fill=1)
        keep &= ~np.asarray(panels)
    return np.asarray(keep)


def reach_px(config: ImageConfig, width: int, height: int) -> float:
    """How far the picture reaches from its centre: the disc, or the farthest corner."""
    x0, y0 = config.centre_px
    corner = math.hypot(max(x0, width - 1 - x0), max(y0, height - 1 - y0))
    return min(config.radius_px, corner)
