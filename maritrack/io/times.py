"""Times of documents as int64 nanoseconds: since 1970, or since midnight where there is no date."""

from __future__ import annotations

from datetime import UTC, date, datetime, timedelta

import numpy as np

from maritrack.errors import InputError
from maritrack.types import BoolArray, FloatArray, IntArray

DAY_S = 86_400
DAY_NS = DAY_S * 1_000_000_000
YEAR_NS = 365 * DAY_NS  # earlier times count from a midnight: the day is unknown
MAX_S = 9.2e9  # beyond this nanoseconds leave an int64
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def seconds_to_ns(time_s: FloatArray) -> IntArray:
    """Nanoseconds of seconds, rounded to the microsecond: what a double can tell of today's times.

    Not finite or beyond `MAX_S`: the caller looks first (`usable_time`).
    """
    whole = np.floor(time_s)
    micro = np.rint((np.asarray(time_s, float) - whole) * 1e6)
    return np.asarray(whole.astype(np.int64) * 1_000_000_000 + micro.astype(np.int64) * 1000, dtype=np.int64)


def usable_time(time_s: FloatArray) -> BoolArray:
    """Which seconds are finite and fit into int64 nanoseconds."""
    return np.asarray(np.abs(np.nan_to_num(time_s, nan=np.inf)) < MAX_S)


def day_start_ns(day: str, *, name: str) -> int:
    """Midnight UTC at the beginning of an ISO day; 0 for "", the day of recordings without a date."""
    if not day:
        return 0
    try:
        return (date.fromisoformat(day) - date(1970, 1, 1)).days * DAY_NS
    except ValueError:
        raise InputError(f"{name}: date '{day}' is not a day as in 2016-01-12") from None


def iso_to_s(text: str) -> float:
    """Seconds since 1970 of an ISO 8601 time (UTC unless it says otherwise); nan where it is none."""
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return float("nan")
    moment = moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment
    return (moment - EPOCH).total_seconds()


def unroll_midnight(time_s: FloatArray) -> FloatArray:
    """Times of day in the order of their recording, a day added after each step back of over 12 h."""
    if len(time_s) == 0:
        return time_s
    step = np.diff(time_s)
    days = np.concatenate([[0], np.cumsum((step < -DAY_S / 2).astype(int) - (step > DAY_S / 2).astype(int))])
    return np.asarray(time_s + DAY_S * days, dtype=np.float64)


def join_midnight(time_s: FloatArray) -> FloatArray:
    """Times of day in any order, those after midnight moved to the next day.

    A recording of less than 12 h leaves most of the day empty. Where that empty stretch lies inside
    0..24 h instead of around midnight, what comes before it is the next day.
    """
    known = np.unique(time_s)
    if len(known) < 2 or known[-1] > DAY_S:
        return time_s
    gaps = np.diff(known)
    widest = int(np.argmax(gaps))
    if gaps[widest] <= DAY_S / 2:
        return time_s
    return np.where(time_s <= known[widest], time_s + DAY_S, time_s)


def time_text(t_ns: int) -> str:
    """A time as ISO 8601, without a date where it is only the time of day."""
    moment = datetime.fromtimestamp(0, UTC) + timedelta(microseconds=t_ns // 1000)
    if t_ns >= YEAR_NS:
        return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")
    return moment.time().isoformat(timespec="milliseconds")
