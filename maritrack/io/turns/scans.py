"""The scan that a turn of an antenna is, once the site of the sensor is known.

The choices that CAT240 leaves open are made here: START_RG counts cells from the antenna and marks
the near edge of the first one, so cell i has its centre at (START_RG + i + 1/2) cells; a spoke whose
END azimuth equals its START, or lies more than half a turn beyond it, is as wide as the median step.
"""

from __future__ import annotations

import numpy as np

from maritrack.geo import TWO_PI, wrap_positive
from maritrack.io.pose import PoseTrack
from maritrack.io.turns.spokes import TURN, Spokes
from maritrack.io.turns.turn import Turn
from maritrack.settings import InputConfig
from maritrack.types import BoolArray, FloatArray, IntArray, Scan, Sensor, Video

HALF_DEGREES = 720
ROUNDING = 0.05  # of half a degree
EDGE = {"start": 0.0, "centre": 0.5, "end": 1.0}  # where in the spoke its azimuth is


def scan_of(turn: Turn, config: InputConfig, pose: PoseTrack, *, midnight_ns: int) -> Scan:
    """The scan at its place and time: azimuths from true north, ranges of cell centres."""
    t_ns = turn.t_ns + midnight_ns
    late_ns = round(config.latency_s * 1e9)  # the platform has moved on when the spoke gets its time
    azimuth_rad, width_rad = _azimuths(turn.spokes, config, pose, t_ns - late_ns)
    first = turn.spokes[0]
    cell_m, start_rg = float(first["cell_m"]), int(first["start_rg"])
    sensor = Sensor(
        id=turn.sensor,
        range_res_m=cell_m,
        azimuth_res_rad=float(np.median(width_rad)),
        max_range_m=(start_rg + turn.cells.shape[1]) * cell_m,
        bits=int(first["bits"]),
        latency_s=config.latency_s,
    )
    video = Video(
        azimuth_rad=azimuth_rad,
        width_rad=width_rad,
        t_ns=t_ns,
        first_range_m=(start_rg + 0.5) * cell_m + config.range_offset_m,
        cell_m=cell_m,
        intensity=turn.cells,
        cells_used=np.ascontiguousarray(turn.spokes["n_cells"]),
    )
    start_ns, end_ns = int(t_ns[0]), int(t_ns[-1])
    middle_ns = np.array([(start_ns + end_ns) // 2 - late_ns])
    return Scan(
        sensor=sensor,
        t_ns=end_ns,
        t_start_ns=start_ns,
        position_m=pose.position(middle_ns)[0],
        heading_rad=float(pose.heading(middle_ns)[0]),
        video=video,
        segment=turn.segment,
        swept=swept_bins(azimuth_rad, width_rad),
    )


def _azimuths(spokes: Spokes, config: InputConfig, pose: PoseTrack, t_ns: IntArray) -> tuple[FloatArray, FloatArray]:
    """Azimuth from true north and width of each spoke, in radians."""
    span = (spokes["end_az"] - spokes["start_az"]) % TURN
    told = (span > 0) & (span <= TURN // 2)
    width = span.astype(np.float64) if told.all() else np.where(told, span, _median_step(spokes))
    azimuth = spokes["start_az"] + EDGE[config.azimuth_edge] * np.where(told, span, 0)
    azimuth_rad = azimuth * (TWO_PI / TURN) + np.deg2rad(config.azimuth_offset_deg)
    if config.stabilised == "head":
        azimuth_rad = azimuth_rad + pose.heading(t_ns)
    return wrap_positive(azimuth_rad), width * (TWO_PI / TURN)


def _median_step(spokes: Spokes) -> float:
    """The usual step from spoke to spoke; 0 where there is only one."""
    step = np.abs(np.diff(spokes["turn"]))
    step = step[(step > 0) & ~spokes["stray"][1:]]
    return float(np.median(step)) if len(step) else 0.0


def swept_bins(azimuth_rad: FloatArray, width_rad: FloatArray) -> BoolArray:
    """Which half degrees (720,) the spokes cover, each being `width_rad` wide about its azimuth.

    A spoke that is off by a rounded azimuth does not count for the half degree beside it.
    """
    per_rad = HALF_DEGREES / TWO_PI
    centre, half = azimuth_rad * per_rad, width_rad * (per_rad / 2)
    inside = half - np.minimum(ROUNDING, half / 2)
    first = np.floor(centre - inside).astype(np.int64)
    last = np.maximum(np.ceil(centre + inside).astype(np.int64) - 1, first)
    # Bins first..last of an unrolled circle of three turns: +1 where a spoke begins, -1 after its end.
    n = 3 * HALF_DEGREES + 1
    change = np.bincount(first + HALF_DEGREES, minlength=n) - np.bincount(last + HALF_DEGREES + 1, minlength=n)
    return np.asarray((np.cumsum(change)[:-1].reshape(3, HALF_DEGREES) > 0).any(axis=0))
