"""A campaign as files: points, screenshots of the display, truth and AIS."""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from maritrack import geo
from maritrack.config import to_toml
from maritrack.errors import InputError
from maritrack.imagesettings import ImageConfig
from maritrack.io.images.palette import GREY
from maritrack.io.pointwriter import write_points
from maritrack.simulate.aistable import ais_path, reports_table
from maritrack.simulate.campaign import Campaign, echoes_of, grabbed, north_up, reference_of
from maritrack.simulate.ppi import REACH, Echoes, Look, echo_pixels, render
from maritrack.simulate.writing import scans_asked, write_octets
from maritrack.types import FloatArray, IntArray, Points, Scan, Sensor

SENSOR = "display"
WEAKEST = 0.93  # of the grey of the weakest colour of an echo: the threshold of screenshots
SPECKS = 20  # single pixels of noise in a screenshot
LEAST_PIXELS = 4  # of a vessel, a mark or an answer in points: fewer are specks


def scan_of(scene: Campaign, k: int, *, seed: int) -> Scan:
    """The points of step k: pixels over the threshold, each once, with the vessel of the strongest echo there."""
    echoes, label = echoes_of(scene, k, seed=seed)
    look = scene.display
    xy, of = _pixels(look, echoes, label, scene.threshold)
    offset_m = (xy - np.array(look.centre_px)) * [look.pixel_m, -look.pixel_m]
    range_m, azimuth = geo.en_to_polar(offset_m)
    own_m = scene.own_m(np.array([k * scene.period_s]))[0]
    t_ns = round((scene.start_s + k * scene.period_s) * 1e9)
    order = np.lexsort((range_m, azimuth))
    n = len(order)
    points = Points(
        range_m=range_m[order], azimuth_rad=azimuth[order], position_m=own_m + offset_m[order], intensity=np.ones(n),
        t_ns=np.full(n, t_ns), range_width_m=np.zeros(n), azimuth_width_rad=np.zeros(n),
        truth_label=label[of[order]] if n else np.zeros(0, np.int64),
    )  # fmt: skip
    sensor = Sensor(SENSOR, 0.0, 0.0, look.radius_px * look.pixel_m)
    return Scan(sensor, t_ns, t_ns, own_m, math.nan, points=points)


def _pixels(look: Look, echoes: Echoes, label: IntArray, threshold: float) -> tuple[FloatArray, IntArray]:
    """Pixels (n, 2), x right and y down, where an echo is over the threshold, and the strongest echo there."""
    found, power, of = [np.zeros((0, 2), np.int64)], [np.zeros(0)], [np.zeros(0, np.int64)]
    for k in range(len(echoes)):
        centre, cov = echo_pixels(look, echoes, k)
        half = REACH * np.sqrt(np.diag(cov))
        low, high = np.floor(centre - half).astype(int), np.ceil(centre + half).astype(int) + 1
        grid = np.stack(np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1])), -1).reshape(-1, 2)
        d, inv = grid - centre, np.linalg.inv(cov)
        strength = float(echoes.strength[k]) * np.exp(-0.5 * np.einsum("ni,ij,nj->n", d, inv, d))
        inside = np.hypot(*(grid - np.array(look.centre_px)).T) <= look.radius_px - 2.0
        over = (strength >= threshold) & inside
        found.append(grid[over])
        power.append(strength[over])
        of.append(np.full(int(over.sum()), k))
    xy, strength, owner = np.concatenate(found), np.concatenate(power), np.concatenate(of)
    order = np.lexsort((-strength, xy[:, 0], xy[:, 1]))
    xy, owner = xy[order], owner[order]
    first = np.ones(len(xy), bool)
    first[1:] = (xy[1:] != xy[:-1]).any(axis=1)
    xy, owner = xy[first], owner[first]
    body = np.where(label >= 0, label, label.max(initial=0) + 1 + np.arange(len(label)))[owner]
    enough = np.bincount(body)[body] >= LEAST_PIXELS if len(body) else np.zeros(0, bool)
    return xy[enough].astype(np.float64), owner[enough]


def simulate_campaign(
    scene: Campaign,
    out: Path,
    *,
    seed: int,
    scans: int | None = None,
    ais: bool = True,
    images: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Write OUT as `maritrack-points/1` with its truth, OUT's AIS beside it, and screenshots; returns what was written.

    Screenshots are IMAGES/20260512T063000.000.png by time, with IMAGES.toml, the settings that read them.
    """
    n_scans = scans_asked(scene.scans, scans, seed=seed)
    steps = grabbed(scene, n_scans, seed=seed)
    if images is not None:
        _folder(images, scene)
    written: list[Scan] = []
    for number, k in enumerate(steps.tolist()):
        written.append(scan_of(scene, k, seed=seed))
        if images is not None:
            _screenshot(scene, k, seed=seed).save(images / image_name(scene, k))
        if progress is not None:
            progress(number + 1, len(steps))
    sensors = {SENSOR: {"sigma_range_m": scene.display.sigma_range_m, "sigma_azimuth_deg": 0.6}}
    octets = write_points(
        written, frame="polar", origin=scene.origin, sensors=sensors, reference=reference_of(scene, n_scans)
    )  # fmt: skip
    write_octets(out, octets)
    told: dict[str, Any] = {}
    if ais:
        table = reports_table(scene.vessel, scene.origin, scene.start_s, scene.period_s * n_scans)
        write_octets(ais_path(out), table.encode())
        told = {"ais": str(ais_path(out)), "ais_reports": table.count("\n") - 1, "own_ship": scene.own}
    if images is not None:
        told |= {"images": str(images), "images_config": str(images.with_suffix(".toml"))}
    points = sum(len(scan.points) for scan in written if scan.points is not None)
    return {
        "recording": str(out), "octets": len(octets), "scans": len(written), "points": points,
        "objects": len(scene.others), "truth_rows": len(scene.others) * n_scans, "seed": seed, **told,
    }  # fmt: skip


def image_name(scene: Campaign, k: int) -> str:
    """The file of step k, by its time to milliseconds: 20260512T063000.000.png."""
    at = datetime.fromtimestamp(scene.start_s, UTC) + timedelta(milliseconds=round(k * scene.period_s * 1e3))
    return f"{at:%Y%m%dT%H%M%S}.{at.microsecond // 1000:03d}.png"


def _screenshot(scene: Campaign, k: int, *, seed: int) -> Image.Image:
    echoes, _ = echoes_of(scene, k, seed=seed)
    picture = render(
        north_up(scene, k), echoes, seed=seed * 1_000_003 + k, specks=SPECKS, caption=f"{scene.title.upper()}\nX-BAND"
    )
    return Image.fromarray(picture)


def _folder(images: Path, scene: Campaign) -> None:
    try:
        images.mkdir(parents=True, exist_ok=True)
        images.with_suffix(".toml").write_text(
            f'extends = "dataset"\n\n[input]\nown_ship = "{scene.own}"\n'
            f"sigma_range_m = {scene.display.sigma_range_m:.3f}\n\n"
            f"[images]\n{to_toml(image_settings(scene))}",
            "utf-8",
        )
    except OSError as error:
        raise InputError(f"{images}: {error.strerror or error}") from None


def image_settings(scene: Campaign) -> ImageConfig:
    """What reads the screenshots: centre, scale, disc, rings and panels; the heading line is told by its colour.

    Each colour of an echo is over the threshold, and blobs are found of few pixels of the weakest one.
    """
    look = scene.display
    grey = float(np.array(look.ramp[0]) @ np.array(GREY)) / 255.0
    rings = [look.radius_px * k / look.rings for k in range(1, look.rings)]
    return ImageConfig(
        centre_px=look.centre_px, pixel_m=look.pixel_m, size_px=(look.width, look.height), times="stamps",
        radius_px=look.radius_px - 2.0, inner_px=8.0,
        annuli_px=tuple((r - 1.5, r + 1.5) for r in rings),
        polygons_px=tuple((float(x0), float(y0), float(x1), float(y0), float(x1), float(y1), float(x0), float(y1))
                          for x0, y0, x1, y1 in look.panels),
        interface=("#{:02x}{:02x}{:02x}".format(*look.line),), threshold=round(WEAKEST * grey, 3),
        blob_threshold=0.0005, blob_reach=2.0,
        blob_min_m=4.0 * look.pixel_m if look.pixel_m < 10 else 25.0,
    )  # fmt: skip
