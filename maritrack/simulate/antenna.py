"""The settings of a rotating radar, and the conventions of its spokes and cells.

Spoke j of a turn of n points at (j + 1/2) 360/n degrees; cell i reaches from (first + i) to (first + i + 1)
cell depths.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maritrack.errors import ConfigError
from maritrack.geo import TWO_PI
from maritrack.types import FloatArray

LAND, CLUTTER, SPECKLE, FADE = range(4)  # stages of the random numbers


def rng(seed: int, stage: int, k: int) -> np.random.Generator:
    """The random numbers of one stage and one turn, whatever was drawn before."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(stage, k)))


@dataclass(frozen=True, kw_only=True)
class RadarSettings:
    """Antenna, transmitter, receiver and where they stand."""

    name: str = ""  # of its file, where a scene has several
    sac: int = 0
    sic: int = 1
    aboard: str = ""  # id of the vessel that carries it; "" = it stands at east_m, north_m
    head_up: bool = False  # sends azimuths from the bow of that vessel, not from North
    east_m: float = 0.0
    north_m: float = 0.0
    turn_s: float
    spokes: int  # a turn
    beam_deg: float  # one-way half-power width
    cells: int
    cell_m: float
    first_cell: int = 0
    pulse_m: float  # c T / 2
    unit_range_m: float  # where 1 m^2 is as strong as the noise
    looks: float = 1.0  # independent looks averaged in a cell
    stc_range_m: float = 0.0  # below this the gain falls ...
    stc_power: float = 3.5  # ... with this power of range
    floor_db: float  # over noise: video 0
    full_db: float  # over noise: video 255
    threshold: int = 1  # video below this is sent as 0
    sparse_noise: bool = False  # draw only the noise that passes the threshold: same law, other random numbers

    def __post_init__(self) -> None:
        for name in ("turn_s", "spokes", "beam_deg", "cells", "cell_m", "pulse_m", "unit_range_m", "looks"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"radar: {name} must be greater than 0")
        if not (self.full_db > self.floor_db and 0 <= self.threshold <= 255 and self.first_cell >= 0):
            raise ConfigError("radar: full_db > floor_db, 0 <= threshold <= 255 and first_cell >= 0")
        if self.head_up and not self.aboard:
            raise ConfigError("radar: head_up is for one that is aboard a vessel")
        if self.sparse_noise and self.threshold < 1:
            raise ConfigError("radar: sparse_noise and a threshold of 1 or more belong together")

    @property
    def edges_m(self) -> FloatArray:
        """Borders of the cells, (cells + 1,)."""
        return np.asarray(self.cell_m * (self.first_cell + np.arange(self.cells + 1.0)), dtype=np.float64)

    @property
    def centres_m(self) -> FloatArray:
        """Centres of the cells, (cells,)."""
        return np.asarray(self.cell_m * (self.first_cell + np.arange(self.cells) + 0.5), dtype=np.float64)

    @property
    def beam_rad(self) -> float:
        return math.radians(self.beam_deg)

    def azimuths_rad(self, per_spoke: int = 1) -> FloatArray:
        """Directions of a turn, (spokes,), or of rays finer than that."""
        n = self.spokes * per_spoke
        return np.asarray(TWO_PI * (np.arange(n) + 0.5) / n, dtype=np.float64)

    def times_s(self, k: int, per_spoke: int = 1) -> FloatArray:
        """When the beam of turn k points there."""
        return np.asarray(self.turn_s * (k + self.azimuths_rad(per_spoke) / TWO_PI), dtype=np.float64)

    @property
    def gain(self) -> FloatArray:
        """Gain of the receiver by range, (cells,)."""
        near = np.minimum(self.centres_m / max(self.stc_range_m, self.cell_m), 1.0)
        return np.asarray(near**self.stc_power, dtype=np.float64)

    @property
    def least_power(self) -> FloatArray:
        """Power over noise from which a cell is shown, (cells,)."""
        level_db = self.floor_db + (self.threshold - 0.5) * (self.full_db - self.floor_db) / 255.0
        return np.asarray(10.0 ** (level_db / 10.0) / self.gain, dtype=np.float64)

    def range_law(self, range_m: FloatArray) -> FloatArray:
        """Power of 1 m^2 over noise."""
        return np.asarray((self.unit_range_m / np.maximum(range_m, self.cell_m)) ** 4, dtype=np.float64)
