"""How far the echo of a hull, seen by two radars, wanders from the one's to the other's as the ship turns and passes.

An Ornstein-Uhlenbeck process along the course, and across it by as much less as a hull is narrower, for each ship;
linear between knots.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from maritrack.calibrate.sightings import Way
from maritrack.types import FloatArray, IntArray

WANDERS = 0.5  # standard deviation, of how far off an echo may lie
WANDER_S, FORGETS_S = 60.0, 600.0  # between knots, and how long an echo stays where it has got to
MOST_KNOTS = 400  # of all ships together: of long recordings they lie farther apart
WIDTH = 1 / 6  # of a length, where unknown


def spacing_s(ways: tuple[Way, ...]) -> float:
    """Seconds between two knots."""
    return max(WANDER_S, sum(float(way.t_s[-1] - way.t_s[0]) for way in ways) / MOST_KNOTS)


def knots(way: Way, apart_s: float) -> int:
    """How many values tell of the wander of an echo; none for ships that told where they are."""
    return 0 if way.seen_from_m is None else 2 + int((way.t_s[-1] - way.t_s[0]) // apart_s)


def wander_prior(ways: tuple[Way, ...]) -> FloatArray:
    """Inverse covariance (k, k) of how far each echo has wandered at the knots: of each ship along, then across.

    A ship that turns, or passes a radar, shows more of one end to it than before, and goes on to do so. Without this
    its way back and forth would be told from how late a radar is, and more surely than it can be.
    """
    blocks, step_s = [np.zeros((0, 0))], spacing_s(ways)
    for way in [way for way in ways if knots(way, step_s)]:
        number = np.arange(knots(way, step_s))
        alike = np.linalg.inv(np.exp(-step_s * np.abs(np.subtract.outer(number, number)) / FORGETS_S))
        blocks += [alike / (share * WANDERS * way.bias_m) ** 2 for share in (1.0, WIDTH)]
    return np.asarray(block_diag(*blocks))


def between_knots(way: Way, t_s: FloatArray, apart_s: float) -> tuple[IntArray, FloatArray]:
    """The knot before each time (m,), and how far it is on to the next, 0 to 1."""
    n = knots(way, apart_s)
    at = np.clip((t_s - way.t_s[0]) / apart_s, 0.0, n - 1.0)
    before = np.minimum(at.astype(np.int64), n - 2)
    return before, at - before
