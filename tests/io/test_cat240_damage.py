"""What is wrong with an input is said, with a stable code, and costs no more than it must."""

from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.errors import InputError
from maritrack.io.cat240.reader import file_chunks, read_batches
from maritrack.io.dump import CSV_FIELDS, dump_records
from tests.io.cat240_blocks import (
    SENTINEL,
    block,
    codes,
    damage,
    indices,
    packed_video,
    radials,
    read,
    record,
    video,
    video_items,
)  # fmt: skip

ONE = block(video(1))
CELLS = bytes(range(50))


def header(**how: Any) -> bytes:
    """I240/041 with one thing in it wrong."""
    fields = {"start_az": 0, "end_az": 16, "start_rg": 0, "cell_dur": 66_712_819, **how}
    return struct.pack(">HHII", *fields.values())


def inflated(stream: bytes, *, nbcells: int = len(CELLS), nbvb: int | None = None) -> bytes:
    return block(video(1, cells=stream, nbcells=nbcells, nbvb=nbvb, compressed=True, video="051"))


WRONG: dict[str, tuple[bytes, list[str], list[int]]] = {
    "empty": (b"", [], []),
    "an empty block": (b"\xf0\0\3", ["empty-block"], []),
    "a block of two octets": (b"\xf0\0\2", ["block-length<3"], []),
    "a block of one octet": (b"\xf0\0\1abcdefg", ["block-length<3"], []),
    "octets that are nothing": (b"\0\xff\xf0\xf0\0\0\0", ["lost-sync"], []),
    "nothing but octets after a block": (ONE + b"\0\1\2", ["lost-sync"], [1]),
    "category 48": (bytes.fromhex("30000500003e000401"), ["other-category"], []),
    "no FSPEC": (block(b"\0"), ["empty-fspec"], []),
    "an FSPEC of nothing but extensions": (block(b"\1\0"), ["empty-fspec"], []),
    "an FSPEC without end": (block(b"\xff" * 30), ["fspec-too-long"], []),
    "an FSPEC that is cut": (block(b"\xe7"), ["truncated-item"], []),
    "a fifteenth item": (block(b"\xe7\xa9\x80" + bytes(40)), ["frn-not-in-uap"], []),
    "item 040 that is cut": (block(b"\xe8\1\2\2\0\0\0\1\0\0\0"), ["truncated-item"], []),
    "a record after a bad one": (block(video(1), b"\0", video(2)), ["empty-fspec"], [1]),
    "an unknown type, and then a good record": (block(video(1, items={"000": b"\7"}), video(2)), ["unknown-type"], [2]),
    "type 0": (block(video(1, items={"000": b"\0"})), ["unknown-type"], []),
    "a summary with video": (block(video(1, items={"000": b"\1"})), ["type-mismatch"], []),
    "video with a summary": (block(video(1, items={"030": b"\1x"})), ["type-mismatch"], [1]),
    "no type, video": (block(video(1, without=["000"])), ["missing-item-000"], [1]),
    "no type, nothing": (block(b"\x80\1\2"), ["missing-item-000"], []),
    "no SAC/SIC": (block(video(1, without=["010"])), ["missing-item-010"], [1]),
    "no index": (block(video(1, without=["020"])), ["missing-item-020"], [-1]),
    "no azimuth": (block(video(1, without=["041"])), ["missing-item-041"], []),
    "no resolution": (block(video(1, without=["048"])), ["missing-item-048"], []),
    "no counts": (block(video(1, without=["049"])), ["missing-item-049"], [1]),
    "no video": (block(video(1, without=["050"])), ["missing-item-video"], []),
    "a summary without text": (block(record({"010": b"\1\2", "000": b"\1"})), ["missing-item-030"], []),
    "a summary that isn't ASCII": (block(record({"010": b"\1\2", "000": b"\1", "030": b"\1\xe9"})),
                                   ["summary-not-ascii"], []),
    "two headers": (block(video(1, items={"040": header()})), ["two-headers"], [1]),
    "two video blocks": (block(video(1, items={"051": b"\1" + bytes(64)})), ["two-video-blocks"], [1]),
    "resolution 0": (block(video(1, res=0)), ["bad-res"], []),
    "resolution 7": (block(video(1, res=7)), ["bad-res"], []),
    "cells without depth": (block(video(1, items={"041": header(cell_dur=0)})), ["cell-duration-zero"], []),
    "a span of half a turn": (block(video(1, azimuth=(100, 100 + 32_768))), [], [1]),
    "a span of more": (block(video(1, azimuth=(100, 100 + 32_769))), ["az-span-implausible"], [1]),
    "the last time of day": (block(video(1, tod=11_059_199)), [], [1]),
    "a time of day too late": (block(video(1, tod=11_059_200)), ["tod-out-of-range"], [1]),
    "more cells than octets": (block(video(1, nbcells=17)), ["cells-short"], [1]),
    "more octets than cells": (block(video(1, nbcells=15)), ["cells-long"], [1]),
    "more octets than the block": (block(video(1, nbvb=17, nbcells=16)), ["nbvb-exceeds-block"], [1]),
    "cells and octets beyond the block": (block(video(1, nbvb=17, nbcells=17)),
                                          ["nbvb-exceeds-block", "cells-short"], [1]),
    "a video block that is cut": (block(video(1, items={"050": b"\x09" + bytes(16)})), ["truncated-item"], []),
    "SP that is cut": (block(video(1, items={"SP": b"\x09a"})), ["truncated-item"], [1]),
    "RE of length 0": (block(video(1, items={"RE": b"\0"})), ["truncated-item"], [1]),
    "a stream with octets after it": (inflated(zlib.compress(CELLS) + b"more"), [], [1]),
    "no zlib header": (inflated(b"0123456789" * 5), ["zlib-error"], []),
    "a deflate stream without zlib's header": (inflated(zlib.compress(CELLS)[2:-4]), [], [1]),
    "the same with too many cells": (inflated(zlib.compress(CELLS)[2:-4], nbcells=51), ["zlib-error"], []),
    "a stream that is cut": (inflated(zlib.compress(CELLS)[:-9]), ["zlib-error"], []),
    "a stream without its last octet": (inflated(zlib.compress(CELLS)[:-1]), ["zlib-error"], []),
    "a wrong checksum": (inflated(zlib.compress(CELLS)[:-1] + b"\x55"), ["zlib-error"], []),
    "a stream with a wrong octet": (inflated(zlib.compress(CELLS)[:9] + b"\xff" * 40), ["zlib-error"], []),
    "a stream of fewer cells": (inflated(zlib.compress(CELLS), nbcells=51), ["cells-short"], [1]),
    "a stream of more cells": (inflated(zlib.compress(CELLS), nbcells=49), ["inflates-beyond-declared"], [1]),
    "a stream without octets": (inflated(b""), ["zlib-error"], []),
    "a stream of no cells": (inflated(zlib.compress(b""), nbcells=0), [], [1]),
    "no stream and no cells": (inflated(b"", nbcells=0), [], [1]),
    "a stream and no counts": (block(video(1, cells=zlib.compress(CELLS), compressed=True, without=["049"])),
                               ["missing-item-049"], [1]),
    "more cells than a radial may have": (block(packed_video(1, bytes(524_289))), ["cells-capped"], [1]),
    "sixteen million cells declared": (block(packed_video(1, CELLS, nbcells=2**24 - 1)), ["cells-short"], [1]),
}  # fmt: skip


@pytest.mark.parametrize("fast", [True, False])
@pytest.mark.parametrize("name", [name for name in WRONG if name != "octets that are nothing"])
def test_a_wrong_block_is_told_and_the_next_one_read(name: str, fast: bool) -> None:
    octets, warnings, delivered = WRONG[name]
    batches = read(octets + SENTINEL, fast=fast)
    assert (codes(batches), indices(batches)) == (warnings, [*delivered, 999])


@pytest.mark.parametrize("name", [name for name in WRONG if name not in ("empty", "a block of one octet")])
def test_a_wrong_block_among_good_ones_costs_only_itself(name: str) -> None:
    octets, warnings, delivered = WRONG[name]
    good = [block(video(10 + i)) for i in range(20)]
    batches = read(b"".join(good[:10]) + octets + b"".join(good[10:]))
    assert (codes(batches), indices(batches)) == (warnings, [*range(10, 20), *delivered, *range(20, 30)])


@pytest.mark.parametrize("name", [name for name, (_, warnings, _) in WRONG.items() if warnings])
def test_strict_raises_at_the_first_damage(name: str) -> None:
    with pytest.raises(InputError, match=r"^rec: .* at byte \d+ \("):
        list(read_batches([ONE * 0 + WRONG[name][0] + SENTINEL], strict=True, name="rec"))


def test_the_cells_that_are_there_are_delivered() -> None:
    for name, n in (("more cells than octets", 16), ("more octets than cells", 15), ("no counts", 16),
                    ("more octets than the block", 16), ("a stream of fewer cells", 50), ("a stream and no counts", 50),
                    ("a stream of more cells", 49), ("more cells than a radial may have", 524_288)):  # fmt: skip
        (of,) = radials(read(WRONG[name][0]))
        assert (name, of.n_cells.tolist(), of.cells.shape) == (name, [n], (1, n))
        assert of.cells[0].tolist() == [i if n < 100 else 0 for i in range(n)]


def test_no_sensor_is_sensor_zero() -> None:
    (of,) = radials(read(WRONG["no SAC/SIC"][0]))
    assert (of.sac.tolist(), of.sic.tolist()) == ([0], [0])


def test_the_finer_of_two_headers_is_used() -> None:
    octets = block(video(1, items={"040": header(cell_dur=67, start_az=9)}))
    (of,) = radials(read(octets))
    assert (of.femto.tolist(), of.start_az.tolist()) == ([True], [0])


# ---- framing


def test_a_file_that_is_no_asterix_is_told_as_such() -> None:
    for octets in (
        b"time,azimuth,range\n" * 40,
        bytes(5000),
        b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 9,
        b"\xf0"[:0] + b"x",
    ):
        assert codes(read(octets)) == ["not-asterix"]


def test_the_end_that_is_cut_is_told_with_its_place() -> None:
    for n in range(1, len(SENTINEL)):
        batches = read(ONE + SENTINEL[:n])
        assert [(code, offset) for code, _, offset, _, _ in damage(batches)] == [("truncated-block", len(ONE))], n
        assert indices(batches) == [1]


@pytest.mark.parametrize("extra", [*range(1, 40), len(ONE) - 1, len(ONE)])
def test_a_block_that_is_too_long_swallows_no_header(extra: int) -> None:
    long = block(video(1), length=len(ONE) + extra)
    batches = read(long + block(video(2)) + SENTINEL)
    assert indices(batches) == [1, 2, 999]
    assert "lost-sync" in codes(batches)


@pytest.mark.parametrize("less", range(1, 20))
def test_a_block_that_is_too_short_costs_itself(less: int) -> None:
    batches = read(block(video(1), length=len(ONE) - less) + SENTINEL)
    assert indices(batches) == [999]
    assert codes(batches) == ["truncated-item", "lost-sync"]


def test_a_block_that_claims_most_of_the_file_hides_none_of_it() -> None:
    whole = b"".join(block(video(i)) for i in range(2, 2000))
    batches = read(block(video(1), length=65_535) + whole)
    assert indices(batches) == list(range(1, 2000))


def test_blocks_that_are_all_too_long_are_all_read() -> None:
    octets = b"".join(block(video(i), length=len(ONE) + 5) for i in range(50))
    assert indices(read(octets + SENTINEL)) == [*range(50), 999]


def test_a_good_block_between_bad_ones_is_found() -> None:
    octets = b"".join(b"\xf0\0\0" + block(video(i)) for i in range(50))
    assert indices(read(octets)) == list(range(50))


def test_a_block_of_many_records_is_found_by_what_follows_it() -> None:
    assert indices(read(b"\0\1\2" + block(*(video(i) for i in range(9))) + SENTINEL)) == [*range(9), 999]


def test_a_chain_that_begins_with_an_unheard_of_category_is_no_chain() -> None:
    batches = read(ONE + bytes.fromhex("05000500003000050000") + SENTINEL)
    assert (codes(batches), indices(batches)) == (["lost-sync"], [1, 999])


@given(st.binary(max_size=60).filter(lambda octets: b"\xf0" not in octets))
@settings(derandomize=True, deadline=None)
def test_octets_between_blocks_are_skipped(rubbish: bytes) -> None:
    batches = read(ONE + rubbish + SENTINEL)
    assert indices(batches) == [1, 999]
    skipped = [offset for code, _, offset, _, _ in damage(batches) if code == "lost-sync"]
    assert skipped == [len(ONE)] or set(codes(batches)) <= {"other-category", "lost-sync"}


def test_video_octets_that_look_like_a_block_are_not_one() -> None:
    decoy = block(b"\xe0\1\2\2\0\0\0\1") + b"\xf0\0\x20"
    octets = block(video(1, cells=decoy.ljust(40, b"\0")), length=30)  # too short: the reader has to look around
    assert indices(read(octets + SENTINEL)) == [999]


def test_many_blocks_of_other_categories_are_one_entry() -> None:
    foreign = bytes.fromhex("300006000000") + bytes.fromhex("3e000400")
    (one,) = (d for batch in read(ONE + foreign * 1000 + SENTINEL) for d in batch.damage)
    assert (one.code, one.offset, one.count) == ("other-category", len(ONE), 2000)


# ---- records after each other


def test_the_same_message_twice_is_delivered_once() -> None:
    batches = read(ONE + block(video(2)) + ONE + ONE + SENTINEL)
    assert indices(batches) == [1, 2, 999]
    assert damage(batches)[0][-1] == 2


def test_a_repeated_index_with_another_azimuth_is_no_duplicate() -> None:
    octets = b"".join(block(video(5, azimuth=(i, i + 16))) for i in range(30))
    assert (codes(read(octets)), len(indices(read(octets)))) == ([], 30)


def test_a_message_that_comes_back_much_later_is_no_duplicate() -> None:
    octets = b"".join(block(video(i)) for i in [*range(9), 0])
    assert indices(read(octets)) == [*range(9), 0]


def test_a_good_copy_of_a_broken_message_is_delivered() -> None:
    broken = inflated(zlib.compress(CELLS)[:-1])
    assert indices(read(broken + inflated(zlib.compress(CELLS)) + SENTINEL)) == [1, 999]


def test_two_sensors_have_their_own_duplicates_and_times() -> None:
    octets = b"".join(block(video(i, sac_sic=(1, s), tod=1000 * s + i)) for i in range(20) for s in (1, 2))
    assert codes(read(octets)) == []


@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 1), st.none() | st.integers(0, 11_059_199)), max_size=40))
@settings(derandomize=True, deadline=None)
def test_order_is_judged_record_by_record(sent: list[tuple[int, int, int | None]]) -> None:
    octets = b"".join(block(video(idx, tod=tod, sac_sic=(1, sic))) for idx, sic, tod in sent)
    last: dict[int, list[int]] = {0: [], 1: []}
    time: dict[int, int] = {}
    warnings, delivered = [], []
    for idx, sic, tod in sent:
        duplicate = idx in last[sic][-8:]
        last[sic].append(idx)
        if duplicate:
            warnings.append("duplicate")
            continue
        delivered.append(idx)
        if tod is not None:
            warnings += ["tod-backwards"] if 0 < time.get(sic, -1) - tod <= 43_200 * 128 else []
            time[sic] = tod
    batches = read(octets)
    assert indices(batches) == delivered
    assert [one[0] for one in damage(batches) for _ in range(one[4])] == warnings


def test_midnight_is_no_step_back() -> None:
    assert codes(read(block(video(1, tod=11_059_199)) + block(video(2, tod=1)))) == []


# ---- batches


def test_a_batch_has_cells_of_the_widest_type_in_it() -> None:
    octets = b"".join(block(video(i, res=4 + (i // 3) % 3, nbcells=16 >> (i // 3) % 3)) for i in range(30))
    batches = read(octets)
    (of,) = radials(batches)
    assert of.bits.tolist() == [8 << i // 3 % 3 for i in range(30)]
    assert (
        of.cells.dtype == np.uint32
        and (of.cells[3, :9] == [0x0001, 0x0203, 0x0405, 0x0607, 0x0809, 0x0A0B, 0x0C0D, 0x0E0F, 0]).all()
    )
    assert b"".join(batch.octets for batch in batches) == octets


def test_records_of_one_block_may_be_in_two_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("maritrack.io.cat240.cutting.MAX_RADIALS", 1)
    octets = block(video(1), video(2, res=5, nbcells=8)) + SENTINEL
    batches = read(octets)
    assert [(of.bits.tolist(), of.idx.tolist()) for of in radials(batches)] == [([8], [1]), ([16], [2]), ([8], [999])]
    assert [len(batch.octets) for batch in batches] == [len(octets) - len(SENTINEL), 0, len(SENTINEL)]


def test_a_batch_stays_below_its_size() -> None:
    wide = [packed_video(i, bytes(400_000)) for i in range(100)]
    batches = read(b"".join(block(video(1000 + i), one) for i, one in enumerate(wide)))
    assert max(of.cells.nbytes for of in radials(batches)) <= 32 << 20
    assert max(len(of) for of in radials(read(b"".join(block(video(i)) for i in range(30_000))))) <= 12_288


def test_cells_beyond_256_times_the_input_are_dropped() -> None:
    bombs = [block(packed_video(i, bytes(524_288))) for i in range(60)]
    batches = read(b"".join(bombs) + SENTINEL)
    dropped = sum(one[-1] for one in damage(batches) if one[0] == "inflation-budget")
    assert dropped > 40
    assert indices(batches)[-1] == 999
    cells = sum(int(of.n_cells.sum()) for of in radials(batches))
    assert cells <= max(4 << 20, 256 * sum(map(len, bombs))) + 8
    assert codes(read(b"".join(bombs), fast=False)) == codes(read(b"".join(bombs)))


def test_honest_recordings_never_meet_the_budget() -> None:
    silent = b"".join(block(packed_video(i, bytes(8192))) for i in range(3000))
    assert codes(read(silent)) == []


# ---- dump


def test_dump_tells_problems_in_their_place() -> None:
    rows = list(dump_records([ONE + b"\xf0\0\3\xf0\0\3" + SENTINEL], name="rec"))
    assert [row.get("warning", row.get("idx")) for row in rows] == [1, "empty-block", 999]
    assert rows[1] == {
        "warning": "empty-block", "offset": len(ONE), "message": "a data block without records", "count": 2,
    }  # fmt: skip


def test_dump_rows_have_no_keys_beyond_the_csv_fields() -> None:
    octets = b"".join(wrong for wrong, _, _ in WRONG.values()) + SENTINEL
    keys = {key for row in dump_records([octets], cells=True) for key in row}
    assert keys <= set(CSV_FIELDS)
    assert {"warning", "message", "offset", "summary", "cells", "idx"} <= keys


def test_dump_names_the_input_that_is_no_asterix() -> None:
    (row,) = dump_records([b"hello, world"], name="notes.txt")
    assert (row["warning"], row["message"].startswith("notes.txt: ")) == ("not-asterix", True)


def test_a_summary_can_not_drive_a_terminal() -> None:
    (row,) = dump_records([block(record({"010": b"\1\2", "000": b"\1", "030": b"\6a\x1b[2Jb"}))])
    assert row["summary"] == "a\ufffd[2Jb"


def test_a_file_is_read_in_pieces(tmp_path: Any) -> None:
    path = tmp_path / "rec.cat240"
    path.write_bytes(ONE + SENTINEL)
    assert [len(chunk) for chunk in file_chunks(path, size=50)] == [50, len(ONE + SENTINEL) - 50]


def test_a_file_that_is_not_there_is_an_input_error(tmp_path: Any) -> None:
    with pytest.raises(InputError, match=r"none\.cat240: No such file"):
        list(file_chunks(tmp_path / "none.cat240"))
    with pytest.raises(InputError, match="directory"):
        list(file_chunks(tmp_path))


def test_the_items_of_the_blocks_here_are_what_they_say() -> None:
    assert sorted(video_items()) == ["000", "010", "020", "041", "048", "049", "050", "140"]


@pytest.mark.parametrize("seed", range(3))
def test_octets_that_are_nothing_cost_no_block_that_is_whole(seed: int) -> None:
    rng = np.random.default_rng(seed)
    video_of = rng.integers(0, 256, (400, 300), dtype=np.uint8)
    video_of[rng.random(video_of.shape) < 0.2] = 0xF0  # as saturated video has them
    parts = []
    for i, cells in enumerate(video_of):
        parts.append(block(packed_video(i, cells.tobytes())) if i % 2 else block(video(i, cells=cells.tobytes())))
        parts.append(rng.bytes(int(rng.integers(1, 60))) if i % 10 == 5 else b"")
    assert indices(read(b"".join(parts))) == list(range(400))


@pytest.mark.parametrize("n", [1, 40], ids=["few", "many"])
@pytest.mark.parametrize(("hours", "steps_back"), [(7, 1), (9, 1), (11, 1), (12, 1), (12.01, 0), (13, 0), (20, 0)])
def test_half_a_day_back_is_midnight(n: int, hours: float, steps_back: int) -> None:
    first, tick = 22 * 3600 * 128, 1 / (3600 * 128)
    times = [first + i for i in range(n)] + [first + n - 1 - round(hours / tick) + i for i in range(n)]
    octets = b"".join(block(video(i, tod=tod)) for i, tod in enumerate(times))
    for fast in (True, False):
        assert codes(read(octets, fast=fast)) == ["tod-backwards"] * steps_back
