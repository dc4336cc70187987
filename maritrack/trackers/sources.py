"""Where new objects come from: births on a ring or anywhere, and what the mixture gave back to the undetected."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from maritrack import geo
from maritrack.objects import matrix2, rate
from maritrack.settings import Config
from maritrack.trackers import bernoullis, tracklist, undetected
from maritrack.trackers.bernoullis import Bernoullis
from maritrack.trackers.cells import Cells, Fits
from maritrack.trackers.pointmodels import PointModel
from maritrack.types import FloatArray, IntArray, Scan


@dataclass(frozen=True, slots=True, eq=False)
class Sources:
    """Poisson components; those that are born in this scan come first."""

    rows: Bernoullis  # `existence` = objects expected
    fits: Fits
    home: IntArray  # (n,) of each point its component, where births are anywhere: one at each cell; else none
    n_born: int

    def weigh(self, cells: Cells, some: list[int], scan: Scan, config: Config) -> tuple[FloatArray, IntArray]:
        """Log weight (k,) of cells as new objects against clutter, and the likeliest source of each.

        What other components would add near a cell is counted by their density at its centroid, not fitted.
        """
        middle = self._middle(cells, some)
        density, source = self._log_density(cells, some, middle, config)
        best = density.argmax(axis=1)
        at = np.arange(len(some))
        others = np.logaddexp.reduce(density, axis=1) - density[at, best]
        chosen = source[at, best]
        pairs = list(zip(chosen.tolist(), some, strict=True))
        self.fits.need(pairs)
        n = cells.sizes(some)
        seen = geo.visible(scan, middle, config.input.roi_min_m, config.input.roi_max_m)
        with np.errstate(divide="ignore"):
            log_u = np.log(self.rows.tracks.existence[chosen] * config.model.p_detect * seen) + others
        log_kappa = math.log(config.model.clutter_density_per_m2)
        log_u += rate.log_count(self.rows.rate[chosen], n) + self.fits.log_l(pairs) - n * log_kappa
        return log_u, chosen

    def made(self, cells: Cells, some: list[int], source: list[int]) -> Bernoullis:
        """The rows of new objects."""
        pairs = list(zip(source, some, strict=True))
        self.fits.need(pairs)
        fitted = self.fits.fitted(pairs)
        return replace(fitted, rate=rate.update(self.rows.rate[np.array(source, np.int64)], cells.sizes(some)))

    def bound(self, cells: Cells, n_cells: int, log_kappa: float, config: Config) -> FloatArray:
        """What the weight (c,) of cells of one point comes to, infinite for others: those are to be fitted."""
        n = cells.sizes(range(n_cells))
        single = np.flatnonzero(n == 1).tolist()
        out = np.full(n_cells, np.inf)
        if single:
            density, _ = self._log_density(cells, single, self._middle(cells, single), config)
            first = np.array([[config.pmbm.rate_shape, config.pmbm.rate_scale]])
            seen = math.log(max(config.model.p_detect, 1e-12)) + rate.log_count(first, np.ones(1))[0] - log_kappa
            out[single] = np.logaddexp.reduce(density, axis=1) + seen
        return out

    def _middle(self, cells: Cells, some: list[int]) -> FloatArray:
        return np.array([cells.z[cells.points[c]].mean(axis=0) for c in some]).reshape(-1, 2)

    def _log_density(
        self, cells: Cells, some: list[int], at_m: FloatArray, config: Config
    ) -> tuple[FloatArray, IntArray]:
        """Log of the objects expected a m^2 (k, q) at cells, and which component (k, q) that is."""
        k, m = len(some), len(self.rows)
        if len(self.home) == 0:
            which = np.arange(m)
            return self._gaussians(at_m, which), np.broadcast_to(which, (k, m))
        own = np.array([self.home[cells.points[c][0]] for c in some], np.int64)
        back = np.arange(self.n_born, m)
        with np.errstate(divide="ignore"):
            everywhere = np.full((k, 1), np.log(config.tracker.birth_density_per_m2))
        density = np.concatenate([everywhere, self._gaussians(at_m, back)], axis=1)
        return density, np.concatenate([own[:, None], np.broadcast_to(back, (k, len(back)))], axis=1)

    def _gaussians(self, at_m: FloatArray, which: IntArray) -> FloatArray:
        d, mu = self.rows.tracks.density, self.rows.tracks.existence[which]
        inv = matrix2.inverse(d.P[which, :2, :2])
        gap = at_m[:, None] - d.x[which, :2]
        form = np.einsum("kmi,mij,kmj->km", gap, inv, gap)
        with np.errstate(divide="ignore"):
            log_mu = np.log(mu) + 0.5 * np.log(matrix2.det(inv)) - math.log(2.0 * math.pi)
        return np.asarray(log_mu - 0.5 * form)


def sources(
    poisson: Bernoullis, cells: Cells, n_cells: int, scan: Scan, config: Config, model: PointModel
) -> Sources:  # fmt: skip
    """The births of a scan and the Poisson components there are.

    With `pmbm.birth` = "uniform" objects appear anywhere, `tracker.birth_density_per_m2` of them: around each cell
    that is a broad Gaussian of that density. Its weight is 2 pi sigma^2 of it.
    """
    rules = config.pmbm
    if rules.birth == "ring":
        at, mu = undetected.ring(scan.position_m, rules)
    else:
        at = np.array([cells.z[cells.points[c]].mean(axis=0) for c in range(n_cells)]).reshape(-1, 2)
        b = config.tracker.birth_density_per_m2
        mu = np.full(len(at), b * 2.0 * math.pi * rules.birth_sigma_m**2)
    m = len(at)
    blank = bernoullis.nothing(model.states)
    tracks = blank_tracks(m, scan.t_ns, mu)
    rows = Bernoullis(
        tracks, np.tile([rules.rate_shape, rules.rate_scale], (m, 1)), np.zeros((m, blank.x.shape[1])),
        np.zeros((m, *blank.P.shape[1:])),
    )  # fmt: skip
    rows = bernoullis.join([model.newborn(rows, at, rules.birth_sigma_m, rules.birth_sigma_mps), poisson])
    fits = Fits(model, rows, cells, scan.position_m, config.contour.headings)
    home = np.zeros(0, np.int64)
    if rules.birth == "uniform":
        home = np.zeros(len(cells.z), np.int64)
        for number in range(n_cells):
            home[cells.points[number]] = number
    return Sources(rows, fits, home, m)


def blank_tracks(m: int, t_ns: int, mu: FloatArray) -> tracklist.TrackList:
    """A list of m tracks that has nothing of a past, with mu (m,) as their existence."""
    none = np.zeros(m, np.int64)
    return replace(
        tracklist.empty(), t_ns=np.full(m, t_ns), existence=mu, id=none, hits=none, misses=none,
        confirmed=np.zeros(m, bool), lag_m=np.zeros((m, 2)), moving=np.zeros(m, bool), settled=np.zeros(m),
        cluster=none, told=none, held_s=np.zeros(m),
    )  # fmt: skip
