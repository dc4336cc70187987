"""A proposal as TOML, and drawn over one of the frames."""

from __future__ import annotations

import math
from typing import Any

from PIL import Image, ImageDraw

from maritrack.imageguess.proposal import Proposal
from maritrack.imageguess.sample import Sample
from maritrack.imagesettings import ImageConfig
from maritrack.io.images.mask import picture_mask

DISC, RING, LINE, PANEL = (255, 60, 60), (255, 0, 255), (255, 140, 0), (0, 220, 255)


def as_toml(proposal: Proposal) -> str:
    """The settings as a TOML table, with what each rests on as comments."""
    rows = ["[images]"]
    for note in proposal.notes:
        rows.append(f"# {note.about}: {'' if note.sure else 'NOT SURE, '}{note.text}")
    rows += [f"{key} = {_value(value)}" for key, value in proposal.settings.items()]
    if "pixel_m" not in proposal.settings:
        rows.append("# pixel_m = ")
    return "\n".join(rows) + "\n"


def _value(value: Any) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    return f'"{value}"' if isinstance(value, str) else repr(value)


def overlay(of: Sample, proposal: Proposal) -> Image.Image:
    """The last frame with what would be masked darkened, and disc, rings, lines and panels drawn."""
    frame = of.frames[-1].copy()
    settings = proposal.settings
    mask = picture_mask(ImageConfig(**{"pixel_m": 1.0} | settings), *of.size_px)
    frame[~mask] = frame[~mask] // 2
    image = Image.fromarray(frame)
    draw = ImageDraw.Draw(image)
    x, y = settings["centre_px"]

    def circle(r: float, colour: tuple[int, int, int]) -> None:
        draw.ellipse((x - r, y - r, x + r, y + r), outline=colour)

    circle(settings["radius_px"], DISC)
    for ring in proposal.rings_px:
        circle(ring, RING)
    if "inner_px" in settings:
        circle(settings["inner_px"], DISC)
    for bearing in map(math.radians, settings.get("lines_deg", ())):
        far = settings["radius_px"]
        draw.line((x, y, x + far * math.sin(bearing), y - far * math.cos(bearing)), fill=LINE)
    for polygon in settings.get("polygons_px", ()):
        draw.polygon(polygon, outline=PANEL)
    draw.line((x - 15, y, x + 15, y), fill=DISC)
    draw.line((x, y - 15, x, y + 15), fill=DISC)
    return image
