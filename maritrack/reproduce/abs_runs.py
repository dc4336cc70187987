"""Runs of the abs paper's experiment: one recording of the port for each radar, four ways to track what they show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from maritrack.config import load_config
from maritrack.job import Job, run_silently
from maritrack.metrics.background import confusion, in_box
from maritrack.recording import kinds_of, open_inputs, side_documents
from maritrack.simulate.record import simulate
from maritrack.simulate.scenes import load_scene
from maritrack.types import CONFIRMED, STATIONARY, BoolArray, FloatArray, IntArray, Result, RunManifest, Truth

SCENE, PRESET = "hamburg", "abs-port"
ASHORE, ABOARD = ("west", "middle", "east"), ("launch",)
MARGIN_M = 25.0  # a track within the box of a vessel, wider by this, is that vessel's
UNDER_WAY_MPS = 0.3
KEY_TIMES_S = (900.0, 999.0, 2085.0)  # abs, Fig. 2


@dataclass(frozen=True, slots=True)
class Case:
    """A row of Table II, or a variant of it."""

    name: str
    launch: bool  # with the radar aboard V1
    track_from: str  # "converged" or "start"
    start: str = "uniform"  # psi before the first scan


CASES = (
    Case("1A", False, "converged"), Case("1B", True, "converged"), Case("2A", False, "start"),
    Case("2B", True, "start"), Case("2A, sea empty at first", False, "start", "empty"),
    Case("2B, sea empty at first", True, "start", "empty"),
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """What there was in the turn of all radars that ends at a time."""

    t_s: float
    position_m: FloatArray  # (n, 2) of points
    keep: BoolArray  # (n,) left by background subtraction
    truth: Truth
    tracks_m: FloatArray  # (t, 2) confirmed
    extent_m2: FloatArray  # (t, 2, 2)
    track_id: IntArray  # (t,)
    stationary: BoolArray  # (t,)


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A case over time, in steps of a turn (k,). Vessels (v,) in the order of their ids."""

    case: Case
    seed: int
    t_s: FloatArray  # (k,) end of the step since the first spoke
    vessels: tuple[str, ...]
    known: BoolArray  # (k, v) AIS tells where it is
    under_way: BoolArray  # (k, v)
    held_by: IntArray  # (k, v) id of the track that has it, -1 = none
    stationary: BoolArray  # (k, v) that track is held in the background
    n_tracks: IntArray  # (k,) confirmed, those held in the background left out
    table: IntArray  # (k, 4) points: TP, FP, FN, TN
    converged_s: float  # when the model of the first radar had converged, nan = never
    snapshots: tuple[Snapshot, ...]

    def fpr(self, since_s: float = 0.0, until_s: float = np.inf) -> float:
        """FP / (FP + TN) over the points of a span of time."""
        _, fp, _, tn = self.table[(self.t_s > since_s) & (self.t_s <= until_s)].sum(axis=0).tolist()
        return float(fp / (fp + tn)) if fp + tn else float("nan")

    def npv(self, since_s: float = 0.0, until_s: float = np.inf) -> float:
        """TN / (TN + FN) over the points of a span of time."""
        _, _, fn, tn = self.table[(self.t_s > since_s) & (self.t_s <= until_s)].sum(axis=0).tolist()
        return float(tn / (tn + fn)) if tn + fn else float("nan")

    def missed(self, since_s: float = 0.0, until_s: float = np.inf) -> float:
        """Mean number of vessels under way without a track in a span of time."""
        span = (self.t_s > since_s) & (self.t_s <= until_s)
        return float((self.under_way & (self.held_by < 0))[span].sum(axis=1).mean()) if span.any() else float("nan")

    def all_hidden_s(self) -> float:
        """How long from the beginning the background takes every point; to the end where it always does."""
        _, _, fn, tn = self.table.T
        kept = np.flatnonzero(fn + tn > 0)
        first = int(kept[0]) if len(kept) else len(self.t_s)
        return float(self.t_s[first - 1]) if first else 0.0


@dataclass(frozen=True, slots=True)
class Piece:
    """A case to be run on recordings that are there."""

    case: Case
    folder: Path
    seed: int
    scene: str | Path = SCENE
    sets: tuple[str, ...] = ()


def record(folder: Path, *, seed: int, scans: int, workers: int, scene: str | Path = SCENE) -> None:
    """The recordings of all radars, their AIS and their truth."""
    simulate(load_scene(scene), folder / "port.cat240", seed=seed, scans=scans or None, labels=False, workers=workers)


def run_case(job: Piece) -> Run:
    """One case over the recordings of a folder."""
    case, folder = job.case, job.folder
    names = ASHORE + ABOARD * case.launch
    paths = [folder / f"port-{name}.cat240" for name in names]
    scene = load_scene(job.scene)
    sets = [
        f"subtract.track_from={case.track_from}", f"subtract.start={case.start}",
        f"input.lat_deg={scene.lat_deg}", f"input.lon_deg={scene.lon_deg}", *job.sets,
    ]  # fmt: skip
    octets, config = open_inputs(paths), load_config(preset=PRESET, sets=sets)
    ais = folder / "port.ais.csv"  # boxes are made of what AIS tells, as the paper does
    side = side_documents(paths, truth=ais, own_ship=ais, sensors=folder / "port.sensors.toml")
    watch = _Watch(turn_s=scene.radar.turn_s)
    kinds, digests = kinds_of(octets), [""] * len(paths)
    run_silently(Job(octets=octets, kinds=kinds, input_sha256=digests, side=side, config=config, name="port"), [watch])
    return watch.run(case, job.seed)


@dataclass
class _Watch:
    """A sink that keeps what the figures and the claims need."""

    turn_s: float
    start_s: float = float("nan")
    converged_s: float = float("nan")
    holders: dict[str, int] = field(default_factory=dict)  # id of the track that had each vessel last
    steps: dict[int, dict[str, Any]] = field(default_factory=dict)
    snapshots: dict[float, list[Result]] = field(default_factory=dict)

    def open(self, manifest: RunManifest) -> None:
        """Nothing to open."""

    def close(self, summary: Mapping[str, Any]) -> None:
        """Nothing to close."""

    def abort(self) -> None:
        """Nothing to undo."""

    def write(self, result: Result) -> None:
        """Take one scan in; the last one of a step says what was tracked in it."""
        truth = result.frame.truth
        if truth is None:
            return
        if np.isnan(self.start_s):
            self.start_s = result.frame.scan.t_start_ns * 1e-9
        t_s = result.frame.t_ns * 1e-9 - self.start_s
        if np.isnan(self.converged_s) and result.background and any(m.converged for m in result.background.values()):
            self.converged_s = t_s
        k = int(t_s / self.turn_s)
        step = self.steps.setdefault(k, {"table": np.zeros(4, np.int64)})
        counts = confusion(result.points, result.keep, truth)
        step["table"] += (counts.tp, counts.fp, counts.fn, counts.tn)
        step |= {"truth": truth, **_tracked(result, truth, self.holders)}
        self.holders |= step["held_by"]
        for at_s in KEY_TIMES_S:
            if at_s - self.turn_s < t_s <= at_s:
                self.snapshots.setdefault(at_s, []).append(result)

    def run(self, case: Case, seed: int) -> Run:
        """The run as arrays over steps."""
        steps = [self.steps[k] for k in sorted(self.steps)]
        vessels = tuple(sorted({name for step in steps for name in step["truth"].id}))

        def column(name: str, missing: Any) -> np.ndarray:
            return np.array([[step[name].get(v, missing) for v in vessels] for step in steps])

        return Run(
            case=case, seed=seed, t_s=(np.array(sorted(self.steps)) + 1.0) * self.turn_s, vessels=vessels,
            known=np.array([[v in step["truth"].id for v in vessels] for step in steps]),
            under_way=column("under_way", False), held_by=column("held_by", -1), stationary=column("stationary", False),
            n_tracks=np.array([step["n_tracks"] for step in steps]), table=np.array([step["table"] for step in steps]),
            converged_s=self.converged_s, snapshots=tuple(_snapshot(t, r) for t, r in sorted(self.snapshots.items())),
        )  # fmt: skip


def _tracked(result: Result, truth: Truth, holders: Mapping[str, int]) -> dict[str, Any]:
    """Which confirmed track has which vessel: of those in its box the one that had it before, else the nearest."""
    tracks = result.tracks
    held = tracks.status >= CONFIRMED
    position_m, t_ns, ids = tracks.position_m[held], tracks.t_ns[held], tracks.id[held]
    speed_mps = np.hypot(truth.velocity_mps[:, 0], truth.velocity_mps[:, 1])
    held_by, stationary = {}, {}
    for i, name in enumerate(truth.id):
        inside = in_box(position_m, t_ns, truth, i, margin_m=MARGIN_M)
        if inside.any():
            off_m = np.hypot(*(position_m - truth.position_m[i]).T)
            best = np.argmin(np.where(inside, np.where(ids == holders.get(name, -1), -1.0, off_m), np.inf))
            held_by[name] = int(ids[best])
            stationary[name] = bool(tracks.status[held][best] == STATIONARY)
    return {
        "under_way": dict(zip(truth.id, (speed_mps > UNDER_WAY_MPS).tolist(), strict=True)),
        "held_by": held_by,
        "stationary": stationary,
        "n_tracks": int(np.count_nonzero(held & (tracks.status != STATIONARY))),
    }


def _snapshot(t_s: float, results: list[Result]) -> Snapshot:
    last = results[-1]
    held = last.tracks.status >= CONFIRMED
    assert last.frame.truth is not None
    return Snapshot(
        t_s=t_s,
        position_m=np.concatenate([r.points.position_m for r in results]),
        keep=np.concatenate([r.keep for r in results]),
        truth=last.frame.truth,
        tracks_m=last.tracks.position_m[held],
        extent_m2=last.tracks.extent_m2[held],
        track_id=last.tracks.id[held],
        stationary=last.tracks.status[held] == STATIONARY,
    )
