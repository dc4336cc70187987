"""Own ship: positions and headings between reports."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from maritrack.errors import ConfigError
from maritrack.geo import wrap
from maritrack.io.pose import PoseTrack

S = 1_000_000_000
DAY = 1_700_000_000 * S


def line(order: list[int]) -> PoseTrack:
    t_s = np.array([0, 10, 20, 30])[order]
    position = np.stack([t_s * 2.0, t_s * -1.0], axis=-1)
    return PoseTrack.from_reports(DAY + t_s * S, position, np.deg2rad(t_s * 15.0 % 360))


@given(order=st.permutations([0, 1, 2, 3]), at=st.floats(0, 30))
@settings(derandomize=True, deadline=None, max_examples=50)
def test_between_reports_the_ship_moves_and_turns_evenly(order: list[int], at: float) -> None:
    t_ns = np.array([DAY + int(at * S)])
    assert_allclose(line(order).position(t_ns), [[2 * at, -at]], atol=1e-6)
    assert_allclose(wrap(line(order).heading(t_ns) - np.deg2rad(15 * at)), 0, atol=1e-6)


def test_the_bow_turns_the_short_way() -> None:
    pose = PoseTrack.from_reports(np.array([0, 2 * S]), np.zeros((2, 2)), np.deg2rad([350.0, 20.0]))
    assert_allclose(np.rad2deg(pose.heading(np.array([S]))), 5.0)


def test_before_and_after_the_reports_the_ship_stays() -> None:
    pose = line([0, 1, 2, 3])
    assert_allclose(pose.position(np.array([0, DAY + 99 * S])), [[0, 0], [60, -30]])


def test_of_reports_at_one_time_the_last_counts() -> None:
    pose = PoseTrack.from_reports(np.array([5, 5, 0]), np.array([[1, 1], [2, 2], [0, 0]]), np.array([0.1, 0.2, 0.3]))
    assert_allclose(pose.position(np.array([5])), [[2, 2]])
    assert_allclose(pose.heading(np.array([5])), [0.2])


def test_reports_without_a_heading_give_a_position_all_the_same() -> None:
    pose = PoseTrack.from_reports(
        np.array([0, 10, 20]), np.array([[0, 0], [5, 5], [10, 0]]), np.array([1.0, np.nan, 2.0])
    )
    assert_allclose(pose.position(np.array([10])), [[5, 5]])
    assert_allclose(pose.heading(np.array([10])), [1.5])


def test_a_fixed_platform_is_there_at_all_times() -> None:
    pose = PoseTrack.fixed((3.0, 4.0))
    assert_allclose(pose.position(np.array([-5, 0, DAY])), [[3, 4]] * 3)
    assert not pose.has_heading
    assert np.isnan(pose.heading(np.array([0, 1]))).all()
    assert PoseTrack.fixed(heading_rad=1.0).heading(np.array([7]))[0] == 1.0


def test_reports_without_a_position_are_refused() -> None:
    with pytest.raises(ConfigError, match="position"):
        PoseTrack.from_reports(np.array([0]), np.array([[np.nan, 1.0]]), np.array([0.0]))
