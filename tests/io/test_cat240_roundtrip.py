"""What is written is read: every representable record, and a few put together by hand."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from maritrack.errors import UsageError
from maritrack.io.cat240.cells import unpack
from maritrack.io.cat240.encode import encode_summary, encode_video, pack_cells
from maritrack.io.dump import dump_records
from tests.io.cat240_blocks import codes, radials, read

U32 = 2**32 - 1
MOST_OCTETS = 65_024
GOOD: dict[str, Any] = {
    "sac": 1,
    "sic": 2,
    "idx": 3,
    "start_az": 4,
    "end_az": 20,
    "start_rg": 5,
    "cell_dur": 66_712_819,
}


@st.composite
def videos(draw: st.DrawFn) -> dict[str, Any]:
    """The arguments of a record that the reader has nothing to say about."""
    bits = draw(st.sampled_from([1, 2, 4, 8, 16, 32]))
    compress = draw(st.booleans())
    octets = draw(st.sampled_from([0, 1, 7, 60, 1000, 1020, 1021, 4000, 16_320, 16_321, 30_000]))
    n = max(0, octets * 8 // bits - draw(st.integers(0, 3)))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    start_az = draw(st.integers(0, 65_535))
    return {
        "sac": draw(st.integers(0, 255)), "sic": draw(st.integers(0, 255)), "idx": draw(st.integers(0, U32)),
        "start_az": start_az, "end_az": (start_az + draw(st.integers(0, 32_768))) % 65_536,
        "start_rg": draw(st.integers(0, U32)), "cell_dur": draw(st.integers(1, U32)), "femto": draw(st.booleans()),
        "bits": bits, "compress": compress, "tod": draw(st.none() | st.integers(0, 11_059_199)),
        "re": draw(st.none() | st.binary(max_size=254)), "sp": draw(st.none() | st.binary(max_size=20)),
        "cells": rng.integers(0, 1 << min(bits, draw(st.sampled_from([1, 3, 32]))), n, dtype=np.uint32),
    }  # fmt: skip


@given(videos(), st.booleans())
@settings(derandomize=True, deadline=None, max_examples=200)
def test_a_record_comes_back_as_it_was_written(written: dict[str, Any], fast: bool) -> None:
    octets = encode_video(**written)
    batches = read(octets * (9 if fast else 1), fast=fast)  # nine blocks are enough for the fast way
    assert codes(batches) == (["duplicate"] if fast else [])
    (of,) = radials(batches)
    for name in ("sac", "sic", "idx", "start_az", "end_az", "start_rg", "cell_dur", "femto"):
        assert getattr(of, name).tolist() == [written[name]]
    assert of.tod.tolist() == [-1 if written["tod"] is None else written["tod"]]
    assert (of.bits.tolist(), of.compressed.tolist()) == ([written["bits"]], [written["compress"]])
    assert of.cells.dtype == np.dtype(f"u{max(8, int(of.bits[0])) // 8}")
    assert of.n_cells.tolist() == [len(written["cells"])]
    assert_array_equal(of.cells[0], written["cells"])


@given(videos())
@settings(derandomize=True, deadline=None, max_examples=60)
def test_dump_shows_what_was_written(written: dict[str, Any]) -> None:
    (row,) = dump_records([encode_video(**written)], cells=True)
    assert row["cells"] == written["cells"].tolist()
    assert row["header"] == ("femto" if written["femto"] else "nano")
    for name in ("sac", "sic", "idx", "start_az", "end_az", "start_rg", "cell_dur", "bits"):
        assert row[name] == written[name]
    assert row.get("tod") == written["tod"]
    for name, octets in (("re_hex", written["re"]), ("sp_hex", written["sp"])):
        assert row.get(name) == (None if octets is None else octets.hex())


@given(st.binary(max_size=255).map(lambda octets: bytes(one & 0x7F for one in octets)), st.none() | st.integers(0, 999))
@settings(derandomize=True, deadline=None)
def test_a_summary_comes_back(text: bytes, tod: int | None) -> None:
    (row,) = dump_records([encode_summary(sac=9, sic=8, text=text, tod=tod)])
    shown = "".join(c if (c >= " " and c != "\x7f") or c in "\t\n\r" else "\ufffd" for c in text.decode())
    assert (row["type"], row["sac"], row["sic"], row["summary"], row.get("tod")) == (1, 9, 8, shown, tod)


@pytest.mark.parametrize("n", [65_024, 65_024 * 2])
def test_the_largest_block_takes_65024_octets(n: int) -> None:
    cells = np.arange(n, dtype=np.uint8) % 16
    octets = encode_video(**GOOD, cells=cells, bits=8 * MOST_OCTETS // n)
    assert len(octets) == 3 + 2 + 26 + 1 + MOST_OCTETS
    assert_array_equal(radials(read(octets))[0].cells[0], cells)


def test_compressed_cells_may_be_many_more_than_octets() -> None:
    cells = np.zeros(524_288, dtype=np.uint32)
    (of,) = radials(read(encode_video(**GOOD, cells=cells, bits=32, compress=True)))
    assert of.cells.shape == (1, 524_288)


@pytest.mark.parametrize(
    "wrong",
    [
        {"sac": 256}, {"sic": -1}, {"idx": 2**32}, {"start_az": 65_536}, {"end_az": -1}, {"start_rg": 2**32},
        {"cell_dur": 0}, {"cell_dur": 2**32}, {"bits": 3}, {"tod": 11_059_200}, {"sp": bytes(255)}, {"re": bytes(255)},
        {"cells": np.array([256])}, {"cells": np.array([-1])}, {"cells": np.array([4]), "bits": 2},
        {"cells": np.array([0.5])}, {"cells": np.zeros((2, 2), dtype=np.uint8)},
        {"cells": np.zeros(65_025, dtype=np.uint8)}, {"cells": np.zeros(524_289, dtype=np.uint8), "compress": True},
        {"cells": np.zeros(65_024, dtype=np.uint8), "sp": bytes(254), "re": bytes(254)},
    ],
)  # fmt: skip
def test_what_has_no_place_in_the_format_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(UsageError):
        encode_video(**{**GOOD, "cells": np.zeros(4, dtype=np.uint8), **wrong})


@pytest.mark.parametrize("text", [bytes(256), b"\xff"])
def test_a_summary_that_has_no_place_is_refused(text: bytes) -> None:
    with pytest.raises(UsageError):
        encode_summary(sac=0, sic=0, text=text)


@pytest.mark.parametrize(
    ("bits", "octets", "cells"),
    [
        (1, "b2e8", [1, 0, 1, 1, 0, 0, 1, 0, 1, 1, 1, 0, 1]),
        (2, "1be4", [0, 1, 2, 3, 3, 2, 1]),
        (4, "1f80", [1, 15, 8]),
        (8, "00ff10", [0, 255, 16]),
        (16, "1234ffff", [0x1234, 0xFFFF]),
        (32, "0102030480000000", [0x01020304, 0x80000000]),
    ],
)
def test_the_first_cell_has_the_most_significant_bits(bits: int, octets: str, cells: list[int]) -> None:
    assert pack_cells(np.array(cells), bits=bits).hex() == octets
    packed = np.frombuffer(bytes.fromhex(octets), dtype=np.uint8)[None, :]
    assert unpack(packed, bits=bits, n=len(cells)).tolist() == [cells]


def test_a_record_written_by_hand_is_read() -> None:
    # block of 43; FSPEC; 010 25/201; 000 video; 020 index; 041 azimuth 300 to 310, from cell 7, 66712819 fs;
    # 048 raw, 8 bit; 049 five octets, five cells; 050 two times four; 140 one second after midnight
    octets = bytes.fromhex(
        "f0002b" "e7c8" "19c9" "02" "01020304" "012c" "0136" "00000007" "03f9f4f3" "0004" "0005" "000005"
        "02" "0a0b0c0d" "0e000000" "000080"
    )  # fmt: skip
    (row,) = dump_records([octets], cells=True)
    assert row == {
        "type": 2, "sac": 25, "sic": 201, "idx": 0x01020304, "header": "femto", "start_az": 300, "end_az": 310,
        "start_az_deg": 1.64794921875, "end_az_deg": 1.702880859375, "span_raw": 10, "centre_az_deg": 1.6754150390625,
        "start_rg": 7, "cell_dur": 66_712_819, "cell_m": pytest.approx(10.0), "range_first_cell_m": pytest.approx(70.0),
        "range_last_cell_m": pytest.approx(110.0), "compressed": False, "res": 4, "bits": 8, "nbvb": 5, "nbcells": 5,
        "block": "050", "rep": 2, "tod": 128, "tod_s": 1.0, "cells": [10, 11, 12, 13, 14], "offset": 3,
    }  # fmt: skip


@given(videos())
@settings(derandomize=True, deadline=None, max_examples=25)
def test_another_decoder_reads_what_we_write(written: dict[str, Any]) -> None:
    asterix = pytest.importorskip("asterix.base")
    category = pytest.importorskip("asterix.generated").Cat_240_1_3
    (raw,) = asterix.RawDatablock.parse(asterix.Bits.from_bytes(encode_video(**written)))
    (found,) = category.cv_uap.parse(raw.get_raw_records())
    header = found.get_item("041" if written["femto"] else "040").variation
    for name in ("start_az", "end_az", "start_rg", "cell_dur"):
        assert header.get_item(name.replace("_", "").upper()).as_uint() == written[name]
    assert found.get_item("020").as_uint() == written["idx"]
    assert found.get_item("049").variation.get_item("NBCELLS").as_uint() == len(written["cells"])
    video = next(found.get_item(name) for name in ("050", "051", "052") if found.get_item(name) is not None)
    octets = video.unparse().to_bytes()[1 : 1 + found.get_item("049").variation.get_item("NBVB").as_uint()]
    packed = zlib.decompress(octets) if written["compress"] else octets
    assert packed == pack_cells(written["cells"], bits=written["bits"])
