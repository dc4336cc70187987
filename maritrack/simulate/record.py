"""A scene as a recording: CAT240 video, one record a spoke, and beside it truth, AIS and labelled cells."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maritrack.errors import InputError, UsageError
from maritrack.geo import C_MPS, TWO_PI, wrap
from maritrack.io.cat240.encode import encode_video
from maritrack.simulate.aistable import ais_path, ais_table
from maritrack.simulate.antenna import RadarSettings
from maritrack.simulate.echoes import Mover, movers
from maritrack.simulate.labels import label_file, labels_path
from maritrack.simulate.radar import Turn, labelled_turn
from maritrack.simulate.scenery import scenery
from maritrack.simulate.scenes import Scene
from maritrack.simulate.sparse import backdrop, sparse_turn
from maritrack.types import FloatArray, IntArray

DAY_TICKS = 86400 * 128  # of the time of day
IDX_AT, AZIMUTH_AT = 8, 12  # in a data block of one record with items 010, 000, 020, 041, ...


def simulate(
    scene: Scene,
    out: Path,
    *,
    seed: int,
    scans: int | None = None,
    ais: bool = True,
    labels: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Write OUT and beside it what was true; returns what was written.

    `<OUT without suffix>.truth.json` always, `.ais.csv` and `.labels.parquet` if wanted. All appear when they are
    complete. `progress(done, of)` is called after each scan.
    """
    n_scans = scene.scans if scans is None else scans
    if n_scans < 1 or seed < 0:
        raise UsageError(f"scans = {n_scans} starts at 1, seed = {seed} at 0")
    rows = truth_rows(scene, n_scans + 1)  # a pass beyond the end, so that truth is known up to it
    wanted = {"recording": out, "truth": truth_path(out)}
    wanted |= ({"ais": ais_path(out)} if ais else {}) | ({"labels": labels_path(out)} if labels else {})
    partial = {key: path.with_name(path.name + ".partial") for key, path in wanted.items()}
    try:
        octets, cells = _write(scene, partial, n_scans, seed=seed, progress=progress)
        partial["truth"].write_text(_document(scene, rows), "utf-8")
        reports = ais_table(scene, n_scans) if ais else ""
        if ais:
            partial["ais"].write_text(reports, "utf-8")
        for key, path in wanted.items():
            partial[key].replace(path)
    except OSError as error:
        raise InputError(f"{out}: {error.strerror or error}") from None
    return {
        **{key: str(path) for key, path in wanted.items()},
        "octets": octets,
        "scans": n_scans,
        "records": n_scans * scene.radar.spokes,
        "truth_rows": len(rows),
        "objects": len(scene.vessel),
        "seed": seed,
        **({"ais_reports": reports.count("\n") - 1} if ais else {}),
        **({"labelled_cells": cells} if labels else {}),
    }


def _write(
    scene: Scene, paths: Mapping[str, Path], n_scans: int, *, seed: int, progress: Callable[[int, int], None] | None
) -> tuple[int, int]:
    """The recording and, where they have a path, the labels; octets and labelled cells."""
    octets = cells = 0
    with ExitStack() as stack:
        file = stack.enter_context(paths["recording"].open("wb"))
        table = stack.enter_context(label_file(paths["labels"], scene)) if "labels" in paths else None
        for k, heard in enumerate(turns(scene, n_scans, seed=seed, labels=table is not None)):
            octets += file.write(encode_turn(scene.radar, heard.video, k, start_s=scene.start_s))
            if table is not None:
                cells += len(heard.cells)
                table.add(k, heard)
            if progress is not None:
                progress(k + 1, n_scans)
    return octets, cells


def truth_path(recording: Path) -> Path:
    """Where the truth of a recording lies: rec.cat240 -> rec.truth.json."""
    return recording.with_name(recording.stem + ".truth.json")


def turns(scene: Scene, n_scans: int, *, seed: int, labels: bool = True) -> Iterator[Turn]:
    """What the radar of a scene hears, turn by turn."""
    radar, fleet = scene.radar, movers(scene.radar, scene.vessel)
    still = scenery(radar, scene.land, scene.sea, seed=seed)
    if radar.sparse_noise:
        behind = backdrop(radar, still)
        for k in range(n_scans):
            yield sparse_turn(radar, fleet, behind, scene.sea, k, seed=seed, labels=labels)
        return
    for k in range(n_scans):
        yield labelled_turn(radar, fleet, still, scene.sea, k, seed=seed, labels=labels)


def encode_turn(radar: RadarSettings, video: NDArray[np.uint8], k: int, *, start_s: float) -> bytes:
    """The records of turn k: femto header, zlib, time of day rounded to 1/128 s, MSG_INDEX from 0.

    Spokes without echo differ in their head and their time only: they are one record, filled in for all at once.
    """
    borders = np.rint(np.arange(radar.spokes + 1) * 65536.0 / radar.spokes).astype(int) % 65536
    ticks = np.rint((start_s % 86400.0 + radar.times_s(k)) * 128.0).astype(int) % DAY_TICKS
    idx = (k * radar.spokes + np.arange(radar.spokes)) % 2**32
    cell_fs = round(2.0 * radar.cell_m / C_MPS * 1e15)

    def record(j: int) -> bytes:
        return encode_video(
            sac=radar.sac,
            sic=radar.sic,
            idx=int(idx[j]),
            start_az=int(borders[j]),
            end_az=int(borders[j + 1]),
            start_rg=radar.first_cell,
            cell_dur=cell_fs,
            cells=video[j],
            compress=True,
            tod=int(ticks[j]),
        )

    empty = np.nonzero(~video.any(axis=1))[0]
    records = dict.fromkeys(range(radar.spokes), b"")
    if len(empty):
        first = np.frombuffer(record(int(empty[0])), dtype=np.uint8)
        rows = np.repeat(first[None], len(empty), axis=0)
        rows[:, IDX_AT : IDX_AT + 4] = _big_endian(idx[empty], 4)
        rows[:, AZIMUTH_AT : AZIMUTH_AT + 2] = _big_endian(borders[empty], 2)
        rows[:, AZIMUTH_AT + 2 : AZIMUTH_AT + 4] = _big_endian(borders[empty + 1], 2)
        rows[:, -3:] = _big_endian(ticks[empty], 3)
        octets, size = rows.tobytes(), len(first)
        records |= {int(j): octets[i * size : (i + 1) * size] for i, j in enumerate(empty)}
    return b"".join(known or record(j) for j, known in records.items())


def _big_endian(values: IntArray, octets: int) -> NDArray[np.uint8]:
    """Integers (n,) as octets (n, octets)."""
    return np.ascontiguousarray(values, dtype=">u4").view(np.uint8).reshape(-1, 4)[:, 4 - octets :]


def truth_rows(scene: Scene, n_scans: int) -> list[dict[str, Any]]:
    """One row for each time the middle of the beam passes the middle of an object within range, by time."""
    radar = scene.radar
    rows = []
    for mover in movers(radar, scene.vessel):
        passes_s = pass_times_s(radar, mover, n_scans)
        state = mover.course.at(passes_s)
        near = np.hypot(state.position_m[:, 0], state.position_m[:, 1]) < radar.edges_m[-1]
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
    radar = scene.radar
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
        },
        "scans": [],
    }
    lines = ",\n".join(json.dumps(row, separators=(",", ":")) for row in rows)
    return json.dumps(head, indent=1)[:-2] + f',\n "truth": [\n{lines}\n]}}\n'
