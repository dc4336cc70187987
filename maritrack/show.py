"""What an archive or a recording holds, as one document."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from maritrack.config import load_config
from maritrack.io.archive import iter_messages, read_archive
from maritrack.io.mcap_walk import MAGIC
from maritrack.io.messages import OUTPUTS
from maritrack.recording import default_preset, kinds_of, open_inputs, open_recording, side_documents
from maritrack.types import Damage, Frame, Origin

DAY_NS = 86_400 * 10**9
NO_DATE_NS = 1000 * DAY_NS  # times before are of a recording without a date
GAP = 1.8  # times the usual period
MAX_GAPS = 100  # that are listed
MAX_DAMAGE = 20


def is_archive(path: Path) -> bool:
    """Whether a file begins like an archive."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def time_text(t_ns: int) -> str:
    """A time as ISO 8601, without a date where it is only the time of day."""
    moment = datetime.fromtimestamp(0, UTC) + timedelta(microseconds=t_ns // 1000)
    if t_ns >= NO_DATE_NS:
        return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")
    return moment.time().isoformat(timespec="milliseconds")


def show_archive(path: Path) -> dict[str, Any]:
    """Manifest, counts, channels, time span and damage of an archive; all of it is read and checked."""
    archive = read_archive(path)
    manifest = archive.manifest
    damage: list[Damage] = list(archive.damage)
    count: dict[str, int] = {}
    size: dict[str, int] = {}
    first_ns = last_ns = None
    for message in iter_messages(path, {*archive.inputs, *OUTPUTS}, on_damage=damage.append):
        count[message.topic] = count.get(message.topic, 0) + 1
        size[message.topic] = size.get(message.topic, 0) + len(message.data)
        first_ns, last_ns = message.t_ns if first_ns is None else first_ns, message.t_ns
    return {
        "what": "archive", "path": str(path), "octets": path.stat().st_size, "complete": archive.complete,
        "interrupted": bool(archive.summary.get("interrupted")), "run_id": manifest.run_id,
        "tracker": manifest.tracker, "preset": manifest.preset, "seed": manifest.seed,
        "inputs": [
            {"kind": kind, "sha256": digest, "channel": channel, "archived": archive.full}
            for kind, digest, channel in zip(manifest.input_kind, manifest.input_sha256, archive.inputs, strict=True)
        ],
        "side": {name: len(octets) for name, octets in archive.side.items()}, "origin": _origin(manifest.origin),
        "code_sha256": manifest.code_sha256, "versions": dict(manifest.versions),
        "scans": count.get("/scan", 0), **_span(first_ns, last_ns),
        "channels": [{"topic": topic, "messages": count[topic], "octets": size[topic]} for topic in sorted(count)],
        "counts": dict(archive.counts), "metrics": dict(archive.summary.get("metrics", {})),
        "damage": [_damage(d) for d in dict.fromkeys(damage)][:MAX_DAMAGE],
    }  # fmt: skip


@dataclass
class _Seen:
    """What the scans of one sensor have shown so far."""

    t_ns: array[int] = field(default_factory=lambda: array("q"))
    spokes: array[int] = field(default_factory=lambda: array("q"))
    points: int = 0
    cells: dict[tuple[float, float, int], int] = field(default_factory=dict)  # (cell, range, bits) -> scans
    width_rad: float = 0.0

    def add(self, frame: Frame) -> None:
        scan = frame.scan
        self.t_ns.append(scan.t_ns)
        self.spokes.append(scan.n_spokes)
        self.points += 0 if scan.points is None else len(scan.points)
        key = (scan.sensor.range_res_m, scan.sensor.max_range_m, scan.sensor.bits)
        self.cells[key] = self.cells.get(key, 0) + 1
        self.width_rad = scan.sensor.azimuth_res_rad


def show_recording(paths: Sequence[Path]) -> dict[str, Any]:
    """Sensors, scans, periods, cells, times and gaps of a recording, read as a run would read it."""
    octets = open_inputs(paths)
    kinds = kinds_of(octets)
    config = load_config(preset=default_preset(kinds))
    side = side_documents(paths, truth=None, own_ship=None, sensors=None)
    recording = open_recording(octets, kinds, side, config)
    sensors: dict[str, _Seen] = {}
    warnings: dict[str, int] = dict(recording.damage)
    first_ns = last_ns = None
    for frame in recording.frames:
        sensors.setdefault(frame.scan.sensor.id, _Seen()).add(frame)
        for damage in frame.damage:
            warnings[damage.code] = warnings.get(damage.code, 0) + damage.count
        first_ns, last_ns = frame.scan.t_start_ns if first_ns is None else first_ns, frame.t_ns
    return {
        "what": "recording", "path": ", ".join(map(str, paths)), "kind": ", ".join(dict.fromkeys(kinds)),
        "octets": sum(max(o.size, 0) for o in octets), "origin": _origin(recording.origin),
        "truth": None if recording.reference is None else len(recording.reference),
        "scans": sum(len(seen.t_ns) for seen in sensors.values()), **_span(first_ns, last_ns),
        "sensors": [_sensor(name, sensors[name]) for name in sorted(sensors)],
        "warnings": dict(sorted(warnings.items())),
    }  # fmt: skip


def _sensor(name: str, seen: _Seen) -> dict[str, Any]:
    t_ns = np.array(seen.t_ns, np.int64)
    step_s = np.diff(t_ns) * 1e-9
    period_s = float(np.median(step_s)) if len(step_s) else None
    gaps = np.flatnonzero(step_s > GAP * period_s) if period_s else np.zeros(0, np.int64)
    (cell_m, range_m, bits), _ = max(seen.cells.items(), key=lambda item: item[1])
    table: dict[str, Any] = {
        "id": name, "scans": len(t_ns), "period_s": period_s, "gaps": len(gaps),
        "gap_list": [{"at": time_text(int(t_ns[i])), "seconds": float(step_s[i])} for i in gaps[:MAX_GAPS].tolist()],
    }  # fmt: skip
    if any(seen.spokes):
        table |= {
            "spokes_per_turn": int(np.median(np.array(seen.spokes))), "spokes_least": min(seen.spokes),
            "spokes_most": max(seen.spokes), "cell_m": cell_m, "range_m": range_m, "bits": bits,
            "spoke_width_deg": float(np.degrees(seen.width_rad)), "range_scales": len(seen.cells),
        }  # fmt: skip
    else:
        table |= {"points": seen.points}
    return table


def _span(first_ns: int | None, last_ns: int | None) -> dict[str, Any]:
    if first_ns is None or last_ns is None:
        return {"from": None, "to": None, "duration_s": None}
    return {"from": time_text(first_ns), "to": time_text(last_ns), "duration_s": (last_ns - first_ns) * 1e-9}


def _origin(origin: Origin | None) -> dict[str, float] | None:
    return None if origin is None else {"lat_deg": origin.lat_deg, "lon_deg": origin.lon_deg}


def _damage(damage: Damage) -> dict[str, Any]:
    return {"code": damage.code, "offset": damage.offset, "message": damage.message}
