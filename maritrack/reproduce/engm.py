"""The experiment of the engm paper: two objects that cross in space, three PHD filters, 250 Monte Carlo runs.

The paper compares a density of clutter per volume of space with likelihoods of range and angles. Both that and the
density in the space of the measurements are run, on the same points.
"""

from __future__ import annotations

from maritrack.fanout import Tick, fan_out
from maritrack.reproduce.claims import Plan, Report
from maritrack.reproduce.engm_claims import claims_of, table_cpu, table_of
from maritrack.reproduce.engm_figures import draw
from maritrack.reproduce.engm_limits import limits
from maritrack.reproduce.engm_runs import run_seed

RUNS, QUICK_RUNS = 250, 50


def reproduce(plan: Plan, tick: Tick | None = None) -> Report:
    """All runs, what follows from them, and figures where there is a folder for them."""
    seeds = range(1, (plan.seeds or (QUICK_RUNS if plan.quick else RUNS)) + 1)
    answers = dict(fan_out(run_seed, seeds, workers=plan.workers, tick=tick))
    runs = [run for i in range(len(seeds)) for run in answers[i]]
    tables = {"ospa": table_of(runs), "cpu": table_cpu(runs)}
    figures = draw(runs, plan.out) if plan.out is not None else {}
    return Report("engm", plan.quick, claims_of(runs, limits()), tables, figures)
