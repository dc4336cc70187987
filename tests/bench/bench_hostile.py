"""Time and memory that hostile inputs cost, beside what zlib alone needs for them.

python -m tests.bench.bench_hostile [--size 10000000] [--only TEXT]

Each input (`tests.io.hostile`, `tests.io.hostile_turns`, `tests.io.pcap_hostile`) is read in a process of its own in
two ways: by its headers, as `maritrack show` does, and as frames whose points are detected, as `maritrack process`
does. Time is that of the processor without the start of the program; memory is that of the whole process. The floor
is `decompressobj().decompress(m, n + 1)` over the same compressed cells within the inflation budget of the reader.
What is asked for: at 10 MB no more than 5 s beyond the floor, and no more than 500 MB. An input whose floor took too
long to be known, or whose reading failed, is not judged.
"""

from __future__ import annotations

import argparse
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
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
path, most = Path(sys.argv[1]), int(sys.argv[2])
resource.setrlimit(resource.RLIMIT_CPU, (most, most + 1))
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


@dataclass(frozen=True, slots=True)
class Cost:
    """What reading took."""

    found: str  # how many scans or streams; why it is not known how many
    seconds: float
    megabytes: float
    timed_out: bool = False
    failed: bool = False


NOTHING = Cost("0", 0.0, 0.0)


def cost(way: str, path: Path, timeout_s: int) -> Cost:
    command = [sys.executable, "-c", START + WAYS[way] + END, str(path), str(timeout_s)]
    told = subprocess.run(command, capture_output=True, text=True, check=False)
    if told.returncode == -signal.SIGXCPU:
        return Cost("timeout", timeout_s, 0.0, timed_out=True)
    if told.returncode:
        return Cost((told.stderr.strip().splitlines() or ["killed"])[-1][:40], 0.0, 0.0, failed=True)
    n, seconds, megabytes = told.stdout.split()
    return Cost(n, float(seconds), float(megabytes))


def verdict(floor: Cost, show: Cost, frames: Cost) -> str:
    """Whether it costs too much; of what isn't known nothing is said to be good."""
    if max(show.seconds, frames.seconds - floor.seconds) > SECONDS or max(show.megabytes, frames.megabytes) > MEGABYTES:
        return "TOO MUCH"
    if any(one.timed_out or one.failed for one in (floor, show, frames)):
        return "not judged"
    return "good"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--size", type=int, default=10_000_000)
    parser.add_argument("--only", default="", help="inputs whose name holds this")
    parser.add_argument("--timeout", type=int, default=120, help="seconds of processor for each")
    args = parser.parse_args()
    limits = f"{SECONDS:g} s beyond zlib or {MEGABYTES:g} MB"
    print(f"{'input':52} {'zlib s':>7} {'show s':>7} {'MB':>5} {'frames s':>8} {'MB':>5}  scans")
    count = Counter[str]()
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "hostile"
        for title, make in INPUTS.items():
            if args.only not in title:
                continue
            path.write_bytes(make(args.size))
            packed = any(word in title for word in COMPRESSED)
            floor = cost("floor", path, args.timeout) if packed else NOTHING
            show, frames = cost("show", path, args.timeout), cost("frames", path, args.timeout)
            judged = verdict(floor, show, frames)
            count[judged] += 1
            row = f"{title:52} {floor.seconds:7.2f} {show.seconds:7.2f} {show.megabytes:5.0f}"
            print(f"{row} {frames.seconds:8.2f} {frames.megabytes:5.0f}  {frames.found:>5}  {judged}", flush=True)
    print(f"{count['TOO MUCH']} cost more than {limits}, {count['not judged']} not judged, {count['good']} good")


if __name__ == "__main__":
    main()
