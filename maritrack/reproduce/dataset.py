"""The experiment of the dataset paper: ec-jpda against jpda on three campaigns, 50 runs of each.

Its recordings are not public: the scenes `daan`, `darc` and `manv` are simulated in their place. Tracks start at the
first words of AIS, as most of the paper's do; the craft of manv, which has no AIS, is not followed. A third tracker
is ec-jpda with the other reading of eq. 5, the dispersion of all points in the gate, and all of it in the gain. Seeds
are 2, 3, ...: scenes and settings were chosen while looking at seed 1.
"""

from __future__ import annotations

from maritrack.fanout import Tick, fan_out
from maritrack.reproduce.claims import Case, Plan, Report
from maritrack.reproduce.dataset_claims import claims_of, table_of
from maritrack.reproduce.dataset_figures import draw
from maritrack.reproduce.dataset_images import frames, judged
from maritrack.reproduce.dataset_runs import SCENES, run_case, without_dispersion

RUNS, QUICK_RUNS = 50, 5
FIRST = 2
SCREENSHOTS, QUICK_SCREENSHOTS = 40, 8  # of each scene
ZERO_SCANS = 60


def reproduce(plan: Plan, tick: Tick | None = None) -> Report:
    """All runs, what follows from them, and figures where there is a folder for them."""
    seeds = range(FIRST, FIRST + (plan.seeds or (QUICK_RUNS if plan.quick else RUNS)))
    work = [Case(scene, seed) for scene in SCENES for seed in seeds]
    answers = dict(fan_out(run_case, work, workers=plan.workers, tick=tick))
    runs = [run for i in range(len(work)) for run in answers[i]]
    few = [Case(scene, 1, ZERO_SCANS) for scene in SCENES]
    same = dict(fan_out(without_dispersion, few, workers=plan.workers))
    shots = frames(QUICK_SCREENSHOTS if plan.quick else SCREENSHOTS)
    seen = dict(fan_out(judged, shots, workers=plan.workers))
    claims = claims_of(runs, {case.scene: same[i] for i, case in enumerate(few)}, [seen[i] for i in range(len(shots))])
    figures = draw(runs, plan.out) if plan.out is not None else {}
    return Report("dataset", plan.quick, claims, {"errors": table_of(runs)}, figures)
