"""Clusters against labelled points over a grid of eps and min_points, in the polar and in the Cartesian domain.

Points are detected once a scan. ARI and count difference are those of a scan, then their means over scans; scans
in which no object has a point are left out. Clusters are those of DBSCAN, before cluster.min_count and max_extent_m.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from maritrack.cluster.grid import dbscan_grid
from maritrack.errors import InputError
from maritrack.fanout import Tick, fan_out
from maritrack.metrics.clusters import UNKNOWN, Noise, adjusted_rand, count_difference, pair_counts
from maritrack.settings import Config
from maritrack.tune.subjects import DOMAINS, LabelledScan, Subject, labelled_scans
from maritrack.types import FloatArray

BLOCK = 64  # scans held at once
NEAR_BEST = 0.01  # pairs within this of the best ARI are as good
NOISES: tuple[Noise, ...] = ("single", "class")
PAPER = (55.0, 3)  # polar, sec. III
RULE = (
    f"the smallest mean count difference among pairs within {NEAR_BEST:g} of the highest mean adjusted Rand index; "
    "then the higher index, the smaller eps, the smaller min_points"
)


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """Means over the scans of a recording, or over recordings. Axes: domain, eps, min_points."""

    eps_m: tuple[float, ...]
    min_points: tuple[int, ...]
    ari: FloatArray  # (d, e, k)
    count_difference: FloatArray  # (d, e, k) mean of the absolute differences
    count_bias: FloatArray  # (d, e, k) mean of clusters less objects
    scans: int  # that count
    scans_without_object: int
    points: Mapping[str, int]  # "object", "noise", "unknown"
    told: str  # how points came by their objects


def study(
    of: Subject,
    config: Config,
    *,
    eps_m: Sequence[float],
    min_points: Sequence[int],
    noise: Noise,
    margin_m: float,
    radius_m: float,
    moving_only: bool = False,
    workers: int = 1,
    tick: Tick | None = None,
) -> Study:
    """The grid over one recording. `tick(done, of)` counts scans; of = 0 where nobody knows how many there are."""
    scans, labelling = labelled_scans(of, config, margin_m=margin_m, radius_m=radius_m, moving_only=moving_only)
    work = partial(agreement, eps_m=tuple(eps_m), min_points=tuple(min_points), noise=noise)
    total = np.zeros((3, len(DOMAINS), len(eps_m), len(min_points)))
    points, n_scans, n_empty = dict.fromkeys(("object", "noise", "unknown"), 0), 0, 0
    for block in _blocks(scans):
        seen = [scan for scan in block if (scan.truth >= 0).any()]
        n_empty += len(block) - len(seen)
        answers = dict(fan_out(work, seen, workers=workers))
        for i, scan in enumerate(seen):  # in order: the sums are the same for any number of workers
            total += answers[i]
            points["object"] += int((scan.truth >= 0).sum())
            points["noise"] += int((scan.truth == -1).sum())
            points["unknown"] += int((scan.truth == UNKNOWN).sum())
        n_scans += len(seen)
        if tick is not None:
            tick(n_scans + n_empty, config.input.limit)
    if n_scans == 0:
        raise InputError(
            f"{of.path}: no point of an object in {n_empty} scans", hint="is the truth of that day and place?"
        )
    ari, difference, bias = total / n_scans
    return Study(
        tuple(eps_m), tuple(min_points), ari, difference, bias, n_scans, n_empty, points, labelling.told
    )  # fmt: skip


def agreement(scan: LabelledScan, *, eps_m: tuple[float, ...], min_points: tuple[int, ...], noise: Noise) -> FloatArray:
    """ARI, absolute count difference and count difference of one scan, (3, domain, eps, min_points)."""
    found = np.empty((3, len(scan.planes), len(eps_m), len(min_points)))
    for d, (xy_m, period_m) in enumerate(scan.planes):
        grid = dbscan_grid(xy_m, eps_m=eps_m, min_points=min_points, period_m=period_m)
        for k, label in enumerate(grid):
            for e in range(len(eps_m)):
                if e and np.array_equal(label[e], label[e - 1]):
                    found[:, d, e, k] = found[:, d, e - 1, k]
                    continue
                count = count_difference(scan.truth, label[e])
                ari = adjusted_rand(pair_counts(scan.truth, label[e], noise=noise))
                found[:, d, e, k] = ari, abs(count), count
    return found


def _blocks(scans: Iterator[LabelledScan]) -> Iterator[list[LabelledScan]]:
    while block := list(itertools.islice(scans, BLOCK)):
        yield block


def mean(studies: Sequence[Study]) -> Study:
    """Of several recordings, each of the same weight."""
    first = studies[0]
    if len(studies) == 1:
        return first
    return replace(
        first,
        ari=np.mean([s.ari for s in studies], axis=0),
        count_difference=np.mean([s.count_difference for s in studies], axis=0),
        count_bias=np.mean([s.count_bias for s in studies], axis=0),
        scans=sum(s.scans for s in studies),
        scans_without_object=sum(s.scans_without_object for s in studies),
        points={key: sum(s.points[key] for s in studies) for key in first.points},
        told="; ".join(dict.fromkeys(s.told for s in studies)),
    )


def choose(of: Study, domain: int) -> tuple[int, int]:
    """The pair of a domain, as indices: of those within `NEAR_BEST` of the highest mean ARI the one with the smallest
    mean count difference; then the higher ARI, the smaller eps, the smaller min_points.
    """
    ari, difference = of.ari[domain], of.count_difference[domain]
    e, k = np.nonzero(ari >= ari.max() - NEAR_BEST)
    best = np.lexsort((k, e, -ari[e, k], difference[e, k]))[0]
    return int(e[best]), int(k[best])


def rows(of: Study) -> list[dict[str, Any]]:
    """The grid, a row a pair."""
    chosen = [choose(of, d) for d in range(len(DOMAINS))]
    return [
        {
            "domain": domain,
            "eps_m": of.eps_m[e],
            "min_points": of.min_points[k],
            "ari": float(of.ari[d, e, k]),
            "count_difference": float(of.count_difference[d, e, k]),
            "count_bias": float(of.count_bias[d, e, k]),
            "chosen": chosen[d] == (e, k),
        }
        for d, domain in enumerate(DOMAINS)
        for e in range(len(of.eps_m))
        for k in range(len(of.min_points))
    ]


def document(of: Study, *, recordings: Sequence[str], noise: Noise) -> dict[str, Any]:
    """The study as a document: the chosen pair of each domain, and the paper's where it is on the grid."""
    grid = rows(of)
    domains: dict[str, Any] = {}
    for domain in DOMAINS:
        own = [row for row in grid if row["domain"] == domain]
        paper = [row for row in own if (row["eps_m"], row["min_points"]) == PAPER]
        domains[domain] = {
            "chosen": _pair(next(row for row in own if row["chosen"])),
            "paper": _pair(paper[0]) if paper else None,
        }
    return {
        "recordings": list(recordings),
        "scans": of.scans,
        "scans_without_object": of.scans_without_object,
        "points": dict(of.points),
        "labels": of.told,
        "noise": noise,
        "rule": RULE,
        "domains": domains,
        "grid": grid,
    }


def at_edge(told: Mapping[str, Any]) -> list[str]:
    """Domains of a document whose chosen pair has the least or the largest eps or the most points of the grid."""
    eps = {row["eps_m"] for row in told["grid"]}
    most = max(row["min_points"] for row in told["grid"])
    chosen = {domain: pairs["chosen"] for domain, pairs in told["domains"].items()}
    return [d for d, pair in chosen.items() if pair["eps_m"] in (min(eps), max(eps)) or pair["min_points"] == most]


def _pair(row: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in row.items() if key not in ("domain", "chosen")}
