"""Reduction of a mixture of Gaussians of any dimension: which components are one, and their moments.

Vo, Ma 2006: greedy from the heaviest, which takes all that are left and near it, by its own covariance.
"""

from __future__ import annotations

import numpy as np

from maritrack.types import FloatArray, IntArray

BLOCK = 64  # leaders whose neighbours are asked at once


def leaders(x: FloatArray, P: FloatArray, distance2: float) -> IntArray:
    """The component (n,) that each of n is merged into, itself where it stays. Rows are ordered, heaviest first.

    i takes j > i where (x_j - x_i)' P_i^-1 (x_j - x_i) < distance2 and nothing before i took it. What is left is
    asked block by block: memory is BLOCK times n.
    """
    n, s = x.shape
    into, left = np.arange(n), np.arange(n)
    while len(left) > 1 and distance2 > 0:
        asked = left[:BLOCK]
        L_inv = np.linalg.inv(np.linalg.cholesky(P[asked]))
        white = (L_inv.reshape(-1, s) @ x[left].T).reshape(len(asked), s, len(left))
        own = np.einsum("aij,aj->ai", L_inv, x[asked])
        white -= own[:, :, None]
        near = np.einsum("asn,asn->an", white, white) < distance2
        free = np.ones(len(left), bool)
        for a in range(len(asked)):
            if free[a]:
                taken = free & near[a]
                into[left[taken]] = asked[a]
                free &= ~taken
                free[a] = False
                into[asked[a]] = asked[a]
        free[: len(asked)] = False
        left = left[free]
    return into


def merge(
    x: FloatArray, P: FloatArray, w: FloatArray, into: IntArray, *, spread: bool
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """State, covariance and weight for each leader of `into` (n,), and the leaders (g,). Alone means unchanged.

    With `spread` the covariance is that of the mixture; without, the weighted mean of the covariances.
    """
    lead = np.flatnonzero(into == np.arange(len(w)))
    group = np.searchsorted(lead, into)
    total = totals(group, w, len(lead))
    joined = np.bincount(group, minlength=len(lead)) > 1
    rows = np.flatnonzero(joined[group])
    g, share = group[rows], (w / total[group])[rows]
    gap = x[rows] - x[lead[g]]  # from the leader, which keeps the digits that far places would cost
    mean, cov = x[lead].copy(), P[lead].copy()
    shift = sums(g, share[:, None] * gap, len(lead))
    mean += shift
    second = P[rows] + gap[:, :, None] * gap[:, None, :] if spread else P[rows]
    whole = sums(g, (share[:, None, None] * second).reshape(len(rows), x.shape[1] ** 2), len(lead)).reshape(cov.shape)
    whole -= shift[:, :, None] * shift[:, None, :] if spread else 0.0
    cov = np.where(joined[:, None, None], (whole + whole.transpose(0, 2, 1)) / 2, cov)
    return mean, cov, total, lead


def totals(group: IntArray, w: FloatArray, n: int) -> FloatArray:
    """The weight (n,) of each group (k,)."""
    return np.asarray(np.bincount(group, w, n), np.float64)


def sums(group: IntArray, rows: FloatArray, n: int) -> FloatArray:
    """Sums (n, c) of the rows (k, c) of each group (k,)."""
    c = rows.shape[1]
    flat = (group[:, None] * c + np.arange(c)).ravel()
    return np.asarray(np.bincount(flat, rows.ravel(), n * c).reshape(n, c), np.float64)
