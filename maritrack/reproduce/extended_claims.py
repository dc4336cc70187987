"""What the extended paper states, and whether it holds in our runs.

Numbers are means over seeds of means over scans. GOSPA with c = 10 and p = 2 is of position and velocity together; its
localisation is a sum of squares, missed and false are counts. Intervals hold 95 % and are of pairs of runs on the same
points; with fewer than two runs there is none, and the means decide.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import t as student

from maritrack.reproduce.claims import Cell, Claim, Table
from maritrack.reproduce.extended_runs import GP, JIPDA, NAMES, SCENES, SCORES, SHIPS, TEST_1, TEST_2, TRACKERS, Run
from maritrack.types import FloatArray

Key = tuple[str, str]  # scene, tracker
PAPER: Mapping[Key, Mapping[str, float]] = {  # extended, Tables 1 and 2
    key: dict(zip(SCORES, row, strict=True))
    for key, row in {
        (SHIPS, GP): (4.15, 3.40, 0.10, 0.28, 0.60), (SHIPS, JIPDA): (4.56, 6.72, 0.12, 0.07, 0.28),
        (TEST_1, GP): (1.40, 1.12, 0.03, 0.00, 0.38), (TEST_1, JIPDA): (3.95, 2.21, 0.36, 0.00, 0.08),
        (TEST_2, GP): (5.69, 6.02, 0.08, 0.02, 0.18), (TEST_2, JIPDA): (4.37, 4.49, 0.05, 0.04, 0.18),
    }.items()
}  # fmt: skip
C_M, P = 10.0, 2.0
AHEAD, COVERED = 1.0 / 1.5, 0.60  # localisation of gp-pmbm at most that share of jipda's; its IoU at least this
BUDGET_MS = {GP: 150.0, JIPDA: 5.0}  # CPU of a scan, median
LATE = 150  # scan after which the ships meet


def claims_of(runs: Sequence[Run]) -> tuple[Claim, ...]:
    """All statements. Those on CPU come last: their numbers alone differ from one time to the next."""
    return (
        ahead_claim(runs),
        covered_claim(runs),
        order_claim(runs, SHIPS, "iou", GP, "gp-pmbm's hulls cover the ships better"),
        order_claim(runs, SHIPS, "gospa_false", JIPDA, "jipda reports fewer false targets"),
        order_claim(runs, SHIPS, "gospa", GP, "gp-pmbm has the lower GOSPA"),
        late_claim(runs),
        order_claim(runs, TEST_1, "gospa", GP, "gp-pmbm has the lower GOSPA"),
        order_claim(runs, TEST_1, "gospa_localisation", GP, "gp-pmbm has the lower localisation error"),
        order_claim(runs, TEST_1, "iou", GP, "gp-pmbm's hulls cover the boat better"),
        order_claim(runs, TEST_2, "gospa", JIPDA, "with much wake the order turns, jipda has the lower GOSPA"),
        order_claim(runs, TEST_2, "gospa_localisation", JIPDA, "with much wake jipda has the lower localisation error"),
        lead_claim(runs),
        definition_claim(runs),
        *(cpu_claim(runs, tracker) for tracker in TRACKERS),
        faster_claim(runs),
    )


def named(runs: Sequence[Run], scene: str, tracker: str) -> list[Run]:
    """Runs of a tracker on a scene, by seed."""
    mine = [run for run in runs if (run.case.scene, run.tracker) == (scene, tracker)]
    return sorted(mine, key=lambda run: run.case.seed)


def by_seed(runs: Sequence[Run], scene: str, tracker: str, score: str) -> FloatArray:
    """Mean of a score over the scans that have it, of each seed."""
    return np.array([np.nanmean(run.scores[score]) for run in named(runs, scene, tracker)])


def interval(values: FloatArray) -> dict[str, float]:
    """Mean of values and where it lies, by Student's law; without an interval from a single one."""
    mean, n = float(values.mean()), len(values)
    half = float(student.ppf(0.975, n - 1) * values.std(ddof=1) / math.sqrt(n)) if n > 1 else 0.0
    return {"mean": mean, "low": mean - half, "high": mean + half, "runs": n}


def ratio(a: FloatArray, b: FloatArray) -> dict[str, float]:
    """Mean of a over mean of b, values of the same seeds, to first order (delta method)."""
    value = float(a.mean() / b.mean())
    spread = interval((a - value * b) / b.mean())
    return {"ratio": value, "low": value + spread["low"], "high": value + spread["high"], "runs": len(a)}


def both(runs: Sequence[Run], scene: str, score: str) -> dict[str, Any]:
    """A score of both trackers, and gp-pmbm less jipda."""
    gp, points = (by_seed(runs, scene, tracker, score) for tracker in TRACKERS)
    return {GP: interval(gp), JIPDA: interval(points), "gp-pmbm less jipda": interval(gp - points)}


def theirs(scene: str, score: str) -> dict[str, float]:
    """The paper's."""
    return {tracker: PAPER[scene, tracker][score] for tracker in TRACKERS}


def ahead_claim(runs: Sequence[Run]) -> Claim:
    """Table 1, localisation."""
    gp, points = (by_seed(runs, SHIPS, tracker, "gospa_localisation") for tracker in TRACKERS)
    ours: dict[str, Any] = {GP: interval(gp), JIPDA: interval(points), "gp-pmbm over jipda": ratio(gp, points)}
    paper = theirs(SHIPS, "gospa_localisation")
    paper["gp-pmbm over jipda"] = paper[GP] / paper[JIPDA]
    what = "simulation: gp-pmbm's localisation error is at most 1/1.5 of jipda's"
    return Claim(what, bool(ours["gp-pmbm over jipda"]["high"] <= AHEAD), ours, paper)


def covered_claim(runs: Sequence[Run]) -> Claim:
    """Table 1, IoU."""
    ours = both(runs, SHIPS, "iou")
    what = f"simulation: gp-pmbm's IoU is at least {COVERED:.2f}"
    return Claim(what, bool(ours[GP]["mean"] >= COVERED), ours, theirs(SHIPS, "iou"))


def order_claim(runs: Sequence[Run], scene: str, score: str, winner: str, what: str) -> Claim:
    """Which of the two is ahead: of IoU the larger, of all else the smaller one."""
    ours = both(runs, scene, score)
    gap = ours["gp-pmbm less jipda"]
    below = gap["high"] < 0.0 if (winner == GP) == (score != "iou") else gap["low"] > 0.0
    return Claim(f"{NAMES[scene]}: {what}", bool(below), ours, theirs(scene, score))


def late_claim(runs: Sequence[Run]) -> Claim:
    """Fig. 2: when ships have met."""
    ours = {}
    for tracker in TRACKERS:
        of_scan = np.array([run.scores["gospa_localisation"] for run in named(runs, SHIPS, tracker)])
        ours[tracker] = interval(of_scan[:, LATE:].mean(axis=1) - of_scan[:, LATE - 90 : LATE].mean(axis=1))
    what = f"simulation: after scan {LATE} jipda's localisation error is larger than in the 90 scans before"
    return Claim(what, bool(ours[JIPDA]["low"] > 0.0), ours, None)


def lead_claim(runs: Sequence[Run]) -> Claim:
    """IoU of test 2 is the same for both in the paper."""
    lead = {NAMES[s]: both(runs, s, "iou")["gp-pmbm less jipda"]["mean"] for s in SCENES}
    paper = {NAMES[s]: PAPER[s, GP]["iou"] - PAPER[s, JIPDA]["iou"] for s in SCENES}
    least = min(lead.values())
    return Claim("gp-pmbm's lead in IoU is least in test 2", bool(lead[NAMES[TEST_2]] == least), lead, paper)


def bound(scores: Mapping[str, float]) -> float:
    """The largest mean GOSPA that its parts allow: the root of the mean of its square."""
    wrong = scores["gospa_missed"] + scores["gospa_false"]
    return math.sqrt(scores["gospa_localisation"] + C_M**P / 2.0 * wrong)


def definition_claim(runs: Sequence[Run]) -> Claim:
    """A mean of roots is no larger than the root of the mean; the paper's columns do not keep to it, ours do."""
    ours, paper = {}, {}
    for scene in SCENES:
        for tracker in TRACKERS:
            means = {score: float(by_seed(runs, scene, tracker, score).mean()) for score in SCORES}
            name = f"{NAMES[scene]}, {tracker}"
            ours[name] = {"GOSPA": means["gospa"], "at most": bound(means)}
            paper[name] = {"GOSPA": PAPER[scene, tracker]["gospa"], "at most": bound(PAPER[scene, tracker])}
    holds = all(row["GOSPA"] <= row["at most"] + 0.01 for row in paper.values())
    what = "the paper's means of GOSPA are possible with its means of the parts, c = 10 and p = 2"
    return Claim(what, bool(holds), ours, paper)


def cpu_of(runs: Sequence[Run], scene: str, tracker: str) -> float:
    """Median CPU of a scan in milliseconds, over all runs."""
    return float(np.median(np.concatenate([run.cpu_ms for run in named(runs, scene, tracker)])))


def cpu_claim(runs: Sequence[Run], tracker: str) -> Claim:
    """On one core."""
    ours, limit = cpu_of(runs, SHIPS, tracker), BUDGET_MS[tracker]
    what = f"simulation: {tracker} takes at most {limit:g} ms of CPU a scan (median)"
    return Claim(what, bool(ours <= limit), {"ms": ours}, None)


def faster_claim(runs: Sequence[Run]) -> Claim:
    """Sec. 5.5, of two programming languages."""
    ours = {NAMES[s]: cpu_of(runs, s, GP) / cpu_of(runs, s, JIPDA) for s in SCENES}
    paper = {NAMES[SHIPS]: 10.0, NAMES[TEST_1]: 100.0, NAMES[TEST_2]: 100.0}
    return Claim("jipda is at least ten times as fast as gp-pmbm", bool(min(ours.values()) >= 10.0), ours, paper)


def table_of(runs: Sequence[Run]) -> Table:
    """Tables 1 and 2, ours beside the paper's; half the width of the 95 % interval of GOSPA."""
    rows: list[tuple[Cell, ...]] = []
    for scene in SCENES:
        for tracker in TRACKERS:
            numbers = [by_seed(runs, scene, tracker, score) for score in SCORES]
            gospa = interval(numbers[0])
            half = (gospa["high"] - gospa["low"]) / 2 if len(numbers[0]) > 1 else None
            rows.append((NAMES[scene], tracker, "ours", *(float(n.mean()) for n in numbers), half, len(numbers[0])))
            rows.append((NAMES[scene], tracker, "paper", *PAPER[scene, tracker].values(), None, None))
    header = ("experiment", "method", "whose", "GOSPA", "localisation", "missed", "false", "IoU", "GOSPA +-", "runs")
    title = (
        "Tables 1 and 2; tests 1 and 2 are recordings in the paper, simulated scenes in ours: compare parts and order"
    )
    return Table(title, header, tuple(rows), text_columns=3)


def table_definition(runs: Sequence[Run]) -> Table:
    """What `definition_claim` compares."""
    claim = definition_claim(runs)
    rows = tuple(
        (name, claim.ours[name]["GOSPA"], claim.ours[name]["at most"], row["GOSPA"], row["at most"])
        for name, row in claim.paper.items()
    )
    header = ("experiment", "GOSPA, ours", "its parts allow", "GOSPA, paper", "its parts allow (paper)")
    return Table("Mean GOSPA, and the most that the means of its parts allow", header, rows)


def table_cpu(runs: Sequence[Run]) -> Table:
    """CPU of clustering and tracking."""
    rows = tuple((NAMES[s], t, cpu_of(runs, s, t)) for s in SCENES for t in TRACKERS)
    return Table("CPU of a scan (median)", ("experiment", "method", "ms"), rows, text_columns=2)
