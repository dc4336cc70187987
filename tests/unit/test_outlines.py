"""Outlines of tracks as polygons: ellipses and contours, on the map and as a table."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from numpy.testing import assert_allclose

from maritrack.errors import UsageError
from maritrack.export import export
from maritrack.geo import geodetic_to_en
from maritrack.types import Tracks
from tests import runs
from tests.unit.test_export import tracks

CLOCKWISE = np.array([[0.0, 0.0], [0.0, 2.0], [3.0, 2.0], [3.0, 0.0]])


def drawn() -> Tracks:
    """A contour, one of two corners and one that runs clockwise."""
    return replace(tracks(), contour_m=(CLOCKWISE[::-1] + 100.0, CLOCKWISE[:2], CLOCKWISE))


def archive(path: Path, what: Tracks, *, origin: bool = True) -> Path:
    manifest = runs.MANIFEST if origin else replace(runs.MANIFEST, origin=None)
    return runs.archive(path, [replace(runs.result(k), tracks=what) for k in range(2)], manifest=manifest)


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_contours_are_polygons_counter_clockwise_and_closed(tmp_path: Path) -> None:
    done = export(archive(tmp_path / "run.mcap", drawn()), outlines=tmp_path / "o.geojson")
    assert done.rows == {"outlines": 4}  # two corners are no polygon
    features = json.loads((tmp_path / "o.geojson").read_text())["features"]
    assert [(f["properties"]["scan"], f["properties"]["track_id"]) for f in features] == [
        (0, 3),
        (0, 9),
        (1, 3),
        (1, 9),
    ]
    assert {f["properties"]["kind"] for f in features} == {"contour"}
    assert runs.MANIFEST.origin is not None
    (ring,) = features[1]["geometry"]["coordinates"]
    lon_deg, lat_deg = np.array(ring).T
    shape = shapely.Polygon(geodetic_to_en(runs.MANIFEST.origin, lat_deg, lon_deg))
    assert shape.exterior.is_ccw and ring[0] == ring[-1]
    assert shape.symmetric_difference(shapely.Polygon(CLOCKWISE)).area < 0.05
    assert features[1]["properties"]["area_m2"] == 6.0


def test_ellipses_are_polygons_where_there_are_no_contours(tmp_path: Path) -> None:
    path = archive(tmp_path / "run.mcap", tracks(), origin=False)
    export(path, outlines=tmp_path / "o.csv")
    ship, circle = table(tmp_path / "o.csv")[:2]
    assert (ship["track_id"], circle["track_id"], ship["kind"]) == ("3", "9", "ellipse")
    assert float(ship["area_m2"]) == pytest.approx(math.pi * 30 * 10, rel=0.01)
    polygon = shapely.from_wkt(circle["outline"])
    assert polygon.is_valid and polygon.area == pytest.approx(math.pi * 25, rel=0.01)
    assert_allclose(polygon.centroid.coords[0], [1e4, 5.0], atol=1e-2)


def test_only_what_moves_when_asked(tmp_path: Path) -> None:
    export(archive(tmp_path / "run.mcap", drawn()), outlines=tmp_path / "o.csv", moving=True)
    assert {row["track_id"] for row in table(tmp_path / "o.csv")} == {"3"}


def test_degrees_need_an_origin_and_an_empty_run_gives_an_empty_collection(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="origin"):
        export(archive(tmp_path / "a.mcap", drawn(), origin=False), outlines=tmp_path / "o.geojson")
    path = runs.archive(tmp_path / "b.mcap", [runs.result(0, n=0, c=0, t=0)])
    export(path, outlines=tmp_path / "o.geojson")
    assert json.loads((tmp_path / "o.geojson").read_text()) == {"type": "FeatureCollection", "features": []}
