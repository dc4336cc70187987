"""CPU of the Poisson multi-Bernoulli trackers: four ships beside jipda, and scans made to be hard.

python -m tests.bench.bench_pmbm [--scans 250] [--seed 1]
On the four ships of the extended paper `gp-pmbm` is told as times `jipda` in the same run (growth with ships, points:
tests.bench.bench_lidar --tracker gp-pmbm). Hard scans, five of each: the slowest one in ms of the tracker, what `jipda`
takes for its slowest of the same clusters, rows that are left, and the memory of the process.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
from collections.abc import Callable, Iterable

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from maritrack import geo
from maritrack.chain import build_chain, process
from maritrack.config import load_config
from maritrack.simulate.lidarscene import LidarScene, scans_of
from maritrack.simulate.scenes import load_any
from maritrack.types import FloatArray, Frame, Points, Scan, Sensor

Make = Callable[[np.random.Generator], FloatArray]


def scan_of(z: FloatArray, k: int) -> Scan:
    """Points z (n, 2) of one time."""
    (range_m, azimuth), n, t_ns = geo.en_to_polar(z), len(z), round(k * 2.5e9)
    points = Points(
        range_m=range_m, azimuth_rad=azimuth, position_m=z, intensity=np.ones(n), t_ns=np.full(n, t_ns),
        range_width_m=np.zeros(n), azimuth_width_rad=np.zeros(n),
    )  # fmt: skip
    return Scan(Sensor("points", 0.0, 0.0, np.inf), t_ns, t_ns, np.zeros(2), np.nan, points=points)


def track_ms(preset: str, tracker: str, scans: Iterable[Scan]) -> tuple[list[float], int]:
    """CPU of the tracker for each scan, and how many rows its state has in the end."""
    chain = build_chain(load_config(preset=preset, sets=[f"tracker_name={tracker}"]))
    state, cpu = chain.init(), []
    for k, scan in enumerate(scans):
        state, result = process(chain, state, Frame(k, scan))
        cpu.append(result.timing_ms["track"])
    rows = getattr(state.tracker, "rows", state.tracker)
    return cpu, len(rows)


def square(half_m: float, n: int) -> Make:
    """Points anywhere in a square."""
    return lambda rng: rng.uniform(-half_m, half_m, (n, 2))


def blobs(n: int, each: int) -> Make:
    """Crowds of points at places that stay."""
    at = np.random.default_rng(1).uniform(-100.0, 100.0, (n, 2))
    return lambda rng: (at[:, None] + rng.normal(0.0, 1.0, (n, each, 2))).reshape(-1, 2)


def steady(half_m: float, n: int) -> Make:
    """Objects that stay where they are."""
    at = np.random.default_rng(1).uniform(-half_m, half_m, (n, 2))
    return lambda rng: at + rng.normal(0.0, 5.0, at.shape)


HARD: dict[str, tuple[str, str, Make]] = {
    "giw-pmbm, 5,000 clusters anywhere in 20 km": ("points", "giw-pmbm", square(10_000.0, 5000)),
    "giw-pmbm, 5,000 clusters anywhere in 1 km": ("points", "giw-pmbm", square(500.0, 5000)),
    "giw-pmbm, 3,000 objects that stay in 6 km": ("points", "giw-pmbm", steady(3000.0, 3000)),
    "gp-pmbm, 10,000 points anywhere in 200 m": ("extended", "gp-pmbm", square(100.0, 10_000)),
    "gp-pmbm, 10,000 points anywhere in 4 km": ("extended", "gp-pmbm", square(2000.0, 10_000)),
    "gp-pmbm, 60 hulls of 160 points in 200 m": ("extended", "gp-pmbm", blobs(60, 160)),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scans", type=int, default=250)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    scene = load_any("four-ships")
    assert isinstance(scene, LidarScene)
    scans = [scans_of(scene, k, seed=args.seed)[0] for k in range(args.scans)]
    ours, _ = track_ms("extended", "gp-pmbm", scans)
    peer, _ = track_ms("extended", "jipda", scans)
    ratio = statistics.median(ours) / statistics.median(peer)
    print(
        f"four-ships: gp-pmbm median {statistics.median(ours):.0f}, 95 % {np.quantile(ours, 0.95):.0f}, "
        f"most {max(ours):.0f} ms a scan; {ratio:.0f} times jipda",
        flush=True,
    )
    for name, (preset, tracker, make) in HARD.items():
        told = []
        for one in (tracker, "jipda"):
            rng = np.random.default_rng(args.seed)
            told.append(track_ms(preset, one, [scan_of(make(rng), k) for k in range(5)]))
        (mine, rows), (theirs, _) = told
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        print(f"{name}: {max(mine):.0f} ms, jipda {max(theirs):.0f} ms; {rows} rows, {memory} MB so far", flush=True)


if __name__ == "__main__":
    main()
