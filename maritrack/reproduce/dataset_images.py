"""Screenshots of the campaigns to points: how many vessels are found, and how many blobs are nothing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maritrack.detect.blobs import find_blobs
from maritrack.io.images.mask import picture_mask
from maritrack.io.images.palette import Palette
from maritrack.reproduce.dataset_runs import SCENES, the_scene
from maritrack.simulate.campaign import Campaign, echoes_of, north_up
from maritrack.simulate.campaignwriter import SPECKS, image_settings
from maritrack.simulate.ppi import echo_pixels, render
from maritrack.types import IntArray

NEAR = 9.0  # squared distance within which a pixel is an echo's


@dataclass(frozen=True, slots=True)
class Found:
    """Of one screenshot."""

    vessels: int  # with more than 3 pixels over the threshold
    found: int  # of these; half of their pixels are points
    false: int  # blobs none of whose points is any echo's


def judged(of_frame: tuple[str, int, int]) -> Found:
    """A screenshot by scene, step and seed: rendered, masked and searched for blobs."""
    name, k, seed = of_frame
    scene = the_scene(name)
    config, look = image_settings(scene), north_up(scene, k)
    echoes, _ = echoes_of(scene, k, seed=seed)
    pixels = render(look, echoes, seed=seed * 1_000_003 + k, specks=SPECKS)
    mask, palette = picture_mask(config, look.width, look.height), Palette(config)
    strength = palette.strength(np.concatenate([pixels, pixels[:, :, :1]], axis=2)) * mask
    found = find_blobs(strength, look.pixel_m, config)
    owner = _owners(scene, k, seed, strength >= math.ceil(255.0 * config.threshold))
    n = len(scene.others)
    size = np.bincount(owner[(owner >= 0) & (owner < n)], minlength=n)
    of_point = owner[found.row, found.column]
    taken = np.bincount(of_point[(of_point >= 0) & (of_point < n)], minlength=n)
    real = np.bincount(found.blob, of_point >= 0, len(found.blobs)) > 0
    large = size > 3
    return Found(int(large.sum()), int((large & (2 * taken >= size)).sum()), int((~real).sum()))


def _owners(scene: Campaign, k: int, seed: int, over: np.ndarray) -> IntArray:
    """Whose each pixel over the threshold is: a vessel's number, n = another echo's, -1 = nobody's."""
    echoes, label = echoes_of(scene, k, seed=seed)
    row, column = np.nonzero(over)
    away, owner = np.full(len(row), np.inf), np.full(len(row), -1)
    for e in range(len(echoes)):
        centre, cov = echo_pixels(scene.display, echoes, e)
        d = np.stack([column, row], axis=-1) - centre
        square = np.einsum("bi,ij,bj->b", d, np.linalg.inv(cov), d)
        mine = (square < NEAR) & (square < away)
        owner[mine] = label[e] if label[e] >= 0 else len(scene.others)
        away[mine] = square[mine]
    picture = np.full(over.shape, -1)
    picture[row, column] = owner
    return picture


def frames(per_scene: int, *, seed: int = 1) -> Sequence[tuple[str, int, int]]:
    """Steps of each scene, evenly spaced."""
    steps = {name: np.linspace(5, the_scene(name).scans - 5, per_scene).astype(int).tolist() for name in SCENES}
    return [(name, k, seed) for name in SCENES for k in steps[name]]
