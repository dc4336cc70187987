"""A few frames of a recording of images, spread over it, and what stands still in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maritrack.errors import InputError
from maritrack.io.images.decode import LeftOut, decode
from maritrack.io.images.pack import IMAGE_MAGIC, ChunkFile
from maritrack.io.images.source import members
from maritrack.io.source import Octets

MOST_FRAMES, MOST_PIXELS = 12, 20_000_000  # of all of them together
MOVES = 40  # of 255, in any channel: more is another colour


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """Frames of one size, and their picture over time."""

    count: int  # images in the recording
    frames: NDArray[np.uint8]  # (f, h, w, 3)
    still: NDArray[np.uint8]  # (h, w, 3) median over the frames
    moves: NDArray[np.bool_]  # (f, h, w) where a frame differs from it

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return self.still.shape[1], self.still.shape[0]


def sample(octets: Octets, *, most: int = MOST_FRAMES, max_pixels: int = MOST_PIXELS) -> Sample:
    """Frames spread evenly over a recording, those of the commonest size; `max_pixels` is the most of one.

    InputError where none can be read."""
    names = [len(data) for _, data, _ in members(ChunkFile(iter(octets.chunks))) if data.startswith(IMAGE_MAGIC)]
    wanted = set(np.unique(np.linspace(0, len(names) - 1, most).round().astype(int)).tolist()) if names else set()
    frames: list[NDArray[np.uint8]] = []
    at, held = -1, 0
    for _, data, _ in members(ChunkFile(iter(octets.chunks))):
        at += data.startswith(IMAGE_MAGIC)
        if at not in wanted or not data.startswith(IMAGE_MAGIC):
            continue
        try:
            pixels = decode(data, max_pixels=max_pixels)
        except LeftOut:
            continue
        held += pixels.shape[0] * pixels.shape[1]
        if frames and held > MOST_PIXELS:
            break
        frames.append(np.repeat(pixels[:, :, None], 3, axis=2) if pixels.ndim == 2 else pixels[:, :, :3])
    if not frames:
        raise InputError(f"{octets.name}: no image that can be read")
    sizes = [frame.shape for frame in frames]
    commonest = max(dict.fromkeys(sizes), key=sizes.count)
    stack = np.stack([frame for frame in frames if frame.shape == commonest])
    still = np.sort(stack, axis=0)[len(stack) // 2]
    moves = (np.abs(stack.astype(np.int16) - still) > MOVES).any(axis=-1)
    return Sample(len(names), stack, still, moves)
