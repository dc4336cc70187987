"""What we write is read the same by libasterix, item by item."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.io.cat240.encode import Record, encode_block
from maritrack.io.rewrite.recode import Budget, Coding, data_blocks, recode_block
from maritrack.io.rewrite.sensor_filter import keep_sensor
from tests.io.cat240_blocks import ORDER
from tests.io.cat240_records import ANY_RECORDS, sound_blocks
from tests.io.test_convert import SAMPLE, SOLENT, raw
from tests.io.test_recode import records_of
from tests.shared import shared

asterix = pytest.importorskip("asterix.base")
category = pytest.importorskip("asterix.generated").Cat_240_1_3

EASY = settings(derandomize=True, deadline=None, max_examples=40)
NAMES = [name for name in ORDER if name]


def read_by_libasterix(octets: bytes) -> list[dict[str, bytes]]:
    """Items of the records of data blocks. It takes one block at a time: several nest its calls."""
    found = []
    for one in data_blocks(octets):
        (block,) = asterix.RawDatablock.parse(asterix.Bits.from_bytes(one))
        assert block.get_category() == 240
        for record in category.cv_uap.parse(block.get_raw_records()):
            items = {name: record.get_item(name) for name in NAMES}
            found.append({name: item.unparse().to_bytes() for name, item in items.items() if item is not None})
    return found


@given(ANY_RECORDS)
@EASY
def test_any_set_of_items_is_read_the_same(record: Record) -> None:
    octets = encode_block([record])
    assert read_by_libasterix(octets) == records_of(octets)


@given(sound_blocks(), st.sampled_from([None, True, False]))
@EASY
def test_blocks_of_several_records_are_read_the_same_also_recoded(
    blocks: list[list[Record]], compress: bool | None
) -> None:
    for records in blocks:
        octets = encode_block(records)
        if compress is not None:
            octets = recode_block(octets, Coding(compress), Budget(1 << 30)).octets
        found = read_by_libasterix(octets)
        assert found == records_of(octets) and len(found) == len(records)


@given(sound_blocks())
@EASY
def test_what_is_left_of_one_sensor_is_read_the_same(blocks: list[list[Record]]) -> None:
    for records in blocks:
        assert records[0].source is not None
        sac, sic = records[0].source
        octets = keep_sensor(encode_block(records), sac << 8 | sic).octets
        assert read_by_libasterix(octets) == records_of(octets)


@pytest.mark.parametrize("compress", [None, True, False])
def test_converted_recordings_are_read_the_same(compress: bool | None) -> None:
    for path in (SAMPLE, shared(SOLENT)):
        octets = raw(path.read_bytes()[:20_000], compress=compress)
        found = read_by_libasterix(octets)
        assert found == records_of(octets) and len(found) > 100
