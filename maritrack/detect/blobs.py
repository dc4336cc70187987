"""A picture of a radar to points: threshold, blobs, and the pixels under each blob.

Fowdur, Baum, Heymann 2021, section 3.1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from maritrack.detect.cells import empty_points
from maritrack.detect.hessian import Blobs, blobs
from maritrack.geo import polar_to_en, wrap_positive
from maritrack.imagesettings import ImageConfig
from maritrack.types import FloatArray, IntArray, Points, Scan, take

FACTOR = 1.6  # from one scale to the next
LEAST_SIGMA, MOST_SIGMA = 2.0, 40.0


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What is under the blobs of a picture."""

    blobs: Blobs
    row: IntArray  # (n,) pixels, by rows
    column: IntArray  # (n,)
    blob: IntArray  # (n,) the blob of each


def detect_blobs(scan: Scan, config: ImageConfig, *, latency_ns: int = 0, max_points: int) -> Points:
    """Points of a scan's picture in range and bearing, by rows of the picture. No blob, no points.

    A picture with more than `max_points` keeps the strongest of them.   Source: dataset, sec. 3.1, step (d)
    """
    picture = scan.picture
    if picture is None:
        return empty_points()
    found = find_blobs(picture.strength, picture.pixel_m, config)
    x = found.column - picture.centre_px[0]
    y = found.row - picture.centre_px[1]
    range_m = picture.pixel_m * np.hypot(x, y)
    azimuth = wrap_positive(np.arctan2(x, -y) + picture.up_rad)
    n = len(range_m)
    points = Points(
        range_m=range_m,
        azimuth_rad=azimuth,
        position_m=scan.position_m + polar_to_en(range_m, azimuth),
        intensity=picture.strength[found.row, found.column].astype(np.float64),
        t_ns=np.full(n, scan.t_ns - latency_ns, np.int64),
        range_width_m=np.full(n, picture.pixel_m),
        azimuth_width_rad=picture.pixel_m / np.maximum(range_m, picture.pixel_m),
    )
    if n <= max_points:
        return points
    return take(points, np.sort(np.argsort(-points.intensity, kind="stable")[:max_points]))


def find_blobs(strength: NDArray[np.uint8], pixel_m: float, config: ImageConfig) -> Found:
    """Blobs, and their points: pixels over the threshold within a blob's reach, each of the nearest blob.

    What is below the threshold, and echoes of fewer than `min_pixels` that touch, are taken out before blobs are looked
    for; so a blob may have fewer where it shares an echo with others.   Source: dataset, sec. 3.1, step (b)
    """
    least = max(1, math.ceil(255.0 * config.threshold))
    left = without_specks(np.where(strength >= least, strength, np.uint8(0)), config.min_pixels)
    scales = config.sigmas_px or scales_px(config.blob_min_m, config.blob_max_m, pixel_m)
    seen = blobs(left, sorted(scales), threshold=config.blob_threshold, overlap=config.blob_overlap)
    row, column, blob = under(left, seen, config.blob_reach)
    some = np.bincount(blob, minlength=len(seen)) > 0
    return Found(take(seen, some), row, column, (np.cumsum(some) - 1)[blob])


def without_specks(strength: NDArray[np.uint8], min_pixels: int) -> NDArray[np.uint8]:
    """The picture without echoes of fewer pixels, which touch by sides or corners."""
    if min_pixels <= 1:
        return strength
    part, n = label(strength, structure=np.ones((3, 3)))
    flat = part.reshape(-1)
    echo = np.flatnonzero(flat)
    size = np.bincount(flat[echo], minlength=n + 1)
    left = strength.copy()
    left.reshape(-1)[echo[size[flat[echo]] < min_pixels]] = 0
    return left


def scales_px(blob_min_m: float, blob_max_m: float, pixel_m: float) -> tuple[float, ...]:
    """Few scales for blobs of these lengths: sigma is half of the length across, in steps of a factor."""
    first = min(max(blob_min_m / 2 / pixel_m, LEAST_SIGMA), MOST_SIGMA)
    last = min(max(blob_max_m / 2 / pixel_m, first), MOST_SIGMA)
    steps = round(math.log(last / first) / math.log(FACTOR))
    return tuple(round(first * (last / first) ** (k / max(steps, 1)), 3) for k in range(steps + 1))


def under(strength: NDArray[np.uint8], seen: Blobs, reach: float) -> tuple[IntArray, IntArray, IntArray]:
    """Row, column and blob of each pixel that is not 0 within reach of a blob; of several the nearest for its size."""
    height, width = strength.shape
    parts: list[tuple[IntArray, IntArray, FloatArray]] = []
    for sigma in np.unique(seen.sigma_px).tolist():
        which = np.flatnonzero(seen.sigma_px == sigma)
        r = int(reach * sigma)
        dy, dx = np.mgrid[-r : r + 1, -r : r + 1].reshape(2, -1)
        away = np.hypot(dy, dx) / sigma
        inside = away <= reach
        row = seen.row[which, None] + dy[inside]
        column = seen.column[which, None] + dx[inside]
        there = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        there &= strength[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)] > 0
        shape = row.shape
        blob, far = np.broadcast_to(which[:, None], shape)[there], np.broadcast_to(away[inside], shape)[there]
        parts.append(((row * width + column)[there], blob, far))
    if not parts:
        nothing = np.zeros(0, np.int64)
        return nothing, nothing, nothing
    pixel, blob, far = (np.concatenate([part[i] for part in parts]) for i in range(3))
    order = np.lexsort((blob, far, pixel))
    pixel, first = np.unique(pixel[order], return_index=True)
    row, column = np.divmod(pixel, width)
    return row, column, blob[order][first]
