"""The recording for benchmarks has the size and the number of points that it promises."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
import pytest

from tests.bench.make_recording import benchmark_recording


@pytest.mark.parametrize("cells", [700, 1024])
def test_the_benchmark_recording_packs_like_real_video_and_has_the_points_asked_for(tmp_path: Path, cells: int) -> None:
    out = tmp_path / "bench.cat240"
    octets = benchmark_recording(out, scans=2, spokes=2048, cells=cells, points_per_scan=5000, seed=1)
    data = out.read_bytes()
    assert octets == len(data)
    assert 0.3 < octets / (2 * 2048 * cells) < 0.42
    strong, at = [], 0
    while at < len(data):
        body = zlib.decompressobj().decompress(data[at + 32 :])
        strong.append(int(np.count_nonzero(np.frombuffer(body, np.uint8) >= 128)))
        assert len(body) == cells
        at += int.from_bytes(data[at + 1 : at + 3], "big")
    per_scan = np.array(strong).reshape(2, 2048).sum(axis=1)
    assert np.all(np.abs(per_scan - 5000) < 100)


def test_the_benchmark_recording_is_the_same_each_time(tmp_path: Path) -> None:
    for name in ("a", "b"):
        benchmark_recording(tmp_path / name, scans=3, spokes=64, cells=200, points_per_scan=100, seed=4)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
