"""Which colours are echoes: those that come and go within the disc, and what tells their strength best."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from maritrack.imagesettings import ImageConfig
from maritrack.io.images.palette import codes, strength_of
from maritrack.types import BoolArray, FloatArray

LEAST_ECHO = 60  # pixels, for anything to be said
CLEAR = 0.3  # of full scale, between the sea and half of the echoes
Channel = Literal["grey", "red", "green", "blue"]


@dataclass(frozen=True, slots=True)
class Colours:
    """What tells the strength of an echo, and how well it does."""

    palette: Literal["grey", "red", "green", "blue", "colours"]
    colours: tuple[str, ...]
    threshold: float
    clear: float  # 0..1 between sea and echoes
    n_echo: int  # pixels that this rests on


def find_colours(echo: NDArray[np.uint8], sea: NDArray[np.uint8]) -> Colours:
    """From colours of echoes (n, 3) and of the disc without them (m, 3)."""
    if len(echo) < LEAST_ECHO:
        return Colours("grey", (), 0.4, 0.0, len(echo))
    best: Colours | None = None
    for channel in _CHANNELS:
        config = ImageConfig(palette=channel)
        found = _judged(channel, (), _strength(echo, config), _strength(sea, config), len(echo))
        if best is None or found.clear > best.clear + 0.1:
            best = found
    if best is not None and best.clear >= CLEAR:
        return best
    named = dominant(echo)
    config = ImageConfig(palette="colours", colours=named)
    return _judged("colours", named, _strength(echo, config), _strength(sea, config), len(echo))


def dominant(echo: NDArray[np.uint8], *, most: int = 6) -> tuple[str, ...]:
    """The commonest colours, to 16 levels in 256, each its mean."""
    level = echo.astype(np.int64) // 16
    code = (level[:, 0] * 16 + level[:, 1]) * 16 + level[:, 2]
    count = np.bincount(code, minlength=4096)
    top = [int(c) for c in np.argsort(-count, kind="stable")[:most] if count[c] >= 0.03 * len(echo)]
    return tuple(hex_of(echo[code == c].mean(axis=0)) for c in top)


def hex_of(colour: FloatArray) -> str:
    """#rrggbb"""
    return "#" + "".join(f"{round(float(c)):02x}" for c in colour)


def echo_pixels(frames: NDArray[np.uint8], moves: BoolArray, inside: BoolArray) -> NDArray[np.uint8]:
    """Colours (n, 3) of what moves within the disc: brighter there than the median, not what it left behind."""
    return np.concatenate([frame[there & inside] for frame, there in zip(frames, moves, strict=True)])


_CHANNELS: tuple[Channel, ...] = ("grey", "red", "green", "blue")


def _strength(rgb: NDArray[np.uint8], config: ImageConfig) -> FloatArray:
    pixels = np.concatenate([rgb, rgb[:, :1]], axis=1)[None]
    return np.asarray(strength_of(codes(pixels)[0], config) / 255.0)


def _judged(
    palette: Literal["grey", "red", "green", "blue", "colours"], colours: tuple[str, ...], echo: FloatArray,
    sea: FloatArray, n: int,
) -> Colours:  # fmt: skip
    floor = float(np.quantile(sea, 0.98)) if len(sea) else 0.0
    middle, weak = float(np.median(echo)), float(np.quantile(echo, 0.25))
    threshold = min(max((floor + max(weak, (floor + middle) / 2)) / 2, floor + 0.02, 0.05), 0.95)
    return Colours(palette, colours, round(threshold, 3), middle - floor, n)
