"""A large recording for benchmarks: CAT240 with zlib, thresholded video, a known number of strong cells.

    python tests/bench/make_recording.py OUT.cat240 --scans 60 --cells 1024

Not a scene: weak echo that rolls from scan to scan (so that the cells pack about as well as those of a real
thresholded radar), blobs for vessels, half of them moving, and single strong cells for clutter.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maritrack.io.cat240.encode import encode_video

DETECT = 128  # cells from here on count as points
TURN_S = 2.5
START_TICKS = 6 * 3600 * 128
CELL_FS = 66_712_819  # 10 m
BASES = 4  # weak fields that take turns
BLOBS = 60  # 30 of them move
IN_BLOBS = 0.7  # share of the points
WEAK_SHARE = 0.165  # of the cells is not zero: packed to some 0.37 of raw, as in a real recording


def benchmark_recording(
    out: Path, *, scans: int, spokes: int = 2048, cells: int = 1024, points_per_scan: int = 5000, seed: int = 0
) -> int:
    """Write OUT and return its octets. Equal arguments give equal octets with the same zlib."""
    partial = out.with_name(out.name + ".partial")
    octets = 0
    with partial.open("wb") as file:
        for k, video in enumerate(_videos(scans, spokes, cells, points_per_scan, seed)):
            octets += file.write(_encode(video, k))
    partial.replace(out)
    return octets


def _videos(scans: int, spokes: int, cells: int, points: int, seed: int) -> Iterator[NDArray[np.uint8]]:
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0,)))
    bases = [_weak(rng, spokes, cells) for _ in range(BASES)]
    shape = _blob_shape(round(IN_BLOBS * points / BLOBS))
    centre = np.stack([rng.uniform(0, spokes, BLOBS), rng.uniform(30, cells - 30, BLOBS)], axis=1)
    drift = rng.uniform(-1.0, 1.0, (BLOBS, 2)) * (np.arange(BLOBS) % 2)[:, None]
    for k in range(scans):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1, k)))
        video = np.roll(bases[k % BASES], int(rng.integers(spokes)), axis=0)
        where = np.rint(centre + k * drift).astype(int)[:, None, :] + shape  # (blobs, n, 2)
        _strike(video, where.reshape(-1, 2), rng)
        single = np.stack([rng.integers(0, spokes, points), rng.integers(0, cells, points)], axis=1)
        _strike(video, single[: max(points - int(np.count_nonzero(video >= DETECT)), 0)], rng)
        yield video


def _weak(rng: np.random.Generator, spokes: int, cells: int) -> NDArray[np.uint8]:
    """Noise and weak clutter below the limit of detection."""
    level = np.minimum(20.0 + rng.exponential(18.0, (spokes, cells)), DETECT - 1)
    return np.where(rng.random((spokes, cells)) < WEAK_SHARE, level, 0.0).astype(np.uint8)


def _blob_shape(n: int) -> NDArray[np.int64]:
    """The n offsets (spoke, cell) of a compact blob, longer in range than in azimuth."""
    side = int(np.sqrt(n)) + 4
    grid = np.stack(np.meshgrid(np.arange(-side, side + 1), np.arange(-side, side + 1), indexing="ij"), -1).reshape(
        -1, 2
    )
    order = np.argsort((grid[:, 0] / 0.7) ** 2 + grid[:, 1] ** 2, kind="stable")
    return grid[order[:n]]


def _strike(video: NDArray[np.uint8], where: NDArray[np.int64], rng: np.random.Generator) -> None:
    """Make cells strong, in place; azimuth goes round, what is out of range is left out."""
    inside = where[(where[:, 1] >= 0) & (where[:, 1] < video.shape[1])]
    level = np.minimum(DETECT + rng.exponential(50.0, len(inside)), 255.0).astype(np.uint8)
    video[inside[:, 0] % len(video), inside[:, 1]] = level


def _encode(video: NDArray[np.uint8], k: int) -> bytes:
    spokes = len(video)
    borders = np.rint(np.arange(spokes + 1) * 65536.0 / spokes).astype(int)
    ticks = START_TICKS + np.rint(TURN_S * 128.0 * (k + (np.arange(spokes) + 0.5) / spokes)).astype(int)
    return b"".join(
        encode_video(
            sac=7, sic=43, idx=k * spokes + j, start_az=int(borders[j]), end_az=int(borders[j + 1]) % 65536,
            start_rg=0, cell_dur=CELL_FS, cells=video[j], compress=True, tod=int(ticks[j]) % (86400 * 128), level=6,
        )
        for j in range(spokes)
    )  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("out", type=Path)
    parser.add_argument("--scans", type=int, default=60)
    parser.add_argument("--spokes", type=int, default=2048)
    parser.add_argument("--cells", type=int, default=1024)
    parser.add_argument("--points", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=0)
    a = parser.parse_args()
    octets = benchmark_recording(
        a.out, scans=a.scans, spokes=a.spokes, cells=a.cells, points_per_scan=a.points, seed=a.seed
    )
    raw = a.scans * a.spokes * a.cells
    print(f"{a.out}: {octets} octets, {octets / raw:.2f} of the raw cells")


if __name__ == "__main__":
    main()
