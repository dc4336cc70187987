"""The octets of a stream by count, however it was cut into chunks."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator

PIECE = 1 << 20


def even_pieces(chunks: Iterable[bytes | memoryview], size: int = PIECE) -> Iterator[bytes]:
    """The stream in pieces of `size` octets; the last has what is left over.

    Who judges piece by piece then judges the same, whatever the chunks were.
    """
    held = bytearray()
    for chunk in chunks:
        view = memoryview(chunk).cast("B")
        while len(held) + len(view) >= size:
            cut = size - len(held)
            yield bytes(view[:cut]) if not held else bytes(held + view[:cut])
            view, held = view[cut:], bytearray()
        held += view
    if held:
        yield bytes(held)


class Pull:
    """Takes a stream apart from its beginning to its end. Holds what was looked at and not taken, and a piece."""

    def __init__(self, chunks: Iterable[bytes | memoryview]) -> None:
        self._pieces = even_pieces(chunks)
        self._held, self._at, self._base = b"", 0, 0
        self._crc, self._summed = 0, 0  # CRC of the stream up to the octet `_summed` of what is held

    @property
    def offset(self) -> int:
        """Octet of the stream that comes next."""
        return self._base + self._at

    def window(self, n: int) -> tuple[bytes, int]:
        """Octets and a place in them, from which on the next `n` octets are there, or all to the end of the stream."""
        if len(self._held) - self._at < n:
            self._fill(n)
        return self._held, self._at

    def has(self, n: int) -> bool:
        """Whether there are `n` more octets."""
        held, at = self.window(n)
        return len(held) - at >= n

    def take(self, n: int) -> bytes:
        """The next `n` octets, fewer at the end of the stream."""
        held, at = self.window(n)
        octets = held[at : at + n]
        self._at += len(octets)
        return octets

    def skip(self, n: int) -> int:
        """Leave out `n` octets, or as many as there are; returns how many."""
        left = n
        while left and self.has(1):
            some = min(left, len(self._held) - self._at)
            self._at += some
            left -= some
        return n - left

    def crc(self) -> int:
        """CRC of the stream up to what comes next."""
        self._crc = zlib.crc32(memoryview(self._held)[self._summed : self._at], self._crc)
        self._summed = self._at
        return self._crc

    def _fill(self, n: int) -> None:
        self.crc()
        parts, size = [self._held[self._at :]], len(self._held) - self._at
        while size < n and (piece := next(self._pieces, b"")):
            parts.append(piece)
            size += len(piece)
        self._base += self._at
        self._held, self._at, self._summed = b"".join(parts), 0, 0
