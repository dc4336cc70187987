"""Several recordings as one: their frames merged in order of time, or step by step."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from itertools import groupby

import numpy as np

from maritrack.errors import InputError, UsageError
from maritrack.geo import en_to_polar
from maritrack.io.source import Source
from maritrack.types import Frame, Origin, Points, Scan, Sensor


@dataclass(frozen=True, slots=True)
class MergedSource:
    """Frames of several sources by time, at equal times in the order of the sources. Make it with `merge_sources`.

    One frame of each source is read ahead. A source whose own frames step back in time keeps its order.   Eq: abs-1
    """

    kind: str  # "cat240", or "cat240+points" where they differ
    origin: Origin | None
    sources: tuple[Source, ...]

    def frames(self) -> Iterator[Frame]:
        """Frames numbered anew from 0."""
        merged = heapq.merge(*(source.frames() for source in self.sources), key=lambda frame: frame.t_ns)
        for k, frame in enumerate(merged):
            yield replace(frame, k=k)


def merge_sources(sources: Sequence[Source]) -> MergedSource:
    """Sources read side by side. They have one origin; UsageError where there is no source or two origins."""
    if not sources:
        raise UsageError("no input")
    origins = list(dict.fromkeys(source.origin for source in sources if source.origin is not None))
    if len(origins) > 1:
        raise UsageError("inputs have different origins: give one for all")
    kind = "+".join(dict.fromkeys(source.kind for source in sources))
    return MergedSource(kind, origins[0] if origins else None, tuple(sources))


def in_steps(frames: Iterator[Frame], step_s: float) -> Iterator[Frame]:
    """The frames with their times moved to the end of the step in which they end; 0 leaves them as they are.

    Scans of one step then are of one instant, whatever the sensor: a tracker predicts once and is updated by one
    after the other, as in abs, Algorithm 1.   Reading: the paper has sets of all sensors at each step and does not say
    when their beams passed; what moves is as much as a turn and a step late.
    """
    step_ns, first_ns = round(step_s * 1e9), None
    for frame in frames:
        if step_ns == 0:
            yield frame
            continue
        first_ns = frame.t_ns if first_ns is None else first_ns
        end_ns = first_ns + -(-(frame.t_ns - first_ns) // step_ns) * step_ns
        yield replace(frame, scan=_at(frame.scan, end_ns))


def _at(scan: Scan, t_ns: int) -> Scan:
    """The scan as if it had been heard at one instant."""
    video, points = scan.video, scan.points
    return replace(
        scan,
        t_ns=t_ns,
        t_start_ns=t_ns,
        video=None if video is None else replace(video, t_ns=np.full_like(video.t_ns, t_ns)),
        points=None if points is None else replace(points, t_ns=np.full_like(points.t_ns, t_ns)),
    )


def united(frames: Iterator[Frame], name: str) -> Iterator[Frame]:
    """Frames of one instant as one frame of a sensor called `name`, numbered anew; "" leaves them as they are.

    The point clouds of several LiDARs aboard are one cloud, seen from the middle of them. InputError for video, which
    has no points to unite.
    """
    if not name:
        yield from frames
        return
    for k, (_, same) in enumerate(groupby(frames, key=lambda frame: frame.t_ns)):
        group = list(same)
        inputs = tuple(item for frame in group for item in frame.inputs)
        damage = tuple(item for frame in group for item in frame.damage)
        yield Frame(k, _one([frame.scan for frame in group], name), group[0].truth, inputs, damage)


def _one(scans: Sequence[Scan], name: str) -> Scan:
    """All points of scans of one instant in one scan; heading and height are those of the first."""
    clouds = [scan.points for scan in scans if scan.points is not None]
    if len(clouds) < len(scans):
        raise InputError("input.unite: video has no points to unite")
    at_m = np.mean([scan.position_m for scan in scans], axis=0)
    joined = {
        f.name: np.concatenate([getattr(cloud, f.name) for cloud in clouds])
        for f in fields(Points)
        if all(getattr(cloud, f.name) is not None for cloud in clouds)
    }
    range_m, azimuth_rad = en_to_polar(joined["position_m"] - at_m)
    points = Points(**(joined | {"range_m": range_m, "azimuth_rad": azimuth_rad}))
    sensor = Sensor(name, 0.0, 0.0, max(scan.sensor.max_range_m for scan in scans))
    return replace(scans[0], sensor=sensor, position_m=at_m, points=points, swept=None)
