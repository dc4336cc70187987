"""What background subtraction and clutter map do on the Solent recordings: a Markdown table.

`python -m tests.bench.bench_solent [--shared DIR] [--only 01_005] [--scans N]` runs each recording with its preset,
both on and off, into an archive in a temporary folder, and counts from that: confirmed moving tracks that no AIS ship
explains (within 250 m of one in half of their scans, lag removed), those of them that lie on land (in half of their
scans within the coast polygon grown by 100 m), and how long the two ships of the fairway have one and the same track.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry import shape

from maritrack.config import load_config
from maritrack.geo import geodetic_to_en
from maritrack.io.archive import iter_results, read_archive
from maritrack.job import Job, execute
from maritrack.metrics.unexplained import MovingTrack, moving_tracks
from maritrack.recording import default_preset, kinds_of, open_inputs, side_documents
from maritrack.types import Origin

NEAR = ["score.hold_m=250.0"]
RUNS = {  # recording, AIS, settings
    "01_005": ("run_01_005/solent_01_005.cat240", "run_01_005/ais_tracks.csv", ['score.truth_lag_s="210574000=37"']),
    "01_009": ("run_01_009/solent_01_009.cat240", None, []),
    "01_004": ("run_01_004/detections.csv", "run_01_004/ais_tracks.csv", ["input.azimuth_offset_deg=3.0"]),
}
OFF = {"background": "subtract.method=none", "map": "clutter_map.method=none"}
SHIPS = {"CHARLESTON EXPRESS": "367168640", "CORNELIS": "210574000"}


def run_of(folder: Path, name: str, sets: list[str], scans: int, out: Path) -> dict[str, Any]:
    """The summary of a run with its archive in `out`."""
    recording, ais, own = RUNS[name]
    paths = [folder / "data/marce_solent" / recording]
    octets = open_inputs(paths)
    kinds = kinds_of(octets)
    config = load_config(preset=default_preset(kinds), sets=[*NEAR, *own, *sets, f"input.limit={scans}"])
    truth = None if ais is None else folder / "data/marce_solent" / ais
    side = side_documents(paths, truth=truth, own_ship=None, sensors=None)
    job = Job(octets=octets, kinds=kinds, input_sha256=[""], side=side, config=config, name=name, out=out, rrd=False)
    return execute(job)[0]


def land_of(folder: Path, origin: Origin, grown_m: float = 100.0) -> Any:
    """The land as a polygon in east-north, grown."""
    document = json.loads((folder / "data/coast/solent_portsmouth.geojson").read_text())
    polygons = [shape(f["geometry"]) for f in document["features"]]

    def plane(at: Any) -> Any:
        return geodetic_to_en(origin, at[:, 1], at[:, 0])

    kinds = ("Polygon", "MultiPolygon")
    land = [shapely.transform(p, plane).buffer(0) for p in polygons if p.geom_type in kinds]
    return shapely.union_all(land).buffer(grown_m)


def on_land(track: MovingTrack, land: Any) -> bool:
    """Whether half of the track's positions lie there."""
    return bool(shapely.contains_xy(land, *track.position_m.T).mean() >= 0.5)


def row(folder: Path, name: str, off: tuple[str, ...], scans: int) -> str:
    """One line of the table."""
    with tempfile.TemporaryDirectory() as out:
        summary = run_of(folder, name, [OFF[part] for part in off], scans, Path(out))
        archive = Path(out) / "run.mcap"
        origin = read_archive(archive).manifest.origin
        tracks = moving_tracks((scan.tracks, scan.truth) for scan in iter_results(archive))
    unexplained = [track for track in tracks if not track.explained()]
    land = "-" if origin is None else str(sum(on_land(t, land_of(folder, origin)) for t in unexplained))
    held = {o["id"]: f"{100 * o['held_by_one']:.0f} %" for o in summary["objects"]}
    mean = np.mean([o["held_by_one"] for o in summary["objects"]]) if summary["objects"] else np.nan
    told = ["off" if part in off else "on" for part in OFF]
    ships = [held.get(ship, "-") for ship in SHIPS.values()]
    cpu_ms = sum(summary["timing"][f"{stage}_ms_per_scan"] for stage in ("subtract", "cluster", "track"))
    cells = [name, *told, str(len(tracks)), str(len(unexplained)), land, *ships, f"{100 * mean:.0f} %", f"{cpu_ms:.0f}"]
    return "| " + " | ".join(cells) + " |"


def main(folder: Path, only: str, scans: int) -> None:
    """Print the table."""
    head = ["recording", *OFF, "moving", "unexplained", "on land", *SHIPS, "all ships", "CPU ms a scan"]
    print("| " + " | ".join(head) + " |\n|" + "---|" * len(head), flush=True)
    for name in [only] if only else RUNS:
        for off in ((), ("map",), ("background",), ("background", "map")):
            print(row(folder, name, off, scans), flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shared", type=Path, default=Path("../shared"))
    parser.add_argument("--only", choices=tuple(RUNS), default="")
    parser.add_argument("--scans", type=int, default=0)
    given = parser.parse_args()
    main(given.shared, given.only, given.scans)
