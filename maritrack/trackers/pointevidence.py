"""A scan of points: an object gives none, one or many of them, in a cell of some partition.

Cells of the clustering are where it begins; what is tried besides them is for `pmbm.association` to say. Weights are
against clutter: every likelihood is over kappa^n, kappa the density of clutter points.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import expit

from maritrack import geo
from maritrack.cluster.stage import sensor_noise
from maritrack.objects import contour, rate
from maritrack.settings import Config
from maritrack.trackers import bernoullis, pointsearch, stationary, steps, tracklist
from maritrack.trackers.association import Children
from maritrack.trackers.bernoullis import Bernoullis
from maritrack.trackers.cells import Cells, Fits
from maritrack.trackers.pointmodels import PointModel, gated
from maritrack.trackers.sources import Sources, sources
from maritrack.trackers.tracklist import TrackList
from maritrack.types import BoolArray, Clusters, FloatArray, IntArray, Points, Scan

MOST_POINTS = 600  # of a group whose association is searched ...
MOST_WORK = 6000  # ... and points times objects and cells
MOST_PAIRS = 4000  # of rows with cells that are fitted; of a crowd each row with its largest cells


@dataclass(slots=True, eq=False)
class PointEvidence:
    """Rows, and the cells (c,) of the clustering in their gates."""

    config: Config
    model: PointModel
    scan: Scan
    before: Bernoullis  # (n,) rows at their new times
    p_detect: FloatArray  # (n,)
    missed: Bernoullis
    log_miss: FloatArray  # (n,)
    i: IntArray  # (k,) row and ...
    j: IntArray  # (k,) cell of the clustering in its gate
    cells: Cells
    label: IntArray  # (c,) cluster of each cell, -1 = a point of none
    n_elements: int
    inside: dict[tuple[int, int], IntArray]  # points of a cell in the gate of a row
    fits: Fits
    born: Sources
    clock_back: bool
    rng_key: tuple[int, ...]
    poisson: Bernoullis
    may_start: BoolArray  # (c,)
    n_cut: int = 0
    n_inexact: int = 0
    log_u: dict[int, float] = field(default_factory=dict)  # of cells that may be new
    source: dict[int, int] = field(default_factory=dict)

    @property
    def log_kappa(self) -> float:
        """Log of the density of clutter points."""
        return math.log(self.config.model.clutter_density_per_m2)

    @property
    def n_left_out(self) -> int:
        """Cells in no row's gate for which there was no room."""
        kept_out = ~self.may_start
        kept_out[self.j] = False
        return int(np.count_nonzero(kept_out))

    def free(self) -> IntArray:
        """Cells in no row's gate that may be new objects."""
        alone = np.ones(self.n_elements, bool)
        alone[self.j] = False
        return np.array([c for c in np.flatnonzero(alone).tolist() if self.may_be_new(c)], np.int64)

    def may_be_new(self, cell: int) -> bool:
        """Whether an object that begins with the cell exists enough to be kept."""
        room = cell >= self.n_elements or bool(self.may_start[cell])
        return room and expit(self.log_u.get(cell, -math.inf)) >= self.config.pmbm.prune_existence

    def try_new(self, cells: list[int]) -> None:
        """Find out how likely cells are new objects."""
        new = [c for c in dict.fromkeys(cells) if c not in self.log_u]
        if not new:
            return
        log_u, source = self.born.weigh(self.cells, new, self.scan, self.config)
        self.log_u.update(zip(new, log_u.tolist(), strict=True))
        self.source.update(zip(new, source.tolist(), strict=True))

    def log_hit(self, pairs: list[tuple[int, int]]) -> FloatArray:
        """Log weight (k,) of rows with cells, against clutter."""
        if not pairs:
            return np.zeros(0)
        self.fits.need(pairs)
        row = np.array([i for i, _ in pairs])
        n = self.cells.sizes(c for _, c in pairs)
        r, p = self.before.tracks.existence[row], self.p_detect[row]
        with np.errstate(divide="ignore"):
            seen = np.log(r * p)
        return np.asarray(seen + rate.log_count(self.before.rate[row], n) + self.fits.log_l(pairs) - n * self.log_kappa)

    def children(self, rows: IntArray, elements: IntArray, *, most: int, least: float, thorough: bool) -> Children:
        """Associations by search; those of whole cells where that is enough, of a crowd the best of them."""
        rules = self.config.pmbm
        there = rows >= 0
        mine = rows[there]
        size = sum(len(self.cells.points[c]) for c in elements.tolist())
        members = len(mine) + len(elements)
        if members > rules.group_limit or size > MOST_POINTS or size * members > MOST_WORK:
            self.n_inexact += 1
            found = pointsearch.whole_cells(self, mine, elements, most=1)
        elif not thorough:
            found = pointsearch.whole_cells(self, mine, elements, most=most)
        elif rules.association == "murty":
            found = pointsearch.partitions(self, mine, elements, most=most)
        else:
            found = pointsearch.stochastic(self, mine, elements, most=most)
        cell = np.full((len(found.log_w), len(rows)), -1)
        cell[:, there] = found.cell
        return replace(found, cell=cell)

    def crowd(self, rows: IntArray, elements: IntArray) -> None:
        """Hypotheses of points have no marginals."""

    def hit(self, row: IntArray, cell: IntArray) -> Bernoullis:
        """Rows updated with cells: they exist."""
        pairs = list(zip(row.tolist(), cell.tolist(), strict=True))
        self.fits.need(pairs)
        parents = bernoullis.rows(self.before, row)
        fitted = self.fits.fitted(pairs)
        tracks = replace(
            tracklist.count(parents.tracks, np.ones(len(row), bool), self.scan.sensor.id),
            density=fitted.tracks.density, existence=np.ones(len(row)), cluster=self._cluster_of(cell),
            held_s=np.zeros(len(row)),
        )  # fmt: skip
        return Bernoullis(tracks, rate.update(parents.rate, self.cells.sizes(cell.tolist())), fitted.x, fitted.P)

    def newborn(self, cell: IntArray) -> Bernoullis:
        """New rows at cells, of the likeliest source of each."""
        some = cell.tolist()
        made = self.born.made(self.cells, some, [self.source[c] for c in some])
        n, now = len(some), self.scan.t_ns
        tracks = replace(
            made.tracks, t_ns=np.full(n, now), existence=expit(np.array([self.log_u[c] for c in some])),
            lag_m=made.tracks.density.x[:, :2].copy(), cluster=self._cluster_of(cell),
            hits=np.ones(n, np.int64), told=np.full(n, tracklist.HIT),
        )  # fmt: skip
        return replace(made, tracks=tracks)

    def _cluster_of(self, cell: IntArray) -> IntArray:
        """The cluster that most of a cell's points are of."""
        out = np.full(len(cell), -1)
        of_point = self.point_label
        for k, c in enumerate(cell.tolist()):
            label = of_point[self.cells.points[c]]
            if len(label) and label.max() >= 0:
                out[k] = np.bincount(label[label >= 0]).argmax()
        return out

    @property
    def point_label(self) -> IntArray:
        """Cluster (n,) of each point."""
        out = np.full(len(self.cells.z), -1)
        for c in range(self.n_elements):
            out[self.cells.points[c]] = self.label[c]
        return out

    def explained(self, cell: IntArray, p: FloatArray) -> FloatArray:
        """Share (c,) of the points of each cell of the clustering that rows took."""
        taken = np.zeros(len(self.cells.z))
        for c, share in zip(cell.tolist(), p.tolist(), strict=True):
            taken[self.cells.points[c]] += share
        return np.array([taken[self.cells.points[c]].mean() for c in range(self.n_elements)])

    def learn(self, shown: TrackList, unexplained: FloatArray) -> TrackList:
        """Clutter of points is told, not learned."""
        return shown


def held(missed: Bernoullis, rows: Bernoullis, hidden: FloatArray, scan: Scan, config: Config) -> Bernoullis:
    """Missed rows, those that the background takes as they were before the scan, hull and rate too."""
    none = np.zeros(len(rows), bool)
    tracks = stationary.hold_covered(missed.tracks, rows.tracks, none, hidden, scan, config.tracker)
    lies = tracks.held_s > 0
    if not lies.any() or scan.covered is None:
        return replace(missed, tracks=tracks)
    x, P = missed.x.copy(), missed.P.copy()
    if x.shape[1]:
        still, spread, speed = rows.x[lies], rows.P[lies], slice(2, 4)
        own, add = spread[:, speed, speed].copy(), np.where(rows.tracks.held_s[lies] > 0, 0.0, scan.covered.pixel_m**2)
        still[:, speed], still[:, contour.TURN] = 0.0, 0.0
        spread[:, speed], spread[:, :, speed], spread[:, speed, speed] = 0.0, 0.0, own
        spread[:, :2, :2] += add[:, None, None] * np.eye(2)
        x[lies], P[lies] = still, spread
    return Bernoullis(tracks, np.where(lies[:, None], rows.rate, missed.rate), x, P)


def look(
    rows: Bernoullis, poisson: Bernoullis, scan: Scan, points: Points, clusters: Clusters, config: Config, k: int,
    model: PointModel,
) -> PointEvidence:  # fmt: skip
    """Rows at the time of the points, the cells in their gates, and how likely each is new."""
    rules = config.pmbm
    before, back = moved(rows, scan, points, config, model)
    sigma = sensor_noise(scan, config.input)
    var = np.full((2, len(points)), [[sigma[0] ** 2], [sigma[1] ** 2]])
    R = points.cov_m2
    if R is None:
        R = geo.polar_cov_to_en(points.range_m, points.azimuth_rad, var[0], var[1])
    R = R + sigma[2] ** 2 * np.eye(2)
    cells = Cells(points.position_m, R)
    label = _base_cells(cells, clusters.label)
    c = len(label)
    base_of = np.zeros(len(points), np.int64)
    for number in range(c):
        base_of[cells.points[number]] = number
    row, point = gated(model, before, points.position_m, R, steps.gate_limit(config.model.p_gate))
    p_detect, hidden, _ = steps.chances(before.tracks, scan, config)
    seen = p_detect > 0.0
    row, point = row[seen[row]], point[seen[row]]
    order = np.lexsort((point, base_of[point], row))
    row, point = row[order], point[order]
    key = row * max(c, 1) + base_of[point]
    pair, first = np.unique(key, return_index=True)
    inside = np.split(point, first[1:])
    i, j = np.divmod(pair, max(c, 1))
    kept = fullest(i, np.diff(np.append(first, len(point))), MOST_PAIRS)
    n_cut = int(np.count_nonzero(~kept))
    i, j, inside = i[kept], j[kept], [one for one, keep in zip(inside, kept.tolist(), strict=False) if keep]
    r = before.tracks.existence
    q, gone_rate = rate.missed(before.rate, p_detect)
    missed_mass = np.maximum(1.0 - r + r * q, 1e-12)
    tracks = tracklist.count(before.tracks, np.zeros(len(rows), bool), scan.sensor.id)
    tracks = replace(tracks, existence=r * q / missed_mass, cluster=np.full(len(rows), -1, np.int64))
    missed = held(Bernoullis(tracks, gone_rate, before.x, before.P), rows, hidden, scan, config)
    left, _ = moved(poisson, scan, points, config, model)
    lq, left_rate = rate.missed(left.rate, np.full(len(left), config.model.p_detect))
    born = sources(left, cells, c, scan, config, model)
    left = replace(left, rate=left_rate, tracks=replace(left.tracks, existence=left.tracks.existence * lq))
    room = max(config.tracker.max_tracks - len(np.unique(rows.tracks.id)), 0)
    size = cells.sizes(range(c))
    may_start = np.zeros(c, bool)
    may_start[np.argsort(-size, kind="stable")[:room]] = True
    evidence = PointEvidence(
        config=config, model=model, scan=scan, before=before, p_detect=p_detect,
        missed=missed, log_miss=np.log(missed_mass), i=i, j=j, cells=cells,
        label=label, n_elements=c,
        inside=dict(zip(zip(i.tolist(), j.tolist(), strict=True), map(np.sort, inside), strict=False)),
        fits=Fits(model, before, cells, scan.position_m, 1), born=born, clock_back=back,
        rng_key=(8, k), poisson=left, may_start=may_start, n_cut=n_cut,
    )  # fmt: skip
    least = math.log(rules.prune_existence) if rules.prune_existence > 0 else -math.inf
    hopeful = np.flatnonzero(born.bound(cells, c, evidence.log_kappa, config) > least).tolist()
    if rules.association == "stochastic":  # what the groups will ask for, all at once
        hopeful += [half for b in np.unique(j).tolist() for half in pointsearch.halves_of(evidence, b)]
    evidence.try_new(hopeful)
    evidence.fits.need((a, cells.number(one)) for (a, _), one in evidence.inside.items())
    return evidence


def fullest(row: IntArray, size: IntArray, most: int) -> BoolArray:
    """Which pairs (k,) of rows with cells, ordered by row, are looked at: all of `most`, else the largest of each row.

    A row keeps as many as all may have, at least one.
    """
    kept = np.ones(len(row), bool)
    if len(row) <= most:
        return kept
    order = np.lexsort((-size, row))
    begin = np.searchsorted(row, row)
    kept[order] = np.arange(len(row)) - begin < max(most // len(np.unique(row)), 1)
    return kept


def moved(rows: Bernoullis, scan: Scan, points: Points, config: Config, model: PointModel) -> tuple[Bernoullis, bool]:
    """Rows at the time when the scan passes them, less what does not survive; whether a clock stepped back."""
    tracks, share = rows.tracks, config.pmbm.p_survive_scan
    ahead = np.maximum(tracklist.seconds(steps.middle_ns(scan) - tracks.t_ns), 0.0)
    rough = tracks.density.x[:, :2] + ahead[:, None] * tracks.density.x[:, 2:]
    t_ns = tracklist.beam_time(scan, points, rough)
    dt = tracklist.seconds(t_ns - tracks.t_ns)
    back = bool((dt < 0).any())
    dt = np.maximum(dt, 0.0)
    lives = config.model.p_survive**dt if share == 0.0 else np.where(dt > 0, share, 1.0)
    there = model.predict(rows, dt)
    wider = rate.predict(rows.rate, config.pmbm.rate_window)
    tracks = replace(there.tracks, t_ns=np.maximum(t_ns, tracks.t_ns), existence=tracks.existence * lives)
    return Bernoullis(tracks, np.where(dt[:, None] > 0, wider, rows.rate), there.x, there.P), back


def _base_cells(cells: Cells, label: IntArray) -> IntArray:
    """Number the clusters of points, then those that are in none, each alone; the label of each cell."""
    order = np.argsort(label, kind="stable")
    inside = order[label[order] >= 0]
    parts = np.split(inside, np.flatnonzero(np.diff(label[inside])) + 1) if len(inside) else []
    parts += [np.array([p]) for p in np.flatnonzero(label < 0).tolist()]
    for part in parts:
        cells.number(np.sort(part))
    return np.array([label[part[0]] for part in parts], np.int64)
