"""The experiment of the abs paper: a port seen by radars ashore and aboard, tracked in the four ways of its Table II.

The paper's simulator and its port are not public; the scene `hamburg` stands in for them, with its vessels, their
sizes and what they do when. Its numbers count the points of dense radars, so that the preset `abs-port` has others.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from maritrack.fanout import Tick, fan_out
from maritrack.reproduce.abs_claims import claims_of, table_of
from maritrack.reproduce.abs_figures import draw
from maritrack.reproduce.abs_runs import CASES, Piece, record, run_case
from maritrack.reproduce.claims import Plan, Report


def reproduce(plan: Plan, tick: Tick | None = None) -> Report:
    """Record the scene for each seed, run all cases on it, and draw the figures of the first seed."""
    seeds = plan.seeds or (1 if plan.quick else 3)
    with TemporaryDirectory(prefix="maritrack-") as place:
        pieces = []
        for seed in range(1, seeds + 1):
            folder = Path(place) / str(seed)
            folder.mkdir()
            record(folder, seed=seed, scans=0, workers=plan.workers)
            pieces += [Piece(case, folder, seed) for case in CASES]
        answers = dict(fan_out(run_case, pieces, workers=plan.workers, tick=tick))
    runs = [answers[i] for i in range(len(pieces))]
    report = Report("abs", plan.quick, claims_of(runs), {"cases": table_of(runs)})
    if plan.out is None:
        return report
    return replace(report, figures=draw([run for run in runs if run.seed == 1], plan.out))
