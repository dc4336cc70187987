"""The shared vectors, field by field: records that three other decoders agree on, and inputs that are broken."""

from __future__ import annotations

import hashlib
import json
import struct
from typing import Any

import pytest

from maritrack.io.dump import dump_records
from tests.io.cat240_blocks import codes, indices, radials, read
from tests.shared import shared


def load(name: str) -> list[dict[str, Any]]:
    return json.loads(shared(f"vectors/{name}").read_text())  # type: ignore[no-any-return]


def expected(record: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in record.items() if key not in ("cells_head", "cells_sha256_u32be")}


def same_cells(cells: list[int], record: dict[str, Any]) -> bool:
    if "cells" in record:
        return bool(cells == record["cells"])
    digest = hashlib.sha256(struct.pack(f">{len(cells)}I", *cells)).hexdigest()
    return bool(cells[: len(record["cells_head"])] == record["cells_head"] and digest == record["cells_sha256_u32be"])


def test_dump_shows_every_field_of_every_good_vector() -> None:
    for vector in load("cat240_vectors.json"):
        records = [record for block in vector["blocks"] for record in block["records"]]
        rows = list(dump_records([bytes.fromhex(vector["hex"])], cells=True))
        assert [row.get("warning") for row in rows] == [None] * len(records), vector["name"]
        for row, record in zip(rows, records, strict=True):
            row.pop("offset")
            if record["type"] == 2:
                assert same_cells(row["cells"], record), vector["name"]
                if "cells" not in record:
                    row.pop("cells")
            assert row == expected(record), vector["name"]


@pytest.mark.parametrize("fast", [True, False])
def test_the_reader_delivers_the_radials_of_every_good_vector(fast: bool) -> None:
    for vector in load("cat240_vectors.json"):
        records = [record for block in vector["blocks"] for record in block["records"] if record["type"] == 2]
        batches = read(bytes.fromhex(vector["hex"]) * 1, fast=fast)
        assert codes(batches) == [], vector["name"]
        assert indices(batches) == [record["idx"] for record in records]
        got = [(of, i) for of in radials(batches) for i in range(len(of))]
        for (of, i), record in zip(got, records, strict=True):
            assert same_cells(of.cells[i, : of.n_cells[i]].tolist(), record), vector["name"]
            assert (of.bits[i], of.cell_m[i], of.tod[i]) == (record["bits"], record["cell_m"], record.get("tod", -1))


def test_the_fast_way_reads_every_good_vector_that_has_one_record_a_block() -> None:
    for vector in load("cat240_vectors.json"):
        octets = bytes.fromhex(vector["hex"])
        twelve = b"".join([octets] * 12)  # enough blocks for the fast way; the copies are dropped as duplicates
        batches = read(twelve)
        assert [row for row in codes(batches) if row not in ("duplicate", "tod-backwards")] == [], vector["name"]
        want = [r["idx"] for block in vector["blocks"] for r in block["records"] if r["type"] == 2]
        assert indices(batches) == want, vector["name"]


@pytest.mark.parametrize("fast", [True, False])
def test_the_reader_warns_of_every_bad_vector_and_reads_on(fast: bool) -> None:
    for vector in load("cat240_bad_vectors.json"):
        octets = bytes.fromhex(vector["hex"])
        batches = read(octets, fast=fast)
        assert codes(batches) == vector["expect"]["warnings"], vector["name"]
        assert indices(batches) == vector["expect"]["idx_delivered"], vector["name"]
        assert b"".join(batch.octets for batch in batches) == octets


def test_dump_shows_the_problems_of_every_bad_vector() -> None:
    for vector in load("cat240_bad_vectors.json"):
        rows = list(dump_records([bytes.fromhex(vector["hex"])]))
        assert [row["warning"] for row in rows if "warning" in row] == vector["expect"]["warnings"], vector["name"]
        assert [row["idx"] for row in rows if "idx" in row] == vector["expect"]["idx_delivered"], vector["name"]
