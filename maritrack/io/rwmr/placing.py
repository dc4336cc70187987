"""Where own ship is: what turns and moves the polar points of a step onto its Cartesian ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maritrack.geo import polar_to_en, wrap
from maritrack.types import FloatArray

AGREE_M = 5.0  # root mean square distance, after the best turn and move
LEAST_POINTS = 3


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """Own ship at each step: where, and by how much bearings are turned to be from north; nan where not known."""

    position_m: FloatArray  # (s, 2)
    turn_rad: FloatArray  # (s,)


def place(polar: list[FloatArray], cartesian: list[FloatArray | None]) -> Placed:
    """From range and bearing (n, 2) and east and north (n, 2) of the same points in the same order, by step.

    Steps with other numbers of points, too few of them, or that don't agree have none.
    """
    position = np.full((len(polar), 2), np.nan)
    turn = np.full(len(polar), np.nan)
    for k, (rows, points) in enumerate(zip(polar, cartesian, strict=True)):
        if points is None or len(points) != len(rows) or len(rows) < LEAST_POINTS:
            continue
        seen = polar_to_en(rows[:, 0], rows[:, 1])
        a, b = seen - seen.mean(axis=0), points - points.mean(axis=0)
        sine, cosine = np.sum(a[:, 1] * b[:, 0] - a[:, 0] * b[:, 1]), np.sum(a * b)  # clockwise from north
        angle = float(np.arctan2(sine, cosine))
        turned = polar_to_en(rows[:, 0], rows[:, 1] + angle)
        there = points.mean(axis=0) - turned.mean(axis=0)
        if np.sqrt(np.mean(np.sum((turned + there - points) ** 2, axis=1))) <= AGREE_M:
            position[k], turn[k] = there, angle
    return Placed(position, turn)


def from_north(turn_rad: FloatArray) -> bool:
    """Whether the bearings are from north already: hardly any turn at most steps."""
    known = turn_rad[np.isfinite(turn_rad)]
    return len(known) > 0 and float(np.median(np.abs(wrap(known)))) < np.deg2rad(1.0)
