"""A run: frames through the chain into the sinks, and the summary at the end."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

from maritrack.chain import Chain, ChainState, process
from maritrack.io.reference import Reference, truth_at
from maritrack.metrics.scores import ScoreSums, add, hold, means, summary_objects
from maritrack.remarks import remarks
from maritrack.settings import parse_lags
from maritrack.types import CONFIRMED, Damage, Frame, Result, RunManifest


class Sink(Protocol):
    """Where results go. `close` finishes the output under its final name, `abort` leaves what is readable."""

    def open(self, manifest: RunManifest) -> None: ...

    def write(self, result: Result) -> None: ...

    def close(self, summary: Mapping[str, Any]) -> None: ...

    def abort(self) -> None: ...


Progress = Callable[[Result], None]
Step = Callable[[Chain, ChainState, Frame], tuple[ChainState, Result]]


@dataclass
class Tally:
    """Running sums of a run. Memory does not grow with its length, but for one entry a truth object."""

    sums: ScoreSums
    hold_m: float
    frames: int = 0
    points: int = 0
    clusters: int = 0
    damage: dict[str, int] = field(default_factory=dict)  # by code
    damage_sensor: dict[str, int] = field(default_factory=dict)  # by sensor and code
    damage_first: dict[str, dict[str, Any]] = field(default_factory=dict)  # by code
    confirmed: int = 0
    moving: int = 0
    tracks: int = 0
    timing_ms: dict[str, float] = field(default_factory=dict)
    sensors: set[str] = field(default_factory=set)
    ids_confirmed: set[int] = field(default_factory=set)
    ids_moving: set[int] = field(default_factory=set)

    def note(self, damage: Damage) -> None:
        """Count what was wrong; the first of a code tells where."""
        self.damage[damage.code] = self.damage.get(damage.code, 0) + damage.count
        first = self.damage_first.setdefault(
            damage.code, {"offset": damage.offset, "message": damage.message, "sensor": damage.sensor, "sensors": {}}
        )
        sensors = first["sensors"]
        sensors[damage.sensor or "-"] = sensors.get(damage.sensor or "-", 0) + damage.count

    def add(self, result: Result, which: Any) -> None:
        """Take one result in."""
        self.frames += 1
        self.sensors.add(result.frame.scan.sensor.id)
        self.points += len(result.points)
        self.clusters += len(result.clusters)
        self.tracks += len(result.tracks)
        held = result.tracks.status >= CONFIRMED
        moving = held & result.tracks.moving
        self.confirmed += int(held.sum())
        self.moving += int(moving.sum())
        self.ids_confirmed.update(result.tracks.id[held].tolist())
        self.ids_moving.update(result.tracks.id[moving].tolist())
        for damage in result.frame.damage:
            self.note(damage)
            key = f"{damage.sensor or '-'}:{damage.code}"
            self.damage_sensor[key] = self.damage_sensor.get(key, 0) + damage.count
        for name, value in result.timing_ms.items():
            self.timing_ms[name] = self.timing_ms.get(name, 0.0) + value
        self.sums = hold(
            add(self.sums, result.scores), result.frame.truth, result.tracks, which=which, hold_m=self.hold_m
        )


def run(
    frames: Iterable[Frame],
    chain: Chain,
    sinks: Sequence[Sink],
    manifest: RunManifest,
    *,
    reference: Reference | None = None,
    progress: Progress | None = None,
    extra_damage: Sequence[Damage] = (),
    calibrated: Sequence[str] = (),
    keep_partial: bool = False,
    step: Step = process,
) -> dict[str, Any]:
    """Process all frames; the summary document (`metrics`, `counts`, `objects`, `timing`).

    `calibrated` are sensors that a calibration names; those without a scan are warned of.
    An interruption (Ctrl-C, SIGTERM) ends the run after the frame in work and closes the sinks, and the summary says
    so (`keep_partial`: aborts them instead); any other error aborts them, so that no half run stands under a
    final name. Sinks open with the first frame: an input without one leaves nothing behind.
    """
    from maritrack.chain import reported

    config = chain.config
    tally = Tally(ScoreSums(), config.score.hold_m)
    for damage in extra_damage:
        tally.note(damage)
    state, interrupted = chain.init(), False
    opened: list[Sink] = []
    started = time.process_time()
    try:
        with interruptions() as asked:
            for frame in with_truth(_timed(frames, tally.timing_ms), reference, chain):
                for sink in sinks[len(opened) :]:
                    opened.append(sink)
                    sink.open(manifest)
                state, result = step(chain, state, frame)
                at = time.process_time()
                for sink in sinks:
                    sink.write(result)
                tally.timing_ms["log"] = tally.timing_ms.get("log", 0.0) + (time.process_time() - at) * 1e3
                tally.add(result, reported(result.tracks, config))
                if progress is not None:
                    progress(result)
                if asked():
                    interrupted = True
                    break
        said = remarks(chain, state, sensors=tally.sensors, calibrated=calibrated)
        for damage in () if manifest.smoothed_from else said:
            tally.note(damage)
        summary = summarise(tally, chain, manifest, time.process_time() - started, interrupted)
        for sink in opened:
            if interrupted and keep_partial:
                sink.abort()
            else:
                sink.close(summary)
    except BaseException:
        for sink in opened:
            sink.abort()
        raise
    return summary


@contextmanager
def interruptions() -> Iterator[Callable[[], bool]]:
    """Whether somebody has asked to stop: the first Ctrl-C or SIGTERM waits for the frame in work, the second does
    not."""
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    asked: list[int] = []

    def note(number: int, _: object) -> None:
        if asked:
            raise KeyboardInterrupt
        asked.append(number)

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(asked)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def with_truth(frames: Iterable[Frame], reference: Reference | None, chain: Chain) -> Iterator[Frame]:
    """The frames with what is known to be true at their times, within the radar's range and the region of interest."""
    if reference is None:
        yield from frames
        return
    score, of_interest = chain.config.score, chain.config.input
    lags = parse_lags(score.truth_lag_s)
    for frame in frames:
        scan = frame.scan
        reach = min(score.truth_max_m or scan.sensor.max_range_m, of_interest.roi_max_m)
        truth = truth_at(
            reference, scan.t_ns, centre_m=scan.position_m, min_range_m=of_interest.roi_min_m, max_range_m=reach,
            max_gap_moving_s=score.max_gap_moving_s, max_gap_rest_s=score.max_gap_rest_s, lag_s=lags,
        )  # fmt: skip
        yield replace(frame, truth=truth)


def _timed(frames: Iterable[Frame], timing_ms: dict[str, float]) -> Iterator[Frame]:
    iterator = iter(frames)
    while True:
        at = time.process_time()
        try:
            frame = next(iterator)
        except StopIteration:
            return
        finally:
            timing_ms["decode"] = timing_ms.get("decode", 0.0) + (time.process_time() - at) * 1e3
        yield frame


def summarise(tally: Tally, chain: Chain, manifest: RunManifest, total_s: float, interrupted: bool) -> dict[str, Any]:
    """The summary document without its outputs."""
    n = max(tally.frames, 1)
    counts: dict[str, Any] = {
        "scans": tally.frames,
        "points": tally.points,
        "clusters": tally.clusters,
        "tracks": tally.tracks,
        "confirmed": tally.confirmed,
        "moving": tally.moving,
        "track_ids_confirmed": len(tally.ids_confirmed),
        "track_ids_moving": len(tally.ids_moving),
        "warnings": dict(sorted(tally.damage.items())),
        "warnings_by_sensor": dict(sorted(tally.damage_sensor.items())),
    }
    stages = ("decode", "detect", "subtract", "cluster", "track", "score", "log")
    timing = {f"{name}_ms_per_scan": tally.timing_ms.get(name, 0.0) / n for name in stages}
    summary: dict[str, Any] = {
        "run_id": manifest.run_id,
        "tracker": manifest.tracker,
        "preset": manifest.preset,
        "offline": bool(manifest.smoothed_from),
        "metrics": means(tally.sums),
        "objects": summary_objects(tally.sums),
        "counts": counts,
        "warnings": {code: tally.damage_first[code] | {"count": n} for code, n in sorted(tally.damage.items())},
        "timing": timing | {"total_s": total_s},
        "interrupted": interrupted,
        "score": {"c_m": chain.config.score.c_m, "p": chain.config.score.p, "hold_m": chain.config.score.hold_m},
    }
    if manifest.smoothed_from:
        summary["smoothed_from"] = manifest.smoothed_from
    if manifest.origin is not None:
        summary["origin"] = {"lat_deg": manifest.origin.lat_deg, "lon_deg": manifest.origin.lon_deg}
    return summary
