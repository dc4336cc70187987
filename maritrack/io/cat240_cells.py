"""The cells of CAT240 video records: unpacked, inflated within bounds, and many at a time.

A row (ROW) is what there is to know about a record before its cells are touched. `common_rows` makes the rows of
all blocks of the usual make at once; the others come from `maritrack.io.cat240_exact`.
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maritrack.io.cat240_exact import INFLATION, MAX_CELLS, TOD_PER_DAY, Video
from maritrack.io.cat240_items import Trouble
from maritrack.io.framing import Window
from maritrack.types import BoolArray, IntArray

Cells = NDArray[np.unsignedinteger[Any]]
Rows = NDArray[np.void]  # of ROW

ROW = np.dtype([(name, np.int64) for name in (
    "block", "block_end", "at", "sac", "sic", "idx", "start_az", "end_az", "start_rg", "cell_dur", "femto",
    "compressed", "bits", "tod", "n_cells", "first", "octets",
    "record",  # index of the exact record, -1 = of the usual make
)])  # fmt: skip
HEAD = np.dtype([
    ("cat", "u1"), ("len", ">u2"), ("fspec", "u1", 2), ("sac", "u1"), ("sic", "u1"), ("kind", "u1"), ("idx", ">u4"),
    ("start_az", ">u2"), ("end_az", ">u2"), ("start_rg", ">u4"), ("cell_dur", ">u4"), ("flags", "u1"), ("res", "u1"),
    ("nbvb", ">u2"), ("nbcells_high", "u1"), ("nbcells_low", ">u2"), ("rep", "u1"),
])  # fmt: skip
FEMTO, NANO = 0xE7, 0xEB  # first octets of FSPEC: 010, 000, 020, then 041 or 040, 048
TOD, VENDOR = 0x08, 0x06  # bits of the second
FREE_OCTETS = 4096  # of a stream that may be inflated without a bound: to 4 MiB at most


def _repetition_octets() -> IntArray:
    """Octets of a repetition of the video block for each second octet of FSPEC, 0 where it isn't common."""
    table = np.zeros(256, dtype=np.int64)
    for video, octets in ((0x40, 4), (0x20, 64), (0x10, 256)):
        for tail in (0, 0x02, 0x04, TOD, TOD | 0x02, TOD | 0x04):
            table[0x80 | video | tail] = octets
    return table


REPETITION = _repetition_octets()
BITS_OF_RES = np.array([0, 1, 2, 4, 8, 16, 32] + [0] * 249, dtype=np.int64)  # 0 = there is none


def common_rows(w: Window, starts: IntArray) -> tuple[BoolArray, Rows]:
    """Which of the blocks between `starts` (n + 1,) hold one video record of the usual make, and their rows (n,).

    Usual: nothing to warn of before the cells, all items in place, 049 and the video block in agreement.
    Rows of other blocks are without meaning.
    """
    begin, end = starts[:-1], starts[1:]
    rows = np.empty(len(begin), dtype=ROW)
    if len(w.data) < HEAD.itemsize:
        return np.zeros(len(begin), dtype=np.bool_), rows
    roomy = end - begin >= HEAD.itemsize
    head = gather(w, np.where(roomy, begin, 0), HEAD.itemsize).view(HEAD)[:, 0]
    for name in ("sac", "sic", "idx", "start_az", "end_az", "start_rg", "cell_dur"):
        rows[name] = head[name]
    rows["block"], rows["block_end"], rows["at"], rows["record"] = begin, end, begin + 3, -1
    femto = head["fspec"][:, 0] == FEMTO
    rows["femto"] = femto
    rows["compressed"] = head["flags"] >> 7
    rows["bits"] = BITS_OF_RES[head["res"]]
    rows["n_cells"] = head["nbcells_high"].astype(np.int64) << 16 | head["nbcells_low"]
    rows["first"], rows["octets"] = begin + HEAD.itemsize, head["nbvb"]
    tail_fits, rows["tod"] = _tails(w, head, begin, end)
    known = femto | (head["fspec"][:, 0] == NANO)
    sound = (head["kind"] == 2) & (rows["bits"] > 0) & (rows["cell_dur"] > 0)
    sound &= (rows["end_az"] - rows["start_az"]) % 65_536 <= 32_768
    return roomy & known & sound & tail_fits & (rows["tod"] < TOD_PER_DAY) & _agreeing(rows), rows


def _tails(w: Window, head: Rows, begin: IntArray, end: IntArray) -> tuple[BoolArray, IntArray]:
    """Whether video block, time and vendor item fill the block to its end, and the times (-1 = none)."""
    second = head["fspec"][:, 1]
    room = head["rep"] * REPETITION[second]
    at = begin + HEAD.itemsize + room
    last = len(w.u8) - 1
    timed = second & TOD > 0
    octets = [w.u8[np.minimum(at + i, last)].astype(np.int64) for i in range(3)]
    at = at + 3 * timed
    vendor = np.where(second & VENDOR > 0, np.maximum(w.u8[np.minimum(at, last)], 1), 0)
    fits = (REPETITION[second] > 0) & (at + vendor == end) & (head["nbvb"] <= room)
    empty = (second & VENDOR > 0) & (w.u8[np.minimum(at, last)] == 0)
    return fits & ~empty, np.where(timed, octets[0] << 16 | octets[1] << 8 | octets[2], -1)


def _agreeing(rows: Rows) -> BoolArray:
    """Whether the number of cells and the number of octets can both be true."""
    needed = rows["n_cells"] * rows["bits"] + 7 >> 3
    possible = (rows["n_cells"] > 0) & (rows["n_cells"] <= MAX_CELLS) & (needed <= INFLATION * rows["octets"])
    agree: BoolArray = np.where(rows["compressed"] > 0, possible, rows["octets"] == needed)
    return agree


def row_of(record: Video, index: int) -> tuple[int, ...]:
    """The row of a record of any make, as a tuple in the order of ROW."""
    tod = -1 if record.tod is None or record.tod >= TOD_PER_DAY else record.tod
    return (
        record.block, record.block_end, record.at, record.sac or 0, record.sic or 0,
        -1 if record.idx is None else record.idx, record.start_az, record.end_az, record.start_rg, record.cell_dur,
        record.femto, record.compressed, record.bits, tod, record.most_cells, record.first,
        record.stop - record.first, index,
    )  # fmt: skip


def cell_type(bits: int) -> np.dtype[np.unsignedinteger[Any]]:
    """The smallest native unsigned integer that holds a cell."""
    return np.dtype(f"u{max(bits, 8) // 8}")


def unpack(octets: NDArray[np.uint8], *, bits: int, n: int) -> Cells:
    """The first `n` cells of each row of octets (m, k): sub-octet cells from the most significant bit on."""
    if bits == 8:
        return octets[:, :n]
    if bits > 8:
        wide = np.ascontiguousarray(octets[:, : n * bits // 8]).view(f">u{bits // 8}")
        return wide.astype(cell_type(bits))
    if bits == 1:
        return np.unpackbits(octets, axis=1)[:, :n]
    per_octet = 8 // bits
    cells = np.empty((len(octets), octets.shape[1] * per_octet), dtype=np.uint8)
    for i in range(per_octet):
        cells[:, i::per_octet] = octets >> (8 - bits * (i + 1)) & (1 << bits) - 1
    return cells[:, :n]


def exact_cells(data: bytes, record: Video) -> tuple[Cells | None, Trouble | None]:
    """The cells of one record (n,), None where they have to be dropped, and what is wrong with them."""
    n, trouble = record.most_cells, None
    packed: bytes | None = data[record.first : record.stop]
    if packed is not None and record.compressed and (packed or record.nbcells != 0):
        packed, trouble = _inflate(packed, n, record)
    if packed is None:
        return None, trouble
    held = len(packed) * 8 // record.bits
    if trouble is None and record.nbcells is not None and held < record.nbcells:
        trouble = ("cells-short", f"{record.nbcells} cells are declared, the octets hold {held}")
    octets = -(-record.nbcells * record.bits // 8) if record.nbcells is not None else 0
    if not record.compressed and record.nbvb == record.stop - record.first > octets:
        trouble = ("cells-long", f"{record.nbcells} cells are declared, {record.nbvb} octets are valid")
    n = min(n, held)
    return unpack(np.frombuffer(packed, dtype=np.uint8)[None, :], bits=record.bits, n=n)[0], trouble


def _inflate(packed: bytes, n: int, record: Video) -> tuple[bytes | None, Trouble | None]:
    """The octets of `n` cells out of a zlib stream, never many more than that."""
    most = n * record.bits + 7 >> 3
    stream = zlib.decompressobj()
    try:
        octets = stream.decompress(packed, most + 1)
    except zlib.error as error:
        octets = b"" if _is_zlib(packed) else _inflate_bare(packed, most)
        return (octets, None) if octets else (None, ("zlib-error", f"cells can't be inflated: {error}"))
    if len(octets) > most:
        if n == MAX_CELLS and record.nbcells != n:
            return octets[:most], ("cells-capped", f"more than {MAX_CELLS} cells")
        return octets[:most], ("inflates-beyond-declared", f"the cells inflate to more than the {n} declared")
    if not stream.eof:
        return None, ("zlib-error", "cells can't be inflated: the stream is cut off")
    return octets, None


def _is_zlib(packed: bytes) -> bool:
    """Whether the two octets of a zlib header are there, so that a failure isn't for want of them."""
    return len(packed) >= 2 and packed[0] & 0x0F == 8 and packed[0] >> 4 <= 7 and (packed[0] << 8 | packed[1]) % 31 == 0


def _inflate_bare(packed: bytes, most: int) -> bytes:
    """The octets of a deflate stream without zlib's header, empty where they aren't exactly as many as declared."""
    stream = zlib.decompressobj(-15)
    try:
        octets = stream.decompress(packed, most + 1)
    except zlib.error:
        return b""
    return octets if stream.eof and len(octets) == most and not stream.unused_data else b""


def common_cells(w: Window, rows: Rows, *, trusting: bool) -> tuple[Cells, BoolArray]:
    """Cells (n, most) of usual rows, all of one width in bits, and which rows failed (theirs are without meaning).

    `trusting`: as long as all goes well, inflate without a bound but deflate's own.
    """
    bits, counts = int(rows["bits"][0]), rows["n_cells"]
    kinds = counts << 1 | rows["compressed"]  # rows of one kind are read together
    failed = np.zeros(len(rows), dtype=np.bool_)
    if (kinds == kinds[0]).all():
        return _cells_of_kind(w, rows, failed, trusting=trusting), failed
    cells = np.zeros((len(rows), int(counts.max())), dtype=cell_type(bits))
    order = np.argsort(kinds, kind="stable")
    for index in np.split(order, np.flatnonzero(np.diff(kinds[order])) + 1):
        n, failures = int(counts[index[0]]), np.zeros(len(index), dtype=np.bool_)
        cells[index, :n] = _cells_of_kind(w, take_rows(rows, index), failures, trusting=trusting)
        failed[index] = failures
    return cells, failed


def _cells_of_kind(w: Window, rows: Rows, failed: BoolArray, *, trusting: bool) -> Cells:
    """Cells (m, n) of rows with as many cells each, all compressed or none; the failing ones are marked."""
    n, bits = int(rows["n_cells"][0]), int(rows["bits"][0])
    octets = n * bits + 7 >> 3
    if octets == 0:
        return np.zeros((len(rows), 0), dtype=cell_type(bits))
    if not rows["compressed"][0]:
        return unpack(gather(w, rows["first"], octets), bits=bits, n=n)
    packed = np.empty((len(rows), octets), dtype=np.uint8)
    done = _inflate_freely(w, rows, packed) if trusting and rows["octets"].max() <= FREE_OCTETS else 0
    if done < len(rows):
        _inflate_bounded(w, rows[done:], packed[done:], failed[done:])
    return unpack(packed, bits=bits, n=n)


def gather(w: Window, first: IntArray, n: int) -> NDArray[np.uint8]:
    """The `n` octets from each place on, (m, n)."""
    # A view with n octets at every place, of which only the wanted ones are copied.
    everywhere = np.ndarray((len(w.data) - n + 1,), dtype=f"V{n}", buffer=w.data, strides=(1,))
    return everywhere[first].view(np.uint8).reshape(len(first), n)


def take_rows(rows: Rows, index: IntArray) -> Rows:
    """`rows[index]`, without copying field by field."""
    return rows.view(f"V{ROW.itemsize}")[index].view(ROW)


def _inflate_freely(w: Window, rows: Rows, packed: NDArray[np.uint8]) -> int:
    """Inflate the streams of rows into `packed` (m, n), up to the first that doesn't give n octets; its index.

    A tenth faster than the bounded way, and only one stream of a recording can grow beyond what it declares.
    """
    n, size = packed.shape[1], packed.shape[1] + 1
    target, source, inflate = packed.data.cast("B"), memoryview(w.data), zlib.decompress
    to = 0
    try:
        for first, stop in zip(rows["first"].tolist(), (rows["first"] + rows["octets"]).tolist(), strict=True):
            target[to : to + n] = inflate(source[first:stop], 15, size)
            to += n
    except (zlib.error, ValueError):  # ValueError: not n octets
        pass
    return int(to // n)


def _inflate_bounded(w: Window, rows: Rows, packed: NDArray[np.uint8], failed: BoolArray) -> None:
    """Inflate the streams of rows into `packed` (m, n), never more than that; those that don't fit are marked."""
    n = packed.shape[1]
    target, source = packed.data.cast("B"), memoryview(w.data)
    spans = zip(rows["first"].tolist(), (rows["first"] + rows["octets"]).tolist(), strict=True)
    for i, (first, stop) in enumerate(spans):
        stream = zlib.decompressobj()
        try:
            target[i * n : i * n + n] = stream.decompress(source[first:stop], n + 1)
        except (zlib.error, ValueError):  # ValueError: not n octets
            failed[i] = True
        else:
            failed[i] = not stream.eof
