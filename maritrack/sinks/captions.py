"""Names, colours and words of the picture: legend, run document, track table, titles of plots."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from maritrack.geo import en_to_polar
from maritrack.sinks.shapes import NM_M, axes_of, ring_step
from maritrack.types import (
    COASTED,
    CONFIRMED,
    STATIONARY,
    STATUS,
    TENTATIVE,
    BoolArray,
    FloatArray,
    IntArray,
    RunManifest,
    Tracks,
)

KNOTS = 3600.0 / NM_M  # of a metre per second

POINT_CLUSTERED, POINT_NOISE, POINT_SUBTRACTED, CLUSTER = 0, 1, 2, 10
BACKGROUND = 3
TRACK = {TENTATIVE: 20, CONFIRMED: 21, COASTED: 22, STATIONARY: 23}  # by status
STILL = 24  # confirmed or coasted, and not moving
TRUTH = 30
Colour = tuple[int, int, int]
CLASSES: tuple[tuple[int, str, Colour], ...] = (
    (POINT_CLUSTERED, "point in a cluster", (196, 154, 78)),
    (POINT_NOISE, "point without a cluster", (150, 140, 130)),
    (POINT_SUBTRACTED, "point taken as background", (70, 84, 112)),
    (BACKGROUND, "background", (84, 72, 140)),
    (CLUSTER, "cluster (2 sigma)", (214, 112, 44)),
    (TRACK[TENTATIVE], "tentative track", (92, 150, 255)),
    (TRACK[CONFIRMED], "confirmed track, moving", (96, 255, 120)),
    (TRACK[COASTED], "coasted track", (255, 96, 205)),
    (TRACK[STATIONARY], "stationary track, held in the background", (240, 225, 70)),
    (STILL, "track that does not move", (128, 140, 128)),
    (TRUTH, "truth (simulator, GNSS, AIS)", (255, 255, 255)),
)
COLOUR: dict[int, Colour] = {class_id: colour for class_id, _, colour in CLASSES}
COLOUR_NAME = {
    POINT_CLUSTERED: "sand", POINT_NOISE: "grey-brown", POINT_SUBTRACTED: "slate", BACKGROUND: "indigo",
    CLUSTER: "orange",
    TRACK[TENTATIVE]: "blue", TRACK[CONFIRMED]: "green", TRACK[COASTED]: "pink", TRACK[STATIONARY]: "yellow",
    STILL: "grey-green", TRUTH: "white",
}  # fmt: skip
GRID_COLOUR, GRID_TEXT, VIDEO_TEXT = (52, 66, 84), (130, 150, 172), (60, 140, 134)
TRAIL_COLOURS = np.array(
    [0x5CD6C8FF, 0xF2C14EFF, 0xB58CF2FF, 0x7FD65CFF, 0xF28C6BFF, 0x6BB8F2FF, 0xE07BC0FF, 0xC9D65CFF, 0x8C9CF2FF,
     0xF2A3A3FF, 0x5CD68FFF, 0xD6B08CFF],
    np.uint32,
)  # fmt: skip
VIDEO_STOPS = (
    (0, (5, 8, 13)),  # not seen
    (1, (9, 15, 21)),  # nothing there
    (60, (14, 38, 44)),
    (255, (46, 104, 100)),
)
COUNT_COLOURS: dict[str, Colour] = {
    "points": COLOUR[POINT_CLUSTERED], "clusters": COLOUR[CLUSTER], "tracks": COLOUR[TRACK[TENTATIVE]],
    "confirmed": COLOUR[TRACK[CONFIRMED]], "moving": (40, 190, 190), "truth": COLOUR[TRUTH],
}  # fmt: skip
UNITS = {
    "gospa": "m", "ospa": "m", "ospa_localisation": "m", "ospa_cardinality": "m", "gospa_localisation": "m^p",
    "gospa_missed": "objects", "gospa_false": "tracks", "gospa_unexplained": "tracks", "n_truth": "objects",
    "n_tracks": "tracks",
}  # fmt: skip  # of scores; none = a bare number


def track_class(tracks: Tracks) -> IntArray:
    """Class id (t,) of each track: its status; confirmed or coasted and not moving is a class of its own."""
    seen = (tracks.status == CONFIRMED) | (tracks.status == COASTED)
    kind = np.array([TRACK[i] for i in range(len(STATUS))], np.int64)[tracks.status]
    return np.where(seen & ~tracks.moving, STILL, kind)


def shown_moving(tracks: Tracks) -> BoolArray:
    """Tracks (t,) that the picture is about: confirmed or coasted, and moving."""
    return np.asarray(tracks.moving & ((tracks.status == CONFIRMED) | (tracks.status == COASTED)), dtype=bool)


def trail_colour(ids: IntArray) -> np.ndarray[Any, np.dtype[np.uint32]]:
    """Packed colours (t,), the same for a track through all its life."""
    return TRAIL_COLOURS[ids % len(TRAIL_COLOURS)]


def track_labels(tracks: Tracks, rows: IntArray) -> list[str]:
    """What stands beside a track: "T12 8.4 kn"."""
    speed_kn = np.hypot(*tracks.velocity_mps[rows].T) * KNOTS
    return [f"T{i} {v:.1f} kn" for i, v in zip(tracks.id[rows].tolist(), speed_kn.tolist(), strict=True)]


def vector_minutes(range_m: float) -> float:
    """How far ahead velocity lines reach: a ship at 10 kn covers about a twentieth of the range."""
    wanted = range_m / 20 / (10 / KNOTS) / 60
    return max((m for m in (0.1, 0.25, 0.5, 1.0, 2.0, 3.0, 6.0, 12.0) if m <= wanted), default=0.1)


def duration(minutes: float) -> str:
    """A number of minutes as people write it."""
    return f"{minutes:g} min" if minutes >= 1 else f"{minutes * 60:g} s"


def score_title(name: str) -> str:
    """Name of a score in the legend of a plot, with its unit where it has one."""
    words = "IoU" if name == "iou" else name.removeprefix("n_").replace("_", " ")
    for short in ("gospa", "ospa"):
        words = words.replace(short, short.upper()) if words.startswith(short) else words
    return f"{words} [{score_unit(name)}]" if score_unit(name) else words


def score_unit(name: str) -> str:
    """Unit of a score, "" where it has none."""
    return UNITS.get(name, "m" if name.endswith("_m") else "")


def track_table(tracks: Tracks, sensor_m: FloatArray, *, scan: int, view_m: float, most: int = 30) -> str:
    """The tracks as Markdown: those that move first, then those that the background holds, nearest first each.

    Distances are in the unit of the rings.
    """
    ring_m, ring, unit = ring_step(view_m)
    digits = 2 if unit == "NM" else 0
    moving, kind = shown_moving(tracks), track_class(tracks)
    range_m, azimuth = en_to_polar(tracks.position_m - sensor_m)
    speed_mps, course = en_to_polar(tracks.velocity_mps)
    length_m, width_m, _ = axes_of(tracks.extent_m2)
    stationary = tracks.status == STATIONARY
    n_still, n_held, n_tentative = (int((kind == i).sum()) for i in (STILL, TRACK[STATIONARY], TRACK[TENTATIVE]))
    lines = [
        f"Scan {scan}: **{int(moving.sum())} moving**, {n_still} that do not move, "
        f"{n_held} stationary (held in the background), {n_tentative} tentative.",
        "",
        f"| track | status | range {unit} | bearing ° | speed kn | course ° | length m | width m | existence |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    held = np.flatnonzero(tracks.status != TENTATIVE)
    order = held[np.lexsort((tracks.id[held], range_m[held], ~stationary[held], ~moving[held]))]
    for i in order[:most]:
        status = STATUS[int(tracks.status[i])] if moving[i] or stationary[i] else "not moving"
        size = f"{length_m[i]:.0f} | {width_m[i]:.0f}" if length_m[i] > 0 else "- | -"
        way = f"{speed_mps[i] * KNOTS:.1f} | {round(np.degrees(course[i])) % 360:03d}" if moving[i] else "- | -"
        lines.append(
            f"| T{tracks.id[i]} | {status} | {range_m[i] * ring / ring_m:.{digits}f} "
            f"| {round(np.degrees(azimuth[i])) % 360:03d} | {way} | {size} | {tracks.existence[i]:.2f} |"
        )
    if len(order) > most:
        lines += ["", f"and {len(order) - most} more."]
    return "\n".join(lines)


def run_document(manifest: RunManifest, *, vector: str, summary: Mapping[str, Any] | None = None) -> str:
    """What the recording is, how to read the picture, what came out, and the configuration."""
    title = manifest.recording or "run"
    state = "" if summary is not None else "\n\nThe run has not ended: what you see may be a part of it."
    legend = "\n".join(f"- **{COLOUR_NAME[i]}**: {name}" for i, name, _ in CLASSES)
    origin = "unknown (no map)"
    if manifest.origin is not None:
        origin = f"{manifest.origin.lat_deg:.6f}°, {manifest.origin.lon_deg:.6f}° (WGS84)"
    parts = [
        f"# {title}: {manifest.tracker}\n\nPreset `{manifest.preset}`, input {', '.join(manifest.input_kind) or '-'}, "
        f"run `{manifest.run_id}`, {_kind(manifest)}.{state}",
        "## How to read the picture\n\nNorth is up. Rings are distances from the sensor, written on them "
        "(1 NM = 1852 m). The teal picture is the radar video of the latest turn: darkest where no spoke came by.\n\n"
        f"{legend}\n\n"
        "A solid outline about a track is its extent to scale, the thin one its position's covariance (2 sigma). "
        f"The line ahead of a moving track is its way in {vector}; the coloured line behind it, the same colour "
        "through all its life, its last positions. Labels: track number and speed over ground in knots; white "
        "labels are names of the truth. Plots: x is time, y has its unit in the title.",
        f"Origin of east-north: {origin}. In the data x = east and **y = -north** (the view points y down); "
        "`/ppi/tracks/state` has true east, north and velocities as columns.",
    ]
    if summary is not None:
        parts += [_table("Results", summary.get("metrics")), _table("Counts", summary.get("counts"))]
    facts = {"seed": manifest.seed, "code": manifest.code_sha256[:16], **dict(sorted(manifest.versions.items()))}
    parts.append(_table("Provenance", facts))
    fence = "\n".join("    " + line for line in manifest.config_toml.splitlines())
    parts.append(f"## Configuration\n\n{fence}" if fence else "")
    return "\n\n".join(p for p in parts if p)


def _kind(manifest: RunManifest) -> str:
    if not manifest.smoothed_from:
        return "causal tracks"
    return f"**offline** tracks: those of run `{manifest.smoothed_from}` in hindsight"


def _table(title: str, values: Any) -> str:
    if not isinstance(values, Mapping) or not values:
        return ""
    rows = [f"| {_cell(k)} | {_cell(v)} |" for k, v in _flat(values)]
    return "\n".join([f"## {title}", "", "| | |", "|---|---|", *rows])


def _flat(values: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    rows: list[tuple[str, Any]] = []
    for name, value in values.items():
        if isinstance(value, Mapping):
            rows += _flat(value, f"{prefix}{name}.")
        else:
            rows.append((prefix + name, value))
    return rows


def _cell(value: Any) -> str:
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return " ".join(text.replace("|", "/").split())
