"""Sequential probability ratio test on random matrices: hard 1:1 assignment, existence by hits and misses alone.

Blackman, Popoli 1999, as the baseline of polar, sec. II: neither place nor shape of a cluster tells how likely
its track is to exist, so it is for light clutter and objects that keep apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit, logit

from maritrack.associate.hard import assign
from maritrack.objects import giw, matrix2
from maritrack.settings import Config
from maritrack.trackers import steps, tracklist
from maritrack.trackers.steps import Info, Sight
from maritrack.trackers.tracklist import TrackList
from maritrack.tracksettings import SprtConfig
from maritrack.types import BoolArray, Clusters, FloatArray, Points, Scan, Tracks

FALSE_ALARM_MIN, FALSE_ALARM_MAX = 1e-4, 0.9  # of a gate: a hit and a miss always tell something


@dataclass(frozen=True, slots=True)
class Sprt:
    """Settings; the state is a TrackList whose existence is r = 1 / (1 + exp(-L)), L the log-likelihood ratio."""

    config: Config

    def init(self) -> TrackList:
        """No tracks."""
        return tracklist.empty()

    def update(self, state: TrackList, scan: Scan, points: Points, clusters: Clusters) -> tuple[TrackList, Info]:
        """Predict every track, assign at most one cluster to it, update, count, start and end tracks."""
        config = with_limits_of_the_test(self.config)
        model, rules = config.model, config.sprt
        state = steps.still_known(state, scan, config)
        sight = steps.look(state, scan, points, clusters, config)
        sight = steps.keep(sight, sight.p_detect[sight.pairs.i] > 0.0)
        cost = steps.gate_cost(sight, config)
        if rules.assign_by_shape:
            cost -= 2.0 * steps.log_shape(sight, clusters, scan, points, config)
        pairs = steps.keep(sight, assign(sight.pairs.i, sight.pairs.j, cost, how=rules.assignment)).pairs
        n, sure = len(sight.tracks), np.ones(len(pairs.i))
        hit = np.bincount(pairs.i, minlength=n) > 0
        p_false = false_alarm(sight, scan, config)
        L = logit(sight.tracks.existence) + log_ratio_step(hit, sight.p_detect, model.p_gate, p_false)
        most = max(float(logit(rules.existence_max)), limits(rules)[1])
        outcome = steps.Outcome(
            density=giw.update(sight.tracks.density, clusters, pairs, sure, np.where(hit, 0.0, 1.0), model, sight.own),
            existence=np.asarray(expit(np.minimum(L, most))),
            hit=hit,
            cluster=steps.most_likely(pairs.i, pairs.j, sure, hit, n),
            unexplained=np.asarray(1.0 - np.bincount(pairs.j, sure, len(clusters)), np.float64),
        )
        return steps.carry_on(state, sight, outcome, scan, points, clusters, config)

    def estimate(self, state: TrackList) -> Tracks:
        """Tracks at their own times."""
        return tracklist.estimate(state, self.config.tracker)


def false_alarm(sight: Sight, scan: Scan, config: Config) -> FloatArray:
    """Probability (t,) that the gate of a track holds a false cluster: given, or 1 - exp(-lambda A) of its area A."""
    if config.sprt.p_false_alarm > 0.0:
        return np.full(len(sight.tracks), config.sprt.p_false_alarm)
    d, model = sight.tracks.density, config.model
    area_m2 = math.pi * steps.gate_limit(model.p_gate) * np.sqrt(matrix2.det(d.P[:, :2, :2] + model.rho * d.X))
    expected = steps.clutter_of_tracks(sight, scan, config) * area_m2
    return np.clip(-np.expm1(-expected), FALSE_ALARM_MIN, FALSE_ALARM_MAX)


def log_ratio_step(hit: BoolArray, p_detect: FloatArray, p_gate: float, p_false: FloatArray) -> FloatArray:
    """What a scan adds to the log-likelihood ratio of each track (t,).

    log(P_D P_G / P_FA) for a hit, log((1 - P_D P_G) / (1 - P_FA)) for a miss, nothing where the scan did not look.
    """
    seen = p_detect * p_gate
    gain = np.log(np.where(hit, seen, 1.0) / p_false)
    loss = np.log((1.0 - seen) / (1.0 - p_false))
    return np.where(p_detect > 0.0, np.where(hit, gain, loss), 0.0)


def limits(rules: SprtConfig) -> tuple[float, float]:
    """Log-likelihood ratios (low, high) at which Wald's test decides: delete, confirm."""
    return math.log(rules.beta / (1.0 - rules.alpha)), math.log((1.0 - rules.beta) / rules.alpha)


def with_limits_of_the_test(config: Config) -> Config:
    """The settings with the test's decisions in place of those on existence, and no loss of existence by time."""
    low, high = expit(limits(config.sprt))
    rules = replace(
        config.tracker, birth_existence=float(expit(config.sprt.start_ratio)), confirm_existence=float(high),
        confirm_hits=1, delete_existence=float(low),
    )  # fmt: skip
    return replace(config, tracker=rules, model=replace(config.model, p_survive=1.0))
