"""References that are small and slow on purpose: they enumerate what the package computes cleverly."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
from scipy.optimize import linprog

from maritrack.types import FloatArray


def joint_event_marginals(missed: FloatArray, weight: FloatArray) -> FloatArray:
    """Association probabilities (t, 1 + m) from weights W_t0 (t,) and W_tj (t, m), event by event."""
    n_tracks, n_measurements = weight.shape
    table = np.hstack([missed[:, None], weight])
    sums = np.zeros_like(table)
    for event in product(range(1 + n_measurements), repeat=n_tracks):
        taken = [j for j in event if j]
        if len(taken) == len(set(taken)):
            sums[np.arange(n_tracks), list(event)] += np.prod(table[np.arange(n_tracks), list(event)])
    return sums / sums.sum(axis=1, keepdims=True) if n_tracks else sums


def joint_event_existence(beta: FloatArray, existence: FloatArray, p_detect: float, p_gate: float) -> FloatArray:
    """Posterior existence (t,): associated tracks exist, missed ones by Bayes."""
    q = p_detect * p_gate
    return np.array(
        [
            b[1:].sum() + (b[0] * (1 - q) * r / (1 - q * r) if q * r < 1 else 0.0)
            for b, r in zip(beta, existence, strict=True)
        ]
    )


def jpda_step(
    x: FloatArray, P: FloatArray, z: FloatArray, R: FloatArray, *, p_detect: float, p_gate: float, density: float
) -> tuple[FloatArray, FloatArray]:
    """JPDA of point objects, x (t, 4) and P (t, 4, 4) predicted, with z (m, 2) of one covariance R: event by event."""
    H, limit, weight = np.eye(2, 4), -2 * np.log(1 - p_gate), np.zeros((len(x), len(z)))
    S = [H @ P[t] @ H.T + R for t in range(len(x))]
    for t, j in np.ndindex(weight.shape):
        nu = z[j] - H @ x[t]
        d2 = nu @ np.linalg.solve(S[t], nu)
        if d2 <= limit:
            density_of_z = np.exp(-d2 / 2) / (2 * np.pi * np.sqrt(np.linalg.det(S[t])))
            weight[t, j] = p_detect * density_of_z / density
    beta = joint_event_marginals(np.full(len(x), 1 - p_detect * p_gate), weight)
    x_new, P_new = np.empty_like(x), np.empty_like(P)
    for t in range(len(x)):
        K = P[t] @ H.T @ np.linalg.inv(S[t])
        means = np.array([x[t], *(x[t] + K @ (z[j] - H @ x[t]) for j in range(len(z)))])
        covs = [P[t], *[P[t] - K @ S[t] @ K.T] * len(z)]
        x_new[t] = beta[t] @ means
        P_new[t] = sum(
            b * (C + np.outer(m - x_new[t], m - x_new[t])) for b, m, C in zip(beta[t], means, covs, strict=True)
        )
    return x_new, P_new


def ospa_by_permutation(D: FloatArray, c: float, p: float) -> float:
    """OSPA from distances (n, m), over all assignments of the smaller set."""
    D = D if D.shape[0] <= D.shape[1] else D.T
    n, m = D.shape
    if m == 0:
        return 0.0
    best = min(sum(min(D[i, j], c) ** p for i, j in enumerate(perm)) for perm in permutations(range(m), n))
    return float(((best + c**p * (m - n)) / m) ** (1 / p))


def gospa_by_permutation(D: FloatArray, c: float, p: float, alpha: float) -> float:
    """GOSPA from distances (n, m), by its definition over all assignments of the smaller set."""
    D = D if D.shape[0] <= D.shape[1] else D.T
    n, m = D.shape
    best = min(sum(min(D[i, j], c) ** p for i, j in enumerate(perm)) for perm in permutations(range(m), n))
    return float((best + c**p / alpha * (m - n)) ** (1 / p))


def gospa_by_subsets(D: FloatArray, c: float, p: float) -> float:
    """GOSPA for alpha = 2 by its other form: over all sets of pairs, c^p / 2 for each that is single."""
    n, m = D.shape
    best = np.inf
    for event in product(range(-1, m), repeat=n):
        taken = [j for j in event if j >= 0]
        if len(taken) == len(set(taken)):
            near = sum(D[i, j] ** p for i, j in enumerate(event) if j >= 0)
            best = min(best, near + c**p / 2 * (n + m - 2 * len(taken)))
    return float(best ** (1 / p))


def t_gospa_with_dummies(X: FloatArray, Y: FloatArray, *, c: float, p: float, gamma: float, rho: float) -> float:
    """T-GOSPA of (n, t, d), (m, t, d) by the full linear program: all pairs, all times, dummies included."""
    (n, n_times), m = X.shape[:2], len(Y)
    shape = (n_times, n + 1, m + 1)
    cost = np.zeros(shape)
    for k, i, j in np.ndindex(shape):
        has_x = i < n and not np.isnan(X[i, k, 0])
        has_y = j < m and not np.isnan(Y[j, k, 0])
        if has_x and has_y:
            cost[k, i, j] = min(float(np.linalg.norm(X[i, k] - Y[j, k])), c) ** p
        else:
            cost[k, i, j] = ((1 - rho) * has_x + rho * has_y) * c**p
    w = np.arange(cost.size).reshape(shape)
    n_changes = (n_times - 1) * n * m
    change = cost.size + np.arange(n_changes).reshape(n_times - 1, n, m)
    equal = np.zeros((n_times * (n + m), cost.size + n_changes))
    for row, (k, i) in enumerate(product(range(n_times), range(n))):
        equal[row, w[k, i]] = 1
    for row, (k, j) in enumerate(product(range(n_times), range(m)), start=n_times * n):
        equal[row, w[k, :, j]] = 1
    limit = np.zeros((2 * n_changes, equal.shape[1]))
    for row, index in enumerate(np.ndindex(change.shape)):
        k, i, j = index
        for sign, at in ((1, row), (-1, n_changes + row)):
            limit[at, w[k + 1, i, j]], limit[at, w[k, i, j]], limit[at, change[index]] = sign, -sign, -1
    solution = linprog(
        np.concatenate([cost.ravel(), np.full(n_changes, gamma**p / 2)]),
        A_eq=equal, b_eq=np.ones(len(equal)), A_ub=limit, b_ub=np.zeros(len(limit)),
    )  # fmt: skip
    assert solution.success
    return float(max(solution.fun, 0.0) ** (1 / p))
