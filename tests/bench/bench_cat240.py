"""Rates of the CAT240 reader beside their floors, in one run: messages of 1024 cells of 8 bit from a warm file.

python -m tests.bench.bench_cat240 [--messages 32768] [--repeat 15]

The work is cut into laps of some 10 ms, the same for a reader and its floor; the candidates take turns, and of every
lap the best time of the processor counts, so that noise of the machine hits all alike. Two cores are measured by the
best whole run. In brackets is what is asked for. The floors: raw video: pycatzao; zlib: `decompressobj().decompress(m,
n + 1)`, and with libdeflate `zlib.decompress(m)`, over the same streams, taken out beforehand.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from functools import partial
from itertools import accumulate, pairwise
from pathlib import Path

import numpy as np
import pycatzao
from numpy.typing import NDArray

from maritrack.io.cat240 import inflate
from maritrack.io.cat240.encode import encode_video
from maritrack.io.cat240.reader import file_chunks, read_batches
from maritrack.io.containers.pcap import PcapReader
from maritrack.io.containers.pcap_writer import PcapWriter
from maritrack.io.datagrams import Stream

CELLS = 1024
SPOKES = 2048
CELL_FS = 66_712_819
WEAK_SHARE = 0.165
LAP = 1024  # messages
FEW = 2048  # messages that pycatzao is given
SENDER = Stream("10.0.0.1:4000", "239.0.1.2:8600")
TWO_CORES = """
import sys, time
from maritrack.io.cat240.reader import file_chunks, read_batches
path, times, workers = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
start = time.perf_counter()
chunks = (chunk for _ in range(times) for chunk in file_chunks(path))
messages = sum(len(batch.radials) for batch in read_batches(chunks, workers=workers) if batch.radials is not None)
print(messages / (time.perf_counter() - start))
"""

Laps = Callable[[], Iterator[int]]  # does the work of a lap, then tells its messages


def videos(messages: int) -> dict[str, NDArray[np.uint8]]:
    """Cells (messages, CELLS): noise, which zlib packs to some 0.8, and thresholded video, to some 0.37."""
    rng = np.random.default_rng(5)
    noise = np.minimum(8 + rng.exponential(22.0, (messages, CELLS)), 255)
    weak = np.minimum(20 + rng.exponential(18.0, (messages, CELLS)), 255)
    weak[rng.random((messages, CELLS)) >= WEAK_SHARE] = 0
    return {"noisy": noise.astype(np.uint8), "thresholded": weak.astype(np.uint8)}


def blocks(video: NDArray[np.uint8], *, compress: bool) -> list[bytes]:
    borders = np.rint(np.arange(len(video) + 1) * 65_536 / SPOKES).astype(int) % 65_536
    return [
        encode_video(
            sac=7, sic=43, idx=i, start_az=int(borders[i]), end_az=int(borders[i + 1]), start_rg=0, cell_dur=CELL_FS,
            cells=cells, compress=compress, tod=1000 + i // 8,
        )
        for i, cells in enumerate(video)
    ]  # fmt: skip


def rates(candidates: dict[str, Laps], repeat: int) -> dict[str, float]:
    """Messages per second of each, by the best time of every lap."""
    best: dict[str, list[float]] = {}
    done: dict[str, int] = {}
    for _ in range(repeat):
        for name, work in candidates.items():
            times, messages, laps = [], 0, work()
            while True:
                start = time.process_time()
                lap = next(laps, None)
                times.append(time.process_time() - start)
                if lap is None:
                    break
                messages += lap
            best[name] = [min(pair) for pair in zip(times, best.get(name, times), strict=True)]
            done[name] = messages
    return {name: done[name] / sum(times) for name, times in best.items()}


def reading(path: Path, *, libdeflate: bool) -> Iterator[int]:
    there, inflate.LIBDEFLATE = inflate.LIBDEFLATE, libdeflate
    try:
        for batch in read_batches(file_chunks(path)):
            yield 0 if batch.radials is None else len(batch.radials)
    finally:
        inflate.LIBDEFLATE = there


def inflating(streams: list[bytes], laps: list[int], *, bounded: bool) -> Iterator[int]:
    for first, last in pairwise([0, *accumulate(laps)]):
        lap = streams[first:last]
        if bounded:
            for stream in lap:
                zlib.decompressobj().decompress(stream, CELLS + 1)
        else:
            for stream in lap:
                zlib.decompress(stream)
        yield len(lap)


def by_pycatzao(path: Path) -> Iterator[int]:
    for i, _ in enumerate(pycatzao.decode_file(str(path)), 1):
        if i % LAP == 0:
            yield LAP


def capturing(path: Path) -> Iterator[int]:
    for grams in PcapReader(file_chunks(path)).datagrams():
        yield len(grams)


def stream_of(block: bytes) -> bytes:
    octets = block[26] << 8 | block[27]
    return block[32 : 32 + octets]


def two_cores(path: Path, *, times: int, repeat: int, libdeflate: bool) -> float:
    """The best rate with two workers to that without, each in a process of its own."""
    with tempfile.TemporaryDirectory() as name:
        Path(name, "deflate.py").write_text("raise ImportError\n")
        roots = [str(Path(__file__).parents[2]), *([] if libdeflate else [name])]
        env = {**os.environ, "PYTHONPATH": os.pathsep.join(reversed(roots))}
        best = [0.0, 0.0]
        for _ in range(repeat):
            for workers in (1, 2):
                command = [sys.executable, "-c", TWO_CORES, str(path), str(times), str(workers)]
                told = subprocess.run(command, env=env, check=True, capture_output=True, text=True)
                best[workers - 1] = max(best[workers - 1], float(told.stdout))
    return best[1] / best[0]


def bench_raw(folder: Path, video: NDArray[np.uint8], repeat: int) -> None:
    raw = blocks(video, compress=False)
    path, short, capture = folder / "raw.cat240", folder / "short.cat240", folder / "raw.pcap"
    path.write_bytes(b"".join(raw))
    short.write_bytes(b"".join(raw[:FEW]))
    with capture.open("wb") as file:
        writer = PcapWriter(file)
        for i, block in enumerate(raw):
            writer.write(block, t_ns=10**18 + i * 10**6, stream=SENDER)
    found = rates(
        {
            "read": partial(reading, path, libdeflate=False),
            "pycatzao": partial(by_pycatzao, short),
            "pcap": partial(capturing, capture),
        },
        repeat,
    )
    ours, theirs = found["read"], found["pycatzao"]
    print(f"raw: {ours / 1e6:.2f} million messages/s (1), {ours / theirs:.0f} times pycatzao's {theirs:,.0f} (25)")
    print(f"pcap: {found['pcap']:,.0f} datagrams/s (300,000)", flush=True)


def bench_zlib(folder: Path, name: str, video: NDArray[np.uint8], repeat: int) -> None:
    packed = blocks(video, compress=True)
    streams = [stream_of(block) for block in packed]
    assert zlib.decompress(streams[-1]) == video[-1].tobytes()
    path, short = folder / f"{name}.cat240", folder / f"{name}-short.cat240"
    path.write_bytes(b"".join(packed))
    short.write_bytes(b"".join(packed[:FEW]))
    laps = list(reading(path, libdeflate=False))
    candidates: dict[str, Laps] = {
        "zlib": partial(reading, path, libdeflate=False),
        "bounded": partial(inflating, streams, laps, bounded=True),
        "free": partial(inflating, streams, laps, bounded=False),
        "pycatzao": partial(by_pycatzao, short),
    }
    if inflate.LIBDEFLATE:
        candidates["libdeflate"] = partial(reading, path, libdeflate=True)
    found = rates(candidates, repeat)
    ours, bounded, free, theirs = (found[key] for key in ("zlib", "bounded", "free", "pycatzao"))
    share = sum(map(len, streams)) / video.size
    print(f"{name} ({share:.2f} of raw), zlib: {ours:,.0f} messages/s, {ours / bounded:.3f} of bounded inflate (0.95)")
    print(f"    {ours / free:.3f} of zlib.decompress, {ours / theirs:.1f} times pycatzao's {theirs:,.0f}", flush=True)
    if inflate.LIBDEFLATE:
        fast = found["libdeflate"]
        print(f"{name}, libdeflate: {fast:,.0f} messages/s, {fast / free:.3f} of zlib.decompress (1)", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--messages", type=int, default=32_768)
    parser.add_argument("--repeat", type=int, default=15)
    parser.add_argument("--runs", type=int, default=3, help="of each kind with two cores, 0 = none")
    args = parser.parse_args()
    made = videos(args.messages)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bench_raw(folder, made["noisy"], args.repeat)
        for kind, video in made.items():
            bench_zlib(folder, kind, video, args.repeat)
        for kind in made if args.runs else ():
            for libdeflate in (False, True)[: 1 + inflate.LIBDEFLATE]:
                path = folder / f"{kind}.cat240"
                gain = two_cores(path, times=32, repeat=args.runs, libdeflate=libdeflate)
                print(f"{kind}, {'libdeflate' if libdeflate else 'zlib'}: {gain:.2f} times as fast on two cores (1.7)")


if __name__ == "__main__":
    main()
