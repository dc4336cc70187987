"""Settings of folders laid out like DLR's radar data set: what its files leave open, and how it is read."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from maritrack.errors import ConfigError
from maritrack.limits import require

QUANTITIES = ("time", "east", "north", "lat", "lon", "cog", "sog", "heading", "length", "width")


@dataclass(frozen=True, kw_only=True)
class RwmrConfig:
    """How polarMeas.json, cartesianMeas.json and referenceMeas.mat are read; `auto` is a guess that the run tells."""

    points: Literal["auto", "polar", "cartesian"] = "auto"  # which document; auto = both, where they agree
    columns: Literal["auto", "range-bearing", "bearing-range"] = "auto"
    angles: Literal["auto", "rad", "deg"] = "auto"  # of bearings, courses and headings
    axes: Literal["east-north", "north-east"] = "east-north"  # of Cartesian points
    heading_at: int = -1  # which number of an entry's header is own heading, from 0; -1 = none is used
    rate_hz: float = 1.0  # steps a second
    reference: Literal["auto", "none"] = "auto"  # whether referenceMeas.mat is truth
    reference_map: str = ""  # "east=x,north=y,time=0": names of fields or numbers of columns, from 0

    def __post_init__(self) -> None:
        require(0 < self.rate_hz <= 1e6 and math.isfinite(self.rate_hz), "rwmr.rate_hz is within 0..1e6")
        require(-1 <= self.heading_at <= 100, "rwmr.heading_at is within -1..100")
        parse_map(self.reference_map)


def parse_map(text: str) -> dict[str, str]:
    """`east=x,north=y` as {"east": "x", "north": "y"}."""
    found = {}
    for item in filter(None, (part.strip() for part in text.split(","))):
        quantity, sep, name = (part.strip() for part in item.partition("="))
        if not sep or not name or quantity not in QUANTITIES:
            raise ConfigError(f"rwmr.reference_map: '{item[:40]}' is not QUANTITY=NAME", "of " + ", ".join(QUANTITIES))
        found[quantity] = name
    return found
