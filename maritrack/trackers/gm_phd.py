"""Gaussian mixture PHD filter with the extended Kalman filter's update: Vo, Ma 2006, as in the engm paper.

Components carry labels, which stay through merging.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from maritrack.objects import mixture
from maritrack.settings import Config
from maritrack.trackers import berths, intensity, labels, links, readings, steps
from maritrack.trackers.intensity import Intensity, IntensityState
from maritrack.trackers.labels import Found
from maritrack.trackers.readings import Readings
from maritrack.trackers.steps import Info
from maritrack.types import Clusters, FloatArray, IntArray, Points, Scan, Tracks


@dataclass(frozen=True, slots=True)
class GmPhd:
    """Settings; the state holds the mixture and, by label, the tracks."""

    config: Config

    def init(self) -> IntensityState:
        """No object."""
        return intensity.begin(self.config)

    def update(
        self, state: IntensityState, scan: Scan, points: Points, clusters: Clusters
    ) -> tuple[IntensityState, Info]:
        """Predict, update every component with every measurement in its gate, prune, merge and cap, find objects.

        The prior is the mixture of what survives and of the births.   Eq: engm-5
        """
        config = self.config
        t_ns, dt_s, back = intensity.clock(state, scan)
        born, label = intensity.labelled(intensity.newborn(state, dt_s, config), state.tracks.next_id)
        prior = intensity.join(intensity.moved(state.intensity, dt_s, config), born)
        seen = readings.read(scan, points, clusters, state.tracks, config)
        posterior, cluster, unexplained = updated(prior, seen, scan, points, t_ns, config)
        stays, there = berths.step(
            state, posterior, cluster, seen, unexplained, scan, points, (t_ns, dt_s, back), config
        )
        reduced, lead = reduce(intensity.rows(posterior, stays), config)
        found, copies, label = objects(reduced, cluster[stays][lead], state.copies, label, config)
        tracks, whole, unreported = labels.followed(state, found, there, t_ns, dt_s, scan.sensor.id, label, config)
        free = np.ones(len(clusters))
        free[seen.cluster] = there.unexplained
        tracks = steps.with_clutter(tracks, clusters, free, scan, config)
        born = intensity.born_at_clusters(tracks, seen, there.unexplained, scan, clusters, t_ns, config)
        born = intensity.join(born, there.left)
        kept = replace(reduced, label=found.label[: len(reduced)])
        after = IntensityState(kept, born, t_ns, state.k + 1, tracks, whole, unreported, copies)
        return after, Info(clock_back=back)

    def estimate(self, state: IntensityState) -> Tracks:
        """Components heavier than `intensity.extract_weight` are confirmed."""
        return labels.estimate(state, self.config)


def updated(
    prior: Intensity, seen: Readings, scan: Scan, points: Points, t_ns: int, config: Config
) -> tuple[Intensity, IntArray, FloatArray]:
    """The mixture after the update, heaviest first, lighter ones than `intensity.prune_weight` left out.

    Also the cluster of each component, -1 = missed, and the share of each measurement that clutter has.
    Eq: engm-4, engm-6
    """
    p_detect, pairs, log_w, unexplained = links.weighed(prior, seen, scan, points, t_ns, config)
    least = config.intensity.prune_weight
    heavy = np.flatnonzero(log_w >= np.log(least))
    x, P = links.update(prior.x, prior.P, pairs, heavy, seen.R)
    hit = Intensity(x, P, np.exp(log_w[heavy]), prior.label[pairs.i[heavy]])
    left = intensity.missed(prior.w, p_detect, config)
    stays = np.flatnonzero(left >= least)
    both = intensity.join(hit, replace(intensity.rows(prior, stays), w=left[stays]))
    cluster = np.concatenate([seen.cluster[pairs.j[heavy]], np.full(len(stays), -1, np.int64)])
    order = np.lexsort((np.arange(len(both)), -both.w))
    return intensity.rows(both, order), cluster[order], unexplained


def reduce(posterior: Intensity, config: Config) -> tuple[Intensity, IntArray]:
    """The mixture merged and capped, its weight as it was, and the row that each component comes from.

    `intensity.merge_spread` = false leaves the distances of merged means out of the covariance, as the numbers of
    the engm paper do; Vo and Ma have them in it.
    """
    rules = config.intensity
    into = mixture.leaders(posterior.x, posterior.P, rules.merge_distance2)
    x, P, w, lead = mixture.merge(posterior.x, posterior.P, posterior.w, into, spread=rules.merge_spread)
    heaviest = np.lexsort((np.arange(len(w)), -w))[: rules.components]
    scale = w.sum() / w[heaviest].sum() if len(heaviest) < len(w) else 1.0
    merged = Intensity(x[heaviest], P[heaviest], scale * w[heaviest], posterior.label[lead[heaviest]])
    return merged, lead[heaviest]


def objects(
    reduced: Intensity, cluster: IntArray, before: Mapping[tuple[int, int], int], next_label: int, config: Config
) -> tuple[Found, dict[tuple[int, int], int], int]:
    """The components under labels of their own, then the copies of those that stand for several objects.

    Reading: Vo and Ma report a component as often as its weight rounds to, `intensity.copies`, which the preset `engm`
    has. The default is once: where P_D is set too low the weight of one object grows to 1 / P_D.

    `before` holds the labels of copies by label and number; also those of now, and the next label that is free.
    """
    label, next_label = labels.unique_labels(reduced.label, reduced.w, next_label)
    more = np.maximum(np.rint(reduced.w).astype(np.int64) - 1, 0) * config.intensity.copies
    again = np.repeat(np.arange(len(reduced)), more)
    nth = np.arange(len(again)) - np.repeat(np.cumsum(more) - more, more)
    copies = {}
    for key in zip(label[again].tolist(), nth.tolist(), strict=True):
        copies[key] = before.get(key, next_label)
        next_label += key not in before
    row = np.concatenate([np.arange(len(reduced)), again])
    label = np.concatenate([label, np.fromiter(copies.values(), np.int64, len(copies))])
    return Found(label, reduced.x[row], reduced.P[row], reduced.w[row], cluster[row]), copies, next_label
