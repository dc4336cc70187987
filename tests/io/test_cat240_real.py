"""Recordings of real radars."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from maritrack.io.cat240.reader import file_chunks, read_batches
from maritrack.io.dump import dump_records
from tests.shared import shared


def test_the_solent_recording_holds_the_spokes_that_it_was_made_of() -> None:
    batches = list(read_batches(file_chunks(shared("data/marce_solent/run_01_005/solent_01_005.cat240"))))
    spokes = np.load(shared("data/marce_solent/run_01_005/spokes.npz"))["video"]
    found = [batch.radials for batch in batches if batch.radials is not None]
    cells = np.concatenate([of.cells for of in found])
    assert cells.shape == (174_608, 170)
    assert_array_equal(cells, spokes.reshape(-1, 170))
    assert all(batch.damage == () for batch in batches)
    assert {(int(of.bits.max()), int(of.sac[0]), int(of.sic[0])) for of in found} == {(8, 7, 42)}
    assert np.concatenate([of.cell_m for of in found]) == pytest.approx(44.018, abs=1e-3)


def test_two_genuine_blocks_with_vendor_items_are_read() -> None:
    octets = shared("data/cat240/genuine_two_blocks.ast").read_bytes()
    rows = list(dump_records([octets], cells=True))
    assert [(row["start_rg"], row["nbcells"], len(row["cells"]), len(row["sp_hex"]) // 2) for row in rows] == [
        (1280, 1280, 1280, 24),
        (2560, 864, 864, 24),
    ]
    assert [round(row["start_az_deg"], 3) for row in rows] == [158.395, 170.997]
    assert rows[0]["cell_dur"] == 1_169_062
