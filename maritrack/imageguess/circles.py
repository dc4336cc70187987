"""Circles of an image about one centre: range rings, the edge of the disc, the compass frame.

The gradient of a circle's edge points to its centre: each edge pixel votes for all places on the line through it along
its gradient. The peak is refined to where the radii of the edges fall together best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from maritrack.types import BoolArray, FloatArray

EDGE = 2.5  # grey levels a pixel, after smoothing
VOTE_PX, MOST_VOTERS = 4, 6000
ANGLES = 720
FULL = 0.5  # share of a circle that has to be there
LEAST_PX = 12


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """Pixels where the colour changes, and in which direction."""

    x: FloatArray  # (n,)
    y: FloatArray  # (n,)
    gx: FloatArray  # (n,) unit gradient
    gy: FloatArray  # (n,)


def edges_of(still: NDArray[np.uint8]) -> Edges:
    """Edges of an image (h, w, 3): at each pixel those of the channel that changes most."""
    smooth = gaussian_filter(still.astype(np.float64), (1.5, 1.5, 0))
    gy, gx = np.gradient(smooth, axis=(0, 1))
    strong = np.hypot(gy, gx).argmax(axis=-1)[..., None]
    gy, gx = np.take_along_axis(gy, strong, -1)[..., 0], np.take_along_axis(gx, strong, -1)[..., 0]
    size = np.hypot(gy, gx)
    row, column = np.nonzero(size > EDGE)
    size = size[row, column]
    return Edges(column.astype(float), row.astype(float), gx[row, column] / size, gy[row, column] / size)


def find_centre(edges: Edges, width: int, height: int) -> tuple[float, float, float]:
    """x, y of the common centre of circles, and the share of edges whose gradient points to it.

    The centre may lie a quarter of the image outside.
    """
    n = len(edges.x)
    if n < 50:
        return width / 2, height / 2, 0.0
    some = slice(None, None, max(1, n // MOST_VOTERS))
    x, y, gx, gy = edges.x[some], edges.y[some], edges.gx[some], edges.gy[some]
    t = np.arange(-max(width, height), max(width, height), 3.0)
    x0, y0 = -0.25 * width, -0.25 * height
    columns, rows = int(1.5 * width) // VOTE_PX + 1, int(1.5 * height) // VOTE_PX + 1
    votes = np.zeros(rows * columns)
    for begin in range(0, len(x), 500):
        part = slice(begin, begin + 500)
        column = ((x[part, None] + t * gx[part, None] - x0) / VOTE_PX).astype(np.int64)
        row = ((y[part, None] + t * gy[part, None] - y0) / VOTE_PX).astype(np.int64)
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        votes += np.bincount((row * columns + column)[inside], minlength=rows * columns)
    smooth = gaussian_filter(votes.reshape(rows, columns), 1.5)
    row0, column0 = np.unravel_index(int(smooth.argmax()), smooth.shape)
    cx, cy = x0 + (float(column0) + 0.5) * VOTE_PX, y0 + (float(row0) + 0.5) * VOTE_PX
    for reach, step in ((8.0, 2.0), (2.0, 0.5), (0.5, 0.25)):
        offsets = np.arange(-reach, reach + step / 2, step)
        tried = [(cx + dx, cy + dy) for dy in offsets for dx in offsets]
        cx, cy = max(tried, key=lambda c: _sharpness(edges, *c))
    return float(cx), float(cy), float(_radial(edges, cx, cy).mean())


def find_circles(edges: Edges, cx: float, cy: float, width: int, height: int) -> list[tuple[float, float]]:
    """Radius of each circle about a centre, ascending, and the share of it (of what is in the image) that is there."""
    radial = _radial(edges, cx, cy)
    dx, dy = edges.x[radial] - cx, edges.y[radial] - cy
    radius = np.hypot(dx, dy)
    most = int(np.hypot(max(cx, width - cx), max(cy, height - cy))) + 2
    angle = ((np.arctan2(dx, -dy) % (2 * np.pi)) * ANGLES / (2 * np.pi)).astype(int) % ANGLES
    there = np.zeros((most + 3, ANGLES), bool)
    for shift in (0, 1):
        there[np.clip(radius.astype(int) + shift, 0, most + 2), angle] = True
    r = np.arange(most + 3)[:, None]
    a = (np.arange(ANGLES) + 0.5) * 2 * np.pi / ANGLES
    x, y = cx + r * np.sin(a), cy - r * np.cos(a)
    visible = (x >= 2) & (x < width - 2) & (y >= 2) & (y < height - 2)
    total = visible.sum(axis=1)
    share = np.where(total > ANGLES / 8, (there & visible).sum(axis=1) / np.maximum(total, 1), 0.0)
    found = []
    for begin, end in _runs(share > FULL):
        if end - begin <= 12 and begin >= LEAST_PX:
            inside = (radius >= begin - 0.5) & (radius < end + 0.5)
            found.append((float(np.median(radius[inside])), float(share[begin:end].max())))
    return found


def _radial(edges: Edges, cx: float, cy: float) -> BoolArray:
    """Edges whose gradient points to the centre or away from it."""
    dx, dy = edges.x - cx, edges.y - cy
    along = np.abs(dx * edges.gx + dy * edges.gy)
    return np.asarray(along > 0.98 * np.hypot(dx, dy))


def _sharpness(edges: Edges, cx: float, cy: float) -> float:
    """How much the radii of radial edges fall together."""
    radial = _radial(edges, cx, cy)
    radius = np.hypot(edges.x[radial] - cx, edges.y[radial] - cy)
    histogram = np.bincount((radius * 2).astype(int)).astype(float)
    return float((histogram**2).sum())


def _runs(flags: BoolArray) -> list[tuple[int, int]]:
    """Begin and end (exclusive) of each run of True."""
    padded = np.concatenate([[False], flags, [False]])
    change = np.flatnonzero(padded[1:] != padded[:-1])
    return list(zip(change[::2].tolist(), change[1::2].tolist(), strict=True))
