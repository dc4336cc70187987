"""OSPA, the distance of two sets of positions. Schuhmacher, Vo & Vo 2008."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment

from maritrack.metrics.distances import check_order, check_table, distance_table


@dataclass(frozen=True, slots=True)
class Ospa:
    """total^p = localisation^p + cardinality^p, each a mean over the larger set; at most c."""

    total: float
    localisation: float
    cardinality: float


def ospa(truth: ArrayLike, estimates: ArrayLike, *, c: float, p: float) -> Ospa:
    """OSPA of positions (n, d) and (m, d), cutoff c in their unit, order p.

    Both empty: 0. One empty: c, all of it cardinality. ValueError for positions that are not
    finite, c <= 0 or p < 1.
    """
    return ospa_from_distances(distance_table(truth, estimates), c=c, p=p)


def ospa_from_distances(distances: ArrayLike, *, c: float, p: float) -> Ospa:
    """OSPA from a table (truth, estimates) of distances."""
    check_order(c, p)
    D = check_table(distances)
    larger, smaller = max(D.shape), min(D.shape)
    if larger == 0:
        return Ospa(0.0, 0.0, 0.0)
    cost = (np.minimum(D, c) / c) ** p  # in units of c^p, so that no order overflows
    rows, cols = linear_sum_assignment(cost)
    near = float(cost[rows, cols].sum()) / larger
    missing = (larger - smaller) / larger
    return Ospa(c * (near + missing) ** (1.0 / p), c * near ** (1.0 / p), c * missing ** (1.0 / p))
