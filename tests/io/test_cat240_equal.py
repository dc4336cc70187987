"""The fast way and the exact way read the same, wherever the input is cut and whatever is in it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.io.cat240 import framing
from maritrack.io.dump import dump_records
from tests.io.cat240_blocks import SENTINEL, block, damage, packed_video, read, record, rows, video

SP = b"\4abc"
EASY = settings(derandomize=True, deadline=None, max_examples=150)


@st.composite
def segments(draw: st.DrawFn) -> bytes:
    """A block of one of the kinds that occur, or something that isn't one."""
    idx = draw(st.integers(0, 60))
    tod = draw(st.none() | st.integers(400, 600) | st.integers(11_059_100, 11_059_300))
    sensor = (1, draw(st.sampled_from([2, 2, 2, 3])))
    how: dict[str, Any] = {"tod": tod, "sac_sic": sensor}
    cells = bytes(draw(st.integers(0, 255)) for _ in range(draw(st.sampled_from([0, 3, 16]))))
    make = draw(st.integers(0, 15))
    if make < 4:
        return b"".join(block(video(idx + i, cells=cells, **how)) for i in range(draw(st.integers(1, 12))))
    if make < 6:
        return b"".join(block(packed_video(idx + i, cells * 9, **how)) for i in range(draw(st.integers(1, 12))))
    return {
        6: lambda: block(video(idx, items={"SP": SP}, **how)),
        7: lambda: block(video(idx, **how), video(idx + 1, res=3, nbcells=draw(st.integers(0, 40)), **how)),
        8: lambda: block(record({"010": b"\1\2", "000": b"\1", "030": b"\3abc"})),
        9: lambda: b"\xf0\0\3" * draw(st.integers(1, 3)),
        10: lambda: bytes.fromhex("30000a00000000000000") * draw(st.integers(1, 10)),
        11: lambda: draw(st.binary(max_size=12)),
        12: lambda: block(video(idx, **how), length=draw(st.integers(0, 150))),
        13: lambda: block(packed_video(idx, cells, nbcells=draw(st.integers(0, 40)), **how)),
        14: lambda: block(video(idx, items={"049": draw(st.binary(min_size=5, max_size=5))}, **how)),
        15: lambda: block(
            video(idx, without=[draw(st.sampled_from(["010", "000", "020", "048", "049", "050"]))], **how)
        ),
    }[make]()


@st.composite
def streams(draw: st.DrawFn) -> bytes:
    """Blocks one after another, with a few octets changed, and maybe an end that is cut off."""
    octets = bytearray(b"".join(draw(st.lists(segments(), max_size=12))))
    for _ in range(draw(st.integers(0, 4))):
        if octets:
            octets[draw(st.integers(0, len(octets) - 1))] = draw(st.integers(0, 255))
    return bytes(octets[: len(octets) - draw(st.sampled_from([0, 0, 1, 20]))])


@given(streams())
@EASY
def test_the_fast_way_equals_the_exact_way(octets: bytes) -> None:
    fast, exact = read(octets), read(octets, fast=False)
    assert rows(fast) == rows(exact)
    assert damage(fast) == damage(exact)


@given(streams(), st.sampled_from([1, 2, 17, 1000]))
@EASY
def test_chunks_of_any_size_read_the_same(octets: bytes, chunk: int) -> None:
    whole, cut = read(octets), read(octets, chunk=chunk)
    assert rows(whole) == rows(cut)
    assert damage(whole) == damage(cut)


@given(streams())
@EASY
def test_the_octets_of_the_batches_are_the_input(octets: bytes) -> None:
    batches = read(octets)
    assert b"".join(batch.octets for batch in batches) == octets
    ends = [0, *(batch.end for batch in batches)]
    assert [batch.start for batch in batches] == ends[:-1]


@given(streams())
@EASY
def test_dump_shows_the_radials_and_the_problems_of_the_reader(octets: bytes) -> None:
    shown, batches = list(dump_records([octets], cells=True)), read(octets)
    videos = [(row.get("idx", -1), row["cells"]) for row in shown if row.get("type") == 2]
    assert videos == [(row[3], row[-1]) for row in rows(batches)]
    told = [row["warning"] for row in shown if "warning" in row for _ in range(row.get("count", 1))]
    assert told == [one[0] for one in damage(batches) for _ in range(one[4])]
    assert [row["offset"] for row in shown if "type" in row] == sorted(row["offset"] for row in shown if "type" in row)


@given(st.binary(max_size=400))
@settings(derandomize=True, deadline=None, max_examples=300)
def test_any_octets_are_read_without_an_exception(octets: bytes) -> None:
    batches = read(octets)
    assert b"".join(batch.octets for batch in batches) == octets
    assert damage(batches) == damage(read(octets, fast=False))
    assert len([one for batch in batches for one in batch.damage]) <= len(octets)


@given(st.lists(st.binary(max_size=40), min_size=1, max_size=20))
@settings(derandomize=True, deadline=None, max_examples=200)
def test_any_octets_inside_sound_blocks_cost_those_blocks_only(bodies: list[bytes]) -> None:
    octets = b"".join(block(body) for body in bodies) + SENTINEL * 2
    fast, exact = read(octets), read(octets, fast=False)
    assert rows(fast) == rows(exact)
    assert damage(fast) == damage(exact)
    assert 999 in [row[3] for row in rows(fast)]


MAKES: dict[str, Any] = {
    "raw": video(7, azimuth=(0, 30_000)),
    "raw 12 bit short": video(7, cells=bytes(18), nbcells=12, res=5, nbvb=24, video="051"),
    "zlib": packed_video(7, bytes(range(100)), azimuth=(0, 30_000)),
    "zlib 4 bit": packed_video(7, bytes(range(16)), nbcells=32, items={"048": b"\x80\3"}),
    "without time": video(7, tod=None),
    "SP": video(7, items={"SP": SP}),
    "RE, no time": video(7, tod=None, items={"RE": b"\2a"}),
    "RE and SP": video(7, items={"RE": b"\2a", "SP": b"\1"}),
}


@pytest.mark.parametrize("make", MAKES)
def test_one_wrong_octet_anywhere_in_a_block_reads_the_same(make: str) -> None:
    before = b"".join(block(video(100 + i)) for i in range(5))
    after = b"".join(block(video(200 + i)) for i in range(5))
    sound = block(MAKES[make])
    for at in range(len(sound)):
        for octet in {
            0,
            1,
            2,
            3,
            7,
            8,
            127,
            128,
            255,
            sound[at] ^ 1,
            sound[at] ^ 8,
            sound[at] + 1 & 255,
            sound[at] - 1 & 255,
        }:
            octets = before + sound[:at] + bytes((octet,)) + sound[at + 1 :] + after
            fast, exact = read(octets), read(octets, fast=False)
            assert (rows(fast), damage(fast)) == (rows(exact), damage(exact)), (at, octet)


def damaged_recording(seed: int, *, size: int) -> bytes:
    """A long recording with a wrong octet, a lost stretch or a foreign block every few thousand octets."""
    rng = np.random.default_rng(seed)
    video_cells = rng.integers(0, 30, (64, 48), dtype=np.uint8)
    blocks = [block(video(i, cells=video_cells[i].tobytes(), tod=i)) for i in range(64)]
    blocks += [block(packed_video(64 + i, video_cells[i].tobytes() * 20, tod=99)) for i in range(64)]
    octets = bytearray()
    while len(octets) < size:
        octets += b"".join(blocks)
    for at in np.cumsum(rng.integers(1, 9000, size // 4500)).tolist():
        if at < len(octets):
            octets[at : at + int(rng.integers(0, 3))] = rng.bytes(int(rng.integers(0, 3)))
    return bytes(octets)


@pytest.mark.parametrize("seed", range(3))
def test_a_long_damaged_recording_reads_the_same_however_it_is_cut(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    octets = damaged_recording(seed, size=3 * framing.LOOKAHEAD)
    whole = read(octets)
    monkeypatch.setattr(framing, "PIECE_LEAST", 40_000)
    monkeypatch.setattr(framing, "PIECE_MOST", 100_000)
    cut = read(octets, chunk=33_333 + seed)
    assert len(cut) > len(whole)
    assert rows(whole) == rows(cut)
    assert damage(whole) == damage(cut)
    assert len(damage(whole)) > 100
