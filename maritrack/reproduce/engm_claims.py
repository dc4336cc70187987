"""What the engm paper and its authors' figures say, and whether it holds in our runs.

Numbers are means over seeds of means over the scans, with their standard errors; differences are of pairs of runs on
the same points. The paper's are the labels of its bars.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from maritrack.reproduce.claims import Cell, Claim, Table
from maritrack.reproduce.engm_limits import Limits
from maritrack.reproduce.engm_runs import NOISY, PAPERS, SOUND, TRACKERS, VARIANTS, Run
from maritrack.types import FloatArray

PAPER: Mapping[str, Mapping[str, float]] = {  # engm, Figs. 3 and 4
    "gm-phd": {"OSPA": 80.1, "localisation": 3.08, "cardinality": 79.1, "components": 242, "seconds": 22.3},
    "smc-phd": {"OSPA": 91.2, "localisation": 1.02, "cardinality": 90.7, "components": 250, "seconds": 7.28},
    "engm-phd": {"OSPA": 14.8, "localisation": 2.34, "cardinality": 13.0, "components": 250, "seconds": 16.3},
}
CPU_S = {"gm-phd": 1.0, "engm-phd": 0.5}  # of a run of 101 scans, at most
Z95 = 1.96


def claims_of(runs: Sequence[Run], found: Limits) -> tuple[Claim, ...]:
    """All statements. Those on CPU come last: their numbers alone differ from one time to the next."""
    return (
        bar_claim(runs, "gm-phd", 3.0),
        bar_claim(runs, "engm-phd", 2.0),
        bar_claim(runs, "smc-phd", 3.0),
        noise_claim(runs),
        order_claim(runs),
        worst_claim(runs),
        number_claim(runs),
        components_claim(runs),
        sound_claim(runs),
        reversed_claim(runs),
        theorem_claim(found),
        kalman_claim(found),
        gm_claim(found),
        *(cpu_claim(runs, tracker) for tracker in CPU_S),
    )


def ospa(runs: Sequence[Run], name: str, clutter: str, part: int = 0) -> FloatArray:
    """Mean over the scans of OSPA, or of a part of it, by seed."""
    mine = sorted((r for r in runs if (r.variant.name, r.variant.clutter) == (name, clutter)), key=lambda r: r.seed)
    return np.array([r.ospa[part].mean() for r in mine])


def mean_of(values: FloatArray) -> dict[str, float]:
    """Mean, its standard error and the spread over seeds."""
    n = len(values)
    spread = float(values.std(ddof=1)) if n > 1 else float("nan")
    return {"mean": float(values.mean()), "standard error": spread / math.sqrt(n), "sd": spread, "runs": n}


def bar_claim(runs: Sequence[Run], name: str, within: float) -> Claim:
    """A bar of Fig. 3 with the density of its authors."""
    ours, bar = mean_of(ospa(runs, name, PAPERS)), PAPER[name]["OSPA"]
    what = f"{name}: mean OSPA within {within:g} of the published bar {bar:g}"
    return Claim(what, bool(abs(ours["mean"] - bar) <= within), ours, {"OSPA": bar})


def noise_claim(runs: Sequence[Run]) -> Claim:
    """The bar of SMC-PHD is not that of the process noise that its authors saved, 0."""
    ours, bar = {name: mean_of(ospa(runs, name, PAPERS)) for name in (NOISY, "smc-phd")}, PAPER["smc-phd"]["OSPA"]
    with_noise, without = (abs(told["mean"] - bar) for told in ours.values())
    what = "smc-phd: the published bar is nearer to process noise 1 than to the saved 0"
    return Claim(what, bool(with_noise < without), ours, {"OSPA": bar})


def difference(runs: Sequence[Run], a: str, b: str, clutter: str) -> dict[str, float]:
    """OSPA of a less that of b on the same points: mean and its 95 % interval."""
    gap = mean_of(ospa(runs, a, clutter) - ospa(runs, b, clutter))
    half = Z95 * gap["standard error"]
    return {"difference": gap["mean"], "low": gap["mean"] - half, "high": gap["mean"] + half}


def order_claim(runs: Sequence[Run]) -> Claim:
    """The paper's result."""
    ours = {other: difference(runs, "engm-phd", other, PAPERS) for other in ("gm-phd", "smc-phd")}
    holds = all(gap["high"] < 0 for gap in ours.values())
    theirs = {other: PAPER["engm-phd"]["OSPA"] - PAPER[other]["OSPA"] for other in ours}
    return Claim("clutter per volume of space: engm-phd has a lower OSPA than both others", bool(holds), ours, theirs)


def worst_claim(runs: Sequence[Run]) -> Claim:
    """SMC-PHD, with the saved process noise of 0 and with the 1 that the published bar fits better."""
    ours = {
        f"{name} less {other}": difference(runs, name, other, PAPERS)
        for name in ("smc-phd", NOISY)
        for other in ("gm-phd", "engm-phd")
    }
    holds = all(gap["low"] > 0 for gap in ours.values())
    theirs = {f"smc-phd less {other}": PAPER["smc-phd"]["OSPA"] - PAPER[other]["OSPA"] for other in CPU_S}
    return Claim("smc-phd is the worst of the three, with either process noise", bool(holds), ours, theirs)


def number_claim(runs: Sequence[Run]) -> Claim:
    """Fig. 2: of two objects."""
    ours = {t: float(np.mean([r.found.mean() for r in named(runs, t, PAPERS)])) for t in TRACKERS}
    holds = ours["gm-phd"] > 3.0 and ours["smc-phd"] < 1.0 and abs(ours["engm-phd"] - 2.0) < 1.0
    what = "of two objects gm-phd reports more than three, smc-phd less than one, engm-phd two within one"
    return Claim(what, bool(holds), ours, None)


def components_claim(runs: Sequence[Run]) -> Claim:
    """Fig. 4."""
    ours = {t: float(np.mean([r.components.mean() for r in named(runs, t, PAPERS)])) for t in TRACKERS}
    theirs = {t: PAPER[t]["components"] for t in TRACKERS}
    holds = all(abs(ours[t] - theirs[t]) <= 5.0 for t in TRACKERS)
    return Claim("mean number of components within 5 of the published", bool(holds), ours, theirs)


def sound_claim(runs: Sequence[Run]) -> Claim:
    """With the density of clutter in the space of the measurements."""
    ours = mean_of(ospa(runs, "gm-phd", SOUND))
    return Claim("clutter in measurement space: gm-phd has a mean OSPA below 10", bool(ours["mean"] < 10.0), ours, None)


def reversed_claim(runs: Sequence[Run]) -> Claim:
    """... the order is another."""
    ours: dict[str, Any] = difference(runs, "gm-phd", "engm-phd", SOUND)
    ours["engm-phd"] = mean_of(ospa(runs, "engm-phd", SOUND))
    holds = ours["high"] < 0
    return Claim("clutter in measurement space: gm-phd has a lower OSPA than engm-phd", bool(holds), ours, None)


def theorem_claim(found: Limits) -> Claim:
    """Theorem 3.1."""
    ours = {"largest difference of weights": found.engm_to_engmf}
    what = "one object, always seen, no birth, death and clutter: engm-phd is the EnGMF (theorem 3.1)"
    return Claim(what, bool(found.engm_to_engmf < 1e-6), ours, None)


def kalman_claim(found: Limits) -> Claim:
    """Convergence, on a linear model."""
    holds = True
    for by_number in found.to_kalman.values():
        errors = [by_number[n] for n in sorted(by_number)]
        holds &= all(b < a for a, b in pairwise(errors)) and errors[-1] < 0.15
    ours = {name: {str(n): e for n, e in by.items()} for name, by in found.to_kalman.items()}
    return Claim("the same, linear: smc-phd and engm-phd tend to the Kalman filter as N grows", bool(holds), ours, None)


def gm_claim(found: Limits) -> Claim:
    """GM-PHD, likewise."""
    ours = {"largest difference of means, in standard deviations": found.gm_to_kalman}
    return Claim("the same, linear: gm-phd is the Kalman filter", bool(found.gm_to_kalman < 1e-6), ours, None)


def cpu_claim(runs: Sequence[Run], tracker: str) -> Claim:
    """Of a run of 101 scans on one core."""
    ours = float(np.mean([r.cpu_s for r in named(runs, tracker, PAPERS)]))
    what = f"{tracker}: CPU of a run at most {CPU_S[tracker]:g} s"
    return Claim(what, bool(ours <= CPU_S[tracker]), {"seconds": ours}, {"seconds": PAPER[tracker]["seconds"]})


def named(runs: Sequence[Run], name: str, clutter: str) -> list[Run]:
    """The runs of a variant."""
    return [run for run in runs if (run.variant.name, run.variant.clutter) == (name, clutter)]


def table_of(runs: Sequence[Run]) -> Table:
    """Figs. 3 and 4 as numbers, ours beside the paper's, means over scans and seeds."""
    rows: list[tuple[Cell, ...]] = []
    for variant in VARIANTS:
        mine = named(runs, variant.name, variant.clutter)
        total, *parts = (ospa(runs, variant.name, variant.clutter, part) for part in range(3))
        told = mean_of(total)
        numbers = [float(np.mean([r.found.mean() for r in mine])), float(np.mean([r.components.mean() for r in mine]))]
        means = [float(part.mean()) for part in parts]
        rows.append((variant.clutter, variant.name, "ours", told["mean"], told["standard error"], *means, *numbers))
        if variant.clutter == PAPERS and variant.name in PAPER:
            bars = PAPER[variant.name]
            rows.append((PAPERS, variant.name, "paper", bars["OSPA"], None, bars["localisation"], bars["cardinality"],
                         None, bars["components"]))  # fmt: skip
    header = ("clutter", "filter", "whose", "OSPA", "standard error", "localisation", "cardinality", "objects",
              "components")  # fmt: skip
    return Table("OSPA (c = 100, p = 2), parts, objects reported, components", header, tuple(rows), text_columns=3)


def table_cpu(runs: Sequence[Run]) -> Table:
    """CPU of a run of 101 scans; the paper's are wall-clock seconds of another machine and language."""
    rows: list[tuple[Cell, ...]] = []
    for variant in VARIANTS:
        cpu_s = float(np.mean([run.cpu_s for run in named(runs, variant.name, variant.clutter)]))
        theirs = PAPER[variant.name]["seconds"] if variant.clutter == PAPERS and variant.name in PAPER else None
        rows.append((variant.clutter, variant.name, cpu_s, theirs))
    return Table("seconds a run", ("clutter", "filter", "ours (CPU)", "paper"), tuple(rows), text_columns=2)
