"""Objects nobody has seen yet: a Poisson process, its intensity constant in space or Gaussians on a ring."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from maritrack.contoursettings import PmbmConfig
from maritrack.trackers import bernoullis
from maritrack.trackers.bernoullis import Bernoullis
from maritrack.types import FloatArray, IntArray


def ring(centre_m: FloatArray, rules: PmbmConfig) -> tuple[FloatArray, FloatArray]:
    """Means (b, 2) and expected objects (b,) of the births of a scan: on a circle, and a quarter as many within.

    Reading: extended sec. 3.1 "mixture components are spread along the edge of a circle"; those within are ours.
    """
    n = rules.birth_components
    inside = n // 4
    angle = 2.0 * math.pi * np.concatenate([np.arange(n) / n, (np.arange(inside) + 0.5) / max(inside, 1)])
    reach = rules.birth_radius_m * np.concatenate([np.ones(n), np.full(inside, 0.5)])
    at = centre_m + reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return at, np.full(len(at), rules.birth_weight / len(at))


def pruned(poisson: Bernoullis, rules: PmbmConfig) -> Bernoullis:
    """The components that count, the heaviest `pmbm.most_poisson` of them."""
    mu = poisson.tracks.existence
    keep = np.flatnonzero(mu >= rules.prune_poisson)
    if len(keep) > rules.most_poisson:
        keep = np.sort(keep[np.argsort(-mu[keep], kind="stable")[: rules.most_poisson]])
    return poisson if len(keep) == len(mu) else bernoullis.rows(poisson, keep)


def recycled(poisson: Bernoullis, rows: Bernoullis, index: IntArray, p: FloatArray, rules: PmbmConfig) -> Bernoullis:
    """The Poisson components and what was pruned of the mixture: rows `index` (k,), each as likely as p (k,)."""
    if not rules.recycle or len(index) == 0:
        return poisson
    back = bernoullis.rows(rows, index)
    back = replace(back, tracks=replace(back.tracks, existence=back.tracks.existence * p))
    return pruned(bernoullis.join([poisson, back]), rules)
