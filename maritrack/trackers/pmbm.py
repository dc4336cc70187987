"""Poisson multi-Bernoulli mixture filters: objects seen and not yet seen, and hypotheses of what came of whom.

Williams 2015 for objects that give one measurement, Granstroem, Fatemi, Svensson 2020 for those that give many.
Tracks have labels: the first measurement of a Bernoulli component. With `pmbm.hypotheses` = "merged" one hypothesis
is left after each scan, with the moments of all: the track-oriented filter, which with a constant intensity of the
undetected is JIPDA.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from maritrack.errors import ConfigError
from maritrack.objects import contour, reduction
from maritrack.settings import Config
from maritrack.trackers import (
    association,
    bernoullis,
    clusterevidence,
    hypotheses,
    pointevidence,
    steps,
    tracklist,
    undetected,
)
from maritrack.trackers.association import Outcome
from maritrack.trackers.bernoullis import Bernoullis
from maritrack.trackers.hypotheses import Factor
from maritrack.trackers.pointmodels import HullModel, MatrixModel
from maritrack.trackers.steps import Info
from maritrack.trackers.tracklist import TrackList
from maritrack.types import TENTATIVE, BoolArray, Clusters, FloatArray, IntArray, Points, Scan, Tracks


@dataclass(frozen=True, slots=True, eq=False)
class PmbmState:
    """All that survives from one scan to the next."""

    rows: Bernoullis
    factors: tuple[Factor, ...]
    poisson: Bernoullis
    k: int = 0  # scans so far


Look = Callable[..., Any]


@dataclass(frozen=True, slots=True)
class Pmbm:
    """Settings, and what a scan is to the objects."""

    config: Config
    look: Look = clusterevidence.look
    hull: bool = False  # tracks draw it

    @property
    def states(self) -> int:
        """Of a hull."""
        return contour.FIXED + self.config.contour.angles if self.hull else 0

    def init(self) -> PmbmState:
        """Nobody seen, nobody expected."""
        return PmbmState(bernoullis.nothing(self.states), (), bernoullis.nothing(self.states))

    def update(self, state: PmbmState, scan: Scan, points: Points, clusters: Clusters) -> tuple[PmbmState, Info]:
        """Predict, put the scan to all hypotheses, prune, judge motion, end tracks."""
        config, rules = self.config, self.config.pmbm
        state = still_known(state, scan, config)
        evidence = self.look(state.rows, state.poisson, scan, points, clusters, config, state.k)
        outcome = association.associate(state.factors, evidence, rules)
        outcome.alone += [outcome.ledger.birth(cell) for cell in evidence.free().tolist()]
        rows, factors, explained, parent = made(outcome, evidence, state.rows.tracks.next_id)
        old_ns = np.append(state.rows.tracks.t_ns, 0)[parent]  # a newborn row has no past
        dt_s = np.where(parent >= 0, tracklist.seconds(rows.tracks.t_ns - old_ns), 0.0)
        rows = replace(rows, tracks=tracklist.follow(rows.tracks, np.maximum(dt_s, 0.0), config.tracker))
        rows, factors, parent = merged(rows, factors, parent, config)
        shown, row = representatives(rows, factors)
        shown = evidence.learn(shown, 1.0 - explained)
        rows = replace(rows, tracks=replace(
            rows.tracks, clutter=shown.clutter, clutter_map=shown.clutter_map,
        ))  # fmt: skip
        old = parent[row] >= 0
        kept = tracklist.manage(tracklist.select(shown, old), config)
        rows, factors, poisson = pruned(rows, factors, shown.id[old], kept, evidence.poisson, config)
        info = Info(evidence.n_inexact, evidence.clock_back, evidence.n_cut, evidence.n_left_out)
        return PmbmState(rows, factors, poisson, state.k + 1), info

    def estimate(self, state: PmbmState) -> Tracks:
        """One track for each label: its row in the likeliest hypothesis, with the existence it has under all.

        Only what `pmbm.extract_existence` says exists in that hypothesis is more than tentative.
        """
        shown, row = representatives(state.rows, state.factors)
        _, best = hypotheses.probability(state.factors, len(state.rows))
        tracks = tracklist.estimate(shown, self.config.tracker)
        there = best[row] & (state.rows.tracks.existence[row] > self.config.pmbm.extract_existence)
        tracks = replace(tracks, status=np.where(there, tracks.status, TENTATIVE))
        if not self.hull:
            return tracks
        return replace(tracks, contour_m=tuple(contour.polygon(state.rows.x[row], self.config.contour)))


def still_known(state: PmbmState, scan: Scan, config: Config) -> PmbmState:
    """The mixture without rows whose place is not known well enough to look for them."""
    at = steps.middle_ns(scan)
    tracks, known = steps.waiting(state.rows.tracks, scan, config)
    state, poisson = replace(state, rows=replace(state.rows, tracks=tracks)), state.poisson
    if len(poisson):
        poisson = bernoullis.rows(poisson, tracklist.known(poisson.tracks, at, config))
    if known.all():
        return replace(state, poisson=poisson)
    rows, factors = _select(state.rows, state.factors, ~known, config)
    return replace(state, rows=rows, factors=factors, poisson=poisson)


def made(outcome: Outcome, evidence: Any, next_id: int) -> tuple[Bernoullis, tuple[Factor, ...], FloatArray, IntArray]:
    """The rows of an outcome, ordered by label, its factors, the explained share of each element (c,), and parents.

    The parent of a row is the one before the scan, -1 where it is newborn.
    """
    ledger, mixtures = outcome.ledger, outcome.mixtures
    hit_row, hit_cell = np.array(list(ledger.hits), np.int64).reshape(-1, 2).T
    cells = np.array(list(ledger.births), np.int64)
    born = evidence.newborn(cells)
    label = np.empty(len(cells), np.int64)
    label[np.argsort(cells, kind="stable")] = next_id + np.arange(len(cells))
    born = replace(born, tracks=replace(born.tracks, id=label))
    basic = bernoullis.join([evidence.missed, evidence.hit(hit_row, hit_cell), born])
    parent = np.concatenate([np.arange(ledger.n), hit_row, np.full(len(cells), -1)])
    lead = ledger.numbers(np.array(mixtures.lead, np.int64))
    part = ledger.numbers(np.array(mixtures.code, np.int64))
    into, share = np.array(mixtures.into, np.int64), np.array(mixtures.share, np.float64)
    rows = bernoullis.join([basic, bernoullis.blend(basic, into, part, share, lead)]) if len(lead) else basic
    parent = np.concatenate([parent, parent[lead]])
    single = np.concatenate([ledger.numbers(np.array(outcome.alone, np.int64)), len(basic) + np.arange(len(lead))])
    factors = tuple(Factor(f.log_w, ledger.numbers(f.row)) for f in outcome.factors)
    p = np.zeros(len(basic))
    p[single[single < len(basic)]] = 1.0
    for factor in factors:
        there = factor.row >= 0
        np.add.at(p, factor.row[there], np.broadcast_to(np.exp(factor.log_w)[:, None], factor.row.shape)[there])
    np.add.at(p, part, share)
    explained = evidence.explained(hit_cell, p[ledger.n : ledger.n + len(hit_cell)])
    keep = hypotheses.used(factors, len(rows))
    keep[single] = True
    rows = replace(rows, tracks=replace(rows.tracks, next_id=next_id + len(cells)))
    rows, factors, parent = _ordered(rows, factors, np.flatnonzero(keep), parent)
    return rows, factors, explained, parent


def merged(
    rows: Bernoullis, factors: tuple[Factor, ...], parent: IntArray, config: Config
) -> tuple[Bernoullis, tuple[Factor, ...], IntArray]:
    """The mixture where rows of a track that are alike are the likeliest of them, and equal hypotheses one.

    Alike are states within `pmbm.merge_distance2` by the covariance of the likelier one, and existences within 0.05.
    """
    rules = config.pmbm
    if rules.merge_distance2 == 0.0 or not factors:
        return rows, factors, parent
    p, _ = hypotheses.probability(factors, len(rows))
    d = rows.tracks.density
    x, P = (d.x, d.P) if rows.x.shape[1] == 0 else (rows.x, rows.P)
    place = np.arange(len(rows))
    for factor in factors:
        for column in factor.row.T:
            mine = np.unique(column[column >= 0])
            mine = mine[np.argsort(-p[mine], kind="stable")]
            a, b = np.triu_indices(len(mine), 1)
            i, j = mine[a], mine[b]
            gap = x[j] - x[i]
            away2 = (gap * np.linalg.solve(P[i], gap[..., None])[..., 0]).sum(axis=1)
            near = (away2 < rules.merge_distance2) & (
                np.abs(rows.tracks.existence[i] - rows.tracks.existence[j]) < 0.05
            )
            place[mine] = mine[reduction.leaders(a[near], b[near], len(mine))]
    left: list[Factor] = []
    for factor in factors:
        row = np.where(factor.row >= 0, place[factor.row], -1)
        single, rest = hypotheses.tidy(factor.log_w, row, least=rules.prune_hypothesis, most=rules.most_hypotheses)
        left += [hypotheses.alone(r) for r in single] + ([rest] if rest is not None else [])
    were = hypotheses.used(factors, len(rows))
    keep = ~were | hypotheses.used(left, len(rows))
    return _ordered(rows, tuple(left), np.flatnonzero(keep), parent)


def _ordered(
    rows: Bernoullis, factors: tuple[Factor, ...], index: IntArray, parent: IntArray
) -> tuple[Bernoullis, tuple[Factor, ...], IntArray]:
    """Only the rows `index`, by label."""
    index = index[np.argsort(rows.tracks.id[index], kind="stable")]
    place = np.full(len(rows), -1)
    place[index] = np.arange(len(index))
    return bernoullis.rows(rows, index), hypotheses.renumbered(factors, place), parent[index]


def _select(
    rows: Bernoullis, factors: tuple[Factor, ...], gone: BoolArray, config: Config
) -> tuple[Bernoullis, tuple[Factor, ...]]:
    """The mixture without the rows `gone` (n,)."""
    rules = config.pmbm
    before = hypotheses.used(factors, len(rows))
    factors = hypotheses.without(factors, gone, least=rules.prune_hypothesis, most=rules.most_hypotheses)
    keep = ~gone & (~before | hypotheses.used(factors, len(rows)))
    rows, factors, _ = _ordered(rows, factors, np.flatnonzero(keep), np.zeros(len(rows), np.int64))
    return rows, factors


def representatives(rows: Bernoullis, factors: tuple[Factor, ...]) -> tuple[TrackList, IntArray]:
    """One row for each label, and which it is: that of the likeliest hypothesis, else its likeliest one.

    Existence is that under all hypotheses.
    """
    p, best = hypotheses.probability(factors, len(rows))
    tracks = rows.tracks
    order = np.lexsort((np.arange(len(rows)), -p, ~best, tracks.id))
    label, first = np.unique(tracks.id[order], return_index=True)
    row = order[first]
    at = np.searchsorted(label, tracks.id)
    existence = np.minimum(np.bincount(at, p * tracks.existence, len(label)), 1.0)
    return replace(tracklist.select(tracks, row), existence=existence), row


def pruned(
    rows: Bernoullis, factors: tuple[Factor, ...], judged: IntArray, kept: TrackList, poisson: Bernoullis,
    config: Config,
) -> tuple[Bernoullis, tuple[Factor, ...], Bernoullis]:  # fmt: skip
    """The mixture without labels that ended (`judged` but not `kept`) and rows that hardly exist; what is undetected.

    Rows of labels that are kept are confirmed with them.
    """
    rules, tracks = config.pmbm, rows.tracks
    ended = np.isin(tracks.id, np.setdiff1d(judged, kept.id))
    confirmed = np.isin(tracks.id, kept.id[kept.confirmed])
    rows = replace(rows, tracks=replace(tracks, confirmed=confirmed))
    faint = tracks.existence < rules.prune_existence
    p, _ = hypotheses.probability(factors, len(rows))
    poisson = undetected.pruned(poisson, rules)
    back = np.flatnonzero(faint & ~ended)
    poisson = undetected.recycled(poisson, rows, back, p[back], rules)
    gone = ended | faint
    if gone.any():
        rows, factors = _select(rows, factors, gone, config)
    return rows, factors, poisson


def giw_pmbm(config: Config) -> Pmbm:
    """Objects on random matrices: of clusters, or of points."""
    if config.pmbm.measurement == "clusters":
        return Pmbm(config)
    _of_points(config)
    if config.model.extent == "point":
        raise ConfigError("pmbm.measurement = 'points' asks for model.extent = 'random-matrix'")
    return Pmbm(config, partial(pointevidence.look, model=MatrixModel(config)))


def gp_pmbm(config: Config) -> Pmbm:
    """Hulls with a contour by a Gaussian process, of points whatever `pmbm.measurement` says."""
    _of_points(config)
    return Pmbm(config, partial(pointevidence.look, model=HullModel(config)), hull=True)


def _of_points(config: Config) -> None:
    if config.model.clutter != "fixed" or config.clutter_map.method != "none":
        raise ConfigError("the clutter of points is not learned: model.clutter = 'fixed', clutter_map.method = 'none'")
