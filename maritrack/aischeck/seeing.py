"""How likely a ship is seen by range, from the run itself, and what misses and echoes then mean.

Ships that are confirmed say how often they have an echo in each ring of range. Ships differ (size, aspect, sea): the
probability of one ship is taken to be Beta distributed about the mean of its rings, with the spread that the ships of
the run show. So the probability of as few echoes in so many looks, for a ship that is there, is that of a
beta-binomial; misses in a row by one ship are not independent, and are not counted as if they were. Neighbouring
looks are alike besides: `independent` says how many looks are worth one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maritrack.aischeck.looks import Looks
from maritrack.types import BoolArray, FloatArray, IntArray

EDGES_M = np.array([0, 500, 1000, 1500, 2000, 3000, 4000, 6000, 8000, 12000, 16000, 24000, 32000, 48000, 96000], float)
LEAST_LOOKS = 5.0  # independent ones, of other ships, that a ring's probability rests on
SPREAD_UNKNOWN, UNKNOWN_SHIPS = 0.3, 3.0  # between ships (intraclass correlation; 0 = all alike): as if so many said so
MOST_LAG = 12  # looks over which alikeness is measured


@dataclass(frozen=True, slots=True, eq=False)
class Seeing:
    """Echoes of confirmed ships by ship (s) and ring (r)."""

    looks: FloatArray  # (s, r)
    hits: FloatArray  # (s, r)
    independent: float  # so many looks are worth one, >= 1
    spread: float  # between ships

    def worth(self, without: int = -1) -> tuple[FloatArray, FloatArray]:
        """Looks and hits (r,) of each ring as if all were independent, one ship left out.

        Looks at one ship are alike: n of them are worth n / (1 + (n - 1) spread), so many ships count for more.
        """
        others = np.arange(len(self.looks)) != without
        n = self.looks[others] / self.independent
        share = np.divide(self.hits[others], self.looks[others], out=np.zeros_like(n), where=n > 0)
        worth = n / (1.0 + np.maximum(n - 1.0, 0.0) * self.spread)
        return worth.sum(axis=0), (worth * share).sum(axis=0)

    def p_detect(self, without: int = -1) -> FloatArray:
        """Probability (r,) of an echo in each ring, one ship left out; nan where too little tells it."""
        others = np.arange(len(self.looks)) != without
        enough = self.looks[others].sum(axis=0) / self.independent >= LEAST_LOOKS
        n, h = self.worth(without)
        return np.where(enough, (h + 0.5) / (n + 1.0), np.nan)

    def interval(self) -> tuple[FloatArray, FloatArray]:
        """The 95 % interval (r,) of these probabilities (Jeffreys), of ships like these."""
        from scipy.stats import beta

        n, h = self.worth()
        return np.asarray(beta.ppf(0.025, h + 0.5, n - h + 0.5)), np.asarray(beta.ppf(0.975, h + 0.5, n - h + 0.5))

    def spread_of_another(self, without: int = -1) -> float:
        """Spread of a further ship about that probability, which is itself told by few ships."""
        others = np.arange(len(self.looks)) != without
        ships = int((self.looks[others] > 0).any(axis=1).sum())
        return min(self.spread * (1.0 + 1.0 / max(ships, 1)), 0.95)


def ring_of(range_m: FloatArray) -> IntArray:
    """The ring of each range (n,)."""
    return np.clip(np.searchsorted(EDGES_M, range_m, side="right") - 1, 0, len(EDGES_M) - 2).astype(np.int64)


def seeing_of(looks: Looks, confirmed: BoolArray) -> Seeing:
    """What the confirmed ships (s,) show. Hidden looks do not count."""
    n_ships, n_rings = len(confirmed), len(EDGES_M) - 1
    use = confirmed[looks.ship] & ~looks.hidden if len(looks.ship) else np.zeros(0, bool)
    n, h = np.zeros((n_ships, n_rings)), np.zeros((n_ships, n_rings))
    ship, ring = looks.ship[use], ring_of(looks.range_m[use])
    np.add.at(n, (ship, ring), 1.0)
    np.add.at(h, (ship, ring), looks.hit[use].astype(float))
    independent = alike(looks, use)
    return Seeing(n, h, independent, spread_of(n, h, independent))


def alike(looks: Looks, use: BoolArray) -> float:
    """How many looks are worth one: 1 + 2 sum of the correlations of the hits of a ship, while they are positive."""
    index = np.flatnonzero(use)
    index = index[np.lexsort((looks.scan[index], looks.ship[index]))]
    ship, hit = looks.ship[index], looks.hit[index].astype(float)
    if len(index) == 0:
        return 1.0
    mean = np.bincount(ship, hit) / np.maximum(np.bincount(ship), 1)
    d = hit - mean[ship]
    variance, total = float(np.mean(d**2)), 1.0
    for lag in range(1, MOST_LAG + 1):
        same = ship[lag:] == ship[:-lag]
        if variance <= 0 or not same.any():
            break
        correlation = float(np.mean((d[lag:] * d[:-lag])[same])) / variance
        if correlation <= 0.02:
            break
        total += 2.0 * correlation
    return total


def spread_of(n: FloatArray, h: FloatArray, independent: float) -> float:
    """Intraclass correlation between ships of one ring, by moments over all rings with two ships or more.

    Few ships say little about others: their spread is weighed, ship by ship, against one that is taken beforehand.
    """
    rings = np.flatnonzero((n > 0).sum(axis=0) >= 2)
    ships = int((n[:, rings] > 0).any(axis=1).sum()) - 1 if len(rings) else 0
    if ships < 1:
        return SPREAD_UNKNOWN
    n, h = n[:, rings] / independent, h[:, rings] / independent
    mean = (h.sum(axis=0) + 0.5) / (n.sum(axis=0) + 1.0)
    share = np.divide(h, n, out=np.zeros_like(h), where=n > 0)
    binomial = mean * (1.0 - mean)
    weight = np.where(n > 0, np.minimum(n, 10.0), 0.0)
    observed = float((weight * (share - mean) ** 2).sum())
    by_chance = float((weight * binomial * np.divide(1.0, n, out=np.zeros_like(n), where=n > 0)).sum())
    whole = float((weight * binomial).sum())
    own = float(np.clip((observed - by_chance) / whole, 0.0, 0.9)) if whole > 0 else 0.0
    return (ships * own + UNKNOWN_SHIPS * SPREAD_UNKNOWN) / (ships + UNKNOWN_SHIPS)


def p_so_few(hits: float, looks: float, mean: float, spread: float) -> float:
    """Probability of so few hits or fewer, of a ship that is there. Parts of looks count against saying it."""
    from scipy.stats import betabinom

    a, b = _beta(mean, spread)
    n = max(int(np.floor(looks)), 1)
    return float(betabinom.cdf(min(int(np.ceil(hits)), n), n, a, b))


def p_so_many(hits: float, looks: float, mean: float, spread: float) -> float:
    """Probability of so many hits or more, where nothing is there but what is beside. Parts of looks as above."""
    from scipy.stats import betabinom

    a, b = _beta(mean, spread)
    return float(betabinom.sf(int(np.floor(hits)) - 1, max(int(np.ceil(looks)), 1), a, b))


def _beta(mean: float, spread: float) -> tuple[float, float]:
    strength = 1.0 / spread - 1.0
    mean = min(max(mean, 1e-3), 1 - 1e-3)
    return mean * strength, (1.0 - mean) * strength
