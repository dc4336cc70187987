"""The records of an MCAP stream that can be read only once, also where it is damaged or cut short.

A record is believed if its lengths fit each other and, short of chunks, if what follows it can be a record; after a
broken one the reading goes on at the next chunk, in a file without chunks at the next message. Memory: the largest
record (32 MiB and a little) twice.
Written from the MCAP specification.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator
from struct import Struct
from typing import NamedTuple

import numpy as np
import zstandard

from maritrack.io.containers.mcap_walk import (
    ATTACHMENT,
    CHANNEL,
    CHUNK,
    DATA_END,
    FOOTER,
    MAGIC,
    MAX_DAMAGE,
    MESSAGE,
    METADATA,
)
from maritrack.io.containers.pull import PIECE, Pull

NOTHING = 0  # opcode of a stretch without a record that matters
RECORD = Struct("<BQ")
CHUNK_SIZES = Struct("<16xQII")  # after the times: size unpacked, CRC, letters of the compression
CHUNK_HEAD = 44  # octets of a chunk before its data, with a compression of four letters
LOOK = RECORD.size + CHUNK_HEAD
MAX_UNPACKED = 32 << 20  # octets of a chunk or a message
MAX_PACKED = MAX_UNPACKED + (MAX_UNPACKED >> 6)
MAX_SMALL = 1 << 24  # of other records
DULL = frozenset((1, 3, 7, 8, 10, 11, 13, 14))  # opcodes of what is known anyway, or is for other readers
PRIVATE = 128  # opcodes from here on are anybody's
FIRST_SEARCH = 4096
FOLLOWERS = 3  # records that have to follow a message outside of a chunk
LEAST = {CHUNK: CHUNK_HEAD - 4, MESSAGE: 22, DATA_END: 4, FOOTER: 20}  # octets
MOST = {MESSAGE: MAX_UNPACKED, ATTACHMENT: 1 << 62, DATA_END: 4, FOOTER: 20}
READ = (CHUNK, MESSAGE, CHANNEL, METADATA)

Tell = Callable[[str, int, str], None]  # code, octet, message


class Record(NamedTuple):
    """A record and where it stands."""

    offset: int  # of its first octet
    opcode: int
    content: bytes  # of chunks, messages, channels and metadata
    end: int  # octet up to which all has been looked at


def records(chunks: Iterable[bytes], tell: Tell) -> Iterator[Record]:
    """Records of the stream up to its end; NOTHING now and then, where there is none for a while, and at the end."""
    pull = Pull(chunks)
    whole, broken, finished = pull.take(len(MAGIC)) == MAGIC, 0, False
    chunked = False  # messages outside of chunks are then inside of a broken one
    if not whole:
        tell("archive-record", 0, "not the beginning of an MCAP file")
    while not finished and pull.has(1):
        octets, at = pull.window(LOOK)
        if dull := _dull(octets, at):
            pull.skip(dull)
            yield Record(pull.offset, NOTHING, b"", pull.offset)
            continue
        opcode, length = RECORD.unpack_from(octets, at) if len(octets) - at >= RECORD.size else (NOTHING, 0)
        if not _believed(pull, opcode, length):
            whole, broken = False, broken + 1
            if opcode in (CHANNEL, METADATA) and length <= MAX_SMALL and pull.has(RECORD.size + length):
                octets, at = pull.window(RECORD.size + length)  # it may be what follows it that is broken
                yield Record(pull.offset, opcode, octets[at + RECORD.size : at + RECORD.size + length], pull.offset)
            yield from _search(pull, tell, chunked=chunked, given_up=broken > MAX_DAMAGE)
            finished = not pull.has(1)
        elif opcode in READ and length <= MAX_PACKED:
            offset, chunked = pull.offset, chunked or opcode == CHUNK
            pull.skip(RECORD.size)
            yield Record(offset, opcode, pull.take(length), pull.offset)
        else:
            if opcode == DATA_END and whole:
                _check_crc(pull, tell)
            elif opcode == CHUNK:
                tell("archive-chunk", pull.offset, f"a chunk of {length} octets is too large")
            if RECORD.size + length > pull.skip(min(RECORD.size + length, PIECE)):
                yield from _pass(pull, RECORD.size + length - PIECE)
            if opcode == FOOTER:
                yield from _end(pull, tell)
                finished = True
    if not finished:
        tell("archive-truncated", pull.offset, "the file is not finished")
    yield Record(pull.offset, NOTHING, b"", pull.offset)


class Unpacker:
    """Unpacks chunks."""

    def __init__(self) -> None:
        self._zstd = zstandard.ZstdDecompressor()

    def unpack(self, content: bytes) -> bytes:
        """The records of a chunk. ValueError where it is damaged or too large."""
        size, crc, letters = CHUNK_SIZES.unpack_from(content)
        compression, packed = content[32 : 32 + letters], content[data_offset(content) :]
        if size > MAX_UNPACKED or compression not in (b"", b"zstd", b"lz4"):
            raise ValueError(f"a chunk of {size} octets, compression '{compression.decode(errors='replace')}'")
        data = packed
        if compression:
            data = self._unzstd(packed, size) if compression == b"zstd" else _unlz4(packed, size)
        if len(data) != size or (crc and zlib.crc32(data) != crc):
            raise ValueError("a chunk does not match its CRC")
        return data

    def _unzstd(self, packed: bytes, size: int) -> bytes:
        try:
            told = zstandard.frame_content_size(packed)
            if told not in (size, -1):
                raise ValueError("a chunk is not as long as it says")
            return self._zstd.decompress(packed, max_output_size=size) if size or told else b""
        except zstandard.ZstdError as error:
            raise ValueError(f"a chunk can't be decompressed: {error}") from None


def _unlz4(packed: bytes, size: int) -> bytes:
    try:
        import lz4.frame  # type: ignore[import-untyped]
    except ImportError:
        raise ValueError("a chunk is packed with LZ4, and Python's lz4 is not installed") from None
    try:
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1))
    except (RuntimeError, ValueError) as error:
        raise ValueError(f"a chunk can't be decompressed: {error}") from None


def is_packed(content: bytes) -> bool:
    """Whether a chunk is compressed."""
    return any(content[28:32])


def data_offset(content: bytes) -> int:
    """Where in a chunk its data begin."""
    return CHUNK_HEAD - 4 + int.from_bytes(content[28:32], "little")


def _dull(octets: bytes, at: int) -> int:
    """How many octets from a place on are whole records that tell nothing here, each followed by another record."""
    first, last = at, len(octets) - LOOK
    while at < last and (octets[at] in DULL or octets[at] >= PRIVATE):
        end = at + RECORD.size + int.from_bytes(octets[at + 1 : at + RECORD.size], "little")
        if end > last or not _possible(octets, end):
            break
        at = end
    return at - first


def _believed(pull: Pull, opcode: int, length: int) -> bool:
    """Whether what comes next is a record that ends before the stream does."""
    octets, at = pull.window(LOOK)
    if not _possible(octets, at):
        return False
    if opcode == ATTACHMENT or (opcode == CHUNK and length > MAX_PACKED):
        return True
    end = RECORD.size + length
    octets, at = pull.window(end + LOOK)
    left = len(octets) - at - end
    return left >= 0 and (left < RECORD.size or opcode in (CHUNK, FOOTER) or _possible(octets, at + end))


def _possible(octets: bytes, at: int) -> bool:
    """Whether a record can begin at a place."""
    if len(octets) - at < RECORD.size:
        return False
    opcode, length = RECORD.unpack_from(octets, at)
    known = NOTHING < opcode <= DATA_END or opcode >= PRIVATE
    if opcode != CHUNK or not known:
        return bool(known and LEAST.get(opcode, 0) <= length <= MOST.get(opcode, MAX_SMALL))
    head = octets[at + RECORD.size : at + LOOK]
    if len(head) < CHUNK_HEAD:
        return False
    packed_at = data_offset(head)
    packed = int.from_bytes(head[packed_at - 8 : packed_at], "little")
    return packed_at <= CHUNK_HEAD and bool(packed_at + packed == length)


def _check_crc(pull: Pull, tell: Tell) -> None:
    octets, at = pull.window(LOOK)
    told = int.from_bytes(octets[at + RECORD.size : at + RECORD.size + 4], "little")
    if told not in (0, pull.crc()):
        tell("archive-crc", pull.offset, "the octets before do not match their CRC")


def _search(pull: Pull, tell: Tell, *, chunked: bool, given_up: bool) -> Iterator[Record]:
    """Go on to the next chunk that looks sound, message where there are no chunks, or to the end."""
    first, found, span = pull.offset, False, FIRST_SEARCH
    pull.skip(1)
    while not found and pull.has(1):
        octets, at = pull.window(span)
        window = octets[at : at + span]
        places = [] if given_up else _chunks_in(window)
        places += [] if given_up or chunked else _messages_in(window)
        found = len(places) > 0
        pull.skip(min(places) if found else span - LOOK + 1 if pull.has(span + 1) else len(window))
        span = min(4 * span, PIECE)
        yield Record(first, NOTHING, b"", pull.offset)
    if found:
        tell("archive-record", first, f"{pull.offset - first} octets that are no record")
    elif given_up:
        tell("archive-record", first, "no end of broken records: the rest is left unread")
    else:
        tell("archive-truncated", first, f"the file breaks off, {pull.offset - first} octets of a record are left over")


def _chunks_in(window: bytes) -> list[int]:
    """Places where a chunk begins whose lengths fit each other."""
    n = len(window) - LOOK + 1
    if n <= 0:
        return []
    u8 = np.frombuffer(window, dtype=np.uint8)
    likely = u8[:n] == CHUNK
    for high in (5, 6, 7, 8, RECORD.size + 29, RECORD.size + 30, RECORD.size + 31):  # octets of lengths that are small
        likely &= u8[high : high + n] == 0
    return [at for at in np.flatnonzero(likely).tolist() if _possible(window, at)]


def _messages_in(window: bytes) -> list[int]:
    """Places where a message begins that other records follow."""
    u8 = np.frombuffer(window, dtype=np.uint8)
    n = len(u8) - RECORD.size + 1
    likely = u8[: max(n, 0)] == MESSAGE
    for high in (5, 6, 7, 8):
        likely &= u8[high : high + n] == 0
    at = first = np.flatnonzero(likely)
    for _ in range(FOLLOWERS):
        length = sum(u8[at + 1 + i].astype(np.int64) << 8 * i for i in range(4))
        after = at + RECORD.size + length
        sound = (length <= MAX_UNPACKED) & (after < n) & ((u8[at] != MESSAGE) | (length >= LEAST[MESSAGE]))
        first, at = first[sound], after[sound]
        known = (u8[at] > NOTHING) & (u8[at] <= DATA_END) & (u8[at + 5] | u8[at + 6] | u8[at + 7] | u8[at + 8] == 0)
        first, at = first[known], at[known]
    return [int(place) for place in first[:1]]


def _pass(pull: Pull, n: int) -> Iterator[Record]:
    """Leave out `n` octets, a piece at a time."""
    while n > 0 and pull.has(1):
        n -= pull.skip(min(n, PIECE))
        yield Record(pull.offset, NOTHING, b"", pull.offset)


def _end(pull: Pull, tell: Tell) -> Iterator[Record]:
    """What comes after the last record."""
    if pull.take(len(MAGIC)) != MAGIC:
        tell("archive-truncated", pull.offset, "the end mark of the file is missing")
    if pull.has(1):
        tell("archive-record", pull.offset, "octets behind the end of the file")
    while pull.has(1):
        yield from _pass(pull, PIECE)
