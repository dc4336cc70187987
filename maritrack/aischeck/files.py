"""The files of a check: verify-ais.json, .geojson where the run knows its place, and .rrd."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from maritrack.aischeck.check import Check
from maritrack.aischeck.judge import UNSEEN
from maritrack.aischeck.report import geojson, hints, track_way, way_of
from maritrack.errors import UsageError

STEM = "verify-ais"


def write_files(check: Check, told: dict[str, Any], folder: Path, *, rrd: bool) -> dict[str, str]:
    """Write them into a folder, which is made; their paths by kind."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{folder}: {error.strerror or error}") from None
    written = {"json": folder / f"{STEM}.json"}
    _write(written["json"], json.dumps(told, indent=2, sort_keys=True, ensure_ascii=False, allow_nan=False) + "\n")
    if check.origin is not None:
        written["geojson"] = folder / f"{STEM}.geojson"
        _write(written["geojson"], geojson(check))
    if rrd:
        written["rrd"] = folder / f"{STEM}.rrd"
        draw(check, told, written["rrd"])
    return {kind: str(path) for kind, path in written.items()}


def draw(check: Check, told: dict[str, Any], path: Path) -> None:
    """The chart: ways by verdict, tracks, what goes elsewhere, leaps and the radar."""
    from maritrack.sinks.aismap import Shape, write_ais_map

    index = {ship.id: s for s, ship in enumerate(check.ships)}
    drawn = [Shape("track", "", track_way(check, track)) for track in np.unique(check.rows.id).tolist()]
    for one in check.verdicts:
        name = one.name or one.id
        drawn.append(Shape(one.verdict, f"{name} ?" if one.verdict == UNSEEN else name, way_of(check, index[one.id])))
        if one.displaced is not None:
            place = np.array(one.place_m)
            line = np.stack([place, place + one.displaced.offset_m])
            drawn.append(Shape("displaced", f"track {one.displaced.track}", line))
    for alone in check.strangers:
        kind = "undecided" if alone.lobe_of else "track without AIS"
        drawn.append(Shape(kind, f"track {alone.track}", track_way(check, alone.track)))
    drawn += [Shape("leap", one.id, np.array([one.position_m])) for one in check.jumps]
    rows = check.rows
    at = rows.position_m - rows.range_m[:, None] * np.stack([np.sin(rows.azimuth_rad), np.cos(rows.azimuth_rad)], -1)
    centre_m = np.median(at, axis=0) if len(at) else np.zeros(2)
    drawn.append(Shape("radar", "radar", centre_m[None]))
    far = max(float(check.looks.range_m.max(initial=0.0)), float(rows.range_m.max(initial=0.0)), 1000.0)
    write_ais_map(
        path,
        f"{check.run_id}-ais",
        drawn,
        origin=check.origin,
        centre_m=centre_m,
        range_m=far,
        text=markdown(check, told),
    )


def markdown(check: Check, told: dict[str, Any]) -> str:
    """The report for people who look at the chart."""
    lines = ["# AIS checked by radar", "", f"{check.scans} scans, {len(check.verdicts)} ships looked at.", ""]
    lines += [f"- {hint}" for hint in hints(check)]
    lines += ["", "## Findings", ""]
    lines += [f"- **{row['kind']}** {_who(row)}: {row['what']}" for row in told["findings"]] or ["none"]
    lines += ["", "## Ships", "", "| ship | verdict | why |", "|---|---|---|"]
    lines += [f"| {_cell(one.name or one.id)} | {one.verdict} | {_cell(one.why)} |" for one in check.verdicts]
    return "\n".join(lines) + "\n\n" + str(told["reading"]) + "\n"


def _who(row: dict[str, Any]) -> str:
    return _cell(row.get("name") or row.get("ship") or f"track {row['track']}")


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _write(path: Path, text: str) -> None:
    partial = path.with_name(path.name + ".partial")
    try:
        partial.write_text(text, "utf-8")
        os.replace(partial, path)
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror or error}") from None
