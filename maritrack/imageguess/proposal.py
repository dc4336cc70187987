"""A proposal for the settings of a recording of images, and how sure each part of it is."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from maritrack.errors import UsageError
from maritrack.imageguess import marks as mk
from maritrack.imageguess.circles import edges_of, find_centre, find_circles
from maritrack.imageguess.colours import LEAST_ECHO, Colours, echo_pixels, find_colours, hex_of
from maritrack.imageguess.sample import Sample
from maritrack.types import BoolArray

RADIAL = 0.25  # share of edges that point to the centre, for it to be sure
UNIT = {"m": 1.0, "km": 1000.0, "nm": 1852.0, "": 1.0}
USUAL_NM = (0.25, 0.5, 0.75, 1.5, 3.0, 6.0, 12.0, 24.0)  # range scales of ships' radars


@dataclass(frozen=True, slots=True)
class Note:
    """What was found about one setting, and whether it can be relied on."""

    about: str
    sure: bool
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """Settings as in `[images]`, what they rest on, and what is drawn of them."""

    settings: dict[str, Any]  # in the order in which they are told
    rings_px: tuple[float, ...]
    spacing_px: float  # of evenly spaced rings; 0 = unknown
    notes: tuple[Note, ...]


def propose(of: Sample, *, ring_m: float = 0.0, range_m: float = 0.0) -> Proposal:
    """What the frames tell. `ring_m` from ring to ring, or `range_m` from the centre to the edge, tell the scale."""
    width, height = of.size_px
    notes: list[Note] = []
    if len(of.frames) < 4:
        notes.append(Note("frames", False, f"{len(of.frames)} to compare: what moves can hardly be told"))
    edges = edges_of(of.still)
    cx, cy, radial = find_centre(edges, width, height)
    circles = find_circles(edges, cx, cy, width, height)
    sure = len(circles) >= 2 or (len(circles) == 1 and radial > RADIAL)
    if not circles:
        cx, cy = (width - 1) / 2, (height - 1) / 2
    said = f"{len(circles)} circles about it" if circles else "no circle found: the middle of the image"
    notes.append(Note("centre_px", sure, said))
    rings = tuple(round(r, 2) for r, _ in circles)
    distance = np.hypot(np.arange(width)[None, :] - cx, np.arange(height)[:, None] - cy)
    radius = disc_radius(rings, of, distance)
    notes.append(Note("radius_px", bool(rings) and sure, _of_disc(radius, rings)))
    inside = distance <= radius - 3
    spacing = spacing_of(tuple(r for r in rings if r <= radius + 2))
    settings: dict[str, Any] = {"size_px": (width, height), "centre_px": (round(cx, 2), round(cy, 2))}
    pixel_m, note = scale_of(radius, spacing, ring_m=ring_m, range_m=range_m)
    notes.append(note)
    if pixel_m:
        settings["pixel_m"] = pixel_m
    settings["radius_px"] = round(max(radius - 2, 1.0), 2)
    settings |= _interface(of, (cx, cy), radius, rings, inside, notes)
    return Proposal(settings, tuple(r for r in rings if r <= radius + 2), spacing, tuple(notes))


def disc_radius(rings: tuple[float, ...], of: Sample, distance: np.ndarray) -> float:
    """The smallest circle that holds nearly all that moves; the largest where nothing does; to the nearest edge of the
    image where there is none."""
    if not rings:
        return float(min(distance[0, :].min(), distance[-1, :].min(), distance[:, 0].min(), distance[:, -1].min()))
    moving = distance[of.moves.any(axis=0) & (distance <= rings[-1])]
    if len(moving) < LEAST_ECHO:
        return rings[-1]
    farthest = float(np.quantile(moving, 0.99))
    even = spacing_of(rings)
    fitting = [r for r in rings if r >= farthest - 3 and (not even or abs(r / even - round(r / even)) < 0.03)]
    return fitting[-1] if even and fitting else next((r for r in rings if r >= farthest - 3), rings[-1])


def spacing_of(rings: tuple[float, ...]) -> float:
    """From ring to ring where they are evenly spaced from the centre on, 0 where they are not (or there is one)."""
    best = 0.0
    for r in rings:
        for n in range(1, 9):
            step = r / n
            at = [q for q in rings if abs(q - round(q / step) * step) < max(1.5, 0.006 * q)]
            wanted = round(max(at, default=0.0) / step)
            numbers = {round(q / step) for q in at}
            if step > 15 and len(at) >= 2 and numbers >= set(range(1, wanted + 1)) and len(at) >= len(rings) - 1:
                best = max(best, max(at) / wanted)
    return round(best, 3)


def scale_of(radius: float, spacing: float, *, ring_m: float, range_m: float) -> tuple[float, Note]:
    """Metres a pixel from what is told of the rings or the range; 0 and what is missing."""
    if ring_m > 0 and not spacing:
        return 0.0, Note("pixel_m", False, "no evenly spaced rings found: give --range, from the centre to the edge")
    if ring_m > 0:
        return round(ring_m / spacing, 4), Note("pixel_m", True, f"rings of {ring_m:g} m are {spacing:.1f} px apart")
    if range_m > 0:
        return round(range_m / radius, 4), Note("pixel_m", True, f"{range_m:g} m are {radius:.1f} px")
    usual = ", ".join(f"{nm:g} NM: {nm * 1852 / radius:.4g}" for nm in USUAL_NM)
    rings = f"; rings are {spacing:.1f} px apart" if spacing else ""
    text = f"not told: give --range or --ring{rings}. Metres a pixel by range scale: {usual}"
    return 0.0, Note("pixel_m", False, text)


def parse_distance(text: str, option: str) -> float:
    """`0.75NM`, `3 km`, `500m` or `500` in metres; "" is 0."""
    match = re.fullmatch(r"\s*([0-9]*\.?[0-9]+)\s*([a-zA-Z]*)\s*", text)
    if not text:
        return 0.0
    if match is None or match[2].lower() not in UNIT or not 0 < float(match[1]) < 1e6:
        raise UsageError(f"{option} '{text[:40]}': write a distance as in 0.75NM, 3km or 500m")
    return float(match[1]) * UNIT[match[2].lower()]


def _of_disc(radius: float, rings: tuple[float, ...]) -> str:
    beyond = sum(r > radius + 2 for r in rings)
    return f"a circle of {radius:.1f} px" + (f", {beyond} beyond it" if beyond else "") if rings else "no circle"


def _interface(
    of: Sample, centre: tuple[float, float], radius: float, rings: tuple[float, ...], inside: BoolArray,
    notes: list[Note],
) -> dict[str, Any]:  # fmt: skip
    """Rings, lines, panels and colours; notes are added."""
    cx, cy = centre
    found: dict[str, Any] = {}
    sea = mk.sea_colour(of.still, inside)
    marks = mk.marked(of.still, sea) & inside
    distance = np.hypot(np.arange(marks.shape[1])[None, :] - cx, np.arange(marks.shape[0])[:, None] - cy)
    if mark := mk.centre_mark(marks, cx, cy):
        found["inner_px"] = mark
    inner = tuple(r for r in rings if r < radius - 4)
    found["annuli_px"] = tuple((round(r - 2, 2), round(r + 2, 2)) for r in inner)
    unknown = np.zeros_like(marks)
    for r in inner:
        unknown |= np.abs(distance - r) <= 3
    notes.append(Note("annuli_px", True, f"{len(inner)} rings within the disc"))
    lines = mk.find_lines(marks & ~unknown, cx, cy, radius)
    found["lines_deg"] = lines
    clear = of.moves & inside
    turning: list[np.ndarray] = []
    for k in range(len(of.frames)):
        moved = mk.find_lines(clear[k], cx, cy, radius)
        if moved:
            on = mk.along(moved, cx, cy, inside.shape, width_px=4.0) & clear[k]
            turning.append(of.frames[k][on])
            clear[k] &= ~mk.along(moved, cx, cy, inside.shape, width_px=6.0)
    notes.append(Note("lines_deg", not turning, f"{len(lines)} lines that stand still" + _turns(turning)))
    unknown |= mk.along(lines, cx, cy, inside.shape, width_px=7.0) | (distance <= found.get("inner_px", 0.0) + 3)
    boxes, others = mk.find_boxes(marks & ~unknown, unknown)
    found["polygons_px"] = tuple((b.x0, b.y0, b.x1, b.y0, b.x1, b.y1, b.x0, b.y1) for b in boxes)
    said = f"{len(boxes)} panels" + (f"; {others} other marks stand still: text, or land? not masked" if others else "")
    notes.append(Note("polygons_px", others == 0, said))
    still_sea = of.still[inside & ~of.moves.any(axis=0) & ~mk.marked(of.still, sea)]
    colours = find_colours(echo_pixels(of.frames, clear, inside), still_sea)
    found |= {"palette": colours.palette, "threshold": colours.threshold}
    if colours.colours:
        found["colours"] = colours.colours
    if turning:
        found["interface"] = (hex_of(np.median(np.concatenate(turning), axis=0)),)
    notes.append(_of_colours(colours))
    return {key: value for key, value in found.items() if value != ()}


def _turns(turning: list[np.ndarray]) -> str:
    return f"; in {len(turning)} frames one that moves: told by its colour" if turning else ""


def _of_colours(colours: Colours) -> Note:
    if colours.n_echo < LEAST_ECHO:
        return Note("palette", False, "hardly anything moves within the disc: echoes can't be told from the rest")
    text = f"{colours.n_echo} pixels that move are {colours.clear:.2f} of full scale above the sea"
    return Note("palette", colours.clear >= 0.2, text)
