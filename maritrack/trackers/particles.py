"""What `smc-phd` and `engm-phd` share: groups of particles, births as particles, objects out of particles.

With `intensity.bandwidth` = "global" all particles are one group, as in the paper. "local" has a group for each label:
its own number of particles, whatever its weight, and its own kernel, so that objects kilometres apart do not share
one, and a faint new object is not lost among the particles of those that are known. An update divides a group by the
measurements it may have been, as it divides a Gaussian component; what has become alike is united again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from maritrack.objects import mixture
from maritrack.settings import Config
from maritrack.trackers import berths, intensity, kernels, labels, links, readings, steps
from maritrack.trackers.capped import capped_clusters
from maritrack.trackers.intensity import Intensity, IntensityState, missed
from maritrack.trackers.labels import Found
from maritrack.trackers.readings import Readings
from maritrack.trackers.steps import Info
from maritrack.types import BoolArray, Clusters, FloatArray, IntArray, Points, Scan


@dataclass(frozen=True, slots=True, eq=False)
class Weighed:
    """A prior after the update: each component with each of its measurements, and as it was."""

    pairs: links.Links
    hit: FloatArray  # (k,) weight of each pair
    left: FloatArray  # (n,) weight of each component that no measurement updates
    group: IntArray  # (n,)
    n_groups: int
    unexplained: FloatArray  # (m,) share of each measurement that clutter has


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """Particles after the update, equal weights within a group."""

    d: Intensity
    cluster: IntArray  # (n,) that each was updated with, -1 = none
    group: IntArray  # (n,) of particles that were drawn together
    unexplained: FloatArray  # (m,) share of each measurement that clutter has


def grouped(label: IntArray, config: Config) -> tuple[IntArray, int]:
    """The group of each particle (n,), and how many there are."""
    if config.intensity.bandwidth == "global":
        return np.zeros(len(label), np.int64), int(len(label) > 0)
    names, group = np.unique(label, return_inverse=True)
    return group, len(names)


def redrawn(
    w: FloatArray, group: IntArray, cluster: IntArray, config: Config, rng: np.random.Generator
) -> tuple[IntArray, FloatArray, IntArray]:
    """Rows of a posterior drawn anew, the weight of each, and the group it was drawn in.

    Rows have weights w (r,), come from `group` (r,) and were updated with `cluster` (r,). Global: all are one group of
    `intensity.components`. Local: a group for what each was updated with, those below `intensity.prune_weight` left
    out, of `intensity.group_particles` for each object that it stands for.
    """
    rules = config.intensity
    if rules.bandwidth == "global":
        part, n = group, int(len(group) > 0)
        count = np.full(n, rules.components, np.int64)
        W = mixture.totals(part, w, n)
    else:
        keys, part = np.unique(group * (cluster.max(initial=0) + 2) + cluster, return_inverse=True)
        n = len(keys)
        W = mixture.totals(part, w, n)
        many = rules.group_particles * np.maximum(1, np.rint(W)).astype(np.int64)
        count = np.where(rules.prune_weight <= W, many, 0)
    row = kernels.draw(w, part, count, rng)
    return row, np.repeat(W / np.maximum(count, 1), count), np.repeat(np.arange(n), count)


def born_particles(born: Intensity, config: Config, rng: np.random.Generator) -> Intensity:
    """Particles of new Gaussians: as many of each as an object has, or, of drawn ones (global), their means alone."""
    rules = config.intensity
    if len(born) == 0 or (rules.bandwidth == "global" and rules.birth_draws):
        return replace(born, P=np.zeros_like(born.P))
    n = rules.group_particles
    row = np.repeat(np.arange(len(born)), n)
    x = kernels.gaussian(born.x[row], born.P, rng, row)
    return Intensity(x, np.zeros((len(row), *born.P.shape[1:])), born.w[row] / n, born.label[row])


def weighed(
    prior: Intensity, seen: Readings, scan: Scan, points: Points, t_ns: int, config: Config, *, gaussian: bool
) -> Weighed:
    """The weights after the update, of Gaussians or of the particles themselves."""
    group, n_groups = grouped(prior.label, config)
    own_s = intensity.own_time(prior, scan, points, t_ns)
    i, j = paired(prior, group, n_groups, seen, t_ns, own_s, config)
    pairs = links.link(prior.x, prior.P if gaussian else None, seen, i, j, t_ns, own_s)
    p_detect = readings.visible(scan, prior.x, config)
    with np.errstate(divide="ignore"):  # what is out of sight has no weight
        log_detected = np.log(p_detect * prior.w)
    log_w, unexplained = intensity.shares(log_detected[i] + links.log_likelihood(pairs), seen.log_kappa, j)
    return Weighed(pairs, np.exp(log_w), missed(prior.w, p_detect, config), group, n_groups, unexplained)


def paired(
    d: Intensity, group: IntArray, n_groups: int, seen: Readings, t_ns: int, own_s: FloatArray, config: Config
) -> tuple[IntArray, IntArray]:
    """Pairs of a particle and a measurement, ordered by particle: all, or those in the gate of its group."""
    if config.intensity.gate == "none" or n_groups == 0:
        return links.all_pairs(len(d), len(seen))
    mean, cov = kernels.sample_covariance(d.x, d.w, group, n_groups)
    P = cov + d.P[np.unique(group, return_index=True)[1]] + 1e-6 * np.eye(d.x.shape[1])
    own = np.bincount(group, own_s, n_groups) / np.bincount(group, minlength=n_groups)
    g, j = links.gated(mean, P, seen, t_ns, own, config.model.p_gate)
    first = np.searchsorted(g, np.arange(n_groups + 1))
    many = np.diff(first)[group]
    i = np.repeat(np.arange(len(d)), many)
    nth = np.arange(len(i)) - np.repeat(np.cumsum(many) - many, many)
    return i, j[first[group][i] + nth]


def carried_on(
    state: IntensityState, drawn: Drawn, label: int, clock: tuple[int, float, bool], seen: Readings, scan: Scan,
    points: Points, clusters: Clusters, config: Config,
) -> tuple[IntensityState, Info]:  # fmt: skip
    """The state after the update: objects found, particles named after them, births prepared."""
    t_ns, dt_s, back = clock
    rng = intensity.draws(config, state.k, intensity.EXTRACT)
    stays, there = berths.step(state, drawn.d, drawn.cluster, seen, drawn.unexplained, scan, points, clock, config)
    left = replace(drawn, d=intensity.rows(drawn.d, stays), cluster=drawn.cluster[stays], group=drawn.group[stays])
    d, found, label = objects(left, label, config, rng)
    tracks, whole, unreported = labels.followed(state, found, there, t_ns, dt_s, scan.sensor.id, label, config)
    free = np.ones(len(clusters))
    free[seen.cluster] = there.unexplained
    tracks = steps.with_clutter(tracks, clusters, free, scan, config)
    born = intensity.born_at_clusters(tracks, seen, there.unexplained, scan, clusters, t_ns, config)
    born = intensity.join(born, there.left)
    return IntensityState(d, born, t_ns, state.k + 1, tracks, whole, unreported), Info(clock_back=back)


def objects(drawn: Drawn, next_label: int, config: Config, rng: np.random.Generator) -> tuple[Intensity, Found, int]:
    """The particles under the labels of the objects that they belong to, those objects, and the next free label.

    Global: k-means over all particles; a cluster has the label that most of its weight had. Local: a group is an
    object; one of 1.5 and more is divided by k-means; those that have become alike are united, the faintest left out.
    """
    d, cluster = drawn.d, drawn.cluster
    if len(d) == 0:
        return d, Found(d.label, d.x, d.P, d.w, d.label), next_label
    local = config.intensity.bandwidth == "local"
    part = divided(d, drawn.group, rng) if local else capped_clusters(d.x, float(d.w[0]), rng)
    n = int(part.max()) + 1
    names, next_label = labels.unique_labels(dominant(part, d.label, d.w, n), mixture.totals(part, d.w, n), next_label)
    d = replace(d, label=names[part])
    if local:
        label, kept = united(d, config)
        d, cluster = intensity.rows(replace(d, label=label), kept), cluster[kept]
    names, part = np.unique(d.label, return_inverse=True)
    n = len(names)
    mean, cov = kernels.sample_covariance(d.x, d.w, part, n)
    cov = cov + 1e-6 * np.eye(d.x.shape[1])
    return d, Found(names, mean, cov, mixture.totals(part, d.w, n), dominant(part, cluster, d.w, n)), next_label


def divided(d: Intensity, group: IntArray, rng: np.random.Generator) -> IntArray:
    """The part of each particle (n,): its group's, or, of groups that stand for several objects, one of theirs."""
    names, part = np.unique(group, return_inverse=True)
    n = len(names)
    for crowd in np.flatnonzero(np.rint(mixture.totals(part, d.w, n)) > 1):
        mine = np.flatnonzero(part == crowd)
        own = capped_clusters(d.x[mine], float(d.w[mine].mean()), rng)
        part[mine[own > 0]] = n + own[own > 0] - 1
        n += int(own.max())
    return part


def united(d: Intensity, config: Config) -> tuple[IntArray, BoolArray]:
    """Labels of particles (n,), those of groups alike being the heaviest's, and which particles stay.

    Alike is what components of a mixture are: near by the covariance of the heavier. At most `intensity.components`
    groups stay, none lighter than `intensity.prune_weight`.
    """
    rules = config.intensity
    names, part = np.unique(d.label, return_inverse=True)
    W = mixture.totals(part, d.w, len(names))
    mean, cov = kernels.sample_covariance(d.x, d.w, part, len(names))
    order = np.lexsort((names, -W))
    into = mixture.leaders(mean[order], cov[order] + 1e-6 * np.eye(d.x.shape[1]), rules.merge_distance2)
    leader = np.empty(len(names), np.int64)
    leader[order] = order[into]
    together = mixture.totals(leader, W, len(names))
    heaviest = np.lexsort((names, -together))[: rules.components]
    stays = np.zeros(len(names), bool)
    stays[heaviest] = together[heaviest] >= rules.prune_weight
    return names[leader[part]], stays[leader[part]]


def dominant(part: IntArray, value: IntArray, w: FloatArray, n: int) -> IntArray:
    """The value (n,) with the most weight in each part 0..n-1; of equal ones the least."""
    order = np.lexsort((value, part))
    p, v = part[order], value[order]
    first = np.flatnonzero(np.concatenate([[True], (p[1:] != p[:-1]) | (v[1:] != v[:-1])]))
    weight = np.add.reduceat(w[order], first)
    by_weight = np.lexsort((v[first], -weight, p[first]))
    lead = np.searchsorted(p[first][by_weight], np.arange(n))
    return np.asarray(v[first][by_weight][lead])
