"""Runs of the dataset paper's experiment: simulated campaigns, centroids by k-means, both trackers on the same ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from maritrack.chain import detect
from maritrack.cluster.stage import cluster_points
from maritrack.config import load_config
from maritrack.io.ais import read_ais
from maritrack.io.reference import Reference, truth_at
from maritrack.reproduce.claims import Case
from maritrack.settings import Config
from maritrack.simulate.aistable import reports_table
from maritrack.simulate.campaign import Campaign, grabbed
from maritrack.simulate.campaignwriter import scan_of
from maritrack.simulate.scenes import load_any
from maritrack.trackers.jpda import Following, Jpda, jpda
from maritrack.types import Clusters, FloatArray, IntArray, Points, Scan, Truth

EC, STANDARD, GATE = "ec-jpda", "jpda", "ec-jpda, all in the gate"
TRACKERS = (EC, STANDARD, GATE)
SCENES = ("daan", "darc", "manv")
TARGETS: Mapping[str, tuple[str, ...]] = {
    "daan": ("target-2", "target-3"), "darc": ("target-2",), "manv": ("target-2", "target-3"),
}  # fmt: skip
OF_PAPER = (  # tracks start at the first words of AIS and are never ended (dataset, sec. 3.4)
    "centroid.start=reference", "centroid.existence=certain", "tracker.delete_misses=100000",
    "tracker.delete_sigma_m=1e6",
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """What came of one tracker on one case."""

    case: Case
    tracker: str
    time_s: FloatArray  # (scans,) since the scene began
    error_m: Mapping[str, FloatArray]  # by id of the target (scans,), nan where AIS is silent
    way_m: Mapping[str, FloatArray]  # (scans, 2) the estimates


def the_scene(name: str) -> Campaign:
    """A campaign."""
    scene = load_any(name)
    assert isinstance(scene, Campaign)
    return scene


def settings(scene: Campaign, sets: Sequence[str] = ()) -> Config:
    """The preset, the paper's tracks, and the pixel and pulse of the scene as the noise of a range."""
    noise = f"input.sigma_range_m={scene.display.sigma_range_m}"
    return load_config(preset="dataset", sets=[*OF_PAPER, noise, *sets])


def ais_of(scene: Campaign, n_scans: int) -> Reference:
    """What AIS tells, moved from antennas to the middle of hulls; the own ship left out."""
    table = reports_table(scene.vessel, scene.origin, scene.start_s, scene.period_s * n_scans + 20.0)
    return read_ais(table.encode(), name="ais.csv", date="", origin=scene.origin, own_ship=scene.own).reference


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A scan ready for trackers."""

    scan: Scan
    points: Points
    clusters: Clusters
    truth: Truth


def seen_of(case: Case, config: Config) -> list[Seen]:
    """The scans of a case with their clusters and what AIS says then."""
    scene = the_scene(case.scene)
    n_scans = case.scans or scene.scans
    ais, found = ais_of(scene, n_scans), []
    for k in grabbed(scene, n_scans, seed=case.seed).tolist():
        scan = scan_of(scene, k, seed=case.seed)
        points = detect(scan, config)
        clusters = cluster_points(points, scan, config.cluster, config.input)
        truth = truth_at(ais, scan.t_ns, centre_m=scan.position_m, max_range_m=scan.sensor.max_range_m)
        found.append(Seen(scan, points, clusters, truth))
    return found


def run_case(case: Case) -> tuple[Run, ...]:
    """All trackers on the same clusters."""
    scene = the_scene(case.scene)
    config = settings(scene)
    seen = seen_of(case, config)
    gate = replace(config, centroid=replace(config.centroid, dispersion="adaptive", gain="dispersion"))
    return tuple(run_tracker(case, name, gate if name == GATE else config, seen) for name in TRACKERS)


def run_tracker(case: Case, name: str, config: Config, seen: Sequence[Seen]) -> Run:
    """One tracker over the scans; the track of a target is the one that its first words have started."""
    tracker = jpda(config) if name == STANDARD else Jpda(config)
    state, track_of = tracker.init(), dict[str, int]()
    targets, start_ns = TARGETS[case.scene], seen[0].scan.t_ns
    error = {key: np.full(len(seen), np.nan) for key in targets}
    way = {key: np.full((len(seen), 2), np.nan) for key in targets}
    for row, frame in enumerate(seen):
        begun = tracker.started(state, frame.truth, frame.scan)
        track_of |= _tracks_of(state, begun, frame.truth)
        state, _ = tracker.update(begun, frame.scan, frame.points, frame.clusters)
        ids, place = state.tracks.id.tolist(), state.tracks.density.x[:, :2]
        for key in targets:
            if track_of.get(key) in ids:
                way[key][row] = place[ids.index(track_of[key])]
                if key in frame.truth.id:
                    off = way[key][row] - frame.truth.position_m[frame.truth.id.index(key)]
                    error[key][row] = np.hypot(*off)
    time_s = np.array([(frame.scan.t_ns - start_ns) * 1e-9 for frame in seen])
    return Run(case, name, time_s, error, way)


def _tracks_of(before: Following, begun: Following, truth: Truth) -> dict[str, int]:
    """Ids of the tracks that the words of this scan have started, by ship."""
    fresh: IntArray = begun.tracks.id[len(before.tracks) :]
    new = [key for key in begun.told if key not in before.told]
    found = {}
    for key in new if len(fresh) else []:
        away = begun.tracks.density.x[len(before.tracks) :, :2] - truth.position_m[truth.id.index(key)]
        found[key] = int(fresh[np.hypot(*away.T).argmin()])
    return found


def without_dispersion(case: Case) -> float:
    """The largest distance (m) between jpda and ec-jpda with zero dispersion in a case."""
    config = settings(the_scene(case.scene))
    seen = seen_of(case, config)
    none = replace(config, centroid=replace(config.centroid, dispersion="none"))
    a, b = run_tracker(case, STANDARD, config, seen), run_tracker(case, EC, none, seen)
    return max(float(np.nanmax(np.abs(a.way_m[key] - b.way_m[key]))) for key in a.way_m)
