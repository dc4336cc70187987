"""Write ASTERIX category 240 (radar video, edition 1.3): one data block with one record at a time.

The reverse of `maritrack.io.cat240`; integers are as in the specification, big-endian.
"""

from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maritrack.errors import UsageError

CATEGORY = 240
RES_OF_BITS = {1: 1, 2: 2, 4: 3, 8: 4, 16: 5, 32: 6}
MAX_CELLS = 524_288  # a reader takes no more of one radial
MAX_LEN = 65_535
TOD_PER_DAY = 86_400 * 128
BLOCK_KINDS = ((0x40, 4, 255), (0x20, 64, 255), (0x10, 256, 254))  # FSPEC bit, octets, REP: 050, 051, 052


def encode_video(
    *,
    sac: int,
    sic: int,
    idx: int,
    start_az: int,
    end_az: int,
    start_rg: int,
    cell_dur: int,
    cells: NDArray[Any],
    femto: bool = True,
    bits: int = 8,
    compress: bool = False,
    tod: int | None = None,
    re: bytes | None = None,
    sp: bytes | None = None,
    level: int = 6,
) -> bytes:
    """One data block with one video record.

    `cells` (b,) are unsigned integers below 2**bits, the nearest first; `start_rg` counts cells, `cell_dur` fs
    (ns with femto=False), azimuths 360/65536 deg, `tod` 1/128 s since midnight. The cells go into the smallest of
    the items 050, 051 and 052 that holds them. UsageError where something has no place in the format.
    """
    _check("azimuth", 65_535, start_az=start_az, end_az=end_az)
    _check("u32", 2**32 - 1, idx=idx, start_rg=start_rg, cell_dur=cell_dur)
    if cell_dur == 0:
        raise UsageError("cell_dur is 0: a cell without depth")
    packed = pack_cells(cells, bits=bits)
    n_cells = len(cells)
    if n_cells > MAX_CELLS:
        raise UsageError(f"{n_cells} cells: a radial has at most {MAX_CELLS}")
    body = zlib.compress(packed, level) if compress else packed
    kind, rep, block = _block(body)
    items = _head(sac, sic, 2) + struct.pack(
        ">IHHIIBBHBHB", idx, start_az, end_az, start_rg, cell_dur, 0x80 if compress else 0, RES_OF_BITS[bits],
        len(body), n_cells >> 16, n_cells & 0xFFFF, rep,
    )  # fmt: skip
    tail, tail_bits = _tail(tod, re, sp)
    fspec = bytes((0xE7 if femto else 0xEB, 0x80 | kind | tail_bits))
    return _data_block(fspec + items + block + tail)


def encode_summary(
    *, sac: int, sic: int, text: bytes, tod: int | None = None, re: bytes | None = None, sp: bytes | None = None
) -> bytes:
    """One data block with one summary record: up to 255 ASCII characters."""
    if len(text) > 255 or not text.isascii():
        raise UsageError("the text of a summary is at most 255 ASCII characters")
    tail, tail_bits = _tail(tod, re, sp)
    fspec = bytes((0xD1, tail_bits)) if tail_bits else b"\xd0"
    return _data_block(fspec + _head(sac, sic, 1) + bytes((len(text),)) + text + tail)


def pack_cells(cells: NDArray[Any], *, bits: int) -> bytes:
    """Cells (b,) as octets: below 8 bit the first cell in the most significant bits, above big-endian."""
    if bits not in RES_OF_BITS:
        raise UsageError(f"bits is {bits}, not one of {', '.join(map(str, RES_OF_BITS))}")
    if cells.ndim != 1 or cells.dtype.kind not in "ui":
        raise UsageError(f"cells are {cells.ndim}-dimensional {cells.dtype}, not one row of unsigned integers")
    if len(cells) and (int(cells.min()) < 0 or int(cells.max()) >= 1 << bits):
        raise UsageError(f"cells hold values that {bits} bit can't hold")
    if bits >= 8:
        return cells.astype(f">u{bits // 8}").tobytes()
    shifts = np.arange(bits - 1, -1, -1, dtype=np.uint8)
    return np.packbits(cells.astype(np.uint8)[:, None] >> shifts & 1).tobytes()


def _check(what: str, most: int, **values: int) -> None:
    for name, value in values.items():
        if not 0 <= value <= most:
            raise UsageError(f"{name} is {value}, not 0..{most} ({what})")


def _head(sac: int, sic: int, kind: int) -> bytes:
    _check("octet", 255, sac=sac, sic=sic)
    return bytes((sac, sic, kind))


def _block(body: bytes) -> tuple[int, int, bytes]:
    """FSPEC bit, REP and padded octets of the smallest video item that holds `body`."""
    for bit, size, most in BLOCK_KINDS:
        rep = -(-len(body) // size)
        if rep <= most:
            return bit, rep, body.ljust(rep * size, b"\0")
    raise UsageError(f"{len(body)} octets of cells: one record holds at most 65024")


def _tail(tod: int | None, re: bytes | None, sp: bytes | None) -> tuple[bytes, int]:
    """The items after the video and their FSPEC bits."""
    octets, bits = b"", 0
    if tod is not None:
        _check("1/128 s since midnight", TOD_PER_DAY - 1, tod=tod)
        octets, bits = tod.to_bytes(3, "big"), 0x08
    for payload, bit in ((re, 0x04), (sp, 0x02)):
        if payload is not None:
            if len(payload) > 254:
                raise UsageError(f"{len(payload)} octets in RE or SP: at most 254 fit")
            octets, bits = octets + bytes((len(payload) + 1,)) + payload, bits | bit
    return octets, bits


def _data_block(record: bytes) -> bytes:
    length = 3 + len(record)
    if length > MAX_LEN:
        raise UsageError(f"the data block would have {length} octets; {MAX_LEN} is the most")
    return struct.pack(">BH", CATEGORY, length) + record
