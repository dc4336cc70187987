"""Write ASTERIX category 240 (radar video, edition 1.3): records item by item, data blocks of any number of them.

The reverse of `maritrack.io.cat240.reader`; integers are as in the specification, big-endian.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maritrack.errors import UsageError

CATEGORY = 240
SUMMARY, VIDEO = 1, 2
RES_OF_BITS = {1: 1, 2: 2, 4: 3, 8: 4, 16: 5, 32: 6}
MAX_CELLS = 524_288  # a reader takes no more of one radial
MAX_LEN = 65_535
MAX_REP = 255
COMPRESSED = 0x80  # bit of the first octet of item 048
TOD_PER_DAY = 86_400 * 128
FSPEC_BITS = (  # in the order of the items, first octet high
    0x8000, 0x4000, 0x2000, 0x1000, 0x0800, 0x0400, 0x0200, 0x0080, 0x0040, 0x0020, 0x0010, 0x0008, 0x0004, 0x0002,
)  # fmt: skip
SECOND_OCTET = 0x0100  # FX of the first
_PAIR, _OCTET, _U32, _U24 = struct.Struct(">BB"), struct.Struct(">B"), struct.Struct(">I"), struct.Struct(">BH")
_HEADER, _COUNTS, _BLOCK = struct.Struct(">HHII"), struct.Struct(">HBH"), struct.Struct(">BH")


class VideoItem(NamedTuple):
    """One of the three items that hold cells."""

    bit: int  # of the second octet of FSPEC
    octets: int  # of a repetition
    most: int  # repetitions that are advised, so that a data block has room for them


VIDEO_ITEMS = {"050": VideoItem(0x40, 4, 255), "051": VideoItem(0x20, 64, 255), "052": VideoItem(0x10, 256, 254)}


class Header(NamedTuple):
    """Item 040 or 041: where the cells of a record lie."""

    start_az: int  # 360/65536 deg
    end_az: int
    start_rg: int  # cells
    cell_dur: int  # ns in item 040, fs in item 041


@dataclass(frozen=True, slots=True)
class Record:
    """A record item by item, as it is sent; None = the item is not there."""

    source: tuple[int, int] | None = None  # 010: SAC, SIC
    kind: int | None = None  # 000: SUMMARY or VIDEO
    idx: int | None = None  # 020
    text: bytes | None = None  # 030: up to 255 octets
    nano: Header | None = None  # 040
    femto: Header | None = None  # 041
    form: tuple[int, int] | None = None  # 048: an octet of COMPRESSED and seven spare bits, resolution (RES)
    counts: tuple[int, int] | None = None  # 049: valid octets of the video block, cells
    low: bytes | None = None  # 050: n * 4 octets, padding included
    medium: bytes | None = None  # 051: n * 64
    high: bytes | None = None  # 052: n * 256
    tod: int | None = None  # 140: 1/128 s since midnight
    re: bytes | None = None  # up to 254 octets each
    sp: bytes | None = None


def encode_record(record: Record) -> bytes:
    """The octets of a record, with the shortest FSPEC. UsageError where something has no place in the format."""
    counts, tod = record.counts, record.tod
    items = (
        _fixed("010", _PAIR, record.source),
        _fixed("000", _OCTET, None if record.kind is None else (record.kind,)),
        _fixed("020", _U32, None if record.idx is None else (record.idx,)),
        _repeated("030", 1, record.text),
        _fixed("040", _HEADER, record.nano),
        _fixed("041", _HEADER, record.femto),
        _fixed("048", _PAIR, record.form),
        _fixed("049", _COUNTS, None if counts is None else (counts[0], counts[1] >> 16, counts[1] & 0xFFFF)),
        _repeated("050", VIDEO_ITEMS["050"].octets, record.low),
        _repeated("051", VIDEO_ITEMS["051"].octets, record.medium),
        _repeated("052", VIDEO_ITEMS["052"].octets, record.high),
        _fixed("140", _U24, None if tod is None else (tod >> 16, tod & 0xFFFF)),
        _vendor("RE", record.re),
        _vendor("SP", record.sp),
    )
    present = sum(bit for bit, octets in zip(FSPEC_BITS, items, strict=True) if octets is not None)
    if present == 0:
        raise UsageError("a record without items has no place in the format")
    fspec = (present | SECOND_OCTET).to_bytes(2, "big") if present & 0xFF else bytes((present >> 8,))
    return fspec + b"".join(octets for octets in items if octets is not None)


def encode_block(records: Iterable[Record]) -> bytes:
    """One data block with these records. UsageError where there is none, or where they are too large for one."""
    return data_block([encode_record(record) for record in records])


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
    if cell_dur == 0:
        raise UsageError("cell_dur is 0: a cell without depth")
    packed = pack_cells(cells, bits=bits)
    if len(cells) > MAX_CELLS:
        raise UsageError(f"{len(cells)} cells: a radial has at most {MAX_CELLS}")
    body = zlib.compress(packed, level) if compress else packed
    header = Header(start_az, end_az, start_rg, cell_dur)
    low, medium, high = _padded(body)
    record = Record(
        source=(sac, sic), kind=VIDEO, idx=idx, nano=None if femto else header, femto=header if femto else None,
        form=(COMPRESSED if compress else 0, RES_OF_BITS[bits]), counts=(len(body), len(cells)), low=low,
        medium=medium, high=high, tod=_time_of_day(tod), re=re, sp=sp,
    )  # fmt: skip
    return encode_block([record])


def encode_summary(
    *, sac: int, sic: int, text: bytes, tod: int | None = None, re: bytes | None = None, sp: bytes | None = None
) -> bytes:
    """One data block with one summary record: up to 255 ASCII characters."""
    if not text.isascii():
        raise UsageError("the text of a summary is ASCII")
    return encode_block([Record(source=(sac, sic), kind=SUMMARY, text=text, tod=_time_of_day(tod), re=re, sp=sp)])


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


def smallest_item(octets: int) -> str:
    """The smallest of the video items that holds so many octets, "" where none does."""
    return next((name for name, item in VIDEO_ITEMS.items() if octets <= item.most * item.octets), "")


def data_block(records: Sequence[bytes]) -> bytes:
    """One data block of records that are octets already. UsageError where there is none, or where it is too large."""
    if not records:
        raise UsageError("a data block has at least one record")
    length = _BLOCK.size + sum(map(len, records))
    if length > MAX_LEN:
        raise UsageError(f"the data block would have {length} octets; {MAX_LEN} is the most")
    return b"".join((_BLOCK.pack(CATEGORY, length), *records))


def _padded(body: bytes) -> tuple[bytes | None, bytes | None, bytes | None]:
    """The octets as item 050, 051 or 052, the others None."""
    item = smallest_item(len(body))
    if not item:
        raise UsageError(f"{len(body)} octets of cells: one record holds at most 65024")
    size = VIDEO_ITEMS[item].octets
    padded = body.ljust(-(-len(body) // size) * size, b"\0")
    low, medium, high = (padded if name == item else None for name in VIDEO_ITEMS)
    return low, medium, high


def _time_of_day(tod: int | None) -> int | None:
    if tod is not None and not 0 <= tod < TOD_PER_DAY:
        raise UsageError(f"tod is {tod}, not 0..{TOD_PER_DAY - 1} (1/128 s since midnight)")
    return tod


def _fixed(name: str, layout: struct.Struct, values: tuple[int, ...] | None) -> bytes | None:
    if values is None:
        return None
    try:
        return layout.pack(*values)
    except struct.error:
        raise UsageError(f"item {name} can't hold {', '.join(map(str, values))}") from None


def _repeated(name: str, size: int, octets: bytes | None) -> bytes | None:
    """An item of REP times `size` octets."""
    if octets is None:
        return None
    rep, rest = divmod(len(octets), size)
    if rest or rep > MAX_REP:
        raise UsageError(f"item {name} holds 0 to {MAX_REP} times {size} octets, not {len(octets)}")
    return bytes((rep,)) + octets


def _vendor(name: str, payload: bytes | None) -> bytes | None:
    """RE or SP: the octet before the payload counts itself too."""
    if payload is None:
        return None
    if len(payload) > 254:
        raise UsageError(f"{len(payload)} octets in {name}: at most 254 fit")
    return bytes((len(payload) + 1,)) + payload
