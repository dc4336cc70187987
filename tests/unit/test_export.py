"""What people take elsewhere: CSV and GeoJSON of an archive."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.errors import InputError, UsageError
from maritrack.export import ellipse, export
from maritrack.geo import geodetic_to_en
from maritrack.types import Result, Tracks
from tests import runs

TRACK_COLUMNS = (
    "scan,time_s,sensor,track_id,status,moving,existence,east_m,north_m,up_m,vel_east_mps,vel_north_mps,"
    "length_m,width_m,orientation_deg,lat_deg,lon_deg"
)
POINT_COLUMNS = "scan,time_s,sensor,range_m,azimuth_deg,east_m,north_m,intensity,cluster,lat_deg,lon_deg"


def tracks() -> Tracks:
    """A ship of 60 m x 20 m that goes south-west, a point that stands, a circle that drifts."""
    return Tracks(
        id=np.array([3, 4, 9]), t_ns=np.array([1_700_000_000_125_000_000, 1_700_000_000_000_000_001, 5_000_000_000]),
        position_m=np.array([[100.0, -200.5], [0.0, 0.0], [1e4, 5.0]]),
        velocity_mps=np.array([[-3.0, -3.0], [0.1, 0.0], [0.2, 0.2]]), cov=np.zeros((3, 4, 4)),
        extent_m2=np.array([[[500.0, 400.0], [400.0, 500.0]], np.zeros((2, 2)), 25.0 * np.eye(2)]),
        existence=np.array([0.999, 0.5, 1.0]), status=np.array([1, 0, 3]), moving=np.array([True, False, False]),
        cluster=np.array([0, -1, 1]),
    )  # fmt: skip


def with_tracks(k: int) -> Result:
    return replace(runs.result(k), tracks=tracks())


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return runs.archive(tmp_path_factory.mktemp("base") / "run.mcap", [with_tracks(k) for k in range(3)])


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_track_rows_have_the_columns_and_units_that_were_agreed(base: Path, tmp_path: Path) -> None:
    done = export(base, tracks=tmp_path / "t.csv")
    assert (tmp_path / "t.csv").read_text().splitlines()[0] == TRACK_COLUMNS
    ship, point, circle = rows(tmp_path / "t.csv")[:3]
    assert (done.rows, done.damage) == ({"tracks": 9}, ())
    assert (ship["scan"], ship["time_s"], ship["sensor"]) == ("0", "1700000000.125000000", "7-42")
    assert (ship["track_id"], ship["status"], ship["moving"], ship["existence"]) == ("3", "confirmed", "1", "0.999000")
    assert (ship["east_m"], ship["north_m"], ship["up_m"]) == ("100.000", "-200.500", "")
    assert (ship["vel_east_mps"], ship["vel_north_mps"]) == ("-3.0000", "-3.0000")
    assert (ship["length_m"], ship["width_m"], ship["orientation_deg"]) == ("60.000", "20.000", "225.00")
    assert (point["time_s"], point["length_m"], point["orientation_deg"]) == ("1700000000.000000001", "", "")
    assert (circle["status"], circle["length_m"], circle["orientation_deg"]) == ("stationary", "10.000", "")


def test_latitude_and_longitude_are_those_of_the_position(base: Path, tmp_path: Path) -> None:
    export(base, tracks=tmp_path / "t.csv")
    ship = rows(tmp_path / "t.csv")[0]
    assert runs.MANIFEST.origin is not None
    lat, lon = np.array([float(ship["lat_deg"])]), np.array([float(ship["lon_deg"])])
    assert geodetic_to_en(runs.MANIFEST.origin, lat, lon)[0] == pytest.approx([100.0, -200.5], abs=0.01)


def test_without_an_origin_latitude_and_longitude_are_empty(tmp_path: Path) -> None:
    path = runs.archive(tmp_path / "run.mcap", [with_tracks(0)], manifest=replace(runs.MANIFEST, origin=None))
    export(path, tracks=tmp_path / "t.csv")
    assert {(row["lat_deg"], row["lon_deg"]) for row in rows(tmp_path / "t.csv")} == {("", "")}
    with pytest.raises(UsageError, match="origin"):
        export(path, geojson=tmp_path / "g.json")


def test_point_rows_have_the_columns_that_were_agreed(base: Path, tmp_path: Path) -> None:
    export(base, points=tmp_path / "p.csv")
    assert (tmp_path / "p.csv").read_text().splitlines()[0] == POINT_COLUMNS
    found, points = rows(tmp_path / "p.csv")[:12], runs.result(0).points
    assert [float(row["range_m"]) for row in found] == points.range_m.tolist()
    assert [float(row["azimuth_deg"]) for row in found] == pytest.approx(np.degrees(points.azimuth_rad), abs=1e-5)
    assert [float(row["intensity"]) for row in found] == points.intensity.tolist()
    assert [int(row["time_s"].replace(".", "")) for row in found] == points.t_ns.tolist()


def test_a_point_has_its_cluster_noise_or_nothing_where_the_background_took_it(base: Path, tmp_path: Path) -> None:
    export(base, points=tmp_path / "p.csv")
    result = runs.result(0)
    cells = np.full(12, "", object)
    cells[result.keep] = [str(label) for label in result.clusters.label]
    assert [row["cluster"] for row in rows(tmp_path / "p.csv")[:12]] == cells.tolist()
    assert not result.keep.all()


def test_cluster_rows_tell_count_and_size(base: Path, tmp_path: Path) -> None:
    export(base, clusters=tmp_path / "c.csv")
    found, clusters = rows(tmp_path / "c.csv")[:3], runs.result(0).clusters
    assert [row["cluster"] for row in found] == ["0", "1", "2"]
    assert [int(row["count"]) for row in found] == clusters.count.tolist()
    sigma_m = np.sqrt(np.linalg.eigvalsh(clusters.scatter_m2 / clusters.count[:, None, None]))
    assert [float(row["length_m"]) for row in found] == pytest.approx(4 * sigma_m[:, 1], abs=1e-3)
    assert [float(row["width_m"]) for row in found] == pytest.approx(4 * sigma_m[:, 0], abs=1e-3)


def test_only_moving_tracks_when_asked(base: Path, tmp_path: Path) -> None:
    export(base, tracks=tmp_path / "t.csv", geojson=tmp_path / "g.json", moving=True)
    assert {row["track_id"] for row in rows(tmp_path / "t.csv")} == {"3"}
    features = json.loads((tmp_path / "g.json").read_text())["features"]
    assert [feature["properties"]["track_id"] for feature in features] == [3]


def test_geojson_is_a_line_per_track(base: Path, tmp_path: Path) -> None:
    export(base, geojson=tmp_path / "g.json", tracks=tmp_path / "t.csv")
    document = json.loads((tmp_path / "g.json").read_text())
    assert (document["type"], len(document["features"])) == ("FeatureCollection", 3)
    ship = document["features"][0]
    expected = [[float(r["lon_deg"]), float(r["lat_deg"])] for r in rows(tmp_path / "t.csv") if r["track_id"] == "3"]
    assert ship["geometry"] == {"type": "LineString", "coordinates": expected}
    assert ship["properties"] == {
        "track_id": 3, "sensor": "7-42", "status": "confirmed", "moving": True, "first_time_s": 1_700_000_000.125,
        "last_time_s": 1_700_000_000.125, "length_m": 60.0, "width_m": 20.0,
    }  # fmt: skip


def test_a_track_that_was_seen_once_is_a_point(tmp_path: Path) -> None:
    path = runs.archive(tmp_path / "run.mcap", [with_tracks(0)])
    export(path, geojson=tmp_path / "g.json")
    geometry = json.loads((tmp_path / "g.json").read_text())["features"][0]["geometry"]
    assert (geometry["type"], len(geometry["coordinates"])) == ("Point", 2)


def test_a_run_without_rows_gives_heads_only(tmp_path: Path) -> None:
    path = runs.archive(tmp_path / "run.mcap", [runs.result(0, n=0, c=0, t=0)])
    t, p, c, g = (tmp_path / name for name in ("tracks", "points", "clusters", "geojson"))
    rows = export(path, tracks=t, points=p, clusters=c, geojson=g).rows
    assert rows == {"tracks": 0, "points": 0, "clusters": 0, "geojson": 0}
    assert [len(path.read_text().splitlines()) for path in (t, p, c)] == [1, 1, 1]
    assert json.loads(g.read_text())["features"] == []


@pytest.mark.parametrize("name", ['a,"b"', "nan", "7-42"])
def test_the_name_of_a_sensor_may_be_anything(tmp_path: Path, name: str) -> None:
    item = with_tracks(0)
    scan = replace(item.frame.scan, sensor=replace(item.frame.scan.sensor, id=name))
    path = runs.archive(tmp_path / "run.mcap", [replace(item, frame=replace(item.frame, scan=scan))])
    export(path, tracks=tmp_path / "t.csv")
    assert [row["sensor"] for row in rows(tmp_path / "t.csv")] == [name] * 3


def test_one_output_can_go_to_the_standard_output(base: Path, capsys: pytest.CaptureFixture[str]) -> None:
    export(base, tracks=Path("-"))
    assert capsys.readouterr().out.splitlines()[0] == TRACK_COLUMNS
    with pytest.raises(UsageError, match="standard output"):
        export(base, tracks=Path("-"), points=Path("-"))


def test_calls_that_make_no_sense_are_refused(base: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="nothing"):
        export(base)
    with pytest.raises(UsageError, match="none"):
        export(base, tracks=tmp_path / "none" / "t.csv")
    path = runs.archive(tmp_path / "run.mcap", [runs.result(0)], points=False)
    with pytest.raises(UsageError, match="without its points"):
        export(path, points=tmp_path / "p.csv")


def test_a_failed_export_leaves_nothing_and_spoils_nothing(base: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.mcap"
    noise = b"\x06" + (44).to_bytes(8, "little") + bytes(28) + b"\x04\0\0\0zstd" + bytes(8)
    (tmp_path / "t.csv").write_text("old")
    octets = base.read_bytes()
    bad.write_bytes(octets[:8] + noise * 1500 + octets[8:])
    with pytest.raises(InputError):
        export(bad, tracks=tmp_path / "t.csv")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bad.mcap", "t.csv"]
    assert (tmp_path / "t.csv").read_text() == "old"


def test_damage_is_reported_and_the_rest_exported(base: Path, tmp_path: Path) -> None:
    octets = base.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(octets[: len(octets) - 500])
    done = export(tmp_path / "cut.mcap", tracks=tmp_path / "t.csv")
    assert (done.rows["tracks"], len(done.damage)) == (9, 1)


@settings(derandomize=True, deadline=None)
@given(st.floats(1, 300), st.floats(0.05, 0.95), st.floats(-7, 7), st.floats(0, 20))
def test_an_ellipse_is_found_again(length_m: float, ratio: float, heading_rad: float, speed_mps: float) -> None:
    bow = np.array([np.sin(heading_rad), np.cos(heading_rad)])
    side = np.array([bow[1], -bow[0]])
    extent = (length_m / 2) ** 2 * (np.outer(bow, bow) + ratio**2 * np.outer(side, side))
    found = [float(v[0]) for v in ellipse(extent[None], speed_mps * bow[None])]
    period_deg = 360.0 if speed_mps > 0.5 else 180.0
    off_deg = (found[2] - np.degrees(heading_rad) + period_deg / 2) % period_deg - period_deg / 2
    assert found[:2] == pytest.approx([length_m, ratio * length_m], rel=1e-6)
    assert abs(off_deg) < 0.006
    assert 0 <= found[2] < period_deg
