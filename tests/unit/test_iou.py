"""Outlines of ships against what tracks draw: areas by hand, invariances, who is compared with whom."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from shapely import Polygon

from maritrack.metrics.iou import iou, outlines, pair_ious, shape
from maritrack.metrics.scores import score_frame, truth_distances
from maritrack.types import CONFIRMED, FloatArray, Tracks, Truth

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
SECOND = 10**9


def truth_of(position: list[list[float]], *, heading_deg: float = 90.0, length_m: float = 6.0) -> Truth:
    n = len(position)
    return Truth(
        id=tuple(f"s{i}" for i in range(n)), name=("",) * n, t_ns=0, position_m=np.array(position, float),
        velocity_mps=np.tile([1.0, 0.0], (n, 1)), heading_rad=np.full(n, np.deg2rad(heading_deg)),
        length_m=np.full(n, length_m), width_m=np.full(n, 3.0),
    )  # fmt: skip


def tracks_of(position: list[list[float]], *, contours: tuple[FloatArray, ...] = (), axes: float = 0.0) -> Tracks:
    n = len(position)
    return Tracks(
        id=np.arange(1, n + 1), t_ns=np.zeros(n, np.int64), position_m=np.array(position, float).reshape(-1, 2),
        velocity_mps=np.zeros((n, 2)), cov=np.zeros((n, 4, 4)), extent_m2=np.tile(axes**2 * np.eye(2), (n, 1, 1)),
        existence=np.ones(n), status=np.full(n, CONFIRMED), moving=np.ones(n, bool), cluster=np.full(n, -1),
        contour_m=contours,
    )  # fmt: skip


def scores_of(truth: Truth, tracks: Tracks, **more: object) -> dict[str, float]:
    which = np.ones(len(tracks), bool)
    return score_frame(truth, tracks, which=which, c_m=10.0, p=2.0, bow_share=1 / 3, **more)  # type: ignore[arg-type]


def test_squares_by_hand() -> None:
    assert iou(SQUARE, SQUARE) == 1.0
    assert iou(SQUARE, SQUARE + np.array([1.0, 0.0])) == pytest.approx(2 / 6)
    assert iou(SQUARE, SQUARE + np.array([5.0, 0.0])) == 0.0
    assert iou(SQUARE, SQUARE[:2]) == iou(SQUARE[:0], SQUARE) == 0.0
    assert iou(np.zeros((3, 2)), np.zeros((3, 2))) == 0.0


def test_a_contour_that_crosses_itself_counts_with_the_area_that_it_encloses() -> None:
    bow_tie = np.array([[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 2.0]])
    assert iou(SQUARE, bow_tie) == pytest.approx(0.5)


angles = st.floats(0.0, 2 * math.pi)


@given(angles, st.tuples(st.floats(-50, 50), st.floats(-50, 50)), st.integers(0, 99))
@settings(derandomize=True, deadline=None, max_examples=60)
def test_turning_and_moving_the_world_and_the_order_of_the_two_change_nothing(
    angle: float, by: tuple[float, float], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    corner = 2 * math.pi * np.arange(12) / 12
    a, b = (r[:, None] * np.stack([np.cos(corner), np.sin(corner)], 1) for r in rng.uniform(1.0, 4.0, (2, 12)))
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    value = iou(a, b)
    assert 0.0 <= value <= 1.0
    assert iou(a @ turn.T + by, b @ turn.T + by) == pytest.approx(value, abs=1e-9)
    assert iou(b, a) == pytest.approx(value, abs=1e-12)


def test_an_outline_points_ahead_and_an_ellipse_has_the_axes_of_the_extent() -> None:
    ship = outlines(truth_of([[10.0, 20.0]]), np.array([0]), 1 / 3)[0]
    assert_allclose(ship[0], [13.0, 20.0], atol=1e-12)
    assert Polygon(ship).area == pytest.approx(15.0)
    north = outlines(truth_of([[0.0, 0.0]], heading_deg=0.0), np.array([0]), 0.0)[0]
    assert_allclose(Polygon(north).bounds, [-1.5, -3.0, 1.5, 3.0], atol=1e-12)
    round_one = tracks_of([[1.0, 2.0]], axes=2.0)
    assert Polygon(shape(round_one, 0)).area == pytest.approx(math.pi * 4.0, rel=0.01)
    long_one = replace(round_one, extent_m2=np.array([[[9.0, 0.0], [0.0, 1.0]]]))
    assert_allclose(Polygon(shape(long_one, 0)).bounds, [-2.0, 1.0, 4.0, 3.0], atol=1e-9)


def test_the_ship_is_compared_at_the_time_of_its_track() -> None:
    truth = truth_of([[0.0, 0.0]])
    drawn = outlines(truth, np.array([0]), 1 / 3)[0] + np.array([2.0, 0.0])
    late = replace(tracks_of([[2.0, 0.0]], contours=(drawn,)), t_ns=np.array([2 * SECOND]))
    assert_allclose(pair_ious(truth, late, np.array([[0, 0]]), bow_share=1 / 3), [1.0], atol=1e-12)


def test_the_score_is_the_mean_over_the_pairs_of_gospa_and_leaves_out_the_others() -> None:
    truth = truth_of([[0.0, 0.0], [50.0, 0.0], [100.0, 0.0]])
    ships = outlines(truth, np.arange(3), 1 / 3)
    far = ships[2] + np.array([0.0, 30.0])
    tracks = tracks_of([[100.0, 30.0], [0.0, 0.0], [51.0, 0.0]], contours=(far, ships[0], ships[1][:2]))
    found = scores_of(truth, tracks)
    assert found["iou"] == pytest.approx(0.5)  # 1 and, for a hull without area, 0; the third ship has no track
    assert (found["gospa_missed"], found["gospa_false"]) == (1.0, 1.0)
    only = score_frame(
        truth, tracks, which=np.array([True, True, False]), c_m=10.0, p=2.0, covered=np.array([True, False, True]),
        bow_share=1 / 3,
    )  # fmt: skip
    assert only["iou"] == pytest.approx(1.0) and only["n_truth"] == 2.0


def test_without_outlines_shapes_or_pairs_there_is_no_score() -> None:
    truth, drawn = truth_of([[0.0, 0.0]]), (SQUARE,)
    assert "iou" not in scores_of(truth, tracks_of([[0.0, 0.0]]))
    assert "iou" not in scores_of(replace(truth, width_m=np.array([np.nan])), tracks_of([[0.0, 0.0]], contours=drawn))
    assert "iou" not in scores_of(replace(truth, heading_rad=np.array([np.nan])), tracks_of([[0.0, 0.0]], axes=1.0))
    assert math.isnan(scores_of(truth, tracks_of([[40.0, 0.0]], axes=1.0))["iou"])


def test_a_distance_of_position_and_velocity_mixes_metres_and_metres_a_second() -> None:
    truth = truth_of([[3.0, 0.0], [0.0, 0.0]])
    tracks = replace(tracks_of([[0.0, 0.0]]), velocity_mps=np.array([[1.0, 4.0]]))
    assert_allclose(truth_distances(truth, tracks), [[3.0], [0.0]])
    assert_allclose(truth_distances(truth, tracks, velocity=True), [[5.0], [4.0]])
    unknown = replace(truth, velocity_mps=np.full((2, 2), np.nan))
    assert_allclose(truth_distances(unknown, tracks, velocity=True), [[3.0], [0.0]])
    assert scores_of(truth, tracks, velocity=True)["gospa_localisation"] == pytest.approx(16.0)
