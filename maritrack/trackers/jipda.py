"""Joint integrated probabilistic data association on random matrices.

Musicki, Evans 2002, with clusters as single measurements (polar, sec. II). Exact marginals per connected
group of tracks and clusters; groups beyond `tracker.exact_limit` by loopy belief propagation, or by
the likeliest joint events (extended, sec. 3.2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maritrack.associate.marginals import existence_update, log_missed_weight, sparse_marginals
from maritrack.objects import giw
from maritrack.settings import Config
from maritrack.trackers import steps, tracklist
from maritrack.trackers.steps import Info, gate_limit, predict
from maritrack.trackers.tracklist import TrackList
from maritrack.types import Clusters, Points, Scan, Tracks

__all__ = ["Info", "Jipda", "gate_limit", "predict"]


@dataclass(frozen=True, slots=True)
class Jipda:
    """Settings; the state is a TrackList."""

    config: Config

    def init(self) -> TrackList:
        """No tracks."""
        return tracklist.empty()

    def update(self, state: TrackList, scan: Scan, points: Points, clusters: Clusters) -> tuple[TrackList, Info]:
        """Predict every track to the beam's time, associate, update, start and end tracks.

        Reading: polar sec. II "M:N" is read as every cluster in the gate of any track; `tracker.pairs_per_track`
        leaves each track its best ones.
        """
        config, model = self.config, self.config.model
        state = steps.still_known(state, scan, config)
        sight = steps.look(state, scan, points, clusters, config)
        r, pairs, n = sight.tracks.existence, sight.pairs, len(sight.tracks)
        log_w = steps.log_weights(sight, clusters, scan, points, sight.p_detect * r, config)
        log_w0 = log_missed_weight(r, p_detect=sight.p_detect, p_gate=model.p_gate)
        beta, beta0, inexact = sparse_marginals(
            pairs.i,
            pairs.j,
            log_w,
            log_w0,
            n,
            len(clusters),
            exact_limit=config.tracker.exact_limit,
            murty=config.tracker.hypotheses if config.tracker.beyond_limit == "murty" else 0,
        )
        existence, given, given0 = existence_update(
            pairs.i, beta, beta0, r, p_detect=sight.p_detect, p_gate=model.p_gate
        )
        hit = beta0 < 0.5
        outcome = steps.Outcome(
            density=giw.update(sight.tracks.density, clusters, pairs, given, given0, model, sight.own),
            existence=existence,
            hit=hit,
            cluster=steps.most_likely(pairs.i, pairs.j, beta, hit, n),
            unexplained=np.asarray(1.0 - np.bincount(pairs.j, beta, len(clusters)), np.float64),
            n_inexact=inexact,
        )
        return steps.carry_on(state, sight, outcome, scan, points, clusters, config)

    def estimate(self, state: TrackList) -> Tracks:
        """Tracks at their own times."""
        return tracklist.estimate(state, self.config.tracker)
