"""The records of an MCAP file, one after the other, also where the file is damaged or cut short.

Every length is checked against the file before it is believed, every CRC is checked, and after a
broken record the walk goes on at the next chunk. Written from the MCAP specification.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import zstandard

from maritrack.errors import InputError
from maritrack.types import Damage

MAGIC = b"\x89MCAP0\r\n"
FOOTER, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, ATTACHMENT, METADATA, DATA_END = 2, 4, 5, 6, 7, 9, 12, 15

MAX_CHUNK = 1 << 28  # octets of a chunk, packed or not; ours have 8 MiB and one message more
MAX_DAMAGE = 1000  # a file with more broken places than this is none of ours
_MAX_SMALL = 1 << 24  # octets of a record that is neither chunk, message nor attachment
_MAX = {CHUNK: MAX_CHUNK, MESSAGE: MAX_CHUNK, ATTACHMENT: 1 << 62}
_HEAD = 9  # octets of opcode and length
_CHUNK_HEAD = 44  # octets of a chunk's content before its data, with a compression of four letters
_ZSTD = b"\x04\x00\x00\x00zstd"  # how the compression stands in a chunk, _ZSTD_AT octets into the content
_ZSTD_AT = 28
_STEP = 1 << 20  # octets read at a time in search of a chunk

OnDamage = Callable[[Damage], None]


class Record(NamedTuple):
    """A record and where it stands."""

    offset: int  # of its first octet in the file
    opcode: int
    content: bytes  # of a chunk that was to be skipped: only its first octets


def reporter(path: Path, on_damage: OnDamage | None) -> OnDamage:
    """What to call with damage; raises InputError where nobody listens, or when there is no end of it."""
    seen: list[Damage] = []

    def report(damage: Damage) -> None:
        seen.append(damage)
        if on_damage is None or len(seen) > MAX_DAMAGE:
            raise InputError(f"{path}: {damage.message} at byte {damage.offset}")
        on_damage(damage)

    return report


def walk(path: Path, report: OnDamage, *, skip_chunks: bool = False) -> Iterator[Record]:
    """Records of an MCAP file. InputError where it can't be opened or is none."""
    try:
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise InputError(f"{path}: not an MCAP file")
            yield from _records(file, os.fstat(file.fileno()).st_size, report, skip_chunks)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None


def _records(file: BinaryIO, size: int, report: OnDamage, skip_chunks: bool) -> Iterator[Record]:
    offset, crc, whole = len(MAGIC), zlib.crc32(MAGIC), not skip_chunks
    while True:
        head = file.read(_HEAD)
        record = _record(file, offset, head, size - offset - _HEAD, skip_chunks)
        if record is None:
            whole, found = False, _find_chunk(file, offset + 1, size)
            report(_broken(offset, found, size))
            if found < 0:
                return
            offset = file.seek(found)
            continue
        crc = _checked(record, head, crc if whole else None, report)
        yield record
        if record.opcode == FOOTER:
            if file.read(len(MAGIC)) != MAGIC:
                report(Damage("archive-truncated", size, "the end mark of the file is missing"))
            return
        whole |= record.opcode == DATA_END
        offset = file.seek(offset + _HEAD + int.from_bytes(head[1:], "little"))


def _record(file: BinaryIO, offset: int, head: bytes, room: int, skip_chunks: bool) -> Record | None:
    """The record that begins with the nine octets `head`, None where it can't be one."""
    opcode, length = head[:1], int.from_bytes(head[1:], "little")
    if len(head) < _HEAD or not 1 <= opcode[0] <= DATA_END or length > min(room, _MAX.get(opcode[0], _MAX_SMALL)):
        return None
    content = file.read(min(length, _CHUNK_HEAD) if skip_chunks and opcode[0] == CHUNK else length)
    if opcode[0] == CHUNK and not _chunk_adds_up(content[:_CHUNK_HEAD], length):
        return None
    return Record(offset, opcode[0], content)


def _checked(record: Record, head: bytes, crc: int | None, report: OnDamage) -> int:
    """Running CRC after the record; compared where a section ends. None = the section is not whole."""
    before = crc or 0
    if record.opcode == FOOTER:
        before = zlib.crc32(record.content[:16], zlib.crc32(head, before))
    stored = {DATA_END: record.content[:4], FOOTER: record.content[16:20]}.get(record.opcode, b"")
    if crc is not None and any(stored) and stored != before.to_bytes(4, "little"):
        report(Damage("archive-crc", record.offset, "the octets before do not match their CRC"))
    return 0 if record.opcode == DATA_END else zlib.crc32(record.content, zlib.crc32(head, crc or 0))


def _broken(offset: int, found: int, size: int) -> Damage:
    if found < 0:
        return Damage(
            "archive-truncated", offset, f"the file breaks off, {size - offset} octets of a record are left over"
        )
    return Damage("archive-record", offset, f"{found - offset} octets that are no record")


def _chunk_adds_up(head: bytes, length: int) -> bool:
    """Whether the lengths inside a chunk fit the length of its record."""
    packed_at = _ZSTD_AT + 4 + int.from_bytes(head[_ZSTD_AT : _ZSTD_AT + 4], "little") + 8
    return packed_at <= len(head) and packed_at + int.from_bytes(head[packed_at - 8 : packed_at], "little") == length


def _find_chunk(file: BinaryIO, start: int, size: int) -> int:
    """Place of the next chunk that looks sound, -1 where there is none."""
    at = start
    while at < size:
        file.seek(at)
        octets = file.read(_STEP + len(_ZSTD) - 1)
        hit = octets.find(_ZSTD)
        while hit >= 0:
            found = at + hit - _ZSTD_AT - _HEAD
            if found >= start:
                file.seek(found)
                head = file.read(_HEAD)
                if head[0] == CHUNK and _record(file, found, head, size - found - _HEAD, True) is not None:
                    return found
            hit = octets.find(_ZSTD, hit + 1)
        at += _STEP
    return -1


def unpack_chunk(content: bytes) -> bytes:
    """The records of a chunk, decompressed. ValueError where it is damaged or larger than it may be."""
    cursor = Cursor(content)
    cursor.take(16)
    size, crc, compression = cursor.number(8), cursor.number(4), cursor.text()
    packed = cursor.take(cursor.number(8))
    if size > MAX_CHUNK or compression not in ("", "zstd"):
        raise ValueError(f"a chunk of {size} octets, compression '{compression}'")
    data = _unzstd(packed, size) if compression else packed
    if len(data) != size or (crc and zlib.crc32(data) != crc):
        raise ValueError("a chunk does not match its CRC")
    return data


def _unzstd(packed: bytes, size: int) -> bytes:
    try:
        told = zstandard.get_frame_parameters(packed).content_size
        if told not in (size, zstandard.CONTENTSIZE_UNKNOWN):
            raise ValueError("a chunk is not as long as it says")
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    except zstandard.ZstdError as error:
        raise ValueError(f"a chunk can't be decompressed: {error}") from None


def records_of(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Opcode and content of the records of a decompressed chunk. ValueError where a length is wrong."""
    cursor = Cursor(data)
    while cursor.left:
        opcode = cursor.number(1)
        yield opcode, cursor.take(cursor.number(8))


def metadata(content: bytes) -> tuple[str, dict[str, str]]:
    """Name and table of a metadata record."""
    cursor = Cursor(content)
    return cursor.text(), cursor.table()


def attachment(content: bytes) -> tuple[str, bytes]:
    """Name and octets of an attachment. ValueError where they do not match their CRC."""
    if zlib.crc32(content[:-4]) != int.from_bytes(content[-4:], "little"):
        raise ValueError("an attachment does not match its CRC")
    cursor = Cursor(content)
    cursor.take(16)
    name, _ = cursor.text(), cursor.text()
    return name, cursor.take(cursor.number(8))


def channel(content: bytes) -> dict[int, str]:
    """Number and topic of a channel."""
    cursor = Cursor(content)
    id_, _ = cursor.number(2), cursor.number(2)
    return {id_: cursor.text()}


class Cursor:
    """Reads the fields of a record; ValueError where they end before they should."""

    def __init__(self, octets: bytes) -> None:
        self._octets, self._at = octets, 0

    @property
    def left(self) -> int:
        return len(self._octets) - self._at

    def take(self, n: int) -> bytes:
        if n > self.left:
            raise ValueError(f"{n} octets are promised, {self.left} are there")
        self._at += n
        return self._octets[self._at - n : self._at]

    def number(self, n: int) -> int:
        return int.from_bytes(self.take(n), "little")

    def text(self) -> str:
        return self.take(self.number(4)).decode("utf-8")

    def table(self) -> dict[str, str]:
        inner = Cursor(self.take(self.number(4)))
        table: dict[str, str] = {}
        while inner.left:
            key = inner.text()
            table[key] = inner.text()
        return table
