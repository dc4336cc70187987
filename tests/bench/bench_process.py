"""CPU of the whole of `process` beside the floor: pycatzao decoding the same file and nothing more; and memory.

python -m tests.bench.bench_process [--scans 160] [--cells 1024] [--memory]
The recording is made here: 2048 spokes a scan, zlib, thresholded video, 5,000 points a scan.
--memory runs a recording four times as long as well and prints the ratio of the peaks.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.bench.make_recording import benchmark_recording

FLOOR = "import pycatzao, sys\nfor _ in pycatzao.decode_file(sys.argv[1]): pass"
PROCESS = "import sys\nfrom maritrack_cli.main import main\nsys.argv = ['maritrack', *sys.argv[1:]]\nmain()"


def cpu_s(code: str, *args: str) -> float:
    """CPU seconds, user and system, of a Python process and its children."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", code, *args], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def peak_mb(path: Path, out: Path) -> float:
    """Peak resident memory of `process` in MB."""
    code = PROCESS.replace(
        "\nmain()", "\ntry:\n    main()\nfinally:\n    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    )
    done = subprocess.run(
        [sys.executable, "-c", "import resource\n" + code, "process", str(path), "-o", str(out), "-q"],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    return int(done.stdout.split()[-1]) / 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scans", type=int, default=160)
    parser.add_argument("--cells", type=int, default=1024)
    parser.add_argument("--memory", action="store_true")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = folder / "rec.cat240"
        benchmark_recording(path, scans=args.scans, cells=args.cells)
        ours = cpu_s(PROCESS, "process", str(path), "-o", str(folder / "out"), "-q")
        floor = cpu_s(FLOOR, str(path))
        print(f"process {ours:.1f} s CPU, pycatzao.decode_file {floor:.1f} s: ratio {ours / floor:.2f}", flush=True)
        if args.memory:
            benchmark_recording(folder / "long.cat240", scans=4 * args.scans, cells=args.cells)
            short, long = (peak_mb(folder / f, folder / f"out-{f}") for f in ("rec.cat240", "long.cat240"))
            print(f"peak {short:.0f} MB, four times as long {long:.0f} MB: ratio {long / short:.3f}")


if __name__ == "__main__":
    main()
