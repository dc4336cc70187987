"""CPU of a tracker on LiDAR points: the four ships of the extended paper, and the growth with ships and with points.

python -m tests.bench.bench_lidar [--tracker jipda] [--scans 250] [--seed 1]
Medians over scans of clustering and tracking together, on one core. Growth is told as times 4 ships at 0.25 degree:
scenes of 4, 8, 16 and 32 ships in a ring about the sensor, and of 4 ships at 0.5, 0.25, 0.125 and 0.0625 degree.
"""

from __future__ import annotations

import argparse
import math
import os
import statistics
from dataclasses import replace

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from maritrack.chain import build_chain, process
from maritrack.config import load_config
from maritrack.simulate.lidar import Boat
from maritrack.simulate.lidarscene import LidarScene, scans_of
from maritrack.simulate.scenes import load_any
from maritrack.trackers import TRACKERS
from maritrack.types import CONFIRMED, Frame

BUDGET_MS = {"jipda": 5.0, "gp-pmbm": 150.0}


def measure(scene: LidarScene, tracker: str, *, scans: int, seed: int) -> tuple[float, float, float]:
    """Median CPU of a scan in ms, points a scan in the mean, and confirmed tracks at the end."""
    chain = build_chain(load_config(preset="extended", sets=[f"tracker_name={tracker}"]))
    state, cpu, points, held = chain.init(), [], 0, 0
    for k in range(scans):
        (scan,) = scans_of(scene, k, seed=seed)
        state, result = process(chain, state, Frame(k, scan))
        cpu.append(result.timing_ms["cluster"] + result.timing_ms["track"])
        points += len(result.points)
        held = int((result.tracks.status >= CONFIRMED).sum())
    return statistics.median(cpu), points / scans, held


def four_ships() -> LidarScene:
    """The paper's scene."""
    scene = load_any("four-ships")
    assert isinstance(scene, LidarScene)
    return scene


def fleet(n: int, step_deg: float) -> LidarScene:
    """The paper's LiDAR in a ring of n of its ships at 60 m, so that none hides another, each under way outwards."""
    scene, ships = four_ships(), []
    for i in range(n):
        bearing = math.tau * i / n
        at = (60.0 * math.sin(bearing), 60.0 * math.cos(bearing))
        to = (1.2 * at[0], 1.2 * at[1])
        ships.append(Boat(id=f"ship-{i}", length_m=6.0, width_m=3.0, bow_m=2.0, waypoints_m=(at, to), speed_mps=0.5,
                          turn_deg_per_s=3.0))  # fmt: skip
    return replace(scene, boat=tuple(ships), lidar=(replace(scene.lidar[0], step_deg=step_deg),))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tracker", default="jipda", choices=tuple(TRACKERS))
    parser.add_argument("--scans", type=int, default=250)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    ms, points, held = measure(four_ships(), args.tracker, scans=args.scans, seed=args.seed)
    limit = BUDGET_MS.get(args.tracker)
    budget = "" if limit is None else f", {ms / limit:.2f} of its budget of {limit:g} ms"
    print(f"four-ships, {args.tracker}: {ms:.2f} ms CPU a scan (median){budget}; {points:.0f} points, {held} tracks")
    short = min(args.scans, 60)
    base, _, _ = measure(fleet(4, 0.25), args.tracker, scans=short, seed=args.seed)
    for n in (4, 8, 16, 32):
        ms, points, held = measure(fleet(n, 0.25), args.tracker, scans=short, seed=args.seed)
        print(
            f"{n:3} ships: {ms / base:5.2f} times the CPU of 4, {points:.0f} points a scan, {held} tracks", flush=True
        )
    for step_deg in (0.5, 0.25, 0.125, 0.0625):
        ms, points, held = measure(fleet(4, step_deg), args.tracker, scans=short, seed=args.seed)
        print(f"{step_deg:6g} degree: {ms / base:5.2f} times, {points:.0f} points a scan, {held} tracks", flush=True)


if __name__ == "__main__":
    main()
