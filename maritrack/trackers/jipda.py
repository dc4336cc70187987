"""Joint integrated probabilistic data association on random matrices.

Musicki, Evans 2002, with clusters as single measurements (polar, sec. II). Exact marginals per connected
group of tracks and clusters; groups beyond `tracker.exact_limit` by loopy belief propagation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from maritrack.associate.marginals import existence_update, log_missed_weight, sparse_marginals
from maritrack.cluster.stage import cylinder_radius_m
from maritrack.config import Config
from maritrack.objects import giw
from maritrack.trackers import tracklist
from maritrack.trackers.tracklist import TrackList
from maritrack.types import BoolArray, Clusters, FloatArray, IntArray, Points, Scan, Tracks


@dataclass(frozen=True, slots=True)
class Info:
    """What is worth knowing about one update."""

    n_inexact: int = 0  # groups beyond the exact limit
    clock_back: bool = False
    n_cut: int = 0  # pairs in the gate that were not considered
    n_left_out: int = 0  # clusters that started no track because there were too many tracks


@dataclass(frozen=True, slots=True)
class Jipda:
    """Settings; the state is a TrackList."""

    config: Config

    def init(self) -> TrackList:
        """No tracks."""
        return tracklist.empty()

    def update(self, state: TrackList, scan: Scan, points: Points, clusters: Clusters) -> tuple[TrackList, Info]:
        """Predict every track to the beam's time, associate, update, start and end tracks."""
        config, model = self.config, self.config.model
        tracks, clock_back = predict(state, scan, points, config)
        d, lam = tracks.density, tracklist.clutter_at(tracks.clutter.get(scan.sensor.id), clusters, config)
        i, j, dt_s, cut = giw.gate(d, clusters, tracks.t_ns, gate_limit(model.p_gate), model)
        pairs = giw.pair_up(d, clusters, i, j, dt_s, model)
        p_detect = self._p_detect(tracks, scan)
        log_w, log_w0 = self._log_weights(tracks, clusters, pairs, scan, points, p_detect, lam)
        beta, beta0, inexact = sparse_marginals(
            i, j, log_w, log_w0, len(tracks), len(clusters), exact_limit=config.tracker.exact_limit
        )
        existence, given, given0 = existence_update(
            i, beta, beta0, tracks.existence, p_detect=p_detect, p_gate=model.p_gate
        )
        density = giw.update(d, clusters, pairs, given, given0, model)
        hit = beta0 < 0.5
        tracks = replace(
            tracks,
            density=density,
            existence=existence,
            hits=tracks.hits + hit,
            misses=np.where(
                hit, 0, tracks.misses + 1
            ),  # out of sight as well: a track that nobody sees coasts and ends
            cluster=most_likely(i, j, beta, hit, len(tracks)),
        )
        tracks = tracklist.follow(tracks, tracklist.seconds(tracks.t_ns - state.t_ns), config.tracker)
        unexplained = np.asarray(1.0 - np.bincount(j, beta, len(clusters)), np.float64)
        clutter = tracklist.learn_clutter(tracks.clutter.get(scan.sensor.id), clusters, unexplained, scan, config)
        if clutter is not None:
            tracks = replace(tracks, clutter={**tracks.clutter, scan.sensor.id: clutter})
        tracks = tracklist.manage(tracks, config)
        free, left_out = tracklist.room_for(tracks, clusters, np.flatnonzero(unexplained > 0.5), config.tracker)
        r0 = tracklist.birth_existence(config, tracklist.clutter_at(clutter, clusters, config)[free])
        tracks = tracklist.start(tracks, clusters, free, self._birth_time(scan, points, clusters, free), r0, config)
        return tracks, Info(inexact, clock_back, cut, left_out)

    def estimate(self, state: TrackList) -> Tracks:
        """Tracks at their own times."""
        return tracklist.estimate(state, self.config.tracker)

    def _p_detect(self, tracks: TrackList, scan: Scan) -> FloatArray:
        seen = tracklist.visible(
            scan, tracks.density.x[:, :2], self.config.input.roi_min_m, self.config.input.roi_max_m
        )
        return np.where(seen, self.config.model.p_detect, 0.0)

    def _log_weights(
        self, tracks: TrackList, clusters: Clusters, pairs: giw.Pairs, scan: Scan, points: Points,
        p_detect: FloatArray, lam: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:  # fmt: skip
        """log P_D r N / lambda * shape of pairs (k,) and log(1 - P_D P_G r) of tracks (t,).

        P_D P_G r times the normalised likelihood of eq. 9, in which 1/P_G cancels.   Eq: polar-9
        """
        config, model = self.config, self.config.model
        polar = config.cluster.method == "polar-dbscan"
        eps_m = max(config.cluster.eps_m, config.cluster.eps_cells * scan.sensor.range_res_m)
        V0 = giw.clutter_scatter(clusters, scan.position_m, eps_m, cylinder_radius_m(points, scan) if polar else 0.0)
        shape = giw.log_shape_ratio(tracks.density, clusters, pairs, V0, model)
        detected = p_detect * tracks.existence
        with np.errstate(divide="ignore"):  # a track out of sight has weight 0, its log is -inf
            log_detected = np.log(detected)[pairs.i]
        log_w = log_detected + giw.log_centroid(pairs) - np.log(lam)[pairs.j] + shape
        return log_w, log_missed_weight(tracks.existence, p_detect=p_detect, p_gate=model.p_gate)

    def _birth_time(self, scan: Scan, points: Points, clusters: Clusters, free: IntArray) -> IntArray:
        return tracklist.beam_time(scan, points, clusters.mean_m[free])


def predict(state: TrackList, scan: Scan, points: Points, config: Config) -> tuple[TrackList, bool]:
    """Tracks at the time when the beam of this scan passes them; whether a clock stepped back.

    A scan that is older than a track doesn't move it.
    """
    middle_ns = (scan.t_ns + scan.t_start_ns) // 2
    ahead = np.maximum(tracklist.seconds(middle_ns - state.t_ns), 0.0)
    rough = state.density.x[:, :2] + ahead[:, None] * state.density.x[:, 2:]
    t_ns = tracklist.beam_time(scan, points, rough)
    dt = tracklist.seconds(t_ns - state.t_ns)
    back = bool((dt < 0).any())
    dt = np.maximum(dt, 0.0)
    existence = state.existence * config.model.p_survive**dt
    density = giw.predict(state.density, dt, config.model)
    return replace(state, density=density, t_ns=np.maximum(t_ns, state.t_ns), existence=existence), back


def gate_limit(p_gate: float) -> float:
    """Squared Mahalanobis distance that holds p_gate of a Gaussian of two dimensions."""
    return -2.0 * math.log1p(-p_gate)


def most_likely(i: IntArray, j: IntArray, beta: FloatArray, hit: BoolArray, n: int) -> IntArray:
    """Cluster of the largest weight of each track (n,), -1 where the track was missed."""
    best = np.full(n, -1, np.int64)
    order = np.lexsort((beta, i))
    best[i[order]] = j[order]  # the last one written, the largest weight, stays
    return np.where(hit, best, -1)
