"""Radials sent in parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from maritrack.io.cat240.radials import Radials
from maritrack.io.turns import stitch as module
from maritrack.io.turns.stitch import continues, stitch
from maritrack.types import take
from tests.io.spins import radials, spin, turns_of


def parts_of(whole: Radials, parts: list[int]) -> Radials:
    """Each radial sent in messages of so many cells."""
    n, k = len(whole), len(parts)
    row = np.repeat(np.arange(n), k)
    at = np.tile(np.cumsum([0, *parts[:-1]]), n)
    size = np.tile(parts, n)
    cells = np.zeros((n * k, max(parts)), whole.cells.dtype)
    for i in range(n * k):
        cells[i, : size[i]] = whole.cells[row[i], at[i] : at[i] + size[i]]
    made = radials(whole.start_az[row], tod=whole.tod[row], idx=np.arange(n * k) + 7)
    return replace(made, end_az=whole.end_az[row], start_rg=at, n_cells=size, cells=cells)


def noise(turns: float = 1.0, n_cells: int = 12) -> Radials:
    of = spin(turns, n_cells=n_cells)
    of.cells[:] = np.random.default_rng(3).integers(1, 60_000, of.cells.shape)
    return of


@pytest.mark.parametrize("parts", [[12], [6, 6], [5, 4, 3], [1, 11], [4, 4, 4]])
def test_parts_give_the_radial_they_were_cut_from(parts: list[int]) -> None:
    whole = noise()
    split = parts_of(whole, parts)
    put, first = stitch(split, continues(split))
    assert_array_equal(put.cells, whole.cells)
    assert_array_equal(put.n_cells, whole.n_cells)
    assert_array_equal(put.start_rg, whole.start_rg)
    assert_array_equal(first, np.arange(len(whole)) * len(parts))


@given(at=st.lists(st.integers(0, 192), max_size=9), parts=st.sampled_from([[6, 6, 0], [5, 4, 3], [1, 2, 9]]))
@settings(derandomize=True, deadline=None, max_examples=40)
def test_parts_find_each_other_across_batches(at: list[int], parts: list[int]) -> None:
    whole = noise()
    (turn,) = turns_of(parts_of(whole, parts), at)
    assert_array_equal(turn.cells, whole.cells)


def test_parts_one_batch_each_are_put_together() -> None:
    whole = noise(2.0)
    split = parts_of(whole, [5, 4, 3])
    first, second = turns_of(split, range(len(split)))
    assert_array_equal(np.concatenate([first.cells, second.cells]), whole.cells)


@pytest.mark.parametrize("name", ["start_az", "end_az", "cell_dur", "femto", "idx"])
def test_what_differs_in_the_header_is_another_radial(name: str) -> None:
    split = parts_of(noise(), [6, 6])
    column = getattr(split, name)
    column[1] = not column[1] if name == "femto" else column[1] + 1
    assert not continues(split)[1]
    assert continues(split)[3]


def test_an_index_that_cycles_within_a_radial_does_no_harm() -> None:
    split = parts_of(noise(), [6, 6])
    split.idx[:] = (split.idx + 2**32 - 8) % 2**32
    assert continues(split).sum() == 64


def test_radials_without_parts_stay_as_they_are() -> None:
    whole = spin(1.0)
    assert stitch(whole, continues(whole))[0] is whole


def test_parts_of_sensors_that_take_turns_are_put_together() -> None:
    split = parts_of(noise(), [6, 6])
    sic = np.repeat(split.sic, 2)
    sic[1::2] += 1
    both = replace(take(split, np.repeat(np.arange(len(split)), 2)), sic=sic)
    one, other = turns_of(both, [3, 50, 51])
    assert_array_equal(one.cells, noise().cells)
    assert_array_equal(other.cells, noise().cells)


def test_a_radial_does_not_grow_without_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_RADIAL_CELLS", 100)
    n = 200
    split = replace(radials(np.full(n, 5)), start_rg=np.arange(n) * 4)
    put, _ = stitch(split, continues(split))
    assert len(put) == n


def test_radials_without_cells_are_not_parts_of_each_other() -> None:
    assert not continues(radials(np.full(9, 5), n_cells=0)).any()
