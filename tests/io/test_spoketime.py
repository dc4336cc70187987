"""Times of spokes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from maritrack.io.cat240.radials import Radials
from maritrack.io.turns.spokes import DayCount
from maritrack.io.turns.spoketime import TICK_NS
from tests.io.spins import cuts_of, radials, spin

DAY = 86_400 * 128
S = 1_000_000_000


def times(of: Radials) -> np.ndarray[Any, Any]:
    return np.concatenate([cut.turn.t_ns for cut in cuts_of(of) if cut.turn is not None])


@pytest.mark.parametrize("per_turn", [64, 720, 4096])
@pytest.mark.parametrize("period_s", [1.0, 2.5, 2.7183])
def test_spokes_of_an_even_antenna_are_placed_to_less_than_a_tick(per_turn: int, period_s: float) -> None:
    of = spin(3.0, per_turn=per_turn, period_s=period_s, tod=77)
    exact = 77 * TICK_NS + np.arange(len(of)) * period_s * S / per_turn
    error = times(of) - exact
    assert np.abs(error).max() < 1.01 * max(TICK_NS, period_s * S / per_turn)


def test_spokes_that_share_a_tick_are_spread_evenly() -> None:
    of = radials(np.arange(64) * 1024, tod=5 + np.arange(64) // 4)
    assert_array_equal(times(of), 5 * TICK_NS + np.arange(64) * TICK_NS // 4)


def test_spokes_sent_in_bursts_are_spread_up_to_the_next_burst() -> None:
    of = radials(np.arange(64) * 1024, tod=np.arange(64) // 16 * 100)
    assert_allclose(np.diff(times(of)), 100 * TICK_NS / 16, atol=1)


def test_a_run_of_equal_ticks_goes_on_across_the_seam() -> None:
    of = radials(np.arange(128) * 1024, tod=5 + np.arange(128) // 10)
    assert_allclose(times(of), 5 * TICK_NS + np.arange(128) * TICK_NS / 10, atol=1)


def test_a_pause_is_not_spread_over_the_spokes_before_it() -> None:
    tod = 5 + np.arange(64) // 4
    tod[30:] += 600
    t_ns = times(radials(np.arange(64) * 1024, tod=tod))
    assert t_ns[29] < 14 * TICK_NS
    assert t_ns[30] > 600 * TICK_NS


@given(ticks=st.lists(st.integers(-9, 30), min_size=30, max_size=200), unknown=st.integers(1, 9))
@settings(derandomize=True, deadline=None, max_examples=60)
def test_time_never_goes_back(ticks: list[int], unknown: int) -> None:
    tod = np.maximum(500 + np.cumsum(ticks), 0)
    tod[::unknown] = -1
    t_ns = times(radials(np.arange(len(tod)) * 2048, tod=tod))
    assert (np.diff(t_ns) >= 0).all()


def test_the_day_goes_on_after_midnight() -> None:
    of = spin(4.0, tod=DAY - 640)
    assert of.tod.min() < 640
    assert_array_equal(times(of), times(spin(4.0, tod=640)) + (DAY - 1280) * TICK_NS)


@pytest.mark.parametrize("at", [[], [130], [20, 129, 131]])
def test_a_sensor_that_joins_after_midnight_is_on_the_day_of_the_others(at: list[int]) -> None:
    of = spin(6.0, tod=DAY - 200)
    of.sic[128::2] += 1
    ends_ns = [int(cut.turn.t_ns[-1]) for cut in cuts_of(of, at) if cut.turn is not None]
    assert min(ends_ns) > (DAY - 200) * TICK_NS
    assert max(ends_ns) < (DAY + 2000) * TICK_NS


def test_records_out_of_order_at_midnight_are_not_a_day_apart() -> None:
    tod = np.array([DAY - 2, DAY - 1, 0, DAY - 1, 1, DAY - 1, 2, 3])
    tick, back, silence = DayCount().unwrap(tod, np.zeros(8, bool))
    assert_array_equal(tick, [DAY - 2, DAY - 1, DAY, DAY - 1, DAY + 1, DAY - 1, DAY + 2, DAY + 3])
    assert not back.any()
    assert silence.max() < 5


def test_one_wrong_time_of_day_is_passed_over() -> None:
    of = spin(3.0)
    of.tod[70] += 3600 * 128
    assert_allclose(times(of), times(spin(3.0)), atol=5 * TICK_NS)
    assert all(not cut.damage for cut in cuts_of(of))


def test_a_clock_that_is_set_back_goes_on_from_where_it_was() -> None:
    of = spin(3.0, tod=128 * 5000)
    of.tod[100:] -= 3600 * 128
    t_ns = times(of)
    assert_allclose(t_ns[:100], times(spin(3.0, tod=128 * 5000))[:100])
    assert np.diff(t_ns).max() < S
    assert [d.code for cut in cuts_of(of) for d in cut.damage] == ["clock-back"]


def test_without_a_clock_a_turn_is_assumed_to_take_two_and_a_half_seconds() -> None:
    cuts = cuts_of(radials(np.arange(192) * 1024, width=1024))
    t_ns = np.concatenate([cut.turn.t_ns for cut in cuts if cut.turn is not None])
    assert_allclose(t_ns, np.arange(192) * 2.5 * S / 64, atol=1)
    assert [d.code for cut in cuts for d in cut.damage] == ["no-time"]
    assert "2.5 s" in cuts[0].damage[0].message


def test_a_clock_that_falls_silent_is_continued_at_the_speed_it_showed() -> None:
    of = spin(5.0, period_s=4.0)
    exact = times(of)
    of.tod[150:] = -1
    assert_allclose(times(of), exact, atol=3 * TICK_NS)


def test_a_clock_that_stands_still_is_said_to_be_no_clock() -> None:
    cuts = cuts_of(spin(3.0, period_s=0.0))
    t_ns = np.concatenate([cut.turn.t_ns for cut in cuts if cut.turn is not None])
    assert_allclose(np.diff(t_ns), 2.5 * S / 64, rtol=0.03)
    assert [d.code for cut in cuts for d in cut.damage] == ["no-time"]
