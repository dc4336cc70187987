"""One frame down the line: detect, subtract, cluster, track, score. Read this file first."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from maritrack.cluster.kmeans import MOST_POINTS
from maritrack.cluster.stage import cluster_points
from maritrack.detect.background import Background, learn, mask_of, no_background, under
from maritrack.detect.blobs import detect_blobs
from maritrack.detect.cells import detect_cells, nearest_in_sectors
from maritrack.errors import ConfigError
from maritrack.geo import in_mask
from maritrack.metrics.background import background_scores
from maritrack.metrics.scores import score_frame
from maritrack.objects import nearside
from maritrack.settings import ClusterConfig, Config
from maritrack.trackers import TRACKERS, Told, Tracker
from maritrack.types import CONFIRMED, BoolArray, Event, Frame, Mask, Points, Result, Scan, Tracks, take


@dataclass(frozen=True, slots=True)
class Chain:
    """The stages of a run with their settings. None of them remembers anything."""

    config: Config
    tracker: Tracker
    unexplained: bool = False  # truth is incomplete (AIS): false tracks are merely unexplained
    background: Mapping[str, Background] = field(default_factory=dict)  # known before the first scan, by sensor
    hulls: tuple[nearside.NearSide, ...] = ()  # behind what is seen of them; none = extents are what is seen

    def init(self) -> ChainState:
        """The memory of a run that has not begun."""
        return ChainState(self.tracker.init(), (), self.background)


@dataclass(frozen=True, slots=True, eq=False)
class ChainState:
    """What survives from frame to frame."""

    tracker: Any
    alive: tuple[int, ...]  # ids of confirmed tracks after the last frame, for the log
    background: Mapping[str, Background] = field(default_factory=dict)  # by sensor, "" = one for all


def build_chain(
    config: Config, *, unexplained: bool = False, background: Mapping[str, Background] | None = None
) -> Chain:
    """The chain of a configuration; `background` is one that is known, as of a snapshot."""
    if config.tracker_name not in TRACKERS:
        raise ConfigError(f"no tracker '{config.tracker_name}'", hint="trackers: " + ", ".join(TRACKERS))
    told = config.input.scale_db > 0.0 and config.model.extent == "random-matrix"
    hulls = nearside.build(config.model.outline_power) if told and config.model.outline_power else ()
    return Chain(config, TRACKERS[config.tracker_name](config), unexplained, background or {}, hulls)


def process(chain: Chain, state: ChainState, frame: Frame) -> tuple[ChainState, Result]:
    """Carry one frame down the line."""
    config, scan, clock = chain.config, frame.scan, _Clock()
    points = detect(scan, config)
    clock.lap("detect")
    background, mask, keep = subtract(state.background, scan, points, spared(chain, state), config)
    left = points if mask is None else take(points, keep)
    clock.lap("subtract")
    clusters = cluster_points(left, scan, config.cluster, config.input)
    clock.lap("cluster")
    tracker, info = state.tracker, None
    if ready(background, scan, config):  # abs-9: in case 1 tracking waits for it
        if frame.truth is not None and isinstance(chain.tracker, Told):
            tracker = chain.tracker.started(tracker, frame.truth, scan)
        tracker, info = chain.tracker.update(tracker, covered(scan, mask, background, config), left, clusters)
    tracks = nearside.complete(chain.tracker.estimate(tracker), scan.position_m, chain.hulls, config.model)
    clock.lap("track")
    scores = score_frame(
        frame.truth, tracks, c_m=config.score.c_m, p=config.score.p, which=reported(tracks, config),
        unexplained=chain.unexplained, velocity=config.score.velocity, bow_share=config.score.bow_share,
    )  # fmt: skip
    if mask is not None:
        scores |= background_scores(points, keep, frame.truth, margin_m=config.score.box_margin_m)
    clock.lap("score")
    alive = tuple(tracks.id[tracks.status >= CONFIRMED].tolist())
    events = background_events(state.background, background, scan, config) + sample_events(left, config.cluster)
    events += track_events(state.alive, alive, tracks, info) if info is not None else ()
    result = Result(frame, points, keep, clusters, tracks, scores, events, clock.laps, mask, background)
    return ChainState(tracker, alive, background), result


def detect(scan: Scan, config: Config) -> Points:
    """Points of a scan, as given or from its video or picture, within the region of interest, of each sector the
    nearest."""
    settings = config.input
    if scan.points is not None:
        points = scan.points
    elif scan.video is not None:
        points = detect_cells(scan, config.detect, latency_ns=round(scan.sensor.latency_s * 1e9))
    else:
        latency_ns = round(settings.latency_s * 1e9)
        points = detect_blobs(scan, config.images, latency_ns=latency_ns, max_points=config.detect.max_points)
    inside = (points.range_m >= settings.roi_min_m) & (points.range_m <= settings.roi_max_m)
    points = points if inside.all() else take(points, inside)
    return take(points, nearest_in_sectors(points, settings.sector_deg)) if settings.sector_deg > 0 else points


def subtract(
    background: Mapping[str, Background], scan: Scan, points: Points, spare: Tracks | None, config: Config
) -> tuple[Mapping[str, Background], Mask | None, BoolArray]:
    """The models with one more scan, the pixels of its sensor that are background, the points (n,) that are not.

    What lies under the tracks `spare` is neither learned nor taken away.
    """
    rules = config.subtract
    if rules.method == "none":
        return background, None, np.ones(len(points), bool)
    name = model_name(scan, config)
    model = learn(
        background.get(name, no_background()), scan, points, rules,
        roi_min_m=config.input.roi_min_m, roi_max_m=min(config.input.roi_max_m, rules.max_range_m), spared=spare,
    )  # fmt: skip
    mask = mask_of(model, rules)
    keep = ~in_mask(mask, points.position_m) | (points.range_m > rules.max_range_m)
    if spare is not None:
        keep |= under(spare, points.position_m, scan.t_ns, rules.pixel_m)
    return {**background, name: model}, mask, keep


def covered(scan: Scan, mask: Mask | None, background: Mapping[str, Background], config: Config) -> Scan:
    """The scan with the background of its sensor and, as they are now, those of the others."""
    if mask is None:
        return scan
    own = model_name(scan, config)
    others = tuple(mask_of(model, config.subtract) for name, model in background.items() if name != own)
    return replace(scan, covered=mask, also_covered=others)


def spared(chain: Chain, state: ChainState) -> Tracks | None:
    """Tracks under way after the last scan, where background subtraction is to leave them alone."""
    if chain.config.subtract.method == "none" or chain.config.subtract.spare == "none":
        return None
    tracks = chain.tracker.estimate(state.tracker)
    return take(tracks, (tracks.status >= CONFIRMED) & tracks.moving)


def model_name(scan: Scan, config: Config) -> str:
    """The background model that a scan belongs to: its sensor's, or the one of all."""
    return "" if config.subtract.masks == "joint" else scan.sensor.id


def ready(background: Mapping[str, Background], scan: Scan, config: Config) -> bool:
    """Whether the scan goes to the tracker."""
    waits = config.subtract.method != "none" and config.subtract.track_from == "converged"
    return not waits or background[model_name(scan, config)].converged


def background_events(
    before: Mapping[str, Background], now: Mapping[str, Background], scan: Scan, config: Config
) -> tuple[Event, ...]:
    """A log line when the model of the scan's sensor has converged."""
    name = model_name(scan, config)
    if name not in now or not now[name].converged or (name in before and before[name].converged):
        return ()
    tracking = ": tracking starts" if config.subtract.track_from == "converged" else ""
    if now[name].settled:
        return (Event("info", "subtract", f"background converged after {now[name].scans} scans{tracking}"),)
    return (Event("warning", "subtract", f"background not settled after {now[name].scans} scans{tracking}"),)


def sample_events(left: Points, config: ClusterConfig) -> tuple[Event, ...]:
    """A log line where k-means had too many points to look at them all."""
    if config.method != "kmeans" or len(left) <= MOST_POINTS:
        return ()
    text = f"{len(left)} points: k-means searched a sample of {MOST_POINTS} of them, the rest went to what is nearest"
    return (Event("warning", "cluster", text),)


def reported(tracks: Tracks, config: Config) -> BoolArray:
    """Tracks (t,) that count in scores: confirmed in any way, and under way where that is asked for."""
    which = tracks.status >= CONFIRMED
    return which & tracks.moving if config.score.moving_only else which


def track_events(before: tuple[int, ...], now: tuple[int, ...], tracks: Tracks, info: Any) -> tuple[Event, ...]:
    """Log lines of what changed: tracks confirmed and ended, approximations made."""
    old, new = set(before), set(now)
    events = [Event("info", "track", f"track {i} confirmed") for i in now if i not in old]
    events += [Event("info", "track", f"track {i} ended") for i in before if i not in new]
    if info.n_inexact:
        text = f"{info.n_inexact} groups beyond the exact limit: association approximated"
        events.append(Event("warning", "track", text))
    if info.n_cut:
        events.append(
            Event("warning", "track", f"{info.n_cut} pairs of tracks and clusters left out: more than 64 in a gate")
        )
    if info.n_left_out:
        events.append(
            Event("warning", "track", f"{info.n_left_out} clusters started no track: tracker.max_tracks reached")
        )
    if info.clock_back:
        events.append(Event("warning", "track", "the clock stepped back: tracks not moved"))
    return tuple(events)


class _Clock:
    """CPU time of the stages of one frame; it reaches the summary and the picture, never the archive."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._at = time.process_time()

    def lap(self, name: str) -> None:
        now = time.process_time()
        self.laps[name] = (now - self._at) * 1e3
        self._at = now
