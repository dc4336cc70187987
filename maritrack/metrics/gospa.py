"""GOSPA: localisation, missed and false objects in one distance.

Rahmathullah, Garcia-Fernandez & Svensson 2017.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment

from maritrack.metrics.distances import check_order, check_table, distance_table
from maritrack.types import IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Gospa:
    """total^p = localisation_p + missed_p + false_p; parts are p-th powers, neither rooted nor averaged.

    A truth object is missed and an estimate false if it has no partner nearer than c. With
    alpha = 2 each costs c^p / 2. With another alpha the smaller set is assigned in full: two that
    are assigned across c or more still count as one missed and one false and share their cost
    c^p, and each of the surplus costs c^p / alpha.
    """

    total: float
    localisation_p: float
    n_missed: int
    n_false: int
    missed_p: float
    false_p: float
    pairs: IntArray  # (k, 2) truth and estimate, nearer than c; by truth


def gospa(truth: ArrayLike, estimates: ArrayLike, *, c: float, p: float, alpha: float = 2.0) -> Gospa:
    """GOSPA of positions (n, d) and (m, d), cutoff c in their unit, order p, 0 < alpha <= 2.

    ValueError for positions that are not finite, c <= 0, p < 1 or alpha out of range.
    """
    return gospa_from_distances(distance_table(truth, estimates), c=c, p=p, alpha=alpha)


def gospa_from_distances(distances: ArrayLike, *, c: float, p: float, alpha: float = 2.0) -> Gospa:
    """GOSPA from a table (truth, estimates) of distances."""
    check_order(c, p)
    if not 0.0 < alpha <= 2.0:
        raise ValueError(f"alpha = {alpha} is not within (0, 2]")
    D = check_table(distances)
    rows, cols = linear_sum_assignment((np.minimum(D, c) / c) ** p)
    near = D[rows, cols] < c
    n_far = len(rows) - int(near.sum())
    pairs = np.stack([rows[near], cols[near]], axis=1).astype(np.int64)
    localisation_p = float((D[pairs[:, 0], pairs[:, 1]] ** p).sum())
    n_missed, n_false = D.shape[0] - len(pairs), D.shape[1] - len(pairs)
    missed_p = c**p * (n_far / 2.0 + (n_missed - n_far) / alpha)
    false_p = c**p * (n_far / 2.0 + (n_false - n_far) / alpha)
    total = (localisation_p + missed_p + false_p) ** (1.0 / p)
    return Gospa(total, localisation_p, n_missed, n_false, missed_p, false_p, pairs)
