"""Colours to the strength of an echo: grey, one channel, or how near a pixel is to named colours."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from maritrack.imagesettings import ImageConfig, parse_colours

GREY = (0.299, 0.587, 0.114)  # ITU-R BT.601: red, green, blue
CHANNEL = {"red": 0, "green": 1, "blue": 2}
UNKNOWN = -1
Bytes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Palette:
    """The strength of each colour, worked out when it is first seen and then looked up."""

    config: ImageConfig
    _known: NDArray[np.int16] = field(default_factory=lambda: np.full(1 << 24, UNKNOWN, np.int16))

    def strength(self, pixels: Bytes) -> Bytes:
        """Strength (h, w) in 0..255 of grey (h, w) or coloured (h, w, 4) pixels.

        Source: dataset, sec. 3.1, step (a)
        """
        if pixels.ndim == 2:
            if self.config.palette != "colours" and not self.config.interface:
                return pixels
            pixels = np.repeat(pixels[:, :, None], 4, axis=2)
        code = codes(pixels)
        found = self._known[code]
        new = np.unique(code[found == UNKNOWN])
        if len(new):
            self._known[new] = strength_of(new, self.config)
            found = self._known[code]
        return found.astype(np.uint8)


def codes(pixels: Bytes) -> NDArray[np.uint32]:
    """Pixels (..., 4) as one number each: 65536 red + 256 green + blue."""
    whole = np.ascontiguousarray(pixels).view("<u4" if sys.byteorder == "little" else ">u4")[..., 0]
    if sys.byteorder == "big":
        return np.asarray(whole >> np.uint32(8))
    swapped = whole.byteswap()
    return np.asarray(swapped >> np.uint32(8))


def strength_of(code: NDArray[np.uint32], config: ImageConfig) -> NDArray[np.int16]:
    """Strength (n,) in 0..255 of colours (n,)."""
    rgb = np.stack([code >> 16, code >> 8 & 255, code & 255], axis=-1).astype(np.float64)
    if config.palette == "grey":
        strength = rgb @ np.array(GREY)
    elif config.palette == "colours":
        strength = np.zeros(len(rgb))
        for *colour, full in parse_colours(config.colours, "images.colours"):
            away = np.linalg.norm(rgb - np.array(colour), axis=-1)
            strength = np.maximum(strength, 255.0 * full * (1.0 - away / config.colour_distance))
    else:
        strength = rgb[:, CHANNEL[config.palette]]
    for *colour, _ in parse_colours(config.interface, "images.interface"):
        strength[np.linalg.norm(rgb - np.array(colour), axis=-1) <= config.interface_distance] = 0.0
    return np.asarray(np.clip(np.rint(strength), 0, 255).astype(np.int16))
