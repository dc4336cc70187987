"""Reduction of a mixture of Gaussian inverse-Wishart components: which are one, and what that one is.

Granstroem, Orguner 2012: greedy from the heaviest, merged by least Kullback-Leibler divergence from the mixture,
which keeps the mean and covariance of the kinematics, E[X^-1] and E[log|X|] of the extent. In the mean
parametrisation of `maritrack.objects.giw`: nu = alpha + 6, V = alpha X; a = nu - 3 is short for what the formulas
share. A component is measured against heavier ones only; ties in weight are for the caller to order.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import digamma, polygamma

from maritrack.objects import giw, matrix2
from maritrack.objects.giw import Giw
from maritrack.types import BoolArray, FloatArray, IntArray

ALPHA_MIN = 2.0  # below, the mean of the extent has no variance; nu = 8
LIMIT = 2.0 * math.log(2.0)  # of _spread for a -> inf
BLOCK = 2_000  # heavier components whose neighbours are asked at once


def near_pairs(d: Giw, distance2: float, *, hull: FloatArray | None = None) -> tuple[IntArray, IntArray]:
    """Pairs (i, j), i < j, with (m_i - m_j)' T^-1 (m_i - m_j) < distance2, the kinematics of both at one time.

    T is P_i. With `hull` (n, 2, 2), the scatter of the points of each object, it is P_i + hull_i in position and
    P_i + P_j in velocity, without their correlation: what lies in the hull and moves with it as far as one can tell.
    """
    if len(d) < 2 or distance2 <= 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    at, cov = d.x[:, :2], d.P[:, :2, :2] if hull is None else d.P[:, :2, :2] + hull
    radius = np.sqrt(distance2 * matrix2.eigen(cov)[0][:, 0]) * (1.0 + 1e-9)
    inv, tree = matrix2.inverse(cov), cKDTree(at)
    i, j = (np.concatenate(part) for part in zip(*_blocks(d, inv, tree, radius, distance2), strict=True))
    gap = d.x[i] - d.x[j]
    if hull is None:
        distance = np.einsum("ki,ki->k", gap, np.linalg.solve(d.P[i], gap[..., None])[..., 0])
    else:
        faster = matrix2.inverse(d.P[i, 2:, 2:] + d.P[j, 2:, 2:])
        distance = matrix2.form(inv[i], gap[:, :2]) + matrix2.form(faster, gap[:, 2:])
    return i[distance < distance2], j[distance < distance2]


def _blocks(
    d: Giw, inv: FloatArray, tree: cKDTree, radius: FloatArray, distance2: float
) -> Iterator[tuple[IntArray, IntArray]]:
    """Pairs that are near in position, which alone is never farther than all, block by block of the heavier ones."""
    for begin in range(0, len(d), BLOCK):
        rows = np.arange(begin, min(begin + BLOCK, len(d)))
        around = tree.query_ball_point(d.x[rows, :2], radius[rows])
        count = np.fromiter(map(len, around), np.int64, len(rows))
        i, j = np.repeat(rows, count), np.concatenate([np.asarray(near, np.int64) for near in around])
        lighter = j > i
        i, j = i[lighter], j[lighter]
        near = matrix2.form(inv[i], d.x[i, :2] - d.x[j, :2]) < distance2
        yield i[near], j[near]


def gauss_wasserstein2(X1: FloatArray, X2: FloatArray) -> FloatArray:
    """Squared Gauss-Wasserstein distance (n,) of extents (n, 2, 2), in m^2.

    tr X1 + tr X2 - 2 tr (X1^1/2 X2 X1^1/2)^1/2; the last trace is sqrt(tr X1 X2 + 2 sqrt|X1 X2|).
    """
    both = X1[:, 0, 0] + X1[:, 1, 1] + X2[:, 0, 0] + X2[:, 1, 1]
    product = np.sqrt(np.maximum(matrix2.det(X1) * matrix2.det(X2), 0.0))
    cross = np.sqrt(np.maximum(matrix2.trace_product(X1, X2) + 2.0 * product, 0.0))
    return np.asarray(np.maximum(both - 2.0 * cross, 0.0))


def symmetric_kl(X1: FloatArray, alpha1: FloatArray, X2: FloatArray, alpha2: FloatArray) -> FloatArray:
    """KL(1||2) + KL(2||1) (n,) of inverse Wisharts; their gamma functions cancel. It compares certainty as well."""
    a1, a2 = alpha1 + 3.0, alpha2 + 3.0
    share = alpha2 / alpha1
    forth = matrix2.trace_product(matrix2.inverse(X1), X2) * share  # tr V1^-1 V2
    back = matrix2.trace_product(matrix2.inverse(X2), X1) / share
    log_det = np.log(matrix2.det(X2)) - np.log(matrix2.det(X1)) + 2.0 * np.log(share)  # log |V1^-1 V2|
    certainty = _digammas(a2) - _digammas(a1)
    return np.asarray(0.5 * (a1 * (forth - 2.0) + a2 * (back - 2.0) + (a1 - a2) * log_det + (a2 - a1) * certainty))


def leaders(i: IntArray, j: IntArray, n: int) -> IntArray:
    """The component (n,) that each of n is merged into, itself where it stays; pairs i < j are alike.

    Greedy from component 0 on: the first that is left takes all that are left and like it. In rounds: who is like
    no earlier one that is still undecided leads; a component goes to its first leader.
    """
    open_, leads = np.ones(n, bool), np.zeros(n, bool)
    a, b = i, j
    while open_.any():
        held = np.zeros(n, bool)
        held[b] = True
        new = open_ & ~held
        leads |= new
        open_ &= ~new
        open_[b[new[a]]] = False
        left = open_[a] & open_[b]
        a, b = a[left], b[left]
    into = np.arange(n)
    led = leads[i] & ~leads[j]
    first = np.full(n, n)
    np.minimum.at(first, j[led], i[led])
    return np.where(first < n, first, into)


def merge(d: Giw, log_w: FloatArray, into: IntArray) -> tuple[Giw, FloatArray]:
    """One component and its log weight for each leader of `into` (n,), in the order of the leaders.

    The leader of a group must be its heaviest. A component alone stays as it is, to the last bit. A group of
    points (X = 0) has the leader's X and alpha.
    """
    lead = np.flatnonzero(into == np.arange(len(d)))
    order = np.argsort(into, kind="stable")
    group, d = np.searchsorted(lead, into[order]), Giw(d.x[order], d.P[order], d.X[order], d.alpha[order])
    first = np.searchsorted(group, np.arange(len(lead)))  # the leader comes first in its group: it has the least index
    log_w = log_w[order]
    part = np.exp(log_w - log_w[first][group])
    total = np.bincount(group, part, len(lead))
    share = part / total[group]
    x, P = _moments(d, share, group, first)
    X, alpha = d.X[first].copy(), d.alpha[first].copy()
    unlike = _unlike(d, group, first) & (matrix2.det(X) > 0.0)
    if unlike.any():
        rows = unlike[group]
        number = np.cumsum(unlike)[group[rows]] - 1
        X[unlike], alpha[unlike] = merge_extents(d.X[rows], d.alpha[rows], share[rows], number)
    return Giw(x, P, X, alpha), log_w[first] + np.log(total)


def _moments(d: Giw, share: FloatArray, group: IntArray, first: IntArray) -> tuple[FloatArray, FloatArray]:
    gap = d.x - d.x[first][group]
    second = d.P + gap[:, :, None] * gap[:, None, :]
    rows = np.concatenate([gap, second.reshape(-1, 16)], axis=1) * share[:, None]
    sums = giw.segment_sums(group, rows, len(first))
    mean = sums[:, :4]
    P = sums[:, 4:].reshape(-1, 4, 4) - mean[:, :, None] * mean[:, None, :]
    return d.x[first] + mean, (P + P.transpose(0, 2, 1)) / 2


def _unlike(d: Giw, group: IntArray, first: IntArray) -> BoolArray:
    """Groups whose extents are not all the leader's."""
    other = (d.X[first][group] != d.X).any(axis=(1, 2)) | (d.alpha != d.alpha[first][group])
    return np.bincount(group, other, len(first)) > 0


def merge_extents(
    X: FloatArray, alpha: FloatArray, share: FloatArray, group: IntArray
) -> tuple[FloatArray, FloatArray]:
    """The inverse Wishart (X, alpha) nearest to each group's mixture; shares add up to 1 within a group.

    Matches E[X^-1] = a V^-1 and E[log|X|]. Rows are ordered by group. Where the root has alpha < 2 the extent is the
    arithmetic mean with alpha = 2, as a mean extent would explode.
    """
    n, a = int(group[-1]) + 1, alpha + 3.0
    V = alpha[:, None, None] * X
    terms = np.concatenate(
        [(a[:, None, None] * matrix2.inverse(V)).reshape(-1, 4), X.reshape(-1, 4),
         (np.log(matrix2.det(V)) - _digammas(a))[:, None]], axis=1
    )  # fmt: skip
    sums = giw.segment_sums(group, terms * share[:, None], n)
    C1, mean_X = sums[:, :4].reshape(n, 2, 2), sums[:, 4:8].reshape(n, 2, 2)
    most = np.zeros(n)
    np.maximum.at(most, group, a)
    root = solve_spread(np.log(matrix2.det(C1)) + sums[:, 8], most + 1.0)
    vague = root - 3.0 < ALPHA_MIN
    merged = np.maximum(root - 3.0, ALPHA_MIN)
    X_merged = (root / merged)[:, None, None] * matrix2.inverse(C1)
    return np.where(vague[:, None, None], mean_X, X_merged), merged


def solve_spread(target: FloatArray, most: FloatArray) -> FloatArray:
    """The a (n,) within (1, most) at which 2 log a - psi(a/2) - psi((a-1)/2) is the target.

    Newton's method on the inverse of what is above the limit for a -> inf, which is nearly linear in a (between
    (a-1)/2 and a/3); bisection where a step leaves the bracket.
    """
    low, high = np.full_like(most, 1.0 + 1e-9), most.copy()
    goal = 1.0 / np.maximum(target - LIMIT, 1e-14)
    a = np.clip(1.0 + 2.0 * goal, low, high)
    for _ in range(60):
        above = np.maximum(_spread(a) - LIMIT, 1e-14)
        slope = -(2.0 / a - 0.5 * polygamma(1, a / 2) - 0.5 * polygamma(1, (a - 1.0) / 2)) / above**2
        miss = 1.0 / above - goal
        low, high = np.where(miss < 0, a, low), np.where(miss > 0, a, high)
        step = a - miss / slope
        new = np.where((step >= low) & (step <= high), step, 0.5 * (low + high))
        if (np.abs(new - a) <= 1e-13 * a).all():
            return np.asarray(new)
        a = new
    return a


def _digammas(a: FloatArray) -> FloatArray:
    return np.asarray(digamma(a / 2) + digamma((a - 1.0) / 2))


def _spread(a: FloatArray) -> FloatArray:
    return np.asarray(2.0 * np.log(a) - _digammas(a))
