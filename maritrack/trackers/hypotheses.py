"""Global hypotheses, factor by factor: which row each track is, and how likely that is.

Tracks that no measurement ever connected are independent, so that a hypothesis of all is one of each factor. Rows
that are in no factor are alone and certain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maritrack.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Factor:
    """Hypotheses of some tracks, the likeliest first."""

    log_w: FloatArray  # (h,) they add up to one
    row: IntArray  # (h, t) row of each track, -1 = it is not there


def alone(row: int) -> Factor:
    """One track and one hypothesis."""
    return Factor(np.zeros(1), np.array([[row]], np.int64))


def product(factors: Sequence[Factor], most: int) -> Factor:
    """One factor of all, its likeliest `most` hypotheses."""
    log_w, row = factors[0].log_w, factors[0].row
    for other in factors[1:]:
        both = (log_w[:, None] + other.log_w).ravel()
        best = np.argsort(-both, kind="stable")[:most]
        a, b = np.divmod(best, len(other.log_w))
        log_w, row = both[best], np.concatenate([row[a], other.row[b]], axis=1)
    return Factor(log_w, row)


def tidy(log_w: FloatArray, row: IntArray, *, least: float, most: int) -> tuple[list[int], Factor | None]:
    """What is left of hypotheses (h,), (h, t): rows that are certain and alone, and the factor of the others.

    Equal hypotheses are one. Those with less than a share `least` of all are left out, but for the likeliest, and so
    are those beyond `most`. A track that is the same row in all of them is independent of the others.
    """
    if len(log_w) > 1:
        row, log_w = _united(row, log_w)
        order = np.lexsort((*row.T[::-1], -log_w))
        log_w, row = log_w[order], row[order]
        weight = np.exp(log_w - log_w[0])
        keep = (weight >= least * weight.sum()) & (np.arange(len(weight)) < most)
        keep[0] = True
        log_w, row = log_w[keep], row[keep]
    same = (row == row[0]).all(axis=0)
    single = [r for r in row[0, same].tolist() if r >= 0]
    if same.all():
        return single, None
    return single, Factor(_normal(log_w), row[:, ~same])


def _united(row: IntArray, log_w: FloatArray) -> tuple[IntArray, FloatArray]:
    if row.shape[1] == 0:
        return row[:1], np.zeros(1)
    distinct, which = np.unique(row, axis=0, return_inverse=True)
    top = log_w.max()
    return distinct, np.log(np.bincount(which.reshape(-1), np.exp(log_w - top))) + top


def _normal(log_w: FloatArray) -> FloatArray:
    top = log_w.max()
    return np.asarray(log_w - top - np.log(np.exp(log_w - top).sum()))


def without(factors: Sequence[Factor], gone: BoolArray, *, least: float, most: int) -> tuple[Factor, ...]:
    """The factors when rows `gone` (n,) exist under no hypothesis any more."""
    left = []
    for factor in factors:
        row = np.where((factor.row >= 0) & gone[factor.row], -1, factor.row)
        if (row == factor.row).all():
            left.append(factor)
            continue
        single, rest = tidy(factor.log_w, row, least=least, most=most)
        left += [alone(r) for r in single] + ([rest] if rest is not None else [])
    return tuple(left)


def renumbered(factors: Sequence[Factor], place: IntArray) -> tuple[Factor, ...]:
    """The factors of more than one hypothesis with rows numbered anew; the others need none."""
    return tuple(
        Factor(f.log_w, np.where(f.row >= 0, place[f.row], -1)) for f in factors if len(f.log_w) > 1
    )  # fmt: skip


def used(factors: Sequence[Factor], n: int) -> BoolArray:
    """Rows (n,) that some factor has."""
    out = np.zeros(n, bool)
    for factor in factors:
        out[factor.row[factor.row >= 0]] = True
    return out


def probability(factors: Sequence[Factor], n: int) -> tuple[FloatArray, BoolArray]:
    """How likely each row (n,) is, and which rows the likeliest hypothesis has; rows in no factor are certain."""
    p, best = np.ones(n), np.ones(n, bool)
    for factor in factors:
        flat = factor.row.ravel()
        there = flat >= 0
        p[flat[there]] = 0.0
        best[flat[there]] = False
    for factor in factors:
        there = factor.row >= 0
        np.add.at(p, factor.row[there], np.broadcast_to(np.exp(factor.log_w)[:, None], factor.row.shape)[there])
        first = factor.row[0]
        best[first[first >= 0]] = True
    return p, best
