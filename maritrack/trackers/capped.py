"""Objects out of particles: k-means whose clusters hold a weight of one object each, no more.

Vo, Singh, Doucet 2005 leave the clustering open; this is the capped one that the engm paper's numbers come from.
Particles have equal weights, so that a cap on weight is one on their number.
"""

from __future__ import annotations

import math

import numpy as np

from maritrack.types import FloatArray, IntArray


def capped_clusters(x: FloatArray, weight: float, rng: np.random.Generator) -> IntArray:
    """Cluster of each particle (n,), numbered from 0; each particle has this weight.

    Centres: a particle by chance takes the nearest ones that are left, up to a weight of 1; the centre is their mean;
    and so on until none is left. Then each particle goes to the nearest centre that has room, in their order.
    """
    n = len(x)
    room = n if weight * n <= 1.0 else max(1, math.floor(1.0 / weight + 1e-9))
    left = np.arange(n)
    centre = []
    while len(left):
        seed = x[left[rng.integers(len(left))]]
        far = ((x[left] - seed) ** 2).sum(axis=1)
        near = np.argpartition(far, room - 1)[:room] if room < len(left) else np.arange(len(left))
        centre.append(x[left[near]].mean(axis=0))
        left = np.delete(left, near)
    return nearest_with_room(((x[:, None] - np.array(centre)[None]) ** 2).sum(axis=2), room)


def nearest_with_room(cost: FloatArray, room: int) -> IntArray:
    """The cheapest column with room for each row (n,), row after row; `room` rows fit in a column.

    All rows ask at once, a column keeps the first of those who ever asked, the others ask their next: the same outcome.
    """
    n, k = cost.shape
    choice = np.argsort(cost, axis=1, kind="stable")
    asked = np.zeros(n, np.int64)
    while True:
        column = choice[np.arange(n), asked]
        order = np.argsort(column, kind="stable")  # by column, in it by row
        first = np.searchsorted(column[order], np.arange(k))
        place = np.empty(n, np.int64)
        place[order] = np.arange(n) - first[column[order]]
        refused = place >= room
        if not refused.any():
            return column
        asked[refused] += 1
