"""What the polar paper states, and whether it holds in our runs. Numbers are means over seeds unless they say not.

A switch is a switch of T-GOSPA (c = 100 m, p = 2, gamma = 1 m, over the whole of a recording): its switching cost,
which is what the paper's Table I is read to hold.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from maritrack.reproduce.claims import Cell, Claim, Table
from maritrack.reproduce.polar_runs import DOMAINS, TRACKERS, Run

Key = tuple[str, str, str]  # area, domain, tracker
PAPER: Mapping[Key, float] = {  # polar, Table I
    (area, domain, tracker): value
    for area, domain, row in (
        ("near", "cartesian", (9.0, 5.5, 9.0, 3.5)),
        ("near", "polar", (9.0, 5.5, 9.0, 3.5)),
        ("far", "cartesian", (141.0, 17.0, 23.0, 175.0)),
        ("far", "polar", (5.0, 3.5, 4.0, 3.0)),
    )
    for tracker, value in zip(TRACKERS, row, strict=True)
}
SAME = 2.0  # near: the domains are within this factor
MANY, SHARE, HELD = 15.0, 1.0 / 3.0, 0.9  # far: Cartesian at least so many, polar at most that share and held so long
MODEST = 3.0  # the paper's largest gain over SPRT with polar clusters is 9.0 / 3.5


def claims_of(runs: Sequence[Run]) -> tuple[Claim, ...]:
    """The statements, for those variants of the scenes that were run."""
    plain = [run for run in runs if not run.case.name]
    names = list(dict.fromkeys(run.case.name for run in runs if run.case.name))
    claims = [near_claim(plain, tracker) for tracker in TRACKERS]
    claims += [far_claim(plain, tracker) for tracker in TRACKERS]
    claims += [held_claim(plain), near_ospa_claim(plain), far_ospa_claim(plain), gain_claim(plain), modest_claim(plain)]
    return tuple(claims + [VARIANT_CLAIMS[name](runs, name) for name in names])


def mean(runs: Sequence[Run], value: str, key: Key, name: str = "") -> float:
    """Mean of a number over the seeds of a field, domain and tracker."""
    return float(np.mean(values(runs, value, key, name)))


def values(runs: Sequence[Run], value: str, key: Key, name: str = "") -> list[float]:
    """A number of each seed."""
    return [
        float(getattr(run, value))
        for run in runs
        if (run.case.area, run.domain, run.tracker) == key and run.case.name == name
    ]


def switches(runs: Sequence[Run], area: str, tracker: str, name: str = "") -> dict[str, float]:
    """Mean switches by domain."""
    return {domain: mean(runs, "switches", (area, domain, tracker), name) for domain in DOMAINS}


def paper(area: str, tracker: str) -> dict[str, float]:
    """The paper's switching cost by domain."""
    return {domain: PAPER[area, domain, tracker] for domain in DOMAINS}


def near_claim(runs: Sequence[Run], tracker: str) -> Claim:
    """Near: both domains within a factor."""
    ours = switches(runs, "near", tracker)
    low, high = sorted(ours.values())
    name = f"near field, {tracker}: switches with polar and Cartesian clusters within a factor {SAME:g}"
    return Claim(name, high <= SAME * low, ours, paper("near", tracker))


def far_claim(runs: Sequence[Run], tracker: str, name: str = "") -> Claim:
    """Far: many Cartesian switches, a third of them or less with polar clusters. Also of each seed alone."""
    found = switches(runs, "far", tracker, name)
    holds = far_holds(found["cartesian"], found["polar"])
    by_seed = {domain: values(runs, "switches", ("far", domain, tracker), name) for domain in DOMAINS}
    ours: dict[str, Any] = {
        **found,
        "seeds": len(by_seed["polar"]),
        "seeds in which it holds": sum(map(far_holds, by_seed["cartesian"], by_seed["polar"])),
        "one-to-one switches": {d: mean(runs, "id_changes", ("far", d, tracker), name) for d in DOMAINS},
        "held": held(runs, tracker, name),
    }
    what = f"far field, {tracker}: Cartesian clusters at least {MANY:g} switches, polar at most a third of them"
    return Claim(what, holds, ours, paper("far", tracker))


def far_holds(cartesian: float, polar: float) -> bool:
    """Whether these switches are many, and few beside them."""
    return cartesian >= MANY and polar <= SHARE * cartesian


def held_claim(runs: Sequence[Run]) -> Claim:
    """Far: switches alone would reward a tracker that holds nothing."""
    ours = {tracker: held(runs, tracker) for tracker in TRACKERS}
    holds = all(share["polar"] >= HELD for share in ours.values())
    return Claim(f"far field: polar clusters hold objects for a share of at least {HELD:g}", holds, ours, None)


def ospa(runs: Sequence[Run], area: str, tracker: str) -> dict[str, float]:
    """Mean OSPA by domain, in metres."""
    found: dict[str, float] = {}
    for domain in DOMAINS:
        mine = [r.ospa[0] for r in runs if (r.case.area, r.domain, r.tracker) == (area, domain, tracker)]
        found[domain] = float(np.mean(mine))
    return found


def near_ospa_claim(runs: Sequence[Run]) -> Claim:
    """Fig. 3."""
    ours = {tracker: ospa(runs, "near", tracker) for tracker in TRACKERS}
    holds = all(abs(o["polar"] / o["cartesian"] - 1.0) <= 0.1 for o in ours.values())
    return Claim("near field: mean OSPA of both domains within 10 % for every tracker", holds, ours, None)


def far_ospa_claim(runs: Sequence[Run]) -> Claim:
    """Fig. 4."""
    ours = {tracker: ospa(runs, "far", tracker) for tracker in TRACKERS}
    holds = all(o["polar"] < o["cartesian"] for o in ours.values())
    return Claim(
        "far field: mean OSPA with polar clusters below that with Cartesian for every tracker", holds, ours, None
    )


def gains(runs: Sequence[Run]) -> tuple[dict[str, dict[str, float]], dict[str, dict[str, float]]]:
    """Switches of SPRT over those of each other tracker, polar clusters; ours and the paper's."""
    ours, theirs = {}, {}
    for area in ("near", "far"):
        baseline = mean(runs, "switches", (area, "polar", "sprt"))
        ours[area] = {t: ratio(baseline, mean(runs, "switches", (area, "polar", t))) for t in TRACKERS[1:]}
        theirs[area] = {t: PAPER[area, "polar", "sprt"] / PAPER[area, "polar", t] for t in TRACKERS[1:]}
    return ours, theirs


def ratio(a: float, b: float) -> float:
    """a / b, 1 where both are 0, infinite where b alone is."""
    return a / b if b > 0 else (1.0 if a == 0 else np.inf)


def gain_claim(runs: Sequence[Run]) -> Claim:
    """Complex trackers gain: the paper's do, in both fields."""
    ours, theirs = gains(runs)
    holds = all(gain >= 1.0 for area in ours.values() for gain in area.values())
    return Claim("polar clusters: complex trackers gain over sprt (its switches / theirs)", holds, ours, theirs)


def modest_claim(runs: Sequence[Run]) -> Claim:
    """... modestly."""
    ours, theirs = gains(runs)
    holds = all(gain <= MODEST for area in ours.values() for gain in area.values())
    name = f"polar clusters: complex trackers gain at most a factor {MODEST:g} over sprt"
    return Claim(name, holds, ours, theirs)


def all_far_claim(runs: Sequence[Run], name: str) -> Claim:
    """The far field's statement in a variant of the scene, for every tracker."""
    what = f"far field, {name}: Cartesian clusters at least {MANY:g} switches, polar at most a third, for every tracker"
    return Claim(what, all_hold(runs, name), far_numbers(runs, name), None)


def ends_claim(runs: Sequence[Run], name: str) -> Claim:
    """Where that statement is not true of every tracker any more."""
    what = f"far field, {name}: the effect ends, the statement on switches does not hold for every tracker"
    return Claim(what, not all_hold(runs, name), far_numbers(runs, name), None)


def all_hold(runs: Sequence[Run], name: str) -> bool:
    """The far field's statement on switches for every tracker."""
    return all(far_claim(runs, tracker, name).holds for tracker in TRACKERS)


def far_numbers(runs: Sequence[Run], name: str) -> dict[str, Any]:
    """Switches and held share of a variant by tracker and domain, and how often objects had a cluster."""
    ours: dict[str, Any] = {
        t: {"switches": switches(runs, "far", t, name), "held": held(runs, t, name)} for t in TRACKERS
    }
    ours["objects with a cluster"] = {d: mean(runs, "seen", ("far", d, "sprt"), name) for d in DOMAINS}
    return ours


def held(runs: Sequence[Run], tracker: str, name: str = "") -> dict[str, float]:
    """Mean held share in the far field by domain."""
    return {domain: mean(runs, "held", ("far", domain, tracker), name) for domain in DOMAINS}


def own_pair_claim(runs: Sequence[Run], name: str) -> Claim:
    """Each domain with the pair that clusters best."""
    ours = far_numbers(runs, name)
    pairs = next(run.case.pairs for run in runs if run.case.name == name)
    ours["eps and min_points"] = {domain: list(pair) for domain, pair in pairs.items()}
    each = [switches(runs, "far", tracker, name) for tracker in TRACKERS]
    holds = all(found["polar"] <= found["cartesian"] for found in each)
    return Claim(
        f"far field, {name}: polar clusters switch no more than Cartesian for every tracker", holds, ours, None
    )


OWN_PAIR = "each domain at its own best pair"
FINE, COARSE = "4,096 azimuths", "30 m cells"
STEADY = {"echoes that fade less (shape 4)": 4.0, "echoes that fade less (shape 6)": 6.0}
VARIANT_CLAIMS: Mapping[str, Callable[[Sequence[Run], str], Claim]] = {
    **dict.fromkeys(STEADY, all_far_claim),
    FINE: ends_claim,
    COARSE: ends_claim,
    OWN_PAIR: own_pair_claim,
}


def table_one(runs: Sequence[Run]) -> Table:
    """Table I: switching cost, ours beside the paper's."""
    rows = []
    for area in ("near", "far"):
        for domain in DOMAINS:
            for whose in ("ours", "paper"):
                cells = [
                    PAPER[area, domain, t] if whose == "paper" else mean(runs, "switches", (area, domain, t))
                    for t in TRACKERS
                ]
                rows.append((area, domain, whose, *cells))
    title = "Table I: switching cost of T-GOSPA (c = 100 m, p = 2, gamma = 1 m), mean over seeds"
    return Table(title, ("field", "clusters", "whose", *TRACKERS), tuple(rows), text_columns=3)


def table_runs(runs: Sequence[Run]) -> Table:
    """Every run."""
    header = (
        "field", "variant", "clusters", "tracker", "seed", "scans", "switches", "switches_20m", "one_to_one", "held",
        "held_least", "seen", "ids", "tracks", "objects", "clusters_a_scan", "ospa_m", "localisation_m",
        "cardinality_m",
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = [
        (
            r.case.area, r.case.name or "as it is", r.domain, r.tracker, str(r.case.seed), r.case.scans, r.switches,
            r.switches_strict, r.id_changes, r.held, r.held_least, r.seen, r.ids, r.tracks, r.objects, r.clusters,
            *map(float, r.ospa.mean(axis=1)),
        )
        for r in runs
    ]  # fmt: skip
    return Table("every run", header, tuple(rows), text_columns=5)
