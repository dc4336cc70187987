"""AIS as its receivers write it: sentences AIVDM, BSVDM and the like, one line each, some messages in several.

What pyais makes of a payload becomes a row; which line belongs to which message, and when it was received, is told
here, with bounded memory and a count of all that is wrong. Times come, in this order, from what stands on the line
itself (a tag block's `c:`, seconds behind the checksum, a time before the sentence), from the last sentence that
tells one ($PGHP, ZDA, RMC), or, where the document has nothing of the kind, from the last report of a base station.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pyais

from maritrack.io.aisrows import OTHER, VESSEL, AisRows
from maritrack.io.jsontext import clean
from maritrack.io.times import DAY_NS, iso_to_s, usable_time
from maritrack.types import Damage

MOST_LINE = 2048  # octets of a line; sentences have 82
MOST_OPEN = 64  # messages whose other parts are waited for
MOST_LATE_S = 10.0  # a report's own second of the minute counts when it is nearer than this to its time
SENTENCE = re.compile(
    rb"!(?:[A-Z]{2}|--)VD([MO]),([1-9]),([1-9]),([0-9]?),([^,*]{0,2}),[0-W`-w]*,[0-5](?:\*([0-9A-Fa-f]{2}))?"
)  # fmt: skip
CLOCK = re.compile(rb"\$(PGHP|[A-Z]{2}ZDA|[A-Z]{2}RMC),([^*]*)\*([0-9A-Fa-f]{2})")
RECEIVED = re.compile(rb"\\(?:[^\\]*,)?c:(\d{9,14})")
BEHIND = re.compile(rb"\s*(\d{9,14}(?:\.\d*)?)\s*$")  # in the last field of a line
LEAST_BITS = {1: 143, 2: 143, 3: 143, 4: 134, 9: 134, 11: 134, 18: 139, 19: 301, 21: 219, 27: 94, 5: 270, 24: 160}
POSITIONS = (1, 2, 3, 4, 9, 11, 18, 19, 21, 27)
SIDES = ("to_bow", "to_stern", "to_port", "to_starboard")
TOLD = {
    "bad-checksum": "sentences with a wrong checksum", "bad-sentence": "lines of AIS that are no sentence",
    "bad-message": "messages that are too short or can't be read",
    "incomplete-message": "messages of which not all parts came", "coarse-time": "times taken from base stations",
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Sentences:
    """What a document of sentences says."""

    rows: AisRows  # positions and particulars, in order of their messages
    messages: dict[int, int]  # how many of each type came, by type
    damage: tuple[Damage, ...]  # one entry a kind


def read_sentences(data: bytes) -> Sentences:
    """All messages of a document. Rows without a time are not `timed`.

    A position is of the second that its message names, where that is within `MOST_LATE_S` of the time of reception.
    Messages 9, 4 and virtual aids to navigation are OTHER: nothing is afloat there. So is message 27, which tells
    the place to 0.1 minutes only.
    """
    wrong: Counter[str] = Counter()
    messages: Counter[int] = Counter()
    rows: list[tuple[object, ...]] = []
    base_ns: int | None = None  # when the last base station said that it is
    clocked = False
    for parts, own, t_ns in _messages(data, wrong):
        told = _decoded(parts)
        if told is None:
            wrong["bad-message"] += 1
            continue
        messages[told.msg_type] += 1
        clocked |= t_ns is not None
        if told.msg_type in (4, 11):
            base_ns = _base_ns(told, base_ns)
        row = _row(told, own, t_ns, base_ns)
        if row is not None:
            rows.append(row)
    if not clocked and any(row[2] is not None for row in rows):
        wrong["coarse-time"] = sum(row[2] is not None for row in rows)
    damage = tuple(Damage(code, -1, f"AIS: {TOLD[code]}", count=n) for code, n in sorted(wrong.items()))
    return Sentences(_columns(rows, clocked=clocked), dict(sorted(messages.items())), damage)


def _lines(data: bytes, wrong: Counter[str]) -> Iterator[bytes]:
    """Lines of a document; those that are too long to be a sentence are counted where they hold one, and left out."""
    end_of_line = b"\n" if b"\n" in data else b"\r"
    at = 0
    while at < len(data):
        end = data.find(end_of_line, at)
        end = len(data) if end < 0 else end
        if end - at <= MOST_LINE:
            yield data[at:end]
        elif data.find(b"!", at, end) >= 0:
            wrong["bad-sentence"] += 1
        at = end + 1


def _messages(data: bytes, wrong: Counter[str]) -> Iterator[tuple[list[bytes], bool, int | None]]:
    """The sentences of each whole message, whether it is of own ship, and when it was received (of its first)."""
    clock_ns: int | None = None
    waiting: dict[tuple[bytes | int, ...], tuple[dict[int, bytes], int | None]] = {}
    for line in _lines(data, wrong):
        start = line.find(b"!")
        match = SENTENCE.match(line, start) if start >= 0 else None
        if match is None:
            if start < 0:
                clock_ns = _clock_ns(line, clock_ns)
            else:
                wrong["bad-sentence"] += b"VDM" in line or b"VDO" in line
            continue
        kind, total, number, sequence, channel, checksum = match.groups()
        if checksum is not None and int(checksum, 16) != _xor(match[0][1:-3]):
            wrong["bad-checksum"] += 1
            continue
        own, here_ns = kind == b"O", _line_ns(line, start, match.end())
        t_ns = clock_ns if here_ns is None else here_ns
        clock_ns = t_ns
        if total == b"1":
            yield [match[0]], own, t_ns
            continue
        key = (match[0][:6], total, sequence, channel)
        if int(number) > int(total):
            wrong["bad-sentence"] += 1
            continue
        if number == b"1" and key in waiting:
            wrong["incomplete-message"] += 1
            del waiting[key]
        found, first_ns = waiting.setdefault(key, ({}, t_ns))
        found[int(number)] = match[0]
        if len(found) == int(total):
            del waiting[key]
            yield [found[i] for i in sorted(found)], own, first_ns
        elif len(waiting) > MOST_OPEN:
            del waiting[next(iter(waiting))]
            wrong["incomplete-message"] += 1
    wrong["incomplete-message"] += len(waiting)
    for code in [code for code, n in wrong.items() if n == 0]:
        del wrong[code]


def _xor(octets: bytes) -> int:
    value = 0
    for octet in octets:
        value ^= octet
    return value


def _line_ns(line: bytes, start: int, end: int) -> int | None:
    """When a line says itself that it was received."""
    told = RECEIVED.search(line, 0, start) if start else None
    if told is None and (comma := line.rfind(b",", end)) >= 0:
        told = BEHIND.match(line, comma + 1)
    if told is not None:
        return _since_1970_ns(float(told[1]))
    before = line[:start].strip(b" ,;\t\"'").decode("ascii", "replace")
    if not before or before.startswith("\\"):
        return None
    try:
        return _since_1970_ns(float(before))
    except ValueError:
        return _since_1970_ns(iso_to_s(before))


def _since_1970_ns(value: float) -> int | None:
    """Seconds or milliseconds since 1970 as nanoseconds; None for what is no time of today."""
    seconds = value / 1e3 if value > 1e11 else value
    if not usable_time(np.array([seconds]))[0] or seconds < 1e8:
        return None
    return round(seconds * 1e6) * 1000


def _clock_ns(line: bytes, now_ns: int | None) -> int | None:
    """The time that a sentence of time tells, else what it was before."""
    match = CLOCK.search(line)
    if match is None or int(match[3], 16) != _xor(match[0][1:-3]):
        return now_ns
    fields = match[2].decode("ascii", "replace").split(",")
    try:
        if match[1] == b"PGHP":
            year, month, day, hour, minute, second, milli = (int(field) for field in fields[1:8])
            return _utc_ns(year, month, day, hour, minute, second) + milli * 10**6
        time, date = fields[0], fields[1:4]
        if match[1].endswith(b"RMC"):
            day_month_year = fields[8]
            date = [day_month_year[:2], day_month_year[2:4], f"20{day_month_year[4:6]}"]
        whole = _utc_ns(int(date[2]), int(date[1]), int(date[0]), int(time[:2]), int(time[2:4]), int(time[4:6]))
        return whole + round(float(f"0{time[6:]}") * 1e3) * 10**6
    except (ValueError, IndexError, OverflowError):
        return now_ns


def _utc_ns(*parts: int) -> int:
    year, month, day, hour, minute, second = parts
    return round(datetime(year, month, day, hour, minute, second, tzinfo=UTC).timestamp()) * 10**9


def _decoded(parts: list[bytes]) -> Any:
    """What pyais makes of a message; None for what it can't read, or what ends before the fields that are used."""
    try:
        told = pyais.decode(*parts)
    except (pyais.exceptions.AISBaseException, ValueError, TypeError, IndexError, KeyError, OverflowError):
        return None
    bits = sum(6 * len(part.split(b",")[5]) for part in parts)
    return None if bits < LEAST_BITS.get(told.msg_type, 0) else told


def _base_ns(told: Any, before_ns: int | None) -> int | None:
    try:
        return _utc_ns(told.year, told.month, told.day, told.hour, told.minute, told.second)
    except (ValueError, TypeError, OverflowError):  # 0 stands for what it does not know
        return before_ns


def _row(told: Any, own: bool, t_ns: int | None, base_ns: int | None) -> tuple[object, ...] | None:
    """A message as a row, None where it tells neither a position nor particulars that are used."""
    placed = told.msg_type in POSITIONS
    if not placed and told.msg_type not in (5, 24):
        return None

    def number(name: str) -> float:
        value = getattr(told, name, None)
        return float("nan") if value is None else float(value)

    other = told.msg_type in (4, 9, 27) or bool(getattr(told, "virtual_aid", False))
    name = getattr(told, "shipname", None) or getattr(told, "name", None) or ""
    second = number("second") if placed else float("nan")
    return (
        str(told.mmsi), t_ns, base_ns, *((number("lat"), number("lon")) if placed else (float("nan"),) * 2),
        number("heading"), number("course"), number("speed"), second, clean(str(name)),
        tuple(number(side) for side in SIDES), not placed, OTHER if other else VESSEL, own,
    )  # fmt: skip


def _columns(rows: list[tuple[object, ...]], *, clocked: bool) -> AisRows:
    n = len(rows)
    label, received, base, lat, lon, heading, course, speed, second, name, sides, static, kind, own = (
        zip(*rows, strict=True) if rows else [()] * 14
    )
    told = received if clocked else base
    t_ns = np.array([0 if t is None else t for t in told], np.int64)
    second_s = np.array(second, float)
    late_s = (t_ns % (60 * 10**9)) * 1e-9 - second_s
    late_s = np.where(np.isfinite(second_s) & (second_s < 60), (late_s + 30.0) % 60.0 - 30.0, 0.0)
    ships = {name for name, mine, what in zip(label, own, kind, strict=True) if mine and what == VESSEL}
    near = np.abs(late_s) <= (MOST_LATE_S if clocked else 30.0)
    unknown = np.full(n, np.nan)
    return AisRows(
        label=np.array(label, np.str_), t_ns=t_ns - np.where(near, np.rint(late_s * 1e3), 0.0).astype(np.int64) * 10**6,
        timed=np.array([t is not None and 0 < t < 100 * 366 * DAY_NS for t in told], bool),
        lat_deg=np.array(lat, float), lon_deg=np.array(lon, float), heading_deg=np.array(heading, float),
        course_deg=np.array(course, float), speed_kn=np.array(speed, float), second=second_s,
        name=np.array(name, np.str_), length_m=unknown, width_m=unknown,
        sides_m=np.array(sides, float).reshape(n, 4), static=np.array(static, bool), kind=np.array(kind, np.int64),
        own=np.array(own, bool) & (len(ships) == 1),  # of several, as shore stations write them, none is it
    )  # fmt: skip
