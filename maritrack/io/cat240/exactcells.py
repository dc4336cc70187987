"""The cells of one CAT240 record, read the exact way: bounded, and with the word for what is wrong with them."""

from __future__ import annotations

import zlib
from typing import NamedTuple

import numpy as np

from maritrack.io.cat240.cells import COLUMNS, Cells, unpack
from maritrack.io.cat240.exact import MAX_CELLS, Video
from maritrack.io.cat240.items import Trouble


class Sent(NamedTuple):
    """What there is to know about the cells of one record."""

    first: int  # the valid octets
    stop: int
    compressed: bool
    bits: int
    most: int  # cells that it can hold
    nbcells: int | None  # as declared
    nbvb: int | None

    @classmethod
    def of(cls, record: Video) -> Sent:
        """The cells of an exact record."""
        return cls(
            record.first, record.stop, record.compressed, record.bits, record.most_cells, record.nbcells, record.nbvb
        )

    @classmethod
    def usual(cls, row: np.void) -> Sent:
        """The cells of a record of the usual make."""
        told = dict(zip(COLUMNS, row.item(), strict=True))
        first, octets, n = told["first"], told["octets"], told["n_cells"]
        return cls(first, first + octets, told["compressed"] > 0, told["bits"], n, n, octets)


def exact_cells(data: bytes, sent: Sent) -> tuple[Cells | None, Trouble | None]:
    """The cells of one record (n,), None where they have to be dropped, and what is wrong with them."""
    n, trouble = sent.most, None
    packed: bytes | None = data[sent.first : sent.stop]
    if packed is not None and sent.compressed and (packed or sent.nbcells != 0):
        packed, trouble = _inflate(packed, sent)
    if packed is None:
        return None, trouble
    held = len(packed) * 8 // sent.bits
    if trouble is None and sent.nbcells is not None and held < sent.nbcells:
        trouble = ("cells-short", f"{sent.nbcells} cells are declared, the octets hold {held}")
    octets = -(-sent.nbcells * sent.bits // 8) if sent.nbcells is not None else 0
    if not sent.compressed and sent.nbvb == sent.stop - sent.first > octets:
        trouble = ("cells-long", f"{sent.nbcells} cells are declared, {sent.nbvb} octets are valid")
    n = min(n, held)
    return unpack(np.frombuffer(packed, dtype=np.uint8)[None, :], bits=sent.bits, n=n)[0], trouble


def _inflate(packed: bytes, sent: Sent) -> tuple[bytes | None, Trouble | None]:
    """The octets of the cells out of a zlib stream, never many more than that."""
    n, most = sent.most, sent.most * sent.bits + 7 >> 3
    stream = zlib.decompressobj()
    try:
        octets = stream.decompress(packed, most + 1)
    except zlib.error as error:
        octets = b"" if _is_zlib(packed) else _inflate_bare(packed, most)
        return (octets, None) if octets else (None, ("zlib-error", f"cells can't be inflated: {error}"))
    if len(octets) > most:
        if n == MAX_CELLS and sent.nbcells != n:
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
