"""From particles to Gaussians and back: kernel density estimates, draws from mixtures.

Silverman 1986; a global kernel has the covariance of all particles, a local one that of the particles of its group.
"""

from __future__ import annotations

import numpy as np

from maritrack.objects.mixture import sums, totals
from maritrack.types import FloatArray, IntArray


def bandwidth(n: FloatArray, s: int) -> FloatArray:
    """Silverman's rule for n particles of s dimensions, a factor of the covariance.   Eq: engm-13, engm-29"""
    return np.asarray((4.0 / (n * (s + 2.0))) ** (2.0 / (s + 4.0)))


def kernels(
    x: FloatArray, w: FloatArray, group: IntArray, n_groups: int, *, shrink: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Centres (n, s) of the kernels of particles, and their covariance in each group (g, s, s).

    Eq: engm-11, engm-12

    beta times the sample covariance, divided once by the objects the group stands for, ceil(W), 1 at least. Weights
    may differ within a group. Of one particle, or of identical ones, it is zero but for a millimetre.

    With `shrink` centres are drawn towards the mean of their group, so that the mixture has the covariance of the
    particles; else it is wider by that of the kernel, scan after scan.

    Deviates: engm-11 `shrink` is the default; the preset `engm` has the paper's kernels about the particles.

    Deviates: engm-12 one kernel for all particles where n_groups = 1, as in the paper; else one for those of each
    object, as objects that are far apart leave nothing of a kernel that spans them.
    """
    s = x.shape[1]
    n, W = np.bincount(group, minlength=n_groups), totals(group, w, n_groups)
    mean, cov = sample_covariance(x, w, group, n_groups)
    scale = bandwidth(np.maximum(n, 1), s) / np.maximum(
        1.0, np.ceil(W - 1e-9)
    )  # a sum that is 1 but for rounding is one object
    K = scale[:, None, None] * cov + 1e-6 * np.eye(s)
    if not shrink:
        return x, K
    return mean[group] + np.sqrt(np.maximum(1.0 - scale, 0.0))[group, None] * (x - mean[group]), K


def sample_covariance(x: FloatArray, w: FloatArray, group: IntArray, n_groups: int) -> tuple[FloatArray, FloatArray]:
    """Mean (g, s) and unbiased covariance (g, s, s) of particles by group, by weight; all alike where there is none."""
    s = x.shape[1]
    W, n = totals(group, w, n_groups)[group], np.bincount(group, minlength=n_groups)[group]
    share = np.where(W > 0.0, w / np.where(W > 0.0, W, 1.0), 1.0 / n)
    mean = sums(group, share[:, None] * x, n_groups)
    gap = x - mean[group]
    if n_groups == 1:
        cov = ((share[:, None] * gap).T @ gap)[None]
    else:
        outer = share[:, None, None] * gap[:, :, None] * gap[:, None, :]
        cov = sums(group, outer.reshape(len(x), s * s), n_groups).reshape(n_groups, s, s)
    effective = 1.0 / np.maximum(np.bincount(group, share**2, n_groups), 1e-300)
    unbiased = effective / np.maximum(effective - 1.0, 1e-9)
    return mean, np.where(effective > 1.0 + 1e-9, unbiased, 0.0)[:, None, None] * cov


def draw(w: FloatArray, group: IntArray, count: IntArray, rng: np.random.Generator) -> IntArray:
    """Rows of a mixture, drawn by weight: count[g] independent ones from each group g of rows, ordered by group."""
    order = np.argsort(group, kind="stable")
    total = np.concatenate([[0.0], np.cumsum(w[order])])
    first = np.searchsorted(group[order], np.arange(len(count) + 1))
    of = np.repeat(np.arange(len(count)), count)
    low, high = total[first[:-1]][of], total[first[1:]][of]
    at = np.searchsorted(total, low + rng.random(len(of)) * (high - low), side="right") - 1
    return np.asarray(order[np.clip(at, first[:-1][of], first[1:][of] - 1)])


def gaussian(x: FloatArray, P: FloatArray, rng: np.random.Generator, row: IntArray | None = None) -> FloatArray:
    """One sample of each Gaussian: states (n, s), covariances (n, s, s), or those of `row` (n,) of fewer."""
    L = np.linalg.cholesky(P)
    noise = rng.normal(size=x.shape)
    if len(P) == 1:
        return np.asarray(x + noise @ L[0].T)
    return np.asarray(x + np.einsum("nij,nj->ni", L if row is None else L[row], noise))
