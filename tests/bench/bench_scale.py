"""CPU of a tracker alone in crowded scenes: n vessels among 2 n clusters a scan, from 100 to 1,000.

python -m tests.bench.bench_scale [--tracker jipda] [--vessels 100 1000] [--side-km 40] [--scans 30]
Vessels keep their courses on a square, each is a cluster of cells nine scans in ten; the other clusters are
clutter. Detection and clustering are not measured; the first ten scans, in which tracks begin, are told apart.
"""

from __future__ import annotations

import argparse
import os
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from maritrack import geo
from maritrack.config import load_config
from maritrack.trackers import TRACKERS
from maritrack.types import CONFIRMED, Clusters, FloatArray, Points, Scan, Sensor

TURN_S, WARM = 2.5, 10
SENSOR = Sensor("radar", 15.0, 2 * np.pi / 4096, 30_000.0)


def scan_of(clusters: Clusters, k: int) -> tuple[Scan, Points]:
    """The scan of these clusters: one point each, which tells the times of the beam."""
    n, start_ns = len(clusters), round(k * TURN_S * 1e9)
    points = Points(
        range_m=clusters.range_m, azimuth_rad=clusters.azimuth_rad, position_m=clusters.mean_m,
        intensity=np.ones(n), t_ns=clusters.t_ns, range_width_m=np.full(n, SENSOR.range_res_m),
        azimuth_width_rad=np.full(n, SENSOR.azimuth_res_rad),
    )  # fmt: skip
    end_ns = start_ns + round(TURN_S * 1e9)
    return Scan(SENSOR, end_ns, start_ns, np.zeros(2), np.nan, points=points), points


def clusters_at(z: FloatArray, count: FloatArray, k: int, rng: np.random.Generator) -> Clusters:
    """Clusters at z (n, 2) of so many cells (n,), with the scatter of hulls of about 60 x 20 m, ordered by azimuth."""
    range_m, azimuth = geo.en_to_polar(z)
    order = np.argsort(azimuth)
    z, range_m, azimuth, n = z[order], range_m[order], azimuth[order], len(z)
    cells = count[order].astype(np.int64)
    angle = rng.uniform(0, np.pi, n)
    u = np.stack([np.cos(angle), np.sin(angle)], 1)
    shape = 25.0 * np.eye(2) + 200.0 * u[:, :, None] * u[:, None, :]
    across = (range_m * SENSOR.azimuth_res_rad) ** 2 / 12.0
    noise = geo.polar_cov_to_en(range_m, azimuth, np.full(n, SENSOR.range_res_m**2 / 12.0), across / range_m**2)
    t_ns = round(k * TURN_S * 1e9) + np.rint(azimuth / geo.TWO_PI * TURN_S * 1e9).astype(np.int64)
    return Clusters(
        mean_m=z, scatter_m2=cells[:, None, None] * (shape + noise), count=cells, weight_sq=1.0 / cells,
        noise_m2=noise, t_ns=t_ns, range_m=range_m, azimuth_rad=azimuth, intensity=cells.astype(np.float64),
        label=np.zeros(0, np.int64),
    )  # fmt: skip


def measure(name: str, vessels: int, *, side_m: float, scans: int, seed: int) -> dict[str, float]:
    """Median and greatest CPU (ms) of a scan after the first ten, tracks confirmed at the end, pairs in gates."""
    rng, config = np.random.default_rng(seed), load_config(preset="radar", sets=[f"tracker_name={name}"])
    tracker, half = TRACKERS[name](config), side_m / 2
    state, cpu_ms = tracker.init(), []
    x, v = rng.uniform(-half, half, (vessels, 2)), rng.uniform(-8, 8, (vessels, 2))
    for k in range(scans):
        seen = (x + k * TURN_S * v)[rng.random(vessels) < 0.9] if vessels else x
        seen = seen + rng.normal(0, 5, seen.shape)
        noise = rng.uniform(-half, half, (2 * vessels - len(seen), 2))
        count = np.concatenate([rng.integers(6, 30, len(seen)), rng.integers(3, 8, len(noise))])
        clusters = clusters_at(np.concatenate([seen, noise]), count, k, rng)
        scan, points = scan_of(clusters, k)
        at = time.process_time()
        state, _ = tracker.update(state, scan, points, clusters)
        tracks = tracker.estimate(state)
        cpu_ms.append(1e3 * (time.process_time() - at))
    steady = cpu_ms[WARM:]
    return {
        "median_ms": float(np.median(steady)), "most_ms": max(steady), "rows": float(len(tracks)),
        "confirmed": float((tracks.status >= CONFIRMED).sum()), "clusters": float(len(clusters)),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tracker", default="jipda", choices=tuple(TRACKERS))
    parser.add_argument("--vessels", type=int, nargs="+", default=[100, 1000])
    parser.add_argument("--side-km", type=float, default=40.0)
    parser.add_argument("--scans", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    found = []
    for n in args.vessels:
        r = measure(args.tracker, n, side_m=1e3 * args.side_km, scans=args.scans, seed=args.seed)
        found.append(r["median_ms"])
        print(
            f"{args.tracker}: {n} vessels, {r['clusters']:.0f} clusters a scan: median {r['median_ms']:.0f} ms CPU, "
            f"most {r['most_ms']:.0f}; {r['rows']:.0f} tracks, {r['confirmed']:.0f} confirmed",
            flush=True,
        )
    print(f"cost of the last over the first: {found[-1] / found[0]:.1f}")


if __name__ == "__main__":
    main()
