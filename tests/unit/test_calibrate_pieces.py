"""Tracks of one radar that are of one ship: they count once."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from maritrack.calibrate.pieces import whole_ships
from maritrack.retrospect import History, gather
from maritrack.types import CONFIRMED, FloatArray, Tracks

TURN_S = 4.0


def history(*pieces: tuple[int, int, int, FloatArray, FloatArray]) -> History:
    """Tracks: id, first and last scan, place at scan 0, velocity."""
    scans = []
    for k in range(1 + max(piece[2] for piece in pieces)):
        here = [piece for piece in pieces if piece[1] <= k <= piece[2]]
        n = len(here)
        if n:
            place = np.array([start + k * TURN_S * velocity for _, _, _, start, velocity in here])
            scans.append((k, Tracks(
                np.array([piece[0] for piece in here]), np.full(n, int(k * TURN_S * 1e9)), place,
                np.array([piece[4] for piece in here]), np.tile(np.eye(4), (n, 1, 1)), np.tile(np.eye(2), (n, 1, 1)),
                np.ones(n), np.full(n, CONFIRMED), np.ones(n, bool), np.zeros(n, np.int64), (), np.full(n, 9.0),
            )))  # fmt: skip
    return gather(scans)


EAST, WEST, START = np.array([2.5, 0.2]), np.array([-2.5, 0.0]), np.array([100.0, 50.0])


def off(east_m: float, north_m: float) -> FloatArray:
    """A place seen from `START`."""
    return np.asarray(START + np.array([east_m, north_m]))


def test_a_track_that_goes_on_from_another_is_of_the_same_ship() -> None:
    found = whole_ships(history((3, 0, 40, START, EAST), (9, 60, 100, START, EAST), (12, 120, 160, START, EAST)))
    assert np.unique(found.tracks.id).tolist() == [3] and len(found) == 123
    assert (np.diff(found.tracks.t_ns) > 0).all()
    assert_allclose(found.tracks.position_m, START + found.scan[:, None] * TURN_S * EAST, atol=1e-9)


def test_two_tracks_at_both_ends_of_a_hull_are_one_ship_and_the_longer_one_stays() -> None:
    ends = history((1, 40, 80, off(200.0, 0.0), EAST), (2, 0, 100, START, EAST))
    assert np.unique(whole_ships(ends).tracks.id).tolist() == [2]
    one_then_other = history((1, 0, 30, off(200.0, 0.0), EAST), (2, 28, 100, START, EAST))
    assert np.unique(whole_ships(one_then_other).tracks.id).tolist() == [2]


def test_ships_that_meet_overtake_or_begin_elsewhere_stay_ships_of_their_own() -> None:
    meet = history((1, 0, 100, START, EAST), (2, 0, 100, off(900.0, 60.0), WEST))
    overtakes = history((1, 0, 100, START, EAST), (2, 0, 100, off(-200.0, 60.0), 1.6 * EAST))
    late = history((1, 0, 40, START, EAST), (2, 120, 160, START, EAST))  # 320 s later
    aside = history((1, 0, 40, START, EAST), (2, 50, 90, off(0.0, 400.0), EAST))
    turned = history((1, 0, 40, START, EAST), (2, 45, 90, off(850.0, 0.0), WEST))
    for case in (meet, overtakes, late, aside, turned):
        assert np.unique(whole_ships(case).tracks.id).tolist() == [1, 2]


def test_no_tracks_are_no_ships() -> None:
    none = history((1, 0, 1, START, EAST))
    assert len(whole_ships(none.rows(np.zeros(2, bool)))) == 0
