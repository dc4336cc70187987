"""States scan by scan as trajectories."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_array_equal

from maritrack.metrics import t_gospa
from maritrack.metrics.trajectories import track_states, trajectories
from maritrack.types import Tracks


def test_a_trajectory_has_its_positions_where_it_was_and_holes_elsewhere() -> None:
    scans = [((7, 3), np.array([[1.0, 2.0], [3.0, 4.0]])), ((), np.zeros((0, 2))), ((7,), np.array([[5.0, 6.0]]))]
    nan = [np.nan, np.nan]
    assert_array_equal(trajectories(scans), [[[3.0, 4.0], nan, nan], [[1.0, 2.0], nan, [5.0, 6.0]]])


def test_names_and_nothing_at_all_are_normal() -> None:
    assert trajectories([(("b", "a"), np.eye(2))])[:, 0].tolist() == [[0.0, 1.0], [1.0, 0.0]]
    assert trajectories([((), np.zeros((0, 2)))]).shape == (0, 1, 2)
    assert trajectories([]).shape == (0, 0, 2)
    assert t_gospa(trajectories([]), trajectories([]), c=1.0, p=2.0, gamma=1.0).total == 0.0


def test_tracks_are_moved_to_the_time_of_the_scan() -> None:
    n = np.zeros(2, np.int64)
    tracks = Tracks(
        id=np.array([4, 9]), t_ns=np.array([0, 10**9]), position_m=np.array([[0.0, 0.0], [5.0, 5.0]]),
        velocity_mps=np.array([[1.0, 0.0], [0.0, 2.0]]), cov=np.zeros((2, 4, 4)), extent_m2=np.zeros((2, 2, 2)),
        existence=np.ones(2), status=n, moving=np.zeros(2, bool), cluster=n,
    )  # fmt: skip
    ids, at = track_states(tracks, np.array([True, True]), 3 * 10**9)
    assert ids == (4, 9) and at.tolist() == [[3.0, 0.0], [5.0, 9.0]]
    assert track_states(tracks, np.array([False, True]), 0)[0] == (9,)
