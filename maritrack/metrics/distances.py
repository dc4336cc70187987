"""Euclidean distances between truth and estimates, and the checks that all set metrics share."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from maritrack.types import FloatArray


def distance_table(truth: ArrayLike, estimates: ArrayLike) -> FloatArray:
    """Distances (n, m) between the rows of (n, d) and (m, d); an empty set may have any shape.

    ValueError where a position is not finite or the dimensions differ.
    """
    X, Y = _rows("truth", truth), _rows("estimates", estimates)
    if not len(X) or not len(Y):
        return np.zeros((len(X), len(Y)))
    if X.shape[1] != Y.shape[1]:
        raise ValueError(f"truth has {X.shape[1]} dimensions, estimates have {Y.shape[1]}")
    return np.asarray(np.linalg.norm(X[:, None] - Y[None], axis=2), dtype=np.float64)


def _rows(name: str, values: ArrayLike) -> FloatArray:
    rows = np.asarray(values, dtype=np.float64)
    if rows.size == 0:
        return np.zeros((len(rows) if rows.ndim == 2 else 0, 0))
    if rows.ndim != 2:
        raise ValueError(f"{name} must be a table (items, dimensions), not of shape {rows.shape}")
    if not np.all(np.isfinite(rows)):
        raise ValueError(f"{name} has a position that is not finite")
    return rows


def check_table(distances: ArrayLike) -> FloatArray:
    """Distances (n, m) as floats; ValueError where one is negative or not a number. Infinite is far."""
    D = np.asarray(distances, dtype=np.float64)
    if D.ndim != 2:
        raise ValueError(f"distances must be a table (truth, estimates), not of shape {D.shape}")
    if not np.all(D >= 0.0):
        raise ValueError("a distance is negative or not a number")
    return D


def check_order(c: float, p: float) -> None:
    """ValueError unless the cutoff c is positive and the order p is at least 1, both finite."""
    if not 0.0 < c < math.inf:
        raise ValueError(f"cutoff c = {c} must be greater than 0 and finite")
    if not 1.0 <= p < math.inf:
        raise ValueError(f"order p = {p} must be at least 1 and finite")
