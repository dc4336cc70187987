"""Times of documents: units, calendars and midnights."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.errors import InputError
from maritrack.io.csvtable import read_table, times_s
from maritrack.io.times import day_start_ns, iso_to_s, join_midnight, seconds_to_ns, unroll_midnight, usable_time


@settings(derandomize=True, deadline=None)
@given(st.integers(0, 2_000_000_000), st.integers(0, 999_999))
def test_microseconds_survive_the_way_through_seconds(second, micro):
    t_ns = second * 1_000_000_000 + micro * 1000
    assert int(seconds_to_ns(np.array(t_ns / 1e9))) == t_ns


def test_times_that_no_nanoseconds_can_hold_are_not_usable():
    assert usable_time(np.array([0.0, 1.6e9, 1e300, np.nan, -np.inf])).tolist() == [True, True, False, False, False]


def test_a_day_begins_at_its_midnight_and_no_day_at_zero():
    assert day_start_ns("", name="x") == 0
    assert day_start_ns("2016-01-12", name="x") == 1_452_556_800 * 10**9
    with pytest.raises(InputError, match=r"rec: date .* is not a day"):
        day_start_ns("12.1.2016", name="rec")


def test_a_step_back_by_most_of_a_day_is_midnight_and_a_small_one_is_not():
    assert unroll_midnight(np.array([86399.0, 1.0, 0.5, 86399.9, 2.0])).tolist() == [
        86399.0, 86401.0, 86400.5, 86399.9, 86402.0,
    ]  # fmt: skip


@settings(derandomize=True, deadline=None)
@given(st.permutations([86390.0, 86395.0, 86399.0, 1.0, 30.0]))
def test_midnight_is_found_in_any_order(times):
    joined = join_midnight(np.array(times))
    assert sorted(joined.tolist()) == [86390.0, 86395.0, 86399.0, 86401.0, 86430.0]


def test_times_of_one_day_stay():
    times = np.array([10.0, 3000.0, 45000.0, 45001.0])
    assert join_midnight(times) is times


@pytest.mark.parametrize(
    ("column", "cell", "seconds"),
    [
        ("time_s", "1452603731.218", 1452603731.218),
        ("timestamp", "1452603731218", 1452603731.218),
        ("t", "1452603731218000", 1452603731.218),
        ("Time", "2016-01-12 13:02:11.218", 1452603731.218),
        ("BaseDateTime", "2016-01-12T13:02:11.218Z", 1452603731.218),
        ("timestamp", "2016-01-12T15:02:11.218+02:00", 1452603731.218),
        ("# Timestamp", "12/01/2016 13:02:11", 1452603731.0),
        ("Time", "12.01.2016 13:02:11", 1452603731.0),
    ],
)
def test_times_are_read_in_many_forms(column, cell, seconds):
    time_s, of_day = times_s(read_table(f"{column};x\n{cell};1\n".encode(), name="x"))
    assert time_s[0] == pytest.approx(seconds, abs=1e-6)
    assert not of_day


def test_seconds_of_the_day_have_no_date():
    time_s, of_day = times_s(read_table(b"time_s_utc_of_day,x\n45074.955,1\nrubbish,2\n", name="x"))
    assert of_day
    assert time_s[0] == 45074.955
    assert np.isnan(time_s[1])


def test_what_is_no_time_is_nan():
    assert np.isnan(iso_to_s("yesterday"))
