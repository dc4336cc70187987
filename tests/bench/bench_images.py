"""Frames of 1050 x 1024 pixels from PNG to points: CPU per stage and frame, beside plain scikit-image.

`python -m tests.bench.bench_images [--frames N]` renders screenshots of two displays with twelve vessels, specks and
sea clutter, then reads them as `maritrack process` does. It ends with 1 where 780 frames would take a minute of CPU.
"""

from __future__ import annotations

import argparse
import io
import math
import sys
import time
from collections.abc import Iterator

import numpy as np
from PIL import Image

from maritrack.detect.blobs import scales_px, under, without_specks
from maritrack.detect.hessian import blobs
from maritrack.io.images.decode import decode
from maritrack.io.images.mask import picture_mask
from maritrack.io.images.palette import Palette
from maritrack.simulate.ppi import Look, render
from tests.ppi_scenes import DAAN, MANV, fleet, settings_of

RECORDING, MOST_S = 780, 60.0
STAGES = ("decode", "palette and mask", "threshold and specks", "blobs", "points")


def screenshots(look: Look, n: int) -> Iterator[bytes]:
    for seed in range(n):
        out = io.BytesIO()
        pixels = render(look, fleet(look, n=12, seed=seed), seed=seed, specks=100, sea_clutter=0.2)
        Image.fromarray(pixels).save(out, "PNG")
        yield out.getvalue()


def timed(look: Look, n: int) -> tuple[dict[str, float], float]:
    """CPU in ms per frame of each stage, and of scikit-image's blobs at its defaults on one frame."""
    from skimage.feature import blob_doh

    config = settings_of(look, palette="red")
    spent = dict.fromkeys(STAGES, 0.0)
    begun = time.process_time()
    mask, palette = picture_mask(config, look.width, look.height), Palette(config)
    spent["palette and mask"] += time.process_time() - begun
    least = math.ceil(255 * config.threshold)
    left = np.zeros((1, 1), np.uint8)
    for data in screenshots(look, n):
        at = [time.process_time()]
        pixels = decode(data, max_pixels=config.max_pixels)
        at.append(time.process_time())
        strength = palette.strength(pixels) * mask
        at.append(time.process_time())
        left = without_specks(np.where(strength >= least, strength, np.uint8(0)), config.min_pixels)
        at.append(time.process_time())
        scales = scales_px(config.blob_min_m, config.blob_max_m, look.pixel_m)
        seen = blobs(left, scales, threshold=config.blob_threshold, overlap=config.blob_overlap)
        at.append(time.process_time())
        under(left, seen, config.blob_reach)
        at.append(time.process_time())
        for name, a, b in zip(STAGES, at, at[1:], strict=False):
            spent[name] += b - a
    begun = time.process_time()
    blob_doh(left / 255.0)
    return {name: value / n * 1e3 for name, value in spent.items()}, (time.process_time() - begun) * 1e3


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else "")
    parser.add_argument("--frames", type=int, default=30)
    frames = parser.parse_args().frames
    slow = False
    for name, look in (("12.34 m a pixel", DAAN), ("6.01 m a pixel", MANV)):
        stages, plain = timed(look, frames)
        total = sum(stages.values())
        print(f"{name}: {total:.1f} ms a frame, {total * RECORDING / 1e3:.1f} s for {RECORDING} frames")
        for stage, value in stages.items():
            print(f"  {stage:<22}{value:7.1f} ms")
        print(f"  scikit-image blob_doh {plain:7.1f} ms in place of {stages['blobs']:.1f}")
        slow |= total * RECORDING / 1e3 >= MOST_S
    return int(slow)


if __name__ == "__main__":
    sys.exit(main())
