"""AIS reports as columns, whatever document they come from: each row tells a position or a ship's particulars."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from maritrack.errors import InputError
from maritrack.io.csvtable import Table, find, numbers, times_s
from maritrack.io.jsontext import clean
from maritrack.io.times import day_start_ns, join_midnight, seconds_to_ns
from maritrack.types import BoolArray, FloatArray, IntArray, check_lengths

LAT = ("lat_deg", "latitude_degrees", "latitude_deg", "latitude", "lat")
LON = ("lon_deg", "longitude_degrees", "longitude_deg", "longitude", "lon", "long")
SHIP = ("mmsi", "userid", "user_id", "ship_id", "id")
NAME = ("name", "vesselname", "vessel_name", "shipname", "ship_name")
HEADING = ("heading_deg", "heading", "true_heading", "trueheading", "hdg")
COURSE = ("cog_degrees", "cog_deg", "cog", "course", "course_over_ground")
SPEED = ("sog_knots", "sog_kn", "sog", "speed_over_ground", "speed")
LENGTH, WIDTH = ("length_m", "length"), ("width_m", "width", "beam", "beam_m")
TO_SIDES = (  # distances of the antenna from the hull's sides, in the order of the message: A, B, C, D
    ("to_bow_m", "to_bow", "dim_a", "a"), ("to_stern_m", "to_stern", "dim_b", "b"),
    ("to_port_m", "to_port", "dim_c", "c"), ("to_starboard_m", "to_starboard", "dim_d", "d"),
)  # fmt: skip
STATION = ("type_of_mobile", "station_type")
NO_SHIPS = ("base station", "sar airborne")  # what a column of stations calls what is not on the water
VESSEL, OTHER = 0, 1  # what reports: a ship or an aid to navigation that is there; what a radar can't see as one


@dataclass(frozen=True, slots=True, eq=False)
class AisRows:
    """Reports in the order of their document. Leading axis: report; nan where something is not told."""

    label: NDArray[np.str_]  # (n,) MMSI or another id, "" where unknown
    t_ns: IntArray  # (n,)
    timed: BoolArray  # (n,) its time is known
    lat_deg: FloatArray  # (n,) as told, also off the globe
    lon_deg: FloatArray  # (n,)
    heading_deg: FloatArray  # (n,) as told, also 511
    course_deg: FloatArray  # (n,)
    speed_kn: FloatArray  # (n,)
    second: FloatArray  # (n,) of the minute in which the position was taken
    name: NDArray[np.str_]  # (n,) "" where not told
    length_m: FloatArray  # (n,)
    width_m: FloatArray  # (n,)
    sides_m: FloatArray  # (n, 4) from the antenna to bow, stern, port and starboard
    static: BoolArray  # (n,) no position is meant: particulars alone
    kind: IntArray  # (n,) VESSEL or OTHER
    own: BoolArray  # (n,) the ship that received the others

    def __post_init__(self) -> None:
        check_lengths(self, len(self.label), *(f.name for f in fields(self)))

    def __len__(self) -> int:
        return len(self.label)


def rows_of_table(table: Table, *, date: str = "") -> AisRows:
    """The reports of a table whose columns are found by name. Times of day are of the day `date` (ISO)."""
    lat, lon = find(table, LAT), find(table, LON)
    if lat is None or lon is None:
        raise InputError(f"{table.name}: no columns of latitude and longitude")
    time_s, of_day = times_s(table)
    timed = np.isfinite(time_s)
    t_ns = np.zeros(table.rows, np.int64)
    t_s = join_midnight(time_s[timed]) if of_day else time_s[timed]
    t_ns[timed] = seconds_to_ns(t_s) + (day_start_ns(date, name=table.name) if of_day else 0)
    sides_m = np.stack([numbers(table, find(table, names)) for names in TO_SIDES], axis=1)
    name, length_m, width_m = _names(table), numbers(table, find(table, LENGTH)), numbers(table, find(table, WIDTH))
    places = zip(table.columns[lat], table.columns[lon], strict=True)
    no_place = np.array([not (a.strip() or b.strip()) for a, b in places], bool)
    told = (name != "") | (length_m > 0) | (width_m > 0) | (sides_m > 0).any(axis=1)
    return AisRows(
        label=_labels(table), t_ns=t_ns, timed=timed, lat_deg=numbers(table, lat), lon_deg=numbers(table, lon),
        heading_deg=numbers(table, find(table, HEADING)), course_deg=numbers(table, find(table, COURSE)),
        speed_kn=numbers(table, find(table, SPEED)), second=np.full(table.rows, np.nan), name=name, length_m=length_m,
        width_m=width_m, sides_m=sides_m, static=no_place & told, kind=_kinds(table), own=_own(table),
    )  # fmt: skip


def _labels(table: Table) -> NDArray[np.str_]:
    column = find(table, SHIP)
    if column is None:
        return np.full(table.rows, "ship")
    return np.array([clean(cell).removesuffix(".0") for cell in table.columns[column]], dtype=np.str_)


def _names(table: Table) -> NDArray[np.str_]:
    column = find(table, NAME)
    if column is None:
        return np.full(table.rows, "", dtype=np.str_)
    told = [clean(cell) for cell in table.columns[column]]
    return np.array(["" if name.lower() == "unknown" else name for name in told], dtype=np.str_)


def _kinds(table: Table) -> IntArray:
    column = find(table, STATION)
    if column is None:
        return np.full(table.rows, VESSEL)
    other = [cell.strip().lower() in NO_SHIPS for cell in table.columns[column]]
    return np.where(np.array(other, bool), OTHER, VESSEL)


def _own(table: Table) -> BoolArray:
    if "is_own_ship" not in table.columns:
        return np.zeros(table.rows, bool)
    return np.array(
        [cell.strip().lower() in ("1", "1.0", "true", "yes") for cell in table.columns["is_own_ship"]], bool
    )
