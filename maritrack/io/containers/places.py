"""Where the joined payloads of a container come from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from maritrack.errors import InputError
from maritrack.io.containers.kinds import Opened
from maritrack.io.containers.select import whole_blocks
from maritrack.io.datagrams import Datagrams
from maritrack.types import Damage, IntArray

MAX_WAITING = 1 << 30  # octets of a container that may pass without a data block


def payloads(opened: Opened, places: Places, *, name: str) -> Iterator[bytes]:
    """The whole data blocks of a container's datagrams, their places noted. InputError where none comes for long."""
    for d in opened.datagrams():
        if opened.ledger.size > MAX_WAITING:
            raise InputError(f"{name}: no CAT240 within {MAX_WAITING} octets")
        whole = whole_blocks(d)
        places.add(whole)
        if whole.data:
            yield whole.data


class Places:
    """Of each datagram its place in the container, its time and its stream, as long as they are asked for."""

    def __init__(self) -> None:
        none = np.zeros(0, dtype=np.int64)
        self._start = self._offset = self.t_ns = self.stream = self._end = none
        self._size = 0  # octets of payload so far
        self._container_end = 0
        self._damage: list[Damage] = []

    def add(self, d: Datagrams) -> None:
        """The next datagrams."""
        if len(d):
            at = np.maximum.accumulate(np.concatenate([self._end[-1:], d.offset]))[len(self._end[-1:]) :]
            self._start = np.concatenate([self._start, self._size + d.bounds[:-1]])
            self._offset = np.concatenate([self._offset, d.offset])
            self.t_ns = np.concatenate([self.t_ns, d.t_ns])
            self.stream = np.concatenate([self.stream, d.stream])
            self._end = np.concatenate([self._end, np.minimum(at, d.end)])
        self._size += len(d.data)
        self._container_end = d.end
        self._damage += d.damage

    def rows(self, offset: IntArray) -> IntArray:
        """The datagrams that octets (n,) of the payloads are in."""
        return np.asarray(np.maximum(np.searchsorted(self._start, offset, side="right") - 1, 0))

    def stream_of(self, offset: IntArray) -> IntArray:
        """The streams (n,) of octets of the payloads."""
        return np.asarray(self.stream[self.rows(offset)])

    def back(self, offset: IntArray, row: IntArray) -> IntArray:
        """The octets (n,) of the container where these octets of the payloads, of these datagrams, stand."""
        return np.asarray(self._offset[row] + offset - self._start[row])

    def place(self, offset: int) -> int:
        """The octet of the container where an octet of the payloads stands."""
        at = np.array([offset], dtype=np.int64)
        return int(self.back(at, self.rows(at))[0])

    def damage_back(self, damage: tuple[Damage, ...]) -> list[Damage]:
        """The same damage at its places in the container."""
        if not damage or len(self._start) == 0:
            return [replace(one, offset=0) for one in damage]
        offset = np.array([one.offset for one in damage], dtype=np.int64)
        places = self.back(offset, self.rows(offset)).tolist()
        return [replace(one, offset=place) for one, place in zip(damage, places, strict=True)]

    def told(self) -> tuple[Damage, ...]:
        """Damage of the container, each told once."""
        told, self._damage = tuple(self._damage), []
        return told

    def container_end(self, offset: int) -> int:
        """Octet of the container up to which it is used when the payloads are up to `offset`."""
        if offset >= self._size:
            return self._container_end
        return int(self._end[int(np.searchsorted(self._start, offset, side="right")) - 1])

    def forget(self, offset: int) -> None:
        """Drop what lies before an octet of the payloads."""
        first = max(int(np.searchsorted(self._start, offset, side="right")) - 1, 0)
        if first > 0:
            self._start, self._offset, self.t_ns = self._start[first:], self._offset[first:], self.t_ns[first:]
            self.stream, self._end = self.stream[first:], self._end[first:]
