"""Time and memory that hostile inputs cost, beside what zlib alone needs for them.

python -m tests.bench.bench_hostile [--size 10000000] [--only TEXT]

Each input (`tests.io.hostile`, `tests.io.hostile_turns`, `tests.io.pcap_hostile`) is read in a process of its own in
two ways: by its headers, as `maritrack show` does, and as frames whose points are detected, as `maritrack process`
does. Time is that of the processor without the start of the program; memory is that of the whole process. The floor
is `decompressobj().decompress(m, n + 1)` over the same compressed cells within the inflation budget of the reader.
What is asked for: at 10 MB no more than 5 s beyond the floor, and no more than 500 MB.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.io.hostile import CASES
from tests.io.hostile_turns import TURNS
from tests.io.pcap_hostile import KINDS

SECONDS, MEGABYTES = 5.0, 500.0
COMPRESSED = ("zlib", "wide", "8192")  # words in the names of inputs that have a floor
INPUTS = {
    **{f"blocks: {name}": make for name, make in CASES.items()},
    **{f"turns: {name}": make for name, make in TURNS.items()},
    **{f"packets: {name}": make for name, make in KINDS.items()},
}
START = """
import resource, sys, time
from pathlib import Path
path = Path(sys.argv[1])
"""
END = """
print(n, time.process_time() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
"""
WAYS = {
    "floor": """
import zlib
from maritrack.io.cat240.exact import parse_block
from maritrack.io.cat240.framing import window
data, streams, at = path.read_bytes(), [], 0
w, budget = window(0, data, final=True), max(4 << 20, 256 * len(data))
while 3 <= (length := int.from_bytes(data[at + 1 : at + 3], "big")) and at + length <= len(data):
    for v in parse_block(w, at, at + length).videos if data[at] == 240 else ():
        if v.compressed and v.most_cells <= budget:
            budget -= v.most_cells
            streams.append((v.first, v.stop, (v.most_cells * v.bits + 7 >> 3) + 1))
    at += length
start, n = time.process_time(), len(streams)
for first, stop, most in streams:
    try:
        zlib.decompressobj().decompress(data[first:stop], most)
    except zlib.error:
        pass
""",
    "show": """
from maritrack.io.octets import octets_from_file
from maritrack.survey import survey
start = time.process_time()
n = survey(octets_from_file(path, ""))["scans"]
""",
    "frames": """
from maritrack.chain import detect
from maritrack.io.cat240_source import Cat240Source
from maritrack.io.octets import octets_from_file
from maritrack.settings import Config
start, n, config = time.process_time(), 0, Config()
for frame in Cat240Source(octets_from_file(path, "/input/cat240"), config.input).frames():
    detect(frame.scan, config)
    n += 1
""",
}


def cost(way: str, path: Path, timeout_s: float) -> tuple[str, float, float]:
    """What was found, seconds and megabytes."""
    command = [sys.executable, "-c", START + WAYS[way] + END, str(path)]
    try:
        told = subprocess.run(command, capture_output=True, text=True, timeout=timeout_s, check=False)
    except subprocess.TimeoutExpired:
        return "timeout", timeout_s, 0.0
    if told.returncode:
        return told.stderr.strip().splitlines()[-1][:40], 0.0, 0.0
    n, seconds, megabytes = told.stdout.split()
    return n, float(seconds), float(megabytes)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--size", type=int, default=10_000_000)
    parser.add_argument("--only", default="", help="inputs whose name holds this")
    parser.add_argument("--timeout", type=float, default=120.0, help="seconds for each")
    args = parser.parse_args()
    limits = f"{SECONDS:g} s beyond zlib or {MEGABYTES:g} MB"
    print(f"{'input':52} {'zlib s':>7} {'show s':>7} {'MB':>5} {'frames s':>8} {'MB':>5}  scans")
    over = 0
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "hostile"
        for title, make in INPUTS.items():
            if args.only not in title:
                continue
            path.write_bytes(make(args.size))
            packed = any(word in title for word in COMPRESSED)
            floor_s = cost("floor", path, args.timeout)[1] if packed else 0.0
            _, show_s, show_mb = cost("show", path, args.timeout)
            found, frames_s, frames_mb = cost("frames", path, args.timeout)
            bad = max(show_s, frames_s - floor_s) > SECONDS or max(show_mb, frames_mb) > MEGABYTES
            over += bad
            row = f"{title:52} {floor_s:7.2f} {show_s:7.2f} {show_mb:5.0f} {frames_s:8.2f} {frames_mb:5.0f}"
            print(f"{row}  {found}{'  TOO MUCH' * bad}", flush=True)
    print(f"{over} cost more than {limits}")


if __name__ == "__main__":
    main()
