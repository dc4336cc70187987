"""Truth at an instant, against a reader of reports that is slow on purpose."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.io.reference import Reference, Reports, build_reference, moved_to, truth_at
from maritrack.types import Origin

S = 1_000_000_000
NAN = math.nan


def reference(rows, *, complete=True, velocity=None, heading=None, order=None):
    """Reports (id, seconds, east, north) as a reference."""
    ids = sorted({row[0] for row in rows})
    rows = rows if order is None else [rows[i] for i in order]
    m = len(rows)
    return build_reference(
        Reports(
            ship=np.array([ids.index(row[0]) for row in rows], dtype=np.int64),
            t_ns=np.array([round(row[1] * S) for row in rows], dtype=np.int64),
            position_m=np.array([row[2:4] for row in rows], dtype=float).reshape(-1, 2),
            velocity_mps=np.full((m, 2), NAN) if velocity is None else np.array(velocity, float),
            heading_rad=np.full(m, NAN) if heading is None else np.array(heading, float),
        ),
        ids=ids,
        names=[f"ship {i}" for i in ids],
        length_m=np.arange(len(ids)) + 10.0,
        width_m=np.full(len(ids), NAN),
        complete=complete,
    )


def slow_truth(ref: Reference, t_ns, *, moving_s, rest_s):
    """(id, east, north) of the ships known at a time, by walking through all reports."""
    found = []
    for i, key in enumerate(ref.ids):
        rows = range(int(ref.start[i]), int(ref.start[i + 1]))
        for a in rows:
            if ref.t_ns[a] == t_ns:
                found.append((key, *ref.position_m[a]))
                break
            b = a + 1
            if b in rows and ref.t_ns[a] < t_ns < ref.t_ns[b]:
                gap = (ref.t_ns[b] - ref.t_ns[a]) / S
                way = ref.position_m[b] - ref.position_m[a]
                far = math.hypot(*way)
                rest = far < 20.0 or far / gap < 0.5
                jump = not ref.complete and far > 60.0 * max(gap, 1.0)
                if not jump and (gap <= moving_s or (rest and gap <= rest_s)):
                    share = (t_ns - ref.t_ns[a]) / (ref.t_ns[b] - ref.t_ns[a])
                    found.append((key, *(ref.position_m[a] + share * way)))
    return found


reports = st.lists(
    st.tuples(
        st.sampled_from(["a", "b", "c"]),
        st.integers(0, 60).map(lambda i: i * 0.5),
        st.integers(-200, 200).map(float),
        st.integers(-200, 200).map(float),
    ),
    max_size=20,
)


@settings(derandomize=True, deadline=None, max_examples=200)
@given(reports, st.integers(-4, 130), st.booleans())
def test_truth_equals_walking_through_the_reports(rows, quarter_s, complete):
    ref = reference(rows, complete=complete)
    t_ns = quarter_s * S // 4
    truth = truth_at(ref, t_ns, max_gap_moving_s=4.0, max_gap_rest_s=12.0)
    expected = slow_truth(ref, t_ns, moving_s=4.0, rest_s=12.0)
    assert truth.id == tuple(row[0] for row in expected)
    np.testing.assert_allclose(truth.position_m, np.array([row[1:] for row in expected]).reshape(-1, 2), atol=1e-9)


@settings(derandomize=True, deadline=None)
@given(st.permutations(range(8)))
def test_order_of_reports_does_not_matter(order):
    rows = [(key, t, t * 3.0, -t) for key in ("x", "y") for t in (0.0, 2.0, 5.0, 9.0)]
    one, other = reference(rows), reference(rows, order=order)
    assert np.array_equal(one.t_ns, other.t_ns)
    assert np.array_equal(one.position_m, other.position_m)


def test_of_reports_with_equal_times_the_first_counts():
    ref = reference([("a", 1.0, 5.0, 0.0), ("a", 1.0, 6.0, 0.0)])
    assert ref.position_m.tolist() == [[5.0, 0.0]]


def test_nothing_is_known_before_the_first_and_after_the_last_report():
    ref = reference([("a", 10.0, 0.0, 0.0), ("a", 20.0, 50.0, 0.0)])
    assert [len(truth_at(ref, t * S)) for t in (9, 10, 15, 20, 21)] == [0, 1, 1, 1, 0]


def test_a_ship_under_way_is_lost_over_a_long_gap_and_one_at_rest_is_not():
    rows = [("moving", 0.0, 0.0, 0.0), ("moving", 60.0, 300.0, 0.0), ("rest", 0.0, 0.0, 0.0), ("rest", 180.0, 9.0, 0.0)]
    assert truth_at(reference(rows), 50 * S).id == ("rest",)


def test_velocity_is_the_slope_also_at_the_reports_themselves():
    ref = reference([("a", 0.0, 0.0, 0.0), ("a", 10.0, 50.0, -20.0)])
    for t in (0, 5, 10):
        np.testing.assert_allclose(truth_at(ref, t * S).velocity_mps, [[5.0, -2.0]])


def test_velocity_of_a_single_report_is_unknown():
    truth = truth_at(reference([("a", 3.0, 1.0, 2.0)]), 3 * S)
    assert truth.position_m.tolist() == [[1.0, 2.0]]
    assert np.isnan(truth.velocity_mps).all()


def test_a_complete_reference_is_taken_at_its_word_about_velocity_and_ais_is_not():
    rows = [("a", 0.0, 0.0, 0.0), ("a", 10.0, 50.0, 0.0)]
    told = [[4.0, 1.0], [6.0, 3.0]]
    assert truth_at(reference(rows, velocity=told), 5 * S).velocity_mps.tolist() == [[5.0, 2.0]]
    assert truth_at(reference(rows, velocity=told, complete=False), 5 * S).velocity_mps.tolist() == [[5.0, 0.0]]


def test_heading_turns_the_short_way_over_north():
    rows = [("a", 0.0, 0.0, 0.0), ("a", 10.0, 50.0, 0.0)]
    heading = truth_at(reference(rows, heading=np.deg2rad([350.0, 20.0])), 5 * S).heading_rad
    np.testing.assert_allclose(np.rad2deg(heading), [5.0])


def test_a_heading_that_one_report_lacks_is_that_of_the_other():
    rows = [("a", 0.0, 0.0, 0.0), ("a", 10.0, 50.0, 0.0)]
    assert truth_at(reference(rows, heading=[NAN, 1.0]), 5 * S).heading_rad.tolist() == [1.0]


def test_a_late_report_was_true_before_its_time():
    ref = reference([("late", 40.0, 0.0, 0.0), ("late", 50.0, 100.0, 0.0), ("prompt", 5.0, 7.0, 0.0)])
    truth = truth_at(ref, 5 * S, lag_s={"late": 37.0, "nobody": 1.0})
    assert truth.id == ("late", "prompt")
    np.testing.assert_allclose(truth.position_m, [[20.0, 0.0], [7.0, 0.0]])


def test_truth_counts_within_range_of_the_sensor_only():
    ref = reference([("near", 0.0, 100.0, 100.0), ("far", 0.0, 900.0, 100.0)])
    truth = truth_at(ref, 0, centre_m=np.array([0.0, 100.0]), max_range_m=100.0)
    assert truth.id == ("near",)
    assert truth.name == ("ship near",)
    assert truth.length_m.tolist() == [11.0]


def test_truth_on_both_borders_of_the_ranges_counts_and_beyond_them_does_not():
    ref = reference([(f"{r:03.0f}", 0.0, 0.0, r) for r in (99.0, 100.0, 300.0, 301.0)])
    truth = truth_at(ref, 0, centre_m=np.zeros(2), min_range_m=100.0, max_range_m=300.0)
    assert truth.id == ("100", "300")


def test_a_jump_that_no_ship_makes_is_not_bridged():
    rows = [("a", 0.0, 0.0, 0.0), ("a", 10.0, 5000.0, 0.0)]
    assert len(truth_at(reference(rows, complete=False), 5 * S)) == 0
    assert len(truth_at(reference(rows, complete=True), 5 * S)) == 1


def test_a_reference_without_ships_knows_nothing():
    assert len(truth_at(reference([]), 0, centre_m=np.zeros(2), max_range_m=1.0, lag_s={"a": 1.0})) == 0


def test_another_origin_moves_the_reports_and_back_again():
    ref, here, there = reference([("a", 0.0, 1500.0, -700.0)]), Origin(50.7, -1.1), Origin(50.75, -1.0)
    moved = moved_to(ref, old=here, new=there)
    np.testing.assert_allclose(
        moved.position_m, [[1500.0 - 7060.0, -700.0 - 5560.0]], atol=15.0
    )  # 0.1 and 0.05 degrees
    np.testing.assert_allclose(moved_to(moved, old=there, new=here).position_m, ref.position_m, atol=0.1)
    assert moved_to(ref, old=None, new=there) is ref


def test_arrays_of_unequal_length_are_refused():
    ref = reference([("a", 0.0, 0.0, 0.0)])
    with pytest.raises(ValueError, match="heading_rad"):
        replace(ref, heading_rad=np.zeros(2))
