"""Datagrams in an MCAP file: a channel for each stream, a message for each datagram.

A channel has no schema and names its stream in its metadata ("source", "destination"). Times are the receive times,
negative ones as 2^64 more. Datagrams that have none are on a channel of their own, marked "time": "none" in its
metadata, at the time of the datagram before them (0 for the first). Written from the MCAP specification.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from maritrack.io.containers.mcap_run import Messages, messages_from
from maritrack.io.containers.mcap_stream import MAX_UNPACKED, RECORD, Record, Unpacker, data_offset, is_packed, records
from maritrack.io.containers.mcap_walk import CHANNEL, CHUNK, MESSAGE, METADATA, Cursor, metadata
from maritrack.io.datagrams import NO_TIME, Datagrams, Stream
from maritrack.types import Damage, IntArray

META_CHANNEL = "maritrack.channel"
UNTIMED = {"time": "none"}
COST_OF_TEXTS = 8  # records that a description of a channel counts for
FEW = 8  # messages that follow each other, from which on they are taken together
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
                run = messages_from(data, at, left)
                if len(run.first) >= FEW and all(id_ in self._channels for id_ in run.channels()):
                    yield from self._take_run(data, run, place, record.offset)
                    at, left = int(run.end[-1]), left - len(run.first)
                    continue
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

    def _take_run(self, data: memoryview, run: Messages, place: int, offset: int) -> Iterator[Datagrams]:
        """Take messages of known channels; `place` is the octet of the file for the data, 0 = they were packed."""
        ids = run.channels()
        channels = [self._channels[id_] for id_ in ids]
        for channel in channels:
            if channel.holds_datagrams and channel.index < 0:
                self._appear(channel)
        row = np.empty(MAX_CHANNEL + 1, dtype=np.int64)
        row[ids] = np.arange(len(ids))
        row = row[run.head["channel"]]
        run, row = run.of(kept := np.array([one.holds_datagrams for one in channels])[row]), row[kept]
        stream = np.array([one.index for one in channels])[row]
        t_ns = np.where(np.array([one.timed for one in channels])[row], run.head["t_ns"], NO_TIME)
        where = place + run.first if place else np.full(len(run.first), offset)
        upto, low = np.cumsum(run.end - run.first), 0
        while low < len(upto):
            before = int(upto[low - 1]) if low else 0
            full = int(np.searchsorted(upto, before + BATCH_OCTETS - self._batch.octets)) + 1
            high = min(full, low + BATCH - len(self._batch.parts), len(upto))
            some = slice(low, high)
            parts = [data[a:b] for a, b in zip(run.first[some].tolist(), run.end[some].tolist(), strict=True)]
            self._batch.add_all(parts, where[some], t_ns[some], stream[some], int(upto[high - 1]) - before)
            low = high
            if self._batch.is_full():
                yield self._batch.take(offset)

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

    def add_all(
        self, payloads: list[memoryview], offset: IntArray, t_ns: IntArray, stream: IntArray, octets: int
    ) -> None:
        self.parts += payloads
        self.offset += offset.tolist()
        self.t_ns += t_ns.tolist()
        self.stream += stream.tolist()
        self.octets += octets

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
