"""A rotating radar: what it hears of vessels, land and sea, turn by turn, as cells of video.

Every spoke sees the world at its own time, so vessels move while the antenna turns. The mean power of a cell
is the sum of what the beam and the pulse collect there, in units of the receiver's noise; the power itself
scatters about the mean as speckle does (exponential, or gamma where several looks are averaged).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maritrack.simulate.antenna import SPECKLE, RadarSettings, rng
from maritrack.simulate.echoes import Mover, clear, echoes, fades
from maritrack.simulate.scenery import Scenery, Sea, background, smear
from maritrack.types import FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """The video of one turn, and whose echo the shown cells are."""

    video: NDArray[np.uint8]  # (spokes, cells)
    cells: IntArray  # (n,) shown cells that are a vessel's or land's, spoke * cells + cell, ascending
    owners: IntArray  # (n,) index of the vessel; the number of vessels = land


def turn(
    radar: RadarSettings, fleet: Sequence[Mover], still: Scenery, sea: Sea, k: int, *, seed: int
) -> NDArray[np.uint8]:
    """The video of turn k, (spokes, cells)."""
    return labelled_turn(radar, fleet, still, sea, k, seed=seed, labels=False).video


def labelled_turn(
    radar: RadarSettings, fleet: Sequence[Mover], still: Scenery, sea: Sea, k: int, *, seed: int, labels: bool = True
) -> Turn:
    """Turn k; without labels its `cells` and `owners` are empty."""
    rays_rad, t_s = radar.azimuths_rad(still.per_spoke), radar.times_s(k, still.per_spoke)
    shadow = clear(fleet, rays_rad, t_s, radar.centres_m)
    power = 1.0 + background(radar, still, sea, shadow, k, seed=seed)
    land = smear(still.land * shadow, radar, still.per_spoke) if labels else np.zeros((0, radar.cells))
    rest = power - land if labels else land
    parts: list[tuple[IntArray, FloatArray]] = []
    for i, echo in enumerate(echoes(radar, fleet, still, k)):
        cells = slice(echo.first_cell, echo.first_cell + echo.power.shape[1])
        heard = fades(radar, fleet, i, echo, k, seed=seed)[:, None] * echo.power
        power[echo.spokes, cells] += heard
        parts.append((flat_cells(radar, echo.spokes, cells), heard.ravel()))
    power *= rng(seed, SPECKLE, k).standard_gamma(radar.looks, power.shape) / radar.looks
    shown = video(radar, power)
    if not labels:
        return Turn(shown, nothing(), nothing())
    cells_shown = np.flatnonzero(shown)
    return Turn(shown, *owners(cells_shown, parts, land.ravel()[cells_shown], rest.ravel()[cells_shown]))


def flat_cells(radar: RadarSettings, spokes: IntArray, cells: slice) -> IntArray:
    """Numbers of the cells of a window, spoke * cells + cell, (w * c,)."""
    return np.asarray((spokes[:, None] * radar.cells + np.arange(cells.start, cells.stop)).ravel(), dtype=np.int64)


def nothing() -> IntArray:
    """No cells."""
    return np.zeros(0, dtype=np.int64)


def owners(
    cells: IntArray, parts: Sequence[tuple[IntArray, FloatArray]], land: FloatArray, rest: FloatArray
) -> tuple[IntArray, IntArray]:
    """Those of the shown cells (n,) that are a vessel's or land's, and whose: as `Turn` has them.

    A cell belongs to the vessel (`parts`: cells and power of each), or land (n,), whose mean power there is the
    largest, and to nobody where noise and sea together, `rest` (n,), are larger still.
    """
    most, owner = np.maximum(land, rest), np.where(land > rest, len(parts), -1)
    for i, (heard_in, power) in enumerate(parts if len(cells) else ()):
        place = np.minimum(np.searchsorted(cells, heard_in), len(cells) - 1)
        hit = np.nonzero((cells[place] == heard_in) & (power > most[place]))[0]
        most[place[hit]], owner[place[hit]] = power[hit], i
    kept = owner >= 0
    return cells[kept], owner[kept]


def video(radar: RadarSettings, power: FloatArray) -> NDArray[np.uint8]:
    """Cells of 8 bits from power over noise (spokes, cells): gain by range, logarithm, threshold."""
    return levels(radar, power, radar.gain)


def levels(radar: RadarSettings, power: FloatArray, gain: FloatArray) -> NDArray[np.uint8]:
    """Cells of 8 bits from power over noise and the gain at their range, any shape."""
    level_db = 10.0 * np.log10(np.maximum(power * gain, 1e-9))
    level = np.rint(255.0 * (level_db - radar.floor_db) / (radar.full_db - radar.floor_db))
    level = np.clip(level, 0.0, 255.0).astype(np.uint8)
    return np.where(level < radar.threshold, np.uint8(0), level)
