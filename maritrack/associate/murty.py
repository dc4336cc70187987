"""The k best ways to pair rows with columns (Murty 1968), a row with one column or with none.

Each solution splits what is left: one part for each row that is free in it, in which the row must not do what it
did, and the rows before it must. The best of a part is an assignment problem.
"""

from __future__ import annotations

import heapq
import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from maritrack.types import FloatArray, IntArray

NONE = -1


class Best(NamedTuple):
    """Solutions in order of their gain, best first; no two are alike."""

    column: IntArray  # (k, l) of each row, -1 = none
    gain: FloatArray  # (k,) sum over the rows


def k_best(
    log_pair: FloatArray, log_none: FloatArray, k: int, *, span: float = math.inf, least: float = -math.inf
) -> Best:
    """Of all pairings of rows (l,) and columns (s,) the k of largest gain, or all of them where there are fewer.

    What is worse than the best by more than `span` is left out, and what is below `least` but for the best.

    The gain of a row is log_pair (l, s), -inf = never, or log_none (l,), which is finite. Ties are in an order that the
    numbers of rows and columns decide.
    """
    n_rows, n_cols = log_pair.shape
    if n_rows == 0 or k < 1:
        return Best(np.zeros((min(max(k, 0), 1), 0), np.int64), np.zeros(min(max(k, 0), 1)))
    if n_rows == 1:
        return _of_one_row(np.append(log_pair[0], log_none), k, span, least)
    table = np.full((n_rows, n_cols + n_rows), -np.inf)
    table[:, :n_cols] = log_pair
    table[np.arange(n_rows), n_cols + np.arange(n_rows)] = log_none
    never = np.isneginf(table)
    low, high = float(table[~never].min()), float(table[~never].max())
    worst = low - (high - low + 1.0) * (n_rows + 1)  # one of these outweighs all that is possible
    table[never] = worst
    first = _best(table, low)
    waiting: list[tuple[float, int, IntArray, int, tuple[int, ...]]] = []  # no tables: each is made anew from these
    if first is not None:
        waiting.append((-first[0], 0, first[1], 0, ()))
    found: list[IntArray] = []
    gains: list[float] = []
    made = 1
    while waiting and len(found) < k:
        negative, _, column, fixed, banned = heapq.heappop(waiting)
        if gains and -negative < max(gains[0] - span, least):
            break
        found.append(column)
        gains.append(-negative)
        if len(found) == k:
            break
        part = table.copy()
        for row in range(n_rows):
            own = int(column[row])
            if row >= fixed:
                not_again = (*banned, own) if row == fixed else (own,)
                without = part.copy()
                without[row, list(not_again)] = worst
                best = _best(without, low)
                if best is not None:
                    heapq.heappush(waiting, (-best[0], made, best[1], row, not_again))
                    made += 1
            kept = part[row, own]
            part[row], part[:, own] = worst, worst
            part[row, own] = kept
    chosen = np.array(found, np.int64).reshape(-1, n_rows)
    return Best(np.where(chosen < n_cols, chosen, NONE), np.array(gains))


def _of_one_row(gain: FloatArray, k: int, span: float, least: float) -> Best:
    order = np.argsort(-gain, kind="stable")[:k]
    good = np.isfinite(gain[order]) & (gain[order] >= max(gain[order[0]] - span, least))
    good[0] = True
    order = order[good]
    return Best(np.where(order < len(gain) - 1, order, NONE)[:, None], gain[order])


def _best(table: FloatArray, low: float) -> tuple[float, IntArray] | None:
    """Gain and columns of the best assignment, None where a row has nothing left: less than `low`."""
    rows, column = linear_sum_assignment(table, maximize=True)
    gain = table[rows, column]
    return (float(gain.sum()), column.astype(np.int64)) if gain.min() >= low else None


def murty_marginals(log_psi: FloatArray, k: int) -> FloatArray:
    """Pair probabilities (l, s) from the k likeliest joint events; log_psi is relative to a row without a column."""
    best = k_best(log_psi, np.zeros(len(log_psi)), k)
    weight = np.exp(best.gain - best.gain[0])
    probability = np.zeros(log_psi.shape)
    event, row = np.nonzero(best.column >= 0)
    np.add.at(probability, (row, best.column[event, row]), weight[event])
    return np.asarray(probability / weight.sum(), dtype=np.float64)
