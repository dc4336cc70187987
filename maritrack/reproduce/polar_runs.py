"""One simulated recording through both clustering domains and all four trackers of the polar paper.

The recording is written as CAT240 and read back. Points are detected once a scan, clusters made once a domain; the
rest is what `chain.process` does.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from maritrack.chain import build_chain, detect, reported
from maritrack.cluster.stage import cluster_points
from maritrack.config import load_config
from maritrack.metrics import t_gospa
from maritrack.metrics.scores import ScoreSums, add, hold, means, score_frame, summary_objects
from maritrack.metrics.trajectories import States, track_states, trajectories, truth_states
from maritrack.recording import kinds_of, open_inputs, open_recording, side_documents
from maritrack.run import with_truth
from maritrack.settings import Config
from maritrack.simulate.record import simulate
from maritrack.simulate.scenery import Land
from maritrack.simulate.scenes import Scene, load_scene
from maritrack.types import BoolArray, Clusters, FloatArray, Frame, Tracks, Truth

DOMAINS = ("cartesian", "polar")
TRACKERS = ("sprt", "ipda", "jipda", "cb-giw-phd")
GAMMA_M = 1.0  # penalty of T-GOSPA for a switch: its cost is then the number of switches, as in the paper's table
STRICT_GAMMA_M = 20.0  # switches that are worth 20 m of localisation
SHORE_M = 100.0  # what is nearer to land than this is not in the region of interest
EPS_M, MIN_POINTS = 55.0, 3  # polar, sec. III


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A recording, and the clustering that it is tracked with."""

    area: str  # "near" or "far": scene and preset
    seed: int
    scans: int
    name: str = ""  # of what is changed; "" = nothing
    spokes: int = 0  # a turn; 0 = the scene's
    cell_m: float = 0.0  # 0 = the scene's
    fade: float = 0.0  # of every vessel; 0 = the scene's
    pairs: Mapping[str, tuple[float, int]] = field(
        default_factory=dict
    )  # by domain: eps_m and min_points, else the paper's


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """What came of one tracker in one domain."""

    case: Case
    domain: str
    tracker: str
    switches: float  # T-GOSPA with gamma = 1 m: switching cost, and number of switches
    switches_strict: float  # number of switches with gamma = 20 m
    id_changes: int  # of the track assigned to an object, which stays as long as it can
    held: float  # share of scans, over all objects, with a track within 100 m
    held_least: float  # of the object that has the least
    seen: float  # share with a cluster within 100 m
    clusters: float  # a scan
    tracks: float  # confirmed, a scan
    objects: float  # a scan
    ids: int  # of confirmed tracks
    ospa: FloatArray  # (3, scans) total, localisation, cardinality


def scene_of(case: Case) -> Scene:
    """The scene with its changes. Cells of another depth cover the same ranges."""
    scene = load_scene(f"{case.area}-field")
    radar, vessels = scene.radar, scene.vessel
    if case.spokes:
        radar = replace(radar, spokes=case.spokes)
    if case.cell_m:
        share = radar.cell_m / case.cell_m
        cells, first = round(radar.cells * share), round(radar.first_cell * share)
        radar = replace(radar, cell_m=case.cell_m, cells=cells, first_cell=first)
    if case.fade:
        vessels = tuple(replace(vessel, fade=case.fade) for vessel in vessels)
    return replace(scene, radar=radar, vessel=vessels)


def config_of(case: Case, domain: str, tracker: str) -> Config:
    """The preset of the field with this domain and tracker."""
    eps_m, min_points = case.pairs.get(domain, (EPS_M, MIN_POINTS))
    cluster = {"method": f"{domain}-dbscan", "eps_m": eps_m, "min_points": min_points}
    return load_config(preset=f"polar-{case.area}", over={"tracker_name": tracker, "cluster": cluster})


def run_case(case: Case) -> tuple[Run, ...]:
    """Simulate the recording and run every domain and tracker over it."""
    scene = scene_of(case)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rec.cat240"
        simulate(scene, path, seed=case.seed, scans=case.scans, ais=False, labels=False)
        frames = frames_of(path, config_of(case, "polar", "sprt"))
        return run_frames(case, scene, frames)


def frames_of(path: Path, config: Config) -> Iterator[Frame]:
    """Frames of a recording with the truth beside it."""
    octets = open_inputs([path])
    side = side_documents([path], truth=None, own_ship=None, sensors=None)
    recording = open_recording(octets, kinds_of(octets), side, config)
    return with_truth(recording.frames, recording.reference, build_chain(config))


def run_frames(case: Case, scene: Scene, frames: Iterator[Frame]) -> tuple[Run, ...]:
    """Every domain and tracker over the frames of a case, which need truth."""
    configs = {(domain, tracker): config_of(case, domain, tracker) for domain in DOMAINS for tracker in TRACKERS}
    trackers = {key: build_chain(config).tracker for key, config in configs.items()}
    states = {key: tracker.init() for key, tracker in trackers.items()}
    tallies = {key: Tally(ScoreSums()) for key in configs}
    objects: list[States] = []
    for frame in frames:
        scan, truth = frame.scan, frame.truth
        assert truth is not None
        covered = ~near_land(truth.position_m, scene.land, SHORE_M)
        points = detect(scan, configs["polar", TRACKERS[0]])
        objects.append(truth_states(truth) if covered.all() else _covered(truth, covered))
        for domain in DOMAINS:
            first = configs[domain, TRACKERS[0]]
            clusters = cluster_points(points, scan, first.cluster, first.input)
            seen = _seen(truth, covered, clusters, first.score.hold_m)
            for tracker in TRACKERS:
                key = (domain, tracker)
                states[key], _ = trackers[key].update(states[key], scan, points, clusters)
                tracks = trackers[key].estimate(states[key])
                which = reported(tracks, configs[key]) & ~near_land(tracks.position_m, scene.land, SHORE_M)
                tallies[key] = tallied(
                    tallies[key], truth, tracks, covered=covered, which=which, config=configs[key],
                    seen=seen, clusters=len(clusters),
                )  # fmt: skip
    truth_m = trajectories(objects)
    return tuple(finish(case, key, tallies[key], truth_m, configs[key]) for key in configs)


@dataclass(frozen=True, slots=True, eq=False)
class Tally:
    """What is gathered of one tracker in one domain, scan by scan."""

    sums: ScoreSums
    states: tuple[States, ...] = ()
    ospa: tuple[tuple[float, float, float], ...] = ()
    seen: int = 0
    clusters: int = 0


def tallied(
    tally: Tally, truth: Truth, tracks: Tracks, *, covered: BoolArray, which: BoolArray, config: Config, seen: int,
    clusters: int,
) -> Tally:  # fmt: skip
    """The tally with one more scan."""
    rules = config.score
    scores = score_frame(truth, tracks, which=which, c_m=rules.c_m, p=rules.p, covered=covered)
    sums = hold(add(tally.sums, scores), truth, tracks, which=which, hold_m=rules.hold_m, covered=covered)
    parts = (scores["ospa"], scores["ospa_localisation"], scores["ospa_cardinality"])
    return Tally(
        sums, (*tally.states, track_states(tracks, which, truth.t_ns)), (*tally.ospa, parts), tally.seen + seen,
        tally.clusters + clusters,
    )  # fmt: skip


def finish(case: Case, key: tuple[str, str], tally: Tally, truth_m: FloatArray, config: Config) -> Run:
    """The numbers of a tally."""
    tracks_m, n_scans, rules = trajectories(tally.states), len(tally.states), config.score
    by_one_m, strict = (
        t_gospa(truth_m, tracks_m, c=rules.c_m, p=rules.p, gamma=gamma) for gamma in (GAMMA_M, STRICT_GAMMA_M)
    )
    rows, mean = summary_objects(tally.sums), means(tally.sums)
    present = sum(row["frames"] for row in rows)
    return Run(
        case=case,
        domain=key[0],
        tracker=key[1],
        switches=by_one_m.n_switch,
        switches_strict=strict.n_switch,
        id_changes=sum(row["switches"] for row in rows),
        held=sum(row["held"] for row in rows) / present,
        held_least=min(row["held_share"] for row in rows),
        seen=tally.seen / present,
        clusters=tally.clusters / n_scans,
        tracks=mean["n_tracks"],
        objects=mean["n_truth"],
        ids=len(tracks_m),
        ospa=np.array(tally.ospa).T,
    )


def _covered(truth: Truth, covered: BoolArray) -> States:
    names = tuple(name for name, kept in zip(truth.id, covered.tolist(), strict=True) if kept)
    return names, truth.position_m[covered]


def _seen(truth: Truth, covered: BoolArray, clusters: Clusters, within_m: float) -> int:
    """Objects that count and have a cluster near them."""
    gap_m = np.linalg.norm(truth.position_m[covered, None] - clusters.mean_m[None], axis=2)
    return int((gap_m <= within_m).any(axis=1).sum())


def near_land(position_m: FloatArray, lands: tuple[Land, ...], margin_m: float) -> BoolArray:
    """Positions (n, 2) on land or within a margin of its shore."""
    near = np.zeros(len(position_m), bool)
    for land in lands:
        a = np.array(land.outline_m)
        b = np.roll(a, -1, axis=0)
        edge, x = b - a, position_m[:, None] - a[None]  # (v, 2), (n, v, 2)
        along = np.clip(np.einsum("nvd,vd->nv", x, edge) / np.einsum("vd,vd->v", edge, edge), 0.0, 1.0)
        gap_m = np.linalg.norm(x - along[..., None] * edge, axis=2)
        level = (a[:, 1] > position_m[:, 1:]) != (b[:, 1] > position_m[:, 1:])  # edges that pass at its height
        with np.errstate(divide="ignore", invalid="ignore"):
            east = a[:, 0] + edge[:, 0] * (position_m[:, 1:] - a[:, 1]) / edge[:, 1]
        crossings = (level & (east > position_m[:, :1])).sum(axis=1)
        near |= (gap_m <= margin_m).any(axis=1) | (crossings % 2 == 1)
    return near
