"""Joint association of tracks and measurements: exact marginals of JPDA and JIPDA.

A joint event gives each track one measurement or none, and no measurement twice; its weight is the
product of W_t0 (missed) and W_tj (paired). Fortmann, Bar-Shalom & Scheffe 1983; with existence
Musicki & Evans 2004. Exact wherever `exact_limit` columns at a time suffice, in particular for a
group with that many tracks or measurements; loopy belief propagation beyond, or the likeliest joint
events by Murty's method (extended, sec. 3.2), and said so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maritrack.associate.groups import connected_groups
from maritrack.associate.matchings import frontier, loopy, potentials, row_order, small_groups
from maritrack.associate.murty import murty_marginals
from maritrack.types import FloatArray, IntArray

MIN_MISSED = 1e-12  # least W_t0: with P_D P_G r = 1 a track without measurement would void every event
SMALL_COLS = ((1, 3), (4, 6))  # groups whose shorter side is within a range are solved together ...
SMALL_ROWS = 12  # ... if the longer one is not above this
MAX_ORDERED = 200  # rows of a group whose best order is searched for
MOST_MURTY = 60  # tracks of a group, or one event would take too long
MURTY_SOLVES = 4000  # assignment problems of a group, as many an event as it has tracks
SAFE_LOG = 600.0  # sums of offsets up to this stay within a double without `potentials`


@dataclass(frozen=True, slots=True, eq=False)
class JointMarginals:
    """Marginals of a joint association; column 0 = missed."""

    beta: FloatArray  # (t, 1 + m) association probabilities, rows sum to 1
    existence: FloatArray  # (t,) posterior
    beta_given_existence: FloatArray  # (t, 1 + m) weights of the state update; zero where existence is 0
    exact: bool  # False: some group was beyond the limit


def joint_marginals(
    likelihood: FloatArray,
    valid: ArrayLike,
    *,
    p_detect: ArrayLike,
    p_gate: float,
    clutter_density: ArrayLike,
    existence: ArrayLike,
    exact_limit: int = 12,
) -> JointMarginals:
    """JIPDA from likelihoods N (t, m), not divided by P_G, that count where `valid` (t, m).

    W_t0 = 1 - P_D P_G r, W_tj = P_D r N / lambda; existence r (t,) all ones is JPDA. `p_detect`
    is one number or (t,), `clutter_density` one number, (m,) or (t, m) in the unit of N.
    ValueError for numbers out of range.
    """
    N = np.asarray(likelihood, dtype=np.float64)
    shape = N.shape
    if N.ndim != 2 or np.shape(valid) != shape:
        raise ValueError(f"likelihood {shape} and valid {np.shape(valid)} must be one table (tracks, measurements)")
    r = np.broadcast_to(np.asarray(existence, dtype=np.float64), shape[:1])
    P_D = np.broadcast_to(np.asarray(p_detect, dtype=np.float64), shape[:1])
    track, measurement = np.nonzero(np.asarray(valid, dtype=bool))
    N, lam = N[track, measurement], np.broadcast_to(np.asarray(clutter_density, dtype=np.float64), shape)
    _check_inputs(N, P_D, p_gate, lam, r)
    with np.errstate(divide="ignore"):
        log_weight = np.log(N) - np.log(lam[track, measurement]) + np.log(P_D * r)[track]
    log_missed = log_missed_weight(r, p_detect=P_D, p_gate=p_gate)
    beta_pairs, beta_missed, n_inexact = sparse_marginals(
        track, measurement, log_weight, log_missed, *shape, exact_limit=exact_limit
    )
    posterior, b_pairs, b_missed = existence_update(track, beta_pairs, beta_missed, r, p_detect=P_D, p_gate=p_gate)
    beta, given = np.zeros((shape[0], 1 + shape[1])), np.zeros((shape[0], 1 + shape[1]))
    beta[:, 0], given[:, 0] = beta_missed, b_missed
    beta[track, 1 + measurement], given[track, 1 + measurement] = beta_pairs, b_pairs
    return JointMarginals(beta, posterior, given, n_inexact == 0)


def _check_inputs(N: FloatArray, P_D: FloatArray, P_G: float, lam: FloatArray, r: FloatArray) -> None:
    if not np.all((lam > 0.0) & np.isfinite(lam)):
        raise ValueError("clutter_density must be greater than 0")
    if not 0.0 < P_G <= 1.0:
        raise ValueError(f"p_gate = {P_G} is not within (0, 1]")
    for name, value in (("p_detect", P_D), ("existence", r)):
        if not np.all((value >= 0.0) & (value <= 1.0)):
            raise ValueError(f"{name} is not within 0..1")
    if not np.all((N >= 0.0) & np.isfinite(N)):
        raise ValueError("likelihood must be finite and not negative")


def log_missed_weight(existence: FloatArray, *, p_detect: ArrayLike, p_gate: float) -> FloatArray:
    """log W_t0 (t,) = log(1 - P_D P_G r), at least log(MIN_MISSED)."""
    return np.log(np.maximum(1.0 - np.asarray(p_detect) * p_gate * existence, MIN_MISSED))


def existence_update(
    track: IntArray,
    beta: FloatArray,
    beta_missed: FloatArray,
    existence: FloatArray,
    *,
    p_detect: ArrayLike,
    p_gate: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Posterior existence (t,), and the association weights given existence of pairs (k,) and misses (t,).

    A missed track may exist all the same, with probability (1 - P_D P_G) r / (1 - P_D P_G r); an
    associated one does. Weights are zero where the posterior existence is.
    """
    q = np.broadcast_to(np.asarray(p_detect, dtype=np.float64) * p_gate, existence.shape)
    missable = 1.0 - q * existence
    if_missed = np.divide((1.0 - q) * existence, missable, out=np.zeros(len(existence)), where=missable > 0.0)
    missed = if_missed * beta_missed
    posterior = missed + np.bincount(track, beta, minlength=len(existence))
    divisor = np.where(posterior > 0.0, posterior, 1.0)
    return np.minimum(posterior, 1.0), beta / divisor[track], missed / divisor


def sparse_marginals(
    track: IntArray,
    measurement: IntArray,
    log_weight: FloatArray,
    log_missed: FloatArray,
    n_tracks: int,
    n_measurements: int,
    *,
    exact_limit: int = 12,
    murty: int = 0,
) -> tuple[FloatArray, FloatArray, int]:
    """Marginals of pairs (k,) and of misses (t,) from log weights, and the number of inexact groups.

    `track`, `measurement` (k,) name each possible pair once, in any order; log_weight (k,) = log W_tj
    may be -inf, log_missed (t,) = log W_t0 may not. With exact_limit 0 every group is inexact: by belief propagation,
    or where `murty` > 0 and the group is not above 60 tracks, by that many of the best events.   Eq: polar-8
    """
    if not np.all(np.isfinite(log_missed)) or not np.all(log_weight < np.inf):
        raise ValueError("log_missed must be finite and log_weight less than inf")
    with np.errstate(under="ignore"):
        possible = log_weight > -np.inf
        load = np.bincount(measurement[possible], minlength=n_measurements)
        shared = possible & (load[measurement] > 1)
        private = possible & ~shared
        log_free = _log_add(log_missed, track[private], log_weight[private])
        beta, n_inexact, free = np.zeros(len(track)), 0, np.ones(n_tracks)
        if shared.any():
            t = track[shared]
            beta[shared], n_inexact = _shared(
                t, measurement[shared], log_weight[shared] - log_free[t], exact_limit, murty
            )
            free = np.clip(1.0 - np.bincount(t, beta[shared], minlength=n_tracks), 0.0, 1.0)
        # A measurement of one track only is in nobody's way: it splits what the others leave.
        t = track[private]
        beta[private] = np.exp(log_weight[private] - log_free[t]) * free[t]
        return beta, np.exp(log_missed - log_free) * free, n_inexact


def _log_add(log_start: FloatArray, index: IntArray, log_term: FloatArray) -> FloatArray:
    """log of exp(log_start) plus the exponentials of the terms at their index."""
    top = log_start.copy()
    np.maximum.at(top, index, log_term)
    total = np.exp(log_start - top) + np.bincount(index, np.exp(log_term - top[index]), minlength=len(top))
    return np.asarray(top + np.log(total), dtype=np.float64)


def _shared(
    track: IntArray, measurement: IntArray, log_psi: FloatArray, limit: int, murty: int
) -> tuple[FloatArray, int]:
    """Pair probabilities (k,) from log psi = log W_tj - log W_t(none of these), and inexact groups."""
    groups = connected_groups(track, measurement)
    longer = np.maximum(groups.n_tracks, groups.n_measurements)
    shorter = np.minimum(groups.n_tracks, groups.n_measurements)
    swap = (groups.n_tracks < groups.n_measurements)[groups.group]
    row = np.where(swap, groups.measurement, groups.track)
    col = np.where(swap, groups.track, groups.measurement)
    beta, n_inexact = np.zeros(len(track)), 0
    left = np.ones(len(groups), dtype=bool)
    for least, most in SMALL_COLS:
        small = (shorter >= least) & (shorter <= min(most, limit)) & (longer <= SMALL_ROWS)
        mine = np.flatnonzero(small[groups.group])
        if len(mine):
            number = np.cumsum(small) - 1
            beta[mine] = _solve_small((number[groups.group[mine]], row[mine], col[mine]), log_psi[mine])
        left &= ~small
    for g in np.flatnonzero(left).tolist():
        mine = np.flatnonzero(groups.group == g)
        exact = _solve_large(row[mine], col[mine], log_psi[mine], limit)
        n_inexact += exact is None
        if exact is None and murty > 0 and groups.n_tracks[g] <= MOST_MURTY:
            place = groups.track[mine], groups.measurement[mine]
            table = np.full((int(groups.n_tracks[g]), int(groups.n_measurements[g])), -np.inf)
            table[place] = log_psi[mine]
            beta[mine] = murty_marginals(table, min(murty, MURTY_SOLVES // len(table)))[place]
        else:  # tracks are the rows of the approximation, which sums to one over rows
            beta[mine] = loopy(track[mine], measurement[mine], log_psi[mine]) if exact is None else exact
    return beta, n_inexact


def _solve_small(place: tuple[IntArray, IntArray, IntArray], log_psi: FloatArray) -> FloatArray:
    """All small groups in one padded table; `place` = group, row and column of each pair."""
    table = np.full([int(x.max()) + 1 for x in place], -np.inf)
    table[place] = log_psi
    u = np.maximum(table.max(axis=2), 0.0)
    v = np.zeros((len(table), table.shape[2]))
    for g in np.flatnonzero(u.sum(axis=1) > SAFE_LOG).tolist():
        u[g], v[g] = potentials(table[g])
    return small_groups(table, u, v)[place]


def _solve_large(row: IntArray, col: IntArray, log_psi: FloatArray, limit: int) -> FloatArray | None:
    """One group, None if too many columns are open at a time for an exact answer."""
    n_rows, n_cols = int(row.max()) + 1, int(col.max()) + 1  # rows are the longer side
    if n_rows > MAX_ORDERED and n_cols > limit:
        return None  # the search for an order would cost more than it is worth
    table = np.full((n_rows, n_cols), -np.inf)
    table[row, col] = log_psi
    order, widest = row_order(table) if n_rows <= MAX_ORDERED else (np.argsort(table.max(axis=1)), n_cols)
    return frontier(table, order)[row, col] if widest <= limit else None
