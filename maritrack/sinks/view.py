"""What a view of the run has to show: its bounds, how far the rings go, which scores there are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maritrack.sinks.captions import shown_moving
from maritrack.types import FloatArray, Result

POINTS_LOOKED_AT = 500  # of a scan, to find out where the action is


@dataclass(frozen=True, slots=True)
class Box:
    """What a view shows, in metres."""

    west: float
    east: float
    south: float
    north: float

    @property
    def size_m(self) -> float:
        return max(self.east - self.west, self.north - self.south)

    @property
    def centre_m(self) -> FloatArray:
        return np.array([(self.west + self.east) / 2, (self.south + self.north) / 2])

    def farthest_side(self, position_m: FloatArray) -> float:
        """Distance from a place to the side of the box that is farthest, along an axis."""
        east, north = position_m.tolist()
        return float(max(east - self.west, self.east - east, north - self.south, self.north - north))

    def holds(self, other: Box) -> bool:
        """Whether the other lies inside."""
        return self.union(other) == self

    def union(self, other: Box | None) -> Box:
        """The smallest box around both."""
        if other is None:
            return self
        return Box(min(self.west, other.west), max(self.east, other.east), min(self.south, other.south),
                   max(self.north, other.north))  # fmt: skip

    def padded(self, share: float) -> Box:
        """A square about the same centre, larger by `share`."""
        half = max(self.size_m, 1.0) / 2 * (1 + share)
        east, north = self.centre_m
        return Box(float(east - half), float(east + half), float(north - half), float(north + half))


def square(centre_m: FloatArray, half_m: float) -> Box:
    """The box that reaches this far on all sides."""
    east, north = centre_m.tolist()
    return Box(east - half_m, east + half_m, north - half_m, north + half_m)


def box_around(position_m: FloatArray, *, share: float = 0.98) -> Box | None:
    """The box that holds this share of the positions (n, 2) on either axis; None where there are none."""
    position_m = position_m[np.isfinite(position_m).all(axis=1)]
    if len(position_m) == 0:
        return None
    tail = (1 - share) / 2
    (west, south), (east, north) = np.quantile(position_m, [tail, 1 - tail], axis=0)
    return Box(float(west), float(east), float(south), float(north))


DEFAULT_BOX = Box(-1000.0, 1000.0, -1000.0, 1000.0)


@dataclass(frozen=True, slots=True, eq=False)
class Pending:
    """A result that waits for its batch. Its video has become a picture already."""

    result: Result
    jpeg: bytes | None
    half_m: float  # of the picture; 0 where the scan has none


def bounds_of(pending: list[Pending], box: Box | None) -> Box | None:
    """The box, grown by what these scans show: the reach of the video, or where the points are."""
    at = [np.zeros((0, 2))]
    for p in pending:
        scan, tracks = p.result.frame.scan, p.result.tracks
        if p.half_m > 0:
            reach = square(scan.position_m, p.half_m)
            box = reach.union(box)
            continue
        kept = p.result.points.position_m[p.result.keep]
        at += [scan.position_m[None], kept[:: len(kept) // POINTS_LOOKED_AT + 1]]
        at.append(tracks.position_m[shown_moving(tracks)])
    around = box_around(np.concatenate(at))
    return box if around is None else around.union(box)


def range_of(pending: list[Pending], box: Box | None) -> float:
    """How far the rings go: to the end of the first video, or to the farthest side of the box."""
    reach = [p.half_m for p in pending if p.half_m > 0]
    if reach or box is None:
        return reach[0] if reach else DEFAULT_BOX.size_m / 2
    return max(box.farthest_side(pending[0].result.frame.scan.position_m), 10.0)


def score_names(pending: list[Pending]) -> list[str]:
    """Scores that have a value in these scans."""
    return list(dict.fromkeys(n for p in pending for n, v in p.result.scores.items() if np.isfinite(v)))
