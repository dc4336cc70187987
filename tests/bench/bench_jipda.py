"""A tracker on point detections: CPU per scan and GOSPA, beside a peer on the same detections in the same run.

python -m tests.bench.bench_jipda [SCENE.json ...] [--tracker NAME] [--peer "COMMAND"] [--method NAME] [--scans N]
Without scenes: made here, 10 objects with 20 and 50 with 100 clutter points a scan. COMMAND is run as
`COMMAND SCENE.json METHOD [SCANS]` and prints one JSON line with scans, cpu_ms_per_scan_mean and mean_gospa_c100_p2.
Both are judged over the scans that the peer got through. `--tracker gm-phd --method gmphd` races the PHD filters.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from maritrack import geo
from maritrack.cluster.stage import cluster_points
from maritrack.config import load_config
from maritrack.metrics import gospa
from maritrack.trackers import TRACKERS
from maritrack.types import CONFIRMED, Points, Scan, Sensor
from tests.bench.linear_gaussian import scene


def scan_of(document: dict[str, Any], sigma_m: float) -> Scan:
    """A scan of point detections in east-north about the sensor."""
    z = np.array(document["detections"], float).reshape(-1, 2)
    n, t_ns = len(z), round(document["t"] * 1e9)
    range_m, azimuth = geo.en_to_polar(z)
    points = Points(
        range_m=range_m, azimuth_rad=azimuth, position_m=z, intensity=np.ones(n), t_ns=np.full(n, t_ns),
        range_width_m=np.zeros(n), azimuth_width_rad=np.zeros(n), cov_m2=np.tile(np.eye(2) * sigma_m**2, (n, 1, 1)),
    )  # fmt: skip
    return Scan(Sensor("points", 0.0, 0.0, np.inf), t_ns, t_ns, np.zeros(2), np.nan, points=points)


def measure(document: dict[str, Any], name: str = "jipda", scans: int = 0) -> dict[str, float]:
    """Mean GOSPA (c = 100 m, p = 2) of confirmed tracks and CPU a scan of clustering and tracking, first `scans`."""
    config = load_config(preset="points", sets=[f"tracker_name={name}"])
    tracker = TRACKERS[name](config)
    state, cpu, values = tracker.init(), [], []
    for entry in document["scans"][: scans or None]:
        scan = scan_of(entry, document["meta"]["sigma_z"])
        assert scan.points is not None
        at = time.process_time()
        clusters = cluster_points(scan.points, scan, config.cluster, config.input)
        state, _ = tracker.update(state, scan, scan.points, clusters)
        tracks = tracker.estimate(state)
        cpu.append(time.process_time() - at)
        k = entry["k"]
        alive = [t["states"][k - t["k0"]] for t in document["truth"] if 0 <= k - t["k0"] < len(t["states"])]
        truth = np.array(alive).reshape(-1, 4)[:, [0, 2]]
        values.append(gospa(truth, tracks.position_m[tracks.status >= CONFIRMED], c=100.0, p=2.0).total)
    return {"gospa": float(np.mean(values)), "cpu_ms_per_scan": 1e3 * float(np.mean(cpu))}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", type=Path)
    parser.add_argument("--peer", default="")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--tracker", default="jipda", choices=tuple(TRACKERS))
    parser.add_argument("--method", default="jpda_pyehm2")
    parser.add_argument("--scans", type=int, default=0)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        paths = args.scenes or [
            _write(Path(folder) / f"t{t}_c{c}_s{s}.json", scene(n_targets=t, clutter_per_scan=c, seed=s))
            for t, c in ((10, 20), (50, 100))
            for s in range(args.seeds)
        ]
        for path in paths:
            scans, peer = args.scans, {}
            if args.peer:
                command = [*shlex.split(args.peer), str(path), args.method, *([str(scans)] if scans else [])]
                told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
                peer = json.loads(told.splitlines()[-1])
                scans = peer["scans"]
            ours = measure(json.loads(path.read_text()), args.tracker, scans)
            line = f"{path.stem}: GOSPA {ours['gospa']:.1f} m, {ours['cpu_ms_per_scan']:.2f} ms CPU per scan"
            if peer:
                ratio = peer["cpu_ms_per_scan_mean"] / ours["cpu_ms_per_scan"]
                line += f"; peer GOSPA {peer['mean_gospa_c100_p2']:.1f} m, {ratio:.0f} times the CPU, {scans} scans"
            print(line, flush=True)


def _write(path: Path, document: dict[str, Any]) -> Path:
    path.write_text(json.dumps(document))
    return path


if __name__ == "__main__":
    main()
