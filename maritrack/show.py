"""What an archive or a recording holds, as one document.

Radar video is told by its headers (`maritrack.survey`), in less time than the rest takes to import: so that is imported
where it is used.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field
from glob import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from maritrack.errors import InputError
from maritrack.io import ARCHIVE, sniff
from maritrack.io.containers.kinds import MCAP_MAGIC
from maritrack.io.octets import HEAD, octets_from_file, octets_from_stdin
from maritrack.io.times import time_text
from maritrack.survey import survey

if TYPE_CHECKING:
    from maritrack.types import Damage, Frame, Origin

GAP = 1.8  # times the usual period
MAX_GAPS = 100  # that are listed
MAX_DAMAGE = 20


def is_archive(path: Path) -> bool:
    """Whether a file begins like the archive of a run."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(HEAD)
    return head.startswith(MCAP_MAGIC) and ARCHIVE in head


def show_archive(path: Path) -> dict[str, Any]:
    """Manifest, counts, channels, time span and damage of an archive; all of it is read and checked."""
    from maritrack.io.archive import iter_messages, read_archive
    from maritrack.io.messages import OUTPUTS

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
        "offline": bool(manifest.smoothed_from), "smoothed_from": manifest.smoothed_from or None,
        "joined": manifest.joined or None,
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


def show_recording(path: Path) -> dict[str, Any]:
    """Sensors, turns, ranges, times, gaps and damage of a recording; "-" is standard input.

    Radar video is told as `maritrack.survey` describes it, other recordings by the frames that a run would have.
    """
    octets = octets_from_stdin() if str(path) == "-" else octets_from_file(path, "")
    kind = sniff(octets.head, octets.name)
    if kind != "cat240":
        return _show_frames(path)
    told = {"what": "recording", "path": str(path), "kind": kind, **survey(octets)}
    if not any(told[what] for what in ("sensors", "other_streams", "summaries", "damage")):
        raise InputError(f"{octets.name}: {told['container']} without datagrams")
    return {**told, "origin": None, "truth": _truth_beside(path)}


def _truth_beside(path: Path) -> int | None:
    """How many objects the truth beside a recording has; None without one."""
    stem = path.name.partition(".")[0]
    if not any(path.parent.glob(f"{escape(stem)}*ruth.json")):
        return None
    from maritrack.io.documents import read_document
    from maritrack.io.truth import find_truth, read_reference

    found = find_truth(path)
    return None if found is None else len(read_reference(read_document(found), name=str(found), origin=None))


@dataclass
class _Seen:
    """What the scans of one sensor have shown so far."""

    t_ns: array[int] = field(default_factory=lambda: array("q"))
    points: int = 0

    def add(self, frame: Frame) -> None:
        self.t_ns.append(frame.scan.t_ns)
        self.points += 0 if frame.scan.points is None else len(frame.scan.points)


def _show_frames(path: Path) -> dict[str, Any]:
    """Sensors, scans, periods, points, times and gaps of a recording of points, read as a run would read it."""
    from maritrack.config import load_config
    from maritrack.recording import default_preset, kinds_of, open_inputs, open_recording, side_documents

    octets = open_inputs([path])
    kinds = kinds_of(octets)
    over = {"images": {"centre_px": [0.0, 0.0], "pixel_m": 1.0}}  # nothing that is told depends on them
    config = load_config(preset=default_preset(kinds), over=over)
    side = side_documents([path], truth=None, own_ship=None, sensors=None)
    recording = open_recording(octets, kinds, side, config)
    sensors: dict[str, _Seen] = {}
    warnings = {damage.code: damage.count for damage in recording.damage}
    first_ns = last_ns = None
    for frame in recording.frames:
        sensors.setdefault(frame.scan.sensor.id, _Seen()).add(frame)
        for damage in frame.damage:
            warnings[damage.code] = warnings.get(damage.code, 0) + damage.count
        first_ns, last_ns = frame.scan.t_start_ns if first_ns is None else first_ns, frame.t_ns
    return {
        "what": "recording", "path": str(path), "kind": ", ".join(dict.fromkeys(kinds)),
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
    return {
        "id": name, "scans": len(t_ns), "period_s": period_s, "gaps": len(gaps),
        "gap_list": [{"at": time_text(int(t_ns[i])), "seconds": float(step_s[i])} for i in gaps[:MAX_GAPS].tolist()],
        "points": seen.points,
    }  # fmt: skip


def _span(first_ns: int | None, last_ns: int | None) -> dict[str, Any]:
    if first_ns is None or last_ns is None:
        return {"from": None, "to": None, "duration_s": None}
    return {"from": time_text(first_ns), "to": time_text(last_ns), "duration_s": (last_ns - first_ns) * 1e-9}


def _origin(origin: Origin | None) -> dict[str, float] | None:
    return None if origin is None else {"lat_deg": origin.lat_deg, "lon_deg": origin.lon_deg}


def _damage(damage: Damage) -> dict[str, Any]:
    return {"code": damage.code, "offset": damage.offset, "message": damage.message}
