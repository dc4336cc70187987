"""The headers of a CAT240 recording in the quickest way that its make allows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from maritrack.errors import InputError
from maritrack.io.cat240.headers import HeaderWalk, RawMake
from maritrack.io.cat240.radials import Batch
from maritrack.io.containers.kinds import FINAL, GZIP, PCAP, PCAPNG, RAW, container_of, unpacked_head
from maritrack.io.datagrams import Stream
from maritrack.io.octets import CHUNK, FileChunks
from maritrack.io.source import Octets
from maritrack.types import Damage, IntArray, take


class Skim:
    """The headers of a recording, read once.

    Files that are as they should be are gone through from header to header; from the first thing that is out of the
    ordinary on the general reader goes on, and it reads all other recordings. Both ways tell the same. The general
    reader is imported where it is used: that takes a tenth of the time in which a million records are told.
    """

    def __init__(self, octets: Octets, *, stream: str = "", quick: bool = True) -> None:
        self.container = container_of(unpacked_head(octets.head))
        self.gzipped = octets.head.startswith(GZIP)
        self.streams: list[Stream] = []  # those that have appeared
        self._octets, self._stream = octets, stream
        self._quick = quick and not self.gzipped and isinstance(octets.chunks, FileChunks)
        self._others: dict[Stream, int] = {}

    def others(self) -> list[tuple[Stream, int]]:
        """Streams without CAT240 and how many datagrams each has; known when all is read."""
        return list(self._others.items())

    def __iter__(self) -> Iterator[Batch]:
        """Batches without cells and octets."""
        chunks = self._octets.chunks
        if self._quick and isinstance(chunks, FileChunks):
            if self.container == RAW:
                yield from self._raw(chunks.path)
                return
            if self.container == FINAL and not self._stream:
                yield from self._final(chunks.path)
                return
            if self.container in (PCAP, PCAPNG) and not self._stream:
                yield from self._packets(chunks.path)
                return
        yield from self._general(self._octets)

    def _raw(self, path: Path) -> Iterator[Batch]:
        self.streams.append(Stream())
        walk = HeaderWalk(path, RawMake())
        yield from walk
        if not walk.whole:
            from maritrack.io.cat240.reader import read_batches

            chunks = _FileFrom(path, walk.end)
            yield from read_batches(chunks, cells=False, start=walk.end, memories=walk.memories)

    def _final(self, path: Path) -> Iterator[Batch]:
        from maritrack.io.containers.final_heads import FinalMake

        make = FinalMake(self._octets.head)
        self.streams = make.streams
        walk = HeaderWalk(path, make)
        yield from walk
        if not walk.whole:  # days are counted from the first record on
            yield from _told_from(walk.end, self._general(self._octets))

    def _packets(self, path: Path) -> Iterator[Batch]:
        from maritrack.io.containers.packetwalk import packet_make

        found = packet_make(self._octets.head)
        if found is None:
            yield from self._general(self._octets)
            return
        make, start = found
        self.streams = make.streams
        walk = HeaderWalk(path, make, start=start)
        yield from walk
        self._add_others(make.others(whole=walk.whole))
        if not walk.whole:  # the file's header, a few packets, and what was not told
            rest = replace(self._octets, chunks=_FileFrom(path, walk.again, before=self._octets.head[:start]))
            found_in = self._general(rest, known=make.holding())
            yield from _told_from(walk.end, _moved(found_in, walk.again - start))

    def _general(self, octets: Octets, *, known: frozenset[Stream] = frozenset()) -> Iterator[Batch]:
        """What the general reader finds; `known` are streams that have shown CAT240 before."""
        from maritrack.io.containers.capture import open_cat240

        recording = open_cat240(octets, stream=self._stream, cells=False)
        recording.opened.selection.known = known
        for batch in recording.batches():
            yield self._renumbered(batch, recording.streams)
        self._renumber(recording.streams)
        counts, holding = recording.opened.selection.counts, set(recording.opened.selection.holding())
        self._add_others([(recording.streams[i], n) for i, n in enumerate(counts) if i not in holding])
        for i in holding:
            self._others.pop(recording.streams[i], None)

    def _renumber(self, streams: list[Stream]) -> IntArray:
        """The index that each of the reader's streams has here."""
        known = {stream: i for i, stream in enumerate(self.streams)}
        for stream in streams:
            known.setdefault(stream, len(known))
        self.streams += list(known)[len(self.streams) :]
        return np.array([known[stream] for stream in streams], dtype=np.int64)

    def _renumbered(self, batch: Batch, streams: list[Stream]) -> Batch:
        radials = batch.radials
        if radials is None:
            return batch
        number = self._renumber(streams)
        if (number == np.arange(len(number))).all():
            return batch
        return replace(batch, radials=replace(radials, stream=number[radials.stream]))

    def _add_others(self, others: list[tuple[Stream, int]]) -> None:
        for stream, n in others:
            self._others[stream] = self._others.get(stream, 0) + n


def _moved(batches: Iterable[Batch], by: int) -> Iterator[Batch]:
    """The same batches, their places so many octets further on."""
    for batch in batches:
        radials = batch.radials
        if by == 0:
            yield batch
            continue
        yield replace(
            batch, start=batch.start + by,
            radials=None if radials is None else replace(radials, offset=radials.offset + by),
            damage=tuple(replace(one, offset=one.offset + by) for one in batch.damage),
            texts=tuple(one._replace(offset=one.offset + by) for one in batch.texts),
        )  # fmt: skip


def _told_from(told: int, batches: Iterable[Batch]) -> Iterator[Batch]:
    """What is found from an octet on."""
    for batch in batches:
        radials, packed = batch.radials, batch.packed
        if radials is not None and packed is not None and radials.offset.min() < told:
            new = radials.offset >= told
            radials, packed = take(radials, new) if new.any() else None, packed[new]
        damage: tuple[Damage, ...] = tuple(one for one in batch.damage if one.offset >= told)
        texts = tuple(one for one in batch.texts if one.offset >= told)
        yield replace(batch, radials=radials, packed=packed, damage=damage, texts=texts)


class _FileFrom:
    """Some octets, and a file from a place on."""

    def __init__(self, path: Path, start: int, *, before: bytes = b"") -> None:
        self._path, self._start, self._before = path, start, before

    def __iter__(self) -> Iterator[bytes]:
        try:
            with open(self._path, "rb", buffering=0) as file:
                file.seek(self._start)
                if self._before:
                    yield self._before
                while chunk := file.read(CHUNK):
                    yield chunk
        except OSError as error:
            raise InputError(f"{self._path}: {error.strerror}") from error
