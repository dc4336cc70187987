"""The experiments of the extended paper: a tracker of extended objects, gp-pmbm, against one of points, jipda.

Its simulation of four ships, 100 Monte Carlo runs, and simulated scenes in place of its recordings in a canal, which
are not public: `canal-1` with little wake and `canal-2` with much.
"""

from __future__ import annotations

from maritrack.fanout import Tick, fan_out
from maritrack.reproduce.claims import Case, Plan, Report
from maritrack.reproduce.extended_claims import claims_of, table_cpu, table_definition, table_of
from maritrack.reproduce.extended_figures import draw
from maritrack.reproduce.extended_runs import SHIPS, TEST_1, TEST_2, run_case

RUNS, QUICK_RUNS = 100, 10
OF_CANAL, QUICK_OF_CANAL = 10, 4
QUICK_SCANS = {TEST_1: 0, TEST_2: 600}  # 0 = all
CANAL = (TEST_2, TEST_1)  # the longest first, so that no worker is left with it at the end


def cases(plan: Plan) -> list[Case]:
    """What is run, by seeds 1, 2, ..."""
    runs = plan.seeds or (QUICK_RUNS if plan.quick else RUNS)
    of_canal = min(plan.seeds, OF_CANAL) or (QUICK_OF_CANAL if plan.quick else OF_CANAL)
    scans = QUICK_SCANS if plan.quick else {}
    canal = [Case(scene, seed, scans.get(scene, 0)) for scene in CANAL for seed in range(1, of_canal + 1)]
    return canal + [Case(SHIPS, seed) for seed in range(1, runs + 1)]


def reproduce(plan: Plan, tick: Tick | None = None) -> Report:
    """All runs, what follows from them, and figures where there is a folder for them."""
    work = cases(plan)
    answers = dict(fan_out(run_case, work, workers=plan.workers, tick=tick))
    runs = [run for i in range(len(work)) for run in answers[i]]
    tables = {"scores": table_of(runs), "definition": table_definition(runs), "cpu": table_cpu(runs)}
    figures = draw(runs, plan.out) if plan.out is not None else {}
    return Report("extended", plan.quick, claims_of(runs), tables, figures)
