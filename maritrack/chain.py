"""One frame down the line: detect, subtract, cluster, track, score. Read this file first."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from maritrack.cluster.stage import cluster_points
from maritrack.detect.cells import detect_cells, empty_points
from maritrack.errors import ConfigError
from maritrack.metrics.scores import score_frame
from maritrack.settings import Config
from maritrack.trackers import TRACKERS, Tracker
from maritrack.types import CONFIRMED, BoolArray, Event, Frame, Points, Result, Scan, Tracks, take


@dataclass(frozen=True, slots=True)
class Chain:
    """The stages of a run with their settings. None of them remembers anything."""

    config: Config
    tracker: Tracker
    unexplained: bool = False  # truth is incomplete (AIS): false tracks are merely unexplained

    def init(self) -> ChainState:
        """The memory of a run that has not begun."""
        return ChainState(self.tracker.init(), ())


@dataclass(frozen=True, slots=True, eq=False)
class ChainState:
    """What survives from frame to frame."""

    tracker: Any
    alive: tuple[int, ...]  # ids of confirmed tracks after the last frame, for the log


def build_chain(config: Config, *, unexplained: bool = False) -> Chain:
    """The chain of a configuration."""
    if config.tracker_name not in TRACKERS:
        raise ConfigError(f"no tracker '{config.tracker_name}'", hint="trackers: " + ", ".join(TRACKERS))
    return Chain(config, TRACKERS[config.tracker_name](config), unexplained)


def process(chain: Chain, state: ChainState, frame: Frame) -> tuple[ChainState, Result]:
    """Carry one frame down the line."""
    config, scan, clock = chain.config, frame.scan, _Clock()
    points = detect(scan, config)
    clock.lap("detect")
    keep = np.ones(len(points), bool)
    clusters = cluster_points(points, scan, config.cluster, config.input)
    clock.lap("cluster")
    tracker, info = chain.tracker.update(state.tracker, scan, points, clusters)
    tracks = chain.tracker.estimate(tracker)
    clock.lap("track")
    scores = score_frame(
        frame.truth, tracks, c_m=config.score.c_m, p=config.score.p, which=reported(tracks, config),
        unexplained=chain.unexplained,
    )  # fmt: skip
    clock.lap("score")
    alive = tuple(tracks.id[tracks.status >= CONFIRMED].tolist())
    events = track_events(state.alive, alive, tracks, info)
    return ChainState(tracker, alive), Result(frame, points, keep, clusters, tracks, scores, events, clock.laps)


def detect(scan: Scan, config: Config) -> Points:
    """Points of a scan, from its video or as given, within the region of interest."""
    settings = config.input
    if scan.video is not None:
        points = detect_cells(scan, config.detect, latency_ns=round(settings.latency_s * 1e9))
    else:
        points = scan.points if scan.points is not None else empty_points()
    inside = (points.range_m >= settings.roi_min_m) & (points.range_m <= settings.roi_max_m)
    return points if inside.all() else take(points, inside)


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
        text = f"{info.n_inexact} groups beyond the exact limit: association by loopy belief propagation"
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
