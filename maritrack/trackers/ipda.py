"""Integrated probabilistic data association, one filter a track on clusters of its own.

Musicki, Evans, Stankovic 1994, with clusters as single measurements; many at once as in polar, sec. II:
first each cluster goes to the nearest track that has it in its gate (1:N), then every track associates alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit, logit

from maritrack.associate.hard import nearest_track
from maritrack.objects import giw
from maritrack.settings import Config
from maritrack.trackers import steps, tracklist
from maritrack.trackers.steps import Info
from maritrack.trackers.tracklist import TrackList
from maritrack.types import Clusters, FloatArray, IntArray, Points, Scan, Tracks


@dataclass(frozen=True, slots=True)
class Ipda:
    """Settings; the state is a TrackList."""

    config: Config

    def init(self) -> TrackList:
        """No tracks."""
        return tracklist.empty()

    def update(self, state: TrackList, scan: Scan, points: Points, clusters: Clusters) -> tuple[TrackList, Info]:
        """Predict every track, give each cluster to one of them, update each on its own, start and end tracks.

        Reading: polar sec. II "1:N" is read as one track for a cluster, any number of clusters for a track;
        nearest by the cost of `steps.gate_cost`. Where one of them is held in the background, by shape as well: a
        quay that is hidden as a whole would take all that leaves it.
        """
        config, model = self.config, self.config.model
        state = steps.still_known(state, scan, config)
        sight = steps.look(state, scan, points, clusters, config)
        sight = steps.keep(sight, sight.p_detect[sight.pairs.i] > 0.0)
        cost = steps.gate_cost(sight, config)
        if state.held_s.any():
            by_shape = np.isin(sight.pairs.j, sight.pairs.j[state.held_s[sight.pairs.i] > 0])
            cost -= 2.0 * np.where(by_shape, steps.log_shape(sight, clusters, scan, points, config), 0.0)
        sight = steps.keep(sight, nearest_track(sight.pairs.i, sight.pairs.j, cost))
        pairs, n = sight.pairs, len(sight.tracks)
        log_ratio = steps.log_weights(sight, clusters, scan, points, sight.p_detect, config)
        existence, beta, beta0 = integrated_pda(
            pairs.i, log_ratio, sight.tracks.existence, p_detect=sight.p_detect, p_gate=model.p_gate
        )
        taken = existence[pairs.i] * beta
        hit = existence * (1.0 - beta0) > 0.5
        outcome = steps.Outcome(
            density=giw.update(sight.tracks.density, clusters, pairs, beta, beta0, model, sight.own),
            existence=existence,
            hit=hit,
            cluster=steps.most_likely(pairs.i, pairs.j, beta, hit, n),
            unexplained=np.asarray(1.0 - np.bincount(pairs.j, taken, len(clusters)), np.float64),
        )
        return steps.carry_on(state, sight, outcome, scan, points, clusters, config)

    def estimate(self, state: TrackList) -> Tracks:
        """Tracks at their own times."""
        return tracklist.estimate(state, self.config.tracker)


def integrated_pda(
    track: IntArray, log_ratio: FloatArray, existence: FloatArray, *, p_detect: FloatArray, p_gate: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Posterior existence (t,) and weights given existence of pairs (k,) and of misses (t,), each track alone.

    log_ratio (k,) = log P_D N / lambda, existence (t,) predicted. With Delta = 1 - P_D P_G + sum P_D N / lambda:
    beta0 = (1 - P_D P_G) / Delta, beta = P_D N / (lambda Delta), r = Delta r / (1 - r + Delta r).
    """
    log_missed = np.log1p(-p_detect * p_gate)
    log_delta = log_missed.copy()
    np.logaddexp.at(log_delta, track, log_ratio)
    r = expit(log_delta + logit(existence))
    return np.asarray(r), np.exp(log_ratio - log_delta[track]), np.exp(log_missed - log_delta)
