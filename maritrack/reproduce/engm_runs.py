"""One Monte Carlo run of the engm paper's experiment: the same points through all filters, both clutter densities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from maritrack.chain import build_chain, process
from maritrack.config import load_config
from maritrack.simulate.pointscene import PointScene, scan_of, truth_of
from maritrack.simulate.scenes import load_any
from maritrack.types import CONFIRMED, FloatArray, Frame, IntArray, Truth

TRACKERS = ("gm-phd", "smc-phd", "engm-phd")
PAPERS, SOUND = "cartesian", "jacobian"  # clutter densities
NOISY = "smc-phd, process noise 1"


@dataclass(frozen=True, slots=True)
class Variant:
    """A filter as it is run."""

    name: str
    tracker: str
    clutter: str
    sigma_process: float = 0.0


VARIANTS = tuple(
    [Variant(tracker, tracker, clutter) for clutter in (PAPERS, SOUND) for tracker in TRACKERS]
    + [Variant(NOISY, "smc-phd", PAPERS, 1.0)]
)


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """What came of one filter."""

    variant: Variant
    seed: int
    ospa: FloatArray  # (3, scans) total, localisation, cardinality
    found: IntArray  # (scans,) objects reported
    components: FloatArray  # (scans,)
    position_m: FloatArray  # (e, 3) of all that was reported
    scan: IntArray  # (e,)
    cpu_s: float  # of clustering and tracking


def the_scene() -> PointScene:
    """The experiment's scene."""
    scene = load_any("crossing-3d")
    assert isinstance(scene, PointScene)
    return scene


def run_seed(seed: int) -> tuple[Run, ...]:
    """All variants on the points of a seed."""
    scene = the_scene()
    frames = [Frame(k, scan_of(scene, k, seed=seed), truth_frame(scene, k)) for k in range(scene.scans)]
    return tuple(run_variant(variant, frames, seed) for variant in VARIANTS)


def run_variant(variant: Variant, frames: list[Frame], seed: int) -> Run:
    """One filter over the frames, as `process` runs it."""
    over: Mapping[str, object] = {
        "tracker_name": variant.tracker,
        "seed": seed,
        "intensity": {"clutter_space": variant.clutter, "sigma_process": variant.sigma_process},
    }
    chain = build_chain(load_config(preset="engm", over=over))
    state, cpu_ms = chain.init(), 0.0
    ospa, found, components, places, scans = [], [], [], [], []
    for frame in frames:
        state, result = process(chain, state, frame)
        cpu_ms += result.timing_ms["cluster"] + result.timing_ms["track"]
        scores, tracks = result.scores, result.tracks
        which = tracks.status >= CONFIRMED
        assert tracks.up_m is not None
        places.append(np.column_stack([tracks.position_m, tracks.up_m])[which])
        scans.append(np.full(len(places[-1]), frame.k))
        ospa.append((scores["ospa"], scores["ospa_localisation"], scores["ospa_cardinality"]))
        found.append(len(places[-1]))
        components.append(len(state.tracker.intensity))
    return Run(
        variant, seed, np.array(ospa).T, np.array(found, np.int64), np.array(components, np.float64),
        np.concatenate(places), np.concatenate(scans), cpu_ms * 1e-3,
    )  # fmt: skip


def truth_frame(scene: PointScene, k: int) -> Truth:
    """The objects at scan k."""
    x = truth_of(scene, k)
    unknown = np.full(len(x), np.nan)
    return Truth(
        id=tuple(f"object-{i + 1}" for i in range(len(x))), name=("",) * len(x),
        t_ns=round(k * scene.period_s * 1e9), position_m=x[:, :2], velocity_mps=x[:, 3:5], heading_rad=unknown,
        length_m=unknown, width_m=unknown, up_m=x[:, 2], vel_up_mps=x[:, 5],
    )  # fmt: skip
