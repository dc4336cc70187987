"""FINAL is read and written as its layout says, and a broken record costs itself."""

from __future__ import annotations

import io
import json
import random
import struct
import sys
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.io.containers.final import FinalReader, FinalWriter, looks_final
from maritrack.io.datagrams import NO_TIME, Stream
from maritrack.io.times import DAY_NS
from tests.io.grams import START_NS, STREAMS, Gram, Read, cuts, gram_lists, grown_mb, pieces, read, videos, write
from tests.shared import shared

FOOTER = b"\xa5" * 4
HOUR_CS = 360_000
LINE = Stream("board-1-line-2")


def record(payload: bytes, *, time_cs: int = 0, day: int = 1, line: bytes = b"\1\2", number: bytes = b"") -> bytes:
    body = number + line + bytes([day]) + time_cs.to_bytes(3, "big") + payload + FOOTER
    return struct.pack(">H", 2 + len(body)) + body


def written(grams: Sequence[Gram]) -> bytes:
    file = io.BytesIO()
    write(FinalWriter(file), grams)
    return file.getvalue()


def read_final(octets: bytes, sizes: Sequence[int] = ()) -> Read:
    got = read(FinalReader(pieces(octets, sizes)))
    assert got.end == len(octets)
    for payload, offset in zip(got.payloads, got.offsets, strict=True):
        assert octets[offset : offset + len(payload)] == payload
    return got


def test_a_record_is_what_the_layout_says() -> None:
    payload = videos(1)[0]
    octets = written([Gram(payload, START_NS + 123_456_789, Stream("board-7-line-255"))])
    time_cs = (START_NS + 123_456_789) % DAY_NS // 10**7
    assert octets == (
        struct.pack(">HBBB", 12 + len(payload), 7, 255, 1) + struct.pack(">I", time_cs)[1:] + payload + FOOTER
    )
    assert read_final(octets).grams == [Gram(payload, time_cs * 10**7, Stream("board-7-line-255"))]


def as_read(grams: Sequence[Gram]) -> list[Gram]:
    """What FINAL keeps of datagrams."""
    streams = list(dict.fromkeys(gram.stream for gram in grams))
    days = [gram.t_ns // DAY_NS for gram in grams if gram.t_ns != NO_TIME]
    names = {stream: Stream(f"board-0-line-{i}") for i, stream in enumerate(streams, 1)}
    cut = [t if t == NO_TIME else (t - days[0] * DAY_NS) // 10**7 * 10**7 for t in (gram.t_ns for gram in grams)]
    return [Gram(gram.payload, t_ns, names[gram.stream]) for gram, t_ns in zip(grams, cut, strict=True)]


@settings(derandomize=True, deadline=None, max_examples=150)
@given(gram_lists, st.lists(st.integers(-11 * 3600 * 10**9, 100 * DAY_NS), min_size=25, max_size=25), cuts)
def test_what_is_written_is_read(grams: list[Gram], steps: list[int], sizes: list[int]) -> None:
    now, moved = START_NS + 12 * 3600 * 10**9, []
    for gram, step in zip(grams, steps, strict=False):
        now += step if gram.t_ns != NO_TIME else 0
        moved.append(gram._replace(t_ns=now) if gram.t_ns != NO_TIME else gram)
    got = read_final(written(moved), sizes)
    assert (got.grams, got.damage) == (as_read(moved), [])


def test_streams_of_final_keep_their_lines_and_others_get_free_ones() -> None:
    streams = [Stream("board-0-line-1"), *STREAMS[:2], Stream("board-3-line-4"), Stream("board-0-line-1", "elsewhere")]
    got = read_final(written([Gram(b"x", stream=stream) for stream in streams]))
    names = ["board-0-line-1", "board-0-line-2", "board-0-line-3", "board-3-line-4", "board-0-line-4"]
    assert [gram.stream for gram in got.grams] == [Stream(name) for name in names]


def test_all_boards_and_lines_can_be_had() -> None:
    writer = FinalWriter(io.BytesIO())
    fits = [writer.write(b"", t_ns=0, stream=Stream(str(i))) for i in range(65_536)]
    assert fits == [True] * 65_535 + [False]


def test_a_payload_that_is_too_long_for_len_is_refused() -> None:
    file = io.BytesIO()
    writer = FinalWriter(file)
    assert not writer.write(bytes(65_524), t_ns=0, stream=LINE)
    assert file.getvalue() == b""
    assert writer.write(bytes(65_523), t_ns=0, stream=LINE)
    assert read_final(file.getvalue()).payloads == [bytes(65_523)]


@pytest.mark.parametrize("day", [(7, 7, 7, 7), (255, 0, 0, 1), (3, 4, 4, 5)])
def test_midnights_are_counted_with_and_without_recording_days(day: Sequence[int]) -> None:
    hours = [23, 1, 22, 3]
    octets = b"".join(record(b"", time_cs=h * HOUR_CS, day=d) for h, d in zip(hours, day, strict=True))
    got = read_final(octets)
    assert [gram.t_ns // (3600 * 10**9) for gram in got.grams] == [23, 25, 46, 51]


def test_records_out_of_order_around_midnight_are_no_new_days() -> None:
    octets = b"".join(record(b"", time_cs=t) for t in (8_639_999, 1, 8_639_998, 2))
    assert [gram.t_ns for gram in read_final(octets).grams] == [8_639_999 * 10**7, DAY_NS + 10**7, 8_639_998 * 10**7,
                                                                DAY_NS + 2 * 10**7]  # fmt: skip


def test_a_day_of_silence_is_no_step_back() -> None:
    octets = b"".join(record(b"", time_cs=t) for t in (1, 8_639_998))
    assert [gram.t_ns for gram in read_final(octets).grams] == [10**7, 8_639_998 * 10**7]


def test_recordings_of_more_than_a_year_keep_their_days() -> None:
    days = [0, 100, 200, 254, 255, 256, 300, 400, 511, 512, 600]
    octets = written([Gram(b"", START_NS + day * DAY_NS) for day in days])
    assert [gram.t_ns // DAY_NS for gram in read_final(octets).grams] == days


def test_a_day_without_records_is_a_day() -> None:
    octets = record(b"", day=1) + record(b"", day=200) + record(b"", day=3)
    assert [gram.t_ns // DAY_NS for gram in read_final(octets).grams] == [0, -57, 2]


def test_a_time_that_is_none_is_told_but_for_our_own_mark() -> None:
    octets = record(b"", time_cs=0xFFFFFF) + record(b"", time_cs=8_640_100) * 2 + record(b"", time_cs=8_640_099)
    got = read_final(octets)
    assert [gram.t_ns for gram in got.grams] == [NO_TIME] * 3 + [8_640_099 * 10**7]
    assert [(one.code, one.offset, one.count) for one in got.damage] == [("final-time", 12 + 5, 2)]


def test_records_with_sequence_numbers_are_told_by_their_data_blocks() -> None:
    payloads = videos(20)
    octets = b"".join(record(p, time_cs=i, number=struct.pack(">I", i)) for i, p in enumerate(payloads))
    assert looks_final(octets)
    assert read_final(octets, [1000]).grams == [Gram(p, i * 10**7, LINE) for i, p in enumerate(payloads)]


def many(n: int = 60) -> tuple[list[bytes], list[int], bytes]:
    """Payloads, where their records begin, and the file."""
    payloads = [payload * (1 + i % 3) for i, payload in enumerate(videos(n))]
    records = [record(payload, time_cs=i) for i, payload in enumerate(payloads)]
    starts = [sum(map(len, records[:i])) for i in range(n)]
    return payloads, starts, b"".join(records)


def test_a_broken_footer_costs_nothing() -> None:
    payloads, starts, octets = many()
    for i in (0, 30, 59):
        at = (starts[i + 1] if i < 59 else len(octets)) - 2
        got = read_final(octets[:at] + b"\0" + octets[at + 1 :])
        assert got.payloads == payloads
        assert [(one.code, one.offset) for one in got.damage] == [("final-footer", starts[i])]


@pytest.mark.parametrize("length", [0, 1, 11, 12, 13, 100, 0xFFFF])
@pytest.mark.parametrize("i", [0, 1, 30, 58, 59])
def test_a_wrong_length_costs_its_record(i: int, length: int) -> None:
    payloads, starts, octets = many()
    got = read_final(octets[: starts[i]] + length.to_bytes(2, "big") + octets[starts[i] + 2 :])
    assert got.payloads == payloads[:i] + payloads[i + 1 :]
    assert [one.offset for one in got.damage] == [starts[i]]
    assert got.codes == ["final-cut" if i == 59 and length == 0xFFFF else "final-lost"]


@pytest.mark.parametrize("junk", [b"\0", b"\xa5", b"\xa5" * 7, b"\xf0\0\x10", bytes(70_000), videos(1)[0]], ids=len)
def test_stray_octets_cost_no_record_with_one_data_block(junk: bytes) -> None:
    payloads, starts, octets = many()
    for i in (0, 3, 30):
        got = read_final(octets[: starts[i]] + junk + octets[starts[i] :])
        assert got.payloads == payloads
        assert [(one.code, one.offset) for one in got.damage] == [("final-lost", starts[i])]


def test_a_cut_file_gives_all_whole_records() -> None:
    payloads, starts, octets = many(6)
    for size in range(1, len(octets)):
        got = read_final(octets[:size])
        n = sum(end <= size for end in [*starts[1:], len(octets)])
        assert got.payloads == payloads[:n]
        assert [(one.code, one.offset) for one in got.damage] == [("final-cut", starts[n])] * (size not in starts)


@settings(derandomize=True, deadline=None, max_examples=150)
@given(st.integers(0, 2**32))
def test_a_changed_octet_costs_at_most_its_own_record_and_the_next(seed: int) -> None:
    payloads, _, octets = many()
    at, change = random.Random(seed).randrange(len(octets)), random.Random(seed + 1).randrange(1, 256)
    got = read_final(octets[:at] + bytes([octets[at] ^ change]) + octets[at + 1 :])
    assert len(set(payloads) - set(got.payloads)) <= 1
    assert len(got.payloads) >= len(payloads) - 1


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.integers(0, 2**32), cuts)
def test_damage_reads_the_same_however_the_input_is_cut(seed: int, sizes: list[int]) -> None:
    rng = random.Random(seed)
    large = record(rng.randbytes(40_000)) * 26 + record(b"\xa5" * 60_000)
    octets = bytearray(large + many()[2] * rng.randrange(20))
    for _ in range(rng.randrange(60)):
        at = rng.randrange(len(octets))
        octets[at : at + rng.randrange(3)] = rng.randbytes(rng.randrange(3)) + FOOTER * rng.randrange(2)
    whole = read_final(bytes(octets))
    got = read_final(bytes(octets), sizes)
    assert got.grams == whole.grams
    assert got.offsets == whole.offsets


@pytest.mark.parametrize("shift", range(0, 70_000, 6_997))
def test_damage_at_the_border_of_a_window_reads_as_elsewhere(shift: int) -> None:
    head = record(bytes(60_000)) * 17 + record(bytes(shift % 65_000))
    payloads, starts, octets = many()
    bad = octets[: starts[20]] + b"\xff\xff" + octets[starts[20] + 2 : starts[39]] + b"stray" + octets[starts[39] :]
    got = read_final(head + bad)
    assert got.payloads[18:] == payloads[:20] + payloads[21:]
    assert [one.offset - len(head) for one in got.damage] == [starts[20]]
    assert [one.count for one in got.damage] == [2]


def test_final_is_known_by_its_content() -> None:
    octets = many()[2]
    assert looks_final(octets[:65_536])
    assert looks_final(octets[:30])
    assert looks_final(b"\xff\xff" + octets[2:])
    assert looks_final(record(videos(1, size=1000)[0])[:100])
    for other in (b"", b"\0" * 1000, FOOTER * 1000, b"".join(videos(50)), b"\xd4\xc3\xb2\xa1" + octets[100:110], b"{}"):
        assert not looks_final(other)
    assert not looks_final(videos(1)[0] + octets)


@pytest.mark.parametrize("name", ["cat240_vectors.json", "cat240_bad_vectors.json"])
def test_no_message_by_itself_is_taken_for_final(name: str) -> None:
    messages = [bytes.fromhex(one["hex"]) for one in json.loads(shared(f"vectors/{name}").read_text())]
    assert len(messages) > 30
    assert not any(map(looks_final, messages))


PROGRAM = """
import random, sys
from maritrack.io.containers.final import FinalReader
from tests.io.grams import peak_mb
A5 = b"\\xa5" * 4
def cycle(part): return part * (4_000_000 // len(part))
file = {
    "empty records": lambda: cycle(b"\\0\\x0c\\0\\1\\0\\0\\0\\0" + A5),
    "broken footers": lambda: cycle(b"\\0\\x0c\\0\\1\\0\\0\\0\\0" + A5 + b"\\0\\x0c\\0\\1\\0\\0\\0\\0xxxx"),
    "footers": lambda: cycle(A5),
    "claims": lambda: cycle(b"\\xff\\xff\\0\\1\\0\\0\\0\\0" + A5),
    "lines": lambda: b"".join(b"\\0\\x0c" + i.to_bytes(2, "big") + bytes(4) + A5 for i in range(65_536)) * 5,
    "noise": lambda: random.Random(1).randbytes(4_000_000),
}[sys.argv[1]]()
before = peak_mb()
end = 0
for d in FinalReader([file]).datagrams():
    end = d.end
assert end == len(file)
print(end, peak_mb() - before)
"""
KINDS = ("empty records", "broken footers", "footers", "claims", "lines", "noise")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="peak memory is read from /proc")
@pytest.mark.parametrize("kind", KINDS)
def test_hostile_final_takes_little_memory(kind: str) -> None:
    octets, grown = grown_mb(PROGRAM, kind)
    assert octets > 3_000_000
    assert grown < 100
