"""Turns whose noise is drawn only where it shows: the law of `radar.turn`, a fraction of its cost.

A cell that holds nothing but noise passes the threshold with a probability that is known, so the cells that
pass are drawn by the gaps between them, and their power above the threshold after that. Cells near a vessel, on
land and in clutter are drawn one by one. Left out: land and clutter of a mean below `LOUD` of the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc, gammainccinv

from maritrack.geo import TWO_PI
from maritrack.simulate.antenna import CLUTTER, SPECKLE, RadarSettings, rng
from maritrack.simulate.echoes import Mover
from maritrack.simulate.hulls import Heard, hear
from maritrack.simulate.radar import Turn, flat_cells, levels, nothing, owners
from maritrack.simulate.rays import BEAM_REACH, beam
from maritrack.simulate.scenery import Scenery, Sea, smear
from maritrack.types import BoolArray, FloatArray, IntArray

LOUD = 0.05  # of the noise
FAINT = 1e-5  # of the beam's axis: directions that clutter is not collected from


@dataclass(frozen=True, slots=True, eq=False)
class Backdrop:
    """What does not change from turn to turn."""

    hiding: Scenery | None  # land that vessels pass behind
    has_land: bool
    land: FloatArray  # (spokes, cells) mean power, as the beam collects it
    per_spoke: int
    sea: NDArray[np.float32]  # (rays, b) mean clutter of the first b cells
    loud: IntArray  # (m,) cells that are drawn one by one, ascending
    is_loud: BoolArray  # (spokes * cells,)


def backdrop(radar: RadarSettings, still: Scenery) -> Backdrop:
    """Prepare land and clutter."""
    land = smear(still.land, radar, still.per_spoke)
    land[land < LOUD] = 0.0
    rough = np.nonzero(smear(still.sea, radar, still.per_spoke).max(axis=0) >= LOUD)[0]
    band = int(rough[-1]) + 1 if len(rough) else 0
    is_loud = land > 0.0
    is_loud[:, :band] = True
    hiding = still if still.passed.min() < 1.0 else None
    clutter = np.ascontiguousarray(still.sea[:, :band], dtype=np.float32)
    return Backdrop(hiding, bool(land.any()), land, still.per_spoke, clutter, np.flatnonzero(is_loud), is_loud.ravel())


def sparse_turn(
    radar: RadarSettings, fleet: Sequence[Mover], still: Backdrop, sea: Sea, k: int, *, seed: int, labels: bool = True
) -> Turn:
    """Turn k; without labels its `cells` and `owners` are empty."""
    heard = hear(radar, fleet, still.hiding, k, seed=seed)
    land, clutter = _still_now(radar, still, sea, heard, k, seed=seed)
    excess = land.copy() if still.has_land and labels else land if still.has_land else np.zeros(land.shape)
    excess[:, : clutter.shape[1]] += clutter
    parts = [(_cells_of(radar, h), h.power.ravel()) for h in heard]
    for cells, power in parts:
        excess.ravel()[cells] += power
    video = _draw(radar, still, parts, excess.ravel(), rng(seed, SPECKLE, k))
    if not labels:
        return Turn(video, nothing(), nothing())
    shown = np.flatnonzero(video)
    spoke, cell = shown // radar.cells, shown % radar.cells
    rest, rough = np.ones(len(shown)), cell < clutter.shape[1]
    rest[rough] += clutter[spoke[rough], cell[rough]]
    return Turn(video, *owners(shown, parts, land.ravel()[shown], rest))


def _cells_of(radar: RadarSettings, heard: Heard) -> IntArray:
    return flat_cells(radar, heard.spokes, slice(heard.first_cell, heard.first_cell + heard.power.shape[1]))


def _still_now(
    radar: RadarSettings, still: Backdrop, sea: Sea, heard: Sequence[Heard], k: int, *, seed: int
) -> tuple[FloatArray, NDArray[np.float32]]:
    """Land (spokes, cells) and clutter (spokes, b) in the shadows of the vessels."""
    land = still.land.copy() if still.has_land else still.land
    clutter = _clutter(radar, still, sea, k, seed=seed)
    for h in heard:
        for field in (land, clutter) if still.has_land else (clutter,):
            field[h.spokes, h.behind :] *= h.passed[:, None]
    return land, clutter


def _clutter(radar: RadarSettings, still: Backdrop, sea: Sea, k: int, *, seed: int) -> NDArray[np.float32]:
    """Mean power of the sea with this turn's texture, as the beam collects it, (spokes, b)."""
    smeared = np.zeros((radar.spokes, still.sea.shape[1]), dtype=np.float32)
    if not smeared.size:
        return smeared
    n, per_spoke = len(still.sea), still.per_spoke
    side = int(np.ceil(BEAM_REACH * radar.beam_rad / TWO_PI * n))
    texture = rng(seed, CLUTTER, k).standard_gamma(sea.spike, still.sea.shape, dtype=np.float32)
    rays = still.sea * texture / np.float32(sea.spike)
    rays = np.concatenate([rays[n - side :], rays, rays[: side + per_spoke]])
    offsets = np.arange(-side, side + per_spoke)
    off_rad = (offsets.astype(np.float64) + 0.5 - per_spoke / 2.0) * (TWO_PI / n)
    weights = beam(off_rad, beam_rad=radar.beam_rad)
    for offset, weight in zip(offsets, weights, strict=True):
        if weight > FAINT:
            smeared += np.float32(weight) * rays[side + offset : side + offset + n : per_spoke]
    return smeared


def _draw(
    radar: RadarSettings, still: Backdrop, parts: Sequence[tuple[IntArray, FloatArray]], excess: FloatArray,
    draws: np.random.Generator,
) -> NDArray[np.uint8]:  # fmt: skip
    """The video: speckle in the loud cells and those of vessels, noise that shows in the others."""
    video = np.zeros(radar.spokes * radar.cells, dtype=np.uint8)
    near = np.unique(np.concatenate([nothing(), *(cells for cells, _ in parts)]))
    near = near[~still.is_loud[near]]
    noise, power = noise_shown(radar, draws)
    quiet = ~still.is_loud[noise] & ~np.isin(noise, near)
    noise, power = noise[quiet], power[quiet]
    video[noise] = np.maximum(levels(radar, power, radar.gain[noise % radar.cells]), radar.threshold)
    for cells in (still.loud, near):
        scatter = draws.standard_gamma(radar.looks, len(cells)) / radar.looks
        video[cells] = levels(radar, (1.0 + excess[cells]) * scatter, radar.gain[cells % radar.cells])
    return video.reshape(radar.spokes, radar.cells)


def noise_shown(radar: RadarSettings, draws: np.random.Generator) -> tuple[IntArray, FloatArray]:
    """Cells (n,), ascending, in which noise alone passes the threshold, and its power there.

    Gaps between trials of equal probability are geometric; where the gain makes the probability smaller, trials
    are struck out at random.
    """
    chance = gammaincc(radar.looks, radar.looks * radar.least_power)  # (cells,)
    n, most = radar.spokes * radar.cells, float(chance.max())
    if most * n < 1e-6:
        return nothing(), np.zeros(0)
    found, last = [nothing()], -1
    while last < n:
        gaps = draws.geometric(most, int(most * n + 6.0 * np.sqrt(most * n) + 10.0))
        found.append(last + np.cumsum(gaps))
        last = int(found[-1][-1])
    cells = np.concatenate(found)
    cells = cells[cells < n]
    u = draws.random(len(cells)) * most  # below the chance of its cell: it shows, by so much
    kept = u < chance[cells % radar.cells]
    return cells[kept], gammainccinv(radar.looks, u[kept]) / radar.looks
