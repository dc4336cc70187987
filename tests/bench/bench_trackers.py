"""All trackers on the real recordings, as the README's table: GOSPA, switches, held shares, CPU of the tracker.

MARITRACK_SHARED=FOLDER python -m tests.bench.bench_trackers [--trackers sprt jipda] [--set KEY=VALUE ...]
With --sensors the Autoferry recordings by their radar, by their lidar and by both, in place of all that.
The recordings are not the project's to ship: FOLDER holds marce_solent/ and autoferry/ under data/.
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from maritrack.config import load_config
from maritrack.job import Job, run_silently
from maritrack.recording import default_preset, kinds_of, open_inputs, side_documents
from maritrack.run import Sink
from maritrack.trackers import TRACKERS
from maritrack.types import Result, RunManifest
from tests.shared import ROOT, shared

SHIPS = {"CHARLESTON EXPRESS": "367168640", "CORNELIS": "210574000"}
SOLENT = ("score.hold_m=250.0", 'score.truth_lag_s="210574000=37"')
SCENARIOS = (2, 3, 4, 13, 17)
PAPER = ("sprt", "ipda", "jipda", "cb-giw-phd", "gm-phd", "smc-phd", "engm-phd", "giw-pmbm")
SENSORS = ROOT / "data" / "samples" / "autoferry.sensors.toml"
BY_SENSOR = {  # preset and settings; truth is what lies within the radar's reach, whoever looks
    "radar": ("autoferry", ()),
    "lidar": ("autoferry-fused", ("input.sensor=lidar",)),
    "radar+lidar": ("autoferry-fused", ()),
}


@dataclass
class GospaOf:
    """GOSPA at the scans of one sensor: a sink, for runs of several are compared at the instants that both have."""

    sensor: str
    values: list[float] = field(default_factory=list)

    def open(self, manifest: RunManifest) -> None: ...

    def write(self, result: Result) -> None:
        if result.frame.scan.sensor.id == self.sensor:
            self.values.append(result.scores["gospa"])

    def close(self, summary: Mapping[str, Any]) -> None: ...

    def abort(self) -> None: ...

    @property
    def mean(self) -> float:
        """Over the scans where truth is known."""
        return float(np.nanmean(self.values)) if self.values else math.nan


def summary(
    path: Path, truth: Path | None, sets: Sequence[str], *, preset: str = "", sensors: Path | None = None,
    sinks: Sequence[Sink] = (),
) -> dict[str, Any]:  # fmt: skip
    """What `process` would say of a recording."""
    octets = open_inputs([path])
    kinds = kinds_of(octets)
    config = load_config(preset=preset or default_preset(kinds), sets=list(sets))
    side = side_documents([path], truth=truth, own_ship=None, sensors=sensors)
    job = Job(octets=octets, kinds=kinds, input_sha256=[""], side=side, config=config, name=path.stem)
    return run_silently(job, sinks)[0]


def solent(tracker: str, sets: Sequence[str]) -> str:
    """GOSPA, switches, held shares and CPU in the run with AIS; confirmed tracks and CPU in the one without."""
    folder = shared("data/marce_solent")
    ais = folder / "run_01_005" / "ais_tracks.csv"
    a = summary(folder / "run_01_005" / "solent_01_005.cat240", ais, [f"tracker_name={tracker}", *SOLENT, *sets])
    b = summary(folder / "run_01_009" / "solent_01_009.cat240", None, [f"tracker_name={tracker}", *sets])
    objects = {o["id"]: o for o in a["objects"]}
    held = " | ".join(f"{100 * objects[mmsi]['held_by_one']:.0f} %" for mmsi in SHIPS.values())
    switches = sum(o["switches"] for o in objects.values())
    track_ms = [f"{s['timing']['track_ms_per_scan']:.0f}" for s in (a, b)]
    each = b["counts"]["confirmed"] / b["counts"]["scans"]
    return (
        f"| `{tracker}` | {a['metrics']['gospa']:.0f} | {switches} | {held} | {track_ms[0]} | "
        f"{b['counts']['track_ids_confirmed']} ({each:.0f} a scan) | {track_ms[1]} |"
    )


def scenario(n: int) -> tuple[Path, Path]:
    """Detections and truth."""
    stem = shared("data/autoferry") / f"scenario{n}" / f"scenario{n}"
    return Path(f"{stem}_detections.json"), Path(f"{stem}_groundTruth.json")


def by_sensor(path: Path, truth: Path, tracker: str, which: str, sets: Sequence[str] = ()) -> tuple[float, float]:
    """GOSPA over all scans, and at those of the radar (nan without it)."""
    preset, own = BY_SENSOR[which]
    at_radar = GospaOf("radar")
    settings = [f"tracker_name={tracker}", *own, *sets]
    found = summary(path, truth, settings, preset=preset, sensors=SENSORS, sinks=[at_radar])
    return found["metrics"]["gospa"], at_radar.mean


def sensors_of_autoferry(tracker: str, which: str, sets: Sequence[str]) -> str:
    """GOSPA of each scenario and their mean; at the radar's scans alone the mean of all that have them."""
    values = np.array([by_sensor(*scenario(n), tracker, which, sets) for n in SCENARIOS])
    all_scans, at_radar = values.mean(axis=0)
    row = " | ".join(f"{v:.2f}" for v in values[:, 0])
    return f"| `{tracker}` | {which} | {row} | {all_scans:.2f} | {at_radar:.2f} |"


def autoferry(tracker: str, sets: Sequence[str]) -> str:
    """GOSPA of each scenario and their mean, switches, CPU."""
    found = []
    for n in SCENARIOS:
        found.append(summary(*scenario(n), [f"tracker_name={tracker}", *sets]))
    values = [s["metrics"]["gospa"] for s in found]
    switches = sum(o["switches"] for s in found for o in s["objects"])
    cpu = sum(s["timing"]["track_ms_per_scan"] for s in found) / len(found)
    row = " | ".join(f"{v:.1f}" for v in values)
    return f"| `{tracker}` | {row} | {sum(values) / len(values):.1f} | {switches} | {cpu:.1f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trackers", nargs="+", default=PAPER, choices=tuple(TRACKERS))
    parser.add_argument("--set", nargs="+", default=[], dest="sets")
    parser.add_argument("--sensors", action="store_true", help="Autoferry by radar, by lidar and by both")
    args = parser.parse_args()
    if args.sensors:
        print("| tracker | sensor | " + " | ".join(str(n) for n in SCENARIOS) + " | mean | at the radar's scans |")
        print("|---|---|" + "---|" * (len(SCENARIOS) + 2))
        for tracker in args.trackers:
            for which in BY_SENSOR:
                print(sensors_of_autoferry(tracker, which, args.sets), flush=True)
        return
    print(
        "| tracker | GOSPA (m) | switches | "
        + " | ".join(SHIPS)
        + " | CPU (ms) | 01_009: confirmed tracks | CPU (ms) |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for tracker in args.trackers:
        print(solent(tracker, args.sets), flush=True)
    print()
    print("| tracker | " + " | ".join(str(n) for n in SCENARIOS) + " | mean | switches | CPU (ms) |")
    print("|---|" + "---|" * (len(SCENARIOS) + 3))
    for tracker in args.trackers:
        print(autoferry(tracker, args.sets), flush=True)


if __name__ == "__main__":
    main()
