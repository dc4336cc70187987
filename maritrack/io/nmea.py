"""Own ship by its own instruments: NMEA 0183 sentences of position (RMC, GGA) and true heading (HDT, THS)."""

from __future__ import annotations

import re
from collections import Counter

import numpy as np

from maritrack.errors import InputError
from maritrack.geo import geodetic_to_en
from maritrack.io.ais import AisDocument, OwnShip, none_implausible
from maritrack.io.reference import Reports, build_reference
from maritrack.io.times import DAY_NS, day_start_ns
from maritrack.types import Damage, Origin

SENTENCE = re.compile(r"\$([A-Z]{2})([A-Z]{3}),([^*]*)(?:\*([0-9A-Fa-f]{2}))?\s*$")
TOLD = {"bad-checksum": "with a wrong checksum", "bad-sentence": "whose fields can't be read"}


def read_nmea(data: bytes, *, name: str, date: str = "", origin: Origin | None = None) -> AisDocument:
    """Positions and headings of the ship that wrote the sentences; it knows of no other.

    RMC tells date and time, GGA the time of day only: until a date comes it counts from `date` (ISO). A heading has
    no time of its own and takes that of the position before it. Sentences of other kinds are passed over, those that
    are wrong are counted in `reference.damage`. InputError where no position is left.
    """
    fixes, wrong = _fixes(data.decode("ascii", "replace"), day_start_ns(date, name=name))
    if not fixes:
        raise InputError(f"{name}: no position (RMC, GGA) in it")
    t_ns = np.array(sorted(fixes), np.int64)
    lat_deg, lon_deg, heading_deg = np.array([fixes[t] for t in t_ns.tolist()]).T
    if origin is None:
        origin = Origin(float(lat_deg[0]), float(lon_deg[0]))
    position_m = geodetic_to_en(origin, lat_deg, lon_deg)
    none, nobody = np.zeros(0), np.zeros((0, 2))
    reference = build_reference(
        Reports(none.astype(np.int64), none.astype(np.int64), nobody, nobody, none), ids=(), names=(), length_m=none,
        width_m=none, complete=False,
        damage=tuple(Damage(code, -1, f"NMEA sentences {TOLD[code]}", count=n) for code, n in sorted(wrong.items())),
    )  # fmt: skip
    return AisDocument(
        reference, OwnShip(t_ns, lat_deg, lon_deg, position_m, np.deg2rad(heading_deg)), origin, none_implausible()
    )


def _fixes(text: str, day_ns: int) -> tuple[dict[int, tuple[float, float, float]], Counter[str]]:
    """Latitude, longitude and heading (nan where none came) in degrees by time, and what was wrong."""
    fixes: dict[int, tuple[float, float, float]] = {}
    wrong: Counter[str] = Counter()
    last_ns = -1
    for line in text.splitlines():
        match = SENTENCE.search(line)
        if match is None or match[2] not in ("RMC", "GGA", "HDT", "THS"):
            continue
        if match[4] is not None and int(match[4], 16) != _checksum(match[0]):
            wrong["bad-checksum"] += 1
            continue
        fields = match[3].split(",")
        try:
            if match[2] in ("HDT", "THS"):
                if last_ns in fixes and fields[0] and not (match[2] == "THS" and fields[1:2] == ["V"]):
                    fixes[last_ns] = (*fixes[last_ns][:2], float(fields[0]) % 360.0)
                continue
            if match[2] == "RMC":
                day_ns = _day_ns(fields[8]) if fields[8] else day_ns
            place = fields[2:6] if match[2] == "RMC" else fields[1:5]
            invalid = fields[1] != "A" if match[2] == "RMC" else fields[5] in ("", "0")
            if invalid or not fields[0]:
                continue
            t_ns = day_ns + _time_ns(fields[0])
            if match[2] == "GGA" and last_ns - t_ns > DAY_NS // 2:  # past midnight, the new date comes later
                day_ns, t_ns = day_ns + DAY_NS, t_ns + DAY_NS
            heading_deg = fixes[t_ns][2] if t_ns in fixes else float("nan")
            fixes[t_ns] = (_angle_deg(place[0], place[1], 90.0), _angle_deg(place[2], place[3], 180.0), heading_deg)
            last_ns = t_ns
        except (ValueError, IndexError):
            wrong["bad-sentence"] += 1
    return fixes, wrong


def _checksum(sentence: str) -> int:
    """All characters between $ and * by exclusive or."""
    value = 0
    for letter in sentence[1 : sentence.index("*")]:
        value ^= ord(letter)
    return value


def _time_ns(text: str) -> int:
    """hhmmss.sss since midnight."""
    hours, minutes, seconds = int(text[:2]), int(text[2:4]), float(text[4:])
    if not (0 <= hours < 24 and 0 <= minutes < 60 and 0.0 <= seconds < 61.0):
        raise ValueError(text)
    return (hours * 3600 + minutes * 60) * 10**9 + round(seconds * 1000) * 10**6


def _day_ns(text: str) -> int:
    """ddmmyy; years from 80 are of the last century."""
    day, month, year = int(text[:2]), int(text[2:4]), int(text[4:6])
    return day_start_ns(f"{1900 + year if year >= 80 else 2000 + year:04d}-{month:02d}-{day:02d}", name="RMC")


def _angle_deg(text: str, half: str, most: float) -> float:
    """(d)ddmm.mmm with N, S, E or W."""
    head, _, tail = text.partition(".")
    angle = int(head[:-2]) + float(f"{head[-2:]}.{tail or 0}") / 60.0
    if half not in ("N", "S", "E", "W") or angle > most:
        raise ValueError(text)
    return -angle if half in ("S", "W") else angle
