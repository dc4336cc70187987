"""A rotating radar: what it hears of vessels, land and sea, turn by turn, as cells of video.

Every spoke sees the world at its own time, so vessels move while the antenna turns. The mean power of a cell
is the sum of what the beam and the pulse collect there, in units of the receiver's noise; the power itself
scatters about the mean as speckle does (exponential, or gamma where several looks are averaged).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from maritrack.simulate.antenna import SPECKLE, RadarSettings, rng
from maritrack.simulate.echoes import Mover, clear, echoes, fades
from maritrack.simulate.scenery import Scenery, Sea, background
from maritrack.types import FloatArray


def turn(
    radar: RadarSettings, fleet: Sequence[Mover], still: Scenery, sea: Sea, k: int, *, seed: int
) -> NDArray[np.uint8]:
    """The video of turn k, (spokes, cells)."""
    rays_rad, t_s = radar.azimuths_rad(still.per_spoke), radar.times_s(k, still.per_spoke)
    shadow = clear(fleet, rays_rad, t_s, radar.centres_m)
    power = 1.0 + background(radar, still, sea, shadow, k, seed=seed)
    for i, echo in enumerate(echoes(radar, fleet, still, k)):
        cells = slice(echo.first_cell, echo.first_cell + echo.power.shape[1])
        power[echo.spokes, cells] += fades(radar, fleet, i, echo, k, seed=seed)[:, None] * echo.power
    power *= rng(seed, SPECKLE, k).standard_gamma(radar.looks, power.shape) / radar.looks
    return video(radar, power)


def video(radar: RadarSettings, power: FloatArray) -> NDArray[np.uint8]:
    """Cells of 8 bits from power over noise: gain by range, logarithm, threshold."""
    gain = np.minimum(radar.centres_m / max(radar.stc_range_m, radar.cell_m), 1.0) ** radar.stc_power
    level_db = 10.0 * np.log10(np.maximum(power * gain, 1e-9))
    level = np.rint(255.0 * (level_db - radar.floor_db) / (radar.full_db - radar.floor_db))
    level = np.clip(level, 0.0, 255.0).astype(np.uint8)
    return np.where(level < radar.threshold, np.uint8(0), level)
