"""Inputs that are made to cost a reader as much as they can, for each of a size in octets."""

# ruff: noqa: E501
from __future__ import annotations

import struct
import zlib
from collections.abc import Callable

import numpy as np

from tests.io.cat240_blocks import SENTINEL, block, packed_video, video

Octets = tuple[int, str, Callable[[np.ndarray], np.ndarray]]  # place in a block, type, values by number of the block
SUMMARY = b"\xd0\1\2\1\0"
NO_CELLS = video(7, cells=b"", tod=None)  # 29 octets
FOREIGN = b"\x30\0\3"
EMPTY = b"\xf0\0\3"


def filled(size: int, *units: bytes) -> bytes:
    """The units one after another, as often as there is room, and a block that is to be delivered in spite of all."""
    whole = b"".join(units)
    return whole * max(1, (size - len(SENTINEL)) // len(whole)) + SENTINEL


def _wide(size: int, *records: bytes) -> bytes:
    """The same in data blocks that are as long as they can be."""
    whole = b"".join(records)
    return filled(size, block(whole * ((65_535 - 3) // len(whole))))


def _many(size: int, make: Callable[[int], bytes]) -> bytes:
    """Blocks that differ."""
    made, octets = [], 0
    while octets < size - len(SENTINEL):
        made.append(make(len(made)))
        octets += len(made[-1])
    return b"".join(made) + SENTINEL


def counted(size: int, unit: bytes, *fields: Octets) -> bytes:
    """Copies of one unit in which fields (place, type) are functions of the number of the copy."""
    n = max(1, (size - len(SENTINEL)) // len(unit))
    table = np.tile(np.frombuffer(unit, dtype=np.uint8), (n, 1))
    number = np.arange(n)
    for place, kind, values in fields:
        octets = values(number).astype(kind).view(np.uint8).reshape(n, -1)
        table[:, place : place + octets.shape[1]] = octets
    return table.tobytes() + SENTINEL


def _video_block(*, bits_cycle: bool = False, **how: object) -> bytes:
    return block(video(7, cells=b"", **{"tod": None, **how}))  # type: ignore[arg-type]


def _fragments(size: int) -> bytes:
    """Records without cells, each with another resolution than the one before."""
    unit = block(video(7, cells=b"", tod=None))
    return counted(size, unit, (8, ">u4", lambda i: i), (25, "u1", lambda i: 1 + i % 6))


def _fragments_in_blocks(size: int) -> bytes:
    records = b"".join(video(i, cells=b"", tod=None, res=1 + i % 6) for i in range(2250))
    return filled(size, block(records))


def _sensors(size: int) -> bytes:
    unit = block(video(7, cells=b"", tod=5))
    return counted(size, unit, (5, ">u2", lambda i: i % 65_536), (8, ">u4", lambda i: i))


def _backwards(size: int) -> bytes:
    unit = block(video(7, cells=b"", tod=5))
    return counted(size, unit, (8, ">u4", lambda i: i), (33, ">u2", lambda i: 60_000 - i % 60_000))


def _seesaw(size: int) -> bytes:
    unit = block(video(7, cells=b"", tod=5))
    return counted(size, unit, (8, ">u4", lambda i: i), (33, ">u2", lambda i: 60_000 - i % 2))


def _widths(size: int) -> bytes:
    """Wide radials among narrow ones, so that a batch holds few."""
    wide = [block(packed_video(i, bytes(2_097_152), nbcells=524_288, items={"048": b"\x80\6"})) for i in range(8)]
    narrow = b"".join(block(video(100 + i, cells=bytes(4), res=6, nbcells=1, tod=None)) for i in range(16))
    return filled(size, *(one + narrow for one in wide))


def _bombs(size: int, *, cells: int, spoil: int = 0, res: int = 4, declared: int = 0) -> bytes:
    """Compressed radials of zeros that declare what they hold, or other than that, or have a wrong checksum."""
    stream = zlib.compress(bytes(cells), 9)
    stream = stream[: len(stream) - spoil] + bytes(spoil)
    kind = "050" if len(stream) <= 1020 else "051"
    unit = block(
        video(7, cells=stream, nbcells=declared or cells * 8 // (1 << res - 1), compressed=True, video=kind, res=res)
    )
    return counted(size, unit, (8, ">u4", lambda i: i))


def _nested(size: int) -> bytes:
    """Blocks in blocks: the longest LEN at every seventh octet, each with one record that can't be read."""
    return filled(size, b"\xf0\xff\xff\xc0\1\2\1")


def _reread(size: int) -> bytes:
    """Blocks that begin with decoys, each of them a record of no known type, and hold thousands of records."""
    decoy = b"\xf0\xf0\x00\xc0\1\2\2"  # a record of no known type; or the header of a block
    decoys = b"".join(b"\xf0" + struct.pack(">H", 65_535 - 3 - 7 * i) + b"\xc0\1\2\1" for i in range(4000))
    body = SUMMARY + decoys + decoy
    return filled(size, block(body + SUMMARY * ((65_532 - len(body)) // 5)))


def _last_only(size: int) -> bytes:
    """A block of many records, of which the last is of no known type and looks like a block to the end."""
    chain = SUMMARY * 6000
    return filled(size, block(chain + b"\xf0\0\7\xc0\1\2\7"))


CASES: dict[str, Callable[[int], bytes]] = {
    # records that are sound, but not of the usual make
    "summaries, one a block": lambda n: filled(n, block(SUMMARY)),
    "summaries, thousands a block": lambda n: _wide(n, SUMMARY),
    "summaries, three a block": lambda n: filled(n, block(SUMMARY * 3)),
    "summaries, 1 to 40 a block": lambda n: filled(n, *(block(SUMMARY * i) for i in range(1, 41))),
    "summaries with RE and SP": lambda n: _wide(n, b"\xd1\6\1\2\1\0\1\1"),
    "videos of no cells": lambda n: counted(n, block(NO_CELLS), (8, ">u4", lambda i: i)),
    "videos of no cells, thousands a block": lambda n: _wide(n, NO_CELLS),
    "videos of no cells, two a block": lambda n: filled(n, block(NO_CELLS * 2)),
    "videos with a summary text": lambda n: filled(n, block(video(7, cells=b"", tod=None, items={"030": b"\0"}))),
    "videos with RE and SP": lambda n: counted(
        n, block(video(7, cells=b"", items={"RE": b"\1", "SP": b"\1"})), (8, ">u4", lambda i: i)),
    "videos with both headers": lambda n: filled(n, block(video(7, cells=b"", items={"040": b"\0\0\0\1" + bytes(7) + b"\1"}))),
    "videos of four octets, two a block, zlib": lambda n: filled(n, block(packed_video(1, b"abcd"), packed_video(2, b"abcd"))),
    "videos of no index": lambda n: _wide(n, video(7, cells=b"", tod=None, without=["020"])),
    "videos that lack all they can": lambda n: _wide(n, video(7, cells=b"", tod=None, without=["010", "000", "020", "049"])),
    "the same, one a block": lambda n: filled(n, block(video(7, cells=b"", tod=None, without=["010", "000", "020", "049"]))),
    "cells short": lambda n: filled(n, block(video(7, cells=b"", nbcells=1, tod=None))),
    "cells long": lambda n: filled(n, block(video(7, cells=bytes(4), nbcells=1, tod=None))),
    # records that are bad
    "bad records, one a block": lambda n: filled(n, b"\xf0\0\4\0"),
    "bad records, two kinds, one a block": lambda n: filled(n, b"\xf0\0\4\0", b"\xf0\0\5\x40\1"),
    "bad records at the beginning of each block": lambda n: filled(n, block(b"\x40\1" + SUMMARY)),
    "bad records and empty blocks": lambda n: filled(n, b"\xf0\0\4\0", EMPTY),
    "bad records, thousands a block": lambda n: _wide(n, b"\x40\1"),
    "bad records of two kinds, thousands a block": lambda n: _wide(n, b"\x40\1\x40\2"),
    "bad records of many sensors": lambda n: _wide(n, *(b"\xc0" + struct.pack(">H", i * 17 % 65_536) + b"\1" for i in range(16_000))),
    "unknown types, four a block": lambda n: filled(n, block(b"\x40\7" * 4)),
    "no type, four a block": lambda n: filled(n, block(b"\x80\1\2" * 4)),
    "no cell depth": lambda n: filled(n, block(video(7, cells=b"", tod=None, items={"041": bytes(12)}))),
    "cut vendor items": lambda n: filled(n, block(b"\xd1\2\1\2\1\0\5")),
    "summaries that aren't ASCII": lambda n: _wide(n, b"\xd0\1\2\1\1\xff"),
    # the chain of blocks
    "empty blocks": lambda n: filled(n, EMPTY),
    "other categories": lambda n: filled(n, FOREIGN),
    "two other categories": lambda n: filled(n, FOREIGN, b"\x3e\0\4a"),
    "other and empty blocks in turn": lambda n: filled(n, FOREIGN, EMPTY),
    "other categories and summaries in turn": lambda n: filled(n, FOREIGN, block(SUMMARY)),
    "a category that isn't known, and back": lambda n: filled(n, b"\x05\0\3", EMPTY),
    "a chain of nine hops that ends nowhere": lambda n: filled(n, FOREIGN * 7 + b"\0"),
    "F0 alone": lambda n: filled(n, b"\xf0"),
    "octets": lambda n: np.random.default_rng(1).bytes(n) + SENTINEL,
    "octets of F0, F1, 1 and 2": lambda n: np.random.default_rng(2).choice(
        np.array([0xF0, 0xF0, 0xF1, 0xC0, 1, 2, 0], dtype=np.uint8), n).tobytes() + SENTINEL,
    "decoys, three in nine octets": lambda n: filled(n, b"\xf0\xf0\xf0\xc0\xc0\xc0\1\1\1"),
    "decoys, three in eleven octets": lambda n: filled(n, b"\xf0\xf0\xf0\xc1\xc1\xc1\1\1\1\1\1"),
    "decoys with a short LEN": lambda n: filled(n, b"\xf0\0\x10\xc0\1\2\1\x30"),
    "blocks and an octet": lambda n: filled(n, b"\xf0\0\7\xc0\1\2\1", b"\0"),
    "summaries and an octet": lambda n: filled(n, block(SUMMARY), b"\0"),
    "three blocks and an octet": lambda n: filled(n, block(SUMMARY) * 3, b"\0"),
    "forty blocks and an octet": lambda n: filled(n, block(SUMMARY) * 40, b"\0"),
    "blocks that are one too long": lambda n: filled(n, b"\xf0\0\x09" + SUMMARY),
    "blocks that are one too short": lambda n: filled(n, b"\xf0\0\7" + SUMMARY),
    "a LEN of two before each block": lambda n: filled(n, b"\xf0\0\2", block(SUMMARY)),
    "blocks in blocks": _nested,
    "decoys before thousands of records": _reread,
    "an unknown type after thousands of records": _last_only,
    # order
    "the same record again": lambda n: filled(n, block(NO_CELLS)),
    "time that steps back": _backwards,
    "time that steps back and forth": _seesaw,
    "65536 sensors": _sensors,
    # batches
    "another resolution each time": _fragments,
    "another resolution each time, thousands a block": _fragments_in_blocks,
    "wide radials among narrow ones": _widths,
    # cells
    "zlib, 524288 cells of 8 bit": lambda n: _bombs(n, cells=524_288),
    "zlib, 524288 cells of 32 bit": lambda n: _bombs(n, cells=2_097_152, res=6),
    "zlib, wrong checksums": lambda n: _bombs(n, cells=524_288, spoil=1),
    "zlib, wrong checksums, 32 bit": lambda n: _bombs(n, cells=2_097_152, spoil=1, res=6),
    "zlib, more than declared": lambda n: _bombs(n, cells=2_000_000, declared=16),
    "zlib, more than declared, wrong checksum": lambda n: _bombs(n, cells=2_000_000, declared=16, spoil=1),
    "zlib, fewer than declared": lambda n: _bombs(n, cells=100_000, declared=500_000),
    "zlib, one cell": lambda n: counted(n, block(packed_video(7, b"a")), (8, ">u4", lambda i: i)),
    "zlib without a header": lambda n: counted(
        n, block(video(7, cells=zlib.compress(b"a")[2:-4], nbcells=1, compressed=True)), (8, ">u4", lambda i: i)),
    "no zlib": lambda n: filled(n, block(video(7, cells=b"x", nbcells=1, compressed=True))),
}  # fmt: skip
