"""A scan of clusters, each a single measurement: an object on a random matrix gives one of them at most."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit, logit

from maritrack.associate.marginals import log_missed_weight, sparse_marginals
from maritrack.associate.murty import k_best
from maritrack.objects import giw
from maritrack.settings import Config
from maritrack.trackers import bernoullis, stationary, steps, tracklist
from maritrack.trackers.association import Children
from maritrack.trackers.bernoullis import Bernoullis
from maritrack.trackers.steps import Sight
from maritrack.trackers.tracklist import TrackList
from maritrack.types import Clusters, FloatArray, IntArray, Points, Scan, take


@dataclass(slots=True, eq=False)
class ClusterEvidence:
    """Rows and the clusters in their gates; what the Poisson components say of clusters is in `log_u`."""

    sight: Sight  # of the rows, then of the Poisson components
    before: Bernoullis  # (n,) the rows at their new times
    missed: Bernoullis
    log_miss: FloatArray  # (n,)
    i: IntArray  # (k,)
    j: IntArray  # (k,)
    log_hit: FloatArray  # (k,) log r P_D N / lambda and the ratio of the shapes
    log_u: FloatArray  # (c,) log of new objects against clutter
    log_new: FloatArray  # (c,) log of both
    donor: IntArray  # (c,) pair of the Poisson component that a newborn is of, -1 = of the births everywhere
    may_start: FloatArray  # (c,) 1, or 0 where there is no room for it
    poisson: Bernoullis  # after the scan
    config: Config
    scan: Scan
    points: Points
    clusters: Clusters
    n_inexact: int = 0

    @property
    def n_elements(self) -> int:
        """Clusters."""
        return len(self.clusters)

    @property
    def clock_back(self) -> bool:
        """Whether a clock stepped back."""
        return self.sight.clock_back

    @property
    def n_cut(self) -> int:
        """Pairs in the gate that were not considered."""
        return self.sight.n_cut

    @property
    def n_left_out(self) -> int:
        """Clusters in no row's gate for which there was no room."""
        kept_out = self.may_start == 0
        kept_out[self.j] = False
        return int(np.count_nonzero(kept_out))

    def free(self) -> IntArray:
        """Clusters in no row's gate that may be new objects."""
        alone = self.may_start > 0
        alone[self.j] = False
        return np.flatnonzero(alone)

    def explained(self, cell: IntArray, p: FloatArray) -> FloatArray:
        """Share (c,) of each cluster that rows took, from hits by cells (m,), each as likely as p (m,)."""
        return np.asarray(np.bincount(cell, p, len(self.clusters)), np.float64)

    def learn(self, shown: TrackList, unexplained: FloatArray) -> TrackList:
        """The tracks with the clutter of one more scan."""
        return steps.with_clutter(shown, self.clusters, unexplained, self.scan, self.config)

    def children(self, rows: IntArray, elements: IntArray, *, most: int, least: float, thorough: bool) -> Children:
        """The best assignments of clusters to rows, which need no search."""
        rules = self.config.pmbm
        gain = np.full((len(rows), len(elements)), -np.inf)
        for t, row in enumerate(rows.tolist()):
            if row >= 0:
                mine = slice(*np.searchsorted(self.i, [row, row + 1]))
                at = np.searchsorted(elements, self.j[mine])
                gain[t, at] = self.log_hit[mine] - self.log_miss[row] - self.log_new[self.j[mine]]
        span = -np.log(rules.prune_hypothesis) if rules.prune_hypothesis > 0 else np.inf
        place, total = k_best(gain, np.zeros(len(rows)), most, span=span, least=least)
        cell = np.where(place >= 0, elements[place], -1)
        free = np.repeat(self.may_start[elements][None] > 0, len(place), axis=0)
        event, row = np.nonzero(place >= 0)
        free[event, place[event, row]] = False
        return Children(total, cell, [elements[one] for one in free])

    def crowd(self, rows: IntArray, elements: IntArray) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
        """Marginals of a group, by belief propagation where it is large."""
        place = np.full(len(self.log_miss), -1)
        place[rows] = np.arange(len(rows))
        mine = place[self.i] >= 0
        i, j = place[self.i[mine]], np.searchsorted(elements, self.j[mine])
        log_w = self.log_hit[mine] - self.log_new[self.j[mine]]
        beta, beta0, inexact = sparse_marginals(
            i, j, log_w, self.log_miss[rows], len(rows), len(elements), exact_limit=self.config.tracker.exact_limit
        )  # fmt: skip
        self.n_inexact += inexact
        return i, elements[j], beta, beta0

    def hit(self, row: IntArray, cell: IntArray) -> Bernoullis:
        """Rows updated with clusters: they exist."""
        c = len(self.clusters)
        pair = np.searchsorted(self.i * c + self.j, row * c + cell)
        parents = bernoullis.rows(self.before, row)
        tracks = replace(
            tracklist.count(parents.tracks, np.ones(len(row), bool), self.scan.sensor.id),
            density=self._updated(pair, parents.tracks.density), existence=np.ones(len(row)), cluster=cell,
            held_s=np.zeros(len(row)),
        )  # fmt: skip
        return replace(parents, tracks=tracks)

    def newborn(self, cell: IntArray) -> Bernoullis:
        """New rows at clusters, at their own or as the heaviest Poisson component there."""
        t_ns = tracklist.beam_time(self.scan, self.points, self.clusters.mean_m[cell])
        none = replace(self.before.tracks, next_id=0)
        none = tracklist.select(none, np.zeros(0, np.int64))
        tracks = tracklist.start(none, self.clusters, cell, t_ns, expit(self.log_u[cell]), self.config)
        heir = np.flatnonzero(self.donor[cell] >= 0)
        if len(heir):
            pair = self.donor[cell[heir]]
            of = self.sight.pairs.i[pair]
            donated = self._updated(pair, take(self.sight.tracks.density, of))
            d, t_ns = tracks.density, tracks.t_ns.copy()
            arrays = [getattr(d, name).copy() for name in ("x", "P", "X", "alpha")]
            for array, name in zip(arrays, ("x", "P", "X", "alpha"), strict=True):
                array[heir] = getattr(donated, name)
            t_ns[heir] = self.sight.tracks.t_ns[of]
            tracks = replace(tracks, density=giw.Giw(*arrays), t_ns=t_ns)
        rate = np.tile([self.config.pmbm.rate_shape, self.config.pmbm.rate_scale], (len(cell), 1))
        empty = bernoullis.nothing(0)
        return Bernoullis(tracks, rate, np.zeros((len(cell), 0)), np.zeros((len(cell), *empty.P.shape[1:])))

    def _updated(self, pair: IntArray, parents: giw.Giw) -> giw.Giw:
        n = len(pair)
        own = replace(take(self.sight.pairs, pair), i=np.arange(n))
        hidden = self.sight.own[self.sight.pairs.i[pair]]
        return giw.update(parents, self.clusters, own, np.ones(n), np.zeros(n), self.config.model, hidden)


def look(
    rows: Bernoullis, poisson: Bernoullis, scan: Scan, points: Points, clusters: Clusters, config: Config, k: int = 0
) -> ClusterEvidence:
    """Rows and Poisson components at the beam's time, and what the clusters in their gates say.

    A cluster is new with log u: objects nobody has seen, against clutter; from `tracker.birth_existence`, or
    P_D b / lambda, and from the Poisson components in whose gate it is.
    """
    share, n, model = config.pmbm.p_survive_scan, len(rows), config.model
    still = config if share == 0.0 else replace(config, model=replace(model, p_survive=1.0))
    both = bernoullis.join([rows, poisson])
    sight = steps.look(both.tracks, scan, points, clusters, still)
    if share > 0.0:
        lives = np.where(sight.tracks.t_ns > both.tracks.t_ns, share, 1.0)
        sight = replace(sight, tracks=replace(sight.tracks, existence=sight.tracks.existence * lives))
    sight = steps.keep(sight, sight.p_detect[sight.pairs.i] > 0.0)
    c = len(clusters)
    order = np.argsort(sight.pairs.i * c + sight.pairs.j, kind="stable")
    sight = replace(sight, pairs=take(sight.pairs, order), dt_s=sight.dt_s[order])
    pairs, tracks = sight.pairs, sight.tracks
    log_w = steps.log_weights(sight, clusters, scan, points, sight.p_detect * tracks.existence, config)
    r0 = tracklist.birth_existence(config, steps.clutter_density(tracks, clusters, scan, config))
    log_u, donor = logit(r0), np.full(c, -1, np.int64)
    first = int(np.searchsorted(pairs.i, n))
    best = log_u.copy()
    np.maximum.at(best, pairs.j[first:], log_w[first:])
    mine = first + np.flatnonzero(log_w[first:] >= best[pairs.j[first:]])
    donor[pairs.j[mine]] = mine
    np.logaddexp.at(log_u, pairs.j[first:], log_w[first:])
    before = replace(both, tracks=tracks)
    ours = bernoullis.rows(before, np.arange(n))
    r, p = ours.tracks.existence, sight.p_detect[:n]
    log_miss = log_missed_weight(r, p_detect=p, p_gate=model.p_gate)
    gone = tracklist.count(ours.tracks, np.zeros(n, bool), scan.sensor.id)
    left = (1.0 - p * model.p_gate) * r / np.exp(log_miss)
    gone = replace(gone, existence=np.minimum(left, 1.0), cluster=np.full(n, -1, np.int64))
    gone = stationary.hold_covered(
        gone, rows.tracks, np.zeros(n, bool), sight.covered[:n], scan, config.tracker
    )  # fmt: skip
    theirs = bernoullis.rows(before, np.arange(n, len(both)))
    mu = theirs.tracks.existence * (1.0 - sight.p_detect[n:] * model.p_gate)
    room = max(config.tracker.max_tracks - len(np.unique(rows.tracks.id)), 0)
    may_start = np.zeros(c)
    may_start[np.lexsort((np.arange(c), -clusters.intensity, -clusters.count))[:room]] = 1.0
    return ClusterEvidence(
        sight=sight, before=ours, missed=replace(ours, tracks=gone), log_miss=log_miss, i=pairs.i[:first],
        j=pairs.j[:first], log_hit=log_w[:first], log_u=log_u, log_new=np.logaddexp(0.0, log_u), donor=donor,
        may_start=may_start, poisson=replace(theirs, tracks=replace(theirs.tracks, existence=mu)), config=config,
        scan=scan, points=points, clusters=clusters,
    )  # fmt: skip
