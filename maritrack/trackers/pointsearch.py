"""Associations of the points of a group with rows and new objects: by stochastic optimisation, or by partitions."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from maritrack.associate import sampling
from maritrack.associate.murty import k_best
from maritrack.associate.sampling import Slots
from maritrack.cluster.dbscan import dbscan
from maritrack.trackers import bernoullis
from maritrack.trackers.association import Children
from maritrack.types import FloatArray, IntArray

if TYPE_CHECKING:
    from maritrack.trackers.pointevidence import PointEvidence

HALVES_FROM = 6  # points of a cell whose halves may be two objects
LEAST_LOG_U = -30.0  # a cell that is new with less is no slot


def whole_cells(ev: PointEvidence, rows: IntArray, elements: IntArray, *, most: int) -> Children:
    """Cells of the clustering, each to a row or to nobody: what is in the row's gate of it.

    Or where several rows have a cell in their gates, the points of it that are nearest to each of them.
    """
    shared = _nearest_parts(ev, rows, elements)
    return _assigned(ev, rows, [elements, shared] if len(shared) else [elements], most)


def _nearest_parts(ev: PointEvidence, rows: IntArray, elements: IntArray) -> IntArray:
    """The cells, those in the gates of several rows cut up among these; none where no cell is."""
    owners = {c: [row for row in rows.tolist() if (row, c) in ev.inside] for c in elements.tolist()}
    if all(len(some) < 2 for some in owners.values()):
        return elements[:0]
    found: list[int] = []
    for c, some in owners.items():
        points = ev.cells.points[c]
        if len(some) < 2 or len(points) < 2:
            found.append(c)
            continue
        i, j = np.repeat(some, len(points)), np.tile(points, len(some))
        away2 = ev.model.distance2(ev.before, i, ev.cells.z[j], ev.cells.R[j]).reshape(len(some), len(points))
        nearest = away2.argmin(axis=0)
        found += [ev.cells.number(points[nearest == k]) for k in np.unique(nearest).tolist()]
    return np.array(sorted(found), np.int64)


def partitions(ev: PointEvidence, rows: IntArray, elements: IntArray, *, most: int) -> Children:
    """The best assignments of the cells of several partitions: the clustering, others by distance, and halves."""
    points = np.concatenate([ev.cells.points[c] for c in elements.tolist()])
    z = ev.cells.z[points]
    found = {tuple(elements.tolist())}
    for eps in ev.config.pmbm.partition_eps_m:
        found.add(_numbers(ev, points, dbscan(z, eps_m=eps, min_points=1)))
    for c in elements.tolist():
        halves = halves_of(ev, c)
        if halves:
            found.add(tuple(sorted([*(e for e in elements.tolist() if e != c), *halves])))
    every = [np.array(one, np.int64) for one in sorted(found)]
    shared = _nearest_parts(ev, rows, elements)
    every += [shared] if len(shared) else []
    return _assigned(ev, rows, every, most)


def halves_of(ev: PointEvidence, cell: int) -> list[int]:
    """The two halves of a cell, if it is not small nor all in one place."""
    mine = ev.cells.points[cell]
    if len(mine) < HALVES_FROM:
        return []
    side = sampling.halves(ev.cells.z[mine])
    if not side.any():
        return []
    return [ev.cells.number(mine[side]), ev.cells.number(mine[~side])]


def _numbers(ev: PointEvidence, points: IntArray, label: IntArray) -> tuple[int, ...]:
    order = np.argsort(label, kind="stable")
    parts = np.split(points[order], np.flatnonzero(np.diff(label[order])) + 1)
    return tuple(sorted(ev.cells.number(np.sort(part)) for part in parts))


def _in_gates(ev: PointEvidence, rows: IntArray, cells: IntArray) -> dict[tuple[int, int], int]:
    """Of rows and cells of a partition the cell of those points that are in the row's gate, where there are any."""
    cell_of = np.full(len(ev.cells.z), -1)
    for c in cells.tolist():
        cell_of[ev.cells.points[c]] = c
    out: dict[tuple[int, int], int] = {}
    for row in rows.tolist():
        begin, end = np.searchsorted(ev.i, [row, row + 1]).tolist()
        if begin == end:
            continue
        near = np.sort(np.concatenate([ev.inside[row, c] for c in ev.j[begin:end].tolist()]))
        order = np.argsort(cell_of[near], kind="stable")
        near, label = near[order], cell_of[near[order]]
        first = np.flatnonzero(np.diff(label, prepend=-2))
        for c, inner in zip(label[first].tolist(), np.split(near, first[1:]), strict=True):
            if c >= 0:
                out[row, c] = ev.cells.number(inner)
    return out


def _assigned(ev: PointEvidence, rows: IntArray, every: list[IntArray], most: int) -> Children:
    ev.try_new([c for cells in every for c in cells.tolist() if c >= ev.n_elements])
    known: dict[tuple[int, ...], float] = {}
    tables = [_in_gates(ev, rows, cells) for cells in every]
    pairs = list(dict.fromkeys((row, inner) for table in tables for (row, _), inner in table.items()))
    weight = dict(zip(pairs, ev.log_hit(pairs).tolist(), strict=True))
    place = {row: t for t, row in enumerate(rows.tolist())}
    for cells, table in zip(every, tables, strict=True):
        new = np.array([np.logaddexp(0.0, ev.log_u.get(c, -math.inf)) for c in cells.tolist()])
        gain = np.full((len(rows), len(cells)), -np.inf)
        column_of = {c: m for m, c in enumerate(cells.tolist())}
        for (row, c), inner in table.items():
            m = column_of[c]
            gain[place[row], m] = weight[row, inner] - ev.log_miss[row] - new[m]
        best = k_best(gain, np.zeros(len(rows)), most, span=_span(ev))
        for column, total in zip(best.column, best.gain.tolist(), strict=True):
            taken = [-1 if m < 0 else table[row, int(cells[m])] for row, m in zip(rows.tolist(), column, strict=True)]
            used = set(column.tolist())
            born = [c for m, c in enumerate(cells.tolist()) if m not in used and ev.may_be_new(c)]
            known.setdefault((*taken, -2, *born), total + float(new.sum()))
    return _children(known, len(rows), ev, most)


def _span(ev: PointEvidence) -> float:
    least = ev.config.pmbm.prune_hypothesis
    return -math.log(least) if least > 0 else math.inf


def _children(known: dict[tuple[int, ...], float], t: int, ev: PointEvidence, most: int) -> Children:
    order = sorted(known.items(), key=lambda one: -one[1])[:most]
    top = order[0][1]
    order = [one for one in order if one[1] >= top - _span(ev)]
    cell = np.array([key[:t] for key, _ in order], np.int64).reshape(len(order), t)
    born = [np.array(key[t + 1 :], np.int64) for key, _ in order]
    return Children(np.array([value for _, value in order]), cell, born)


def stochastic(ev: PointEvidence, rows: IntArray, elements: IntArray, *, most: int) -> Children:
    """Associations that stochastic optimisation visits, weighed by the fits of their cells.

    It begins with the best assignment of whole cells, and looks at objects to first order about the fits of those.
    """
    rules = ev.config.pmbm
    start = whole_cells(ev, rows, elements, most=1)
    points = np.concatenate([ev.cells.points[c] for c in elements.tolist()])
    cell_of = np.repeat(elements, [len(ev.cells.points[c]) for c in elements.tolist()])
    order = np.argsort(points, kind="stable")
    points, cell_of = points[order], cell_of[order]
    new = _candidates(ev, elements)
    if len(rows) + len(new) == 0:
        return start
    slots = _slots(ev, rows, start.cell[0], new, elements, points)
    state = np.full(len(points), sampling.CLUTTER)
    for t, c in enumerate(start.cell[0].tolist()):
        if c >= 0:
            state[np.searchsorted(points, ev.cells.points[c])] = t
    for number, c in enumerate(new):
        mine = np.searchsorted(points, ev.cells.points[c])
        if c in elements and ev.log_u[c] > 0 and (state[mine] < 0).all():
            state[mine] = len(rows) + number
    rng = np.random.default_rng(np.random.SeedSequence(ev.config.seed, spawn_key=(*ev.rng_key, int(elements[0]))))
    visited = sampling.sample(
        slots, state, cell_of, ev.cells.z[points], iterations=rules.iterations * len(points),
        most_moves=rules.sample_moves, most=2 * most, rng=rng,
    )  # fmt: skip
    keep = visited.log_w >= visited.log_w[0] - _span(ev) - 3.0  # the fits decide
    return _weighed(ev, rows, new, points, visited.slot[keep], most)


def _candidates(ev: PointEvidence, elements: IntArray) -> list[int]:
    """Cells that may be new objects, and halves of them."""
    some = elements.tolist()
    halves = [half for c in some for half in halves_of(ev, c)]
    ev.try_new(halves)
    return [c for c in [*some, *halves] if ev.log_u.get(c, -math.inf) > LEAST_LOG_U]


def _slots(
    ev: PointEvidence, rows: IntArray, taken: IntArray, new: list[int], elements: IntArray, points: IntArray
) -> Slots:
    """Rows about what they are by their cell, or as predicted; new objects about what their cell makes them."""
    z, R = ev.cells.z[points], ev.cells.R[points]
    about = [(row, c) for row, c in zip(rows.tolist(), taken.tolist(), strict=True) if c >= 0]
    own = bernoullis.rows(ev.before, rows)
    fitted = own
    if about:
        hit = np.flatnonzero(taken >= 0)
        made = bernoullis.join([own, ev.fits.fitted(about)])
        place = np.arange(len(rows))
        place[hit] = len(rows) + np.arange(len(hit))
        fitted = bernoullis.rows(made, place)
    source = [ev.source[c] for c in new]
    theirs = bernoullis.rows(ev.born.rows, np.array(source, np.int64))
    made_new = ev.born.made(ev.cells, new, source)
    prior, fit = bernoullis.join([own, theirs]), bernoullis.join([fitted, made_new])
    A, y, log_noise, info = ev.model.linear(prior, fit, z, R)
    allowed = np.ones((len(prior), len(points)), bool)
    for t, row in enumerate(rows.tolist()):
        near = [ev.inside[row, e] for e in elements.tolist() if (row, e) in ev.inside]
        allowed[t] = np.isin(points, np.concatenate(near)) if near else False
    log_point = np.where(allowed, log_noise - ev.log_kappa, -np.inf)
    slots = Slots(A, y, log_point, info, np.zeros(len(prior)), prior.rate)
    return Slots(A, y, log_point, info, _base(ev, rows, taken, new, points, slots), prior.rate)


def _base(
    ev: PointEvidence, rows: IntArray, taken: IntArray, new: list[int], points: IntArray, slots: Slots
) -> FloatArray:
    """What brings the weight of each slot with its own cell to that of the fit; of a row without, r P_D."""
    n = len(points)
    mask = np.zeros((len(slots.log_base), n), bool)
    for k, c in enumerate([*taken.tolist(), *new]):
        if c >= 0:
            mask[k, np.searchsorted(points, ev.cells.points[c])] = True
    linear = sampling.totals(slots, np.arange(len(mask)), mask)
    r, p = ev.before.tracks.existence[rows], ev.p_detect[rows]
    with np.errstate(divide="ignore"):
        base = np.log(r * p) - ev.log_miss[rows]
    hit = np.flatnonzero(taken >= 0)
    pairs = [(int(rows[t]), int(taken[t])) for t in hit]
    base[hit] = ev.log_hit(pairs) - ev.log_miss[rows[hit]] - linear[hit]
    theirs = np.array([ev.log_u[c] for c in new]) - linear[len(rows) :]
    return np.concatenate([base, theirs])


def _weighed(
    ev: PointEvidence, rows: IntArray, new: list[int], points: IntArray, slot: IntArray, most: int
) -> Children:
    """Associations by the fits of their cells."""
    t = len(rows)
    made: list[tuple[list[int], list[int]]] = []
    for state in slot:
        cells = [int(ev.cells.number(points[state == k])) if (state == k).any() else -1 for k in range(t + len(new))]
        made.append((cells[:t], [c for c in cells[t:] if c >= 0]))
    pairs = list(
        dict.fromkeys((row, c) for own, _ in made for row, c in zip(rows.tolist(), own, strict=True) if c >= 0)
    )
    weight = dict(zip(pairs, ev.log_hit(pairs).tolist(), strict=True))
    ev.try_new([c for _, fresh in made for c in fresh])
    known: dict[tuple[int, ...], float] = {}
    for own, fresh in made:
        total = sum(weight[row, c] - ev.log_miss[row] for row, c in zip(rows.tolist(), own, strict=True) if c >= 0)
        total += sum(float(np.logaddexp(0.0, ev.log_u[c])) for c in fresh)
        born = sorted(c for c in fresh if ev.may_be_new(c))
        known.setdefault((*own, -2, *born), float(total))
    return _children(known, t, ev, most)
