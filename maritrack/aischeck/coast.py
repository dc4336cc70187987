"""Land that hides what is behind it, as GeoJSON polygons tell."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from maritrack.errors import InputError
from maritrack.geo import geodetic_to_en
from maritrack.types import BoolArray, FloatArray, Origin

BLOCK = 2_000_000  # crossings that are looked at at a time


def read_coast(data: bytes, *, name: str, origin: Origin) -> list[FloatArray]:
    """Rings (v, 2) of all polygons and lines of a GeoJSON document, east-north; InputError where it has none."""
    try:
        document = json.loads(data.decode("utf-8-sig"))
        rings = [np.asarray(ring, float)[:, :2] for ring in _rings(document)]
    except (ValueError, TypeError, IndexError, KeyError, AttributeError, RecursionError):
        raise InputError(f"{name}: no GeoJSON of polygons") from None
    if not rings:
        raise InputError(f"{name}: GeoJSON without polygons or lines")
    return [geodetic_to_en(origin, ring[:, 1], ring[:, 0]) for ring in rings]


def _rings(value: Any) -> Iterator[Any]:
    kind = value.get("type") if isinstance(value, dict) else None
    if kind == "FeatureCollection":
        for feature in value["features"]:
            yield from _rings(feature.get("geometry"))
    elif kind == "Feature":
        yield from _rings(value.get("geometry"))
    elif kind == "GeometryCollection":
        for geometry in value["geometries"]:
            yield from _rings(geometry)
    elif kind in ("LineString", "Polygon", "MultiLineString", "MultiPolygon"):
        depth = {"LineString": 0, "Polygon": 1, "MultiLineString": 1, "MultiPolygon": 2}[kind]
        yield from _flat(value["coordinates"], depth)


def _flat(value: Any, depth: int) -> Iterator[Any]:
    if depth == 0:
        yield value
        return
    for item in value:
        yield from _flat(item, depth - 1)


def hidden(sensor_m: FloatArray, place_m: FloatArray, rings: Sequence[FloatArray]) -> BoolArray:
    """Whether a shore lies between the sensor (n, 2) and each place (n, 2): their line crosses a side of a ring."""
    found = np.zeros(len(place_m), bool)
    if not rings or len(place_m) == 0:
        return found
    a = np.concatenate([ring[:-1] for ring in rings])
    b = np.concatenate([ring[1:] for ring in rings])
    step = max(BLOCK // max(len(a), 1), 1)
    for first in range(0, len(place_m), step):
        rows = slice(first, first + step)
        found[rows] = _crossed(sensor_m[rows, None], place_m[rows, None], a[None], b[None]).any(axis=1)
    return found


def _crossed(p: FloatArray, q: FloatArray, a: FloatArray, b: FloatArray) -> BoolArray:
    def side(o: FloatArray, to: FloatArray, x: FloatArray) -> FloatArray:
        u, v = to - o, x - o
        return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])

    return np.asarray((side(p, q, a) * side(p, q, b) < 0) & (side(a, b, p) * side(a, b, q) < 0))
