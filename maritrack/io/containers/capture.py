"""Radar video out of any container: the radials of its data blocks, with their places and times in the container."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from maritrack.io.cat240.radials import Batch
from maritrack.io.cat240.reader import read_batches, refuse
from maritrack.io.containers.kinds import RAW, Opened
from maritrack.io.containers.places import Places, payloads
from maritrack.io.datagrams import Stream
from maritrack.io.source import Octets


class Cat240Recording:
    """A CAT240 recording, read once.

    The octets of its batches join to the stored input. With `cells` False there are headers alone, and no octets.
    `stream` chooses one of several, see `Selection`. With `strict` the first damage raises InputError. With several
    `workers` as many processes inflate, to the same result.
    """

    def __init__(
        self, octets: Octets, *, strict: bool = False, stream: str = "", cells: bool = True, workers: int = 1
    ) -> None:
        self._name, self._strict, self._cells, self._workers = octets.name, strict, cells, workers
        self.opened = Opened(octets, stream=stream, keep=cells)
        self._places = Places()
        self._at = 0  # octet of the container up to which all was delivered

    @property
    def container(self) -> str:
        return self.opened.name

    @property
    def gzipped(self) -> bool:
        return self.opened.gzipped

    @property
    def streams(self) -> list[Stream]:
        """Those that have appeared, the first first; recordings without addresses have one without a name."""
        return self.opened.streams

    def batches(self) -> Iterator[Batch]:
        """Batches in the order of the recording, the last with all that is left of the input."""
        raw = self.container == RAW
        found = self._raw() if raw else self._translated()
        for batch in found:
            damage = (*self.opened.damage(), *batch.damage)
            if self._strict and damage:
                refuse(damage[0], self._name)
            self._at = batch.end
            yield replace(batch, damage=damage) if len(damage) != len(batch.damage) else batch
        rest, damage = self.opened.ledger.rest(), (*self.opened.damage(), *self._places.told())
        if self._strict and damage:
            refuse(damage[0], self._name)
        if rest or damage:
            yield Batch(self._at, rest, None, damage, span=0)

    def _raw(self) -> Iterator[Batch]:
        ledger = self.opened.ledger
        for batch in read_batches(self.opened.chunks(), cells=self._cells, workers=self._workers):
            octets = ledger.cut(batch.end)
            yield replace(batch, octets=octets, span=batch.end - batch.start) if self.gzipped else batch

    def _translated(self) -> Iterator[Batch]:
        """Batches of the joined payloads, put back to their places in the container."""
        places, ledger = self._places, self.opened.ledger
        joined = payloads(self.opened, places, name=self._name)
        for batch in read_batches(joined, cells=self._cells, stream_of=places.stream_of, workers=self._workers):
            radials = batch.radials
            if radials is not None:
                row = places.rows(radials.offset)
                radials = replace(radials, offset=places.back(radials.offset, row), t_ns=places.t_ns[row])
            damage = sorted([*places.told(), *places.damage_back(batch.damage)], key=lambda one: one.offset)
            end = places.container_end(batch.end)
            octets, span = ledger.cut(end), end - self._at
            texts = tuple(one._replace(offset=places.place(one.offset)) for one in batch.texts)
            yield replace(
                batch, start=self._at, octets=octets, radials=radials, damage=tuple(damage), span=span, texts=texts
            )
            places.forget(batch.end)


def open_cat240(
    octets: Octets, *, strict: bool = False, stream: str = "", cells: bool = True, workers: int = 1
) -> Cat240Recording:
    """A recording ready to be read; see `Cat240Recording`."""
    return Cat240Recording(octets, strict=strict, stream=stream, cells=cells, workers=workers)
