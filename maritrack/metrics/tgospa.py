"""T-GOSPA, a distance of two sets of trajectories that counts changes of partner.

Garcia-Fernandez, Rahmathullah & Svensson 2020; with rho other than one half the quasi-metric of
2025. The linear-programming form, solved exactly: the dummy trajectories are eliminated, and only
trajectories that ever come near each other, at the times when some do, meet in one program.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.optimize import linprog

from maritrack.associate.groups import connected_groups
from maritrack.errors import NumericalError
from maritrack.metrics.distances import check_order
from maritrack.types import FloatArray, IntArray

SCALE = 1e4  # gains are at most 1, and the solver is content with an error of 1e-7


@dataclass(frozen=True, slots=True)
class TGospa:
    """total^p = localisation_p + missed_p + false_p + switch_p, sums over time.

    The total is unique; where several assignments reach it the parts need not be. A hole in an
    estimate is a miss, not a switch.
    """

    total: float
    localisation_p: float
    missed_p: float  # (1 - rho) c^p for each truth state without a partner nearer than c
    false_p: float  # rho c^p for each such estimate state
    switch_p: float  # gamma^p for a change of partner, half of it for a gain or a loss
    n_switch: float  # switch_p / gamma^p; 0 where gamma is 0


@dataclass(frozen=True, slots=True, eq=False)
class _Links:
    """Pairs of trajectories that are nearer than c at some time."""

    truth: IntArray  # (q,)
    estimate: IntArray  # (q,)
    cost: FloatArray  # (q, t) (d / c)^p; inf where not nearer than c


def t_gospa(truth: ArrayLike, estimates: ArrayLike, *, c: float, p: float, gamma: float, rho: float = 0.5) -> TGospa:
    """T-GOSPA of trajectories (n, t, d) and (m, t, d), nan where one does not exist.

    Cutoff c and switching penalty gamma in the unit of the positions, order p, 0 < rho < 1 the
    share of c^p that a false state costs. ValueError for arguments out of range.
    """
    check_order(c, p)
    if not 0.0 <= gamma < np.inf:
        raise ValueError(f"gamma = {gamma} must be at least 0 and finite")
    if not 0.0 < rho < 1.0:
        raise ValueError(f"rho = {rho} is not within (0, 1)")
    X, n_truth = _trajectories("truth", truth)
    Y, n_estimates = _trajectories("estimates", estimates)
    if len(X) and len(Y) and X.shape[1:] != Y.shape[1:]:
        raise ValueError(f"truth {X.shape} and estimates {Y.shape} differ in times or dimensions")
    localisation = paired = changes = 0.0  # in units of c^p, so that no unit of length and no order matters
    with np.errstate(over="ignore", under="ignore"):
        switch = np.power(np.float64(gamma) / c, p)
        links = _links(X / c, Y / c, p)
        groups = connected_groups(links.truth, links.estimate)
        for g in range(len(groups)):
            mine = np.flatnonzero(groups.group == g)
            cost = links.cost[mine]
            cost = cost[:, np.isfinite(cost).any(axis=0)]
            near = np.isfinite(cost)
            gain = np.where(near, 1.0 - cost, 0.0)
            dear = cost.shape[1] + 1.0  # half a change for more than this gains nothing: better without
            share = _shares(groups.track[mine], groups.measurement[mine], gain, min(float(switch) / 2.0, dear))
            localisation += float((share[near] * cost[near]).sum())
            paired += float(share[near].sum())
            changes += float(np.abs(np.diff(share, axis=1)).sum()) / 2.0 if switch / 2.0 < dear else 0.0
        missed = (1.0 - rho) * max(n_truth - paired, 0.0)
        false = rho * max(n_estimates - paired, 0.0)
        switched = float(switch) * changes if changes else 0.0
        unit = np.power(np.float64(c), p)  # may be too large for a float, as the parts then are
        localisation_p, missed_p, false_p, switch_p = (
            float(part * unit) if part else 0.0 for part in (localisation, missed, false, switched)
        )
        total = c * (localisation + missed + false + switched) ** (1.0 / p)
    return TGospa(total, localisation_p, missed_p, false_p, switch_p, changes if gamma > 0.0 else 0.0)


def _trajectories(name: str, values: ArrayLike) -> tuple[FloatArray, int]:
    """Trajectories (n, t, d), (0, 0, 0) if there are none, and the number of their states."""
    states = np.asarray(values, dtype=np.float64)
    if states.size == 0:
        return np.zeros((0, 0, 0)), 0
    if states.ndim != 3:
        raise ValueError(f"{name} must be of shape (trajectories, times, dimensions), not {states.shape}")
    absent = np.isnan(states)
    if np.any(np.isinf(states)) or np.any(absent.any(axis=2) != absent.all(axis=2)):
        raise ValueError(f"{name} has a state that is not finite, or nan in part")
    return states, int((~absent[:, :, 0]).sum())


def _links(X: FloatArray, Y: FloatArray, p: float) -> _Links:
    """Pairs that come nearer than 1."""
    truth, estimate, cost = [], [], [np.zeros((0, X.shape[1]))]
    for i in range(len(X) if len(Y) else 0):
        distance = np.linalg.norm(Y - X[i], axis=2)
        distance[~(distance < 1.0)] = np.inf  # absent ones are nan
        near = np.flatnonzero(np.isfinite(distance).any(axis=1))
        truth.append(np.full(len(near), i))
        estimate.append(near)
        cost.append(distance[near] ** p)
    none = [np.empty(0, dtype=np.int64)]
    return _Links(np.concatenate(none + truth), np.concatenate(none + estimate), np.concatenate(cost))


def _shares(truth: IntArray, estimate: IntArray, gain: FloatArray, half_switch: float) -> FloatArray:
    """Shares (q, t) of the pairs of a group that maximise gain minus the cost of changes."""
    if len(gain) == 1:
        return np.ones_like(gain)
    if truth.max() == 0 or estimate.max() == 0:
        return _best_path(gain, half_switch)
    return _linear_program(truth, estimate, gain, half_switch)


def _best_path(gain: FloatArray, half_switch: float) -> FloatArray:
    """Shares where all pairs have one trajectory in common: a shortest path, on which the program is tight."""
    n_pairs, n_times = gain.shape
    states = np.arange(n_pairs + 1)  # the last: no partner
    reward = np.vstack([gain, np.zeros(n_times)])
    half = np.append(np.full(n_pairs, half_switch), 0.0)  # a change passes through "no partner", half each way
    score, back = np.zeros(n_pairs + 1), np.zeros((n_times, n_pairs + 1), dtype=np.int64)
    for k in range(n_times):
        origin = np.argmax(score - half)
        changed = (score - half)[origin] - half
        stays = score >= changed
        back[k] = np.where(stays, states, origin)
        score = np.where(stays, score, changed) + reward[:, k]
    share = np.zeros((n_pairs + 1, n_times))
    state = int(np.argmax(score))
    for k in reversed(range(n_times)):
        share[state, k] = 1.0
        state = back[k, state]
    return share[:-1]


def _linear_program(truth: IntArray, estimate: IntArray, gain: FloatArray, half_switch: float) -> FloatArray:
    """Shares y of pair and time: maximise sum gain y - half_switch |y_k+1 - y_k|, no trajectory used twice."""
    n_pairs, n_times = gain.shape
    n_y, n_steps = gain.size, gain.size - n_pairs  # unknowns: y by time and pair, then rises, then falls
    y = np.arange(n_y).reshape(n_times, n_pairs)
    step = np.arange(n_steps)
    changes = sparse.csc_array(
        (
            np.repeat([1.0, -1.0, -1.0, 1.0], n_steps),
            (np.tile(step, 4), np.concatenate([step + n_pairs, step, step + n_y, step + n_y + n_steps])),
        ),
        shape=(n_steps, n_y + 2 * n_steps),
    )
    owner = np.concatenate([truth, truth.max() + 1 + estimate])
    crowded = np.bincount(owner) > 1  # a trajectory with one pair is held by the bound of that
    owner, pair = owner[crowded[owner]], np.tile(np.arange(n_pairs), 2)[crowded[owner]]
    rows = np.arange(n_times)[:, None] * len(crowded) + owner
    once = sparse.csc_array(
        (np.ones(rows.size), (rows.ravel(), y[:, pair].ravel())),
        shape=(n_times * len(crowded), n_y + 2 * n_steps),
    )
    solution = linprog(
        SCALE * np.concatenate([-gain.T.ravel(), np.full(2 * n_steps, half_switch)]),
        A_ub=once,
        b_ub=np.ones(once.shape[0]),
        A_eq=changes,
        b_eq=np.zeros(n_steps),
        bounds=(0.0, 1.0),
        method="highs",
    )
    if not solution.success:
        raise NumericalError(f"T-GOSPA: {n_pairs} pairs at {n_times} times: {solution.message}")
    return np.asarray(solution.x[:n_y], dtype=np.float64).reshape(n_times, n_pairs).T
