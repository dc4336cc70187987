"""Probability hypothesis density filter on Gaussian inverse-Wishart components, clusters as single measurements.

Granstroem, Orguner 2012 without its partitions: every cluster is one measurement (polar, sec. II). Components carry
labels, which stay through merging, so that they can be followed as tracks. Weights are computed as logarithms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from maritrack.objects import giw, reduction
from maritrack.objects.giw import Giw
from maritrack.settings import Config
from maritrack.trackers import stationary, steps, tracklist
from maritrack.trackers.steps import Info, Sight
from maritrack.trackers.tracklist import TrackList
from maritrack.tracksettings import PhdConfig
from maritrack.types import (
    COASTED,
    CONFIRMED,
    TENTATIVE,
    BoolArray,
    Clusters,
    FloatArray,
    IntArray,
    Points,
    Scan,
    Tracks,
    take,
)


@dataclass(frozen=True, slots=True)
class Phd:
    """Settings; the state is a TrackList whose rows are components, `id` the label and `existence` the weight.

    A weight above one stands for several objects. `confirmed` rows have been above `phd.extract_weight` under
    their label.
    """

    config: Config

    def init(self) -> TrackList:
        """No components."""
        return tracklist.empty()

    def update(self, state: TrackList, scan: Scan, points: Points, clusters: Clusters) -> tuple[TrackList, Info]:
        """Predict, update every component with every cluster in its gate, reduce, start new components.

        Reading: polar sec. II "M:N" is read as every cluster in the gate of any component; `tracker.pairs_per_track`
        leaves each its best ones. A new component has its weight when its cluster was seen; it is first updated
        in the next scan, so that no cluster counts twice.
        """
        config = self.config
        state = steps.still_known(state, scan, config)
        sight = look(state, scan, points, clusters, config)
        log_wl = steps.log_weights(
            sight, clusters, scan, points, sight.p_detect * sight.tracks.existence, config
        )  # w P_D P_G Lambda
        held, rows, log_wl, log_w0 = set_aside(state, sight, log_wl, len(clusters), scan, config)
        log_w, unexplained = detected_weights(log_wl, sight.pairs.j, len(clusters))
        mixture, parent = hypotheses(sight, clusters, log_w, log_w0, scan.sensor.id, config)
        eps_m = max(config.cluster.eps_m, config.cluster.eps_cells * scan.sensor.range_res_m)
        mixture, kept = reduce_mixture(mixture, steps.middle_ns(scan), eps_m, config)
        moved_s = tracklist.seconds(sight.tracks.t_ns - state.t_ns)[np.concatenate([parent[kept], rows])]
        mixture = tracklist.follow(_join(mixture, held), moved_s, config.tracker)
        mixture, left_out = give_birth(relabel(mixture, config.phd), scan, points, clusters, unexplained, config)
        return mixture, Info(0, sight.clock_back, sight.n_cut, left_out)

    def estimate(self, state: TrackList) -> Tracks:
        """Components at their own times: those above `phd.extract_weight` are confirmed, one track for each."""
        rules, w = self.config.phd, state.existence
        late = state.confirmed & (state.misses > 0) & (state.misses <= rules.hold_scans)
        shown = (w > rules.extract_weight) & (state.hits >= rules.extract_hits)
        status = np.where(shown, CONFIRMED, np.where(late, COASTED, TENTATIVE))
        return stationary.told(state, status, self.config.tracker)


def look(state: TrackList, scan: Scan, points: Points, clusters: Clusters, config: Config) -> Sight:
    """Components at the beam's time, less what doesn't survive, with the clusters in their gates.

    Survival is by scan; a scan that doesn't move a component's clock (a second sensor at the same time) costs
    nothing.
    """
    share = config.phd.p_survive_scan
    model = config.model if share == 0.0 else replace(config.model, p_survive=1.0)
    sight = steps.look(state, scan, points, clusters, replace(config, model=model))
    sight = steps.keep(sight, sight.p_detect[sight.pairs.i] > 0.0)
    if share == 0.0:
        return sight
    lives = np.where(sight.tracks.t_ns > state.t_ns, share, 1.0)
    return replace(sight, tracks=replace(sight.tracks, existence=sight.tracks.existence * lives))


def detected_weights(log_wl: FloatArray, j: IntArray, n_clusters: int) -> tuple[FloatArray, FloatArray]:
    """Log weights of the updated components of pairs (k,), and the share of each cluster (c,) they leave.

    w_ij = w_i l_ij / (1 + sum_l w_l l_lj), from log_wl (k,) = log w_i l_ij; the 1 is clutter, by which l is divided.
    """
    log_all = np.zeros(n_clusters)
    np.logaddexp.at(log_all, j, log_wl)
    return np.asarray(log_wl - log_all[j]), np.exp(-log_all)


def missed_weights(sight: Sight, p_gate: float) -> FloatArray:
    """Log weights (t,) of the components as predicted: (1 - P_D P_G) w, w itself out of sight."""
    with np.errstate(divide="ignore"):  # a weight of 0 is -inf
        return np.asarray(np.log(sight.tracks.existence) + np.log1p(-sight.p_detect * p_gate))


def set_aside(
    state: TrackList, sight: Sight, log_wl: FloatArray, n_clusters: int, scan: Scan, config: Config
) -> tuple[TrackList, IntArray, FloatArray, FloatArray]:
    """Components that the background takes, as they were before, and their rows; what the others weigh.

    That is log w l of pairs (k,) and the log weights of components as predicted (t,), none for those that are taken.
    They are out of the mixture until they win a cluster: nothing merges with them. What is seen to leave leaves
    nothing behind: it was one vessel.
    """
    tracks, rules, log_w0 = sight.tracks, config.tracker, missed_weights(sight, config.model.p_gate)
    i, j = sight.pairs.i, sight.pairs.j
    log_w, free = detected_weights(log_wl, j, n_clusters)
    hit = np.bincount(i, np.exp(log_w), len(tracks)) > 0.5
    hit[i[stationary.winners(i, j, log_w, 1.0 - free)]] = True
    rests = stationary.takes(tracks, hit, sight.covered, rules) & (state.existence >= rules.delete_existence)
    rows = np.flatnonzero(rests)
    missed = tracklist.count(tracklist.select(tracks, rows), np.zeros(len(rows), bool), scan.sensor.id)
    held = stationary.hold_covered(missed, tracklist.select(state, rows), hit[rows], sight.covered[rows], scan, rules)
    held = replace(held, existence=np.minimum(held.existence, 1.0), cluster=np.full(len(rows), -1))
    lasts = held.held_s <= rules.stationary_s
    none = rests | (hit & (state.held_s > 0))
    log_wl, log_w0 = np.where(rests[i], -np.inf, log_wl), np.where(none, -np.inf, log_w0)
    return tracklist.select(held, lasts), rows[lasts], log_wl, log_w0


def hypotheses(
    sight: Sight, clusters: Clusters, log_w: FloatArray, log_w0: FloatArray, sensor: str, config: Config
) -> tuple[TrackList, IntArray]:
    """The mixture after the update, components below `phd.prune_weight` left out, and each one's predecessor."""
    least = math.log(config.phd.prune_weight)
    heavy, stays = log_w >= least, np.flatnonzero(log_w0 >= least)
    pairs = take(sight.pairs, heavy)
    n, parents = len(pairs.i), tracklist.select(sight.tracks, pairs.i)
    own = replace(pairs, i=np.arange(n))
    hit = replace(
        tracklist.count(parents, np.ones(n, bool), sensor),
        density=giw.update(parents.density, clusters, own, np.ones(n), np.zeros(n), config.model, sight.own[pairs.i]),
        existence=np.exp(log_w[heavy]),
        cluster=pairs.j,
    )
    missed = tracklist.count(tracklist.select(sight.tracks, stays), np.zeros(len(stays), bool), sensor)
    missed = replace(missed, existence=np.exp(log_w0[stays]), cluster=np.full(len(stays), -1, np.int64))
    both = _join(hit, missed)
    return replace(both, held_s=np.zeros(len(both))), np.concatenate([pairs.i, stays])


def _join(a: TrackList, b: TrackList) -> TrackList:
    d, e, join = a.density, b.density, np.concatenate
    return replace(
        a, density=Giw(join([d.x, e.x]), join([d.P, e.P]), join([d.X, e.X]), join([d.alpha, e.alpha])),
        t_ns=join([a.t_ns, b.t_ns]), existence=join([a.existence, b.existence]), id=join([a.id, b.id]),
        hits=join([a.hits, b.hits]), misses=join([a.misses, b.misses]), confirmed=join([a.confirmed, b.confirmed]),
        lag_m=join([a.lag_m, b.lag_m]), moving=join([a.moving, b.moving]), settled=join([a.settled, b.settled]),
        cluster=join([a.cluster, b.cluster]), told=join([a.told, b.told]), held_s=join([a.held_s, b.held_s]),
    )  # fmt: skip


def reduce_mixture(mixture: TrackList, t_ns: int, eps_m: float, config: Config) -> tuple[TrackList, IntArray]:
    """The mixture with what is alike merged into the heaviest, and the rows (t,) that were the heaviest.

    Merged ones have the label, the time and the past of their heaviest. States are compared and merged at one
    time, t_ns: on both sides of the azimuth where a scan begins they differ by a turn. At most
    `phd.max_components` stay.
    """
    rank = heaviest_first(mixture)
    mixture = tracklist.select(mixture, rank)
    still = replace(config.model, accel_psd_m2ps3=0.0, extent_time_constant_s=math.inf)
    since_s = tracklist.seconds(t_ns - mixture.t_ns)
    at_once = len(mixture) == 0 or bool((since_s == since_s[0]).all())
    d = mixture.density if at_once else giw.predict(mixture.density, since_s, still)
    i, j = reduction.near_pairs(d, config.phd.merge_distance2)
    like = alike(d, i, j, eps_m, config)
    into = reduction.leaders(i[like], j[like], len(d))
    lead = np.flatnonzero(into == np.arange(len(d)))
    with np.errstate(divide="ignore"):
        d, log_w = reduction.merge(d, np.log(mixture.existence), into)
    whole, weight = parts_united(d, np.exp(log_w), tracklist.select(mixture, lead), config)
    d = take(d, whole)
    d = d if at_once else giw.predict(d, -since_s[lead[whole]], still)
    merged = replace(tracklist.select(mixture, lead[whole]), density=d, existence=weight)
    heaviest = heaviest_first(merged)[: config.phd.max_components]
    return tracklist.select(merged, heaviest), rank[lead[whole[heaviest]]]


def parts_united(d: Giw, weight: FloatArray, rows: TrackList, config: Config) -> tuple[IntArray, FloatArray]:
    """Which components stay when what lies in the hull of another and moves with it is a part of that, and weights.

    The one that was reported first, under the lowest label, is the whole; among others the heaviest. Its state and
    extent stay as they are: the mean of the parts would count the hull as uncertainty, and grow with it.
    `phd.unite_distance2` = 0 unites none.

    Reading: polar sec. II merges by state and extent alone, and so does the default; the preset `radar` unites.
    """
    rules, x = config.phd, d.x
    reported = rows.confirmed & (weight > rules.extract_weight)
    order = np.lexsort((x[:, 1], x[:, 0], rows.id, -weight, np.where(reported, rows.id, rows.next_id)))
    ranked = take(d, order)
    i, j = reduction.near_pairs(ranked, rules.unite_distance2, hull=config.model.rho * ranked.X)
    into = reduction.leaders(i, j, len(order))
    whole = np.flatnonzero(into == np.arange(len(order)))
    return order[whole], np.asarray(np.bincount(into, weight[order], len(order)), np.float64)[whole]


def alike(d: Giw, i: IntArray, j: IntArray, eps_m: float, config: Config) -> BoolArray:
    """Which pairs (k,) have extents alike enough to be one object. Points always have."""
    rules = config.phd
    if config.model.extent == "point":
        return np.ones(len(i), bool)
    if rules.merge_extent == "kl":
        return np.asarray(reduction.symmetric_kl(d.X[i], d.alpha[i], d.X[j], d.alpha[j]) < rules.merge_kl)
    return np.asarray(reduction.gauss_wasserstein2(d.X[i], d.X[j]) < (rules.merge_eps_share * eps_m) ** 2)


def heaviest_first(mixture: TrackList) -> IntArray:
    """Order of the rows by weight; equal ones by label, then place."""
    x = mixture.density.x
    return np.lexsort((x[:, 1], x[:, 0], mixture.id, -mixture.existence))


def relabel(mixture: TrackList, rules: PhdConfig) -> TrackList:
    """The mixture ordered by label, each label once: the heaviest keeps it, others get new ones.

    Reading: polar sec. II keeps the dominant label through merging; of components that share one and did not merge
    it says nothing.
    """
    order = heaviest_first(mixture)
    _, first = np.unique(mixture.id[order], return_index=True)
    label, keeps = mixture.id.copy(), np.zeros(len(mixture), bool)
    keeps[order[first]] = True
    others = order[~keeps[order]]
    label[others] = mixture.next_id + np.arange(len(others))
    shown = (mixture.existence > rules.extract_weight) & (mixture.hits >= rules.extract_hits)
    confirmed = (mixture.confirmed & keeps) | shown
    named = replace(mixture, id=label, confirmed=confirmed, next_id=mixture.next_id + len(others))
    return tracklist.select(named, np.argsort(label))


def give_birth(
    mixture: TrackList, scan: Scan, points: Points, clusters: Clusters, unexplained: FloatArray, config: Config
) -> tuple[TrackList, int]:
    """The mixture with a component at each cluster that is explained by less than half, and how many had no room.

    Lighter components make room for them. The clutter density learns what is unexplained.
    """
    rules = config.phd
    mixture = steps.with_clutter(mixture, clusters, unexplained, scan, config)
    born = replace(config, tracker=replace(config.tracker, birth_existence=rules.birth_weight))
    weight = tracklist.birth_existence(born, steps.clutter_density(mixture, clusters, scan, config))
    free = np.flatnonzero(unexplained > 0.5)
    heavier = tracklist.select(mixture, mixture.existence >= weight[free].max(initial=0.0))
    room = replace(config.tracker, max_tracks=rules.max_components)
    free, left_out = tracklist.room_for(heavier, clusters, free, room)
    stays = heaviest_first(mixture)[: rules.max_components - len(free)]
    mixture = mixture if len(stays) == len(mixture) else tracklist.select(mixture, np.sort(stays))
    t_ns = tracklist.beam_time(scan, points, clusters.mean_m[free])
    return tracklist.start(mixture, clusters, free, t_ns, weight[free], config), left_out
