"""The values that travel down the line. Frozen dataclasses of arrays, leading axis = item.

Units are in the names, shapes in the comments, checked once when a value is made. Time is int64
nanoseconds since 1970 (since midnight where a recording has no date). The common frame is local
east-north in metres; azimuth is clockwise from true north in radians. Empty is normal everywhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

TENTATIVE, CONFIRMED, COASTED, STATIONARY = 0, 1, 2, 3
STATUS = ("tentative", "confirmed", "coasted", "stationary")

T = TypeVar("T")


def check_lengths(value: Any, length: int, *names: str) -> None:
    """Raise ValueError where a named array of a value has another leading length."""
    for name in names:
        array = getattr(value, name)
        if array is not None and len(array) != length:
            raise ValueError(f"{type(value).__name__}.{name} has {len(array)} rows, not {length}")


def take(value: T, index: Any, *, keep: tuple[str, ...] = ()) -> T:
    """The same kind of value with only the rows `index`; fields named in `keep` stay as they are."""
    changed = {
        f.name: getattr(value, f.name)[index]
        for f in fields(value)  # type: ignore[arg-type]
        if f.name not in keep and isinstance(getattr(value, f.name), np.ndarray)
    }
    return replace(value, **changed)  # type: ignore[type-var]


@dataclass(frozen=True, slots=True)
class Origin:
    """Where east = north = 0 lies on WGS84."""

    lat_deg: float
    lon_deg: float


@dataclass(frozen=True, slots=True)
class Sensor:
    """What is constant about a sensor while its settings stay."""

    id: str  # "7-42" (SAC-SIC) for CAT240, else a name: the last part of entity paths and topics
    range_res_m: float  # depth of a cell; 0 where the input is points
    azimuth_res_rad: float  # width of a cell; 0 where the input is points
    max_range_m: float  # inf where unknown
    bits: int = 8  # of a video cell
    latency_s: float = 0.0  # points of its video are older than their spoke's time; not archived: points have theirs


@dataclass(frozen=True, slots=True, eq=False)
class Video:
    """One rotation of radar video in sensor-polar coordinates. Rows = spokes in time order."""

    azimuth_rad: FloatArray  # (a,) centre of the spoke from true north, [0, 2 pi)
    width_rad: FloatArray  # (a,) width of the spoke
    t_ns: IntArray  # (a,)
    first_range_m: float  # centre of cell 0
    cell_m: float
    intensity: NDArray[np.unsignedinteger[Any]]  # (a, b) as recorded: uint8, uint16 or uint32
    cells_used: IntArray  # (a,) cells that the spoke has; the rest of its row is padding

    def __post_init__(self) -> None:
        check_lengths(self, len(self.azimuth_rad), "width_rad", "t_ns", "intensity", "cells_used")


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A screenshot of a radar as echo strength. Masked pixels have none."""

    strength: NDArray[np.uint8]  # (h, w)
    centre_px: tuple[float, float]  # x, y of the radar
    pixel_m: float
    up_rad: float  # azimuth of what is up in the picture, from true north


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Detections of one scan."""

    range_m: FloatArray  # (n,) from the sensor, centre of the cell
    azimuth_rad: FloatArray  # (n,)
    position_m: FloatArray  # (n, 2) east-north
    intensity: FloatArray  # (n,)
    t_ns: IntArray  # (n,) time of the spoke, latency already taken off
    range_width_m: FloatArray  # (n,) cell: range +- half of it; 0 where the input is points
    azimuth_width_rad: FloatArray  # (n,)
    cov_m2: FloatArray | None = None  # (n, 2, 2) noise, where the input tells it
    truth_label: IntArray | None = None  # (n,) index of the true object, -1 = clutter (simulations)
    elevation_rad: FloatArray | None = None  # (n,) above the sensor's horizon, in 3-D inputs; range is the slant range
    up_m: FloatArray | None = None  # (n,) with it
    noise: FloatArray | None = None  # (n, 3) variances of range (m^2), azimuth and elevation (rad^2), where told

    def __post_init__(self) -> None:
        names = [f.name for f in fields(self)]
        check_lengths(self, len(self.range_m), *names)

    def __len__(self) -> int:
        return len(self.range_m)


@dataclass(frozen=True, slots=True, eq=False)
class Clusters:
    """Extended measurements of one scan, ordered by azimuth, then range. Rows c, points n."""

    mean_m: FloatArray  # (c, 2) centroid, east-north
    scatter_m2: FloatArray  # (c, 2, 2) n * sum w (z - mean)(z - mean)', a sum, not divided
    count: IntArray  # (c,) points in the cluster
    weight_sq: FloatArray  # (c,) sum of squared normalised weights; 1/count for equal ones
    noise_m2: FloatArray  # (c, 2, 2) sensor noise R at the centroid
    t_ns: IntArray  # (c,) mean time of its points
    range_m: FloatArray  # (c,) of the centroid from the sensor
    azimuth_rad: FloatArray  # (c,)
    intensity: FloatArray  # (c,) sum over its points
    label: IntArray  # (n,) cluster of each point, -1 = noise

    def __post_init__(self) -> None:
        check_lengths(
            self, len(self.mean_m), "scatter_m2", "count", "weight_sq", "noise_m2", "t_ns", "range_m", "azimuth_rad",
            "intensity",
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.mean_m)


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """What a tracker believes after a scan. Ordered by id."""

    id: IntArray  # (t,)
    t_ns: IntArray  # (t,) the time that position and covariance refer to
    position_m: FloatArray  # (t, 2)
    velocity_mps: FloatArray  # (t, 2)
    cov: FloatArray  # (t, 4, 4) of [east, north, vel_east, vel_north]
    extent_m2: FloatArray  # (t, 2, 2) ellipse {u: u' X^-1 u <= 1}, semi-axes sqrt(eig X); 0 = point
    existence: FloatArray  # (t,)
    status: IntArray  # (t,) index into STATUS
    moving: BoolArray  # (t,)
    cluster: IntArray  # (t,) cluster with the largest association weight, -1 = missed
    contour_m: tuple[FloatArray, ...] = ()  # (v, 2) each, for trackers that draw the hull
    extent_dof: FloatArray | None = None  # (t,) alpha of the extent's inverse Wishart, for trackers that have one
    up_m: FloatArray | None = None  # (t,) for trackers in 3-D
    vel_up_mps: FloatArray | None = None  # (t,) with it

    def __post_init__(self) -> None:
        names = [f.name for f in fields(self) if f.name != "contour_m"]
        check_lengths(self, len(self.id), *names)

    def __len__(self) -> int:
        return len(self.id)


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """Reference objects at one instant: simulator, GNSS or AIS."""

    id: tuple[str, ...]
    name: tuple[str, ...]  # "" where unknown
    t_ns: int
    position_m: FloatArray  # (n, 2)
    velocity_mps: FloatArray  # (n, 2) nan where unknown
    heading_rad: FloatArray  # (n,) nan where unknown
    length_m: FloatArray  # (n,) nan where unknown
    width_m: FloatArray  # (n,) nan where unknown
    up_m: FloatArray | None = None  # (n,) where the reference has it
    vel_up_mps: FloatArray | None = None  # (n,) with it, nan where unknown

    def __post_init__(self) -> None:
        names = [f.name for f in fields(self) if f.name != "t_ns"]
        check_lengths(self, len(self.id), *names)

    def __len__(self) -> int:
        return len(self.id)


@dataclass(frozen=True, slots=True)
class Damage:
    """One thing that was wrong with the input, and where."""

    code: str  # stable, kebab-case: "zlib-error"
    offset: int  # octet in the input; -1 where there is no such place
    message: str
    sensor: str = ""
    count: int = 1  # of the same thing in a row, the first at `offset`


@dataclass(frozen=True, slots=True, eq=False)
class Mask:
    """Pixels of a grid in east-north, of those that background subtraction takes away."""

    key: IntArray  # (m,) geo.pixel_key, ascending
    pixel_m: float
    corner_m: tuple[float, float] = (0.0, 0.0)  # of a corner of pixel (0, 0)


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One rotation of one sensor: video, a picture or points, and where the sensor was."""

    sensor: Sensor
    t_ns: int  # end of the rotation (points: their common time)
    t_start_ns: int
    position_m: FloatArray  # (2,) of the sensor at the middle of the rotation
    heading_rad: float  # of the platform, nan where unknown (already applied to azimuths)
    video: Video | None = None
    points: Points | None = None
    picture: Picture | None = None
    segment: int = 0  # counts up when the range scale changes or after a long gap
    swept: BoolArray | None = None  # (720,) half-degree bins seen in this scan; None = all
    covered: Mask | None = None  # where points were taken away: what is there is not to be seen; None = nowhere
    up_m: float = 0.0  # of the sensor, in 3-D inputs
    also_covered: tuple[Mask, ...] = ()  # where points of the other sensors are taken away

    @property
    def n_spokes(self) -> int:
        return 0 if self.video is None else len(self.video.azimuth_rad)


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One step of the run: a scan, what is known to be true at its time, and its original bytes."""

    k: int
    scan: Scan
    truth: Truth | None = None
    inputs: tuple[tuple[str, bytes], ...] = ()  # (channel, octets read since the last frame)
    damage: tuple[Damage, ...] = ()  # noticed since the last frame

    @property
    def t_ns(self) -> int:
        return self.scan.t_ns


@dataclass(frozen=True, slots=True)
class Event:
    """A line for the log of the run."""

    level: str  # "info" or "warning"
    stage: str  # "ingest", "cluster", "track"
    message: str


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """All that is known after a frame: what sinks draw and archive."""

    frame: Frame
    points: Points  # detected
    keep: BoolArray  # (n,) points that background subtraction left
    clusters: Clusters  # of points.take(keep); label has keep.sum() rows
    tracks: Tracks
    scores: Mapping[str, float]  # names like "gospa", "ospa", "ospa_localisation"; nan = no truth
    events: tuple[Event, ...]
    timing_ms: Mapping[str, float]  # CPU per stage
    mask: Mask | None = None  # what background subtraction took away; None = there was none
    background: Any = None  # its model after this scan, by sensor


@dataclass(frozen=True, slots=True)
class RunManifest:
    """What makes a run this run. Equal manifests give equal archives."""

    run_id: str
    tracker: str
    preset: str
    code_sha256: str
    config_toml: str
    input_sha256: tuple[str, ...]
    input_kind: tuple[str, ...]  # "cat240", "points", "autoferry", "plots", "images", "rwmr"
    seed: int
    versions: Mapping[str, str]
    origin: Origin | None = None
    recording: str = ""  # stem of the input, for titles; not archived
    smoothed_from: str = ""  # id of the causal run whose tracks these are in hindsight; "" = a causal run
    joined: str = ""  # of which segments the run was joined; "" = it ran in one piece
