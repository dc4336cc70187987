"""What the abs paper says about its Figs. 2 to 4, one statement after the other, against our runs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from maritrack.reproduce.abs_runs import Run
from maritrack.reproduce.claims import Cell, Claim, Table

FIRST_S = 250.0  # "the first 250 s"
RADIAL_S = 500.0  # "after 500 s" V3 heads for two radars
MOORS_S = 1750.0  # "after 1750 s" V3 moors
HELD = 0.9  # share of its time under way in which a vessel has a track, to be called tracked
KEEPS = 0.9  # ... and one and the same
LEAVING = 75  # steps under way in which a track of the berth must have the vessel for the most part
V2, V3 = "acs-diamond", "evelyn-maersk"
EMPTY = ("2A, sea empty at first", "2B, sea empty at first")
LEAST = 0.01  # a rate has to differ by this to be called lower

Numbers = Mapping[str, float]


def claims_of(runs: Sequence[Run]) -> tuple[Claim, ...]:
    """Every statement; numbers are means over the seeds."""
    by = {name: [run for run in runs if run.case.name == name] for name in dict.fromkeys(r.case.name for r in runs)}
    cases = {name: by[name] for name in ("1A", "1B", "2A", "2B")}
    found = [*_misdetections(cases), *(_from_empty(name, by[name]) for name in EMPTY), *_rates(cases)]
    for name, of_case in by.items():
        found += _tracked(name, of_case)
    found += [_berth(name, by[name], V2) for name in EMPTY]
    return (*found, *(_moors(name, of_case) for name, of_case in by.items()))


def _mean(values: Sequence[float]) -> float:
    told = [v for v in values if not math.isnan(v)]
    return round(float(np.mean(told)), 4) if told else math.nan


def _misdetections(cases: Mapping[str, Sequence[Run]]) -> list[Claim]:
    """Fig. 4: vessels under way without a track before and after the model has converged.

    From the uniform start every pixel is background by its tail for a half-life (34 turns), and nothing can be
    tracked: before convergence most of what is missed is missed because of that. `all_hidden_s` tells how long.
    """
    found = []
    for name in ("2A", "2B"):
        said = f"{name}: fewer misdetections after convergence than from the start"
        found.append(_fewer_after(said, cases[name]))
    after = {name: _mean([run.missed(run.converged_s) for run in of_case]) for name, of_case in cases.items()}
    for a, b in (("1A", "1B"), ("2A", "2B")):
        told = {a: after[a], b: after[b]}
        found.append(Claim(f"{b} misses fewer than {a} after convergence", after[b] < after[a], told, None))
    return found


def _from_empty(name: str, runs: Sequence[Run]) -> Claim:
    """The same where the model hides nothing at first: what is missed then, a tracker or the background has missed."""
    return _fewer_after(f"{name}: fewer misdetections after convergence than from the start", runs)


def _fewer_after(said: str, runs: Sequence[Run]) -> Claim:
    early = _mean([run.missed(0.0, run.converged_s) for run in runs])
    late = _mean([run.missed(run.converged_s) for run in runs])
    hidden_s = _mean([run.all_hidden_s() for run in runs])
    told = {"missed_before": early, "missed_after": late, "all_hidden_s": hidden_s}
    return Claim(said, late < early, told, None)


def _rates(cases: Mapping[str, Sequence[Run]]) -> list[Claim]:
    """Fig. 3: FPR and NPV."""
    fpr = {name: _mean([run.fpr() for run in of_case]) for name, of_case in cases.items()}
    npv = {name: _mean([run.npv() for run in of_case]) for name, of_case in cases.items()}
    found = [
        Claim(f"{b} has a lower FPR than {a}", fpr[b] < fpr[a] - LEAST, {a: fpr[a], b: fpr[b]}, None)
        for a, b in (("1A", "1B"), ("2A", "2B"))
    ]
    found.append(Claim("2B has a lower NPV than 2A", npv["2B"] < npv["2A"] - LEAST, _two(npv), None))
    for name in ("2A", "2B"):
        of_case = cases[name]
        spans = (("at_first", 0.0, FIRST_S / 2), ("after", FIRST_S, FIRST_S * 1.5))
        told = {f"fpr_{when}": _mean([run.fpr(a, b) for run in of_case]) for when, a, b in spans}
        told |= {f"npv_{when}": _mean([run.npv(a, b) for run in of_case]) for when, a, b in spans}
        better = told["fpr_after"] < told["fpr_at_first"] and not told["npv_after"] <= told["npv_at_first"]
        found.append(Claim(f"{name}: FPR and NPV improve within the first {FIRST_S:.0f} s", better, told, None))
        for what, at_s, before_s, until_s in (
            ("heads for a radar", RADIAL_S, RADIAL_S / 2, 2 * RADIAL_S), ("moors", MOORS_S, MOORS_S - 250.0, math.inf),
        ):  # fmt: skip
            before = _mean([run.fpr(before_s, at_s) for run in of_case])
            after = _mean([run.fpr(at_s, until_s) for run in of_case])
            said = f"{name}: FPR rises after {at_s:.0f} s, as V3 {what}"
            found.append(Claim(said, after > before + LEAST, {"before": before, "after": after}, None))
    return found


def _two(values: Numbers) -> dict[str, float]:
    return {name: values[name] for name in ("2A", "2B")}


def _tracked(name: str, runs: Sequence[Run]) -> list[Claim]:
    """Every vessel under way is tracked once the model has converged, and by one track."""
    found = []
    for i, vessel in enumerate(runs[0].vessels):
        shares = [share_held(run, i) for run in runs]
        held, one = _mean([s[0] for s in shares]), _mean([s[1] for s in shares])
        said, holds = f"{name}: {vessel} under way is tracked, by one track", held >= HELD and one >= KEEPS
        found.append(Claim(said, holds, {"held_share": held, "held_by_one": one}, None))
    return found


def share_held(run: Run, i: int) -> tuple[float, float]:
    """Share of its time under way, from convergence on, in which vessel i has a track, and one and the same."""
    span = run.under_way[:, i] & (run.t_s > run.converged_s)
    ids = run.held_by[span, i]
    if len(ids) == 0:
        return math.nan, math.nan
    ids = ids[ids >= 0]
    most = np.bincount(ids).max() if len(ids) else 0
    return len(ids) / int(span.sum()), float(most / span.sum())


def _berth(name: str, runs: Sequence[Run], vessel: str) -> Claim:
    """The vessel that lies at a berth and leaves has one track before and after; how many she has had there."""
    kept, lies_s, had = [], [], []
    for run in runs:
        i = run.vessels.index(vessel)
        away = np.flatnonzero(run.under_way[:, i])
        lies_s.append(float(run.t_s[away[0]]))
        at_berth, left = run.held_by[: away[0], i], run.held_by[away[:LEAVING], i]
        at_berth, left = at_berth[at_berth >= 0], left[left >= 0]
        had.append(float(len(np.unique(at_berth))))
        kept.append(bool(len(at_berth) and len(left) and at_berth[-1] == np.bincount(left).argmax()))
    told = {"kept": float(np.mean(kept)), "at_berth_s": _mean(lies_s), "tracks_at_berth": _mean(had)}
    return Claim(f"{name}: the track of {vessel} survives the berth she leaves", all(kept), told, None)


def _moors(name: str, runs: Sequence[Run]) -> Claim:
    """The vessel that comes to rest keeps its track in the background."""
    kept, stationary = [], []
    for run in runs:
        i = run.vessels.index(V3)
        before, last = run.held_by[run.under_way[:, i], i], int(np.flatnonzero(run.known[:, i])[-1])
        kept.append(bool(run.held_by[last, i] >= 0 and run.held_by[last, i] in before))
        stationary.append(bool(run.stationary[last, i]))
    told = {"kept": float(np.mean(kept)), "stationary_at_the_end": float(np.mean(stationary))}
    return Claim(f"{name}: the track of {V3} survives the berth she reaches", all(kept), told, None)


def table_of(runs: Sequence[Run]) -> Table:
    """A row for each run."""
    header = ("case", "seed", "FPR", "NPV", "missed before", "missed after", "false", "converged [s]")
    rows: list[tuple[Cell, ...]] = []
    for run in runs:
        late = run.t_s > (0.0 if math.isnan(run.converged_s) else run.converged_s)
        held = np.array([len(set(row[row >= 0].tolist())) for row in run.held_by])
        false = float((run.n_tracks - np.minimum(held, run.n_tracks))[late].mean())
        numbers = (run.fpr(), run.npv(), run.missed(0.0, run.converged_s), run.missed(run.converged_s), false)
        cells = (*(round(x, 4) for x in numbers), run.converged_s)
        rows.append((run.case.name, run.seed, *(None if math.isnan(x) else x for x in cells)))
    return Table("Cases of Table II; missed: vessels under way without a track, a step", header, tuple(rows), 1)
