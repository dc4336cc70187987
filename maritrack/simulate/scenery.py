"""Land and sea as a radar hears them, with the shadows that vessels throw on both."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maritrack.errors import ConfigError
from maritrack.geo import TWO_PI
from maritrack.simulate.antenna import CLUTTER, LAND, RadarSettings, rng
from maritrack.simulate.rays import BEAM_REACH, beam, inside_length, returned, through
from maritrack.types import FloatArray

SPOT_M = 10.0  # squares of the map of the ground


@dataclass(frozen=True, kw_only=True)
class Land:
    """A piece of land, drawn as a polygon."""

    name: str = ""
    outline_m: tuple[tuple[float, ...], ...]
    rcs_m2_per_m: float = 100.0  # echo for each metre across the beam
    reach_m: float = 30.0  # inland, to 1/e: small for a wall, large for low ground
    spike: float = 1.0  # shape of the gamma law of the ground's texture: small = few strong spots
    high: bool = False  # seen over the land before it, as hills and towns are

    def __post_init__(self) -> None:
        if len(self.outline_m) < 3 or any(len(p) != 2 for p in self.outline_m):
            raise ConfigError(f"land '{self.name}': outline_m is a list of at least three [east, north]")
        if not (self.reach_m > 0 and self.spike > 0 and self.rcs_m2_per_m >= 0):
            raise ConfigError(f"land '{self.name}': reach_m and spike > 0, rcs_m2_per_m >= 0")


@dataclass(frozen=True, kw_only=True)
class Sea:
    """Clutter of the waves."""

    level_db: float = -200.0  # mean over noise at 1 km, before the gain falls
    decay: float = 4.0  # power of range
    spike: float = 0.5  # shape of the gamma texture (K distribution)
    wind_deg: float = 0.0  # the wind comes from: clutter is strongest there
    wind_db: float = 0.0  # over the opposite direction


@dataclass(frozen=True, slots=True, eq=False)
class Scenery:
    """What does not move, on rays finer than the spokes."""

    per_spoke: int
    land: FloatArray  # (rays, cells) power over noise, not yet smeared by the beam
    passed: FloatArray  # (rays, cells) share of the power that land lets through to the cell
    sea: FloatArray  # (rays, cells) mean clutter


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """Strong and weak spots of a piece of land, about a mean of 1, on a map that all radars share."""

    corner_m: FloatArray  # (2,) south-west
    strength: FloatArray  # (rows, columns) squares of SPOT_M

    def at(self, position_m: FloatArray) -> FloatArray:
        """The strength (...) at positions (..., 2)."""
        column, row = np.moveaxis(np.floor((position_m - self.corner_m) / SPOT_M).astype(np.int64), -1, 0)
        rows, columns = self.strength.shape
        return np.asarray(self.strength[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)])


def grounds(lands: Sequence[Land], *, seed: int) -> tuple[Ground, ...]:
    """The texture of each piece of land as a map."""
    found = []
    for i, land in enumerate(lands):
        outline_m = np.array(land.outline_m)
        columns, rows = np.ceil(np.ptp(outline_m, axis=0) / SPOT_M).astype(int) + 1
        strength = rng(seed, LAND, i).standard_gamma(land.spike, (rows, columns)) / land.spike
        found.append(Ground(outline_m.min(axis=0), strength))
    return tuple(found)


def scenery(
    radar: RadarSettings, lands: Sequence[Land], sea: Sea, *, seed: int, maps: Sequence[Ground] | None = None
) -> Scenery:
    """Land and mean clutter. The texture of the ground is drawn once: it looks the same in every turn.

    It is drawn for the cells of this radar, or taken from `maps`, one for each land, that others share.
    """
    per_spoke = math.ceil(3.0 * 360.0 / radar.spokes / radar.beam_deg)
    azimuth_rad, centres_m, place_m = radar.azimuths_rad(per_spoke), radar.centres_m, [radar.east_m, radar.north_m]
    shape, arc_m = (len(azimuth_rad), radar.cells), TWO_PI / len(azimuth_rad) * centres_m
    pieces = [np.array(land.outline_m) - place_m for land in lands]
    hit = [np.nonzero(inside_length(p, azimuth_rad, radar.edges_m[-1:])[:, 0] > 0.0)[0] for p in pieces]
    depths = [
        inside_length(p, azimuth_rad[rows], centres_m) / a.reach_m
        for p, rows, a in zip(pieces, hit, lands, strict=True)
    ]
    depth = np.zeros(shape)  # in units of reach, of all land that hides
    for land, rows, own in zip(lands, hit, depths, strict=True):
        if not land.high:
            depth[rows] += own
    ground = np.zeros(shape)
    for i, (outline_m, land, rows) in enumerate(zip(pieces, lands, hit, strict=True)):
        share = returned(outline_m, azimuth_rad[rows], radar.edges_m, reach_m=land.reach_m, pulse_m=radar.pulse_m)
        share *= land.rcs_m2_per_m * arc_m * radar.range_law(centres_m)
        if maps is None:
            share *= rng(seed, LAND, i).standard_gamma(land.spike, share.shape) / land.spike
        else:
            share *= maps[i].at(place_m + centres_m[:, None] * _ahead(azimuth_rad[rows])[:, None])
        if not land.high:
            share *= through(depth[rows] - depths[i])
        ground[rows] += share
    passed = through(depth)
    return Scenery(per_spoke, ground, passed, passed * _sea_mean(radar, sea, azimuth_rad))


def _ahead(azimuth_rad: FloatArray) -> FloatArray:
    """Unit vectors (n, 2) of directions."""
    return np.stack([np.sin(azimuth_rad), np.cos(azimuth_rad)], axis=-1)


def _sea_mean(radar: RadarSettings, sea: Sea, azimuth_rad: FloatArray) -> FloatArray:
    """Clutter power of a ray's share of the beam, (rays, cells)."""
    wind_db = 0.5 * sea.wind_db * (np.cos(azimuth_rad - math.radians(sea.wind_deg)) - 1.0)
    ray_share = TWO_PI / len(azimuth_rad) / (radar.beam_rad * math.sqrt(math.pi / (8.0 * math.log(2.0))))
    falling = (1000.0 / np.maximum(radar.centres_m, radar.cell_m)) ** sea.decay
    level = 10.0 ** ((sea.level_db + wind_db) / 10.0)
    return np.asarray(ray_share * level[:, None] * falling, dtype=np.float64)


def background(radar: RadarSettings, still: Scenery, sea: Sea, shadow: FloatArray, k: int, *, seed: int) -> FloatArray:
    """Mean power of land and sea in turn k, (spokes, cells), under what vessels let through (rays, cells)."""
    texture = rng(seed, CLUTTER, k).standard_gamma(sea.spike, still.sea.shape) / sea.spike
    return smear((still.land + still.sea * texture) * shadow, radar, still.per_spoke)


def smear(field: FloatArray, radar: RadarSettings, per_spoke: int) -> FloatArray:
    """What the beam on each spoke collects from the rays about it."""
    n = len(field)
    side = math.ceil(BEAM_REACH * radar.beam_rad / TWO_PI * n)
    offsets = np.arange(-side, side + per_spoke)
    off_rad = (offsets.astype(np.float64) + 0.5 - per_spoke / 2.0) * (TWO_PI / n)
    axis = np.arange(radar.spokes) * per_spoke
    smeared = np.zeros((radar.spokes, field.shape[1]))
    for offset, weight in zip(offsets, beam(off_rad, beam_rad=radar.beam_rad), strict=True):
        smeared += weight * field[(axis + offset) % n]
    return smeared
