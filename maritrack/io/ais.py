"""AIS reports as a table (CSV): positions of ships in local east-north, own ship apart."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maritrack.errors import InputError
from maritrack.geo import geodetic_to_en, polar_to_en
from maritrack.io.csvtable import Table, find, numbers, read_table, times_s
from maritrack.io.jsontext import clean
from maritrack.io.reference import JUMP_MPS, REST_MPS, Reference, Reports, build_reference
from maritrack.io.times import day_start_ns, join_midnight, seconds_to_ns
from maritrack.types import BoolArray, Damage, FloatArray, IntArray, Origin, take

LAT = ("lat_deg", "latitude_degrees", "latitude_deg", "latitude", "lat")
LON = ("lon_deg", "longitude_degrees", "longitude_deg", "longitude", "lon", "long")
SHIP = ("mmsi", "userid", "user_id", "ship_id", "id")
NAME = ("name", "vesselname", "vessel_name", "shipname", "ship_name")
HEADING = ("heading_deg", "heading", "true_heading", "trueheading", "hdg")
COURSE = ("cog_degrees", "cog_deg", "cog", "course", "course_over_ground")
SPEED = ("sog_knots", "sog_kn", "sog", "speed_over_ground")
SIZE = {"length_m": ("length_m", "length"), "width_m": ("width_m", "width", "beam", "beam_m")}
TO_SIDES = {  # distances of the antenna from the hull's sides, in the order of the message: A, B, C, D
    "bow": ("to_bow_m", "to_bow", "dim_a", "a"), "stern": ("to_stern_m", "to_stern", "dim_b", "b"),
    "port": ("to_port_m", "to_port", "dim_c", "c"), "starboard": ("to_starboard_m", "to_starboard", "dim_d", "d"),
}  # fmt: skip
KNOT_MPS = 1852.0 / 3600.0
EARTH_M = 6_371_000.0


class OwnShip(NamedTuple):
    """Reports of the ship that carries the radar, in order of time."""

    t_ns: IntArray  # (m,) strictly increasing
    lat_deg: FloatArray  # (m,)
    lon_deg: FloatArray  # (m,)
    position_m: FloatArray  # (m, 2) east-north
    heading_rad: FloatArray  # (m,) nan where not reported


@dataclass(frozen=True, slots=True, eq=False)
class AisDocument:
    """What an AIS table says."""

    reference: Reference  # the other ships; complete = False
    own: OwnShip | None
    origin: Origin


def read_ais(
    data: bytes, *, name: str, date: str = "", origin: Origin | None = None, own_ship: str | None = None
) -> AisDocument:
    """Reports of a table with columns of time, latitude and longitude, found by name.

    Own ship is what a column `is_own_ship` marks, or the ship `own_ship`. Without an origin it is the
    first report of own ship, else the first of all. `date` (ISO) is for times of day; a table of those
    that runs past midnight is put together again (up to 12 h). Left out and counted in
    `reference.damage`, one entry a kind: reports without id or time, off the globe, a second one at
    the same time, and single ones that no ship can have sailed to and from (`JUMP_MPS`). Where a ship tells how
    far its antenna is from its sides, positions are those of the middle of its hull; own ship's stay the antenna's.
    """
    table = read_table(data, name=name)
    rows, damage = _clean_rows(table, date=date)
    own_id = _own_id(table, rows, own_ship)
    if origin is None:
        pick = rows.ship == own_id if own_id >= 0 else np.ones(len(rows.ship), dtype=bool)
        first = np.flatnonzero(pick)[np.argmin(rows.t_ns[pick])]
        origin = Origin(float(rows.lat_deg[first]), float(rows.lon_deg[first]))
    position_m = geodetic_to_en(origin, rows.lat_deg, rows.lon_deg)
    heading_rad = np.deg2rad(_heading_deg(numbers(table, find(table, HEADING))))[rows.row]
    mine = rows.ship == own_id
    own = OwnShip(
        rows.t_ns[mine], rows.lat_deg[mine], rows.lon_deg[mine], position_m[mine], heading_rad[mine]
    )  # fmt: skip
    velocity_mps, sides_m = _velocity_mps(table)[rows.row], _sides_m(table, rows)
    middle_m = position_m + _to_middle(sides_m[rows.ship], heading_rad, velocity_mps)
    others = Reports(rows.ship, rows.t_ns, middle_m, velocity_mps, heading_rad)
    reference = _reference(table, rows, take(others, ~mine), own_id=own_id, sides_m=sides_m, damage=damage)
    return AisDocument(reference, own if own_id >= 0 else None, origin)


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Usable reports, ordered by ship and time, no time twice."""

    ids: tuple[str, ...]  # of all ships with such reports
    ship: IntArray  # (m,) index into ids
    t_ns: IntArray  # (m,)
    lat_deg: FloatArray  # (m,)
    lon_deg: FloatArray  # (m,)
    row: IntArray  # (m,) of the table


def _clean_rows(table: Table, *, date: str) -> tuple[_Rows, tuple[Damage, ...]]:
    lat, lon = find(table, LAT), find(table, LON)
    if lat is None or lon is None:
        raise InputError(f"{table.name}: no columns of latitude and longitude")
    time_s, of_day = times_s(table)
    lat_deg, lon_deg, label = numbers(table, lat), numbers(table, lon), _labels(table)
    told = np.isfinite(time_s) & (label != "")
    placed = _on_globe(lat_deg, lon_deg)
    row = np.flatnonzero(told & placed)
    if len(row) == 0:
        raise InputError(f"{table.name}: no report with a time and a position")
    t_s = join_midnight(time_s[row]) if of_day else time_s[row]
    t_ns = seconds_to_ns(t_s) + (day_start_ns(date, name=table.name) if of_day else 0)
    ids, ship = np.unique(label[row], return_inverse=True)
    order = np.lexsort((t_ns, ship))
    again = np.zeros(len(order), dtype=bool)
    again[1:] = (np.diff(ship[order]) == 0) & (np.diff(t_ns[order]) == 0)
    order = order[~again]
    jump = _jumps(ship[order], t_ns[order] / 1e9, lat_deg[row[order]], lon_deg[row[order]])
    order = order[~jump]
    row = row[order]
    counts = {
        "bad-report": (int(np.sum(~told)), "without a time or an id"),
        "bad-position": (int(np.sum(told & ~placed)), "off the globe"),
        "duplicate-time": (int(np.sum(again)), "at a time their ship has reported already"),
        "position-jump": (int(np.sum(jump)), f"away from the way of their ship (over {JUMP_MPS:g} m/s)"),
    }
    damage = tuple(Damage(code, -1, f"AIS reports {what}", count=n) for code, (n, what) in counts.items() if n)
    return _Rows(tuple(ids.tolist()), ship[order], t_ns[order], lat_deg[row], lon_deg[row], row), damage


def _labels(table: Table) -> NDArray[np.str_]:
    column = find(table, SHIP)
    if column is None:
        return np.full(table.rows, "ship")
    return np.array([clean(cell).removesuffix(".0") for cell in table.columns[column]], dtype=np.str_)


def _on_globe(lat_deg: FloatArray, lon_deg: FloatArray) -> BoolArray:
    """False for what is no place: 91/181 and 0/0, which mean unknown, and all else off the globe."""
    null = (np.abs(lat_deg) < 1e-9) & (np.abs(lon_deg) < 1e-9)
    return np.asarray((np.abs(lat_deg) <= 90) & (np.abs(lon_deg) <= 180) & ~null)


def _jumps(ship: IntArray, t_s: FloatArray, lat_deg: FloatArray, lon_deg: FloatArray) -> BoolArray:
    """Which reports (ordered by ship and time) lie alone, far from those before and after.

    The first and the last of a ship are judged by the two next to them.
    """
    index, last = np.arange(len(ship)), len(ship) - 1

    def apart(i: IntArray, j: IntArray) -> tuple[BoolArray, BoolArray]:
        """Whether both are reports of one ship, and whether it can't have sailed from one to the other."""
        inside = (i >= 0) & (j <= last)
        i, j = np.clip(i, 0, last), np.clip(j, 0, last)
        same = inside & (ship[i] == ship[j])
        far = _distance_m(lat_deg[i], lon_deg[i], lat_deg[j], lon_deg[j])
        return same, same & (far > JUMP_MPS * np.maximum(t_s[j] - t_s[i], 1.0))  # times may be whole seconds

    (has_before, before), (has_after, after) = apart(index - 1, index), apart(index, index + 1)
    (_, across), (more_after, after2), (more_before, before2) = (
        apart(index - 1, index + 1), apart(index, index + 2), apart(index - 2, index)
    )  # fmt: skip
    inner = before & after & ~across
    first = ~has_before & after & more_after & after2 & ~np.append(after[1:], False)
    last_one = ~has_after & before & more_before & before2 & ~np.append(False, before[:-1])
    return np.asarray(inner | first | last_one)


def _distance_m(lat1: FloatArray, lon1: FloatArray, lat2: FloatArray, lon2: FloatArray) -> FloatArray:
    """Great-circle distances of positions in degrees, on a sphere."""
    a, b = np.deg2rad(lat1), np.deg2rad(lat2)
    h = np.sin((b - a) / 2) ** 2 + np.cos(a) * np.cos(b) * np.sin(np.deg2rad(lon2 - lon1) / 2) ** 2
    return np.asarray(2 * EARTH_M * np.arcsin(np.sqrt(np.clip(h, 0.0, 1.0))))


def _own_id(table: Table, rows: _Rows, own_ship: str | None) -> int:
    """Index of own ship, -1 where there is none. InputError where the one asked for is not there."""
    if own_ship:
        if own_ship not in rows.ids:
            raise InputError(f"{table.name}: no report of own ship '{own_ship}'")
        return rows.ids.index(own_ship)
    if "is_own_ship" not in table.columns:
        return -1
    mark = np.array([cell.strip().lower() in ("1", "1.0", "true", "yes") for cell in table.columns["is_own_ship"]])
    marked = np.unique(rows.ship[mark[rows.row]])
    if len(marked) > 1:
        raise InputError(f"{table.name}: several ships are marked as own ship", hint="say which one")
    return int(marked[0]) if len(marked) else -1


def _heading_deg(value: FloatArray) -> FloatArray:
    """Headings and courses in [0, 360); 511, and 360 for a course, say that they are unknown."""
    return np.where((value >= 0) & (value < 360), value, np.nan)


def _velocity_mps(table: Table) -> FloatArray:
    """East-north (n, 2) of course and speed over ground."""
    course = np.deg2rad(_heading_deg(numbers(table, find(table, COURSE))))
    speed = numbers(table, find(table, SPEED))
    speed_mps = np.where((speed >= 0) & (speed < 102.3), speed * KNOT_MPS, np.nan)  # 102.3 kn: unknown
    return polar_to_en(speed_mps, course)


def _sides_m(table: Table, rows: _Rows) -> FloatArray:
    """Distances (n, 4) of each ship's antenna to bow, stern, port and starboard; nan where not all are told."""
    told = [_last_numbers(rows, numbers(table, find(table, names))) for names in TO_SIDES.values()]
    sides_m = np.stack(told, axis=1)
    whole = (sides_m >= 0).all(axis=1) & (sides_m[:, :2].sum(axis=1) > 0) & (sides_m[:, 2:].sum(axis=1) > 0)
    return np.where(whole[:, None], sides_m, np.nan)


def _to_middle(sides_m: FloatArray, heading_rad: FloatArray, velocity_mps: FloatArray) -> FloatArray:
    """From the antenna to the middle of the hull (m, 2) east-north, for reports with the sides (m, 4) of their ship.

    Under way the course stands for a heading that is not reported; 0 where nothing tells it.
    """
    course_rad = np.arctan2(velocity_mps[:, 0], velocity_mps[:, 1])
    under_way = np.hypot(velocity_mps[:, 0], velocity_mps[:, 1]) > REST_MPS
    heading_rad = np.where(np.isnan(heading_rad) & under_way, course_rad, heading_rad)
    ahead_m, starboard_m = (sides_m[:, 0] - sides_m[:, 1]) / 2, (sides_m[:, 3] - sides_m[:, 2]) / 2
    step_m = polar_to_en(ahead_m, heading_rad) + polar_to_en(starboard_m, heading_rad + np.pi / 2)
    unplaced = (sides_m[:, :1] == 0) & (sides_m[:, 2:3] == 0)  # A = C = 0: the size is told, the antenna's place is not
    return np.asarray(np.where(np.isnan(step_m) | unplaced, 0.0, step_m))


def _last_numbers(rows: _Rows, value: FloatArray) -> FloatArray:
    """The last number that each ship reports (n,), nan where none does."""
    told = np.isfinite(value[rows.row])
    result = np.full(len(rows.ids), np.nan)
    result[rows.ship[told]] = value[rows.row][told]  # rows are in order of time: the last one written stays
    return result


def _reference(
    table: Table, rows: _Rows, reports: Reports, *, own_id: int, sides_m: FloatArray, damage: tuple[Damage, ...]
) -> Reference:
    """The ships but own ship."""
    others = [i for i in range(len(rows.ids)) if i != own_id]
    renumber = np.searchsorted(others, np.arange(len(rows.ids)))
    size = {key: _per_ship(rows, numbers(table, find(table, names))) for key, names in SIZE.items()}
    for key, a in (("length_m", 0), ("width_m", 2)):
        size[key] = np.where(np.isnan(size[key]), sides_m[:, a] + sides_m[:, a + 1], size[key])
    names = _names(table, rows)
    return build_reference(
        replace(reports, ship=renumber[reports.ship]),
        ids=[rows.ids[i] for i in others],
        names=[names[i] for i in others],
        length_m=size["length_m"][others],
        width_m=size["width_m"][others],
        complete=False,
        damage=damage,
    )


def _per_ship(rows: _Rows, value: FloatArray) -> FloatArray:
    """The first positive value that each ship reports, nan where none does."""
    told = value[rows.row] > 0
    result = np.full(len(rows.ids), np.nan)
    ship, first = np.unique(rows.ship[told], return_index=True)
    result[ship] = value[rows.row][told][first]
    return result


def _names(table: Table, rows: _Rows) -> list[str]:
    """The first name that each ship reports, "" where none does."""
    column = find(table, NAME)
    if column is None:
        return [""] * len(rows.ids)
    name = np.array([clean(cell) for cell in table.columns[column]], dtype=np.str_)[rows.row]
    ship, first = np.unique(rows.ship[name != ""], return_index=True)
    told = dict(zip(ship.tolist(), name[name != ""][first].tolist(), strict=True))
    return [told.get(i, "") for i in range(len(rows.ids))]
