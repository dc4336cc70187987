"""How `maritrack tune` tells its studies to people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from . import render


def clustering(document: Mapping[str, Any]) -> None:
    """Which eps and min_points cluster best, for people."""
    points, empty = document["points"], document["scans_without_object"]
    print(f"{document['scans']} scans ({empty} without an object left out); points: " + ", ".join(
        f"{n} {name}" for name, n in points.items()
    ))  # fmt: skip
    print(f"labels: {document['labels']}")
    rows = [
        (domain, name, f"{pair['eps_m']:g}", str(pair["min_points"]), f"{pair['ari']:.4f}",
         f"{pair['count_difference']:.2f}", f"{pair['count_bias']:+.2f}")
        for domain, pairs in document["domains"].items()
        for name, pair in pairs.items() if pair is not None
    ]  # fmt: skip
    header = ("domain", "pair", "eps [m]", "min_points", "ARI", "|clusters - objects|", "clusters - objects")
    render.table("mean per scan", header, rows, text_columns=2)
    print(f"chosen: {document['rule']}")
    for domain, pairs in document["domains"].items():
        chosen = pairs["chosen"]
        print(
            f"use it: --set cluster.method={domain} --set cluster.eps_m={chosen['eps_m']} --set cluster.eps_cells=0.0 "
            f"--set cluster.min_points={chosen['min_points']}"
        )
    for name, path in document.get("outputs", {}).items():
        print(f"{name}: {path}")


def tracking(document: Mapping[str, Any]) -> None:
    """The rows of a study of trackers, the best first, for people."""
    by, keys = document["by"], list(document["grid"])
    told: Mapping[str, float] = next((row["metrics"] for row in document["rows"] if row["metrics"]), {})
    wanted = (by, "gospa", "gospa_missed", "gospa_false", "gospa_unexplained", "switches", "held_by_one")
    names = [name for name in dict.fromkeys(wanted) if name in told]
    rows = []
    for row in document["rows"]:
        values = [str(row["values"][key]) for key in keys]
        metrics = [render.number((row["metrics"] or {}).get(name)) for name in names]
        rows.append((*values, *metrics, *([row["error"] or ""] if any(r["error"] for r in document["rows"]) else [])))
    header = (*keys, *names, *(["error"] if rows and len(rows[0]) > len(keys) + len(names) else []))
    title = f"mean per scan ({document['preset']}; switches: all), the smallest {by} first"
    render.table(title, header, rows, text_columns=len(keys))
    for name, path in document.get("outputs", {}).items():
        print(f"{name}: {path}")
