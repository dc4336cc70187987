"""Which points belong together, and to whom: stochastic optimisation of an association.

Granstroem, Renter, Fatemi, Svensson 2017. The state gives each point to a slot, an object that is followed or may be
new, or to clutter. An iteration picks a point by chance and gives it to a slot as likely as that makes the whole, or
with one chance in five moves a block: all points of a slot, a half of them, or a cell. What is asked for is the set of
likely states that were visited. Iterations that change nothing are not carried out but counted, as many as chance has
of them: the chain is the same, its cost that of its changes.

Objects are linear and Gaussian here, about a fit that the caller has: point i of a slot is y_i = A_i x + e with e of
unit variance, x Gaussian with information `info` and mean zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import expit, gammaln

from maritrack.types import BoolArray, FloatArray, IntArray

CLUTTER = -1
BLOCK_SHARE = 0.2
PATIENCE = 12  # changes that lead to nothing new that is likely, after which a chain ends
LIKELY = 7.0  # log weight below the best


@dataclass(frozen=True, slots=True, eq=False)
class Slots:
    """Objects (s,) that points (n,) may be of, each of d dimensions."""

    A: FloatArray  # (s, n, 2, d)
    y: FloatArray  # (s, n, 2)
    log_point: FloatArray  # (s, n) of the noise's density at its mean, against clutter; -inf where it can't be
    info: FloatArray  # (s, d, d)
    log_base: FloatArray  # (s,) of an object with points against one without, but for points and their number
    rate: FloatArray  # (s, 2) gamma density of their number


class Visited(NamedTuple):
    """Associations that were visited, the likeliest first."""

    slot: IntArray  # (m, n) of each point, -1 = clutter
    log_w: FloatArray  # (m,) against all clutter
    spent: IntArray  # (m,) iterations in each


def sample(
    slots: Slots, start: IntArray, cell: IntArray, z: FloatArray, *, iterations: int, most_moves: int, most: int,
    rng: np.random.Generator, block_share: float = BLOCK_SHARE,
) -> Visited:  # fmt: skip
    """Associations that a chain from `start` (n,) visits; `cell` (n,) and place z (n, 2) say what blocks there are.

    With block_share = 0 it is Gibbs sampling, whose time in a state tends to the state's probability; else the chain
    ends when it finds nothing likely any more.
    """
    state = start.copy()
    n, s = len(state), len(slots.log_base)
    log_w = {state.tobytes(): float(totals(slots, np.arange(s), _masks(state, s)).sum())}
    spent = dict.fromkeys(log_w, 0)
    left, gain, stale = iterations, np.zeros((n, s + 1)), np.arange(s)
    best, idle = max(log_w.values()), 0
    for _ in range(most_moves):
        gain[:, stale] = gains(slots, stale, _masks(state, s)[stale]).T
        share = _softmax(gain)
        own = np.where(state >= 0, state, s)
        leave = 1.0 - share[np.arange(n), own]
        blocks, accept, to = _blocks(slots, state, cell, z) if block_share > 0 else ([], np.zeros(0), own[:0])
        by_point = (1.0 - block_share) * leave.mean()
        rate = by_point + (block_share * accept.mean() if len(accept) else 0.0)
        stays = min(int(rng.geometric(min(rate, 1.0))), left + 1) if rate > 1e-12 else left + 1
        spent[state.tobytes()] += min(stays, left)
        left -= stays
        if left < 0:
            break
        before = state.copy()
        if rng.random() * rate < by_point:
            i = int(rng.choice(n, p=leave / leave.sum()))
            p = share[i].copy()
            p[own[i]] = 0.0
            target = int(rng.choice(s + 1, p=p / p.sum()))
            state[i] = target if target < s else CLUTTER
        else:
            k = int(rng.choice(len(accept), p=accept / accept.sum()))
            state[blocks[k]] = to[k]
        touched = np.unique(np.concatenate([before[before != state], state[before != state]]))
        stale = touched[touched >= 0]
        idle += 1
        if state.tobytes() not in log_w:
            log_w[state.tobytes()] = found_w = float(totals(slots, np.arange(s), _masks(state, s)).sum())
            spent[state.tobytes()] = 0
            idle = 0 if found_w > best - LIKELY else idle
            best = max(best, found_w)
        if block_share > 0 and idle >= PATIENCE:
            break
    found = sorted(log_w, key=lambda key: -log_w[key])[:most]
    rows = [np.frombuffer(key, start.dtype) for key in found]
    return Visited(
        np.array(rows), np.array([log_w[key] for key in found]), np.array([spent[key] for key in found], np.int64)
    )


def _masks(state: IntArray, s: int) -> BoolArray:
    return np.asarray(state == np.arange(s)[:, None])


def _softmax(x: FloatArray) -> FloatArray:
    p = np.exp(x - x.max(axis=1, keepdims=True))
    return np.asarray(p / p.sum(axis=1, keepdims=True))


def log_number(rate: FloatArray, n: FloatArray) -> FloatArray:
    """Log likelihood of so many points; see `maritrack.objects.rate`."""
    a, b = rate[:, 0], rate[:, 1]
    return np.asarray(gammaln(a + n) - gammaln(a) + a * np.log(b) - (a + n) * np.log(b + 1.0))


def totals(slots: Slots, which: IntArray, mask: BoolArray) -> FloatArray:
    """Log weight (m,) of slots `which` (m,) with points `mask` (m, n), against those points as clutter."""
    n = mask.sum(axis=1).astype(np.float64)
    w = mask.astype(np.float64)
    flat = slots.A.reshape(*slots.A.shape[:1], -1, slots.A.shape[-1])[which]  # (m, 2n, d)
    twice = np.repeat(w, 2, axis=1)
    weighted = flat * twice[..., None]
    info = slots.info[which] + weighted.transpose(0, 2, 1) @ flat
    y = slots.y.reshape(len(slots.y), -1)[which]
    b = (weighted.transpose(0, 2, 1) @ y[..., None])[..., 0]
    L = np.linalg.cholesky(info)
    half = np.linalg.solve(L, b[..., None])[..., 0]
    prior = np.linalg.slogdet(slots.info)[1][which]
    log_det = 2.0 * np.log(np.diagonal(L, axis1=1, axis2=2)).sum(axis=1) - prior
    square = (y**2 * twice).sum(axis=1) - (half**2).sum(axis=1)
    point = np.where(mask, slots.log_point[which], 0.0).sum(axis=1)
    full = slots.log_base[which] + log_number(slots.rate[which], n) + point - 0.5 * (log_det + square)
    return np.where(n > 0, full, 0.0)


def gains(slots: Slots, which: IntArray, mask: BoolArray) -> FloatArray:
    """What each point (m, n) adds to the log weight of slots with points `mask` (m, n): if it joins, or by staying.

    By the predictive density of the point given the others: for a point that is in, the others are those without it,
    whose innovation and covariance follow from the residual with it.
    """
    w = mask.astype(np.float64)
    A = slots.A[which]
    m, n, _, d = A.shape
    flat = A.reshape(m, 2 * n, d)
    weighted = flat * np.repeat(w, 2, axis=1)[..., None]
    info = slots.info[which] + weighted.transpose(0, 2, 1) @ flat
    b = (weighted.transpose(0, 2, 1) @ slots.y[which].reshape(m, 2 * n, 1))[..., 0]
    cov = np.linalg.inv(info)
    mean = (cov @ b[..., None])[..., 0]
    spread = np.einsum("mnad,mnbd->mnab", (flat @ cov).reshape(m, n, 2, d), A)
    sign = np.where(mask, -1.0, 1.0)
    S = np.eye(2) + sign[..., None, None] * spread
    v = slots.y[which] - (flat @ mean[..., None]).reshape(m, n, 2)
    det = S[..., 0, 0] * S[..., 1, 1] - S[..., 0, 1] * S[..., 1, 0]
    det = np.maximum(det, 1e-300)
    form = (
        S[..., 1, 1] * v[..., 0] ** 2 - (S[..., 0, 1] + S[..., 1, 0]) * v[..., 0] * v[..., 1]
        + S[..., 0, 0] * v[..., 1] ** 2
    ) / det  # fmt: skip
    count = w.sum(axis=1)[:, None] - w  # of the others
    rate = np.repeat(slots.rate[which], n, axis=0)
    without = np.where(count > 0, log_number(rate, count.ravel()).reshape(m, n), 0.0)
    more = log_number(rate, count.ravel() + 1.0).reshape(m, n) - without
    first = np.where(count > 0, 0.0, slots.log_base[which][:, None])
    return np.asarray(slots.log_point[which] - 0.5 * (sign * np.log(det) + form) + more + first)


def halves(z: FloatArray) -> BoolArray:
    """Which points (n,) lie on one side of their middle, along their longer axis; none if all are in one place."""
    gap = z - z.mean(axis=0)
    c = gap.T @ gap
    angle = 0.5 * np.arctan2(2.0 * c[0, 1], c[0, 0] - c[1, 1])
    return np.asarray(gap @ np.array([np.cos(angle), np.sin(angle)]) > 1e-6)


def _blocks(
    slots: Slots, state: IntArray, cell: IntArray, z: FloatArray
) -> tuple[list[IntArray], FloatArray, IntArray]:
    """Blocks of points that might move, the chance that they do, and where to."""
    s = len(slots.log_base)
    sets: list[IntArray] = []
    for slot in np.unique(state[state >= 0]).tolist():
        mine = np.flatnonzero(state == slot)
        sets.append(mine)
        if len(mine) >= 4:
            side = halves(z[mine])
            sets += [mine[side], mine[~side]] if side.any() else []
        inner = cell[mine]
        cells = np.unique(inner)
        if len(cells) > 1:
            sets += [mine[inner == c] for c in cells.tolist()]
    for c in np.unique(cell[state < 0]).tolist():
        mine = np.flatnonzero((cell == c) & (state < 0))
        if len(mine) > 1:
            sets.append(mine)
    if not sets:
        return [], np.zeros(0), np.zeros(0, np.int64)
    masks, k = _masks(state, s), len(sets)
    source = np.array([state[one[0]] for one in sets])
    member = np.zeros((k, len(state)), bool)
    for number, one in enumerate(sets):
        member[number, one] = True
    joined = np.repeat(masks, k, axis=0) | np.tile(member, (s, 1))
    possible = np.array([[np.isfinite(slots.log_point[b, one]).all() for one in sets] for b in range(s)])
    now = totals(slots, np.arange(s), masks)
    at = np.flatnonzero(possible.ravel())
    after = np.full(s * k, -np.inf)
    after[at] = totals(slots, np.repeat(np.arange(s), k)[at], joined[at]) - now[np.repeat(np.arange(s), k)[at]]
    held = np.where(source >= 0, source, 0)
    left = totals(slots, held, masks[held] & ~member) - now[held]
    left = np.where(source >= 0, left, 0.0)
    change = np.concatenate([after.reshape(s, k), np.zeros((1, k))]) + left
    change[np.where(source >= 0, source, s), np.arange(k)] = -np.inf
    to, which = np.nonzero(np.isfinite(change))
    accept = expit(change[to, which])
    blocks = [sets[number] for number in which.tolist()]
    return blocks, np.asarray(accept, np.float64), np.where(to < s, to, CLUTTER)
