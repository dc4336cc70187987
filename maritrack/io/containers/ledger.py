"""Octets that were read and not yet given away, so that what is archived joins to the very input."""

from __future__ import annotations

from collections import deque


class Ledger:
    """Pieces of an input, each with the stretch it stands for.

    A piece whose size is another than its stretch's (it was stored compressed) is given away whole, with the first
    octet that it stands for.
    """

    def __init__(self) -> None:
        self._parts: deque[tuple[bytes | memoryview, int]] = deque()  # octets, length of the stretch
        self.start = 0  # of the stretch of the first piece
        self.size = 0  # octets held

    def add(self, octets: bytes | memoryview, span: int = -1) -> None:
        """The next piece; it stands for `span` octets of the input as read (-1 = for itself)."""
        span = len(octets) if span < 0 else span
        if octets or span:
            self._parts.append((octets, span))
            self.size += len(octets)

    def cut(self, end: int) -> bytes:
        """The octets up to `end` of the input; none where they are already given away."""
        taken = []
        while self._parts and (self.start < end or self._parts[0][1] == 0):
            part, span = self._parts.popleft()
            n = span if span != len(part) else min(span, end - self.start)
            if span == len(part) and n < span:
                self._parts.appendleft((part[n:], span - n))
                part = part[:n]
            taken.append(part)
            self.start += n
            self.size -= len(part)
        return b"".join(taken)

    def rest(self) -> bytes:
        """All of them."""
        taken = b"".join(part for part, _ in self._parts)
        self.start += sum(span for _, span in self._parts)
        self._parts.clear()
        self.size = 0
        return taken
