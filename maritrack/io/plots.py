"""Plots of a radar's extractor as a table (CSV): rows with time, azimuth and range, grouped into turns.

Columns are found by name and say their unit: `azimuth_rad` or `azimuth_deg`, `range_m`, `range_km` or
`range_nm`, `intensity`, and the covariance of azimuth and range `cov_aa, cov_ar, cov_ra, cov_rr` (that
of the azimuth in its column's unit, ranges in m). The table is read as a whole.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from maritrack.errors import InputError
from maritrack.io.csvtable import Table, find, numbers, read_table, times_s
from maritrack.io.jsontext import MAX_M
from maritrack.io.noise import plot_cov_to_en, usable_cov
from maritrack.io.octets import whole
from maritrack.io.pieces import Piece, frames_by_time
from maritrack.io.plotturns import Turns, group_turns
from maritrack.io.pointscan import Measured, point_sensor, to_points
from maritrack.io.pose import PoseTrack
from maritrack.io.source import Octets
from maritrack.io.times import day_start_ns, seconds_to_ns, unroll_midnight
from maritrack.settings import InputConfig
from maritrack.types import Damage, FloatArray, Frame, IntArray, Origin, Scan, take

AZIMUTH = {"azimuth_rad": 1.0, "azimuth_deg": np.deg2rad(1.0), "bearing_rad": 1.0, "bearing_deg": np.deg2rad(1.0)}
RANGE = {"range_m": 1.0, "range_km": 1000.0, "range_nm": 1852.0}


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Usable plots in order of time."""

    t_ns: IntArray  # (n,)
    azimuth_rad: FloatArray  # (n,)
    range_m: FloatArray  # (n,)
    intensity: FloatArray  # (n,)
    cov: FloatArray | None  # (n, 3) range range m^2, range azimuth m rad, azimuth azimuth rad^2


class PlotSource:
    """The turns of a table of plots as frames; each plot keeps its own time.

    A turn begins at north, counted by the azimuth unwrapped with the antenna's own period. Plots that
    share one time per turn are a scan each time. Turns without plots are empty scans. `pose` is where
    the radar is (None: at the origin). Raises InputError for a table without such columns.
    """

    kind = "plots"

    def __init__(
        self,
        octets: Octets,
        config: InputConfig,
        *,
        pose: PoseTrack | None = None,
        origin: Origin | None = None,
        strict: bool = False,
    ) -> None:
        self.origin = origin
        self.unclaimed: tuple[Damage, ...] = ()
        self._octets, self._config, self._strict = octets, config, strict
        self._pose = pose if pose is not None else PoseTrack.fixed()
        self._data = whole(octets)
        self._rows, self._damage = read_rows(self._data, name=octets.name, date=config.date)
        self._reach_m = float(self._rows.range_m.max(initial=0.0)) or math.inf  # that of the farthest plot

    def frames(self) -> Iterator[Frame]:
        """Frames from 0 on; the first carries the octets."""
        self.unclaimed = yield from frames_by_time(
            self._pieces(), channel=self._octets.channel, name=self._octets.name, window=0, strict=self._strict
        )

    def _pieces(self) -> Iterator[Piece]:
        yield Piece(self._data, damage=self._damage)
        rows = self._rows
        if len(rows.t_ns) == 0:
            return
        turns = group_turns(rows.t_ns, rows.azimuth_rad)
        for i in range(len(turns)):
            mine = take(rows, slice(int(turns.first[i]), int(turns.first[i + 1])))
            yield Piece(scan=self._scan(mine, turns, i))

    def _scan(self, rows: Rows, turns: Turns, i: int) -> Scan:
        start_ns, end_ns = int(turns.start_ns[i]), int(turns.end_ns[i])
        late_ns = round(self._config.latency_s * 1e9)
        middle = np.array([(start_ns + end_ns) // 2 - late_ns])
        cov = None if rows.cov is None else plot_cov_to_en(rows.range_m, rows.azimuth_rad, rows.cov)
        points = to_points(
            Measured(rows.range_m, rows.azimuth_rad, rows.t_ns, rows.intensity, cov),
            sensor_m=self._pose.position(rows.t_ns - late_ns),
            heading_rad=self._pose.heading(rows.t_ns - late_ns),
            config=self._config,
            where=self._octets.name,
            head_up=True,
        )
        sensor = point_sensor(self._config.sensor or "radar", self._config)
        return Scan(
            sensor=replace(sensor, max_range_m=min(sensor.max_range_m, self._reach_m)),
            t_ns=end_ns,
            t_start_ns=start_ns,
            position_m=self._pose.position(middle)[0],
            heading_rad=float(self._pose.heading(middle)[0]),
            points=points,
            segment=int(turns.segment[i]),
        )


def read_rows(data: bytes, *, name: str, date: str) -> tuple[Rows, tuple[Damage, ...]]:
    """The plots of a table by time, and how many rows are none."""
    table = read_table(data, name=name)
    azimuth, range_ = _column(table, "azimuth", tuple(AZIMUTH)), _column(table, "range", tuple(RANGE))
    time_s, of_day = times_s(table)
    azimuth_rad = numbers(table, azimuth) * AZIMUTH[azimuth]
    range_m = numbers(table, range_) * RANGE[range_]
    cov = _cov(table, per_rad=AZIMUTH[azimuth])
    intensity = numbers(table, find(table, ("intensity", "amplitude")))
    good = np.isfinite(time_s) & (np.abs(np.nan_to_num(azimuth_rad, nan=np.inf)) < 1e4)
    good &= (range_m >= 0) & (range_m <= MAX_M)
    if cov is not None:
        good &= usable_cov(cov)
    row = np.flatnonzero(good)
    t_s = unroll_midnight(time_s[row]) if of_day else time_s[row]
    order = np.argsort(t_s, kind="stable")
    row = row[order]
    rows = Rows(
        t_ns=seconds_to_ns(t_s[order]) + (day_start_ns(date, name=name) if of_day else 0),
        azimuth_rad=azimuth_rad[row],
        range_m=range_m[row],
        intensity=np.where(np.isfinite(intensity[row]), intensity[row], 1.0),
        cov=None if cov is None else cov[row],
    )
    bad = table.rows - len(row)
    return rows, (Damage("bad-point", -1, "rows without a time, a place or a covariance", count=bad),) if bad else ()


def _column(table: Table, what: str, names: tuple[str, ...]) -> str:
    """The column of azimuths or ranges, which says its unit."""
    column = find(table, names)
    if column is None and what in table.columns:
        raise InputError(f"{table.name}: column '{what}' has no unit", hint=f"name it {' or '.join(names)}")
    if column is None:
        raise InputError(f"{table.name}: no column of {what}", hint="columns: time_s, azimuth_deg, range_m")
    return column


def _cov(table: Table, *, per_rad: float) -> FloatArray | None:
    """[range range, range azimuth, azimuth azimuth] (n, 3) in m and rad; None without such columns."""
    if not {"cov_aa", "cov_rr"} <= table.columns.keys():
        return None
    cross = find(table, ("cov_ar", "cov_ra"))
    ar = numbers(table, cross) if cross else np.zeros(table.rows)
    aa, rr = numbers(table, "cov_aa"), numbers(table, "cov_rr")
    return np.stack([rr, ar * per_rad, aa * per_rad**2], axis=-1)
