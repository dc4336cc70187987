"""Joint probabilistic data association on principal axes: `pakf-jpda` of the abs paper.

The state of its eq. 5 in two decoupled blocks: position and velocity by a Kalman filter, orientation and semi-axes
by another (`objects/axes.py`, a reconstruction). Every track exists for sure; it is confirmed by M hits within
N steps and ends after misses in a row.   Eq: abs-5
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from maritrack.associate.marginals import log_missed_weight, sparse_marginals
from maritrack.objects import axes, giw
from maritrack.objects.axes import Axes
from maritrack.settings import Config
from maritrack.trackers import steps, tracklist
from maritrack.trackers.steps import Info
from maritrack.trackers.tracklist import TrackList
from maritrack.types import Clusters, IntArray, Points, Scan, Tracks, take


@dataclass(frozen=True, slots=True, eq=False)
class Principal:
    """The state: tracks whose extent is the ellipse of `axes`, row by row, and their last steps."""

    tracks: TrackList  # `existence` = hits within the last N steps over M, 1 once confirmed
    axes: Axes
    recent: IntArray  # (t,) a bit for each of the last N steps, the latest lowest: 1 = hit


@dataclass(frozen=True, slots=True)
class Pakf:
    """Settings; the state is a Principal."""

    config: Config

    def init(self) -> Principal:
        """No tracks."""
        return Principal(tracklist.empty(), axes.empty(), np.zeros(0, np.int64))

    def update(self, state: Principal, scan: Scan, points: Points, clusters: Clusters) -> tuple[Principal, Info]:
        """Predict both blocks, associate all tracks with all clusters in their gates, update both, keep the list.

        The prior of a scan is the posterior of the one before it, of whichever sensor: the product over sensors.
        Scans of one time are one prediction. Tentative tracks are updated too, or none could be
        confirmed.   Eq: abs-6
        """
        config = rules_of(self.config)
        known = steps.still_known(state.tracks, scan, config)
        rows = np.isin(state.tracks.id, known.id)
        state = Principal(known, take(state.axes, rows), state.recent[rows])
        sight = steps.look(state.tracks, scan, points, clusters, config)
        pairs, n, certain = sight.pairs, len(sight.tracks), np.ones(len(sight.tracks))
        log_w = steps.log_weights(sight, clusters, scan, points, sight.p_detect, config)
        log_w0 = log_missed_weight(certain, p_detect=sight.p_detect, p_gate=config.model.p_gate)
        beta, beta0, inexact = sparse_marginals(
            pairs.i, pairs.j, log_w, log_w0, n, len(clusters), exact_limit=config.tracker.exact_limit
        )
        density, shape = self._condition(state, sight, clusters, beta, beta0, config)
        hit = beta0 < 0.5
        again = scan.sensor.id in state.tracks.heard  # a new step begins
        recent = ((state.recent << again) & ((1 << config.pakf.confirm_scans) - 1)) | hit
        share = np.minimum(_bits(recent, config.pakf.confirm_scans) / config.pakf.confirm_hits, 1.0)
        outcome = steps.Outcome(
            density=density,
            existence=np.where(state.tracks.confirmed, 1.0, share),
            hit=hit,
            cluster=steps.most_likely(pairs.i, pairs.j, beta, hit, n),
            unexplained=np.asarray(1.0 - np.bincount(pairs.j, beta, len(clusters)), np.float64),
            n_inexact=inexact,
        )
        tracks, info = steps.carry_on(state.tracks, sight, outcome, scan, points, clusters, config)
        return self._joined(Principal(sight.tracks, shape, recent), tracks, clusters, config), info

    def estimate(self, state: Principal) -> Tracks:
        """Tracks at their own times."""
        return tracklist.estimate(state.tracks, self.config.tracker)

    def _condition(
        self, state: Principal, sight: steps.Sight, clusters: Clusters, beta: np.ndarray, beta0: np.ndarray,
        config: Config,
    ) -> tuple[giw.Giw, Axes]:  # fmt: skip
        """Both blocks after the update with the same weights."""
        rules, model = config.pakf, config.model
        dt_s = np.maximum(tracklist.seconds(sight.tracks.t_ns - state.tracks.t_ns), 0.0)
        shape = axes.predict(state.axes, dt_s, rules)
        seen = axes.measure(clusters, model, rules)
        whole = 1.0 - sight.own[sight.pairs.i]  # of what is hidden there are fragments, which say nothing of its size
        shape = axes.update(shape, seen, sight.pairs.i, sight.pairs.j, beta * whole, rules)
        motion = giw.update(sight.tracks.density, clusters, sight.pairs, beta, beta0, replace(model, extent="point"))
        shape = axes.held(axes.follow_course(shape, motion.x[:, 2:], rules), model)
        return replace(motion, X=axes.ellipse(shape)), shape

    def _joined(self, before: Principal, tracks: TrackList, clusters: Clusters, config: Config) -> Principal:
        """The kept list with the axes of its rows; new ones have those of their cluster.

        A tentative track ends sooner than a confirmed one.
        """
        alive = tracks.confirmed | (tracks.misses < config.pakf.tentative_misses)
        tracks = tracks if alive.all() else tracklist.select(tracks, alive)
        old = np.isin(tracks.id, before.tracks.id)
        row = np.searchsorted(before.tracks.id, tracks.id[old])
        new = axes.birth(take(axes.measure(clusters, config.model, config.pakf), tracks.cluster[~old]))
        join = np.concatenate  # rows are ordered by id, and new ids are higher
        shape = Axes(join([before.axes.p[row], new.p]), join([before.axes.P[row], new.P]))
        recent = join([before.recent[row], np.ones(len(new), np.int64)])
        density = replace(tracks.density, X=axes.ellipse(shape))
        return Principal(replace(tracks, density=density), shape, recent)


def rules_of(config: Config) -> Config:
    """The configuration as this tracker reads it: M of N for existence, misses alone end, no likelihood of shapes."""
    rules = replace(
        config.tracker, confirm_existence=1.0, confirm_hits=config.pakf.confirm_hits, delete_existence=0.0,
        delete_misses=config.pakf.confirmed_misses - 1, birth_existence=1.0 / config.pakf.confirm_hits,
    )  # fmt: skip
    return replace(config, tracker=rules, model=replace(config.model, shape="none", p_survive=1.0))


def _bits(value: IntArray, n: int) -> IntArray:
    """How many of the n lowest bits are set."""
    return np.asarray(((value[:, None] >> np.arange(n)) & 1).sum(axis=1), np.int64)
