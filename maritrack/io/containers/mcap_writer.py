"""Datagrams as an MCAP file, see `maritrack.io.containers.mcap_datagrams`."""

from __future__ import annotations

from typing import BinaryIO

from mcap.writer import CompressionType, Writer

from maritrack.io.containers.mcap_datagrams import MAX_CHANNEL, META_CHANNEL, UNTIMED
from maritrack.io.datagrams import NO_TIME, Stream

FORMAT, META_RECORDING = "maritrack-datagrams/1", "maritrack.recording"
LIBRARY, ENCODING = "maritrack", "x-asterix-cat240"
CHUNK_SIZE = 4 << 20


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
