"""A scene as recordings: CAT240 video, one record a spoke, and beside them truth, AIS and labelled cells."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from maritrack.errors import InputError
from maritrack.fanout import fan_out
from maritrack.geo import TWO_PI, wrap
from maritrack.simulate.aistable import ais_path, ais_table
from maritrack.simulate.antenna import RadarSettings
from maritrack.simulate.echoes import Mover, movers
from maritrack.simulate.labels import label_file, labels_path
from maritrack.simulate.radar import Turn, labelled_turn
from maritrack.simulate.scenery import Ground, grounds, scenery
from maritrack.simulate.scenes import Scene
from maritrack.simulate.sparse import backdrop, sparse_turn
from maritrack.simulate.stations import aboard, carried, legs, recording_path, sensors_path, sensors_table
from maritrack.simulate.turnrecords import encode_turn
from maritrack.simulate.vessels import Vessel
from maritrack.simulate.writing import scans_asked
from maritrack.types import FloatArray

SEED_STEP = 1_000_003  # between the noises of the radars of a scene


def simulate(
    scene: Scene,
    out: Path,
    *,
    seed: int,
    scans: int | None = None,
    ais: bool = True,
    labels: bool = True,
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Write OUT and beside it what was true; returns what was written.

    `<OUT without suffix>.truth.json` always, `.ais.csv` and `.labels.parquet` if wanted. All appear when they are
    complete. Of several radars each has a recording and labels of its own, `<OUT>-<name>.cat240`, and
    `<OUT>.sensors.toml` says where they are; `workers` of them are drawn at a time. `progress(done, of)` is called
    after each scan, of several radars after each recording.
    """
    n_scans = scans_asked(scene.scans, scans, seed=seed)
    rows = truth_rows(scene, n_scans + 1)  # a pass beyond the end, so that truth is known up to it
    texts = {truth_path(out): _document(scene, rows)}
    texts |= {ais_path(out): ais_table(scene, n_scans)} if ais else {}
    placed = bool(scene.others or scene.radar.aboard)
    texts |= {sensors_path(out): sensors_table(scene)} if placed else {}
    recordings = [recording_path(out, radar.name) if scene.others else out for radar in scene.radars]
    jobs = [
        _Station(scene, i, path, n_scans, seed, labels, None if scene.others else progress)
        for i, path in enumerate(recordings)
    ]
    tick = progress if scene.others else None
    try:
        sizes = dict(fan_out(_write, jobs, workers=workers, tick=tick))
        for path, text in texts.items():
            _partial(path).write_text(text, "utf-8")
        cells_in = [labels_path(path) for path in recordings] if labels else []
        for path in (*recordings, *cells_in, *texts):
            _partial(path).replace(path)
    except OSError as error:
        raise InputError(f"{out}: {error.strerror or error}") from None
    octets, cells = (sum(sizes[i][part] for i in range(len(jobs))) for part in (0, 1))
    return {
        "recording": str(recordings[0]),
        **({"recordings": [str(path) for path in recordings]} if scene.others else {}),
        **({"sensors": str(sensors_path(out))} if placed else {}),
        "truth": str(truth_path(out)),
        "octets": octets,
        "scans": n_scans,
        "records": n_scans * sum(radar.spokes for radar in scene.radars),
        "truth_rows": len(rows),
        "objects": len(scene.vessel),
        "seed": seed,
        **({"ais": str(ais_path(out)), "ais_reports": texts[ais_path(out)].count("\n") - 1} if ais else {}),
        **({"labels": str(cells_in[0]), "labelled_cells": cells} if labels else {}),
    }


@dataclass(frozen=True, slots=True)
class _Station:
    """One recording to be written."""

    scene: Scene
    index: int  # of the radar
    path: Path
    n_scans: int
    seed: int
    labels: bool
    progress: Callable[[int, int], None] | None


def _write(job: _Station) -> tuple[int, int]:
    """Write a recording and, where wanted, its labels under their partial names; octets and labelled cells."""
    octets = cells = 0
    radar = job.scene.radars[job.index]
    seen, carrier = aboard(job.scene, radar)
    bow = carrier.course() if carrier is not None and radar.head_up else None
    with ExitStack() as stack:
        file = stack.enter_context(_partial(job.path).open("wb"))
        table = stack.enter_context(label_file(_partial(labels_path(job.path)), seen)) if job.labels else None
        heard_turns = turns(job.scene, job.n_scans, seed=job.seed, station=job.index, labels=job.labels)
        for k, heard in enumerate(heard_turns):
            octets += file.write(encode_turn(radar, heard.video, k, start_s=job.scene.start_s, bow=bow))
            if table is not None:
                cells += len(heard.cells)
                table.add(k, heard)
            if job.progress is not None:
                job.progress(k + 1, job.n_scans)
    return octets, cells


def _partial(path: Path) -> Path:
    return path.with_name(path.name + ".partial")


def truth_path(recording: Path) -> Path:
    """Where the truth of a recording lies: rec.cat240 -> rec.truth.json."""
    return recording.with_name(recording.stem + ".truth.json")


def turns(scene: Scene, n_scans: int, *, seed: int, station: int = 0, labels: bool = True) -> Iterator[Turn]:
    """What a radar of a scene hears, turn by turn; of several each has noise of its own over the same ground."""
    seen, carrier = aboard(scene, scene.radars[station])
    radar, own_seed = seen.radar, seed + SEED_STEP * station
    maps = grounds(scene.land, seed=seed) if scene.others or carrier is not None else None
    if carrier is None:
        yield from _turns_at(seen, radar, range(n_scans), seed=own_seed, maps=maps, labels=labels)
        return
    for place in legs(radar, carrier, n_scans):
        at = replace(radar, east_m=place.east_m, north_m=place.north_m)
        yield from _turns_at(seen, at, place.turns, seed=own_seed, maps=maps, labels=labels, carrier=carrier)


def _turns_at(
    scene: Scene, radar: RadarSettings, numbers: range, *, seed: int, maps: Sequence[Ground] | None, labels: bool,
    carrier: Vessel | None = None,
) -> Iterator[Turn]:  # fmt: skip
    """Turns of a radar before the scenery of one place; aboard, it hears vessels from where it is in each turn."""
    still = scenery(radar, scene.land, scene.sea, seed=seed, maps=maps)
    behind = backdrop(radar, still) if radar.sparse_noise else None
    for k in numbers:
        here = radar if carrier is None else carried(radar, carrier, k)
        fleet = movers(here, scene.vessel)
        if behind is not None:
            yield sparse_turn(here, fleet, behind, scene.sea, k, seed=seed, labels=labels)
        else:
            yield labelled_turn(here, fleet, still, scene.sea, k, seed=seed, labels=labels)


def truth_rows(scene: Scene, n_scans: int) -> list[dict[str, Any]]:
    """One row for each time the middle of the beam passes the middle of an object within range, by time."""
    radar = scene.radar
    rows = []
    for mover in movers(radar, scene.vessel):
        passes_s = pass_times_s(radar, mover, n_scans)
        state = mover.course.at(passes_s)
        near = np.hypot(state.position_m[:, 0], state.position_m[:, 1]) < radar.edges_m[-1]
        near |= bool(scene.others)  # another radar may see what this one doesn't
        v = mover.vessel
        for i in np.nonzero(near)[0]:
            row: dict[str, Any] = {"id": v.id} | ({"name": v.name} if v.name else {})
            row |= {
                "time_s": round(scene.start_s + float(passes_s[i]), 4),
                "east_m": round(float(state.position_m[i, 0]) + radar.east_m, 3),
                "north_m": round(float(state.position_m[i, 1]) + radar.north_m, 3),
                "vel_east_mps": round(float(state.velocity_mps[i, 0]), 4) + 0.0,
                "vel_north_mps": round(float(state.velocity_mps[i, 1]), 4) + 0.0,
                "heading_deg": round(float(np.degrees(state.heading_rad[i])), 3),
                "length_m": v.length_m,
                "width_m": v.width_m,
            }
            rows.append(row)
    return sorted(rows, key=lambda r: (r["time_s"], r["id"]))


def pass_times_s(radar: RadarSettings, mover: Mover, n_scans: int) -> FloatArray:
    """When the beam points at midships, within the recording: the antenna's angle meets the bearing.

    Bearings are unwrapped, so an object that crosses North is passed once a turn of the beam relative to it.
    """

    def bearing_rad(t_s: FloatArray) -> FloatArray:
        position_m = mover.course.at(t_s).position_m
        return np.asarray(np.arctan2(position_m[:, 0], position_m[:, 1]), dtype=np.float64)

    grid_s = radar.turn_s * np.arange(n_scans + 1.0)
    unwrapped_rad = np.unwrap(bearing_rad(grid_s))
    low, high = unwrapped_rad.min() / TWO_PI, unwrapped_rad.max() / TWO_PI
    turns = np.arange(np.floor(-high) - 1.0, n_scans - np.floor(low) + 1.0)
    t_s = radar.turn_s * turns
    for _ in range(20):  # contracts by (angular speed of the object) / (that of the antenna)
        near_rad = np.interp(t_s, grid_s, unwrapped_rad)
        exact_rad = near_rad + wrap(bearing_rad(np.clip(t_s, 0.0, grid_s[-1])) - near_rad)
        t_s = radar.turn_s * (turns + exact_rad / TWO_PI)
    return np.asarray(t_s[(t_s >= 0.0) & (t_s < grid_s[-1])], dtype=np.float64)


def _document(scene: Scene, rows: list[dict[str, Any]]) -> str:
    """The truth as maritrack-points/1, a row a line."""
    head: Mapping[str, Any] = {
        "format": "maritrack-points/1",
        "frame": "enu",
        "origin": {"lat_deg": scene.lat_deg, "lon_deg": scene.lon_deg},
        "sensors": {
            f"{radar.sac}-{radar.sic}": {
                "east_m": radar.east_m,
                "north_m": radar.north_m,
                "sigma_range_m": round(max(radar.cell_m, radar.pulse_m) / 12**0.5, 3),
                "sigma_azimuth_deg": round(max(360.0 / radar.spokes, radar.beam_deg) / 12**0.5, 4),
            }
            for radar in scene.radars
            if not radar.aboard
        },
        "scans": [],
    }
    lines = ",\n".join(json.dumps(row, separators=(",", ":")) for row in rows)
    return json.dumps(head, indent=1)[:-2] + f',\n "truth": [\n{lines}\n]}}\n'
