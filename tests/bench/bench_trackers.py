"""All trackers on the real recordings, as the README's table: GOSPA, switches, held shares, CPU of the tracker.

MARITRACK_SHARED=FOLDER python -m tests.bench.bench_trackers [--trackers sprt jipda] [--set KEY=VALUE ...]
The recordings are not the project's to ship: FOLDER holds marce_solent/ and autoferry/ under data/.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from maritrack.config import load_config
from maritrack.job import Job, run_silently
from maritrack.recording import default_preset, kinds_of, open_inputs, side_documents
from maritrack.trackers import TRACKERS
from tests.shared import shared

SHIPS = {"CHARLESTON EXPRESS": "367168640", "CORNELIS": "210574000"}
SOLENT = ("score.hold_m=250.0", 'score.truth_lag_s="210574000=37"')
SCENARIOS = (2, 3, 4, 13, 17)
PAPER = ("sprt", "ipda", "jipda", "cb-giw-phd", "gm-phd", "smc-phd", "engm-phd", "giw-pmbm")


def summary(path: Path, truth: Path | None, sets: Sequence[str]) -> dict[str, Any]:
    """What `process` would say of a recording."""
    octets = open_inputs([path])
    kinds = kinds_of(octets)
    config = load_config(preset=default_preset(kinds), sets=list(sets))
    side = side_documents([path], truth=truth, own_ship=None, sensors=None)
    job = Job(octets=octets, kinds=kinds, input_sha256=[""], side=side, config=config, name=path.stem)
    return run_silently(job, [])[0]


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


def autoferry(tracker: str, sets: Sequence[str]) -> str:
    """GOSPA of each scenario and their mean, switches, CPU."""
    found = []
    for n in SCENARIOS:
        folder = shared("data/autoferry") / f"scenario{n}"
        names = (folder / f"scenario{n}_{what}.json" for what in ("detections", "groundTruth"))
        found.append(summary(*names, [f"tracker_name={tracker}", *sets]))
    values = [s["metrics"]["gospa"] for s in found]
    switches = sum(o["switches"] for s in found for o in s["objects"])
    cpu = sum(s["timing"]["track_ms_per_scan"] for s in found) / len(found)
    row = " | ".join(f"{v:.1f}" for v in values)
    return f"| `{tracker}` | {row} | {sum(values) / len(values):.1f} | {switches} | {cpu:.1f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trackers", nargs="+", default=PAPER, choices=tuple(TRACKERS))
    parser.add_argument("--set", nargs="+", default=[], dest="sets")
    args = parser.parse_args()
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
