"""Datagrams in an MCAP file: a channel for each stream, a message for each datagram.

A channel has no schema and names its stream in its metadata ("source", "destination"). Times are the receive times,
negative ones as 2^64 more. Datagrams that have none are on a channel of their own, marked "time": "none" in its
metadata, at the time of the datagram before them (0 for the first). Written from the MCAP specification.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import BinaryIO

import numpy as np
from mcap.writer import CompressionType, Writer

from maritrack.io.containers.mcap_stream import MAX_UNPACKED, RECORD, Record, Unpacker, data_offset, is_packed, records
from maritrack.io.containers.mcap_walk import CHANNEL, CHUNK, MESSAGE, METADATA, Cursor, metadata
from maritrack.io.datagrams import NO_TIME, Datagrams, Stream
from maritrack.types import Damage

FORMAT = "maritrack-datagrams/1"
META_RECORDING, META_CHANNEL = "maritrack.recording", "maritrack.channel"
LIBRARY, ENCODING = "maritrack", "x-asterix-cat240"
UNTIMED = {"time": "none"}
CHUNK_SIZE = 4 << 20
COST_OF_TEXTS = 8  # records that a description of a channel counts for
SPARSE = 4096  # octets to a record, where a chunk has few
BATCH, BATCH_OCTETS = 16_384, 4 << 20  # datagrams and octets handed on together
CHANNEL_HEAD = struct.Struct("<HH")
NO_TABLE = bytes(4)
MESSAGE_HEAD = struct.Struct("<HIqQ")
MAX_TEXTS = 1 << 16  # octets of a record of texts
MAX_CHANNEL = 65_535
MAX_TEXT = 128  # letters of the name of a stream
BUDGET_FLOOR, BUDGET_RATIO = 64 << 20, 256  # unpacked octets that are allowed, and those to an octet of the file
RECORDS_FLOOR, OCTETS_A_RECORD = 1 << 16, 8  # records in chunks that are allowed, and octets of the file to each other


@dataclass(slots=True)
class _Channel:
    stream: Stream
    holds_datagrams: bool = True
    timed: bool = True
    index: int = -1  # of the stream, once it has appeared

    @property
    def kind(self) -> tuple[bool, bool]:
        return self.holds_datagrams, self.timed


class McapReader:
    """Reads the messages of all channels without a schema as datagrams.

    A channel of another program is the stream Stream("", topic); one whose description is lost Stream("",
    "channel-7"). A chunk that doesn't match its CRC is left out as a whole. Datagrams in a compressed chunk have the
    chunk's octet as offset. Names of streams are cut at 128 letters.
    """

    def __init__(self, chunks: Iterable[bytes]) -> None:
        self.streams: list[Stream] = []
        self._chunks = chunks
        self._channels: dict[int, _Channel] = {}
        self._numbers: dict[Stream, int] = {}
        self._batch, self._unpacker = _Batch(), Unpacker()
        self._unpacked = self._records = 0  # in chunks

    def datagrams(self) -> Iterator[Datagrams]:
        end = told = 0
        for record in records(self._chunks, self._tell):
            if record.opcode == CHUNK:
                yield from self._chunk(record)
            elif record.opcode == MESSAGE:
                content = memoryview(record.content)
                self._message(content, 0, len(content), record.offset + RECORD.size + MESSAGE_HEAD.size)
            else:
                self._describe(record.opcode, record.content, record.offset)
            end = record.end
            if self._batch.is_full() or max(self._batch.held, end - told) >= BATCH_OCTETS:
                told = end
                yield self._batch.take(end)
        yield self._batch.take(end)

    def _tell(self, code: str, offset: int, message: str) -> None:
        self._batch.tell(Damage(code, offset, message))

    def _chunk(self, record: Record) -> Iterator[Datagrams]:
        """The messages of a chunk. Until its end it counts as not looked at."""
        most = self._most_records(record)
        left = most - self._records
        try:
            data = memoryview(self._affordable(record))
            place = 0 if is_packed(record.content) else record.offset + RECORD.size + data_offset(record.content)
            at, size = 0, len(data)
            self._batch.held += size
            while at < size:
                opcode, length = RECORD.unpack_from(data, at) if at + RECORD.size <= size else (MESSAGE, size)
                first, at, left = at + RECORD.size, at + RECORD.size + length, left - 1
                if at > size:
                    raise ValueError("a record is longer than its chunk")
                if left < 0:
                    self._tell("inflation-budget", record.offset, "more records than the file can hold, left out")
                    break
                if opcode == MESSAGE:
                    self._message(data, first, at, place + first + MESSAGE_HEAD.size if place else record.offset)
                    if self._batch.is_full():
                        yield self._batch.take(record.offset)
                elif opcode in (CHANNEL, METADATA):
                    left -= COST_OF_TEXTS
                    self._describe(opcode, bytes(data[first:at]), record.offset)
        except ValueError as error:
            self._tell("archive-chunk", record.offset, str(error))
        finally:
            self._records = most - left

    def _affordable(self, record: Record) -> bytes:
        """The records of a chunk, none where they would be too many octets. ValueError where it is damaged."""
        size = int.from_bytes(record.content[16:24], "little")
        too_large = self._unpacked + min(size, MAX_UNPACKED) > max(BUDGET_FLOOR, BUDGET_RATIO * record.end)
        if too_large or self._most_records(record) - self._records < size // SPARSE:
            self._tell("inflation-budget", record.offset, f"a chunk of {size} octets more is too much, left out")
            return b""
        data = self._unpacker.unpack(record.content)
        self._unpacked += len(data)
        return data

    def _most_records(self, record: Record) -> int:
        """How many records may be in the chunks up to this one."""
        return RECORDS_FLOOR + record.end // OCTETS_A_RECORD

    def _message(self, data: memoryview, first: int, end: int, offset: int) -> None:
        """Take the message in a stretch of the data; `offset` is the octet of the file for its payload."""
        if end - first < MESSAGE_HEAD.size:
            raise ValueError("a message without time and channel")
        id_, _, t_ns, _ = MESSAGE_HEAD.unpack_from(data, first)
        channel = self._channels.get(id_) or self._unknown(id_, offset)
        if channel.holds_datagrams:
            stream = channel.index if channel.index >= 0 else self._appear(channel)
            self._batch.add(data[first + MESSAGE_HEAD.size : end], offset, t_ns if channel.timed else NO_TIME, stream)

    def _describe(self, opcode: int, content: bytes, offset: int) -> None:
        """Take note of what a record tells of a channel."""
        try:
            told = _told(opcode, content)
        except (ValueError, struct.error) as error:
            self._tell("archive-record", offset, f"the description of a channel can't be read: {error}")
            return
        if told is not None:
            id_, channel = told
            known = self._channels.get(id_)
            if known is None or (known.stream, known.kind) != (channel.stream, channel.kind):
                self._channels[id_] = channel

    def _unknown(self, id_: int, offset: int) -> _Channel:
        self._tell("archive-record", offset, f"channel {id_} is nowhere described")
        self._channels[id_] = _Channel(Stream("", f"channel-{id_}"))
        return self._channels[id_]

    def _appear(self, channel: _Channel) -> int:
        """The index of a channel's stream, which is known from here on."""
        if channel.stream not in self._numbers:
            self._numbers[channel.stream] = len(self.streams)
            self.streams.append(channel.stream)
        channel.index = self._numbers[channel.stream]
        return channel.index


@dataclass(slots=True)
class _Batch:
    """Datagrams on their way out."""

    parts: list[memoryview] = field(default_factory=list)
    offset: list[int] = field(default_factory=list)
    t_ns: list[int] = field(default_factory=list)
    stream: list[int] = field(default_factory=list)
    octets: int = 0
    held: int = 0  # octets of the chunks that `parts` keep in memory
    damage: list[Damage] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)  # of the damage

    def add(self, payload: memoryview, offset: int, t_ns: int, stream: int) -> None:
        self.parts.append(payload)
        self.offset.append(offset)
        self.t_ns.append(t_ns)
        self.stream.append(stream)
        self.octets += len(payload)

    def tell(self, damage: Damage) -> None:
        if self.damage and self.damage[-1].code == damage.code:
            self.counts[-1] += 1
        else:
            self.damage.append(damage)
            self.counts.append(1)

    def is_full(self) -> bool:
        return len(self.parts) >= BATCH or self.octets >= BATCH_OCTETS

    def take(self, end: int) -> Datagrams:
        """Hand them on; `end` is up to where all has been looked at."""
        lengths = np.fromiter(map(len, self.parts), dtype=np.int64, count=len(self.parts))
        offset, t_ns, stream = (np.array(column, dtype=np.int64) for column in (self.offset, self.t_ns, self.stream))
        taken = Datagrams(
            end=end, data=b"".join(self.parts), bounds=np.concatenate([[0], np.cumsum(lengths)]), offset=offset,
            t_ns=t_ns, stream=stream,
            damage=tuple(replace(one, count=count) for one, count in zip(self.damage, self.counts, strict=True)),
        )  # fmt: skip
        self.parts, self.offset, self.t_ns, self.stream, self.octets, self.held = [], [], [], [], 0, 0
        self.damage, self.counts = [], []
        return taken


def _told(opcode: int, content: bytes) -> tuple[int, _Channel] | None:
    """Number and make of the channel that a record tells of, if it does. ValueError where it can't be read.

    Our own channels are told twice, by a metadata record too, for when the chunk that begins one is lost.
    """
    if opcode not in (CHANNEL, METADATA) or (opcode == METADATA and not content[4:].startswith(META_CHANNEL.encode())):
        return None
    if len(content) > MAX_TEXTS:
        raise ValueError(f"it has {len(content)} octets")
    if opcode == METADATA:
        table = metadata(content)[1]
        id_, schema, topic = int(table.get("id", "")), 0, ""
    else:
        id_, schema = CHANNEL_HEAD.unpack_from(content)
        topic, at = _text(content, CHANNEL_HEAD.size)
        _, at = _text(content, at)
        table = Cursor(content[at:]).table() if content[at:] != NO_TABLE else {}
    if not 0 <= id_ <= MAX_CHANNEL:
        raise ValueError(f"no channel has the number {id_}")
    named = "source" in table or "destination" in table
    source, destination = (table.get("source", ""), table.get("destination", "")) if named else ("", topic)
    stream = Stream(source[:MAX_TEXT], destination[:MAX_TEXT])
    return id_, _Channel(stream, schema == 0, table.get("time") != UNTIMED["time"])


def _text(content: bytes, at: int) -> tuple[str, int]:
    """The text at a place, and where it ends. ValueError where there is none."""
    end = at + 4 + int.from_bytes(content[at : at + 4], "little")
    if end > len(content):
        raise ValueError("a text ends too late")
    return content[at + 4 : end].decode(), end


class McapWriter:
    """Writes an MCAP file to an open file, from data alone: equal datagrams make equal octets.

    Topics are "/asterix/<destination>", or the source where there is no destination, numbered where they would be the
    same. `compress` packs the chunks with zstd. What was written before a `flush` is in finished chunks, which can be
    read without the end of the file. Doesn't fit: more than 65,535 streams.
    """

    def __init__(self, file: BinaryIO, *, compress: bool = True) -> None:
        packing = CompressionType.ZSTD if compress else CompressionType.NONE
        self._writer = Writer(file, chunk_size=CHUNK_SIZE, compression=packing, enable_data_crcs=True)
        self._writer.start(profile="", library=LIBRARY)
        self._writer.add_metadata(META_RECORDING, {"format": FORMAT})
        self._channels: dict[tuple[Stream, bool], int] = {}
        self._topics: dict[str, int] = {}  # and how many would have been called the same
        self._counts: dict[int, int] = {}
        self._last_ns = 0

    def write(self, payload: bytes, *, t_ns: int, stream: Stream) -> bool:
        timed = t_ns != NO_TIME
        id_ = self._channels.get((stream, timed)) or self._channel(stream, timed=timed)
        if id_ > MAX_CHANNEL:
            return False
        self._last_ns = t_ns % (1 << 64) if timed else self._last_ns
        count = self._counts[id_]
        self._writer.add_message(id_, self._last_ns, payload, self._last_ns, count % (1 << 32))
        self._counts[id_] = count + 1
        return True

    def flush(self) -> None:
        self._writer.flush()  # type: ignore[no-untyped-call]

    def finish(self) -> None:
        """Write the end of the file."""
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _channel(self, stream: Stream, *, timed: bool) -> int:
        if len(self._channels) == MAX_CHANNEL:
            return MAX_CHANNEL + 1
        table = {"source": stream.source, "destination": stream.destination} | ({} if timed else UNTIMED)
        topic = name = f"/asterix/{stream.destination or stream.source or 'cat240'}"
        while topic in self._topics:
            self._topics[name] += 1
            topic = f"{name}/{self._topics[name]}"
        self._topics[topic] = 1
        id_ = self._writer.register_channel(topic, ENCODING, 0, table)
        self._writer.add_metadata(META_CHANNEL, {"id": str(id_), "topic": topic} | table)
        self._channels[stream, timed], self._counts[id_] = id_, 0
        return id_
