"""Raster and shapes of the picture: nothing vanishes, everything is where it belongs and to scale."""

from __future__ import annotations

import io
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from maritrack.geo import TWO_PI, en_to_polar, polar_to_en
from maritrack.metrics.scores import KEYS, ScoreSums
from maritrack.run import Tally
from maritrack.sinks import captions, raster, shapes, view
from maritrack.sinks.drawing import draw_numbers, score_entity
from maritrack.types import COASTED, CONFIRMED, STATIONARY, TENTATIVE, FloatArray, IntArray, Tracks, Video
from tests import runs

CELL_M = 12.5
SUMMED = ("points", "clusters", "tracks", "confirmed", "moving")  # counts of a run


def video(cells: np.ndarray, *, azimuth: FloatArray | None = None, used: int | None = None) -> Video:
    n, b = cells.shape
    azimuth = (np.arange(n) + 0.5) * TWO_PI / n if azimuth is None else azimuth
    return Video(azimuth, np.full(n, TWO_PI / n), np.zeros(n, np.int64), 100.0, CELL_M, cells,
                 np.full(n, b if used is None else used))  # fmt: skip


def picture_of(v: Video, *, pixels: int = 200, full_scale: float = 255.0) -> tuple[np.ndarray, float]:
    lookup = raster.make_lookup(raster.geometry_of(v, pixels=pixels))
    return raster.to_raster(v, lookup, full_scale=full_scale), lookup.half_m


def place_of(grey: np.ndarray, half_m: float) -> FloatArray:
    """East-north of the bright pixels' middle."""
    row, column = np.nonzero(grey > 100)
    pixel_m = 2 * half_m / len(grey)
    return np.array([column.mean() + 0.5, -(row.mean() + 0.5)]) * pixel_m + half_m * np.array([-1, 1])


@settings(derandomize=True, deadline=None, max_examples=40)
@given(
    n=st.sampled_from([90, 360, 1000]), b=st.sampled_from([40, 300]), pixels=st.sampled_from([100, 200]), data=st.data()
)
def test_a_single_cell_never_vanishes_and_stands_in_its_place(n: int, b: int, pixels: int, data: st.DataObject) -> None:
    spoke, cell = data.draw(st.integers(0, n - 1)), data.draw(st.integers(0, b - 1))
    jitter = np.random.default_rng(spoke).uniform(-0.3, 0.3, n)
    azimuth = (np.arange(n) + 0.5 + jitter) * TWO_PI / n
    cells = np.zeros((n, b), np.uint8)
    cells[spoke, cell] = 200
    grey, half_m = picture_of(video(cells, azimuth=azimuth), pixels=pixels)
    assert grey.max() == 200
    true = polar_to_en(np.array([100 + cell * CELL_M]), azimuth[spoke : spoke + 1])[0]
    patch_m = TWO_PI / n * (100 + cell * CELL_M) + CELL_M
    assert np.hypot(*(place_of(grey, half_m) - true)) < 2 * half_m / pixels * 2.5 + patch_m


@pytest.mark.parametrize("pixels", [60, 100])
@pytest.mark.parametrize("cell", range(20, 62, 8))
def test_no_cell_is_skipped_in_any_direction(cell: int, pixels: int) -> None:
    cells = np.zeros((360, 70), np.uint8)
    lookup = raster.make_lookup(raster.geometry_of(video(cells), pixels=pixels))
    for spoke in range(360):
        cells[:] = 0
        cells[spoke, cell + spoke % 5 : cell + spoke % 5 + 1] = 200
        assert raster.to_raster(video(cells), lookup, full_scale=255.0).max() == 200


def test_north_is_up_and_east_is_right() -> None:
    cells = np.zeros((360, 100), np.uint8)
    cells[0:2, 80], cells[90:92, 40] = 255, 255
    grey, _ = picture_of(video(cells), pixels=201)
    row, column = np.nonzero(grey == 255)
    north, east = row < 60, column > 120
    assert np.array_equal(north, ~east) and north.any() and east.any()


def test_a_sector_without_spokes_is_dark_and_one_without_echoes_is_not() -> None:
    v = video(np.zeros((270, 100), np.uint8), azimuth=(np.arange(270) + 0.5) * TWO_PI / 360)
    v = Video(v.azimuth_rad, np.full(270, TWO_PI / 360), *(getattr(v, f) for f in ("t_ns", "first_range_m", "cell_m",
              "intensity", "cells_used")))  # fmt: skip
    grey, _ = picture_of(v, pixels=200)
    assert (grey[20:90, 20:90] <= raster.NOTHING).all()
    assert (grey[50:90, 50:90] == raster.NOT_SEEN).all()  # north-west was not swept
    assert (grey[110:150, 110:150] == raster.NOTHING).all()
    assert grey[0, 0] == grey[100, 100] == raster.NOT_SEEN  # beyond the range, and nearer than the first cell


def test_padding_of_short_spokes_counts_as_not_seen() -> None:
    grey, half_m = picture_of(video(np.full((360, 100), 50, np.uint8), used=40), pixels=200)
    assert grey[100, 100 + int(0.3 * 100)] == 50
    assert grey[100, 190] == raster.NOT_SEEN
    assert half_m == pytest.approx(100 - CELL_M / 2 + 100 * CELL_M)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.uint32])
def test_brightness_grows_with_intensity_whatever_the_depth(dtype: type) -> None:
    top = int(np.iinfo(dtype).max)
    levels: np.ndarray = np.linspace(0, top, 50).astype(dtype)[None]
    grey = raster.to_bytes(levels, full_scale=float(top))[0].astype(int)
    assert grey[0] == raster.NOTHING and grey[-1] == 255 and (np.diff(grey) >= 0).all() and len(set(grey)) > 40


def test_full_scale_is_the_depth_unless_the_video_stays_far_below() -> None:
    assert raster.full_scale(8, 200.0) == 255
    assert raster.full_scale(16, 4095.0) == 4095
    assert raster.full_scale(1, 1.0) == 1
    assert raster.full_scale(8, 0.0) == 1


@settings(derandomize=True, deadline=None, max_examples=30)
@given(n=st.integers(1, 60), n_bins=st.sampled_from([16, 64, 256]), seed=st.integers(0, 99))
def test_the_nearest_spoke_is_the_nearest_on_the_ring(n: int, n_bins: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    azimuth, width = rng.uniform(0, TWO_PI, n), rng.uniform(0.01, 0.3, n)
    spoke = raster.nearest_spoke(azimuth, width, n_bins=n_bins)
    centre = (np.arange(n_bins) + 0.5) * TWO_PI / n_bins
    gap = np.abs((azimuth[None] - centre[:, None] + np.pi) % TWO_PI - np.pi)
    seen = spoke < n
    assert np.allclose(gap[seen, spoke[seen]], gap[seen].min(axis=1))
    reach = 0.75 * np.maximum(width, TWO_PI / n_bins)
    assert np.array_equal(seen, gap.min(axis=1) <= reach[gap.argmin(axis=1)])


def test_the_picture_is_a_colour_jpeg() -> None:
    grey = np.full((64, 64), 255, np.uint8)
    image = Image.open(io.BytesIO(raster.to_jpeg(grey, colours=raster.palette(captions.VIDEO_STOPS))))
    assert image.format == "JPEG" and image.size == (64, 64)
    assert np.allclose(np.array(image)[32, 32], captions.VIDEO_STOPS[-1][1], atol=6)


@settings(derandomize=True, deadline=None)
@given(a=st.floats(0.5, 500), b=st.floats(0.5, 500), turn=st.floats(0, 6.3))
def test_ellipses_solve_their_equation_and_axes_come_back(a: float, b: float, turn: float) -> None:
    axis = np.array([np.sin(turn), np.cos(turn)])
    across = np.array([-axis[1], axis[0]])
    shape = a * a * np.outer(axis, axis) + b * b * np.outer(across, across)
    outline = shapes.ellipses(np.array([[7.0, -3.0]]), shape[None])[0] - [7.0, -3.0]
    assert np.allclose(np.einsum("vi,ij,vj->v", outline, np.linalg.inv(shape), outline), 1, rtol=1e-6)
    length, width, orientation = shapes.axes_of(shape[None])
    assert (length[0], width[0]) == pytest.approx((2 * max(a, b), 2 * min(a, b)), rel=1e-6)
    if abs(a - b) > 0.01 * a:
        along = turn if a > b else turn + np.pi / 2
        assert abs(np.sin(orientation[0] - along)) < 1e-5


def test_an_ellipse_without_size_is_a_point() -> None:
    assert np.array_equal(shapes.ellipses(np.ones((1, 2)), np.zeros((1, 2, 2))), np.ones((1, 25, 2)))


@settings(derandomize=True, deadline=None)
@given(st.floats(30, 90_000))
def test_there_are_two_to_six_rings_inside_the_range(range_m: float) -> None:
    step_m, _, _ = shapes.ring_step(range_m)
    assert 2 <= int(range_m / step_m) <= 6
    lines, at, text = shapes.rings(np.zeros(2), range_m)
    assert np.hypot(*lines.vertex.T).max() <= range_m * 1.0001
    assert len(at) == len(text) and lines.count.sum() == len(lines.vertex)


def tracks(ids: list[int], status: IntArray | int = CONFIRMED, *, east: float = 0.0) -> Tracks:
    n = len(ids)
    zero = np.zeros((n, 2))
    return Tracks(np.array(ids, np.int64), np.zeros(n, np.int64), zero + np.array([east, 0.0]), zero,
                  np.zeros((n, 4, 4)), np.zeros((n, 2, 2)), np.ones(n), np.full(n, status), np.ones(n, bool),
                  np.full(n, -1))  # fmt: skip


def test_trails_keep_the_last_positions_and_forget_dead_tracks() -> None:
    trails = shapes.no_trails(3)
    for k, ids in enumerate([[2, 5], [2, 5], [2, 5], [1, 5], [5]]):
        trails = shapes.extend_trails(trails, tracks(ids, east=float(k)))
    assert trails.id.tolist() == [5]
    strips, index = shapes.trail_strips(trails, np.array([True]))
    assert strips.vertex[:, 0].tolist() == [2, 3, 4] and index.tolist() == [0]


def test_a_track_that_comes_back_starts_a_new_trail() -> None:
    trails = shapes.no_trails(5)
    for ids in ([7], [], [7]):
        trails = shapes.extend_trails(trails, tracks(ids))
    assert len(shapes.trail_strips(trails, np.array([True]))[0]) == 0


def test_what_is_held_in_the_background_is_told_apart_from_what_does_not_move() -> None:
    t = tracks([1, 2, 3, 4], np.array([TENTATIVE, CONFIRMED, COASTED, STATIONARY]))
    still = replace(t, moving=np.zeros(4, bool))
    assert captions.track_class(t).tolist() == [20, 21, 22, 23]
    assert captions.track_class(still).tolist() == [20, 24, 24, 23]
    assert not captions.shown_moving(still).any()
    shown = {name: colour for class_id, name, colour in captions.CLASSES if class_id in (23, 24)}
    assert list(shown) == ["stationary track, held in the background", "track that does not move"]
    assert len(set(captions.COLOUR.values())) == len(captions.CLASSES) == len(set(captions.COLOUR_NAME.values()))


def test_the_track_table_has_a_word_for_tracks_in_the_background() -> None:
    t = tracks([1, 2, 3, 4], np.array([COASTED, CONFIRMED, STATIONARY, TENTATIVE]))
    t = replace(t, moving=np.array([True, False, False, False]))
    lines = captions.track_table(t, np.zeros(2), scan=4, view_m=5000).splitlines()
    told = "**1 moving**, 1 that do not move, 1 stationary (held in the background), 1 tentative."
    assert lines[0] == f"Scan 4: {told}"
    rows = [[cell.strip() for cell in line.split("|")[1:3]] for line in lines[4:]]
    assert rows == [["T1", "coasted"], ["T3", "stationary"], ["T2", "not moving"]]


def test_the_track_table_lists_the_nearest_first() -> None:
    t = tracks([1, 2, 3])
    t.position_m[:] = [[3000, 0], [0, 1000], [0, -2000]]
    lines = captions.track_table(t, np.zeros(2), scan=4, view_m=5000).splitlines()
    assert [line.split("|")[1].strip() for line in lines[4:]] == ["T2", "T3", "T1"]
    assert "| 1.62 | 090 |" in lines[-1] and "range NM" in lines[2]


def test_the_box_leaves_stragglers_out_and_a_union_holds_both() -> None:
    position = np.concatenate([np.random.default_rng(1).uniform(-1, 1, (1000, 2)), [[900.0, 900.0]]])
    box = view.box_around(position)
    assert box is not None and box.size_m < 2.1
    other = view.square(np.array([50.0, 0.0]), 2.0)
    assert box.union(other).holds(box) and box.union(other).holds(other) and not box.holds(other)
    assert view.box_around(np.full((3, 2), np.nan)) is None


def test_scores_have_a_place_and_a_unit() -> None:
    assert score_entity("gospa") == "metrics/gospa"
    assert score_entity("ospa_localisation") == "metrics/ospa/localisation"
    assert captions.score_title("ospa_localisation") == "OSPA localisation [m]"
    assert captions.score_title("gospa_localisation") == "GOSPA localisation [m^p]"
    assert captions.score_title("n_truth") == "truth [objects]"
    assert captions.score_title("iou") == "IoU"


def test_velocity_lines_are_a_few_percent_of_the_range() -> None:
    for range_m in (300.0, 3000.0, 7400.0, 40_000.0):
        ahead_m = 10 / captions.KNOTS * 60 * captions.vector_minutes(range_m)
        assert 0.02 <= ahead_m / range_m <= 0.11
    assert captions.duration(0.5) == "30 s" and captions.duration(3.0) == "3 min"


def test_picture_turns_north_over() -> None:
    assert shapes.picture(np.array([[3.0, 4.0]])).tolist() == [[3.0, -4.0]]
    assert np.allclose(en_to_polar(np.array([[0.0, 5.0]]))[1], 0)


def test_the_plotted_counts_add_up_to_those_of_the_summary() -> None:
    results = [runs.result(k) for k in range(8)]
    assert {int(i) for r in results for i in r.tracks.status} == {TENTATIVE, CONFIRMED, COASTED, STATIONARY}
    tally, plotted = Tally(ScoreSums(), 100.0), Counter[str]()
    for r in results:
        tally.add(r, r.tracks.status >= CONFIRMED)
        rows = {row.entity: row.parts for row in draw_numbers(r) if row.kind == "Scalars"}
        plotted.update({name: rows[f"metrics/counts/{name}"]["scalars"].item() for name in SUMMED})
    assert plotted == {name: getattr(tally, name) for name in SUMMED}


def test_every_score_of_a_frame_has_a_unit() -> None:
    assert all(captions.score_unit(name) for name in KEYS)
