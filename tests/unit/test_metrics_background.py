"""FPR and NPV: counted by hand, with boxes against polygons."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.metrics.background import background_scores, confusion, in_boxes
from maritrack.types import FloatArray, Points, Truth
from tests.unit.scans import scan_of


def points_at(z: FloatArray) -> Points:
    return scan_of(z, 0.0)[1]


def truth_of(*rows: tuple[float, float, float, float, float], velocity: tuple[float, float] = (0.0, 0.0)) -> Truth:
    """Vessels (east, north, heading in degrees, length, width)."""
    t = np.array(rows, float).reshape(-1, 5)
    names = tuple(str(i) for i in range(len(t)))
    return Truth(
        names, names, 0, t[:, :2], np.tile(velocity, (len(t), 1)), np.radians(t[:, 2]), t[:, 3], t[:, 4]
    )  # fmt: skip


def test_each_point_is_counted_in_its_field_of_the_table() -> None:
    ship = truth_of((0, 0, 90, 100, 20))
    z = np.array([[0, 0], [49, 9], [-49, -9], [49, 11], [51, 0], [300, 0], [0, 40]], float)
    keep = np.array([1, 0, 1, 0, 1, 0, 0], bool)
    table = confusion(points_at(z), keep, ship)
    assert (table.tp, table.fp, table.fn, table.tn) == (3, 1, 1, 2)
    assert table.fpr == 1 / 3 and table.npv == 2 / 3
    wide = confusion(points_at(z), keep, ship, margin_m=2.0)
    assert (wide.tp, wide.fp, wide.fn, wide.tn) == (2, 2, 0, 3)


def test_nothing_over_nothing_is_no_number() -> None:
    none, ship = points_at(np.zeros((0, 2))), truth_of((0, 0, 0, 50, 10))
    assert math.isnan(confusion(none, np.zeros(0, bool), ship).fpr)
    far = points_at(np.array([[500.0, 0.0]]))
    table = confusion(far, np.zeros(1, bool), ship)
    assert math.isnan(table.fpr) and math.isnan(table.npv)
    assert all(math.isnan(v) for v in background_scores(far, np.ones(1, bool), None).values())
    assert background_scores(far, np.ones(1, bool), ship)["npv"] == 0.0


def test_where_no_vessel_has_a_box_neither_rate_is_known() -> None:
    ship, two = truth_of((0, 0, 0, 50, 10)), points_at(np.array([[500.0, 0.0], [0.0, 0.0]]))
    left = np.ones(2, bool)
    for unknown in (
        replace(ship, width_m=np.full(1, np.nan)),
        replace(ship, heading_rad=np.full(1, np.nan)),
        truth_of(),
    ):
        assert all(math.isnan(v) for v in background_scores(two, left, unknown).values())
    both = truth_of((0, 0, 0, 50, 10), (500, 0, 0, np.nan, 10))
    assert background_scores(two, left, both) == {"fpr": 0.0, "npv": 0.5}


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.integers(0, 10_000))
def test_boxes_are_rectangles_turned_to_the_heading(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = [
        (*rng.uniform(-200, 200, 2), rng.uniform(0, 360), rng.uniform(20, 300), rng.uniform(5, 60)) for _ in range(3)
    ]
    z, inside = rng.uniform(-400, 400, (300, 2)), np.zeros(300, bool)
    for east, north, heading, length, width in rows:
        box = shapely.box(-width / 2, -length / 2, width / 2, length / 2)
        turned = shapely.affinity.rotate(box, -heading, origin=(0, 0))
        inside |= shapely.contains_xy(shapely.affinity.translate(turned, east, north), z)
    assert in_boxes(points_at(z), truth_of(*rows)).tolist() == inside.tolist()


def test_a_box_is_where_the_vessel_was_when_the_beam_saw_the_point() -> None:
    ship = truth_of((0, 0, 90, 20, 10), velocity=(10.0, 0.0))
    points = replace(points_at(np.array([[20.0, 0.0], [20.0, 0.0]])), t_ns=np.array([0, 2_000_000_000]))
    assert in_boxes(points, ship).tolist() == [False, True]


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"heading_rad": np.array([np.nan])}, True),  # the course stands for it
        ({"heading_rad": np.array([np.nan]), "velocity_mps": np.full((1, 2), np.nan)}, False),
        ({"length_m": np.array([np.nan])}, False),
    ],
)
def test_a_vessel_of_unknown_shape_has_no_box(change: dict[str, FloatArray], expected: bool) -> None:
    ship = replace(truth_of((0, 0, 90, 100, 20), velocity=(5.0, 0.0)), **change)
    assert in_boxes(points_at(np.array([[40.0, 0.0]])), ship).tolist() == [expected]
