"""How well the extent of a ship is found: simulated hulls by range, aspect and size, against the truth.

python -m tests.bench.bench_extent [--out extent.png] [--scans 24] [--seeds 2] [--speed 5] [--outline hull]
    [--beam 0.45] [--cell 7.5] [--power 5] [--known power]
The radar is that of the scene `near-field`, without land and sea; ships are under way, or at rest with --speed 0. Three
ways of telling the chain about it: nothing (`cell`), its beam and pulse (`beam`), and besides these the decibels of its
video (`power`), with which extents are those of the hulls behind what is seen.
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np

from maritrack.chain import build_chain, process
from maritrack.config import load_config
from maritrack.objects import matrix2
from maritrack.simulate.antenna import RadarSettings
from maritrack.simulate.record import turns
from maritrack.simulate.scenes import Scene, load_scene
from maritrack.simulate.vessels import Vessel
from maritrack.types import CONFIRMED, FloatArray, Frame, Scan, Sensor, Tracks, Video

RADAR = load_scene("near-field").radar
SIZES_M = ((30.0, 8.0), (60.0, 12.0), (100.0, 20.0), (150.0, 24.0), (200.0, 32.0), (300.0, 45.0))
ASPECTS_DEG = tuple(1.0 + 2.0 * i for i in range(45))
BINS_DEG = (0.0, 3.0, 6.0, 10.0, 15.0, 30.0, 60.0, 90.0)  # in which the table tells of them
SMEARS = (0.0, 2.0, 2.5, 3.0, math.inf)  # width over the standard deviation of what beam and pulse make of a point
RANGES_M = (500.0, 1000.0, 2000.0, 3000.0, 4000.0)
SETTLED = 12  # scans from which on the extent is judged
APART_M = 150.0  # between ships of one scene
WITHIN = np.array([0.2, 0.2, 5.0])  # of length, width and keel


@dataclass(frozen=True, slots=True)
class Ship:
    """What is put before the radar; aspect 0 = end on."""

    length_m: float
    width_m: float
    aspect_deg: float


@dataclass(frozen=True, slots=True)
class Setup:
    """The radar, what the chain is told about it, and what the ships have in common."""

    radar: RadarSettings = RADAR
    way: Literal["cell", "beam", "power"] = "power"
    scans: int = 24
    speed_mps: float = 5.0
    outline: Literal["hull", "ellipse"] = "hull"
    power: float = 5.0

    def sets(self) -> list[str]:
        """Settings of the chain, without the subtraction that takes parts of a hull until it is found to move."""
        radar = self.radar
        beam = [f"input.beam_width_deg={radar.beam_deg}", f"input.pulse_length_m={radar.pulse_m}"]
        told = {"cell": [], "beam": beam, "power": [*beam, f"input.scale_db={radar.full_db - radar.floor_db}"]}
        return ["subtract.method=none", f"model.outline_power={self.power}", *told[self.way]]


@dataclass(frozen=True, slots=True)
class Found:
    """What the track of a ship says, median over the scans: shares of the true axes, and degrees off the keel."""

    length: float
    width: float
    turned_deg: float
    held: float  # share of the scans with a track

    @property
    def good(self) -> bool:
        """Within a fifth in both axes, and 5 degrees."""
        return bool((np.abs([self.length - 1.0, self.width - 1.0, self.turned_deg]) <= WITHIN).all())


def all_ships(sizes_m: Sequence[tuple[float, float]], aspects_deg: Sequence[float]) -> list[Ship]:
    """One of each size under each aspect."""
    return [Ship(*size, aspect) for size in sizes_m for aspect in aspects_deg]


def recover(range_m: float, ships: Sequence[Ship], setup: Setup | None = None, *, seed: int = 0) -> list[Found]:
    """What is found of each ship, in scenes that have room for them."""
    setup = setup or Setup()
    order = np.random.default_rng(seed).permutation(len(ships)).tolist()
    room = max(1, int(2.0 * math.pi * range_m / (APART_M + max(ship.length_m for ship in ships))))
    found: dict[int, Found] = {}
    for scene, at in enumerate(range(0, len(order), room)):
        some = order[at : at + room]
        vessels = tuple(
            _vessel(f"{i}", ships[i], range_m, 2.0 * math.pi * (slot + 0.3) / len(some), setup)
            for slot, i in enumerate(some)
        )
        found |= dict(zip(some, _tracked(vessels, range_m, setup, seed=1000 * seed + scene), strict=True))
    return [found[i] for i in range(len(ships))]


def _vessel(name: str, ship: Ship, range_m: float, bearing_rad: float, setup: Setup) -> Vessel:
    """The ship at that bearing, which has the aspect in the middle of the scans that are judged."""
    at, heading_rad = range_m * _unit(bearing_rad), bearing_rad + math.radians(ship.aspect_deg)
    before_m = setup.speed_mps * setup.radar.turn_s * 0.5 * (SETTLED + setup.scans)
    ends = [at - before_m * _unit(heading_rad), at + 2000.0 * _unit(heading_rad)] if setup.speed_mps else [at]
    return Vessel(
        id=name, length_m=ship.length_m, width_m=ship.width_m, outline=setup.outline, rcs_m2=30.0 * ship.length_m,
        fade=5.0, waypoints_m=tuple((float(e), float(n)) for e, n in ends), speed_mps=setup.speed_mps,
        heading_deg=math.degrees(heading_rad),
    )  # fmt: skip


def scans(vessels: tuple[Vessel, ...], range_m: float, setup: Setup, *, seed: int) -> Iterator[Scan]:
    """What the radar sends of them, turn by turn."""
    radar = replace(setup.radar, cells=int((range_m + 500.0) / setup.radar.cell_m))
    scene = Scene(title="extent", start=datetime(2026, 3, 18, tzinfo=UTC), lat_deg=54.0, lon_deg=13.0,
                  scans=setup.scans, radar=radar, vessel=vessels)  # fmt: skip
    azimuth, width = radar.azimuths_rad(), 2 * np.pi / radar.spokes
    sensor = Sensor("radar", radar.cell_m, width, radar.cells * radar.cell_m)
    for k, turn in enumerate(turns(scene, setup.scans, seed=seed, labels=False)):
        t_ns = np.rint(radar.times_s(k) * 1e9).astype(np.int64)
        video = Video(azimuth, np.full(radar.spokes, width), t_ns, 0.5 * radar.cell_m, radar.cell_m, turn.video,
                      np.full(radar.spokes, radar.cells))  # fmt: skip
        begin, end = (round(radar.turn_s * turns_done * 1e9) for turns_done in (k, k + 1))
        yield Scan(sensor, end, begin, np.zeros(2), np.nan, video=video)


def _tracked(vessels: tuple[Vessel, ...], range_m: float, setup: Setup, *, seed: int) -> list[Found]:
    chain = build_chain(load_config(preset="radar", sets=setup.sets()))
    state, seen = chain.init(), []
    for k, scan in enumerate(scans(vessels, range_m, setup, seed=seed)):
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


def smear_m(setup: Setup, range_m: float, ship: Ship) -> float:
    """Standard deviation of what beam, pulse and cell make of a point, athwart the ship."""
    across_m = math.radians(setup.radar.beam_deg) * range_m / math.sqrt(16.0 * math.log(2.0))
    along_m = math.hypot(setup.radar.pulse_m, setup.radar.cell_m) / math.sqrt(12.0)
    aspect = math.radians(ship.aspect_deg)
    return math.hypot(across_m * math.cos(aspect), along_m * math.sin(aspect))


Results = dict[float, list[tuple[Ship, Found]]]  # by range


def table(results: Results, setup: Setup) -> str:
    """Markdown: by aspect, length, and width in smears, for each range: share of the ships held within, medians."""
    chosen: dict[str, Callable[[Ship, float], bool]] = {
        f"{low:g} to {high:g} deg": lambda ship, _, low=low, high=high: low <= ship.aspect_deg < high
        for low, high in itertools.pairwise(BINS_DEG)
    }
    chosen["all aspects"] = lambda *_: True
    for length_m in sorted({ship.length_m for row in results.values() for ship, _ in row}):
        chosen[f"{length_m:g} m"] = lambda ship, _, length_m=length_m: ship.length_m == length_m
    for low, high in itertools.pairwise(SMEARS):
        chosen[f"width {low:g} to {high:g} smears, from {BINS_DEG[1]:g} deg"] = (
            lambda ship, range_m, low=low, high=high: (
                ship.aspect_deg >= BINS_DEG[1] and low <= ship.width_m / smear_m(setup, range_m, ship) < high
            )
        )
    lines = ["| ships | " + " | ".join(f"{r / 1e3:g} km" for r in results) + " |", "|---" * (1 + len(results)) + "|"]
    for name, of in chosen.items():
        cells = [_cell([f for ship, f in row if of(ship, range_m)]) for range_m, row in results.items()]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _cell(found: Sequence[Found]) -> str:
    held = [f for f in found if f.held > 0.0]
    if not held:
        return "-"
    length, width, turned = np.median([(f.length, f.width, f.turned_deg) for f in held], axis=0)
    lost = f" ({len(found) - len(held)} lost)" if len(held) < len(found) else ""
    return f"{sum(f.good for f in held) / len(held):.0%}: {length:.2f}, {width:.2f}, {turned:.1f}{lost}"


def draw(results: Results, path: Path) -> None:
    """Length, width and angle against aspect: a dot for each ship, a line through medians for each range."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 9.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(3, 1, sharex=True)
    panels = (("length", "length / true", 2.0, (0.8, 1.2)), ("width", "width / true", 2.0, (0.8, 1.2)),
              ("turned_deg", "axis off keel (deg)", 20.0, (0.0, 5.0)))  # fmt: skip
    for axis, (field, label, top, band) in zip(axes, panels, strict=True):
        axis.axhspan(*band, color="#dddddd")
        axis.set_ylabel(label)
        axis.set_ylim(0.0, top)
        for color, (range_m, row) in enumerate(results.items()):
            held = [(ship.aspect_deg, getattr(f, field)) for ship, f in row if f.held > 0.0]
            aspects = sorted({aspect for aspect, _ in held})
            middle = [float(np.median([v for a, v in held if a == aspect])) for aspect in aspects]
            axis.plot(*zip(*held, strict=True), ".", color=f"C{color}", markersize=3)
            axis.plot(aspects, middle, color=f"C{color}", label=f"{range_m / 1e3:g} km")
    axes[0].legend(fontsize="small")
    axes[-1].set_xlabel("aspect (deg off end on)")
    figure.savefig(path, dpi=80)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("extent.png"))
    parser.add_argument("--scans", type=int, default=24)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--speed", type=float, default=5.0)
    parser.add_argument("--outline", choices=("hull", "ellipse"), default="hull")
    parser.add_argument("--beam", type=float, default=RADAR.beam_deg)
    parser.add_argument("--cell", type=float, default=RADAR.cell_m)
    parser.add_argument("--power", type=float, default=5.0)
    parser.add_argument("--known", choices=("cell", "beam", "power"), default="power")
    parser.add_argument("--ranges", type=float, nargs="+", default=RANGES_M)
    args = parser.parse_args()
    radar = replace(RADAR, beam_deg=args.beam, cell_m=args.cell)
    setup = Setup(radar, args.known, args.scans, args.speed, args.outline, args.power)
    ships, seeds = all_ships(SIZES_M, ASPECTS_DEG), range(args.first_seed, args.first_seed + args.seeds)
    results = {
        r: [pair for seed in seeds for pair in zip(ships, recover(r, ships, setup, seed=seed), strict=True)]
        for r in args.ranges
    }
    print("share within 20 % and 5 degrees: medians of length / true, width / true, degrees off the keel\n")
    print(table(results, setup))
    draw(results, args.out)


if __name__ == "__main__":
    main()
