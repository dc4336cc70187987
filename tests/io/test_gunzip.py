"""What gzip holds comes out, piece by piece, and what is broken is named."""

from __future__ import annotations

import gzip
import random
import struct
import sys
import zlib
from collections.abc import Iterable
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.io.containers.gunzip import BUDGET_FLOOR, BUDGET_RATIO, MAX_BROKEN, PIECE, gunzip
from maritrack.types import Damage
from tests.io.grams import cuts, grown_mb, pieces

TEXT = b"".join(b"%d sails in sight, " % i for i in range(3000))
NOISE = random.Random(1).randbytes(300_000)


def pack(data: bytes) -> bytes:
    return gzip.compress(data, mtime=0)


def unpack(chunks: Iterable[bytes]) -> tuple[bytes, bytes, list[Damage]]:
    data, stored, damage = [], [], []
    for piece in gunzip(chunks):
        assert len(piece.data) <= PIECE
        data.append(piece.data)
        stored.append(piece.stored)
        damage += piece.damage
    return b"".join(data), b"".join(stored), damage


def codes(damage: Iterable[Damage]) -> list[tuple[str, int]]:
    return [(one.code, one.offset) for one in damage]


@settings(derandomize=True, deadline=None, max_examples=50)
@given(st.lists(st.sampled_from([b"", b"x", TEXT, NOISE, bytes(600_000)]), min_size=1, max_size=5), cuts)
def test_members_come_out_one_behind_the_other(members: list[bytes], sizes: list[int]) -> None:
    file = b"".join(map(pack, members))
    assert unpack(pieces(file, sizes)) == (b"".join(members), file, [])


def test_nothing_holds_nothing() -> None:
    assert unpack([]) == (b"", b"", [])


@pytest.mark.parametrize("flags", range(32))
def test_every_header_is_understood(flags: int) -> None:
    extra = struct.pack("<H", 70_000 % 65_536) + bytes(70_000 % 65_536)
    head = b"\x1f\x8b\x08" + bytes([flags]) + bytes(6) + extra * bool(flags & 4)
    head += (b"n" * 60_000 + b"\0") * bool(flags & 8) + b"comment\0" * bool(flags & 16)
    file = head + b"\x12\x34" * bool(flags & 2) + pack(TEXT)[10:]
    assert gzip.decompress(file) == TEXT
    assert unpack(pieces(file * 2, [7_777])) == (TEXT * 2, file * 2, [])


def oracle(file: bytes) -> bytes:
    """What zlib makes of the first member, an octet at a time until it stumbles."""
    inflater, data = zlib.decompressobj(-15), b""
    for i in range(10, len(file)):
        try:
            data += inflater.decompress(file[i : i + 1])
        except zlib.error:
            break
    return data


@pytest.mark.parametrize("size", [1, 9, 10, 11, 500, 4000, -9, -8, -1])
def test_a_cut_file_gives_all_up_to_the_cut(size: int) -> None:
    file = pack(TEXT)[:size]
    assert unpack([file]) == (oracle(file), file, [Damage("gzip-cut", len(file), "the file ends within a gzip member")])


def test_a_cut_in_the_second_member_gives_the_first() -> None:
    first = pack(TEXT)
    for size in range(1, 18):
        file = first + pack(b"")[:size]
        data, stored, damage = unpack([file])
        assert (data, stored, codes(damage)) == (TEXT, file, [("gzip-cut", len(file))])


@pytest.mark.parametrize("place", [2000, 4000, 5000, 6000])
@pytest.mark.parametrize("content", [TEXT, TEXT + NOISE], ids=["text", "text and noise"])
def test_all_before_a_break_is_delivered_and_the_members_after_it(place: int, content: bytes) -> None:
    broken = bytearray(pack(content))
    broken[place : place + 12] = bytes(12)
    after = b"after" + NOISE[:5000]
    file = pack(b"before") + bytes(broken) + pack(after) + pack(b"that")
    data, stored, damage = unpack([file])
    believed = oracle(bytes(broken))
    assert len(believed) > place
    assert data.startswith(b"before" + believed)
    assert data.endswith(after + b"that")
    assert stored == file
    assert [one.code for one in damage] in (["gzip-error"], ["gzip-crc"], ["gzip-cut"])  # the last: inflated to the end
    assert damage[0].offset >= file.index(bytes(broken)) + place


def test_octets_that_only_look_like_a_member_are_not_taken_for_one() -> None:
    lures = b"\x1f\x8b\x08\0\0\0\0\0\0\3" + b"\xff" * 600 + pack(b"a lure")[:-8] + bytes(8) + NOISE
    file = pack(TEXT) + lures + pack(b"after")
    data, stored, damage = unpack([file])
    assert (data, stored) == (TEXT + b"after", file)
    assert codes(damage) == [("gzip-error", len(pack(TEXT)) + 10)]


def test_a_wrong_crc_or_length_is_named_and_nothing_is_held_back() -> None:
    good = pack(TEXT)
    for place in (-8, -5, -4, -1):
        bad = bytearray(good)
        bad[place] ^= 4
        data, stored, damage = unpack([good + bytes(bad) + good])
        assert (data, stored) == (TEXT * 3, good + bytes(bad) + good)
        assert codes(damage) == [("gzip-crc", 2 * len(good) - 8)]


@pytest.mark.parametrize("junk", [b"\0", bytes(1000), b"junk", NOISE, b"\x1f\x8b\x08\xff" + NOISE], ids=len)
def test_what_is_no_member_behind_one_is_junk(junk: bytes) -> None:
    file = pack(TEXT) + junk
    data, stored, damage = unpack([file])
    assert (data, stored, codes(damage)) == (TEXT, file, [("gzip-junk", len(pack(TEXT)))])


def test_a_bomb_stops_at_its_budget_and_the_stored_octets_go_on() -> None:
    file = pack(bytes(3 * BUDGET_FLOOR)) + pack(TEXT)
    data, stored, damage = unpack(pieces(file, [100_000]))
    assert BUDGET_FLOOR <= len(data) <= max(BUDGET_FLOOR, BUDGET_RATIO * len(file))
    assert (stored, [one.code for one in damage]) == (file, ["inflation-budget"])


def test_a_file_within_the_budget_is_unpacked_whole() -> None:
    content = (NOISE[:1000] + bytes(200_000)) * 500
    assert len(content) > BUDGET_FLOOR
    assert unpack([pack(content)])[0] == content


def test_there_is_an_end_of_broken_members() -> None:
    file = (pack(b"good") + b"\x1f\x8b\x08\0\0\0\0\0\0\3\xff") * (3 * MAX_BROKEN)
    data, stored, damage = unpack([file])
    assert len(data) == 4 * (MAX_BROKEN + 1)
    assert stored == file
    assert sum(one.count for one in damage) == MAX_BROKEN + 1


@settings(derandomize=True, deadline=None, max_examples=100)
@given(st.integers(0, 2**32), cuts)
def test_damage_reads_the_same_however_the_input_is_cut(seed: int, sizes: list[int]) -> None:
    rng = random.Random(seed)
    file = bytearray(pack(TEXT) + pack(NOISE) + rng.randbytes(rng.randrange(50)) + pack(TEXT * 3))
    for _ in range(rng.randrange(4)):
        file[rng.randrange(len(file))] = rng.randrange(256)
    octets = bytes(file[: rng.randrange(len(file))] if rng.randrange(2) else file)
    whole = unpack([octets])
    assert whole[1] == octets
    assert unpack(pieces(octets, sizes)) == whole


def test_stored_octets_come_with_what_they_hold() -> None:
    file = b"".join(pack(NOISE[i : i + 50_000]) for i in range(0, len(NOISE), 50_000)) * 20
    seen = [(len(piece.data), len(piece.stored)) for piece in gunzip([file])]
    assert len(seen) > 10
    assert all(0.9 < data / stored < 1.1 for data, stored in seen)


PROGRAM = """
import gzip, random, sys
from maritrack.io.containers.gunzip import gunzip
from tests.io.grams import peak_mb
noise = random.Random(1).randbytes
def pack(data): return gzip.compress(data, mtime=0)
def cycle(part): return part * (4_000_000 // len(part))
file = {
    "empty members": lambda: cycle(pack(b"")),
    "bad CRCs": lambda: cycle(pack(b"x")[:-1] + b"?"),
    "broken members": lambda: cycle(pack(b"x") + b"\\x1f\\x8b\\x08\\0\\0\\0\\0\\0\\0\\3\\xff"),
    "headers": lambda: cycle(b"\\x1f\\x8b\\x08\\0\\0\\0\\0\\0\\0\\3"),
    "endless names": lambda: cycle(b"\\x1f\\x8b\\x08\\x18\\1\\1\\1\\1\\1\\3"),
    "bombs": lambda: cycle(pack(noise(700) + bytes(70_000))),
    "noise": lambda: pack(b"") + noise(4_000_000),
}[sys.argv[1]]()
before = peak_mb()
assert sum(len(piece.stored) for piece in gunzip([file])) == len(file)
print(len(file), peak_mb() - before)
"""
KINDS = ("empty members", "bad CRCs", "broken members", "headers", "endless names", "bombs", "noise")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="peak memory is read from /proc")
@pytest.mark.parametrize("kind", KINDS)
def test_hostile_gzip_takes_little_memory(kind: str) -> None:
    octets, grown = grown_mb(PROGRAM, kind)
    assert octets > 3_000_000
    assert grown < 60


def test_pieces_follow_each_other_in_the_file() -> None:
    file = pack(bytes(20_000_000)) + b"junk" + pack(TEXT)
    places = [0]
    for piece in gunzip(pieces(file, [12_345])):
        places.append(places[-1] + len(piece.stored))
        assert all(one.offset <= places[-1] for one in piece.damage)
    assert all(a <= b for a, b in pairwise(places))
    assert places[-1] == len(file)
