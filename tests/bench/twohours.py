"""A scene of two hours: the harbour with ships that ply the sea before it all the time, for runs in segments.

python -m tests.bench.twohours scene.toml [SHIPS]
maritrack simulate scene.toml -o long.cat240 --no-labels --no-ais
"""

from __future__ import annotations

import math
import sys
from importlib import resources
from pathlib import Path

import numpy as np

SCANS = 2880  # of 2.5 s
EAST_M, NORTH_M = (-4200.0, 4200.0), (-4600.0, -1300.0)  # the open sea of the scene
LEAST_LEG_M, SHARPEST_RAD, RADIUS_M = 1500.0, math.radians(150.0), 120.0


def scene_text(ships: int = 40, *, seed: int = 1) -> str:
    """The harbour's radar, sea, land and buoys with `ships` on courses of two hours."""
    harbour = resources.files("maritrack.scenes").joinpath("harbour.toml").read_text("utf-8")
    head, *vessels = harbour.split("[[vessel]]")
    head = head.replace("scans   = 42", f"scans   = {SCANS}").replace('"harbour"', '"two hours"')
    buoys = [text for text in vessels if '"buoy' in text]
    rng = np.random.default_rng([seed, ships])
    return "[[vessel]]".join([head, *buoys, *(_ship(rng, i) for i in range(ships))])


def _ship(rng: np.random.Generator, number: int) -> str:
    speed = rng.uniform(3.0, 10.0)
    length = rng.uniform(12.0, 120.0)
    way = _way(rng, speed * SCANS * 2.5 + 2000.0)
    points = ", ".join(f"[{east:.0f}, {north:.0f}]" for east, north in way)
    return (
        f'\nid = "ship-{number}"\nlength_m = {length:.1f}\nwidth_m = {length / 5.5:.1f}\n'
        f"rcs_m2 = {2.0 * length**1.7:.0f}\nfade = 4.0\nwaypoints_m = [{points}]\n"
        f"speed_mps = {speed:.2f}\nturn_deg_per_s = {math.degrees(speed / RADIUS_M):.2f}\n\n"
    )


def _way(rng: np.random.Generator, least_m: float) -> list[tuple[float, float]]:
    """Corners of a course of at least this length, none of them too sharp for its turn."""

    def somewhere() -> tuple[float, float]:
        return float(rng.uniform(*EAST_M)), float(rng.uniform(*NORTH_M))

    way, gone_m, heading = [somewhere()], 0.0, math.nan
    while gone_m < least_m:
        to = somewhere()
        east, north = to[0] - way[-1][0], to[1] - way[-1][1]
        leg_m, course = math.hypot(east, north), math.atan2(east, north)
        turn = abs((course - heading + math.pi) % (2 * math.pi) - math.pi)
        if leg_m >= LEAST_LEG_M and not turn > SHARPEST_RAD:
            way.append(to)
            gone_m, heading = gone_m + leg_m, course
    return way


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(scene_text(*map(int, sys.argv[2:3])), "utf-8")
