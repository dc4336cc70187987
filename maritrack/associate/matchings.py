"""Sums over all partial matchings of the rows and columns of a group: how likely is each pair?

Rows and columns are alike here (tracks and measurements, in either role). A matching weighs the
product of exp(log_psi) over its pairs; what stays single has weight one. Three ways:
`small_groups` (many groups at once), `frontier` (one group, exact) and `loopy` (any, approximate).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import linear_sum_assignment

from maritrack.types import BoolArray, FloatArray, IntArray

LOOPY_TOLERANCE = 1e-8  # largest change of a log message at which loopy() stops
LOOPY_ITERATIONS = 1000
LOOPY_WORK = 20_000_000  # pairs times iterations
LOOPY_SWEEP = 16  # iterations over those that still change, before all are asked again
LOOPY_SHARE = 0.7  # of the rows that still change, from which on all are asked
FAINT = 1e-280  # sums below this lose digits


def potentials(log_psi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Offsets of rows (l,) and columns (s,), >= 0, that make the heaviest matching weigh exactly one.

    They are dual variables of the optimal assignment: with every row and column, single or
    paired, divided by the exponential of its offset no factor exceeds one, so that sums over
    matchings neither overflow nor lose the matchings that count, whatever the size of log_psi.
    """
    gain = np.maximum(log_psi, 0.0)
    rows, cols = linear_sum_assignment(gain, maximize=True)
    paired = gain[rows, cols] > 0.0
    rows, cols = rows[paired], cols[paired]
    own = np.zeros(len(gain))
    own[rows] = gain[rows, cols]
    v = np.zeros(gain.shape[1])
    for _ in range(len(rows) + 1):  # longest paths from the single nodes: the least feasible v
        left = -own
        left[rows] += v[cols]
        raised = np.maximum((gain + left[:, None]).max(axis=0), 0.0)
        if np.array_equal(raised, v):
            break
        v = raised
    u = own
    u[rows] -= v[cols]
    return np.maximum(u, 0.0), v


@cache
def _sets(n_cols: int) -> tuple[IntArray, IntArray, FloatArray]:
    """For each set of columns (2^s) and column (s,): the set with it, the set without it, and 1 where it lacks it.

    2^s, the place of a constant zero, where the set has the column already (or lacks it already).
    """
    sets, bits = np.arange(1 << n_cols)[:, None], 1 << np.arange(n_cols)
    has = (sets & bits) > 0
    return np.where(has, len(sets), sets | bits), np.where(has, sets & ~bits, len(sets)), (~has).astype(np.float64)


def small_groups(log_psi: FloatArray, row_offset: FloatArray, col_offset: FloatArray) -> FloatArray:
    """Pair probabilities (g, l, s) of g groups of l rows and few columns s, padded with -inf.

    Forward-backward over the rows; the state is the set of columns used so far. Offsets (g, l)
    and (g, s) as of `potentials`, or any others that keep the sums within the range of a double.
    """
    n_groups, n_rows, n_cols = log_psi.shape
    added, removed, lacks = _sets(n_cols)
    n_sets = len(added)
    stay = np.exp(-row_offset).T[:, :, None]
    pair = np.exp(log_psi - row_offset[:, :, None] - col_offset[:, None, :]).swapaxes(0, 1)
    before = np.zeros((n_rows + 1, n_groups, n_sets + 1))
    after = np.zeros((n_rows + 1, n_groups, n_sets + 1))
    before[0, :, 0] = 1.0
    after[n_rows, :, :n_sets] = np.exp(-(col_offset @ lacks.T))
    for k, j in zip(range(n_rows), reversed(range(n_rows)), strict=True):
        paired = (before[k].take(removed, axis=1) @ pair[k, :, :, None])[:, :, 0]
        before[k + 1, :, :n_sets] = stay[k] * before[k, :, :n_sets] + paired
        paired = (after[j + 1].take(added, axis=1) @ pair[j, :, :, None])[:, :, 0]
        after[j, :, :n_sets] = stay[j] * after[j + 1, :, :n_sets] + paired
    around = (before[:-1, :, None, :n_sets] @ after[1:].take(added, axis=2))[:, :, 0]
    return np.asarray(pair * around / after[0, :, :1], dtype=np.float64).swapaxes(0, 1)


def row_order(log_psi: FloatArray) -> tuple[IntArray, int]:
    """Order of rows (l,) that keeps few columns open at a time, and the largest number open.

    A column is open from its first to its last row; `frontier` costs 2^open. Greedy: next is the
    row that opens the fewest more than it closes; ties go by weight, so that the numbering of
    rows and columns has no part in it.
    """
    bits = [int("".join("1" if x else "0" for x in row), 2) for row in (log_psi > -np.inf).tolist()]
    rest = np.argsort(log_psi.max(axis=1)).tolist()
    order: list[int] = []
    is_open = widest = 0
    while rest:
        once = twice = 0
        for k in rest:
            twice |= once & bits[k]
            once |= bits[k]
        last = once & ~twice  # columns that a single remaining row has
        best = min(
            rest, key=lambda k: ((bits[k] & ~is_open).bit_count() - (bits[k] & last).bit_count(), bits[k].bit_count())
        )
        is_open |= bits[best]
        widest = max(widest, is_open.bit_count())
        is_open &= ~(bits[best] & last)
        order.append(best)
        rest.remove(best)
    return np.array(order, dtype=np.int64), widest


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """One row of `frontier`: the table before it, and the columns by the bit they have at that time."""

    row: int
    table: FloatArray  # (2^open,) after the row's new columns were opened as highest bits
    linked: list[tuple[int, int]]  # (column, bit)
    closed: list[tuple[int, int]]  # (column, bit) in the order of closing
    n_opened: int


def frontier(log_psi: FloatArray, order: IntArray) -> FloatArray:
    """Pair probabilities (l, s) of one group, exact; rows are visited in the given order.

    As `small_groups`, but a column leaves the state after its last row, so that the cost is two to
    the power of the columns that are open at once (see `row_order`).
    """
    u, v = potentials(log_psi)
    stay, single = np.exp(-u), np.exp(-v)
    pair = np.exp(log_psi - u[:, None] - v)
    steps, total = _forward(log_psi > -np.inf, order, stay, single, pair)
    probability = np.zeros_like(pair)
    after = np.ones(1)
    for step in reversed(steps):
        for s, bit in reversed(step.closed):
            low = after.reshape(-1, 1, 1 << bit)
            after = np.concatenate([single[s] * low, low], axis=1).ravel()
        earlier = stay[step.row] * after
        for s, bit in step.linked:
            taken = _halves(after, bit)[:, 1]
            around = np.vdot(_halves(step.table, bit)[:, 0], taken)
            probability[step.row, s] = pair[step.row, s] * around / total
            _halves(earlier, bit)[:, 0] += pair[step.row, s] * taken
        after = earlier[: len(earlier) >> step.n_opened]
    return probability


def _forward(
    linked: BoolArray, order: IntArray, stay: FloatArray, single: FloatArray, pair: FloatArray
) -> tuple[list[_Step], float]:
    """First half of `frontier`: the table before each row, and the sum over all matchings."""
    last = len(order) - 1 - np.argmax(linked[order[::-1]], axis=0)  # step after which a column closes
    is_open: list[int] = []  # columns, lowest bit first
    steps: list[_Step] = []
    table = np.ones(1)
    for k, row in enumerate(order.tolist()):
        mine = np.flatnonzero(linked[row]).tolist()
        opened = [s for s in mine if s not in is_open]
        is_open += opened
        table = np.concatenate([table, np.zeros((len(table) << len(opened)) - len(table))])
        bits = [(s, is_open.index(s)) for s in mine]
        later = stay[row] * table
        for s, bit in bits:
            _halves(later, bit)[:, 1] += pair[row, s] * _halves(table, bit)[:, 0]
        closed = []
        for s in [s for s in mine if last[s] == k]:
            bit = is_open.index(s)
            closed.append((s, bit))
            is_open.remove(s)
            later = (single[s] * _halves(later, bit)[:, 0] + _halves(later, bit)[:, 1]).ravel()
        steps.append(_Step(row, table, bits, closed, len(opened)))
        table = later
    return steps, float(table[0])


def _halves(table: FloatArray, bit: int) -> FloatArray:
    """View (high, 2, low) of a table over column sets: middle index = is the column of this bit used."""
    return table.reshape(-1, 2, 1 << bit)


def loopy(row: IntArray, col: IntArray, log_psi: FloatArray) -> FloatArray:
    """Approximate pair probabilities (k,) of a pair list by belief propagation (Williams & Lau 2014).

    In the log domain, and each sum over the others is formed from them and not by taking the own
    term off, which would cancel. Exact without cycles; the iteration always converges. Most messages of a crowd
    settle long before the last, so between sweeps over all pairs only the neighbourhood of those that still change
    is asked. Memory is that of the pairs; a crowd of pairs gets fewer iterations, so that time is bounded as well.
    """
    all_pairs = _Messages.of(row, col, np.ones(len(row), bool))
    mu, nu = np.zeros(len(log_psi)), np.zeros(len(log_psi))
    budget = max(20 * len(row), min(LOOPY_ITERATIONS * len(row), LOOPY_WORK))
    while budget > 0:
        changed = all_pairs.pass_on(log_psi, mu, nu)
        budget -= len(row)
        if np.max(changed, initial=0.0) < LOOPY_TOLERANCE:
            break
        restless = np.zeros(int(row.max()) + 1, bool)
        restless[row[changed >= LOOPY_TOLERANCE]] = True
        some = _Messages.of(row, col, restless[row]) if restless.mean() < LOOPY_SHARE else all_pairs
        for _ in range(LOOPY_SWEEP):
            budget -= len(some.of_cols)
            if np.max(some.pass_on(log_psi, mu, nu)) < LOOPY_TOLERANCE:
                break
    message, by_row = log_psi + nu, all_pairs.by_row
    scale = np.maximum(np.maximum.reduceat(message[by_row.order], by_row.start), 0.0)
    terms = np.exp(message[by_row.order] - scale[by_row.node])
    total, out = np.add.reduceat(terms, by_row.start) + np.exp(-scale), np.empty_like(message)
    out[by_row.order] = terms / total[by_row.node]
    return out


@dataclass(frozen=True, slots=True, eq=False)
class _Segments:
    """Pairs gathered by a node that they share."""

    order: IntArray  # (k,) pairs, node by node
    start: IntArray  # (n,) of each node in the order
    node: IntArray  # (k,) number of the node, in that order

    @classmethod
    def of(cls, node: IntArray) -> _Segments:
        order = np.argsort(node, kind="stable")
        begins = np.append(True, np.diff(node[order]) > 0)
        return cls(order, np.flatnonzero(begins), np.cumsum(begins) - 1)


@dataclass(frozen=True, slots=True, eq=False)
class _Messages:
    """The pairs of some rows, and all pairs of the columns of these."""

    of_rows: IntArray  # (k,)
    by_row: _Segments
    of_cols: IntArray  # (m,)
    by_col: _Segments

    @classmethod
    def of(cls, row: IntArray, col: IntArray, in_rows: BoolArray) -> _Messages:
        of_rows = np.flatnonzero(in_rows)
        asked = np.zeros(int(col.max()) + 1, bool)
        asked[col[of_rows]] = True
        of_cols = np.flatnonzero(asked[col])
        return cls(of_rows, _Segments.of(row[of_rows]), of_cols, _Segments.of(col[of_cols]))

    def pass_on(self, log_psi: FloatArray, mu: FloatArray, nu: FloatArray) -> FloatArray:
        """Messages mu to the columns and nu (k,) back to the rows, renewed in place; by how much the latter changed."""
        i, j = self.of_rows, self.of_cols
        mu[i] = log_psi[i] - _log_one_plus_others(log_psi[i] + nu[i], self.by_row)
        back = -_log_one_plus_others(mu[j], self.by_col)
        changed = np.abs(back - nu[j])
        nu[j] = back
        return np.asarray(changed)


def _log_one_plus_others(x: FloatArray, by: _Segments) -> FloatArray:
    """log(1 + sum of exp over the other pairs of the node), for each pair (k,).

    What is left after taking a pair off the sum is at least as large as the pair, unless that
    is the largest one: nothing cancels if that one gets a sum of its own.
    """
    x = x[by.order]
    most = np.maximum.reduceat(x, by.start)
    scale = np.maximum(most, 0.0)
    terms = np.exp(x - scale[by.node])
    top = np.flatnonzero(x == most[by.node])
    largest = top[np.append(True, np.diff(by.node[top]) > 0)]  # one of each node
    peak, terms[largest] = terms[largest], 0.0
    others = np.add.reduceat(terms, by.start) + np.exp(-scale)
    left = (others + peak)[by.node] - terms
    left[largest] = others
    out = np.empty_like(x)
    with np.errstate(divide="ignore"):
        out[by.order] = np.log(left) + scale[by.node]
    if others.min() < FAINT:  # beside the largest all is lost: what is left has a scale of its own
        x[largest] = -np.inf
        second = np.maximum(np.maximum.reduceat(x, by.start), 0.0)
        rest = np.add.reduceat(np.exp(x - second[by.node]), by.start) + np.exp(-second)
        out[by.order[largest]] = np.log(rest) + second
    return out
