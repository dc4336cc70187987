"""Records go out as they came in; recoding changes the cells' coding and nothing else; filters cut records whole."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.errors import UsageError
from maritrack.io.cat240.encode import COMPRESSED, VIDEO_ITEMS, Record, encode_block, encode_record
from maritrack.io.cat240.items import read_items
from maritrack.io.cat240.recordwalk import walk
from maritrack.io.datagrams import NO_TIME, Datagrams
from maritrack.io.dump import dump_records
from maritrack.io.rewrite.recode import Budget, Coding, Recoded, data_blocks, recode_block
from maritrack.io.rewrite.recode_rows import recode_datagrams
from maritrack.io.rewrite.sensor_filter import Filtered, Ours, keep_sensor
from maritrack.io.rewrite.sensor_filter import of_sensor as filter_datagrams
from tests.io.cat240_blocks import block, codes, packed_video, radials, read, record, rows, video, video_items
from tests.io.cat240_records import ANY_RECORDS, ITEM_OF_FIELD, row_of, sound_blocks
from tests.io.test_cat240_equal import streams

EASY = settings(derandomize=True, deadline=None, max_examples=60)
PACK, UNPACK = Coding(True), Coding(False)
NUMBERS = {"source": ">BB", "kind": ">B", "idx": ">I", "nano": ">HHII", "femto": ">HHII", "form": ">BB"}


def rich() -> Budget:
    return Budget(1 << 40)


def recoded(octets: bytes, coding: Coding) -> Recoded:
    return recode_block(octets, coding, rich())


def kept(octets: bytes, sensor: tuple[int, int]) -> Filtered:
    return keep_sensor(octets, sensor[0] << 8 | sensor[1])


def of_sensor(d: Datagrams, sensor: tuple[int, int]) -> Ours:
    return filter_datagrams(d, sensor[0] << 8 | sensor[1])


def datagrams(payloads: Sequence[bytes]) -> Datagrams:
    bounds = np.cumsum([0, *map(len, payloads)])
    n = len(payloads)
    return Datagrams(
        int(bounds[-1]), b"".join(payloads), bounds, bounds[:-1] + 1000, np.full(n, NO_TIME), np.zeros(n, np.int64)
    )


def items_of(octets: bytes, at: int, end: int) -> dict[str, bytes]:
    items = read_items(octets, at, end)
    assert items.trouble is None
    return {name: octets[first:last] for name, (first, last) in items.span.items()}


def records_of(octets: bytes) -> list[dict[str, bytes]]:
    """Items of the records of data blocks."""
    found = []
    for one in data_blocks(octets):
        at = 3
        while at < len(one):
            found.append(items_of(one, at, len(one)))
            at = read_items(one, at, len(one)).stop
    return found


def radials_of(octets: bytes) -> list[tuple[Any, ...]]:
    """All that is delivered, but for where it stood and how it was coded."""
    return [(*row[1:10], *row[11:]) for row in rows(read(octets))]


@given(ANY_RECORDS)
@EASY
def test_any_set_of_items_is_written_item_by_item(record: Record) -> None:
    octets = encode_record(record)
    items = read_items(octets, 0, len(octets))
    assert (items.trouble, items.stop) == (None, len(octets))
    present = {name for name in ITEM_OF_FIELD if getattr(record, name) is not None}
    assert set(items.span) == {ITEM_OF_FIELD[name] for name in present}
    for name in present:
        first, last = items.span[ITEM_OF_FIELD[name]]
        value, found = getattr(record, name), octets[first:last]
        if name in NUMBERS:
            values = struct.unpack(NUMBERS[name], found)
            assert values == (value if isinstance(value, tuple) else (value,))
        elif name == "counts":
            assert (int.from_bytes(found[:2], "big"), int.from_bytes(found[2:], "big")) == value
        elif name == "tod":
            assert int.from_bytes(found, "big") == value
        else:
            assert found[1:] == value


@given(streams(), st.lists(ANY_RECORDS.map(encode_record), max_size=4), st.binary(max_size=9))
@EASY
def test_a_quick_walk_finds_the_records_that_the_exact_reader_finds(
    octets: bytes, records: list[bytes], rest: bytes
) -> None:
    for one in [*data_blocks(octets), block(*records, rest)]:
        found, at = walk(one, 0, len(one)), 3
        for i, start in enumerate(found.starts):
            assert start == at or at >= len(one)
            if at >= len(one):
                break
            items = read_items(one, at, len(one))
            if items.trouble is not None:
                assert (found.code, i) == (items.trouble[0], len(found.present))
                break
            assert bin(found.present[i]).count("1") == len(items.span)
            at = items.stop


@given(sound_blocks(), st.booleans())
@EASY
def test_every_sound_record_comes_back_through_the_readers(blocks: list[list[Record]], fast: bool) -> None:
    octets = b"".join(encode_block(records) for records in blocks)
    shown = sorted(dump_records([octets], cells=True), key=lambda row: int(row["offset"]))
    expected = [row_of(one) for records in blocks for one in records]
    assert [{name: row.get(name) for name in wanted} for row, wanted in zip(shown, expected, strict=True)] == expected
    batches = read(octets, fast=fast)
    assert codes(batches) == []
    assert [row[-1] for row in rows(batches)] == [row["cells"] for row in expected if "cells" in row]
    assert [int(tod) for of in radials(batches) for tod in of.tod] == [
        row.get("tod", -1) for row in expected if "cells" in row
    ]


@pytest.mark.parametrize(
    "wrong",
    [
        {}, {"source": (256, 0)}, {"kind": -1}, {"idx": 2**32}, {"text": bytes(256)}, {"counts": (65_536, 0)},
        {"counts": (0, 2**24)}, {"counts": (0, -1)}, {"low": bytes(3)}, {"low": bytes(1024)}, {"high": bytes(65_536)},
        {"tod": 2**24}, {"tod": -1}, {"re": bytes(255)}, {"nano": (65_536, 0, 0, 0)},
    ],
)  # fmt: skip
def test_what_has_no_place_in_a_record_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(UsageError):
        encode_record(Record(**wrong))


def test_a_data_block_is_refused_where_it_is_empty_or_too_large() -> None:
    for records in ([], [Record(high=bytes(65_280))] * 2):
        with pytest.raises(UsageError):
            encode_block(records)


@given(sound_blocks(), st.booleans(), st.sampled_from([1, 6, 9]))
@EASY
def test_recoding_leaves_all_but_the_cells_octet_for_octet(
    blocks: list[list[Record]], compress: bool, level: int
) -> None:
    octets = b"".join(encode_block(records) for records in blocks)
    done = [recoded(encode_block(records), Coding(compress, level)) for records in blocks]
    assert not [damage for one in done for damage in one.kept]
    after = b"".join(one.octets for one in done)
    assert radials_of(after) == radials_of(octets)
    for old, new in zip(records_of(octets), records_of(after), strict=True):
        changed = "048" in old and (old["048"][0] >= COMPRESSED) != compress
        if not changed:
            assert list(old.items()) == list(new.items())
            continue
        assert new["048"] == bytes((old["048"][0] ^ COMPRESSED, old["048"][1]))
        assert new["049"][2:] == old["049"][2:]
        others = set(old) - {"048", "049", *VIDEO_ITEMS}
        assert {name: old[name] for name in others} == {
            name: new[name] for name in set(new) - {"048", "049", *VIDEO_ITEMS}
        }
    assert sum(one.changed for one in done) == sum(
        (one.form[0] >= COMPRESSED) != compress for records in blocks for one in records if one.form
    )


@given(sound_blocks())
@EASY
def test_what_is_coded_as_wanted_already_is_not_touched(blocks: list[list[Record]]) -> None:
    for records in blocks:
        for coding in (PACK, UNPACK):
            once = recoded(encode_block(records), coding).octets
            assert all(recoded(one, coding) == (one, 0, []) for one in data_blocks(once))


@pytest.mark.parametrize("name", VIDEO_ITEMS)
@pytest.mark.parametrize("n", [1, 60, 1020])
def test_packing_and_unpacking_comes_back_to_the_same_octets(name: str, n: int) -> None:
    octets = block(
        video(7, cells=bytes(range(60)) * 17, video="051") if n == 1020 else video(7, cells=bytes(n), video=name)
    )
    packed = recoded(octets, PACK)
    assert packed.changed == 1
    assert recoded(packed.octets, UNPACK).octets == octets


def test_cells_that_outgrow_their_item_move_to_the_smallest_that_holds_them() -> None:
    noise = np.random.default_rng(1).bytes(1020)
    grown = recoded(block(video(7, cells=noise, video="050")), PACK).octets
    assert set(records_of(grown)[0]) & set(VIDEO_ITEMS) == {"051"}
    zeros = block(packed_video(7, bytes(16_321)))
    assert set(records_of(zeros)[0]) & set(VIDEO_ITEMS) == {"050"}
    assert set(records_of(recoded(zeros, UNPACK).octets)[0]) & set(VIDEO_ITEMS) == {"052"}


def test_records_that_outgrow_one_block_go_into_several() -> None:
    records = [packed_video(i, bytes([i]) * 30_000) for i in range(5)]
    done = recoded(block(*records), UNPACK)
    assert done.changed == 5 and [len(one) > 30_000 for one in data_blocks(done.octets)] == [True] * 3
    assert radials_of(done.octets) == radials_of(block(*records))


KEPT: dict[str, tuple[bytes, Coding]] = {
    "zlib-error": (video(1, cells=b"\x78\x9cnonsense", compressed=True, nbcells=40), UNPACK),
    "cells-short": (packed_video(1, bytes(20), nbcells=30), UNPACK),
    "inflates-beyond-declared": (packed_video(1, bytes(20), nbcells=10), UNPACK),
    "too-large": (packed_video(1, bytes(65_281)), UNPACK),
    "cells-long": (video(1, nbcells=10), PACK),
    "missing-item-049": (video(1, without=["049"]), PACK),
    "nbvb-exceeds-block": (video(1, nbvb=40, nbcells=40), PACK),
    "two-video-blocks": (video(1, items={"051": b"\1" + bytes(64)}), PACK),
    "missing-item-041": (video(1, without=["041"]), PACK),
    "bad-res": (video(1, res=9), PACK),
    "missing-item-048": (video(1, without=["048"]), PACK),
    "type-mismatch": (video(1, items={"000": b"\1"}), PACK),
    "truncated-item": (video(1, items={"SP": b"\x09ab"}), PACK),
}


@pytest.mark.parametrize("code", KEPT)
def test_what_can_not_be_recoded_for_sure_stays_and_is_told(code: str) -> None:
    made, coding = KEPT[code]
    octets = block(made)
    (some,) = recode_datagrams(datagrams([octets] * 2), coding, rich())
    assert (some.payloads, some.changed) == ([octets] * 2, 0)
    assert [(damage.code, damage.offset, damage.count) for damage in some.kept] == [(code, 1003, 2)]


def test_a_sound_record_is_recoded_beside_one_that_stays() -> None:
    other = record({"010": b"\1\2", "000": b"\7"})
    done = recoded(block(video(1), other, video(2, nbcells=10), video(3)), PACK)
    assert done.changed == 2 and [damage.code for damage in done.kept] == ["cells-long"]
    assert [items["048"][0] for items in records_of(done.octets) if "048" in items] == [0x80, 0, 0x80]


def test_what_is_warned_of_for_other_reasons_is_recoded() -> None:
    odd = video(1, without=["010", "020"], azimuth=(0, 60_000), items={"140": b"\xff\xff\xff"})
    for made in (odd, video(1, items={"041": bytes(12)}), video(1, items={"040": bytes(12)})):
        assert recoded(block(made), PACK).changed == 1


@given(streams(), st.booleans())
@EASY
def test_many_blocks_at_a_time_are_recoded_as_one_at_a_time(octets: bytes, compress: bool) -> None:
    payloads = [octets[at : at + 300] for at in range(0, len(octets), 300)] + data_blocks(octets)
    many = list(recode_datagrams(datagrams(payloads), Coding(compress), rich()))
    single = [[recoded(one, Coding(compress)) for one in data_blocks(payload)] for payload in payloads]
    assert [payload for some in many for payload in some.payloads] == [
        b"".join(one.octets for one in parts) for parts in single
    ]
    assert sum(some.changed for some in many) == sum(one.changed for parts in single for one in parts)
    assert sorted(damage.code for some in many for damage in some.kept for _ in range(damage.count)) == sorted(
        damage.code for parts in single for one in parts for damage in one.kept
    )


@given(streams(), st.booleans())
@EASY
def test_recoded_blocks_deliver_the_same_cells(octets: bytes, compress: bool) -> None:
    for one in data_blocks(octets):
        assert radials_of(recoded(one, Coding(compress)).octets) == radials_of(one)


def test_inflation_has_a_budget() -> None:
    bombs = [block(packed_video(i, bytes(60_000))) for i in range(10)]
    assert len(bombs[0]) < 120
    done = list(recode_datagrams(datagrams(bombs), UNPACK, Budget(200_000)))
    assert sum(some.changed for some in done) == 3
    assert [(damage.code, damage.count) for some in done for damage in some.kept] == [("inflation-budget", 7)]
    assert [payload for some in done for payload in some.payloads][3:] == bombs[3:]
    several = recode_block(block(*(packed_video(i, bytes(60_000)) for i in range(10))), UNPACK, Budget(200_000))
    assert (several.changed, len(several.kept)) == (3, 7)


def test_a_failed_stream_costs_no_budget() -> None:
    budget = Budget(1000)
    wrong = block(video(1, cells=b"\x78\x9cnonsense", compressed=True, nbcells=1000))
    (some,) = recode_datagrams(datagrams([wrong]), UNPACK, budget)
    assert some.payloads == [wrong] and some.changed == 0


def test_a_large_input_is_recoded_in_runs() -> None:
    payloads = [block(packed_video(i, bytes(60_000))) for i in range(1200)]
    runs = list(recode_datagrams(datagrams(payloads), UNPACK, rich()))
    assert len(runs) > 1 and sum(some.changed for some in runs) == 1200
    assert max(sum(map(len, some.payloads)) for some in runs) < 40 << 20


OURS, OTHER = {"sac_sic": (1, 2)}, {"sac_sic": (3, 4)}
SUMMARY_OF = {sensor: record({"010": bytes(sensor), "000": b"\1", "030": b"\3abc"}) for sensor in ((1, 2), (3, 4))}


@given(sound_blocks())
@EASY
def test_the_records_of_all_sensors_are_the_records_of_the_recording(blocks: list[list[Record]]) -> None:
    payloads = [encode_block(records) for records in blocks]
    sensors = {one.source for records in blocks for one in records}
    found = [items for sensor in sensors for items in records_of(of_sensor(datagrams(payloads), sensor).datagrams.data)]
    expected = [items for payload in payloads for items in records_of(payload)]
    assert sorted(map(repr, found)) == sorted(map(repr, expected))
    for sensor in sensors:
        ours = of_sensor(datagrams(payloads), sensor)
        assert ours.cut == sum(one.source != sensor for records in blocks for one in records)
        whole = [encode_block([one for one in records if one.source == sensor]) for records in blocks
                 if any(one.source == sensor for one in records)]  # fmt: skip
        bounds = ours.datagrams.bounds.tolist()
        assert [ours.datagrams.data[a:b] for a, b in pairwise(bounds)] == whole


def test_blocks_of_other_categories_and_sensors_are_cut_out_of_a_datagram() -> None:
    foreign = bytes.fromhex("30000a00000000000000")
    payload = foreign + block(video(1, **OURS)) + block(video(2, **OTHER)) + block(video(3, **OURS), video(4, **OTHER))
    ours = of_sensor(datagrams([payload, block(video(5, **OTHER)), foreign, b"", b"junk"]), (1, 2))
    assert ours.datagrams.data == block(video(1, **OURS)) + block(video(3, **OURS))
    assert (len(ours.datagrams), ours.datagrams.offset.tolist(), ours.cut) == (1, [1000], 3)


def test_summaries_go_with_their_sensor() -> None:
    octets = block(SUMMARY_OF[1, 2], SUMMARY_OF[3, 4], video(1, **OTHER))
    assert kept(octets, (1, 2)) == (block(SUMMARY_OF[1, 2]), 2)
    assert kept(octets, (3, 4)) == (block(SUMMARY_OF[3, 4], video(1, **OTHER)), 1)
    assert kept(octets, (5, 6)) == (b"", 3)


def test_damage_goes_with_the_records_of_one_sensor_and_is_cut_from_those_of_several() -> None:
    broken = b"\xff\xff\xff\xff"
    alone = block(video(1, **OURS), broken)
    assert kept(alone, (1, 2)) == (alone, 0)
    assert kept(alone, (3, 4)).octets == b""
    assert kept(block(video(1, **OURS), video(2, **OTHER), broken), (1, 2)).octets == block(video(1, **OURS))


@given(streams(), st.sampled_from([(1, 2), (1, 3)]))
@EASY
def test_a_filter_loses_no_radial_of_its_sensor(octets: bytes, sensor: tuple[int, int]) -> None:
    for one in data_blocks(octets):
        ours = of_sensor(datagrams([one]), sensor)
        assert ours.datagrams.data == kept(one, sensor).octets
        if one[:1] == b"\xf0" and int.from_bytes(one[1:3], "big") == len(one):
            assert radials_of(ours.datagrams.data) == [row for row in radials_of(one) if row[:2] == sensor]


def test_compressing_at_a_level_is_what_zlib_does() -> None:
    cells = bytes(range(200)) * 4
    for level in (0, 1, 9):
        (some,) = recode_datagrams(datagrams([block(video(1, cells=cells, video="051"))]), Coding(True, level), rich())
        (items,) = records_of(some.payloads[0])
        body = items["051"][1 : 1 + int.from_bytes(items["049"][:2], "big")]
        assert body == zlib.compress(cells, level)
    with pytest.raises(UsageError):
        Coding(True, 10)


def test_items_of_video_are_what_the_helpers_say() -> None:
    assert encode_block([Record(source=(1, 2), kind=2, idx=1)]) == block(
        record({name: video_items(1)[name] for name in ("010", "000", "020")})
    )
