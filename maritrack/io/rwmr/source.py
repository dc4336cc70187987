"""A folder laid out like DLR's data set as a source of frames: its points by step, its AIS positions as truth.

Frames come from polarMeas.json and cartesianMeas.json; where both agree they tell own ship's place and the turn of its
bearings. Everything guessed is in `remarks`, with the setting that overrides it. Images: name radarImages itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from maritrack.errors import InputError
from maritrack.geo import en_to_polar
from maritrack.io.images.pack import MOST_OCTETS, ChunkFile
from maritrack.io.images.source import members
from maritrack.io.jsontext import naming
from maritrack.io.octets import whole
from maritrack.io.pieces import Piece, frames_by_time
from maritrack.io.pointscan import Measured, instant, measured_at, point_sensor, to_points
from maritrack.io.pose import PoseTrack
from maritrack.io.reference import Reference
from maritrack.io.rwmr.entries import Step, Told, read_steps
from maritrack.io.rwmr.placing import Placed, from_north, place
from maritrack.io.rwmr.truth import read_truth
from maritrack.io.source import Octets
from maritrack.io.times import MAX_S, day_start_ns
from maritrack.rwmrsettings import RwmrConfig
from maritrack.settings import InputConfig
from maritrack.types import Damage, Frame, Origin, Scan

POLAR, CARTESIAN, REFERENCE = "polarmeas.json", "cartesianmeas.json", "referencemeas.mat"


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """The steps to be read, and what is known of own ship at each."""

    steps: list[Step]
    polar: bool  # rows are range and bearing, else east and north
    placed: Placed


class RwmrSource:
    """The steps of a folder as frames. `pose` is own ship's from elsewhere: it goes before what the files tell.

    `reference` is the truth in referenceMeas.mat, `remarks` what was guessed. Raises InputError where neither document
    of points can be read.
    """

    kind = "rwmr"

    def __init__(
        self, octets: Octets, config: InputConfig, rwmr: RwmrConfig, *, pose: PoseTrack | None = None,
        origin: Origin | None = None, strict: bool = False,
    ) -> None:  # fmt: skip
        self.origin = origin
        self.unclaimed: tuple[Damage, ...] = ()
        self._octets, self._config, self._rwmr, self._strict = octets, config, rwmr, strict
        self._pose, self._start_ns = pose, day_start_ns(config.date, name=octets.name)
        self._said: list[Damage] = []
        self._wrong: list[Damage] = []
        self._data = whole(octets)
        with naming(octets.name):
            files = self._files()
            self._table = self._steps(files)
            self.reference: Reference | None = self._truth(files)
        self.remarks = tuple(self._said)
        every = [step.rows for step in self._table.steps if len(step.rows)]
        ranges = [rows[:, 0] if self._table.polar else en_to_polar(rows)[0] for rows in every]
        self._reach_m = max((float(one.max()) for one in ranges), default=math.inf)  # that of the farthest point

    def frames(self) -> Iterator[Frame]:
        """Frames from 0 on; the first carries the octets."""
        self.unclaimed = yield from frames_by_time(
            self._pieces(), channel=self._octets.channel, name=self._octets.name, window=0, strict=self._strict
        )

    def _pieces(self) -> Iterator[Piece]:
        yield Piece(self._data, damage=tuple(self._wrong))
        for k, step in enumerate(self._table.steps):
            if step.number / self._rwmr.rate_hz < MAX_S:
                yield Piece(scan=self._scan(k, step))

    def _guess(self, about: str, text: str) -> None:
        self._said.append(Damage(f"rwmr-{about}", -1, text))

    def _files(self) -> dict[str, bytes]:
        found: dict[str, bytes] = {}
        for name, data, reason in members(ChunkFile(iter([self._data]))):
            if not name or reason:
                self._wrong.append(Damage("rwmr-file", -1, f"{name}: {reason}, at most {MOST_OCTETS} octets are read"))
            else:
                found.setdefault(name.lower().rpartition("/")[2], data)
        return found

    def _steps(self, files: dict[str, bytes]) -> _Table:
        read = {name: self._read(name, files[name]) for name in (POLAR, CARTESIAN) if name in files}
        polar, cartesian = read.get(POLAR), read.get(CARTESIAN)
        if self._rwmr.points == "cartesian" or polar is None:
            if cartesian is None:
                why = "; ".join(item.message for item in self._wrong) or "neither is there"
                raise InputError(f"neither polarMeas.json nor cartesianMeas.json can be read: {why}")
            self._guess("own-ship", "own ship's place is not told: ranges and bearings are from east = north = 0")
            return _Table(self._swapped(cartesian), False, _nowhere(len(cartesian)))
        rows = self._columns(polar)
        if self._rwmr.points == "polar" or cartesian is None:
            if self._pose is None:
                self._guess("own-ship", "own ship's place is not told: it stays at east = north = 0 (--own-ship)")
            return _Table(rows, True, _nowhere(len(rows)))
        other = {step.number: step.rows for step in self._swapped(cartesian)}
        placed = place([step.rows for step in rows], [other.get(step.number) for step in rows])
        known = int(np.isfinite(placed.turn_rad).sum())
        if not known:
            self._guess("own-ship", "polar and Cartesian points do not agree at any step: own ship stays at 0, 0")
        else:
            how = "from north" if from_north(placed.turn_rad) else "turned by own heading"
            text = f"own ship's place is what moves polar points onto Cartesian ones ({known} of {len(rows)} steps)"
            self._guess("own-ship", f"{text}; bearings are {how}")
        return _Table(rows, True, _filled(placed, [step.number for step in rows]))

    def _read(self, name: str, data: bytes) -> list[Step] | None:
        try:
            steps, told = read_steps(data)
        except InputError as error:
            self._wrong.append(Damage("rwmr-file", -1, f"{name}: {error}"))
            return None
        self._tell(name, told)
        return steps

    def _tell(self, name: str, told: Told) -> None:
        for form, count in told.forms.items():
            self._guess("form", f"{name}: {form} ({count} x)")
        if told.left_out:
            self._wrong.append(Damage("bad-point", -1, f"{name}: steps or points that are none", count=told.left_out))

    def _swapped(self, steps: list[Step]) -> list[Step]:
        return steps if self._rwmr.axes == "east-north" else [replace(s, rows=s.rows[:, ::-1]) for s in steps]

    def _columns(self, steps: list[Step]) -> list[Step]:
        """Range in metres and bearing in radians, whatever the document has."""
        every = np.concatenate([step.rows for step in steps]) if steps else np.zeros((0, 2))
        most = np.abs(every).max(axis=0, initial=0.0)
        swap = self._rwmr.columns == "bearing-range"
        if self._rwmr.columns == "auto" and most[0] <= 2 * math.pi + 0.01 < 360.01 < most[1]:
            swap = True
            self._guess("columns", "bearings come before ranges: rwmr.columns = range-bearing overrides")
        bearing = most[0] if swap else most[1]
        degrees = self._rwmr.angles == "deg"
        if self._rwmr.angles == "auto" and bearing > 2 * math.pi + 0.01:
            degrees = True
            self._guess("angles", f"bearings up to {bearing:.0f} are degrees: rwmr.angles = rad overrides")
        found, lost = [], 0
        for step in steps:
            rows = step.rows[:, ::-1] if swap else step.rows
            usable = rows[:, 0] >= 0
            lost += int((~usable).sum())
            turned = np.deg2rad(rows[usable, 1]) if degrees else rows[usable, 1]
            found.append(replace(step, rows=np.stack([rows[usable, 0], turned], axis=-1)))
        if lost:
            self._wrong.append(Damage("bad-point", -1, "points with a negative range", count=lost))
        return found

    def _truth(self, files: dict[str, bytes]) -> Reference | None:
        if REFERENCE not in files or self._rwmr.reference == "none":
            return None
        last = self._table.steps[-1].number if self._table.steps else 0
        try:
            found, said = read_truth(files[REFERENCE], self._rwmr, steps=last, start_ns=self._start_ns)
        except InputError as error:
            if self._rwmr.reference_map:
                raise
            hint = f" ({error.hint})" if error.hint else ""
            self._guess("reference", f"referenceMeas.mat is no truth: {error}{hint}")
            return None
        for text in said:
            self._guess("reference", text)
        return found

    def _scan(self, k: int, step: Step) -> Scan:
        config = self._config
        t_ns = self._start_ns + round(step.number / self._rwmr.rate_hz * 1e9)
        then = np.array([t_ns - round(config.latency_s * 1e9)])
        where, turn = self._table.placed.position_m[k], float(self._table.placed.turn_rad[k])
        sensor_m = self._pose.position(then)[0] if self._pose is not None else np.nan_to_num(where)
        heading = float(self._pose.heading(then)[0]) if self._pose is not None else math.nan
        at = self._rwmr.heading_at
        if 0 <= at < len(step.header):
            degrees = self._rwmr.angles == "deg" or abs(step.header[at]) > 2 * math.pi + 0.01
            heading = math.radians(step.header[at]) if degrees else step.header[at]
        if self._table.polar:
            n = len(step.rows)
            turned = 0.0 if math.isnan(turn) or config.stabilised == "head" else turn
            times, ones = np.full(n, t_ns, np.int64), np.ones(n)
            measured = Measured(step.rows[:, 0], step.rows[:, 1] + turned, times, ones)
        else:
            measured = measured_at(step.rows, sensor_m=sensor_m, t_ns=t_ns)
        points = to_points(
            measured, sensor_m=sensor_m, heading_rad=heading, config=config, where=self._octets.name,
            head_up=self._table.polar and len(step.rows) > 0,
        )  # fmt: skip
        sensor = point_sensor(config.sensor or "radar", config)
        return instant(
            replace(sensor, max_range_m=min(sensor.max_range_m, self._reach_m)), points, t_ns=t_ns, sensor_m=sensor_m,
            heading_rad=heading,
        )  # fmt: skip


def _nowhere(n: int) -> Placed:
    return Placed(np.full((n, 2), np.nan), np.full(n, np.nan))


def _filled(placed: Placed, numbers: list[int]) -> Placed:
    """Own ship at every step, in between in a straight line, as far as it is known at any."""
    known = np.isfinite(placed.turn_rad)
    if not known.any():
        return placed
    at = np.array(numbers, np.float64)
    east, north = (np.interp(at, at[known], placed.position_m[known, i]) for i in (0, 1))
    turn = np.interp(at, at[known], np.unwrap(placed.turn_rad[known]))
    return Placed(np.stack([east, north], axis=-1), turn)
