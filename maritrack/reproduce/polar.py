"""The experiment of the polar paper: two fields, two clustering domains, four trackers.

The paper's recordings are not public. The scenes stand in for them: one with up to 5 km between radar and objects,
one with 20 to 30 km, where the arc from one azimuth to the next is longer than the eps that suits both fields.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from maritrack.fanout import Tick, fan_out
from maritrack.reproduce.claims import Plan, Report, Table
from maritrack.reproduce.polar_claims import COARSE, FINE, OWN_PAIR, STEADY, claims_of, table_one, table_runs
from maritrack.reproduce.polar_figures import draw, panels
from maritrack.reproduce.polar_pairs import best_pairs, search, table_pairs
from maritrack.reproduce.polar_runs import DOMAINS, Case, Run, run_case

AREAS = ("near", "far")
SCANS = 240  # ten minutes
GRID_SCANS = 60


def reproduce(plan: Plan, tick: Tick | None = None) -> Report:
    """All runs, what follows from them, and figures where there is a folder for them."""
    found = search(GRID_SCANS, workers=plan.workers)
    cases = cases_of(plan, best_pairs(found))
    answers = dict(fan_out(run_case, cases, workers=plan.workers, tick=tick))
    runs = [run for i in range(len(cases)) for run in answers[i]]
    return report(runs, plan, {"pairs": table_pairs(found)})


def cases_of(plan: Plan, pairs: Mapping[str, tuple[float, int]]) -> list[Case]:
    """Recordings: both fields as they are over the seeds, then variants of the far field.

    Quick: 3 seeds, one of each variant, 240 scans; else 5 seeds of each, 480 scans of the fields as they are.
    """
    seeds = plan.seeds or (3 if plan.quick else 5)
    long, variants = (SCANS, 1) if plan.quick else (2 * SCANS, seeds)
    cases = [Case(area=area, seed=seed, scans=long) for area in AREAS for seed in range(1, seeds + 1)]
    for seed in range(1, variants + 1):
        cases += [Case(area="far", seed=seed, scans=SCANS, name=name, fade=fade) for name, fade in STEADY.items()]
        cases += [
            Case(area="far", seed=seed, scans=SCANS, name=FINE, spokes=4096),
            Case(area="far", seed=seed, scans=SCANS, name=COARSE, cell_m=30.0),
            Case(area="far", seed=seed, scans=SCANS, name=OWN_PAIR, pairs=pairs),
        ]
    return cases


def report(runs: Sequence[Run], plan: Plan, tables: Mapping[str, Table]) -> Report:
    """Claims, tables and figures of finished runs; `tables` are what else there is."""
    plain = [run for run in runs if not run.case.name]
    figures = figures_of(plain, plan.out) if plan.out is not None else {}
    shown = {"table_1": table_one(plain), "runs": table_runs(runs), **tables}
    return Report("polar", plan.quick, claims_of(runs), shown, figures)


def figures_of(runs: Sequence[Run], folder: Path) -> dict[str, Path]:
    """Figs. 3 and 4 as PNG, and their curves for the viewer; the first seed of each."""
    from maritrack.sinks.curves import write_curves

    first = [run for run in runs if run.case.seed == 1]
    written = {}
    for area, name in zip(AREAS, ("figure_3_near", "figure_4_far"), strict=True):
        written[name] = folder / f"{name}.png"
        draw([run for run in first if run.case.area == area], area, written[name])
    written["curves"] = folder / "curves.rrd"
    write_curves(written["curves"], "polar: OSPA over time", panels(first), columns=len(DOMAINS))
    return written
