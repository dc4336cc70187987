"""Radar video to points: amplitude threshold, and cell-averaging or ordered-statistic CFAR along range."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maritrack.settings import DetectConfig
from maritrack.types import BoolArray, FloatArray, IntArray, Points, Scan, Video

SATURATED_SHARE = 0.25  # of the non-zero cells at full scale: a recording that is practically one bit


def detect_cells(scan: Scan, config: DetectConfig, *, latency_ns: int = 0) -> Points:
    """Points of a scan's video, in the order of its spokes, then range. Positions are east-north metres.

    A scan that has more than `max_points` cells over the threshold keeps the strongest of them.
    """
    video = scan.video
    if video is None:
        return empty_points()
    full_scale = float(2**scan.sensor.bits - 1)
    threshold = amplitude_threshold(video.intensity, config.threshold, full_scale)
    if config.method == "threshold":
        over = video.intensity >= math.ceil(threshold)
    else:
        over = cfar(video.intensity, config, threshold, cells_used=video.cells_used)
    flat = np.flatnonzero(over)
    width = video.intensity.shape[1]
    intensity = video.intensity.reshape(-1)[flat]
    if len(flat) > config.max_points:
        strongest = np.argsort(intensity, kind="stable")[::-1][: config.max_points]
        flat, intensity = flat[np.sort(strongest)], intensity[np.sort(strongest)]
    row = flat // width if width else flat
    return _points(scan, video, row, flat - row * width, intensity.astype(np.float64), latency_ns)


def amplitude_threshold(intensity: NDArray[np.unsignedinteger[Any]], fraction: float, full_scale: float) -> float:
    """Least amplitude of a point. A fraction of 0 means: half of full scale, or full scale itself where
    a quarter of the non-zero cells of the scan sit there (receivers that limit hard).
    """
    if fraction > 0:
        return max(1.0, fraction * full_scale)
    occupied = np.count_nonzero(intensity)
    limit = max(1, math.ceil(0.98 * full_scale))
    saturated = np.count_nonzero(intensity >= limit)
    return float(limit) if saturated > SATURATED_SHARE * occupied else max(1.0, math.ceil(0.5 * full_scale))


def cfar(
    intensity: NDArray[np.unsignedinteger[Any]],
    config: DetectConfig,
    least: float,
    *,
    cells_used: IntArray | None = None,
) -> BoolArray:
    """Cells (a, b) that exceed `cfar_scale` times the clutter level around them along range, and `least`.

    Training cells lie `cfar_guard` cells away on both sides, `cfar_window` on each; beyond the ends of a
    spoke, which has cells_used (a,) cells, there are none. Level = their mean (ca-cfar) or their `os_rank`
    quantile (os-cfar).
    """
    used = np.full(len(intensity), intensity.shape[1]) if cells_used is None else cells_used
    over = np.zeros(intensity.shape, np.bool_)
    level = _training_mean if config.method == "ca-cfar" else _training_quantile
    for length in np.unique(used).tolist():  # spokes of one length together: mostly all of them
        rows = np.flatnonzero(used == length)
        amplitude = intensity[rows, :length].astype(np.float64)
        found = (amplitude > config.cfar_scale * level(amplitude, config)) & (amplitude >= least)
        over[rows, :length] = found
    return over


def _training_mean(amplitude: FloatArray, config: DetectConfig) -> FloatArray:
    n = amplitude.shape[1]
    total = np.concatenate([np.zeros((len(amplitude), 1)), np.cumsum(amplitude, axis=1)], axis=1)
    at = np.arange(n)
    outer, guard = config.cfar_window + config.cfar_guard, config.cfar_guard
    left = (np.clip(at - outer, 0, n), np.clip(at - guard, 0, n))
    right = (np.clip(at + guard + 1, 0, n), np.clip(at + outer + 1, 0, n))
    count = (left[1] - left[0]) + (right[1] - right[0])
    summed = total[:, left[1]] - total[:, left[0]] + total[:, right[1]] - total[:, right[0]]
    return np.asarray(summed / np.maximum(count, 1))


def _training_quantile(amplitude: FloatArray, config: DetectConfig) -> FloatArray:
    outer, guard, n = config.cfar_window + config.cfar_guard, config.cfar_guard, amplitude.shape[1]
    offsets = np.concatenate([np.arange(-outer, -guard), np.arange(guard + 1, outer + 1)])
    cells = np.arange(n)[:, None] + offsets
    inside = (cells >= 0) & (cells < n)
    rank = np.clip(np.ceil(config.os_rank * inside.sum(axis=1)).astype(int) - 1, 0, None)
    level = np.empty_like(amplitude)
    for start in range(0, len(amplitude), 64):  # by blocks of spokes: the windows are 2 * window times the video
        window = np.where(inside, amplitude[start : start + 64][:, np.clip(cells, 0, max(n - 1, 0))], np.inf)
        level[start : start + 64] = np.take_along_axis(
            np.sort(window, axis=2), np.broadcast_to(rank[:, None], (*window.shape[:2], 1)), axis=2
        )[..., 0]
    return np.where(np.isfinite(level), level, 0.0)


def _points(scan: Scan, video: Video, row: IntArray, cell: IntArray, intensity: FloatArray, latency_ns: int) -> Points:
    range_m = video.first_range_m + cell.astype(np.float64) * video.cell_m
    azimuth = video.azimuth_rad[row]
    position = np.stack([range_m * np.sin(azimuth), range_m * np.cos(azimuth)], axis=-1) + scan.position_m
    return Points(
        range_m=range_m,
        azimuth_rad=azimuth,
        position_m=position,
        intensity=intensity,
        t_ns=video.t_ns[row] - latency_ns,
        range_width_m=np.full(len(row), video.cell_m),
        azimuth_width_rad=video.width_rad[row],
    )


def empty_points() -> Points:
    """No point at all."""
    none = np.zeros(0)
    return Points(
        range_m=none, azimuth_rad=none, position_m=np.zeros((0, 2)), intensity=none, t_ns=np.zeros(0, np.int64),
        range_width_m=none, azimuth_width_rad=none,
    )  # fmt: skip


def nearest_in_sectors(points: Points, sector_deg: float) -> BoolArray:
    """Which points (n,) are the nearest of their sector of bearing, the first of equals (extended, sec. 5.1).

    Sectors begin at North; where they don't divide the circle the last one is smaller.
    """
    sector = np.floor(np.rad2deg(points.azimuth_rad) / sector_deg + 1e-9).astype(np.int64)
    order = np.lexsort((points.range_m, sector))
    nearest = np.zeros(len(points), bool)
    nearest[order] = np.diff(sector[order], prepend=-1) > 0
    return nearest
