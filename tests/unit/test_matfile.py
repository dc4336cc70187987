"""MATLAB 5 files, against what another writer puts into them."""

from __future__ import annotations

import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.io import savemat

from maritrack.errors import InputError
from maritrack.io import matfile
from maritrack.io.matfile import read_mat


def written(value, *, compressed=True):
    file = io.BytesIO()
    savemat(file, {"x": value}, do_compression=compressed)
    return file.getvalue()


kinds = st.sampled_from(["f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"])


@settings(derandomize=True, deadline=None, max_examples=60)
@given(
    kinds.flatmap(lambda kind: hnp.arrays(kind, hnp.array_shapes(min_dims=2, max_dims=3, max_side=4))), st.booleans()
)
def test_arrays_come_back_without_dimensions_of_length_one(array, compressed):
    value = read_mat(written(array, compressed=compressed))["x"]
    np.testing.assert_array_equal(value, array.squeeze())
    assert np.shape(value) == array.squeeze().shape


def test_cells_structs_and_texts_come_back_as_lists_dictionaries_and_texts():
    cell = np.empty((1, 3), dtype=object)
    cell[0, :] = [{"a": 1.0, "b": "tekst"}, np.zeros((0, 0)), np.array([[1, 2]])]
    one, empty, pair = read_mat(written(cell))["x"]
    assert one == {"a": 1.0, "b": "tekst"}
    assert np.size(empty) == 0
    assert pair.tolist() == [1, 2]


def test_several_structs_are_a_list_in_columns_first():
    rows = np.zeros((2, 2), dtype=[("n", object)])
    for i, j in np.ndindex(2, 2):
        rows[i, j]["n"] = float(10 * i + j)
    assert read_mat(written(rows))["x"] == [{"n": 0.0}, {"n": 10.0}, {"n": 1.0}, {"n": 11.0}]


def test_texts_in_a_cell_are_a_list_of_texts():
    assert read_mat(written(np.array(["ab", "cd"], dtype=object)))["x"] == ["ab", "cd"]


def test_complex_numbers_are_refused():
    with pytest.raises(InputError, match="class 6"):
        read_mat(written(1 + 2j))


@pytest.mark.parametrize("data", [b"", b"MATLAB 5.0 MAT-file", b"\0" * 200])
def test_what_has_no_header_is_refused(data):
    with pytest.raises(InputError, match="not a MATLAB 5 file"):
        read_mat(data)


def deep(levels):
    value = np.zeros((1, 2))
    for _ in range(levels):
        cell = np.empty((1, 1), dtype=object)
        cell[0, 0] = value
        value = cell
    return value


def test_nesting_has_a_limit():
    assert len(read_mat(written(deep(5)))["x"]) == 1
    with pytest.raises(InputError, match="nested too deeply"):
        read_mat(written(deep(40)))


def test_a_bomb_is_not_inflated(monkeypatch):
    monkeypatch.setattr(matfile, "MAX_INFLATED", 100_000)
    assert len(read_mat(written(np.zeros((1, 10_000))))["x"]) == 10_000
    with pytest.raises(InputError, match="too large"):
        read_mat(written(np.zeros((1, 13_000))))


CELL = np.empty((1, 2), dtype=object)
CELL[0, :] = [{"a": 1.0, "b": "tekst"}, np.array([[1.5, 2.5], [3.5, 4.5]])]
SAMPLES = [written(CELL), written(CELL, compressed=False)]


@settings(derandomize=True, deadline=None, max_examples=400)
@given(st.sampled_from(SAMPLES), st.floats(0.0, 1.0), st.binary(max_size=5), st.integers(0, 5))
def test_a_damaged_file_is_read_or_refused(data, share, octets, removed):
    at = 124 + round(share * (len(data) - 124))
    try:
        read_mat(data[:at] + octets + data[at + removed :])
    except InputError as error:
        assert "\n" not in str(error)
