"""Range scales, silences, losses, and what is too much for a turn."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from maritrack.io.turns import stream
from maritrack.io.turns.assemble import Assembler
from maritrack.io.turns.spokes import lost_records
from maritrack.types import take
from tests.io.spins import OCTETS, codes, cuts_of, radials, spin, turns_of


def test_a_new_range_scale_ends_the_turn_and_begins_a_segment() -> None:
    of = spin(3.0)
    of.cell_dur[80:] *= 2
    cuts = cuts_of(of)
    assert [(cut.turn.segment, len(cut.turn.t_ns)) for cut in cuts if cut.turn] == [(0, 64), (0, 16), (1, 64), (1, 48)]
    assert codes(cuts) == ["range-change"]


def test_a_new_range_scale_with_other_cells_is_one_change() -> None:
    of = spin(4.0, n_cells=9)
    of.cell_dur[128:] *= 3
    of.n_cells[:128] = 4
    cuts = cuts_of(of, range(0, 256, 7))
    assert [cut.turn.segment for cut in cuts if cut.turn] == [0, 0, 1, 1]
    assert codes(cuts) == ["range-change"]


def test_a_new_range_scale_just_after_the_seam_leaves_no_scan_of_a_few_spokes() -> None:
    of = spin(3.0)
    of.start_rg[66:] = 9
    cuts = cuts_of(of)
    assert [len(cut.turn.t_ns) for cut in cuts if cut.turn] == [64, 64, 62]
    assert codes(cuts) == ["short-scan", "range-change"]


def test_a_single_spoke_of_another_range_scale_is_left_out() -> None:
    of = spin(2.0)
    of.cell_dur[30] *= 2
    cuts = cuts_of(of)
    assert [len(cut.turn.t_ns) for cut in cuts if cut.turn] == [63, 64]
    assert codes(cuts) == ["odd-range"]


def test_two_range_scales_spoke_by_spoke_give_the_scans_of_one() -> None:
    of = spin(2.0)
    of.cell_dur[1::2] *= 2
    assert [len(turn.t_ns) for turn in turns_of(of)] == [32, 32]


def test_more_cells_from_a_turn_on_are_a_new_segment() -> None:
    of = spin(4.0, n_cells=9)
    of.n_cells[:128], of.cells[:128, 4:] = 4, 0
    cuts = cuts_of(of)
    turns = [cut.turn for cut in cuts if cut.turn is not None]
    assert [(turn.segment, turn.cells.shape[1]) for turn in turns] == [(0, 4), (0, 4), (1, 9), (1, 9)]
    assert codes(cuts) == ["range-change"]


def test_spokes_cut_off_after_their_last_echo_are_filled_with_zeros() -> None:
    of = spin(1.0, n_cells=9)
    of.n_cells[:] = 1 + np.arange(64) % 7
    (turn,) = turns_of(of)
    assert turn.cells.shape == (64, 7)
    assert_array_equal(turn.spokes["n_cells"], of.n_cells)


def test_batches_of_different_width_are_filled_with_zeros(monkeypatch: pytest.MonkeyPatch) -> None:
    of = spin(1.0, n_cells=9)
    of.n_cells[:32], of.cells[:32, 4:] = 4, 0
    assembler = Assembler()
    narrow = take(of, np.arange(32))
    monkeypatch.setattr(np, "empty", lambda shape, dtype: np.full(shape, 7, dtype))
    cuts = [*assembler.push(replace(narrow, cells=narrow.cells[:, :4])), *assembler.push(take(of, np.arange(32, 64)))]
    (turn,) = [cut.turn for cut in [*cuts, *assembler.finish()] if cut.turn]
    assert_array_equal(turn.cells, of.cells)


def test_more_than_half_of_all_indices_lost_is_a_restart() -> None:
    half, first = 1 << 31, 77
    idx = np.array([first, first + half + 1, first, first + half + 2, (1 << 32) - 1, 4, -1, 9])
    assert lost_records(idx, None).tolist() == [0, half, half - 2, 0, half - 81, 4, 0, 0]
    assert lost_records(np.array([half + 5]), 4).tolist() == [half]
    assert lost_records(np.array([half + 6]), 4).tolist() == [0]


def test_lost_records_are_counted_once_a_turn_at_the_first_place() -> None:
    of = spin(2.0)
    of.idx[10:] += 3
    of.idx[20:] += 5
    of.idx[100:] += 1
    first, second = cuts_of(of)
    assert [(d.code, d.offset, d.message, d.sensor) for d in first.damage] == [
        ("lost-records", 500, "8 records missing by MSG_INDEX", "7-42")
    ]
    assert [(d.code, d.offset) for d in second.damage] == [("lost-records", 5000)]


@pytest.mark.parametrize(
    "idx",
    [
        (np.arange(64) + 2**32 - 30) % 2**32,  # cycles
        np.arange(64) % 40,  # a restart
        np.zeros(64, np.int64),  # not used
    ],
    ids=["cycle", "restart", "unused"],
)
def test_an_index_that_cycles_or_restarts_is_no_loss(idx: np.ndarray[Any, Any]) -> None:
    assert codes(cuts_of(spin(1.0, idx=idx))) == []


def test_a_silence_begins_a_segment() -> None:
    of = spin(3.0, period_s=2.5)
    of.tod[100:] += 11 * 128
    cuts = cuts_of(of)
    assert [(cut.turn.segment, len(cut.turn.t_ns)) for cut in cuts if cut.turn] == [(0, 64), (0, 36), (1, 64), (1, 28)]
    assert codes(cuts) == ["gap"]


def test_a_silence_shorter_than_three_turns_of_a_slow_antenna_is_none() -> None:
    of = spin(3.0, period_s=10.0)
    of.tod[100:] += 11 * 128
    assert codes(cuts_of(of)) == []


def test_more_sensors_than_a_site_can_have_are_left_out_aloud() -> None:
    of = spin(4.0)
    of.sic[:] = np.arange(len(of))
    cuts = cuts_of(of)
    assert codes(cuts).count("too-many-sensors") == 256 - 64


def test_an_antenna_that_stands_still_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "MAX_SPOKES", 100)
    cuts = cuts_of(radials(np.full(250, 77)), [30, 140])
    assert [cut.offset for cut in cuts] == [100 * OCTETS, 200 * OCTETS, 249 * OCTETS]
    assert [len(cut.turn.t_ns) if cut.turn else 0 for cut in cuts] == [1, 1, 0]
    assert "scan-overlong" in codes(cuts)


def test_one_wide_spoke_does_not_blow_up_a_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "MAX_CELLS", 600)
    of = spin(1.0, n_cells=50)
    of.n_cells[:] = 4
    of.n_cells[40] = 50
    assert all(turn.cells.size <= 600 for turn in turns_of(of))


def test_after_two_minutes_a_turn_is_cut_off() -> None:
    of = radials(np.arange(64) * 100, tod=np.arange(64) * 128 * 5)
    assert [len(turn.t_ns) for turn in turns_of(of)] == [25, 25]


def test_a_few_spokes_do_not_keep_a_large_batch_in_memory() -> None:
    of = spin(2.0, n_cells=1000)
    of.sic[:120] = 43
    assembler = Assembler()
    list(assembler.push(of))
    kept = sum(block.nbytes for s in assembler._streams.values() for block, _ in s._open.pieces if s.sensor == "7-42")
    assert kept <= 8 * of.cells[0].nbytes
