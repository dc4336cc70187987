"""The check of a run against AIS, from its archive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from maritrack.aischeck.chains import linked
from maritrack.aischeck.coast import read_coast
from maritrack.aischeck.judge import CONFIRMED as SEEN
from maritrack.aischeck.judge import ECHO, Rules, Verdict, matched_ships, verdicts
from maritrack.aischeck.looks import Looks, look
from maritrack.aischeck.match import Noise, TrackRows, match, rows_of, with_lags
from maritrack.aischeck.seeing import Seeing, seeing_of
from maritrack.aischeck.ships import Jump, Ship, comes_near, jumps, ships_of
from maritrack.aischeck.strangers import Stranger, displacements, doubles, strangers
from maritrack.config import config_from_toml
from maritrack.errors import UsageError
from maritrack.io.ais import read_ais
from maritrack.io.archive import Archive, iter_results, read_archive
from maritrack.io.documents import read_document
from maritrack.io.reference import Reference, only
from maritrack.io.times import YEAR_NS, day_start_ns
from maritrack.io.truth import document_kind, read_reference
from maritrack.retrospect import History, gather, judged
from maritrack.settings import Config, parse_ids, parse_lags
from maritrack.types import CONFIRMED, BoolArray, Damage, FloatArray, Origin

NEAR_M = 5000.0  # beyond what the radar sees: a ship may come in between two reports


@dataclass(frozen=True, slots=True)
class Options:
    """What the check is told besides."""

    azimuth_sigma_deg: float = 0.5  # of what a calibration leaves
    max_lag_s: float = 60.0  # transponders may be late by so much
    max_offset_m: float = 2000.0  # a track that goes as a ship does is looked for within this
    ids: str = ""  # of the ships that are checked; "" = all
    own_ship: str = ""
    rules: Rules = field(default_factory=Rules)


@dataclass(frozen=True, slots=True, eq=False)
class Check:
    """What came out."""

    run_id: str
    origin: Origin | None
    start_ns: int
    scans: int
    verdicts: list[Verdict]
    strangers: list[Stranger]
    jumps: list[Jump]
    seeing: Seeing
    azimuth_deg: float  # mean of what confirmed ships lie off in azimuth; nan without one
    azimuth_sigma_deg: float
    elsewhere: int  # ships of AIS that the radar never looked at
    rows: TrackRows  # a chain of pieces has the id of its first
    members: dict[int, tuple[int, ...]]  # the tracks of each chain
    ships: list[Ship]
    looks: Looks
    damage: tuple[Damage, ...]
    noise: Noise
    options: Options


def check_ais(
    path: Path, ais: Path, options: Options, *, coast: Path | None = None, lags: Sequence[str] = (), date: str = ""
) -> Check:
    """Every ship of AIS that the run's radars looked at, and every track under way that is none of them.

    `lags` are ID=SECONDS, for ships whose lag is known; others are found out. The archive is read twice; what is held
    are its track rows, some 400 octets each, and a hundred octets for each look at a ship.
    """
    archive = read_archive(path)
    config = config_from_toml(archive.config_toml)
    damage: list[Damage] = []
    history, sensor_m, cell_m, reach_m, start_ns = _history(archive, damage)
    noise = Noise(math.radians(options.azimuth_sigma_deg), cell_m / 2)
    day = date or config.input.date or (day_of(start_ns) if start_ns > YEAR_NS else "")
    told, leaps, wrong = _ships(ais, archive, config, options, start_ns, day)
    ships = [ship for ship in told if comes_near(ship, sensor_m, reach_m + NEAR_M)]
    ships = _with_known_lags(ships, lags, config)
    history, members = linked(history)
    rows = rows_of(history, start_ns, sensor_m)
    _, moving = judged(history, config.smooth) if len(history) else (None, np.zeros(0, bool))
    known = {ship.id for ship in ships if ship.lag_s}
    found = with_lags(rows, [ship for ship in ships if ship.id not in known], noise, options.max_lag_s)
    ships = sorted((*found, *(ship for ship in ships if ship.id in known)), key=lambda ship: ship.id)
    matching = match(rows, ships, noise, reach_m=300.0 + 3.0 * float(rows.range_m.max(initial=0.0)) * noise.azimuth_rad)
    rings = [] if coast is None else _coast(coast, archive)
    roi = (config.input.roi_min_m, config.input.roi_max_m)
    told_already: list[Damage] = []
    again = iter_results(archive.path, on_damage=told_already.append)
    looks = look(again, ships, noise, start_ns=start_ns, roi_m=roi, hidden_by=rings)
    matched = matched_ships(len(ships), looks, rows, matching, moving)
    seeing = seeing_of(looks, matched)
    astray = displacements(rows, ships, matched, matching, noise, options.max_offset_m)
    unsure = doubles(rows, ships, matching, noise, options.max_offset_m)
    said = verdicts(ships, rows, moving, matching, looks, seeing, astray, unsure, noise, options.rules)
    sure = {one.id for one in said if one.verdict in (SEEN, ECHO)}
    seeing = seeing_of(
        looks, np.array([ship.id in sure for ship in ships], bool)
    )  # now with those at rest, and far off
    said = verdicts(ships, rows, moving, matching, looks, seeing, astray, unsure, noise, options.rules)
    taken = {one.displaced.track for one in said if one.displaced is not None}
    alone = strangers(rows, moving, ships, matched, matching, noise, taken, config.smooth.min_hits)
    azimuth, sigma = _azimuth(rows, ships, matching.ship, matched)
    return Check(
        archive.manifest.run_id, archive.manifest.origin, start_ns, len(sensor_m), said, alone,
        _in_time(leaps, start_ns, rows, looks), seeing, azimuth, sigma, len(told) - len(said), rows, members, ships,
        looks, (*archive.damage, *damage, *wrong), noise, options,
    )  # fmt: skip


def _history(archive: Archive, damage: list[Damage]) -> tuple[History, FloatArray, float, float, int]:
    """Rows of the tracks while confirmed, where the radar was in each scan, the depth of its cells, how far it saw,
    and when it began."""
    places: dict[int, FloatArray] = {}
    cells, reach_m, start_ns, parts = 0.0, 0.0, None, []
    for scan in iter_results(archive.path, on_damage=damage.append):
        start_ns = scan.scan.t_start_ns if start_ns is None else start_ns
        places[scan.k] = scan.scan.position_m
        cells = max(cells, scan.scan.sensor.range_res_m)
        own_m = scan.scan.sensor.max_range_m
        reach_m = max(reach_m, own_m if math.isfinite(own_m) else float(scan.clusters.range_m.max(initial=0.0)))
        parts.append((scan.k, scan.tracks))
    if start_ns is None:
        raise UsageError(f"{archive.path}: no scan in it")
    history = gather(parts)
    sensor_m = np.zeros((max(places) + 1, 2))
    sensor_m[list(places)] = np.stack(list(places.values()))
    return history.rows(np.flatnonzero(history.tracks.status >= CONFIRMED)), sensor_m, cells, reach_m, start_ns


def _ships(
    ais: Path, archive: Archive, config: Config, options: Options, start_ns: int, date: str
) -> tuple[list[Ship], list[Jump], tuple[Damage, ...]]:
    """The ships, their leaps and what was left out. A run without a date is of `date`, or of the first report's day."""
    data, origin = read_document(ais), archive.manifest.origin
    gaps = {"max_gap_moving_s": config.score.max_gap_moving_s, "max_gap_rest_s": config.score.max_gap_rest_s}
    if document_kind(data, name=str(ais)) != "ais":
        reference = only(read_reference(data, name=str(ais), origin=origin, date=date), parse_ids(options.ids))
        return ships_of(reference, since(reference, start_ns, date), **gaps), [], reference.damage
    if origin is None:
        raise UsageError(f"{archive.path}: the run knows no place on the globe", hint="process it with --position")
    document = read_ais(data, name=str(ais), date=date, origin=origin, own_ship=options.own_ship or None)
    reference = only(document.reference, parse_ids(options.ids))
    zero_ns = since(reference, start_ns, date)
    ships = ships_of(reference, zero_ns, **gaps)
    leaps = [jump for jump in jumps(ships, document.implausible, zero_ns) if jump.id in reference.ids]
    leaps = [replace(jump, t_ns=jump.t_ns - zero_ns + start_ns) for jump in leaps]
    return ships, leaps, reference.damage


def since(reference: Reference, start_ns: int, date: str) -> int:
    """When the run began, by the clock of the reports: one of the two may know the date, and the other not."""
    if start_ns > YEAR_NS or len(reference.t_ns) == 0 or reference.t_ns.min() < YEAR_NS:
        return start_ns
    return start_ns + day_start_ns(date or day_of(int(reference.t_ns.min())), name="the run")


def day_of(t_ns: int) -> str:
    """The day of a time, as in 2016-01-12."""
    return str(np.datetime64(t_ns, "ns").astype("datetime64[D]"))


def _with_known_lags(ships: Sequence[Ship], lags: Sequence[str], config: Config) -> list[Ship]:
    known = parse_lags(",".join(filter(None, (config.score.truth_lag_s, *lags))))
    return [replace(ship, lag_s=known.get(ship.id, 0.0)) for ship in ships]


def _coast(path: Path, archive: Archive) -> list[FloatArray]:
    if archive.manifest.origin is None:
        raise UsageError(f"{archive.path}: the run knows no place on the globe, so no coast can be laid over it")
    return read_coast(read_document(path), name=str(path), origin=archive.manifest.origin)


def _in_time(leaps: Sequence[Jump], start_ns: int, rows: TrackRows, looks: Looks) -> list[Jump]:
    """Jumps during the run, of whatever ship."""
    last_s = max(float(rows.t_s.max(initial=0.0)), float(looks.t_s.max(initial=0.0)))
    return [jump for jump in leaps if 0.0 <= (jump.t_ns - start_ns) * 1e-9 <= last_s]


def _azimuth(rows: TrackRows, ships: Sequence[Ship], ship: np.ndarray, matched: BoolArray) -> tuple[float, float]:
    """Mean and standard error, in degrees, of what tracks of confirmed ships lie off in azimuth; a ship is one vote."""
    votes = []
    for s in np.flatnonzero(matched).tolist():
        i = np.flatnonzero((ship == s) & (rows.range_m > 500.0))
        if len(i):
            sensor = rows.position_m[i] - rows.range_m[i, None] * np.stack(
                [np.sin(rows.azimuth_rad[i]), np.cos(rows.azimuth_rad[i])], axis=-1
            )
            offset = ships[s].at(rows.t_s[i])[0] - sensor
            off = np.arctan2(offset[:, 0], offset[:, 1]) - rows.azimuth_rad[i]
            votes.append(math.degrees(float(np.median((off + np.pi) % (2 * np.pi) - np.pi))))
    if not votes:
        return math.nan, math.nan
    spread = float(np.std(votes, ddof=1)) / math.sqrt(len(votes)) if len(votes) > 1 else math.nan
    return float(np.mean(votes)), spread
