"""Background subtraction on a region of 1000 x 1000 pixels with 256 counts, beside the dense definition.

`python -m tests.bench.bench_background [--scans N] [--land N]` feeds both models the same harbour: quays that come
in every scan, cranes and moored boats that flicker, sea clutter anywhere; some 20,000 points in 3,000 pixels a scan.
It prints CPU per scan and memory of either, checks that they agree, and exits with 1 where the sparse model with its
mask is less than 50 times faster than the dense update without one, or takes 100 MB. `--land N` pixels of land change
the load.
"""

from __future__ import annotations

import argparse
import sys
import time
import tracemalloc
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import numpy as np

from maritrack import geo
from maritrack.detect.background import Background, mask_of, no_background, psi_of, take_counts
from maritrack.settings import SubtractConfig
from maritrack.types import IntArray

SIDE, CATEGORIES = 1000, 256
RULES = SubtractConfig(method="abs", categories=CATEGORIES, pixel_m=10.0)


def harbour(scans: int, n_land: int, *, seed: int = 0) -> Iterator[tuple[IntArray, IntArray]]:
    """Pixels (h,), ascending, and their counts (h,) in each scan: of land, and a tenth as many of the sea."""
    rng = np.random.default_rng(seed)
    land = rng.choice(SIDE**2, n_land, replace=False)
    level = rng.choice([0.5, 4.0, 16.0], len(land))
    for _ in range(scans):
        count = np.zeros(SIDE**2, np.int64)
        count[land] = rng.poisson(level)
        count[rng.integers(0, SIDE**2, n_land // 10)] += 1
        pixel = np.flatnonzero(count)
        yield pixel, np.minimum(count[pixel], CATEGORIES - 1)


def keys(pixel: IntArray) -> IntArray:
    """Pixels of the region as keys of the grid."""
    row, column = np.divmod(pixel, SIDE)
    return geo.pixel_key((np.stack([column, row], axis=-1) + 0.5) * RULES.pixel_m, RULES.pixel_m)


def dense_update(psi: Any, pixel: IntArray, count: IntArray, a: float) -> None:
    """The definition, in place: psi <- a psi, and 1 - a more for what was observed, 0 where there was nothing."""
    psi *= np.float32(a)
    psi[:, 0] += np.float32(1 - a)
    psi[pixel, 0] -= np.float32(1 - a)
    psi[pixel, count] += np.float32(1 - a)


def dense_mask(psi: Any) -> Any:
    """Whether the likeliest count exceeds the threshold, of each pixel."""
    return psi.argmax(axis=1) > RULES.threshold


def main(scans: int, n_land: int) -> int:
    """Run both and print."""
    a = RULES.learning_rate
    fed = [(pixel, keys(pixel), count) for pixel, count in harbour(scans, n_land)]
    psi = np.full((SIDE**2, CATEGORIES), 1 / CATEGORIES, np.float32)
    dense_s, mask_s = [], []
    for pixel, _, count in fed:
        at = time.process_time()
        dense_update(psi, pixel, count, a)
        dense_s.append(time.process_time() - at)
        dense_mask(psi)
        mask_s.append(time.process_time() - at)
    model, sparse_s = no_background(), []
    for _, key, count in fed:
        at = time.process_time()
        model = take_counts(model, key, count, np.ones(len(model), bool), RULES, rate=a)
        mask_of(model, RULES)
        sparse_s.append(time.process_time() - at)
    error = np.abs(psi_of(model, keys(fed[0][0]), RULES) - psi[fed[0][0]]).max()
    peak_mb = peak(model, fed[-1][1], fed[-1][2]) / 1e6
    ratio, masked = (float(np.median(dense) / np.median(sparse_s)) for dense in (dense_s, mask_s))
    print(f"dense, float32: {1e3 * np.median(dense_s):.0f} ms a scan, {1e3 * np.median(mask_s):.0f} ms with its mask, "
          f"{psi.nbytes / 1e6:.0f} MB")  # fmt: skip
    print(f"sparse, exact: {1e3 * np.median(sparse_s):.2f} ms a scan with its mask, {peak_mb:.0f} MB at the peak of an "
          f"update, {len(model)} pixels; largest difference {error:.1e}")  # fmt: skip
    print(f"{ratio:.0f} times faster than the dense update alone, {masked:.0f} times than it with its mask")
    return 0 if ratio >= 50 and peak_mb < 100 and error < 1e-5 else 1


def peak(model: Background, key: IntArray, count: IntArray) -> int:
    """Octets of the model, and what an update takes besides."""
    arrays = [getattr(part, f.name) for part in (model, model.pairs) for f in fields(part)]
    held = sum(array.nbytes for array in arrays if isinstance(array, np.ndarray))
    tracemalloc.start()
    take_counts(model, key, count, np.ones(len(model), bool), RULES, rate=RULES.learning_rate)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return held + most


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scans", type=int, default=12)
    parser.add_argument("--land", type=int, default=3000)
    given = parser.parse_args()
    sys.exit(main(given.scans, given.land))
