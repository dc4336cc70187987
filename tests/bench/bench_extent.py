"""How well the extent of a ship is found: simulated hulls by range and aspect, axes and orientation against the truth.

python -m tests.bench.bench_extent [--out extent.png] [--scans 24] [--seeds 2]
The radar is that of the scene `near-field`, without land and sea; ships are under way at 5 m/s. Three ways of telling
the chain about it: nothing, its beam and pulse, and besides these the decibels of its video.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from maritrack.chain import build_chain, process
from maritrack.config import load_config
from maritrack.objects import matrix2
from maritrack.simulate.record import turns
from maritrack.simulate.scenes import Scene, load_scene
from maritrack.simulate.vessels import Vessel
from maritrack.types import CONFIRMED, FloatArray, Frame, Scan, Sensor, Tracks, Video

RADAR = load_scene("near-field").radar
SIZES_M = ((60.0, 12.0), (100.0, 20.0), (200.0, 32.0))
ASPECTS_DEG = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
RANGES_M = (500.0, 1000.0, 2000.0, 3000.0, 4000.0, 6000.0, 10_000.0)
SPEED_MPS, SETTLED = 5.0, 12  # scans from which on the extent is judged
BEAM = (f"input.beam_width_deg={RADAR.beam_deg}", f"input.pulse_length_m={RADAR.pulse_m}")
WAYS = {"cell": (), "beam": BEAM, "power": (*BEAM, f"input.scale_db={RADAR.full_db - RADAR.floor_db}")}


@dataclass(frozen=True, slots=True)
class Found:
    """What the track of a ship says, median over the scans: shares of the true axes, and degrees off the keel."""

    length: float
    width: float
    turned_deg: float
    held: float  # share of the scans with a track


def ships(range_m: float, sizes_m: Sequence[tuple[float, float]], aspects_deg: Sequence[float]) -> tuple[Vessel, ...]:
    """Ships round the radar, one of each size under each aspect (0 = end on)."""
    kinds = [(size, aspect) for size in sizes_m for aspect in aspects_deg]
    made = []
    for i, ((length_m, width_m), aspect) in enumerate(kinds):
        bearing = 2 * np.pi * (i + 0.3) / len(kinds)
        at, ahead = range_m * _unit(bearing), _unit(bearing + math.radians(aspect))
        begin, end = at - 100.0 * ahead, at + 2000.0 * ahead
        way = ((float(begin[0]), float(begin[1])), (float(end[0]), float(end[1])))
        made.append(
            Vessel(id=f"{i}", length_m=length_m, width_m=width_m, rcs_m2=30.0 * length_m, fade=5.0, waypoints_m=way,
                   speed_mps=SPEED_MPS)
        )  # fmt: skip
    return tuple(made)


def scans(vessels: tuple[Vessel, ...], range_m: float, n: int, *, seed: int) -> Iterator[Scan]:
    """What the radar sends of them, turn by turn."""
    radar = replace(RADAR, cells=int((range_m + 400.0) / RADAR.cell_m))
    scene = Scene(title="extent", start=datetime(2026, 3, 18, tzinfo=UTC), lat_deg=54.0, lon_deg=13.0, scans=n,
                  radar=radar, vessel=vessels)  # fmt: skip
    azimuth, width = radar.azimuths_rad(), 2 * np.pi / radar.spokes
    sensor = Sensor("radar", radar.cell_m, width, radar.cells * radar.cell_m)
    for k, turn in enumerate(turns(scene, n, seed=seed, labels=False)):
        t_ns = np.rint(radar.times_s(k) * 1e9).astype(np.int64)
        video = Video(azimuth, np.full(radar.spokes, width), t_ns, 0.5 * radar.cell_m, radar.cell_m, turn.video,
                      np.full(radar.spokes, radar.cells))  # fmt: skip
        begin, end = (round(radar.turn_s * turns_done * 1e9) for turns_done in (k, k + 1))
        yield Scan(sensor, end, begin, np.zeros(2), np.nan, video=video)


def recover(
    range_m: float, sizes_m: Sequence[tuple[float, float]], aspects_deg: Sequence[float], way: str, *,
    n: int = 24, seed: int = 0,
) -> list[Found]:  # fmt: skip
    """What is found of each ship, sizes first, then aspects."""
    vessels = ships(range_m, sizes_m, aspects_deg)
    sets = [*WAYS[way], "subtract.method=none"]  # which takes parts of a hull until it is judged to be under way
    chain = build_chain(load_config(preset="radar", sets=sets))
    state, seen = chain.init(), []
    for k, scan in enumerate(scans(vessels, range_m, n, seed=seed)):
        state, result = process(chain, state, Frame(k, scan))
        seen.append(result.tracks)
    return [_found(vessel, seen[SETTLED:]) for vessel in vessels]


def _found(vessel: Vessel, seen: Sequence[Tracks]) -> Found:
    course, rows = vessel.course(), []
    for tracks in seen:
        away = np.hypot(*(tracks.position_m - course.at(tracks.t_ns * 1e-9).position_m).T)
        good = np.flatnonzero((tracks.status >= CONFIRMED) & (away < 0.6 * vessel.length_m))
        if len(good):
            rows.append(_against(vessel, tracks, int(good[np.argmin(away[good])])))
    if not rows:
        return Found(np.nan, np.nan, np.nan, 0.0)
    length, width, turned = np.median(np.array(rows), axis=0)
    return Found(float(length), float(width), float(turned), len(rows) / len(seen))


def _against(vessel: Vessel, tracks: Tracks, i: int) -> tuple[float, float, float]:
    """Axes (twice the semi-axes of the extent) over length and width, and the angle between axis and keel."""
    values, major = matrix2.eigen(tracks.extent_m2[i : i + 1])
    heading = float(vessel.course().at(np.array([tracks.t_ns[i] * 1e-9])).heading_rad[0])
    off_deg = math.degrees(math.atan2(major[0, 0], major[0, 1]) - heading)
    length, width = 2.0 * np.sqrt(values[0])
    return float(length / vessel.length_m), float(width / vessel.width_m), abs((off_deg + 90.0) % 180.0 - 90.0)


def _unit(azimuth_rad: float) -> FloatArray:
    return np.array([math.sin(azimuth_rad), math.cos(azimuth_rad)])


def table(found: dict[tuple[str, float], list[list[Found]]]) -> str:
    """Markdown: by way and range, median and extremes of the ships under aspects from 30 to 90 degrees."""
    lines = ["| known | range (km) | length / true | width / true | axis off keel (deg) |", "|---|---|---|---|---|"]
    fair = np.tile(np.array(ASPECTS_DEG) >= 30.0, len(SIZES_M))
    for (way, range_m), runs in found.items():
        values = np.array([[(f.length, f.width, f.turned_deg) for f in run] for run in runs])[:, fair].reshape(-1, 3)
        if np.isnan(values).all():
            continue
        cells = [f"{np.nanmedian(v):.2f} ({np.nanmin(v):.2f} to {np.nanmax(v):.2f})" for v in values.T]
        lines.append(f"| {way} | {range_m / 1e3:g} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def draw(found: dict[tuple[str, float], list[list[Found]]], path: Path) -> None:
    """Length, width and angle against range, a line for each aspect, a column for each way of telling."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 9.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(3, len(WAYS), sharex=True, sharey="row")
    ranges = sorted({range_m for _, range_m in found})
    for column, way in enumerate(WAYS):
        for a, aspect in enumerate(ASPECTS_DEG):
            per_range = [[f for run in found[way, r] for f in run[a :: len(ASPECTS_DEG)]] for r in ranges]
            for row, name in enumerate(("length", "width", "turned_deg")):
                of_ships = [[v for f in fs if math.isfinite(v := getattr(f, name))] for fs in per_range]
                middle = [float(np.median(v)) if v else math.nan for v in of_ships]
                axes[row][column].plot(np.array(ranges) / 1e3, middle, marker="o", label=f"{aspect:g} deg")
        axes[0][column].set_title(f"known: {way}")
        axes[2][column].set_xlabel("range (km)")
        for row, band in enumerate(((0.8, 1.2), (0.8, 1.2), (0.0, 5.0))):
            axes[row][column].axhspan(*band, color="#dddddd")
    for row, (label, top) in enumerate((("length / true", 2.0), ("width / true", 3.0), ("axis off keel (deg)", 30.0))):
        axes[row][0].set_ylabel(label)
        axes[row][0].set_ylim(0.0, top)
    axes[0][0].legend(title="aspect", fontsize="small")
    figure.savefig(path, dpi=80)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("extent.png"))
    parser.add_argument("--scans", type=int, default=24)
    parser.add_argument("--seeds", type=int, default=2)
    args = parser.parse_args()
    found = {
        (way, r): [recover(r, SIZES_M, ASPECTS_DEG, way, n=args.scans, seed=s) for s in range(args.seeds)]
        for way in WAYS
        for r in RANGES_M
    }
    print(table(found))
    draw(found, args.out)


if __name__ == "__main__":
    main()
