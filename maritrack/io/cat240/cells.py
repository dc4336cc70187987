"""The cells of CAT240 video records: unpacked, inflated within bounds, and many at a time.

A row (ROW) is what there is to know about a record before its cells are touched. `common_rows` makes the rows of
all blocks of the usual make at once; the others come from `maritrack.io.cat240.exact`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maritrack.io.cat240.exact import INFLATION, MAX_CELLS, TOD_PER_DAY, Video
from maritrack.io.cat240.framing import Window
from maritrack.io.cat240.parallel import Inflated, Inflater
from maritrack.types import BoolArray, IntArray

Cells = NDArray[np.unsignedinteger[Any]]
Rows = NDArray[np.void]  # of ROW

COLUMNS = (
    "block", "block_end", "at", "sac", "sic", "idx", "start_az", "end_az", "start_rg", "cell_dur", "femto",
    "compressed", "bits", "tod", "n_cells", "first", "octets",
    "record",  # index of the exact record, -1 = of the usual make
)  # fmt: skip
ROW = np.dtype([(name, np.int64) for name in COLUMNS])
HEAD = np.dtype([
    ("cat", "u1"), ("len", ">u2"), ("fspec", "u1", 2), ("sac", "u1"), ("sic", "u1"), ("kind", "u1"), ("idx", ">u4"),
    ("start_az", ">u2"), ("end_az", ">u2"), ("start_rg", ">u4"), ("cell_dur", ">u4"), ("flags", "u1"), ("res", "u1"),
    ("nbvb", ">u2"), ("nbcells_high", "u1"), ("nbcells_low", ">u2"), ("rep", "u1"),
])  # fmt: skip
KEYS = slice(COLUMNS.index("idx"), COLUMNS.index("start_rg") + 1)
VARYING = ("len", "idx", "start_az", "end_az", "nbvb", "rep")  # from record to record of one sensor
FEMTO, NANO = 0xE7, 0xEB  # first octets of FSPEC: 010, 000, 020, then 041 or 040, 048
FREE_OCTETS = 16_384  # of a stream that may be inflated without a bound: to 16 MiB at most
KEPT = 16 << 20  # octets; twice as many are kept
TOD, VENDOR = 0x08, 0x06  # bits of the second


def _repetition_octets() -> IntArray:
    """Octets of a repetition of the video block for each second octet of FSPEC, 0 where it isn't common."""
    table = np.zeros(256, dtype=np.int64)
    for video, octets in ((0x40, 4), (0x20, 64), (0x10, 256)):
        for tail in (0, 0x02, 0x04, TOD, TOD | 0x02, TOD | 0x04):
            table[0x80 | video | tail] = octets
    return table


def _same_bits() -> NDArray[np.uint64]:
    """Bits of the words of a head that are the same in all records of a sensor."""
    mask = np.full(HEAD.itemsize, 255, dtype=np.uint8).view(HEAD)
    for name in VARYING:
        mask[name] = 0
    return mask.view(np.uint64)


REPETITION = _repetition_octets()
SAME = _same_bits()
SAME_WORDS = np.flatnonzero(SAME).tolist()
BITS_OF_RES = np.array([0, 1, 2, 4, 8, 16, 32] + [0] * 249, dtype=np.int64)  # 0 = there is none


def common_rows(w: Window, begin: IntArray, end: IntArray) -> tuple[BoolArray, Rows]:
    """Which of the blocks [begin, end) (n,) hold one video record of the usual make, and their rows (n,).

    Usual: nothing to warn of before the cells, all items in place, 049 and the video block in agreement.
    Rows of other blocks are without meaning.
    """
    n = len(begin)
    if n == 0 or len(w.data) < HEAD.itemsize:
        return np.zeros(n, dtype=np.bool_), np.empty(n, dtype=ROW)
    roomy = end - begin >= HEAD.itemsize
    octets = gather(w, np.where(roomy, begin, 0), HEAD.itemsize)
    head = octets.view(HEAD)[:, 0]
    made = head[:1] if _alike(octets) else head  # what holds of one of them holds of all
    sound, base = _bases(made)
    rows = np.repeat(base, n // len(base))
    for name in ("idx", "start_az", "end_az"):
        rows[name] = head[name]
    rows["block"], rows["block_end"], rows["at"], rows["record"] = begin, end, begin + 3, -1
    rows["first"], rows["octets"] = begin + HEAD.itemsize, head["nbvb"]
    tail_fits, rows["tod"] = _tails(w, head, made["fspec"][:, 1], begin, end)
    spans = (rows["end_az"] - rows["start_az"]) % 65_536
    usual = roomy & sound & (spans <= 32_768) & tail_fits & (rows["tod"] < TOD_PER_DAY)
    return usual & _agreeing(base, rows["octets"]), rows


def _alike(octets: NDArray[np.uint8]) -> bool:
    """Whether the heads (n, 32) differ in nothing but VARYING."""
    words = octets.view(np.uint64)
    return all(bool((words[:, i] & SAME[i] == words[0, i] & SAME[i]).all()) for i in SAME_WORDS)


def _bases(head: Rows) -> tuple[BoolArray, Rows]:
    """What heads (k,) say that isn't VARYING, as rows, and whether that is of the usual make."""
    rows = np.zeros(len(head), dtype=ROW)
    for name in ("sac", "sic", "start_rg", "cell_dur"):
        rows[name] = head[name]
    femto = head["fspec"][:, 0] == FEMTO
    rows["femto"], rows["compressed"], rows["bits"] = femto, head["flags"] >> 7, BITS_OF_RES[head["res"]]
    rows["n_cells"] = head["nbcells_high"].astype(np.int64) << 16 | head["nbcells_low"]
    known = femto | (head["fspec"][:, 0] == NANO)
    return known & (head["kind"] == 2) & (rows["bits"] > 0) & (rows["cell_dur"] > 0), rows


def _tails(
    w: Window, head: Rows, second: NDArray[np.uint8], begin: IntArray, end: IntArray
) -> tuple[BoolArray, IntArray]:
    """Whether video block, time and vendor item fill the block to its end, and the times (-1 = none).

    `second` (k,) are the second octets of FSPEC, of all heads or of each.
    """
    timed, has_vendor = second & TOD > 0, second & VENDOR > 0
    room = head["rep"] * REPETITION[second]
    at = begin + HEAD.itemsize + room
    fits = (REPETITION[second] > 0) & (head["nbvb"] <= room)
    tod = np.full(len(head), -1)
    if timed.any():
        four = gather(w, np.minimum(at, len(w.data) - 3) - 1, 4).view(">u4")[:, 0]
        tod = np.where(timed, four & 0xFFFFFF, -1)
        at += 3 * timed
    if has_vendor.any():
        vendor = np.where(has_vendor, w.u8[np.minimum(at, len(w.data) - 1)], 0)
        fits &= ~has_vendor | (vendor > 0)
        at += vendor
    return fits & (at == end), tod


def _agreeing(base: Rows, octets: IntArray) -> BoolArray:
    """Whether the number of cells and the number of octets can both be true."""
    needed = base["n_cells"] * base["bits"] + 7 >> 3
    possible = (base["n_cells"] > 0) & (base["n_cells"] <= MAX_CELLS)
    agree: BoolArray = np.where(base["compressed"] > 0, possible & (needed <= INFLATION * octets), octets == needed)
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


def keep_memory() -> None:
    """Let what is freed be used again instead of being given back and asked for again, which takes longer than reading.

    The memory allocator of Linux (glibc) learns from the release of a large block that such blocks come and go.
    Memory that isn't touched costs nothing.
    """
    np.empty(KEPT, dtype=np.uint8)


def keys_of(rows: Rows) -> IntArray:
    """MSG_INDEX, azimuths and START_RG of rows, (n, 4)."""
    return rows.view(np.int64).reshape(len(rows), len(COLUMNS))[:, KEYS]


def start_cells(w: Window, rows: Rows, inflater: Inflater, *, trusting: bool) -> Callable[[], tuple[Cells, BoolArray]]:
    """Set out for the cells of usual rows; call it to have them.

    They are cells (n, most) and which rows failed, whose cells are without meaning. `trusting`: as long as all goes
    well, inflate without a bound but deflate's own.
    """
    kinds = (rows["n_cells"] << 1 | rows["compressed"]) << 6 | rows["bits"]  # rows of one kind are read together
    if len(rows) and (kinds == kinds[0]).all():
        return _cells_of_kind(w, rows, inflater, trusting=trusting)
    order = np.argsort(kinds, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(kinds[order])) + 1) if len(rows) else []
    started = [(index, _cells_of_kind(w, take_rows(rows, index), inflater, trusting=trusting)) for index in groups]
    return partial(_put_together, rows, started)


def _put_together(
    rows: Rows, started: list[tuple[IntArray, Callable[[], tuple[Cells, BoolArray]]]]
) -> tuple[Cells, BoolArray]:
    """The cells of rows of several kinds."""
    width = cell_type(int(rows["bits"].max(initial=0)))
    cells = np.zeros((len(rows), int(rows["n_cells"].max(initial=0))), dtype=width)
    failed = np.zeros(len(rows), dtype=np.bool_)
    for index, finish in started:
        some, failures = finish()
        cells[index, : some.shape[1]], failed[index] = some, failures
    return cells, failed


def _cells_of_kind(
    w: Window, rows: Rows, inflater: Inflater, *, trusting: bool
) -> Callable[[], tuple[Cells, BoolArray]]:
    """Set out for the cells (m, n) of rows with as many cells of as many bits each, all compressed or none."""
    n, bits = int(rows["n_cells"][0]), int(rows["bits"][0])
    octets = n * bits + 7 >> 3
    if octets and rows["compressed"][0]:
        freely = trusting and bool(rows["octets"].max() <= FREE_OCTETS)
        start = inflater.start(w.data, rows["first"], rows["first"] + rows["octets"], octets, freely=freely)
        return partial(_inflated_cells, start, bits, n)
    return partial(_plain_cells, w, rows, octets)


def _inflated_cells(inflated: Callable[[], Inflated], bits: int, n: int) -> tuple[Cells, BoolArray]:
    packed, wrong = inflated()
    failed = np.zeros(len(packed), dtype=np.bool_)
    failed[wrong] = True
    return unpack(packed, bits=bits, n=n), failed


def _plain_cells(w: Window, rows: Rows, octets: int) -> tuple[Cells, BoolArray]:
    n, bits = int(rows["n_cells"][0]), int(rows["bits"][0])
    failed = np.zeros(len(rows), dtype=np.bool_)
    if octets == 0:
        return np.zeros((len(rows), 0), dtype=cell_type(bits)), failed
    return unpack(gather(w, rows["first"], octets), bits=bits, n=n), failed


def gather(w: Window, first: IntArray, n: int) -> NDArray[np.uint8]:
    """The `n` octets from each place on, (m, n)."""
    # A view with n octets at every place, of which only the wanted ones are copied.
    everywhere = np.ndarray((len(w.data) - n + 1,), dtype=f"V{n}", buffer=w.data, strides=(1,))
    return everywhere[first].view(np.uint8).reshape(len(first), n)


def take_rows(rows: Rows, index: IntArray) -> Rows:
    """`rows[index]`, without copying field by field."""
    return rows.view(f"V{ROW.itemsize}")[index].view(ROW)


def join_rows(parts: list[Rows]) -> Rows:
    """All of them one behind the other, without looking into the fields."""
    if len(parts) == 1:
        return parts[0]
    whole = np.concatenate([np.zeros(0, dtype=f"V{ROW.itemsize}"), *(rows.view(f"V{ROW.itemsize}") for rows in parts)])
    return whole.view(ROW)
