"""Where turns begin and end, and that no spoke is lost on the way."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from maritrack.io.cat240.radials import Radials
from maritrack.io.turns.stitch import join
from maritrack.io.turns.turn import Cut
from maritrack.types import take
from tests.io.spins import OCTETS, TURN, codes, cuts_of, numbers, radials, spin, turns_of

laws = settings(derandomize=True, deadline=None, max_examples=60)


def plain(cuts: Iterable[Cut]) -> list[Any]:
    """All that cuts say, in a form that can be compared."""
    said: list[Any] = []
    for cut in cuts:
        said.append((cut.offset, cut.damage))
        if cut.turn is not None:
            turn = cut.turn
            said.append((turn.sensor, turn.segment, turn.t_ns.tolist(), turn.cells.tolist(), turn.spokes.tolist()))
    return said


def test_a_turn_holds_each_azimuth_once_and_turns_follow_each_other() -> None:
    turns = turns_of(spin(3.0))
    assert [numbers(turn) for turn in turns] == [list(range(64 * i, 64 * i + 64)) for i in range(3)]


@pytest.mark.parametrize("begin", [0, 1, 32_768, 65_535])
def test_where_the_antenna_points_at_the_beginning_does_not_matter(begin: int) -> None:
    assert [numbers(t) for t in turns_of(spin(3.0, begin=begin))] == [numbers(t) for t in turns_of(spin(3.0))]


def test_an_antenna_may_turn_the_other_way_round() -> None:
    turns = turns_of(radials(-np.arange(192) * 1024, width=0))
    assert [len(turn.t_ns) for turn in turns] == [64, 64, 64]


@given(
    steps=st.lists(st.integers(-2000, 12_000), min_size=1, max_size=150),
    ticks=st.lists(st.integers(-3, 40), min_size=150, max_size=150),
    at=st.lists(st.integers(0, 150), max_size=8),
    rare=st.lists(st.tuples(st.integers(0, 149), st.sampled_from(["start_az", "cell_dur", "tod", "idx"])), max_size=5),
    senders=st.integers(1, 3),
)
@laws
def test_how_the_input_is_cut_into_batches_changes_nothing(
    steps: list[int], ticks: list[int], at: list[int], rare: list[tuple[int, str]], senders: int
) -> None:
    n = len(steps)
    spoilt = radials(np.cumsum(steps), width=91, tod=100 + np.cumsum(ticks[:n]), sic=42 + np.arange(n) % senders)
    for row, name in rare:
        getattr(spoilt, name)[row % n] += 30_000 if name != "start_az" else TURN // 3
    spoilt.start_az[:] %= TURN
    np.maximum(spoilt.tod, -1, out=spoilt.tod)
    assert plain(cuts_of(spoilt, [min(i, n) for i in at])) == plain(cuts_of(spoilt))
    assert plain(cuts_of(spoilt, range(n))) == plain(cuts_of(spoilt))


@given(steps=st.lists(st.integers(0, 4000), min_size=20, max_size=300), width=st.integers(0, 200))
@laws
def test_every_spoke_is_in_one_turn_or_came_again_or_is_counted_as_too_few(steps: list[int], width: int) -> None:
    of = radials(np.cumsum(steps), width=width)
    cuts = cuts_of(of)
    delivered = [i for cut in cuts if cut.turn is not None for i in numbers(cut.turn)]
    assert delivered == sorted(set(delivered))
    told = [d.message for cut in cuts for d in cut.damage if d.code in ("repeated-spoke", "short-scan")]
    assert len(delivered) + sum(int(message.split()[0]) for message in told) == len(of)


@given(steps=st.lists(st.integers(-1500, 8000), min_size=20, max_size=300))
@laws
def test_no_azimuth_comes_twice_in_a_turn(steps: list[int]) -> None:
    for turn in turns_of(radials(np.cumsum(steps), width=91)):
        assert len(np.unique(turn.spokes["start_az"])) == len(turn.spokes)


@given(azimuths=st.lists(st.integers(0, TURN - 1), min_size=1, max_size=400))
@laws
def test_azimuths_without_sense_are_taken_without_complaint(azimuths: list[int]) -> None:
    cuts = cuts_of(radials(azimuths))
    assert sum(len(cut.turn.t_ns) for cut in cuts if cut.turn is not None) <= len(azimuths)
    assert [cut.offset for cut in cuts] == sorted(cut.offset for cut in cuts)


def test_a_step_back_stays_in_its_turn() -> None:
    az = np.arange(192) * 1024
    az[70:] -= 2048  # two steps back, near the seam
    assert [len(turn.t_ns) for turn in turns_of(radials(az))] == [64, 64, 62]


def test_jitter_at_the_seam_does_not_end_a_turn() -> None:
    az = 100 + np.arange(192) * 1024
    az[64::64] -= 300  # just before north, again after it
    assert len(turns_of(radials(az, width=1024))) == 3


def test_of_spokes_with_equal_azimuths_the_last_counts() -> None:
    of = radials(np.repeat(np.arange(64) * 1024, [1] * 9 + [3] + [1] * 54), width=1024)
    (cut,) = cuts_of(of)
    assert cut.turn is not None
    assert numbers(cut.turn) == [i for i in range(66) if i not in (9, 10)]
    assert codes([cut]) == ["no-time", "repeated-spoke"]


@pytest.mark.parametrize("blanked", [8, 20, 31, 33, 45, 54])
def test_a_blanked_sector_of_any_width_leaves_one_turn_a_rotation(blanked: int) -> None:
    of = spin(5.0)
    turns = turns_of(take(of, np.flatnonzero(np.arange(len(of)) % 64 >= blanked)))
    assert [len(turn.t_ns) for turn in turns] == [64 - blanked] * 5


@pytest.mark.parametrize("blanked", [8, 31, 45, 54])
def test_a_blanked_sector_is_passed_over_the_other_way_round_too(blanked: int) -> None:
    number = np.arange(320)
    turns = turns_of(radials(-number[number % 64 >= blanked] * 1024))
    assert [len(turn.t_ns) for turn in turns] == [64 - blanked] * 5


@pytest.mark.parametrize("row", [5, 40, 63, 65, 100])
@pytest.mark.parametrize("by", [12_000, 30_000, 36_000, 50_000])
def test_one_wrong_azimuth_does_not_move_the_ends_of_turns(row: int, by: int) -> None:
    of = spin(3.0)
    of.start_az[row] = (of.start_az[row] + by) % TURN
    cuts = cuts_of(of)
    assert [cut.offset for cut in cuts] == [cut.offset for cut in cuts_of(spin(3.0))]
    assert codes(cuts) == ["stray-azimuth"]


def test_cells_arrive_as_sent_whatever_the_batches() -> None:
    of = spin(2.0, n_cells=20)
    of.cells[:] = np.random.default_rng(1).integers(0, 60_000, of.cells.shape)
    for at in ([], [30, 31, 90], range(128)):
        assert_array_equal(np.concatenate([turn.cells for turn in turns_of(of, at)]), of.cells)


def test_sensors_in_one_input_do_not_touch_each_other() -> None:
    one, two = spin(3.0, begin=999), spin(3.0, per_turn=48, begin=5)
    order = np.argsort(np.concatenate([np.arange(192) / 64, np.arange(144) / 48]), kind="stable")
    both = _mix(one, two, order)
    cuts = cuts_of(both)
    assert [cut.turn.sensor for cut in cuts if cut.turn] == ["7-42", "8-42", "7-42", "8-42", "8-42", "7-42"]
    alone = [numbers(turn) for turn in turns_of(one)]
    assert [numbers(cut.turn) for cut in cuts if cut.turn and cut.turn.sensor == "7-42"] == alone
    assert [len(cut.turn.t_ns) for cut in cuts_of(both, sensor="8-42") if cut.turn] == [48, 48, 48]
    assert codes(cuts) == []


def _mix(one: Radials, two: Radials, order: np.ndarray[Any, Any]) -> Radials:
    two.sac[:] = 8
    return replace(take(join(one, two), order), offset=np.arange(len(order)) * OCTETS)
