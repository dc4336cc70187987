"""The Autoferry sensor fusion benchmark: radar or lidar points of a small ferry, GNSS truth of two boats.

Helgesen, Vasstein, Brekke, Stahl: Heterogeneous multi-sensor tracking for an autonomous surface vehicle
in a littoral environment. Ocean Engineering, 2022. Read are its detections and ground truth as JSON,
and the .mat files (MATLAB 5) that hold both. The JSON is MATLAB's: no point is `[]`, one is `[n, e]`, more
are `[[n1, n2, ...], [e1, e2, ...]]`. Positions are north, east; points relative to own ship, the rest
relative to the Piren origin. Sensors are interleaved, and their times step back by parts of a second.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from maritrack.errors import ConfigError, InputError
from maritrack.io.jsontext import MAX_M, clean, list_of, naming, number_of, parse_json, table_of
from maritrack.io.matfile import read_mat
from maritrack.io.octets import whole
from maritrack.io.pieces import Piece, frames_by_time
from maritrack.io.pointscan import instant, measured_at, point_sensor, to_points
from maritrack.io.reference import Reference, Reports, build_reference
from maritrack.io.source import Octets
from maritrack.io.times import MAX_S, seconds_to_ns
from maritrack.settings import InputConfig
from maritrack.types import Damage, FloatArray, Frame, Origin

ORIGIN = Origin(63.4389029083, 10.39908278)  # Piren
SENSORS = {"lidar": 1, "radar": 2}
MAT5 = b"MATLAB 5.0 MAT-file"
PARTS = ("detectionList", "groundTruth")  # the variables of a .mat file


class AutoferrySource:
    """The scans of the radar, the lidar or both ("radar+lidar") by `config.sensor`, as frames in order of time.

    `sensors` has settings of one of them by its name, in place of `config`. `reference` is the truth inside of a .mat
    file; of JSON it lies in a file beside. Raises InputError for what is not such a file, ConfigError for a sensor
    that it can't have.
    """

    kind = "autoferry"
    origin: Origin | None = ORIGIN

    def __init__(
        self,
        octets: Octets,
        config: InputConfig,
        *,
        sensors: Mapping[str, InputConfig] | None = None,
        strict: bool = False,
    ) -> None:
        wanted = (config.sensor or "radar").split("+")
        if not set(wanted) <= set(SENSORS):
            hint = "input.sensor = radar, lidar or radar+lidar"
            raise ConfigError(f"input.sensor = '{config.sensor}': Autoferry has radar and lidar", hint)
        told = {name: (sensors or {}).get(name, config) for name in wanted}
        self.unclaimed: tuple[Damage, ...] = ()
        self._octets, self._strict = octets, strict
        data = whole(octets)
        with naming(octets.name):
            detections, truth = _document(data)
            if detections is None:
                raise InputError("ground truth alone, no detections")
            self._pieces = list(_pieces(detections, data, sensors=told))
            self.reference = None if truth is None else _reference(truth)

    def frames(self) -> Iterator[Frame]:
        """Frames from 0 on; the first carries the octets."""
        self.unclaimed = yield from frames_by_time(
            self._pieces, channel=self._octets.channel, name=self._octets.name, window=0, strict=self._strict
        )


def autoferry_truth(data: bytes, *, name: str) -> Reference:
    """The boats of a ground truth file or a .mat file, in the Piren plane: complete, ids as in the file."""
    with naming(name):
        truth = _document(data)[1]
        if truth is None:
            raise InputError("detections alone, no ground truth")
        return _reference(truth)


def holds_autoferry(data: bytes) -> bool:
    """Whether a MATLAB file has the variables of this data set, or can't be read at all."""
    try:
        return not read_mat(data).keys().isdisjoint(PARTS)
    except InputError:
        return True


def _document(data: bytes) -> tuple[Sequence[Any] | None, Sequence[Any] | None]:
    """Detections and ground truth, None for what the file does not hold."""
    if data.startswith(MAT5):
        return _mat(data)
    rows = list_of(parse_json(data), where="document")
    sample: Any = next((row for row in rows if row), None)
    is_scan = isinstance(sample, dict) and "sensorID" in sample
    return (rows, None) if is_scan else (None, rows)


def _mat(data: bytes) -> tuple[Sequence[Any] | None, Sequence[Any] | None]:
    content = read_mat(data)
    found = [content.get(name) for name in PARTS]
    if all(rows is None for rows in found):
        held = ", ".join(sorted(content))[:200] or "nothing"
        raise InputError(f"a MATLAB file of neither detectionList, groundTruth nor AIS (lat, lon): it holds {held}")
    detections, truth = (None if rows is None else list_of(rows, where="document") for rows in found)
    return detections, truth


def _pieces(detections: Sequence[Any], data: bytes, *, sensors: Mapping[str, InputConfig]) -> Iterator[Piece]:
    """The scans of these sensors, each with its settings, by time; a record of another sensor is none."""
    tables = [(table_of(row, where=f"detections[{i}]"), f"detections[{i}]") for i, row in enumerate(detections)]
    name_of = {SENSORS[name]: name for name in sensors}
    pieces = []
    for table, where in tables:
        number = table.get("sensorID")
        if type(number) in (int, float) and number in name_of:
            name = name_of[int(number)]
            pieces.append(_piece(table, where=where, sensor=name, config=sensors[name]))
    pieces.sort(key=lambda piece: 0 if piece.scan is None else piece.scan.t_ns)
    yield Piece(data)
    yield from pieces


def _piece(table: Mapping[str, Any], *, where: str, sensor: str, config: InputConfig) -> Piece:
    time_s = number_of(table, "time", where=where, limit=MAX_S)
    t_ns = int(seconds_to_ns(np.array(time_s)))
    own = _numbers(table.get("ownshipPosition"), where=f"{where}: ownshipPosition")
    if own.shape != (2,) or not _near(own):
        raise InputError(f"{where}: ownshipPosition is [north, east]")
    position_m = own[::-1].copy()
    offset = _offsets(table.get("measurement"), where=f"{where}: measurement")
    good = np.abs(np.nan_to_num(offset, nan=np.inf)).max(axis=1, initial=0.0) <= MAX_M
    measured = measured_at(position_m + offset[good], sensor_m=position_m, t_ns=t_ns)
    points = to_points(
        measured, sensor_m=position_m, heading_rad=float("nan"), config=config, where=where, head_up=False
    )
    scan = instant(point_sensor(sensor, config), points, t_ns=t_ns, sensor_m=position_m, heading_rad=float("nan"))
    bad = int(np.sum(~good))
    lost = Damage("bad-point", -1, f"{where}: points of {len(good)} that are no places", sensor, count=bad)
    return Piece(scan=scan, damage=(lost,) if bad else ())


def _offsets(value: Any, *, where: str) -> FloatArray:
    """Points relative to own ship, east-north (n, 2)."""
    array = _numbers(value, where=where)
    if array.size == 0:
        return np.empty((0, 2))
    north_east = array.reshape(2, -1) if array.shape == (2,) else array
    if north_east.ndim != 2 or len(north_east) != 2:
        raise InputError(f"{where}: two rows, north and east, were expected")
    return np.ascontiguousarray(north_east[::-1].T)


def _numbers(value: Any, *, where: str) -> FloatArray:
    try:
        array = np.asarray(value)
        array = array.astype(np.float64) if array.dtype == object else array  # null becomes nan
    except (TypeError, ValueError, OverflowError):
        array = np.asarray("")
    if array.dtype.kind not in "iuf":
        raise InputError(f"{where}: numbers were expected")
    return np.asarray(array, dtype=np.float64)


def _reference(truth: Sequence[Any]) -> Reference:
    """All positions of all targets; those that are repeated from element to element count once."""
    ids: dict[str, int] = {}
    ship, time_s, position = [], [], []
    for i, element in enumerate(truth):
        for record in element if isinstance(element, list) else [element]:
            where = f"groundTruth[{i}]"
            table = table_of(record, where=where)
            if type(table.get("targetID")) not in (str, int):
                raise InputError(f"{where}: 'targetID' is missing")
            place = _numbers(table.get("position"), where=f"{where}: position")
            if place.shape not in ((2,), (3,)) or not _near(place):
                raise InputError(f"{where}: position is [north, east, down]")
            ship.append(ids.setdefault(clean(table["targetID"]), len(ids)))
            time_s.append(number_of(table, "time", where=where, limit=MAX_S))
            position.append((place[1], place[0]))
    n, unknown = len(ship), np.full(len(ids), np.nan)
    return build_reference(
        Reports(
            ship=np.array(ship, dtype=np.int64),
            t_ns=seconds_to_ns(np.array(time_s, dtype=np.float64)),
            position_m=np.array(position, dtype=np.float64).reshape(-1, 2),
            velocity_mps=np.full((n, 2), np.nan),
            heading_rad=np.full(n, np.nan),
        ),
        ids=list(ids),
        names=[""] * len(ids),
        length_m=unknown,
        width_m=unknown,
        complete=True,
    )


def _near(position: FloatArray) -> bool:
    return bool(np.all(np.abs(np.nan_to_num(position, nan=np.inf)) <= MAX_M))
