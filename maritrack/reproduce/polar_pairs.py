"""The pair of eps and min_points that clusters the far field best, for each domain: the polar paper's grid search."""

from __future__ import annotations

import tempfile
from pathlib import Path

from maritrack.reproduce.claims import Table
from maritrack.reproduce.polar_runs import Case, config_of, scene_of
from maritrack.simulate.record import simulate
from maritrack.tune.clustering import Study, choose, rows, study
from maritrack.tune.subjects import DOMAINS, subject

EPS_M = (15.0, 25.0, 35.0, 45.0, 55.0, 75.0, 100.0, 150.0, 200.0)
MIN_POINTS = (2, 3, 5, 8)
SEED = 0  # of a recording that no tracker runs over


def search(scans: int, *, workers: int = 1) -> Study:
    """The grid over the labelled cells of a recording of the far field."""
    case = Case(area="far", seed=SEED, scans=scans)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rec.cat240"
        simulate(scene_of(case), path, seed=case.seed, scans=scans, ais=False)
        return study(
            subject(path, truth=None), config_of(case, "polar", "sprt"), eps_m=EPS_M, min_points=MIN_POINTS,
            noise="single", margin_m=0.0, radius_m=0.0, workers=workers,
        )  # fmt: skip


def best_pairs(found: Study) -> dict[str, tuple[float, int]]:
    """eps_m and min_points by domain."""
    chosen = {domain: choose(found, d) for d, domain in enumerate(DOMAINS)}
    return {name.removesuffix("-dbscan"): (found.eps_m[e], found.min_points[k]) for name, (e, k) in chosen.items()}


def table_pairs(found: Study) -> Table:
    """The grid; `best` marks the pair of a domain."""
    header = ("clusters", "best", "eps_m", "min_points", "ari", "count_difference")
    cells = tuple(
        (
            row["domain"].removesuffix("-dbscan"), "best" if row["chosen"] else "", row["eps_m"], row["min_points"],
            row["ari"], row["count_difference"],
        )
        for row in rows(found)
    )  # fmt: skip
    title = f"far field: adjusted Rand index and mean difference in the number of clusters, {found.scans} scans"
    return Table(title, header, cells, text_columns=2)
