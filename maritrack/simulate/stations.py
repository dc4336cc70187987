"""Several radars in one scene: which vessel carries one, where it is in each turn, and the table that tells readers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from maritrack.geo import en_to_geodetic
from maritrack.simulate.antenna import RadarSettings
from maritrack.simulate.scenes import Scene
from maritrack.simulate.vessels import Vessel
from maritrack.types import FloatArray, IntArray, Origin


def recording_path(out: Path, name: str) -> Path:
    """Where the recording of one of several radars lies: port.cat240 -> port-north.cat240."""
    return out.with_name(f"{out.stem}-{name}{out.suffix}")


def sensors_path(out: Path) -> Path:
    """Where the table of the radars lies: port.cat240 -> port.sensors.toml."""
    return out.with_name(out.stem + ".sensors.toml")


def aboard(scene: Scene, radar: RadarSettings) -> tuple[Scene, Vessel | None]:
    """The scene as one of its radars sees it, without the vessel that carries it, and that vessel."""
    carrier = next((v for v in scene.vessel if v.id == radar.aboard), None)
    alone = replace(radar, aboard="", head_up=False)
    return replace(scene, radar=alone, others=(), vessel=tuple(v for v in scene.vessel if v is not carrier)), carrier


@dataclass(frozen=True, slots=True)
class Leg:
    """Turns during which a radar stays within a cell of a place."""

    east_m: float
    north_m: float
    turns: range


def legs(radar: RadarSettings, carrier: Vessel, n_scans: int) -> Iterator[Leg]:
    """The way of a carrier in pieces that are one place as far as land is concerned: not longer than a cell."""
    position_m, first = place_m(radar, carrier, np.arange(n_scans)), 0
    for k in range(1, n_scans + 1):
        if k == n_scans or np.hypot(*(position_m[k] - position_m[first])) > radar.cell_m:
            middle = position_m[(first + k - 1) // 2]
            yield Leg(float(middle[0]), float(middle[1]), range(first, k))
            first = k


def carried(radar: RadarSettings, carrier: Vessel, k: int) -> RadarSettings:
    """The radar where it is in turn k."""
    east_m, north_m = place_m(radar, carrier, np.array([k]))[0].tolist()
    return replace(radar, east_m=east_m, north_m=north_m)


def place_m(radar: RadarSettings, carrier: Vessel, k: IntArray) -> FloatArray:
    """East-north (n, 2) in the middle of each turn k (n,)."""
    return carrier.course().at(np.asarray(radar.turn_s * (k + 0.5), np.float64)).position_m


def sensors_table(scene: Scene) -> str:
    """Where each radar is and what it is like, as `--sensors` reads it."""
    origin, blocks = Origin(scene.lat_deg, scene.lon_deg), []
    for radar in scene.radars:
        lines = [f'[sensors."{radar.sac}-{radar.sic}"]  # {radar.name}']
        if radar.aboard:
            lines += [f'own_ship = "{radar.aboard}"'] + ['stabilised = "head"'] * radar.head_up
        else:
            lat_deg, lon_deg = en_to_geodetic(origin, np.array([[radar.east_m, radar.north_m]]))
            lines += [f"lat_deg = {float(lat_deg[0]):.7f}", f"lon_deg = {float(lon_deg[0]):.7f}"]
        lines += [f"beam_width_deg = {radar.beam_deg}", f"pulse_length_m = {radar.pulse_m}"]
        blocks.append("\n".join(lines) + "\n")
    return "\n".join(blocks)
