"""Interface within the disc: bearing lines that stand or turn, panels, own ship's mark."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, find_objects, label, maximum_filter

from maritrack.types import BoolArray

DIFFERS = 20  # of 255 in any channel: another colour than the sea's
LINE_SHARE = 0.75  # of the way from the centre to the edge
BEARINGS = 1440
BOX_SHARE = 0.8  # of the outline of a panel
JOIN_PX = 5  # marks so near to each other are one


@dataclass(frozen=True, slots=True)
class Box:
    """A panel: its outline and how much of this is drawn."""

    x0: int
    y0: int
    x1: int
    y1: int


def sea_colour(still: NDArray[np.uint8], inside: BoolArray) -> tuple[int, int, int]:
    """The colour that most pixels of the disc have, to four levels in 256."""
    pixels = still[inside].astype(np.int64) // 4
    code = (pixels[:, 0] * 64 + pixels[:, 1]) * 64 + pixels[:, 2]
    most = int(np.bincount(code, minlength=1).argmax())
    of = pixels[code == most]
    mean = still[inside][code == most].mean(axis=0) if len(of) else np.zeros(3)
    return round(float(mean[0])), round(float(mean[1])), round(float(mean[2]))


def marked(still: NDArray[np.uint8], sea: tuple[int, int, int]) -> BoolArray:
    """Pixels (h, w) of another colour than the sea."""
    return np.asarray((np.abs(still.astype(np.int16) - np.array(sea, np.int16)) > DIFFERS).any(axis=-1))


def find_lines(marks: BoolArray, cx: float, cy: float, radius: float) -> tuple[float, ...]:
    """Bearings (degrees, clockwise from up) of lines from the centre to the edge."""
    r = np.arange(12.0, 0.97 * radius, 1.0)
    if len(r) < 20:
        return ()
    wide = maximum_filter(marks, size=3)
    a = np.arange(BEARINGS) * 2 * np.pi / BEARINGS
    x = np.rint(cx + r[None, :] * np.sin(a)[:, None]).astype(int)
    y = np.rint(cy - r[None, :] * np.cos(a)[:, None]).astype(int)
    height, width = marks.shape
    visible = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    there = wide[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)] & visible
    share = there.sum(axis=1) / np.maximum(visible.sum(axis=1), 1)
    share[visible.sum(axis=1) < 0.5 * len(r)] = 0.0
    hit = share > LINE_SHARE
    if hit.all() or not hit.any():
        return ()
    start = int(np.flatnonzero(~hit)[0])
    rolled = np.roll(hit, -start)
    part, n = label(rolled)
    found = []
    for k in range(1, n + 1):
        at = (np.flatnonzero(part == k) + start) % BEARINGS
        if len(at) > BEARINGS // 36:  # more than ten degrees: no line
            continue
        weight = share[at]
        middle = np.angle(np.sum(weight * np.exp(1j * a[at])))
        found.append(round(float(np.degrees(middle) % 360), 2) % 360)
    return tuple(sorted(found))


def along(lines: tuple[float, ...], cx: float, cy: float, shape: tuple[int, int], *, width_px: float) -> BoolArray:
    """Pixels (h, w) on these bearings."""
    x = (np.arange(shape[1]) - cx)[None, :]
    y = (np.arange(shape[0]) - cy)[:, None]
    found = np.zeros(shape, bool)
    for bearing in np.radians(lines):
        ahead, across = x * np.sin(bearing) - y * np.cos(bearing), x * np.cos(bearing) + y * np.sin(bearing)
        found |= (ahead > 0) & (np.abs(across) <= width_px / 2)
    return found


def find_boxes(marks: BoolArray, unknown: BoolArray) -> tuple[tuple[Box, ...], int]:
    """Panels with an outline or a ground of their own, and how many other marks of some size there are.

    `marks` are pixels in the disc that no ring and no line explains; what lies under these is `unknown`. A
    mark that is no rectangle may be land that stands still: it is only counted.
    """
    part, _ = label(binary_dilation(marks, iterations=JOIN_PX))
    boxes: list[Box] = []
    others = 0
    either = marks | unknown
    for where in find_objects(np.where(marks, part, 0)):
        rows, columns = where
        y0, y1, x0, x1 = rows.start, rows.stop - 1, columns.start, columns.stop - 1
        if x1 - x0 < 12 or y1 - y0 < 8:
            others += int(marks[where].sum() > 60)
            continue
        outline = np.concatenate([either[y0, x0 : x1 + 1], either[y1, x0 : x1 + 1], either[y0 : y1 + 1, x0],
                                  either[y0 : y1 + 1, x1]])  # fmt: skip
        if outline.mean() >= BOX_SHARE and len(boxes) < 40:
            boxes.append(Box(x0, y0, x1, y1))
        else:
            others += 1
    return tuple(boxes), others


def centre_mark(marks: BoolArray, cx: float, cy: float) -> float:
    """Radius of own ship's mark, 0 where there is none."""
    y, x = np.mgrid[: marks.shape[0], : marks.shape[1]]
    radius = np.hypot(x - cx, y - cy)
    near = radius < 40
    bins = radius[near].astype(int)
    share = np.bincount(bins, marks[near], 40) / np.maximum(np.bincount(bins, minlength=40), 1)
    there = np.flatnonzero(share[:30] > 0.3)
    return float(there[-1] + 2) if len(there) else 0.0
