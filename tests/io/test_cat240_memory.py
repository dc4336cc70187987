"""No input makes the reader take memory: measured in a process of its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import resource, sys, zlib
from maritrack.io.cat240.reader import read_batches
from tests.io.cat240_blocks import block, packed_video, video

def bomb(idx, nbcells):
    return block(packed_video(idx, bytes(60_000_000), nbcells=nbcells))

def stream(kind):
    if kind == "zip bombs":
        one = bomb(0, 16)
        return (one for _ in range(20))
    if kind == "zip bombs with many cells declared":
        one = bomb(0, 2**24 - 1)
        return (one for _ in range(20))
    if kind == "wide radials":
        return (block(packed_video(i, bytes(524_288))) for i in range(200))
    if kind == "one wide radial among narrow ones":
        return (block(packed_video(i, bytes(500_000 if i % 100 == 0 else 10))) for i in range(8_000))
    if kind == "blocks of nothing":
        return (b"\\xf0\\0\\4\\0" * 100_000 for _ in range(2))
    if kind == "other categories":
        return (b"\\x30\\0\\3" * 400_000 for _ in range(1))
    if kind == "octets":
        return (bytes(range(256)) * 4000 for _ in range(60))
    if kind == "one octet at a time":
        return (b"\\xf0\\0\\2abc"[i % 6 : i % 6 + 1] for i in range(1_200_000))
    if kind == "records in one block":
        one = block(*(b"\\xd0\\1\\2\\1\\0" for _ in range(13_000)))
        return (one for _ in range(6))
    return (block(video(i, sac_sic=(i >> 8 & 255, i & 255))) for i in range(70_000))

made = list(stream(sys.argv[1])) if "octet" not in sys.argv[1] else stream(sys.argv[1])
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
octets = sum(len(batch.octets) for batch in read_batches(made))
print(octets, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024)
"""
KINDS = (
    "zip bombs", "zip bombs with many cells declared", "wide radials", "one wide radial among narrow ones",
    "blocks of nothing", "other categories", "octets", "one octet at a time", "records in one block", "sensors",
)  # fmt: skip
LIMIT_MB = 120  # a window, a batch of 32 MiB and a copy of its cells, and what Python keeps


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="ru_maxrss is counted in kB on Linux only")
@pytest.mark.parametrize("kind", KINDS)
def test_hostile_input_takes_little_memory(kind: str) -> None:
    root = Path(__file__).resolve().parents[2]
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM, kind], cwd=root, capture_output=True, text=True, check=True, timeout=300
    )
    octets, grown_mb = map(int, run.stdout.split())
    assert octets > 100_000
    assert grown_mb < LIMIT_MB
