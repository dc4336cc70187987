"""What a scan says about the rows of a mixture, and how it is put to their hypotheses, group by group.

Groups are factors whose rows have a measurement in common in their gates. Rows after the scan are first numbers: a row
that was missed, a hit of a row, a newborn; they are made once it is known which of them count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from maritrack.associate.groups import connected_groups
from maritrack.contoursettings import PmbmConfig
from maritrack.trackers import hypotheses
from maritrack.trackers.bernoullis import Bernoullis
from maritrack.trackers.hypotheses import Factor
from maritrack.types import FloatArray, IntArray

NOT_THERE = -1


@dataclass(frozen=True, slots=True, eq=False)
class Children:
    """Associations of one hypothesis, best first, against all its rows missed and every measurement clutter."""

    log_w: FloatArray  # (m,)
    cell: IntArray  # (m, t) of each row, -1 = missed
    born: Sequence[IntArray]  # m times the cells that are new objects, if they are any


class Evidence(Protocol):
    """A scan, seen from the rows (n,) of a mixture that were moved on to it."""

    missed: Bernoullis  # the rows, given that nothing came of them
    log_miss: FloatArray  # (n,)
    i: IntArray  # (k,) row and ...
    j: IntArray  # (k,) element in its gate
    n_elements: int

    def children(self, rows: IntArray, elements: IntArray, *, most: int, least: float, thorough: bool) -> Children:
        """Associations of rows (t,), -1 = not there, with the elements of their group, the best ones without search.

        `most` of them, and but for the best none of a log weight below `least`.
        """

    def crowd(self, rows: IntArray, elements: IntArray) -> tuple[IntArray, IntArray, FloatArray, FloatArray] | None:
        """Marginals of a group in place of its associations: row, cell and share of pairs, share missed (t,)."""

    def hit(self, row: IntArray, cell: IntArray) -> Bernoullis:
        """The rows (m,) given that cells (m,) came of them."""

    def newborn(self, cell: IntArray) -> Bernoullis:
        """Objects that cells (m,) may be, existence included."""


@dataclass(slots=True)
class Ledger:
    """Rows after the scan that somebody asked for, by number."""

    n: int
    hits: dict[tuple[int, int], int] = field(default_factory=dict)
    births: dict[int, int] = field(default_factory=dict)

    def hit(self, row: int, cell: int) -> int:
        """Code of a hit; that of a row that was missed is its number."""
        return self.n + self.hits.setdefault((row, cell), len(self.hits))

    def birth(self, cell: int) -> int:
        """Code of a newborn: below that of what is not there."""
        return -2 - self.births.setdefault(cell, len(self.births))

    def numbers(self, code: IntArray) -> IntArray:
        """Codes as rows: those missed first, then hits, then newborn ones."""
        return np.where(code < NOT_THERE, self.n + len(self.hits) - 2 - code, code)


@dataclass(slots=True)
class Mixtures:
    """Rows that are to be made of several: one part a line."""

    lead: list[int] = field(default_factory=list)  # code of the row whose past goes on
    into: list[int] = field(default_factory=list)
    code: list[int] = field(default_factory=list)
    share: list[float] = field(default_factory=list)


@dataclass(slots=True)
class Outcome:
    """After the association, in codes."""

    ledger: Ledger
    alone: list[int]
    factors: list[Factor]
    mixtures: Mixtures


def associate(factors: Sequence[Factor], evidence: Evidence, rules: PmbmConfig) -> Outcome:
    """Put a scan to all hypotheses."""
    n, n_elements = len(evidence.log_miss), evidence.n_elements
    out = Outcome(Ledger(n), [], [], Mixtures())
    of_row = _components(factors, n)
    key = np.unique(of_row[evidence.i] * n_elements + evidence.j)
    component, element = np.divmod(key, max(n_elements, 1))
    groups = connected_groups(component, element)
    order = np.argsort(groups.group, kind="stable")
    ends = np.cumsum(np.bincount(groups.group, minlength=len(groups)))
    connected = np.zeros(n + len(factors), bool)
    connected[component] = True
    most = min(rules.most_hypotheses, max(rules.most_in_scan // max(len(groups), 1), 1))
    for begin, end in zip(ends - np.diff(ends, prepend=0), ends, strict=True):
        mine = order[begin:end]
        members = [
            factors[c - n] if c >= n else hypotheses.alone(c) for c in np.unique(component[mine]).tolist()
        ]  # fmt: skip
        _group(members, np.unique(element[mine]), evidence, rules, most, out)
    for number, factor in enumerate(factors):
        if not connected[n + number]:
            _carry_on(factor, evidence, rules, out)
    out.alone += np.flatnonzero((of_row == np.arange(n)) & ~connected[:n]).tolist()
    return out


def _components(factors: Sequence[Factor], n: int) -> IntArray:
    """Number (n,) of what each row belongs to: itself, or n and that of its factor."""
    of_row = np.arange(n)
    for number, factor in enumerate(factors):
        of_row[factor.row[factor.row >= 0]] = n + number
    return of_row


def _carry_on(factor: Factor, evidence: Evidence, rules: PmbmConfig, out: Outcome) -> None:
    """A factor of which nothing was seen."""
    there = factor.row >= 0
    log_w = factor.log_w + np.where(there, evidence.log_miss[factor.row], 0.0).sum(axis=1)
    _keep(log_w, factor.row, rules, out)


def _keep(log_w: FloatArray, code: IntArray, rules: PmbmConfig, out: Outcome) -> None:
    single, rest = _tidy(log_w, code, rules)
    out.alone += single
    if rest is not None:
        out.factors.append(rest)


def _tidy(log_w: FloatArray, code: IntArray, rules: PmbmConfig) -> tuple[list[int], Factor | None]:
    """`hypotheses.tidy`, for which rows must not be negative: codes of newborn ones are shifted."""
    shift = int(-min(code.min(initial=0), 0)) + 1
    big = np.where(code < NOT_THERE, code + shift + (1 << 40), code)
    single, rest = hypotheses.tidy(log_w, big, least=rules.prune_hypothesis, most=rules.most_hypotheses)
    back = (1 << 40) + shift
    single = [s - back if s >= (1 << 39) else s for s in single]
    if rest is None:
        return single, None
    return single, Factor(rest.log_w, np.where(rest.row >= (1 << 39), rest.row - back, rest.row))


def _group(
    members: Sequence[Factor], elements: IntArray, evidence: Evidence, rules: PmbmConfig, most: int, out: Outcome
) -> None:
    factor = hypotheses.product(members, most)
    merged = rules.hypotheses == "merged"
    if merged or factor.row.shape[1] + len(elements) > rules.group_limit:
        rows = factor.row[0][factor.row[0] >= 0]
        crowd = evidence.crowd(rows, elements)
        if crowd is not None:
            _mix(rows, elements, crowd, out)
            return
    known: dict[bytes, Children] = {}
    log_w, code, births = [], [], []
    best, span = -np.inf, -np.log(rules.prune_hypothesis) if rules.prune_hypothesis > 0 else np.inf
    for weight, row in zip(factor.log_w.tolist(), factor.row, strict=True):
        there = row >= 0
        base = weight + float(evidence.log_miss[row[there]].sum())
        children = known.get(row.tobytes())
        if children is None:
            children = known[row.tobytes()] = evidence.children(
                row, elements, most=min(rules.most_children, most), least=best - span - base,
                thorough=len(known) < rules.most_searched,
            )  # fmt: skip
        best = max(best, base + float(children.log_w[0]))
        for k, total in enumerate(children.log_w.tolist()):
            log_w.append(base + total)
            code.append(
                [
                    NOT_THERE if r < 0 else r if c < 0 else out.ledger.hit(r, c)
                    for r, c in zip(row.tolist(), children.cell[k].tolist(), strict=True)
                ]
            )
            births.append(children.born[k].tolist())
    new = sorted({cell for some in births for cell in some})
    column = {cell: number for number, cell in enumerate(new)}
    table = np.full((len(log_w), factor.row.shape[1] + len(new)), NOT_THERE)
    table[:, : factor.row.shape[1]] = code
    for k, some in enumerate(births):
        for cell in some:
            table[k, factor.row.shape[1] + column[cell]] = out.ledger.birth(cell)
    if merged:
        _mix_hypotheses(np.array(log_w), table, factor.row.shape[1], out)
    else:
        _keep(np.array(log_w), table, replace(rules, most_hypotheses=most), out)


def _mix(
    rows: IntArray, elements: IntArray, crowd: tuple[IntArray, IntArray, FloatArray, FloatArray], out: Outcome
) -> None:
    """One hypothesis of a group: each row the mixture of its hits and of its miss, each element what is left of it."""
    place, cell, share, missed = crowd
    mixtures, ledger = out.mixtures, out.ledger
    order = np.lexsort((cell, place))
    ends = np.searchsorted(place[order], np.arange(len(rows) + 1))
    left = dict.fromkeys(elements.tolist(), 1.0)
    for t, row in enumerate(rows.tolist()):
        mine = order[ends[t] : ends[t + 1]]
        mine = mine[share[mine] > 1e-6]
        parts = [(ledger.hit(row, c), b) for c, b in zip(cell[mine].tolist(), share[mine].tolist(), strict=True)]
        for c, b in zip(cell[mine].tolist(), share[mine].tolist(), strict=True):
            left[c] -= b
        _one(parts, row, float(missed[t]), mixtures)
    for c, b in left.items():
        code = ledger.birth(c)
        if b > 1.0 - 1e-9:
            out.alone.append(code)
        elif b > 1e-6:
            _add(mixtures, code, [(code, b)])


def _one(parts: list[tuple[int, float]], row: int, missed: float, mixtures: Mixtures) -> None:
    """A row and its hits: its past is that of the miss, or of the likeliest hit where a hit is likelier."""
    best = max(parts, key=lambda part: part[1], default=(row, 0.0))
    _add(mixtures, row if missed >= 0.5 else best[0], [*parts, (row, missed)])


def _add(mixtures: Mixtures, lead: int, parts: Sequence[tuple[int, float]]) -> None:
    number = len(mixtures.lead)
    mixtures.lead.append(lead)
    for code, share in parts:
        mixtures.into.append(number)
        mixtures.code.append(code)
        mixtures.share.append(share)


def _mix_hypotheses(log_w: FloatArray, code: IntArray, n_tracks: int, out: Outcome) -> None:
    """One hypothesis of many: each column the mixture of its rows."""
    w = np.exp(log_w - log_w.max())
    w /= w.sum()
    for t in range(code.shape[1]):
        distinct, which = np.unique(code[:, t], return_inverse=True)
        share = np.bincount(which.reshape(-1), w)
        parts = [(c, s) for c, s in zip(distinct.tolist(), share.tolist(), strict=True) if c != NOT_THERE and s > 1e-6]
        if len(parts) == 1 and parts[0][1] > 1.0 - 1e-9:
            out.alone.append(parts[0][0])
        elif parts:
            own = [part for part in parts if t >= n_tracks or part[0] >= out.ledger.n]
            missed = sum(s for c, s in parts if t < n_tracks and 0 <= c < out.ledger.n)
            lead = max(own, key=lambda part: part[1])[0] if own and missed < 0.5 else parts[0][0]
            _add(out.mixtures, lead, parts)
