"""What a CAT240 recording is packed in, by its content: blocks as they are, a capture, FINAL, MCAP, and gzip on top."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np

from maritrack.io.containers.ledger import Ledger
from maritrack.io.containers.select import Selection
from maritrack.io.datagrams import Container, Datagrams, Stream
from maritrack.io.source import Octets
from maritrack.types import Damage

RAW, PCAP, PCAPNG, FINAL, MCAP = "raw", "pcap", "pcapng", "FINAL", "MCAP"
GZIP = b"\x1f\x8b\x08"
PCAP_MAGIC = (
    b"\xd4\xc3\xb2\xa1", b"\xa1\xb2\xc3\xd4", b"\x4d\x3c\xb2\xa1", b"\xa1\xb2\x3c\x4d",
    b"\x34\xcd\xb2\xa1", b"\xa1\xb2\xcd\x34",  # with long packet headers
)  # fmt: skip
PCAPNG_MAGIC, MCAP_MAGIC = b"\x0a\x0d\x0d\x0a", b"\x89MCAP0\r\n"
HEAD_UNPACKED = 64 * 1024


def unpacked_head(head: bytes) -> bytes:
    """The first octets behind gzip; the head itself where it isn't compressed."""
    if not head.startswith(GZIP):
        return head
    try:
        return zlib.decompressobj(31).decompress(head, HEAD_UNPACKED)
    except zlib.error:
        return b""


def is_gzip_of_nothing(octets: bytes) -> bool:
    """Whether these are one whole gzip member without content, and no more."""
    packed = zlib.decompressobj(31)
    try:
        return not packed.decompress(octets, 1) and packed.eof and not packed.unused_data
    except zlib.error:
        return False


def container_of(head: bytes) -> str:
    """What the first octets (unpacked, 64 KiB are enough) are the beginning of; "raw" where it is no container."""
    if head[:4] in PCAP_MAGIC:
        return PCAP
    if head[:4] == PCAPNG_MAGIC:
        return PCAPNG
    if head[:8] == MCAP_MAGIC:
        return MCAP
    from maritrack.io.containers.final import looks_final

    return FINAL if looks_final(head) else RAW


class Opened:
    """A recording ready to be read once: its datagrams, and the stored octets behind them.

    `name` says what the container is, `stream` chooses one of its streams (see `Selection`). With `keep` the stored
    octets wait in `ledger` until they are cut off; offsets count in the unpacked container.
    """

    def __init__(self, octets: Octets, *, stream: str = "", keep: bool = False) -> None:
        self.gzipped = octets.head.startswith(GZIP)
        self.name = container_of(unpacked_head(octets.head))
        self.ledger = Ledger()
        self.stored = 0  # octets read
        self._damage: list[Damage] = []  # of gzip, not yet told
        self._octets = octets
        self._keep = keep and (self.gzipped or self.name != RAW)  # of a raw recording the batches have them
        self._reader: Container | None = None
        self.streams: list[Stream] = [Stream()]
        if self.name != RAW:
            self._reader = READERS[self.name](self.chunks())
            self.streams = self._reader.streams
        self.selection = Selection(self.streams, wanted=stream if self.name != RAW else "")

    def chunks(self) -> Iterator[bytes]:
        """The octets of the container, unpacked."""
        if not self.gzipped:
            for chunk in self._octets.chunks:
                self._note(chunk, len(chunk))
                yield chunk
            return
        from maritrack.io.containers.gunzip import gunzip

        for unpacked in gunzip(self._octets.chunks):
            self._damage += unpacked.damage
            self._note(unpacked.stored, len(unpacked.data))
            if unpacked.data:
                yield unpacked.data

    def _note(self, stored: bytes, span: int) -> None:
        self.stored += len(stored)
        if self._keep:
            self.ledger.add(stored, span)

    def damage(self) -> tuple[Damage, ...]:
        """What was wrong with the compression, each told once."""
        told, self._damage = tuple(self._damage), []
        return told

    def datagrams(self) -> Iterator[Datagrams]:
        """The datagrams that hold CAT240, in the order of the container; of raw recordings each data block is one."""
        found = _data_blocks(self.chunks()) if self._reader is None else self._reader.datagrams()
        for d in found:
            chosen = d if self._reader is None else self.selection.take(d)
            damage = self.damage()
            yield replace(chosen, damage=(*damage, *chosen.damage)) if damage else chosen
        if damage := self.damage():
            yield replace(_nothing(0), damage=damage)


def open_container(octets: Octets, *, stream: str = "") -> Opened:
    """The container of a recording. UsageError where `stream` can't be one."""
    return Opened(octets, stream=stream)


def _pcap(chunks: Iterable[bytes]) -> Container:
    from maritrack.io.containers.pcap import PcapReader

    return PcapReader(chunks)


def _pcapng(chunks: Iterable[bytes]) -> Container:
    from maritrack.io.containers.pcapng import PcapngReader

    return PcapngReader(chunks)


def _final(chunks: Iterable[bytes]) -> Container:
    from maritrack.io.containers.final import FinalReader

    return FinalReader(chunks)


def _mcap(chunks: Iterable[bytes]) -> Container:
    from maritrack.io.containers.mcap_datagrams import McapReader

    return McapReader(chunks)


READERS: dict[str, Callable[[Iterable[bytes]], Container]] = {
    PCAP: _pcap, PCAPNG: _pcapng, FINAL: _final, MCAP: _mcap,
}  # fmt: skip


def _data_blocks(chunks: Iterable[bytes]) -> Iterator[Datagrams]:
    from maritrack.io.containers.rawblocks import data_blocks

    return data_blocks(chunks)


def _nothing(end: int) -> Datagrams:
    none = np.zeros(0, dtype=np.int64)
    return Datagrams(end, b"", np.zeros(1, dtype=np.int64), none, none, none)
