"""The Rerun recording of a small harbour: a rotating radar, land, three ships, tracks and truth."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun_cli  # type: ignore[import-untyped]
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from maritrack.errors import UsageError
from maritrack.geo import TWO_PI, en_to_polar, polar_to_en
from maritrack.sinks import captions
from maritrack.sinks.rerun import RerunSink
from maritrack.types import (
    COASTED,
    CONFIRMED,
    STATIONARY,
    TENTATIVE,
    Clusters,
    Damage,
    Event,
    FloatArray,
    Frame,
    IntArray,
    Origin,
    Points,
    Result,
    RunManifest,
    Scan,
    Sensor,
    Tracks,
    Truth,
    Video,
)

T0_NS = 1_700_000_000 * 10**9
TURN_NS = 2_500_000_000
SHIP_M = np.array([[-2500.0, 1500.0], [1200.0, 3000.0], [800.0, -2200.0]])
SHIP_MPS = np.array([[8.0, 1.5], [-3.0, -6.0], [2.0, 4.5]])
SHIP_LENGTH_M, SHIP_WIDTH_M = np.array([220.0, 120.0, 40.0]), np.array([32.0, 20.0, 9.0])


HOME = Origin(50.75, -1.1)


def manifest(origin: Origin | None = HOME) -> RunManifest:
    return RunManifest(
        run_id="run-1", tracker="jipda", preset="radar", code_sha256="ab" * 32, config_toml='[track]\np_detect = 0.9\n',
        input_sha256=("cd" * 32,), input_kind=("cat240",), seed=7, versions={"numpy": "2"}, origin=origin,
        recording="harbour",
    )  # fmt: skip


def video(t_s: float, rng: np.random.Generator, *, spokes: int, cells: int, range_m: float) -> Video:
    cell_m = range_m / cells
    azimuth = np.sort((np.arange(spokes) + rng.uniform(-0.2, 0.2, spokes)) * (TWO_PI / spokes) % TWO_PI)
    r = (np.arange(cells) + 0.5) * cell_m
    level = rng.gamma(1.0, 10.0, (spokes, cells)) * (1 + 8 * np.exp(-r / 500))
    coast = range_m * (0.55 + 0.12 * np.sin(5 * azimuth) + 0.05 * np.sin(17 * azimuth))
    land = (azimuth > 3.4) & (azimuth < 5.2)
    level[land[:, None] & (r > coast[:, None]) & (r < 1.5 * coast[:, None])] += 230
    at = polar_to_en(np.asarray(r[None, :], float), azimuth[:, None])
    for position, velocity, length, width in zip(
        SHIP_M + SHIP_MPS * t_s, SHIP_MPS, SHIP_LENGTH_M, SHIP_WIDTH_M, strict=True
    ):
        ahead = velocity / np.hypot(*velocity)
        offset = at - position
        along, across = offset @ ahead, offset @ [ahead[1], -ahead[0]]
        level[(np.abs(along) < length / 2 + cell_m) & (np.abs(across) < width / 2 + cell_m)] += 200
    return Video(azimuth, np.full(spokes, TWO_PI / spokes), np.full(spokes, T0_NS + int(t_s * 1e9)), cell_m / 2, cell_m,
                 np.clip(level, 0, 255).astype(np.uint8), np.full(spokes, cells))  # fmt: skip


def points_at(position_m: FloatArray, t_ns: int) -> Points:
    range_m, azimuth = en_to_polar(position_m)
    zero = np.zeros(len(range_m))
    return Points(range_m, azimuth, position_m, zero + 200, np.full(len(range_m), t_ns), zero + 20, zero + 0.01)


def clusters_of(position_m: FloatArray, label: IntArray, t_ns: int) -> Clusters:
    n = int(label.max(initial=-1)) + 1
    count = np.bincount(label[label >= 0], minlength=n)
    safe = np.maximum(count, 1)
    mean = np.stack([np.bincount(label[label >= 0], position_m[label >= 0, i], n) / safe for i in (0, 1)], -1)
    offset = position_m[label >= 0] - mean[label[label >= 0]]
    scatter = np.zeros((n, 2, 2))
    np.add.at(scatter, label[label >= 0], offset[:, :, None] * offset[:, None, :])
    range_m, azimuth = en_to_polar(mean)
    return Clusters(mean, scatter, count, np.asarray(1 / safe, float), np.tile(100 * np.eye(2), (n, 1, 1)),
                    np.full(n, t_ns), range_m, azimuth, 200.0 * count.astype(float), label)  # fmt: skip


def tracks_at(k: int, t_ns: int, rng: np.random.Generator, *, still: int, tentative: int) -> Tracks:
    """Three ships, tentative at first, the third coasted for a while; walls that stand; false starts."""
    t_s = (t_ns - T0_NS) / 1e9
    status = np.full(3, CONFIRMED if k >= 3 else TENTATIVE)
    if 8 <= k % 20 < 12:
        status[2] = COASTED
    wall = polar_to_en(np.linspace(4200, 5200, still), np.linspace(3.5, 5.1, still))
    start = rng.uniform(-6000, 6000, (tentative, 2))
    n = 3 + still + tentative
    position = np.concatenate([SHIP_M + SHIP_MPS * t_s + rng.normal(0, 8, (3, 2)), wall, start])
    velocity = np.concatenate([SHIP_MPS, np.zeros((still, 2)), rng.normal(0, 4, (tentative, 2))])
    ahead = SHIP_MPS / np.hypot(*SHIP_MPS.T)[:, None]
    across = np.stack([ahead[:, 1], -ahead[:, 0]], -1)
    extent = np.tile(900.0 * np.eye(2), (n, 1, 1))
    extent[:3] = (SHIP_LENGTH_M[:, None, None] / 2) ** 2 * ahead[:, :, None] * ahead[:, None, :]
    extent[:3] += (SHIP_WIDTH_M[:, None, None] / 2) ** 2 * across[:, :, None] * across[:, None, :]
    ids = np.concatenate([[1, 4, 12], 20 + np.arange(still), 1000 + tentative * k + np.arange(tentative)])
    kind = np.concatenate([status, np.full(still, STATIONARY), np.full(tentative, TENTATIVE)])
    return Tracks(ids, np.full(n, t_ns), position, velocity, np.tile(np.diag([900.0, 900, 4, 4]), (n, 1, 1)), extent,
                  np.where(kind == TENTATIVE, 0.4, 0.99), kind, np.arange(n) < 3, np.full(n, -1))  # fmt: skip


def truth_at(t_ns: int) -> Truth:
    t_s = (t_ns - T0_NS) / 1e9
    heading = np.arctan2(*SHIP_MPS.T)
    length, width = SHIP_LENGTH_M.copy(), SHIP_WIDTH_M.copy()
    length[2] = width[2] = np.nan
    return Truth(("211000001", "211000002", "211000003"), ("ALPHA", "BRAVO", ""), t_ns, SHIP_M + SHIP_MPS * t_s,
                 SHIP_MPS, heading, length, width)  # fmt: skip


def harbour(
    n: int, *, spokes: int = 180, cells: int = 64, n_points: int = 200, n_clusters: int = 20, still: int = 10,
    tentative: int = 5, range_m: float = 7400.0, with_video: bool = True, with_truth: bool = True,
) -> Iterator[Result]:  # fmt: skip
    """Results of n turns; the same every time."""
    rng = np.random.default_rng(5)
    sensor = Sensor("7-42", range_m / cells, TWO_PI / spokes, range_m if with_video else np.inf)
    for k in range(n):
        t_ns = T0_NS + k * TURN_NS
        t_s = k * TURN_NS / 1e9
        ship = (SHIP_M + SHIP_MPS * t_s)[:, None] + rng.normal(0, 40, (3, 12, 2))
        wall_centre = polar_to_en(rng.uniform(4000, 5500, n_clusters), rng.uniform(3.4, 5.2, n_clusters))
        wall = wall_centre[:, None] + rng.normal(0, 50, (n_clusters, n_points // n_clusters, 2))
        noise = rng.uniform(-4000, 4000, (n_points // 10, 2))
        position = np.concatenate([ship.reshape(-1, 2), wall.reshape(-1, 2), noise])
        label = np.concatenate([np.repeat(np.arange(3), 12), np.repeat(3 + np.arange(n_clusters), wall.shape[1]),
                                np.full(len(noise), -1)])  # fmt: skip
        keep = rng.random(len(position)) > 0.3
        keep[: 3 * 12] = True
        truth = truth_at(t_ns) if with_truth else None
        scan = Scan(sensor, t_ns, t_ns - TURN_NS, np.zeros(2), np.nan,
                    video(t_s, rng, spokes=spokes, cells=cells, range_m=range_m) if with_video else None)  # fmt: skip
        yield Result(
            Frame(k, scan, truth, damage=(Damage("zlib-error", 1266, "cells do not inflate"),) if k == 5 else ()),
            points_at(position, t_ns), keep, clusters_of(position[keep], label[keep], t_ns),
            tracks_at(k, t_ns, rng, still=still, tentative=tentative),
            {"gospa": 40 + 20 * np.sin(k / 5), "ospa": 60 - k / 3, "ospa_localisation": 25.0, "gospa_missed": 0.0}
            if with_truth else {"gospa": np.nan},
            (Event("info", "track", "track T1 confirmed"),) if k == 3 else (),
            {"detect": 1.5, "cluster": 3.0, "track": 8.0 + np.sin(k)},
        )  # fmt: skip


def write(path: Path, results: Iterator[Result], *, run: RunManifest | None = None, **options: Any) -> Path:
    sink = RerunSink(path, raster_px=options.pop("raster_px", 128), **options)
    sink.open(run or manifest())
    for result in results:
        sink.write(result)
    sink.close({"metrics": {"gospa": {"mean": 41.5}}, "counts": {"scans": 3}})
    return path


def stored(path: Path) -> dict[tuple[str, str], dict[int, Any]]:
    """Values by (entity, column), then by scan; -1 = static. The last one counts, as in the viewer."""
    out: dict[tuple[str, str], dict[int, Any]] = {}
    for chunk in RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        names = batch.schema.names
        scans = batch.column("scan").to_pylist() if "scan" in names else [-1] * batch.num_rows
        for name in names:
            if name in ("scan", "time") or name.startswith("rerun.controls"):
                continue
            column = out.setdefault((chunk.entity_path, name), {})
            column.update({k: v.as_py() for k, v in zip(scans, batch.column(name), strict=True) if v.is_valid})
    return out


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str], dict[int, Any]]:
    return stored(write(tmp_path_factory.mktemp("rrd") / "run.rrd", harbour(25), flush_scans=10))


def at(data: dict[tuple[str, str], dict[int, Any]], entity: str, column: str, k: int) -> FloatArray:
    return np.array(data[entity, column][k])


@pytest.mark.parametrize(
    ("entity", "column"),
    [
        ("/ppi/video/7-42", "EncodedImage:blob"), ("/ppi/detections/7-42", "Points2D:positions"),
        ("/ppi/clusters/7-42", "Points2D:positions"), ("/ppi/clusters/7-42", "LineStrips2D:strips"),
        ("/ppi/tracks/extent", "LineStrips2D:strips"), ("/ppi/tracks/covariance", "LineStrips2D:strips"),
        ("/ppi/tracks/trail", "LineStrips2D:strips"), ("/ppi/tracks/velocity", "Arrows2D:vectors"),
        ("/ppi/tracks/state", "Points2D:positions"), ("/ppi/tracks/state", "east_m"),
        ("/ppi/truth", "LineStrips2D:strips"), ("/geo/tracks", "GeoPoints:positions"),
        ("/geo/trails", "GeoLineStrings:line_strings"), ("/metrics/counts/points", "Scalars:scalars"),
        ("/metrics/gospa", "Scalars:scalars"), ("/metrics/ospa/localisation", "Scalars:scalars"),
        ("/metrics/timing/track", "Scalars:scalars"), ("/tables/tracks", "TextDocument:text"),
    ],
)  # fmt: skip
def test_every_scan_has_one_row(small: dict[tuple[str, str], dict[int, Any]], entity: str, column: str) -> None:
    assert list(small[entity, column]) == list(range(25))


def test_what_stands_still_is_drawn_once(small: dict[tuple[str, str], dict[int, Any]]) -> None:
    for entity, column in (
        ("/ppi/grid", "LineStrips2D:strips"), ("/ppi/sensors/7-42", "Points2D:positions"),
        ("/ppi/video/7-42", "Transform3D:scale"), ("/geo/own_ship/7-42", "GeoPoints:positions"),
    ):  # fmt: skip
        assert list(small[entity, column]) == [0]


def test_the_picture_points_y_down_and_the_columns_do_not(small: dict[tuple[str, str], dict[int, Any]]) -> None:
    tracks = list(harbour(8))[7].tracks
    shown = at(small, "/ppi/tracks/state", "Points2D:positions", 7)
    assert np.allclose(shown, tracks.position_m * [1, -1], atol=1e-3)
    assert np.array_equal(at(small, "/ppi/tracks/state", "north_m", 7), tracks.position_m[:, 1])
    assert np.array_equal(at(small, "/ppi/tracks/state", "track_id", 7), tracks.id)
    ahead = at(small, "/ppi/tracks/velocity", "Arrows2D:vectors", 7)
    assert np.allclose(ahead[:, 1] / ahead[:, 0], -SHIP_MPS[:, 1] / SHIP_MPS[:, 0], rtol=1e-5)


def test_points_are_classed_by_what_became_of_them(small: dict[tuple[str, str], dict[int, Any]]) -> None:
    result = list(harbour(8))[7]
    kind = at(small, "/ppi/detections/7-42", "Points2D:class_ids", 7)
    assert np.array_equal(kind == captions.POINT_SUBTRACTED, ~result.keep)
    assert np.array_equal(kind[result.keep] == captions.POINT_NOISE, result.clusters.label == -1)


def test_outlines_have_the_ships_size(small: dict[tuple[str, str], dict[int, Any]]) -> None:
    for entity, first in (("/ppi/tracks/extent", 0), ("/ppi/truth", 0)):
        outlines = small[entity, "LineStrips2D:strips"][5][first : first + 2]
        for outline, length, velocity in zip(outlines, SHIP_LENGTH_M, SHIP_MPS, strict=False):
            along = np.array(outline) @ (velocity * [1, -1] / np.hypot(*velocity))
            assert np.ptp(along) == pytest.approx(length, rel=0.01)


def test_only_confirmed_moving_tracks_have_labels(small: dict[tuple[str, str], dict[int, Any]]) -> None:
    labels = small["/ppi/tracks/label", "Points2D:labels"]
    assert not any(labels[k] for k in range(3))
    assert labels[5] == ["T1 15.8 kn", "T4 13.0 kn", "T12 9.6 kn"]


def test_a_trail_follows_its_track(small: dict[tuple[str, str], dict[int, Any]]) -> None:
    newest = np.array(small["/ppi/tracks/trail", "LineStrips2D:strips"][20][1])
    assert len(newest) == 21
    for k in (0, 13, 20):
        assert np.array_equal(newest[k], at(small, "/ppi/tracks/state", "Points2D:positions", k)[1])


def test_the_log_names_the_damage_and_its_place(small: dict[tuple[str, str], dict[int, Any]]) -> None:
    assert small["/log/ingest", "TextLog:text"] == {5: ["zlib-error at byte 1266: cells do not inflate"]}
    assert small["/log/track", "TextLog:text"] == {3: ["track T1 confirmed"]}


def test_the_document_explains_and_sums_up(small: dict[tuple[str, str], dict[int, Any]]) -> None:
    (text,) = small["/run", "TextDocument:text"][-1]
    for words in ("harbour: jipda", "North is up", "confirmed track, moving", "gospa.mean | 41.5", "p_detect = 0.9"):
        assert words in text
    assert small["/__properties/run", "run_id"][-1] == ["run-1"]


def test_times_are_those_of_the_data(tmp_path: Path) -> None:
    path = write(tmp_path / "run.rrd", harbour(3))
    for chunk in RrdReader(str(path)).stream().filter(content="/metrics/gospa", is_static=False):
        batch = chunk.to_record_batch()
        assert batch.column("time").cast("int64").to_pylist() == [T0_NS + k * TURN_NS for k in range(3)]
        assert set(chunk.timeline_names) == {"scan", "time"}


def test_equal_runs_have_equal_contents(tmp_path: Path) -> None:
    a, b = (write(tmp_path / f"{name}.rrd", harbour(12), flush_scans=5) for name in "ab")
    assert stored(a) == stored(b)
    program = Path(rerun_cli.__file__).parent / "rerun"
    command = [str(program), "rrd", "compare", "--unordered", str(a), str(b)]
    assert subprocess.run(command, capture_output=True, check=False).returncode == 0


def test_the_batch_size_does_not_change_the_contents(tmp_path: Path) -> None:
    a, b = (write(tmp_path / f"{n}.rrd", harbour(9), flush_scans=n) for n in (4, 9))
    assert stored(a) == stored(b)


def test_a_running_recording_can_be_read_up_to_the_last_batch(tmp_path: Path) -> None:
    sink = RerunSink(tmp_path / "run.rrd", flush_scans=4, raster_px=64)
    sink.open(manifest())
    for result in harbour(10):
        sink.write(result)
    with pytest.warns(RerunWarning, match="no footer"):
        assert list(stored(tmp_path / "run.rrd.partial")["/ppi/tracks/state", "east_m"]) == list(range(8))
    sink.abort()
    assert list(stored(tmp_path / "run.rrd.partial")["/ppi/tracks/state", "east_m"]) == list(range(10))
    assert not (tmp_path / "run.rrd").exists()


def test_close_gives_the_file_its_name_and_a_blueprint(tmp_path: Path) -> None:
    path = write(tmp_path / "run.rrd", harbour(2))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run.rrd"]
    assert len(RrdReader(str(path)).blueprints()) == 1


def test_a_run_without_frames_is_a_file(tmp_path: Path) -> None:
    path = write(tmp_path / "run.rrd", iter(()))
    assert "/run" in {entity for entity, _ in stored(path)}
    assert len(RrdReader(str(path)).blueprints()) == 1


def test_without_origin_and_truth_there_is_no_map_and_no_score(tmp_path: Path) -> None:
    path = write(tmp_path / "run.rrd", harbour(2, with_truth=False), run=manifest(None))
    entities = {entity for entity, _ in stored(path)}
    assert not [e for e in entities if e.startswith(("/geo/", "/ppi/truth", "/metrics/gospa"))]


def test_points_without_video_set_the_bounds_by_what_is_seen(tmp_path: Path) -> None:
    data = stored(write(tmp_path / "run.rrd", harbour(4, with_video=False)))
    rings = np.concatenate([np.array(s) for s in data["/ppi/grid", "LineStrips2D:strips"][0]])
    assert 3000 < np.abs(rings).max() < 6000
    assert not [e for e, _ in data if e.startswith("/ppi/video")]


def test_video_follows_a_sensor_that_moves(tmp_path: Path) -> None:
    def moving() -> Iterator[Result]:
        for r in harbour(4):
            scan = replace(r.frame.scan, position_m=np.array([100.0 * r.frame.k, 50.0]))
            yield replace(r, frame=replace(r.frame, scan=scan))

    data = stored(write(tmp_path / "run.rrd", moving()))
    corner = data["/ppi/video/7-42", "Transform3D:translation"]
    assert [corner[k][0][:2] for k in range(4)] == [[100.0 * k - 7400, -50.0 - 7400] for k in range(4)]


def test_every_sensor_has_its_own_entities(tmp_path: Path) -> None:
    def two() -> Iterator[Result]:
        for r in harbour(4):
            sensor = replace(r.frame.scan.sensor, id="shore/2" if r.frame.k % 2 else "7-42")
            yield replace(r, frame=replace(r.frame, scan=replace(r.frame.scan, sensor=sensor)))

    data = stored(write(tmp_path / "run.rrd", two()))
    assert list(data["/ppi/detections/7-42", "Points2D:positions"]) == [0, 2]
    assert list(data[r"/ppi/video/shore\/2", "EncodedImage:blob"]) == [1, 3]


def test_names_of_several_sensors_stand_apart_from_ships_and_from_each_other(tmp_path: Path) -> None:
    """Two on opposite banks: north of the northern one, south of the southern one, on a line from each."""
    place = {"7-42": np.array([0.0, 400.0]), "7-43": np.array([50.0, -400.0]), "7-44": np.array([300.0, 450.0])}

    def three() -> Iterator[Result]:
        for r in harbour(9):
            name = list(place)[r.frame.k % 3]
            scan = replace(r.frame.scan, sensor=replace(r.frame.scan.sensor, id=name), position_m=place[name])
            yield replace(r, frame=replace(r.frame, scan=scan))

    data, away_m, height_m = stored(write(tmp_path / "run.rrd", three())), {}, {}
    for name, at_m in place.items():
        last = max(data[f"/ppi/sensors/{name}/name", "Points2D:labels"])
        assert data[f"/ppi/sensors/{name}/name", "Points2D:labels"][last] == [f"sensor {name}"]
        assert data[f"/ppi/sensors/{name}", "Points2D:labels"][last] == [""]
        shown = at(data, f"/ppi/sensors/{name}/name", "Points2D:positions", last)[0] * [1, -1]
        line = np.array(data[f"/ppi/sensors/{name}", "LineStrips2D:strips"][last][0]) * [1, -1]
        assert np.allclose(line, [at_m, shown], atol=1e-2) and shown[0] == pytest.approx(at_m[0])
        away_m[name], height_m[name] = shown[1] - at_m[1], shown[1]
    assert away_m["7-42"] > 0 and away_m["7-44"] > 0 and away_m["7-43"] < 0
    assert min(map(abs, away_m.values())) > 300.0  # of a radius of some 3 km
    assert abs(height_m["7-44"] - height_m["7-42"]) > 100.0


def test_a_folder_that_is_missing_is_a_usage_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no folder"):
        RerunSink(tmp_path / "none" / "run.rrd").open(manifest())
