"""Ships on straight ways, what a radar of points makes of them, and what they tell by AIS: small runs to be checked."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from maritrack.geo import en_to_geodetic
from maritrack.types import Origin
from tests.cli.calling import call

HERE = Origin(54.0, 10.0)
T0, TURN_S, SCANS = 1_452_603_600, 2.5, 60
Fleet = dict[str, tuple[float, float, float, float]]
SHIPS: Fleet = {  # id: east, north, speed, course
    "201": (-2000.0, 1500.0, 6.0, 95.0), "202": (1500.0, 2500.0, 8.0, 200.0), "203": (-1200.0, -1500.0, 5.0, 20.0),
    "204": (2500.0, -800.0, 7.0, 280.0), "205": (300.0, -2600.0, 9.0, 60.0), "206": (-2600.0, -300.0, 4.0, 150.0),
}  # fmt: skip


def way(ship: tuple[float, float, float, float], t_s: np.ndarray) -> np.ndarray:
    """Where a ship is (n, 2)."""
    east, north, speed, course = ship
    ahead = np.array([np.sin(np.radians(course)), np.cos(np.radians(course))])
    return np.array([east, north]) + np.outer(t_s * speed, ahead)


def record(
    folder: Path, seed: int, *, p_detect: float = 0.9, clutter: int = 4, start_s: float = T0, ships: Fleet = SHIPS
) -> Path:
    """The archive of a run of that scene."""
    rng = np.random.default_rng(seed)
    scans = []
    for k in range(SCANS):
        t_s = k * TURN_S
        seen = [way(s, np.array([t_s]))[0] + rng.normal(0, 8, 2) for s in ships.values() if rng.random() < p_detect]
        noise = rng.uniform(-4000, 4000, (clutter, 2))
        points = np.concatenate([np.array(seen).reshape(-1, 2), noise])
        scans.append({"time_s": start_s + t_s, "points": np.round(points, 2).tolist()})
    document = {
        "format": "maritrack-points/1", "frame": "enu", "origin": {"lat_deg": HERE.lat_deg, "lon_deg": HERE.lon_deg},
        "sensors": {"radar": {"sigma_m": 8.0}}, "scans": scans,
    }  # fmt: skip
    path = folder / "rec.json"
    path.write_text(json.dumps(document))
    done = call("process", path, "-o", folder / "run", "--no-rrd", "-q", "--json")
    assert done.code == 0, done.err
    return folder / "run"


def ais(
    folder: Path, *, shift: dict[str, tuple[float, float]] | None = None, without: tuple[str, ...] = (),
    late_s: dict[str, float] | None = None, leap: dict[str, int] | None = None, ghost: bool = False,
    every_s: float = 5.0, ships: Fleet = SHIPS,
) -> Path:  # fmt: skip
    """The table of what they tell: some elsewhere, late, not at all, or with a leap of 800 m from a report on."""
    rows = ["time,mmsi,lat,lon,sog,cog,heading,length,width"]
    told = {i: s for i, s in ships.items() if i not in without}
    if ghost:
        told["999"] = (1000.0, 600.0, 5.0, 45.0)
    for id_, ship in told.items():
        t_s = np.arange(-20.0, SCANS * TURN_S + 60, every_s)
        at = way(ship, t_s - (late_s or {}).get(id_, 0.0)) + np.array((shift or {}).get(id_, (0.0, 0.0)))
        if leap and id_ in leap:
            at[leap[id_] :] += np.array([800.0, 0.0])
        lat, lon = en_to_geodetic(HERE, at)
        rows += [
            f"{T0 + t},{id_},{a:.7f},{o:.7f},{ship[2] / 0.514444:.1f},{ship[3]:.0f},{ship[3]:.0f},60,12"
            for t, a, o in zip(t_s, lat, lon, strict=True)
        ]
    path = folder / "ais.csv"
    path.write_text("\n".join(rows) + "\n")
    return path
