"""What a sweep costs besides its runs, whether its memory stays, and what a second worker brings.

python -m tests.bench.bench_sweep short [RUNS]        many short runs: CPU a run, resident memory
python -m tests.bench.bench_sweep workers REC [RUNS]  the same runs by one and by two workers
"""

from __future__ import annotations

import json
import os
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from maritrack.sweep import drive
from maritrack.sweep.plan import Run, Settings, plan
from maritrack.sweep.sources import named


def points(path: Path, scans: int) -> Path:
    """Three objects on straight ways, as points."""
    rng = np.random.default_rng(1)
    rows = [
        {"time_s": 2.5 * k, "points": [[500.0 * i + 20 * k + rng.normal(), 900.0 + 5 * k] for i in range(3)]}
        for k in range(scans)
    ]
    path.write_text(json.dumps({"format": "maritrack-points/1", "frame": "enu", "scans": rows}))
    return path


def planned(path: Path, n: int) -> list[Run]:
    return plan(named([str(path)]), axes={}, seeds=range(n), settings=Settings(over={}))


def resident_mib() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


def short(n: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        runs, at = planned(points(Path(folder) / "p.json", 5), n), {}

        def tick(done: int, _failed: int, _of: int) -> None:
            at[done] = (time.process_time(), resident_mib())

        drive.sweep(runs, Path(folder) / "out", tick=tick)
        tables = time.process_time() - at[n][0]
        first, tenth = at[1], at[n // 10]
        each_ms = 1e3 * (at[n][0] - first[0]) / (n - 1)
        alone = sum(t["total_s"] for t in timings(Path(folder) / "out")) / n * 1e3
        print(f"{n} runs: {each_ms:.1f} ms CPU a run after the first, {alone:.1f} in the chain; table {tables:.2f} s")
        print("resident MiB after runs: " + ", ".join(f"{k}: {at[k][1]:.1f}" for k in (1, n // 10, n // 2, n)))
        print(f"growth from the tenth part on: {at[n][1] - tenth[1]:.2f} MiB")


def timings(folder: Path) -> list[dict[str, float]]:
    return [json.loads(line) for line in (folder / "timings.jsonl").read_text().splitlines()]


def workers(path: Path, n: int) -> None:
    runs, took = planned(path, n), []
    for count in (1, 2):
        with tempfile.TemporaryDirectory() as folder:
            wall, own, children = time.monotonic(), time.process_time(), cpu_of_children()
            drive.sweep(runs, Path(folder), workers=count)
            wall, own = time.monotonic() - wall, time.process_time() - own
            if count > 1:
                from joblib.externals.loky import get_reusable_executor

                get_reusable_executor().shutdown(wait=True)
            children = cpu_of_children() - children
            run_s = sum(t["total_s"] for t in timings(Path(folder))) / n
            took.append((wall, own, children))
            print(
                f"{count} workers: wall {wall:.1f} s, CPU {own:.1f} s here, {children:.1f} s there; a run {run_s:.2f} s"
            )
    (wall1, own1, _), (wall2, own2, children) = took
    print(f"load {os.getloadavg()}; wall {wall1 / wall2:.2f} times; CPU, the workers' shared evenly: "
          f"{own1 / (own2 + children / 2):.2f} times")  # fmt: skip


def cpu_of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    if sys.argv[1] == "short":
        short(int(sys.argv[2]) if len(sys.argv) > 2 else 1000)
    else:
        workers(Path(sys.argv[2]), int(sys.argv[3]) if len(sys.argv) > 3 else 40)
