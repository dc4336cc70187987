"""What of a result goes to which entity of the picture, as rows of plain arrays.

A row is one archetype of one entity at one scan. All parts of a row have one entry per item, so that
rows of many scans join into columns. Positions are already turned over (y = -north).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from maritrack.geo import en_to_geodetic, pixel_centre
from maritrack.sinks import captions, shapes
from maritrack.sinks.captions import KNOTS
from maritrack.sinks.shapes import Strips, Trails, picture
from maritrack.sinks.view import Box
from maritrack.types import CONFIRMED, STATIONARY, TENTATIVE, FloatArray, IntArray, Mask, Origin, Result, Tracks, Truth

MOST_DAMAGE_LINES = 20  # of one frame in the log
UI = -1.0  # a negative radius is one in points of the screen, not in metres
STYLES: dict[str, list[tuple[str, dict[str, Any]]]] = {
    "ppi/video/*": [("EncodedImage", {"draw_order": -10.0, "magnification_filter": "linear"})],
    "ppi/background/*": [("Points2D", {"draw_order": -5.0, "show_labels": False})],
    "ppi/grid": [("LineStrips2D", {"colors": [captions.GRID_COLOUR], "radii": UI * 0.5, "draw_order": 0.0})],
    "ppi/grid/label": [("Points2D", {"colors": [captions.GRID_TEXT], "radii": UI * 0.01, "show_labels": True})],
    "ppi/sensors/*": [
        ("Points2D", {"colors": [captions.GRID_TEXT], "radii": UI * 3.0, "show_labels": True}),
        ("LineStrips2D", {"colors": [captions.GRID_COLOUR], "radii": UI * 0.5, "draw_order": 0.0}),
    ],
    "ppi/sensors/*/name": [("Points2D", {"colors": [captions.GRID_TEXT], "radii": UI * 0.01, "show_labels": True})],
    "ppi/detections/*": [("Points2D", {"radii": UI * 1.0, "draw_order": 5.0, "show_labels": False})],
    "ppi/clusters/*": [
        ("Points2D", {"radii": UI * 1.5, "draw_order": 6.0, "show_labels": False}),
        ("LineStrips2D", {"radii": UI * 0.4, "draw_order": 6.0, "show_labels": False}),
    ],
    "ppi/tracks/extent": [("LineStrips2D", {"draw_order": 12.0, "show_labels": False})],
    "ppi/tracks/covariance": [("LineStrips2D", {"radii": UI * 0.4, "draw_order": 11.0, "show_labels": False})],
    "ppi/tracks/trail": [("LineStrips2D", {"radii": UI * 0.8, "draw_order": 10.0})],
    "ppi/tracks/velocity": [("Arrows2D", {"radii": UI * 0.8, "draw_order": 13.0, "show_labels": False})],
    "ppi/tracks/state": [("Points2D", {"draw_order": 14.0, "show_labels": False})],
    "ppi/tracks/label": [("Points2D", {"radii": UI * 0.01, "draw_order": 15.0, "show_labels": True})],
    "ppi/truth": [
        ("Points2D", {"radii": UI * 2.0, "draw_order": 15.0, "show_labels": False}),
        ("LineStrips2D", {"radii": UI * 0.5, "draw_order": 9.0, "show_labels": False}),
    ],
    "ppi/truth/label": [("Points2D", {"radii": UI * 0.01, "draw_order": 15.0, "show_labels": True})],
    "geo/own_ship/*": [("GeoPoints", {"colors": [captions.COLOUR[captions.TRUTH]], "radii": UI * 5.0})],
    "geo/range/*": [("GeoLineStrings", {"colors": [captions.GRID_TEXT], "radii": UI * 0.7})],
    "geo/tracks": [("GeoPoints", {"radii": UI * 3.0})],
    "geo/trails": [("GeoLineStrings", {"radii": UI * 1.0})],
    "geo/clusters": [("GeoPoints", {"radii": UI * 1.0})],
    "geo/truth": [("GeoPoints", {"radii": UI * 2.5})],
}
NO_TRUTH = Truth((), (), 0, *(np.zeros((0, 2)) for _ in range(2)), *(np.zeros(0) for _ in range(3)))


@dataclass(frozen=True, slots=True)
class Row:
    """One archetype of one entity at one scan."""

    entity: str
    kind: str  # name of the archetype
    parts: Mapping[str, Any]


def draw_points(result: Result, part: str) -> Iterator[Row]:
    """Detections of the scan by what became of them. `part` is the sensor's name in paths."""
    kind = np.full(len(result.points), captions.POINT_SUBTRACTED)
    kind[result.keep] = np.where(result.clusters.label >= 0, captions.POINT_CLUSTERED, captions.POINT_NOISE)
    yield _dots(f"ppi/detections/{part}", result.points.position_m, kind)


def draw_mask(mask: Mask, part: str) -> Iterator[Row]:
    """Pixels that are background, each a disc as wide as it."""
    at = pixel_centre(mask.key, mask.pixel_m, mask.corner_m)
    radii = np.full(len(at), mask.pixel_m / 2, np.float32)
    kind = np.full(len(at), captions.BACKGROUND, np.uint16)
    yield Row(f"ppi/background/{part}", "Points2D", {"positions": picture(at), "radii": radii, "class_ids": kind})


def draw_clusters(result: Result, part: str) -> Iterator[Row]:
    """Centroids, and what two sigma of the spread of the points cover."""
    clusters = result.clusters
    entity = f"ppi/clusters/{part}"
    yield _dots(entity, clusters.mean_m, np.full(len(clusters), captions.CLUSTER))
    wide = clusters.count > 2
    cov_m2 = clusters.scatter_m2[wide] / clusters.count[wide, None, None]
    outline = shapes.ellipses(clusters.mean_m[wide], cov_m2, scale=2.0)
    yield _lines(entity, shapes.as_strips(outline), np.full(len(outline), captions.CLUSTER))


def draw_tracks(tracks: Tracks, trails: Trails, *, vector_s: float) -> Iterator[Row]:
    """Extent, covariance, trail, velocity, position and label of every track."""
    kind = captions.track_class(tracks)
    moving = captions.shown_moving(tracks)
    outline, index = shapes.track_outlines(tracks, tracks.status != TENTATIVE)
    thick = np.where(moving[index], 1.0, 0.4).astype(np.float32)
    yield Row("ppi/tracks/extent", "LineStrips2D", {"strips": _turned(outline),
              "class_ids": kind[index].astype(np.uint16), "radii": np.float32(UI) * thick})  # fmt: skip

    alive = np.flatnonzero(moving | (tracks.status == TENTATIVE))
    spread = shapes.ellipses(tracks.position_m[alive], tracks.cov[alive, :2, :2], scale=2.0)
    yield _lines("ppi/tracks/covariance", shapes.as_strips(spread), kind[alive])

    lines, index = shapes.trail_strips(trails, moving)
    yield Row("ppi/tracks/trail", "LineStrips2D", {"strips": _turned(lines),
              "colors": captions.trail_colour(tracks.id[index])})  # fmt: skip

    ahead = np.flatnonzero(moving)
    yield Row("ppi/tracks/velocity", "Arrows2D", {"vectors": picture(tracks.velocity_mps[ahead] * vector_s),
              "origins": picture(tracks.position_m[ahead]), "class_ids": kind[ahead].astype(np.uint16)})  # fmt: skip

    size = np.select([moving, tracks.status == STATIONARY], [4.0, 3.0], 2.0).astype(np.float32)
    yield Row("ppi/tracks/state", "Points2D", {"positions": picture(tracks.position_m),
              "class_ids": kind.astype(np.uint16), "radii": np.float32(UI) * size})  # fmt: skip
    yield Row("ppi/tracks/state", "AnyValues", _state(tracks))

    yield Row("ppi/tracks/label", "Points2D", {"positions": picture(tracks.position_m[ahead]),
              "class_ids": kind[ahead].astype(np.uint16), "labels": captions.track_labels(tracks, ahead)})  # fmt: skip


def _state(tracks: Tracks) -> dict[str, Any]:
    length_m, width_m, orientation = shapes.axes_of(tracks.extent_m2)
    variance = np.diagonal(tracks.cov, axis1=1, axis2=2)
    return {
        "track_id": tracks.id.astype(np.int64), "t_ns": tracks.t_ns.astype(np.int64),
        "status": tracks.status.astype(np.uint8), "moving": tracks.moving.astype(np.uint8),
        "existence": tracks.existence, "east_m": tracks.position_m[:, 0], "north_m": tracks.position_m[:, 1],
        "vel_east_mps": tracks.velocity_mps[:, 0], "vel_north_mps": tracks.velocity_mps[:, 1],
        "speed_kn": np.hypot(*tracks.velocity_mps.T) * KNOTS, "length_m": length_m, "width_m": width_m,
        "orientation_deg": np.degrees(orientation), "sigma_east_m": np.sqrt(variance[:, 0]),
        "sigma_north_m": np.sqrt(variance[:, 1]), "cluster": tracks.cluster.astype(np.int64),
    }  # fmt: skip


def draw_truth(truth: Truth, *, leader_m: float) -> Iterator[Row]:
    """Positions, hulls to scale, and names on a short leader north of them, clear of track labels."""
    kind = np.full(len(truth), captions.TRUTH)
    yield _dots("ppi/truth", truth.position_m, kind)
    above = truth.position_m + np.array([0.0, leader_m])
    leader = np.stack([truth.position_m, (truth.position_m + above) / 2], axis=1)  # the name hangs below its place
    hulls = shapes.hulls(truth)
    lines = Strips(np.concatenate([hulls.reshape(-1, 2), leader.reshape(-1, 2)]),
                   np.repeat([6, 2], [len(hulls), len(leader)]))  # fmt: skip
    yield _lines("ppi/truth", lines, np.full(len(lines), captions.TRUTH))
    names = [name or name_id for name, name_id in zip(truth.name, truth.id, strict=True)]
    yield Row("ppi/truth/label", "Points2D", {"positions": picture(above), "class_ids": kind.astype(np.uint16),
              "labels": names})  # fmt: skip


def draw_grid(centre_m: FloatArray, range_m: float) -> Iterator[Row]:
    """Range rings, the cross of the compass and the arrow to the North."""
    lines, at, text = shapes.rings(centre_m, range_m)
    yield Row("ppi/grid", "LineStrips2D", {"strips": _turned(lines)})
    keep = [i for i, t in enumerate(text) if t]
    yield Row("ppi/grid/label", "Points2D", {"positions": picture(at[keep]), "labels": [text[i] for i in keep]})


def draw_sensor(position_m: FloatArray, name: str, part: str, *, leader_m: float = 0.0) -> Iterator[Row]:
    """Where a sensor is, and its name there or on a leader to the north (south where negative) of it."""
    at = position_m[None]
    if leader_m == 0.0:
        yield Row(f"ppi/sensors/{part}", "Points2D", {"positions": picture(at), "labels": [name]})
        return
    away = at + np.array([0.0, leader_m])
    yield Row(f"ppi/sensors/{part}", "Points2D", {"positions": picture(at), "labels": [""]})
    line = Strips(np.concatenate([at, away]), np.array([2]))
    yield Row(f"ppi/sensors/{part}", "LineStrips2D", {"strips": _turned(line)})
    yield Row(f"ppi/sensors/{part}/name", "Points2D", {"positions": picture(away), "labels": [name]})


def legend(box: Box, vector: str, *, with_video: bool) -> tuple[FloatArray, list[str], list[captions.Colour]]:
    """What is what, in its colour, for the top left corner, which a radar's disc leaves free."""
    entries = [(name, colour) for _, name, colour in captions.CLASSES]
    entries += [("radar video", captions.VIDEO_TEXT)] if with_video else []
    entries.append((f"line ahead: way in {vector}", captions.GRID_TEXT))
    down = np.arange(len(entries))[:, None] * np.array([0.0, 0.026]) * box.size_m
    first = np.array([box.west + 0.12 * box.size_m, -box.north + 0.01 * box.size_m])
    return first + down, [name for name, _ in entries], [colour for _, colour in entries]


def draw_geo(result: Result, trails: Trails, origin: Origin, *, with_truth: bool) -> Iterator[Row]:
    """Tracks, their trails, clusters and truth on the map."""
    tracks, truth = result.tracks, result.frame.truth or NO_TRUTH
    held = np.flatnonzero(tracks.status != TENTATIVE)
    lines, index = shapes.trail_strips(trails, captions.shown_moving(tracks))
    places = [tracks.position_m[held], lines.vertex, result.clusters.mean_m, truth.position_m]
    lat_lon = _lat_lon(origin, np.concatenate(places))  # in one go: a call costs more than a thousand positions
    at, along, clusters, true = np.split(lat_lon, np.cumsum([len(p) for p in places])[:-1])
    kind = captions.track_class(tracks)[held].astype(np.uint16)
    yield Row("geo/tracks", "GeoPoints", {"positions": at, "class_ids": kind})
    yield Row("geo/trails", "GeoLineStrings", {"line_strings": Strips(along, lines.count),
              "colors": captions.trail_colour(tracks.id[index])})  # fmt: skip
    dots = [("clusters", clusters, captions.CLUSTER)] + [("truth", true, captions.TRUTH)] * with_truth
    for name, where, class_id in dots:
        yield Row(f"geo/{name}", "GeoPoints", {"positions": where,
                  "class_ids": np.full(len(where), class_id, np.uint16)})  # fmt: skip


def draw_geo_sensor(position_m: FloatArray, range_m: float, part: str, origin: Origin) -> Iterator[Row]:
    """Where a sensor is on the map, and how far it sees."""
    at = _lat_lon(origin, position_m[None])
    yield Row(f"geo/own_ship/{part}", "GeoPoints", {"positions": at})
    circle = shapes.ellipses(position_m[None], range_m**2 * np.eye(2)[None], vertices=72)[0]
    ring = Strips(_lat_lon(origin, circle), np.array([len(circle)]))
    yield Row(f"geo/range/{part}", "GeoLineStrings", {"line_strings": ring})


def draw_numbers(result: Result) -> Iterator[Row]:
    """Counts as the summary adds them up, scores that exist, and CPU time by stage."""
    held = result.tracks.status >= CONFIRMED  # in any way: coasted and stationary ones are
    counts = {
        "points": len(result.points), "clusters": len(result.clusters), "tracks": len(result.tracks),
        "confirmed": int(held.sum()), "moving": int((held & result.tracks.moving).sum()),
    }  # fmt: skip
    if result.frame.truth is not None:
        counts["truth"] = len(result.frame.truth)
    for name, count in counts.items():
        yield _number(f"metrics/counts/{name}", count)
    for name, value in result.scores.items():
        if np.isfinite(value):
            yield _number(score_entity(name), value)
    for name, value in result.timing_ms.items():
        yield _number(f"metrics/timing/{name}", value)


def score_entity(name: str) -> str:
    """Entity of a score: "ospa_localisation" is metrics/ospa/localisation."""
    family, _, rest = name.partition("_")
    return f"metrics/{family}/{rest}" if rest and family in ("gospa", "ospa") else f"metrics/{name}"


def draw_log(result: Result) -> Iterator[Row]:
    """Events of the run and damage of the input."""
    for event in result.events:
        level = "WARN" if event.level == "warning" else event.level.upper()
        yield _text(f"log/{event.stage}", event.message, level)
    damage = result.frame.damage
    for d in damage[:MOST_DAMAGE_LINES]:
        place = f" at byte {d.offset}" if d.offset >= 0 else ""
        sensor = f"{d.sensor}: " if d.sensor else ""
        more = f" ({d.count} times in a row)" if d.count > 1 else ""
        yield _text("log/ingest", f"{sensor}{d.code}{place}: {d.message}{more}", "WARN")
    if len(damage) > MOST_DAMAGE_LINES:
        yield _text("log/ingest", f"and {len(damage) - MOST_DAMAGE_LINES} more in this scan", "WARN")


def style_of(entity: str, *, few_points: bool, over: bool) -> list[tuple[str, dict[str, Any]]]:
    """The part of an entity that never changes, as archetypes and their fields."""
    if over:
        return [("EncodedImage", {"draw_order": -9.0, "magnification_filter": "linear", "opacity": 0.5})]
    if few_points and entity.startswith("ppi/detections/"):
        return [("Points2D", {"radii": UI * 3.0, "draw_order": 5.0, "show_labels": False})]
    root, _, rest = entity.partition("/")
    head, _, tail = rest.partition("/")
    if root == "metrics":
        return [("SeriesLines", _series(head, tail))]
    named = STYLES.get(f"{root}/{head}/*/name") if tail.endswith("/name") else None
    return STYLES.get(entity) or named or STYLES.get(f"{root}/{head}/*") or []


def _series(head: str, tail: str) -> dict[str, Any]:
    if head == "counts":
        return {"names": tail, "colors": [captions.COUNT_COLOURS[tail]]}
    if head == "timing":
        return {"names": f"{tail} [ms]"}
    return {"names": captions.score_title(f"{head}_{tail}" if tail else head)}


def _dots(entity: str, position_m: FloatArray, kind: IntArray) -> Row:
    return Row(entity, "Points2D", {"positions": picture(position_m), "class_ids": kind.astype(np.uint16)})


def _lines(entity: str, strips: Strips, kind: IntArray) -> Row:
    return Row(entity, "LineStrips2D", {"strips": _turned(strips), "class_ids": kind.astype(np.uint16)})


def _turned(strips: Strips) -> Strips:
    return Strips(picture(strips.vertex), strips.count)  # type: ignore[arg-type]


def _number(entity: str, value: float) -> Row:
    return Row(entity, "Scalars", {"scalars": np.array([float(value)])})


def _text(entity: str, text: str, level: str) -> Row:
    return Row(entity, "TextLog", {"text": [text], "level": [level]})


def _lat_lon(origin: Origin, position_m: FloatArray) -> FloatArray:
    if len(position_m) == 0:
        return np.zeros((0, 2))
    return np.stack(en_to_geodetic(origin, position_m), axis=-1)
