"""AIS reports (sentences, tables, MATLAB files): positions of ships in local east-north, own ship apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from maritrack.errors import InputError
from maritrack.geo import geodetic_to_en, polar_to_en
from maritrack.io import AIS
from maritrack.io.aismat import MAT5, table_of_mat
from maritrack.io.aisrows import VESSEL, AisRows, rows_of_table
from maritrack.io.csvtable import read_table
from maritrack.io.octets import HEAD
from maritrack.io.reference import JUMP_MPS, REST_MPS, Reference, Reports, build_reference
from maritrack.types import BoolArray, Damage, FloatArray, IntArray, Origin, take

REPEAT_S = 59  # a fix is told again within this, by a receiver that is late or a station that repeats
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
class Implausible:
    """Reports that were left out because no ship can have been there. Leading axis: report."""

    id: tuple[str, ...]
    t_ns: IntArray  # (j,)
    position_m: FloatArray  # (j, 2)


def none_implausible() -> Implausible:
    """No report."""
    return Implausible((), np.zeros(0, np.int64), np.zeros((0, 2)))


@dataclass(frozen=True, slots=True, eq=False)
class AisDocument:
    """What AIS says."""

    reference: Reference  # the other ships; complete = False
    own: OwnShip | None
    origin: Origin
    implausible: Implausible


def is_sentences(data: bytes) -> bool:
    """Whether a document is of AIS sentences (NMEA 0183), and no table."""
    return AIS.search(data[:HEAD]) is not None


def ais_rows(data: bytes, *, name: str, date: str = "") -> tuple[AisRows, tuple[Damage, ...]]:
    """The reports of a document as they are told: AIS sentences, a MATLAB file or a table, by its content."""
    if data.startswith(MAT5):
        return rows_of_table(table_of_mat(data, name=name), date=date), ()
    if not is_sentences(data):
        return rows_of_table(read_table(data, name=name), date=date), ()
    from maritrack.io.aivdm import read_sentences  # not at the top: pyais costs time that `--help` need not pay

    found = read_sentences(data)
    if len(found.rows) and not found.rows.timed.any():
        raise InputError(
            f"{name}: AIS sentences that tell no times",
            hint="wanted: a tag block with c:, seconds behind each sentence, $PGHP, ZDA or RMC among them, or reports "
            "of a base station",
        )
    return found.rows, found.damage


def read_ais(
    data: bytes, *, name: str, date: str = "", origin: Origin | None = None, own_ship: str | None = None
) -> AisDocument:
    """Reports of AIS sentences (AIVDM, BSVDM, ...), of a table or of a MATLAB file with columns found by name.

    Own ship is what a column `is_own_ship` or a sentence VDO marks, or the ship `own_ship`. Without an origin it is
    the first report of own ship, else the first of all. `date` (ISO) is for times of day; a table of those
    that runs past midnight is put together again (up to 12 h). Left out and counted in
    `reference.damage`, one entry a kind: reports without id or time, off the globe, of what is not on the water, a
    second one at the same time or of the same fix, and single ones that no ship can have sailed to and from
    (`JUMP_MPS`). Where a ship tells how far its antenna is from its sides, in these reports or in others, positions
    are those of the middle of its hull; own ship's stay the antenna's.
    """
    told, wrong = ais_rows(data, name=name, date=date)
    rows, jump, damage = _clean_rows(told, name=name)
    ids = rows.ids
    own_id = _own_id(told, rows, own_ship, name=name)
    lat_deg, lon_deg = told.lat_deg[rows.row], told.lon_deg[rows.row]
    if origin is None:
        pick = rows.ship == own_id if own_id >= 0 else np.ones(len(rows.ship), dtype=bool)
        first = np.flatnonzero(pick)[np.argmin(told.t_ns[rows.row][pick])]
        origin = Origin(float(lat_deg[first]), float(lon_deg[first]))
    t_ns, position_m = told.t_ns[rows.row], geodetic_to_en(origin, lat_deg, lon_deg)
    heading_rad = np.deg2rad(_heading_deg(told.heading_deg))[rows.row]
    mine = rows.ship == own_id
    own = OwnShip(t_ns[mine], lat_deg[mine], lon_deg[mine], position_m[mine], heading_rad[mine])
    velocity_mps, sides_m = _velocity_mps(told)[rows.row], _sides_m(told, ids)
    middle_m = position_m + _to_middle(sides_m[rows.ship], heading_rad, velocity_mps)
    others = Reports(rows.ship, t_ns, middle_m, velocity_mps, heading_rad)
    reference = _reference(told, ids, take(others, ~mine), own_id=own_id, sides_m=sides_m, damage=(*wrong, *damage))
    return AisDocument(reference, own if own_id >= 0 else None, origin, _implausible(told, jump, origin))


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Usable reports, ordered by ship and time, no time twice."""

    ids: tuple[str, ...]  # of all ships with such reports
    ship: IntArray  # (m,) index into ids
    row: IntArray  # (m,) of the document


def _clean_rows(told: AisRows, *, name: str) -> tuple[_Rows, IntArray, tuple[Damage, ...]]:
    """The usable reports, the rows of those that jump, and what was left out."""
    known = told.timed & (told.label != "")
    placed = _on_globe(told.lat_deg, told.lon_deg)
    seen = told.kind == VESSEL
    meant = ~told.static & seen
    row = np.flatnonzero(known & placed & meant)
    if len(row) == 0:
        raise InputError(f"{name}: no report with a time and a position")
    ids, ship = np.unique(told.label[row], return_inverse=True)
    order = np.lexsort((told.t_ns[row], ship))
    again = np.zeros(len(order), dtype=bool)
    again[1:] = (np.diff(ship[order]) == 0) & (np.diff(told.t_ns[row[order]]) == 0)
    order = order[~again]
    twice = _same_fix(told, row[order], ship[order])
    order = order[~twice]
    ordered = row[order]
    jump = _jumps(ship[order], told.t_ns[ordered] / 1e9, told.lat_deg[ordered], told.lon_deg[ordered])
    counts = {
        "bad-report": (int(np.sum(~known & ~told.static)), "without a time or an id"),
        "bad-position": (int(np.sum(known & ~placed & meant)), "off the globe"),
        "not-afloat": (int(np.sum(known & placed & ~seen)), "of base stations, aircraft, virtual aids, or too coarse"),
        "duplicate-time": (int(np.sum(again)), "at a time their ship has reported already"),
        "duplicate-report": (int(np.sum(twice)), "that repeat a fix of their ship"),
        "position-jump": (int(np.sum(jump)), f"away from the way of their ship (over {JUMP_MPS:g} m/s)"),
    }
    damage = tuple(Damage(code, -1, f"AIS reports {what}", count=n) for code, (n, what) in counts.items() if n)
    return _Rows(tuple(ids.tolist()), ship[order[~jump]], ordered[~jump]), ordered[jump], damage


def _same_fix(told: AisRows, row: IntArray, ship: IntArray) -> BoolArray:
    """Which reports (ordered by ship and time) a ship under way has told already, as another receiver heard them later.

    All that they say is equal, and no minute is between them; of ships at rest that is no wonder.
    """
    said = [told.lat_deg, told.lon_deg, told.speed_kn, told.course_deg, told.heading_deg, told.second]
    columns = [np.nan_to_num(column[row], nan=-1.0) for column in said]
    order = np.lexsort((told.t_ns[row], *columns, ship))
    equal = np.diff(ship[order]) == 0
    for column in columns:
        equal &= np.diff(column[order]) == 0
    near = np.diff(told.t_ns[row][order]) < REPEAT_S * 10**9
    speed = told.speed_kn[row][order][1:]
    under_way = (speed > REST_MPS / KNOT_MPS) & (speed < 102.3)
    again = np.zeros(len(row), bool)
    again[order[1:]] = equal & near & under_way
    return again


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


def _own_id(told: AisRows, rows: _Rows, own_ship: str | None, *, name: str) -> int:
    """Index of own ship, -1 where there is none. InputError where the one asked for is not there."""
    if own_ship:
        if own_ship not in rows.ids:
            raise InputError(f"{name}: no report of own ship '{own_ship}'")
        return rows.ids.index(own_ship)
    marked = np.unique(rows.ship[told.own[rows.row]])
    if len(marked) > 1:
        raise InputError(f"{name}: several ships are marked as own ship", hint="say which one")
    return int(marked[0]) if len(marked) else -1


def _heading_deg(value: FloatArray) -> FloatArray:
    """Headings and courses in [0, 360); 511, and 360 for a course, say that they are unknown."""
    return np.where((value >= 0) & (value < 360), value, np.nan)


def _velocity_mps(told: AisRows) -> FloatArray:
    """East-north (n, 2) of course and speed over ground."""
    course = np.deg2rad(_heading_deg(told.course_deg))
    speed = told.speed_kn
    speed_mps = np.where((speed >= 0) & (speed < 102.3), speed * KNOT_MPS, np.nan)  # 102.3 kn: unknown
    return polar_to_en(speed_mps, course)


def _sides_m(told: AisRows, ids: Sequence[str]) -> FloatArray:
    """Distances (n, 4) of each ship's antenna to bow, stern, port and starboard; nan where not all are told."""
    sides_m = np.stack([_per_ship(told, ids, side, last=True, least=0.0) for side in told.sides_m.T], axis=1)
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


def _per_ship(
    told: AisRows, ids: Sequence[str], value: FloatArray, *, last: bool = False, least: float = 1e-9
) -> FloatArray:
    """The first number (n,) from `least` on that each ship tells in any of its reports, or the last; nan = none."""
    result = np.full(len(ids), np.nan)
    row, ship = _told_by(told, ids, value >= least)
    result[ship[::-1] if not last else ship] = value[row[::-1] if not last else row]  # the last one written stays
    return result


def _told_by(told: AisRows, ids: Sequence[str], usable: BoolArray) -> tuple[IntArray, IntArray]:
    """Rows in order of time that are usable and of these ships, and the ship (index into ids) of each."""
    row = np.flatnonzero(usable & told.timed & (told.label != ""))
    ship = np.searchsorted(ids, told.label[row]).clip(max=max(len(ids) - 1, 0))
    of_these = np.array(ids, np.str_)[ship] == told.label[row]
    order = np.argsort(told.t_ns[row][of_these], kind="stable")
    return row[of_these][order], ship[of_these][order]


def _reference(
    told: AisRows, ids: Sequence[str], reports: Reports, *, own_id: int, sides_m: FloatArray, damage: tuple[Damage, ...]
) -> Reference:
    """The ships but own ship."""
    others = [i for i in range(len(ids)) if i != own_id]
    renumber = np.searchsorted(others, np.arange(len(ids)))
    length_m, width_m = (_per_ship(told, ids, size_m) for size_m in (told.length_m, told.width_m))
    length_m = np.where(np.isnan(length_m), sides_m[:, 0] + sides_m[:, 1], length_m)
    width_m = np.where(np.isnan(width_m), sides_m[:, 2] + sides_m[:, 3], width_m)
    row, ship = _told_by(told, ids, told.name != "")
    names = dict(zip(ship[::-1].tolist(), told.name[row[::-1]].tolist(), strict=True))  # the first one that it tells
    return build_reference(
        replace(reports, ship=renumber[reports.ship]),
        ids=[ids[i] for i in others],
        names=[names.get(i, "") for i in others],
        length_m=length_m[others],
        width_m=width_m[others],
        complete=False,
        damage=damage,
    )


def _implausible(told: AisRows, row: IntArray, origin: Origin) -> Implausible:
    position_m = geodetic_to_en(origin, told.lat_deg[row], told.lon_deg[row])
    return Implausible(tuple(told.label[row].tolist()), told.t_ns[row], position_m)
