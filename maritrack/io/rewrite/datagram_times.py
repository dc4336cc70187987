"""When datagrams were received, or what comes nearest to it, and which of them lie in a window of time."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime, time
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from maritrack.errors import InputError, UsageError
from maritrack.io.cat240.framing import HEADER
from maritrack.io.cat240.recordwalk import ITEM_140, presence, source_at, time_at
from maritrack.io.datagrams import NO_TIME, Datagrams
from maritrack.io.rewrite.datablocks import Blocks, blocks_of
from maritrack.io.times import DAY_NS, YEAR_NS
from maritrack.types import BoolArray, IntArray

TICK_NS = 7_812_500  # 1/128 s
TICKS_PER_DAY = 86_400 * 128
HOUR = 3600 * 128
SENSORS = 65_536
FEW_TIMES = 16  # for which arrays don't pay
FOREVER = 2**62  # ns: some 146 years
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
FORMS = "2017-11-02T07:40:00Z, 07:40:00 or +60 (seconds after the first datagram)"


@dataclass(slots=True)
class Clock:
    """Gives each datagram a time, also where the container has none.

    A receive time stays; one since a midnight counts from `day_ns`. Without any in the container, the time is that
    of the records' time of day (140) on `day_ns`, the days counted on for each sensor at midnight. A datagram
    without either has the last known time, before the first that time.
    """

    day_ns: int = 0
    last: int = NO_TIME
    received: bool = False  # there was a receive time
    now: int = -1  # last time of day of any sensor, with its days; -1 = none
    tod: IntArray = field(default_factory=lambda: np.full(SENSORS, -1))  # last time of day by SAC << 8 | SIC
    day: IntArray = field(default_factory=lambda: np.zeros(SENSORS, dtype=np.int64))

    def times(self, d: Datagrams) -> IntArray:
        """Times (n,) of datagrams that follow those asked for before."""
        if len(d) == 0:
            return d.t_ns
        known = d.t_ns != NO_TIME
        self.received |= bool(known.any())
        if self.received:
            t_ns = np.where(d.t_ns < YEAR_NS, d.t_ns + self.day_ns, d.t_ns) if self.day_ns else d.t_ns
        else:
            t_ns, known = self._of_day(blocks_of(d), d)
        if not known.all():
            t_ns = self._filled(t_ns, known)
        self.last = int(t_ns[-1])
        return t_ns

    def _filled(self, t_ns: IntArray, known: BoolArray) -> IntArray:
        if not known.any():
            return np.full(len(t_ns), self.day_ns if self.last == NO_TIME else self.last)
        before = np.maximum.accumulate(np.where(known, np.arange(len(t_ns)), -1))
        filled: IntArray = t_ns[np.maximum(before, 0)]
        filled[before < 0] = t_ns[np.argmax(known)] if self.last == NO_TIME else self.last
        return filled

    def _of_day(self, blocks: Blocks, d: Datagrams) -> tuple[IntArray, BoolArray]:
        """Times (n,) from the first block of each datagram whose first record tells one, and which have one."""
        sensor = blocks.rows["sac"] << 8 | blocks.rows["sic"]
        tod = np.where(blocks.usual, blocks.rows["tod"], -1)
        for i in np.flatnonzero(blocks.whole & ~blocks.usual & _may_tell(d.data, blocks)).tolist():
            sensor[i], tod[i] = first_time(d.data, int(blocks.bounds[i]), int(blocks.bounds[i + 1]))
        telling = np.flatnonzero(tod >= 0)
        owner, which = np.unique(blocks.owner[telling], return_index=True)
        t_ns, known = np.zeros(len(d), dtype=np.int64), np.zeros(len(d), dtype=np.bool_)
        if len(owner):
            ticks = self._unwrap(sensor[telling[which]], tod[telling[which]])
            t_ns[owner], known[owner] = np.maximum(self.day_ns + ticks * TICK_NS, 0), True
        return t_ns, known

    def _unwrap(self, sensor: IntArray, tod: IntArray) -> IntArray:
        """Times of day (n,), n > 0, with the days since the first. A step below -12 h is midnight.

        A sensor that joins is on the day that brings it nearest to the last time of the others.
        """
        self.now = int(tod[0]) if self.now < 0 else self.now
        sensors, first = np.unique(sensor, return_index=True)
        joining = np.sort(first[self.tod[sensors] < 0])
        ticks = np.empty(len(tod), dtype=np.int64)
        for begin, end in pairwise([0, *joining[joining > 0].tolist(), len(tod)]):
            one, time_ = int(sensor[begin]), int(tod[begin])
            if self.tod[one] < 0:
                self.tod[one], self.day[one] = time_, (self.now - time_ + TICKS_PER_DAY // 2) // TICKS_PER_DAY
            go_on = self._go_on_few if end - begin < FEW_TIMES else self._go_on
            ticks[begin:end] = go_on(sensor[begin:end], tod[begin:end])
            self.now = int(ticks[end - 1])
        return ticks

    def _go_on(self, sensor: IntArray, tod: IntArray) -> IntArray:
        """The same for sensors that are all known."""
        order = np.argsort(sensor, kind="stable")
        s, t = sensor[order], tod[order]
        first = np.flatnonzero(np.diff(s, prepend=-1))
        before = np.concatenate([t[:1], t[:-1]])
        before[first] = self.tod[s[first]]
        step = t - before
        days = np.cumsum((step < -TICKS_PER_DAY // 2).astype(np.int64) - (step > TICKS_PER_DAY - HOUR))
        passed = np.concatenate([[0], days])[first]  # by the groups before
        days += np.repeat(self.day[s[first]] - passed, np.diff(np.append(first, len(s))))
        last = np.append(first[1:], len(s)) - 1
        self.tod[s[last]], self.day[s[last]] = t[last], days[last]
        ticks = np.empty(len(s), dtype=np.int64)
        ticks[order] = days * TICKS_PER_DAY + t
        return ticks

    def _go_on_few(self, sensor: IntArray, tod: IntArray) -> IntArray:
        """The same, one by one."""
        ticks = []
        for one, time_ in zip(sensor.tolist(), tod.tolist(), strict=True):
            step = time_ - int(self.tod[one])
            self.day[one] += (step < -TICKS_PER_DAY // 2) - (step > TICKS_PER_DAY - HOUR)
            self.tod[one] = time_
            ticks.append(int(self.day[one]) * TICKS_PER_DAY + time_)
        return np.array(ticks, dtype=np.int64)


def first_time(data: bytes, start: int, end: int) -> tuple[int, int]:
    """SAC << 8 | SIC and time of day of the first record of the data block in [start, end); time -1 = none."""
    at = start + HEADER
    present = presence(data, at, end)
    tod = time_at(data, at, end, present)
    return (max(0, source_at(data, at, present)), tod) if tod < TICKS_PER_DAY else (0, -1)


def _may_tell(data: bytes, blocks: Blocks) -> BoolArray:
    """Whether the FSPEC of the first record of a whole block names the time of day."""
    u8 = np.frombuffer(data, dtype=np.uint8)
    at = np.minimum(blocks.bounds[:-1] + HEADER, max(0, len(u8) - 2))
    telling: BoolArray = (u8[at] & 1 > 0) & (u8[at + 1] & ITEM_140 > 0)
    return telling


class Bound(NamedTuple):
    """One end of a window as it was written."""

    kind: str  # "" = open, "iso", "day" (time of day), "after" (the first datagram)
    ns: int
    text: str


class Span(NamedTuple):
    """A window in the times of a recording: first <= t < end."""

    first: int
    end: int


def parse_window(text: str) -> tuple[Bound, Bound]:
    """FROM..TO, either side may be empty. UsageError where it is none."""
    begin, dots, end = text.partition("..")
    if not dots:
        raise UsageError(f"time '{text}': write FROM..TO, one side may be empty", hint=f"a time is {FORMS}")
    return _bound(begin.strip(), text), _bound(end.strip(), text)


def resolve(window: tuple[Bound, Bound], first_ns: int, *, name: str) -> Span:
    """The window in the times of a recording whose first datagram came at `first_ns`.

    A time of day as FROM is on the day of the first datagram, as TO it is the first one after FROM (without FROM:
    after the first datagram). Two times of day that end before the first datagram, and a FROM without TO more than
    12 h before it, are a day later. UsageError where it ends before it begins.
    """
    kinds = window[0].kind, window[1].kind
    begin = _placed(window[0], first_ns, first_ns, name) if kinds[0] else -FOREVER
    after = begin if kinds[0] else first_ns
    end = _placed(window[1], first_ns, after, name) if kinds[1] else FOREVER
    if kinds[1] == "day" and end <= after:
        end += DAY_NS
    if (kinds == ("day", "day") and end <= first_ns) or (kinds == ("day", "") and first_ns - begin > DAY_NS // 2):
        begin, end = begin + DAY_NS, end + DAY_NS if kinds[1] else end
    if begin >= end:
        raise UsageError(f"time '{window[0].text}..{window[1].text}': ends before it begins")
    return Span(begin, end)


def as_text(t_ns: int) -> str:
    """A time as people read it; without the day where that is unknown."""
    moment = datetime.fromtimestamp(t_ns // 10**9, UTC)
    form = "%H:%M:%S" if t_ns < YEAR_NS else "%Y-%m-%dT%H:%M:%SZ"
    return moment.strftime(form)


def _placed(bound: Bound, first_ns: int, near_ns: int, name: str) -> int:
    """A bound as a time; a time of day is on the day of `near_ns`."""
    if bound.kind == "iso" and first_ns < YEAR_NS:
        raise InputError(f"{name}: tells times of day only, no day for '{bound.text}'", hint="pass --date")
    start = {"iso": 0, "day": near_ns - near_ns % DAY_NS, "after": first_ns}[bound.kind]
    return start + bound.ns


def _bound(text: str, whole: str) -> Bound:
    try:
        if text.startswith("+") and text[1:2].isdigit():
            return Bound("after", min(round(float(text[1:]) * 1e9), FOREVER), text)
        if not text:
            return Bound("", 0, text)
        if "-" in text.lstrip("-"):
            return Bound("iso", _iso_ns(text), text)
        moment = time.fromisoformat(text.removesuffix("Z"))
        if moment.tzinfo is not None:
            raise ValueError
        since = ((moment.hour * 60 + moment.minute) * 60 + moment.second) * 10**9 + moment.microsecond * 1000
    except (ValueError, OverflowError):
        raise UsageError(f"time '{whole}': '{text}' is no time", hint=f"a time is {FORMS}") from None
    return Bound("day", since, text)


def _iso_ns(text: str) -> int:
    moment = datetime.fromisoformat(text)
    moment = moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment
    since = moment - EPOCH
    since_ns = (since.days * 86_400 + since.seconds) * 10**9 + since.microseconds * 1000
    return max(-FOREVER, min(since_ns, FOREVER))
