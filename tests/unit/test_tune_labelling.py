"""Objects of points: from labelled cells against the table itself, from hulls against shapely."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.chain import detect
from maritrack.config import load_config
from maritrack.errors import InputError
from maritrack.geo import TWO_PI
from maritrack.recording import open_inputs, open_recording
from maritrack.settings import Config
from maritrack.simulate.labels import labels_path, read_labels, read_owners
from maritrack.simulate.record import simulate
from maritrack.simulate.scenes import load_scene
from maritrack.tune.labelling import CellLabels, HullLabels
from maritrack.tune.subjects import labelled_scans, subject
from maritrack.types import Frame, Points, Scan, Sensor, Truth

CONFIG = load_config(preset="radar", sets=["detect.threshold=0.4"])
MARGINS = {"margin_m": 20.0, "radius_m": 50.0}


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two turns of the harbour, with land, and their labels."""
    path = tmp_path_factory.mktemp("tune") / "rec.cat240"
    simulate(load_scene("harbour"), path, seed=1, scans=2)
    return path


def frames(path: Path, config: Config = CONFIG) -> list[Frame]:
    return list(open_recording(open_inputs([path]), ["cat240"], {}, config).frames)


def test_points_have_the_objects_of_their_cells(recording: Path) -> None:
    table, owners = read_labels(labels_path(recording)), read_owners(labels_path(recording))
    labelling = CellLabels(owners, labels_path(recording), 0.0)
    known = dict(zip(zip(*(a.tolist() for a in table[:3]), strict=True), table.object, strict=True))
    seen = set()
    for k, frame in enumerate(frames(recording)):
        points, video = detect(frame.scan, CONFIG), frame.scan.video
        assert video is not None
        spoke = np.floor(points.azimuth_rad / TWO_PI * len(video.azimuth_rad)).astype(int)
        cell = np.rint((points.range_m - video.first_range_m) / video.cell_m).astype(int)
        label = labelling.label(k, frame, points)
        for s, c, got in zip(spoke.tolist(), cell.tolist(), label.tolist(), strict=True):
            expected = known.get((k, s, c), "noise")
            assert {-1: "noise", -2: "land"}.get(got) == expected or owners.ids[got] == expected
            seen.add(expected)
    assert {"noise", "land"} < seen and len(seen) > 5


def test_a_window_and_a_turned_radar_change_no_label(recording: Path) -> None:
    of = subject(recording, truth=None)
    assert of.cells == labels_path(recording)
    whole = [scan.truth for scan in labelled_scans(of, CONFIG, **MARGINS)[0]]
    late = replace(CONFIG, input=replace(CONFIG.input, from_s=2.0, limit=1, azimuth_offset_deg=30.0))
    part = [scan.truth for scan in labelled_scans(of, late, **MARGINS)[0]]
    assert len(whole) == 2 and len(part) == 1
    assert np.array_equal(part[0], whole[1])


def test_labels_of_another_recording_are_noticed(recording: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.cat240"
    scene = load_scene("harbour")
    simulate(replace(scene, vessel=scene.vessel[:1], land=()), other, seed=5, scans=1)
    of = replace(subject(recording, truth=None), path=other)
    with pytest.raises(InputError, match="of another recording"):
        list(labelled_scans(of, CONFIG, **MARGINS)[0])


def test_what_is_no_table_of_labels_is_told(tmp_path: Path) -> None:
    (tmp_path / "x.parquet").write_bytes(b"PAR1 and no more")
    with pytest.raises(InputError, match=r"x\.parquet: no table of labelled cells"):
        read_owners(tmp_path / "x.parquet")


def test_positions_and_cells_mostly_agree_on_what_is_a_vessel(recording: Path) -> None:
    cells = labelled_scans(subject(recording, truth=None), CONFIG, **MARGINS)[0]
    hulls, told = labelled_scans(subject(recording, truth=None, positions=True), CONFIG, **MARGINS)
    a, b = (np.concatenate([scan.truth for scan in scans]) for scans in (cells, hulls))
    assert "positions and hulls" in told.told
    both = np.count_nonzero((a >= 0) & (b >= 0))
    assert both > 0.9 * np.count_nonzero(a >= 0) and both > 0.8 * np.count_nonzero(b >= 0)


def one_ship(**fields: float) -> Truth:
    known = {"heading": 0.0, "length": 100.0, "width": 20.0, "east": 0.0, "north": 3000.0, "ve": 0.0, "vn": 0.0}
    v = {key: np.array([value]) for key, value in (known | fields).items()}
    return Truth(
        ("1",), ("",), 10**9, np.stack([v["east"], v["north"]], 1), np.stack([v["ve"], v["vn"]], 1), v["heading"],
        v["length"], v["width"],
    )  # fmt: skip


def points_at(position_m: np.ndarray, *, t_ns: int = 10**9, depth_m: float = 0.0, width_rad: float = 0.0) -> Points:
    n = len(position_m)
    return Points(
        np.hypot(*position_m.T), np.arctan2(*position_m.T), position_m, np.ones(n), np.full(n, t_ns),
        np.full(n, depth_m), np.full(n, width_rad),
    )  # fmt: skip


def inside(truth: Truth, points: Points, labelling: HullLabels) -> np.ndarray:
    sensor = Sensor("7-1", 10.0, 0.01, 1e5)
    return labelling.label(0, Frame(0, Scan(sensor, 0, 0, np.zeros(2), 0.0), truth), points) == 0


@settings(derandomize=True, deadline=None, max_examples=20)
@given(
    heading=st.floats(0, 6.28), bearing=st.floats(0, 6.28), range_m=st.floats(500, 20_000), seed=st.integers(0, 1000)
)
def test_a_hull_is_grown_by_the_box_of_beam_and_pulse(
    heading: float, bearing: float, range_m: float, seed: int
) -> None:
    """Against the convex hull of all sums of corners, which is the sum of the two rectangles."""
    labelling = HullLabels(margin_m=15.0, radius_m=50.0, beam_rad=0.01, pulse_m=30.0)
    at = range_m * np.array([np.sin(bearing), np.cos(bearing)])
    truth = one_ship(heading=heading, east=at[0], north=at[1])
    position = at + np.random.default_rng(seed).uniform(-150, 150, (60, 2))
    points = points_at(position, depth_m=10.0, width_rad=0.002)
    corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]])

    def rectangle(along: float, abeam: float, azimuth: float) -> np.ndarray:
        axes = np.array([[np.sin(azimuth), np.cos(azimuth)], [np.cos(azimuth), -np.sin(azimuth)]])
        return corners * [along, abeam] @ axes

    expected = [
        shapely.MultiPoint(
            (rectangle(50, 10, heading)[:, None] + rectangle(5 + 15 + 15, r * 0.006 + 15, azimuth) + at).reshape(-1, 2)
        ).convex_hull.contains(shapely.Point(p))
        for p, r, azimuth in zip(position, points.range_m, points.azimuth_rad, strict=True)
    ]
    assert inside(truth, points, labelling).tolist() == expected


def test_a_ship_is_where_it_is_when_the_beam_passes() -> None:
    labelling = HullLabels(margin_m=0.0, radius_m=50.0, beam_rad=0.0, pulse_m=0.0)
    truth, bow = one_ship(vn=10.0), np.array([[0.0, 3060.0]])
    assert not inside(truth, points_at(bow), labelling).any()
    assert inside(truth, points_at(bow, t_ns=3 * 10**9), labelling).all()


def test_without_a_size_there_is_a_radius_and_without_a_heading_the_course() -> None:
    labelling = HullLabels(margin_m=0.0, radius_m=50.0, beam_rad=0.0, pulse_m=0.0)
    around = np.array([[0.0, 3049.0], [49.0, 3000.0], [0.0, 3051.0], [51.0, 3000.0]])
    unknown = one_ship(length=np.nan, width=np.nan, heading=np.nan)
    assert inside(unknown, points_at(around), labelling).tolist() == [True, True, False, False]
    sailing_east = one_ship(heading=np.nan, ve=5.0)
    assert inside(sailing_east, points_at(around), labelling).tolist() == [False, True, False, False]
    at_anchor = one_ship(heading=np.nan)
    assert inside(at_anchor, points_at(around), labelling).tolist() == [True, True, False, False]


def test_of_two_hulls_the_nearer_counts() -> None:
    one, two = one_ship(), one_ship(east=30.0)
    both = Truth(
        ("1", "2"), ("", ""), one.t_ns,
        *(np.concatenate([getattr(one, f), getattr(two, f)]) for f in ("position_m", "velocity_mps", "heading_rad",
                                                                         "length_m", "width_m")),
    )  # fmt: skip
    labelling = HullLabels(margin_m=10.0, radius_m=50.0, beam_rad=0.0, pulse_m=0.0)
    position = np.array([[14.0, 3000.0], [16.0, 3000.0], [200.0, 3000.0]])
    frame = Frame(0, Scan(Sensor("7-1", 10.0, 0.01, 1e5), 0, 0, np.zeros(2), 0.0), both)
    assert labelling.label(0, frame, points_at(position)).tolist() == [0, 1, -2]
