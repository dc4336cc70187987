"""From polar video to a north-up picture in metres: one table per geometry, one `take` per scan.

A pixel takes the strongest cell of the patch of video that it covers, so that a ship of one cell
does not vanish where cells are finer than pixels: cells are pooled along the spoke, then spokes in
pairs, as often as the pixel's distance from the centre asks for (a pyramid over azimuth).
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from maritrack.geo import TWO_PI, wrap
from maritrack.types import FloatArray, Picture, Video

ByteArray = NDArray[np.uint8]

MAX_BINS = 8192
MIN_BINS = 16  # the coarsest level of the pyramid
NOT_SEEN, NOTHING = 0, 1  # grey values: no spoke came by; a spoke without an echo


@dataclass(frozen=True, slots=True, eq=False)
class Lookup:
    """Which entry of the pyramid each pixel shows; good for all scans of one geometry."""

    key: tuple[float, float, int, int, int]  # first_range_m, cell_m, cells, bins, pixels
    half_m: float  # the picture covers the sensor's position +- this
    pool: int  # cells along the spoke that become one
    columns: tuple[int, ...]  # of each level of the pyramid, 0 = level not needed
    index: NDArray[np.intp]  # (px, px) into the levels laid end to end; row 0 = north


def geometry_of(video: Video, *, pixels: int) -> tuple[float, float, int, int, int]:
    """Key of the lookup that a scan needs. Twice as many bins as spokes, so that none is missed."""
    n_spokes, n_cells = video.intensity.shape
    bins = 1 << max(2 * n_spokes - 1, MIN_BINS).bit_length()
    return (video.first_range_m, video.cell_m, n_cells, min(bins, MAX_BINS), pixels)


def make_lookup(key: tuple[float, float, int, int, int]) -> Lookup:
    """The table of one geometry; costs about as much as fifty scans, so keep it."""
    first_range_m, cell_m, n_cells, n_bins, pixels = key
    inner_m = first_range_m - cell_m / 2
    half_m = inner_m + n_cells * cell_m
    pixel_m = 2 * half_m / pixels
    patch_m = np.sqrt(2) * pixel_m  # a square of this side holds a pixel's centre however it is turned
    pool = max(1, int(np.ceil(patch_m / cell_m)))
    n_columns = -(-n_cells // pool)

    offset_m = (np.arange(pixels) + 0.5) * pixel_m - half_m
    east_m, north_m = offset_m[None, :], -offset_m[:, None]
    range_m = np.hypot(east_m, north_m)
    column = np.floor((range_m - inner_m) / (cell_m * pool)).astype(np.intp)
    azimuth = np.arctan2(east_m, north_m) % TWO_PI
    bin_ = np.minimum((azimuth * (n_bins / TWO_PI)).astype(np.intp), n_bins - 1)

    top = int(np.log2(n_bins // MIN_BINS))
    bins_per_patch = n_bins * patch_m / (TWO_PI * np.maximum(range_m, pixel_m / 2))
    level = np.clip(np.ceil(np.log2(bins_per_patch)), 0, top).astype(np.intp)
    inside = (column >= 0) & (column < n_columns)

    index = np.zeros((pixels, pixels), np.intp)
    columns = []
    start = 1  # entry 0 = not seen
    for i in range(top + 1):
        here = inside & (level == i)
        width = int(column[here].max()) + 1 if here.any() else 0
        index[here] = start + (bin_[here] >> i) * width + column[here]
        columns.append(width)
        start += (n_bins >> i) * width
    return Lookup(key, half_m, pool, tuple(columns), index)


def turned(picture: Picture, half_m: float, *, pixels: int) -> ByteArray:
    """A screenshot north-up around the radar (px, px), covering it +- half_m; NOT_SEEN beyond its edges."""
    step = 2 * half_m / pixels / picture.pixel_m
    sin, cos = np.sin(picture.up_rad), np.cos(picture.up_rad)
    x0, y0, half = picture.centre_px[0] + 0.5, picture.centre_px[1] + 0.5, half_m / picture.pixel_m
    columns = (step * cos, step * sin, x0 - half * cos - half * sin)
    rows = (-step * sin, step * cos, y0 - half * cos + half * sin)
    image = Image.fromarray(np.maximum(picture.strength, NOTHING))
    return np.asarray(image.transform((pixels, pixels), Image.Transform.AFFINE, (*columns, *rows), fillcolor=NOT_SEEN))


def to_raster(video: Video, lookup: Lookup, *, full_scale: float) -> ByteArray:
    """Grey picture (px, px) of a scan: 0 = not seen, 1 = nothing, 255 = `full_scale` and above."""
    n_bins = lookup.key[3]
    grid = to_bytes(_pool_cells(video.intensity, lookup.pool), full_scale=full_scale)
    unused = np.arange(grid.shape[1]) * lookup.pool >= video.cells_used[:, None]
    if unused.any():
        grid = np.where(unused, np.uint8(NOT_SEEN), grid)
    spoke = nearest_spoke(video.azimuth_rad, video.width_rad, n_bins=n_bins)
    grid = np.concatenate([grid, np.full((1, grid.shape[1]), NOT_SEEN, np.uint8)])[spoke]
    levels = [np.zeros(1, np.uint8)]
    for i, width in enumerate(lookup.columns):
        if i:
            keep = max(lookup.columns[i:])
            grid = np.maximum(grid[0::2, :keep], grid[1::2, :keep])
        levels.append(grid[:, :width].ravel())
    return np.take(np.concatenate(levels), lookup.index)


def to_bytes(intensity: NDArray[np.unsignedinteger[Any]], *, full_scale: float) -> ByteArray:
    """Intensities as 1..255. Deep video (over 8 bit) by its square root, as its echoes span decades."""
    if intensity.dtype == np.uint8 and full_scale == 255.0:
        same: ByteArray = np.maximum(intensity, np.uint8(NOTHING))
        return same
    if intensity.dtype == np.uint8:
        table = np.clip(np.arange(256) * (255.0 / full_scale), NOTHING, 255).astype(np.uint8)
        return np.take(table, intensity)
    share: NDArray[np.float32] = intensity.astype(np.float32) * np.float32(1.0 / full_scale)
    return np.clip(np.sqrt(share) * np.float32(255.0), NOTHING, 255).astype(np.uint8)


def full_scale(bits: int, peak: float) -> float:
    """What becomes white: the depth of the cells, or the strongest so far where that is far below."""
    depth = float((1 << bits) - 1)
    return depth if 2 * peak > depth else max(peak, 1.0)


def nearest_spoke(azimuth_rad: FloatArray, width_rad: FloatArray, *, n_bins: int) -> NDArray[np.intp]:
    """Spoke whose centre is nearest to each azimuth bin (n_bins,); len(azimuth) where none came by."""
    n = len(azimuth_rad)
    if n == 0:
        return np.zeros(n_bins, np.intp)
    centre = (np.arange(n_bins) + 0.5) * (TWO_PI / n_bins)
    order = np.argsort(azimuth_rad, kind="stable")
    ring = azimuth_rad[order]
    after = np.searchsorted(ring, centre) % n
    before = after - 1  # -1 is the last one: the ring closes
    gap_after, gap_before = np.abs(wrap(ring[after] - centre)), np.abs(wrap(ring[before] - centre))
    chosen = order[np.where(gap_after < gap_before, after, before)]
    reach = 0.75 * np.maximum(width_rad[chosen], TWO_PI / n_bins)  # half a width, and jitter
    return np.where(np.minimum(gap_after, gap_before) <= reach, chosen, n)


def _pool_cells(cells: NDArray[np.unsignedinteger[Any]], pool: int) -> NDArray[np.unsignedinteger[Any]]:
    """The strongest of every `pool` neighbours along the spoke."""
    if pool == 1:
        return cells
    spare = -cells.shape[1] % pool
    if spare:
        cells = np.pad(cells, ((0, 0), (0, spare)))
    pooled = cells[:, 0::pool]
    for i in range(1, pool):
        pooled = np.maximum(pooled, cells[:, i::pool])
    return pooled


def palette(stops: Sequence[tuple[int, tuple[int, int, int]]]) -> bytes:
    """256 colours through the given (grey, (r, g, b)) stops, as an image palette."""
    grey = [g for g, _ in stops]
    channels = [np.interp(np.arange(256), grey, [colour[i] for _, colour in stops]) for i in range(3)]
    return np.stack(channels, axis=-1).round().astype(np.uint8).tobytes()


def to_jpeg(raster: ByteArray, *, colours: bytes, quality: int = 75) -> bytes:
    """A grey picture through a palette, as the octets of a JPEG."""
    height, width = raster.shape
    image = Image.frombuffer("P", (width, height), np.ascontiguousarray(raster), "raw", "P", 0, 1)
    image.putpalette(colours)
    buffer = io.BytesIO()
    image.convert("RGB").save(buffer, "JPEG", quality=quality)
    return buffer.getvalue()
