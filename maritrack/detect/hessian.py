"""Blobs as maxima of the determinant of the Hessian over place and scale, by box filters on an integral image.

What scikit-image calls `blob_doh` (Bay et al. 2008), worked out only where there is an echo near: a picture of a
radar is dark almost everywhere. Sums are whole numbers, so that equal pictures have equal blobs to the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d
from scipy.spatial import cKDTree

from maritrack.types import BoolArray, FloatArray, IntArray

BLOCK = 8  # pixels: near an echo or not is told for blocks of this side
DENSE_SHARE = 0.3  # of pixels near an echo, from which on all of them are worked out
MOST_PEAKS = 5000  # the strongest: more are noise all over, whose pairs would fill the memory
CROSS = 0.81  # weight of the mixed derivative: boxes respond otherwise than Gaussians

Corner = Callable[[int, int], NDArray[np.int64]]


@dataclass(frozen=True, slots=True, eq=False)
class Blobs:
    """Blobs of a picture, the strongest first."""

    row: IntArray  # (b,)
    column: IntArray  # (b,)
    sigma_px: FloatArray  # (b,) scale, and about the radius
    value: FloatArray  # (b,) determinant of the Hessian, of a picture within 0..1

    def __len__(self) -> int:
        return len(self.row)


def blobs(strength: NDArray[np.uint8], sigmas_px: Sequence[float], *, threshold: float, overlap: float) -> Blobs:
    """Blobs of a picture (h, w), full scale 255, at scales `sigmas_px` in ascending order.

    Determinants must exceed `threshold`; of two blobs that share more than `overlap` of the smaller one, the one of
    the smaller scale goes. Of more than `MOST_PEAKS` maxima the strongest count.   Source: dataset, sec. 3.1, step (c)
    """
    height, width = strength.shape
    edge = max(_reach(sigma) for sigma in sigmas_px) + 1
    sums = integral(strength, edge)
    echo = np.flatnonzero(strength)
    cube = np.zeros((len(sigmas_px), height + 2, width + 2))  # a border of 0 all around
    found = []
    for k, sigma in enumerate(sigmas_px):
        at = near(strength, echo, sigma, threshold)
        layer = cube[k].reshape(-1)
        if at is None:
            value = determinant(_slices(sums, edge, strength.shape), sigma)
            cube[k, 1:-1, 1:-1] = value
            row, column = np.nonzero(value > threshold)
            inner = (row + 1) * (width + 2) + column + 1
        else:
            row, column = np.divmod(at, width)
            value = determinant(_gather(sums, (row + edge) * sums.shape[1] + column + edge), sigma)
            inner = (row + 1) * (width + 2) + column + 1
            layer[inner] = value
            inner = inner[value > threshold]
        found.append(k * cube[0].size + inner)
    peak = _local_maxima(cube, np.concatenate(found) if found else np.zeros(0, np.int64))
    value = cube.reshape(-1)[peak]
    peak = peak[np.lexsort((peak, -value))][:MOST_PEAKS]
    scale, within = np.divmod(peak, cube[0].size)
    row, column = np.divmod(within, width + 2)
    place, value = _spaced(np.stack([row - 1, column - 1, scale], axis=-1), cube.reshape(-1)[peak])
    sigma_px = np.asarray(sigmas_px, np.float64)[place[:, 2]]
    keep = unshared(place[:, :2], sigma_px, overlap)
    return Blobs(place[keep, 0], place[keep, 1], sigma_px[keep], value[keep])


def integral(strength: NDArray[np.uint8], edge: int) -> NDArray[np.int64]:
    """Sums over all pixels above and left (inclusive), continued by `edge` pixels at each side.

    So the picture is dark beyond its edges. (scikit-image shifts boxes that begin beyond the upper or left edge.)
    """
    whole = np.int32 if strength.size * 255 < 2**31 else np.int64
    sums = np.cumsum(np.cumsum(strength, axis=0, dtype=whole), axis=1, dtype=whole)
    padded: NDArray[np.int64] = np.pad(np.pad(sums, ((edge, 0), (edge, 0))), ((0, edge), (0, edge)), mode="edge")
    return padded


def determinant(corner: Corner, sigma: float) -> FloatArray:
    """Determinant of the Hessian, from a function that gives the integral image moved by rows and columns.

    Second derivatives are differences of boxes: three lobes of a third of the filter's side each, and four squares.
    """
    side = int(3 * sigma)
    third, half = side // 3, (side - 1) // 2

    def box(row: int, column: int, rows: int, columns: int) -> NDArray[np.int64]:
        total = corner(row, column) + corner(row + rows, column + columns)
        total = total - corner(row, column + columns) - corner(row + rows, column)
        return np.asarray(np.maximum(total, 0))

    cross = box(-third, 1, third, third) + box(1, -third, third, third)
    cross = cross - box(-third, -third, third, third) - box(1, 1, third, third)
    flat = 2 * third - 1
    across = box(-third + 1, -half, flat, side) - 3 * box(-third + 1, -(third // 2), flat, third)
    along = box(-half, -third + 1, side, flat) - 3 * box(-(third // 2), -third + 1, third, flat)
    scale = (1.0 / (255.0 * side * side)) ** 2
    product = across.astype(np.float64) * along
    return np.asarray((product - CROSS * np.square(cross.astype(np.float64))) * scale)


def near(strength: NDArray[np.uint8], echo: IntArray, sigma: float, threshold: float) -> IntArray | None:
    """Flat indices of the pixels whose determinant may exceed a threshold, by blocks; None where they are too many.

    A second derivative is at most twice the sum of what is under its filter, over the filter's area: where blocks
    within its reach hold less than the root of the threshold asks for, there is nothing to be found.
    """
    height, width = strength.shape
    rows, columns = -(-height // BLOCK), -(-width // BLOCK)
    row, column = np.divmod(echo, width)
    block = (row // BLOCK) * columns + column // BLOCK
    held = np.bincount(block, strength.reshape(-1)[echo], rows * columns).reshape(rows, columns)
    window = np.ones(2 * -(-_reach(sigma) // BLOCK) + 1)
    for axis in (0, 1):
        held = correlate1d(held, window, axis=axis, mode="constant")
    least = 255.0 * int(3 * sigma) ** 2 * math.sqrt(threshold) / 2
    block_row, block_column = np.nonzero(held >= least * (1 - 1e-9))
    if len(block_row) > DENSE_SHARE * rows * columns:
        return None
    step = np.arange(BLOCK)
    row = (block_row[:, None, None] * BLOCK + step[None, :, None]) + np.zeros(BLOCK, np.int64)
    column = block_column[:, None, None] * BLOCK + step[None, None, :] + np.zeros((BLOCK, 1), np.int64)
    inside = (row < height) & (column < width)
    return np.asarray((row * width + column)[inside])


def unshared(place: IntArray, sigma_px: FloatArray, overlap: float) -> BoolArray:
    """Which blobs (b,) stay: of two discs of radius sqrt(2) sigma that overlap too much the larger scale does."""
    keep = np.ones(len(place), np.bool_)
    if len(place) < 2:
        return keep
    pairs = cKDTree(place).query_pairs(2 * math.sqrt(2) * float(sigma_px.max()), output_type="ndarray")
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    i, j = pairs[:, 0], pairs[:, 1]
    apart = np.linalg.norm((place[i] - place[j]).astype(np.float64), axis=-1)
    too_much = shared(apart, math.sqrt(2) * sigma_px[i], math.sqrt(2) * sigma_px[j]) > overlap
    for a, b in pairs[too_much].tolist():
        if keep[a] and keep[b]:
            keep[b if sigma_px[a] > sigma_px[b] else a] = False
    return keep


def shared(apart: FloatArray, r1: FloatArray, r2: FloatArray) -> FloatArray:
    """Area that two discs share (n,), as a share of the smaller one."""
    small, large = np.minimum(r1, r2), np.maximum(r1, r2)
    d = np.clip(apart, np.maximum(large - small, 1e-12), small + large)
    a = np.arccos(np.clip((d * d + small**2 - large**2) / (2 * d * small), -1.0, 1.0))
    b = np.arccos(np.clip((d * d + large**2 - small**2) / (2 * d * large), -1.0, 1.0))
    lens = small**2 * (a - np.sin(2 * a) / 2) + large**2 * (b - np.sin(2 * b) / 2)
    return np.where(apart <= large - small, 1.0, lens / (math.pi * small**2))


def _reach(sigma: float) -> int:
    """Pixels from the centre of the filter to beyond its end."""
    return int(3 * sigma) // 2 + 2


def _slices(sums: NDArray[np.int64], edge: int, shape: tuple[int, int]) -> Corner:
    height, width = shape
    return lambda row, column: sums[edge + row : edge + row + height, edge + column : edge + column + width]


def _gather(sums: NDArray[np.int64], at: IntArray) -> Corner:
    flat, width = sums.reshape(-1), sums.shape[1]
    return lambda row, column: flat[at + (row * width + column)]


def _local_maxima(cube: FloatArray, at: IntArray) -> IntArray:
    """Of the flat indices those whose value none of the 26 neighbours in place and scale exceeds."""
    flat = cube.reshape(-1)
    _, rows, columns = cube.shape
    layer = rows * columns
    for dk in (0, -1, 1):
        for dr in (0, -1, 1):
            for dc in (0, -1, 1):
                other = at + (dk * layer + dr * columns + dc)
                there = (other >= 0) & (other < flat.size)
                at = at[~there | (flat[at] >= flat[np.where(there, other, at)])]
    return at


def _spaced(place: IntArray, value: FloatArray) -> tuple[IntArray, FloatArray]:
    """Of maxima that touch each other, which have one value, the first."""
    if len(place) < 2:
        return place, value
    keep = np.ones(len(place), np.bool_)
    pairs = cKDTree(place).query_pairs(1.0, p=math.inf, output_type="ndarray")
    for a, b in pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].tolist():
        if keep[a]:
            keep[b] = False
    return place[keep], value[keep]
