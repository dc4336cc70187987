"""Screenshots for tests: vessels at random places under several displays, and what of them is to be found."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maritrack.detect.blobs import Found
from maritrack.imagesettings import ImageConfig
from maritrack.simulate.ppi import Echoes, Look, echo_pixels
from maritrack.types import FloatArray

DAAN = Look()  # near-white on blue, 12 m a pixel
MANV = Look(
    centre_px=(514.0, 528.0), pixel_m=6.01, sea=(8, 12, 40), frame=(10, 10, 10), ring=(70, 70, 90),
    text=(160, 160, 170), line=(110, 110, 130), ramp=((120, 110, 20), (190, 180, 30), (250, 240, 40)),
)  # fmt: skip


def fleet(look: Look, *, n: int, seed: int) -> Echoes:
    """Vessels anywhere in the picture, none within 60 pixels of another, off rings, lines and the centre."""
    rng = np.random.default_rng(seed)
    placed: list[FloatArray] = []
    while len(placed) < n:
        r, a = rng.uniform(60, look.radius_px - 20), rng.uniform(0.1, 2 * np.pi - 0.1)
        at = r * np.array([np.sin(a), np.cos(a)])
        if all(np.hypot(*(at - other)) > 60 for other in placed):
            placed.append(at)
    position_m = np.array(placed).reshape(-1, 2) * look.pixel_m
    length_m = rng.choice([12.0, 25.0, 60.0, 129.0, 180.0], n)
    return Echoes(position_m, length_m, length_m / 5, rng.uniform(0, 2 * np.pi, n), rng.uniform(0.8, 2.0, n))


def settings_of(look: Look, **more: object) -> ImageConfig:
    """The settings that a person would give for this display."""
    rings = [look.radius_px * k / look.rings for k in range(1, look.rings + 1)]
    lines = tuple(line for line in (look.heading_line_deg, look.bearing_line_deg) if line is not None)
    values: dict[str, object] = {
        "centre_px": look.centre_px, "pixel_m": look.pixel_m, "radius_px": look.radius_px - 2, "inner_px": 8.0,
        "annuli_px": tuple((r - 1.5, r + 1.5) for r in rings[:-1]), "lines_deg": lines,
        "polygons_px": tuple((x0, y0, x1, y0, x1, y1, x0, y1) for x0, y0, x1, y1 in look.panels),
    }  # fmt: skip
    return ImageConfig(**(values | more))  # type: ignore[arg-type]


def judged(
    look: Look, echoes: Echoes, strength: NDArray[np.uint8], found: Found, *, least: int
) -> tuple[int, int, int]:
    """How many vessels have more than 3 pixels over the threshold, how many of these were found, how many blobs are
    false.

    A vessel is found where half of its pixels are points; a blob is false where none of its points is a vessel's.
    """
    owner = np.full(strength.shape, -1)
    row, column = np.nonzero(strength >= least)
    away = np.full(len(row), np.inf)
    for k in range(len(echoes)):
        centre, cov = echo_pixels(look, echoes, k)
        d = np.stack([column, row], axis=-1) - centre
        square = np.einsum("bi,ij,bj->b", d, np.linalg.inv(cov), d)
        mine = (square < 9.0) & (square < away)
        owner[row[mine], column[mine]] = k
        away[mine] = square[mine]
    size = np.bincount(owner[owner >= 0], minlength=len(echoes))
    of_point = owner[found.row, found.column]
    taken = np.bincount(of_point[of_point >= 0], minlength=len(echoes))
    large = size > 3
    real = np.bincount(found.blob, of_point >= 0, len(found.blobs)) > 0
    return int(large.sum()), int((large & (2 * taken >= size)).sum()), int((~real).sum())
