"""The engm paper's filters: CPU of a run of 101 scans, and how CPU a scan grows with the number of particles.

python -m tests.bench.bench_phd [--scans 25] [--numbers 250 500 1000 2500 5000 10000]
The budget: 0.5 s a run of engm-phd, 1.0 s of gm-phd, with the paper's preset, on one core that does nothing else. The
growth exponent is the slope of log CPU against log N, of all numbers and of the last two; 1 is proportional.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from maritrack.chain import build_chain, process
from maritrack.config import load_config
from maritrack.reproduce.engm_runs import TRACKERS, VARIANTS, run_variant, the_scene, truth_frame
from maritrack.simulate.pointscene import scan_of
from maritrack.types import Frame

GROWING = ("smc-phd", "engm-phd")
NUMBERS = (250, 500, 1000, 2500, 5000, 10_000)


def frames(scans: int) -> list[Frame]:
    """The crossing's first scans."""
    scene = the_scene()
    return [Frame(k, scan_of(scene, k, seed=1), truth_frame(scene, k)) for k in range(scans)]


def run_seconds(tracker: str) -> float:
    """CPU of clustering and tracking in a whole run, the least of three."""
    variant = next(v for v in VARIANTS if v.name == tracker)
    return min(run_variant(variant, frames(the_scene().scans), seed).cpu_s for seed in (1, 2, 3))


def scan_ms(tracker: str, n: int, scans: int) -> float:
    """CPU of tracking a scan with n particles, the median."""
    chain = build_chain(load_config(preset="engm", over={"tracker_name": tracker, "intensity": {"components": n}}))
    state, cpu = chain.init(), []
    for frame in frames(scans):
        state, result = process(chain, state, frame)
        cpu.append(result.timing_ms["track"])
    return float(np.median(cpu))


def slope(numbers: Sequence[int], cpu_ms: Sequence[float]) -> float:
    """Of log CPU against log N."""
    return float(np.polyfit(np.log(numbers), np.log(cpu_ms), 1)[0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scans", type=int, default=25)
    parser.add_argument("--numbers", type=int, nargs="+", default=NUMBERS)
    args = parser.parse_args()
    for tracker in TRACKERS:
        print(f"{tracker}: {run_seconds(tracker):.2f} s CPU a run of 101 scans", flush=True)
    for tracker in GROWING:
        cpu_ms = [scan_ms(tracker, n, args.scans) for n in args.numbers]
        told = ", ".join(f"{n}: {ms:.1f}" for n, ms in zip(args.numbers, cpu_ms, strict=True))
        print(f"{tracker}: CPU (ms) a scan by N: {told}", flush=True)
        last = slope(args.numbers[-2:], cpu_ms[-2:])
        print(f"{tracker}: growth exponent {slope(args.numbers, cpu_ms):.2f}, of the last two {last:.2f}", flush=True)


if __name__ == "__main__":
    main()
