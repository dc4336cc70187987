"""Unpack gzip piece by piece, whatever is wrong with it. Written from RFC 1952.

Everything before a break is delivered, and after it the unpacking goes on at the next member that really inflates.
The stored octets come along, so that nothing of the file is lost. What comes out doesn't depend on how the input
was cut. Memory: a step of the input, the largest header (some 200 KiB) and a piece.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from struct import Struct
from typing import NamedTuple

from maritrack.io.containers.pull import even_pieces
from maritrack.types import Damage

MAGIC = b"\x1f\x8b\x08"
PLAIN = MAGIC + b"\0"  # the usual header: no name, no comment
PIECE = 4 << 20  # unpacked octets of a piece, at most
BUDGET_FLOOR, BUDGET_RATIO = 64 << 20, 256  # unpacked octets that are allowed, and those to an octet of the file
STEP = 1 << 18  # stored octets looked at together
HISTORY = 1 << 16  # stored octets that are kept to be searched again
FIRST_STEP = 1 << 10  # of a member: many are small
TRAILER = Struct("<II")
TEXT = 1 << 16  # octets of a name or comment
TRIAL = 512  # octets that must inflate before a member is believed that nothing leads to
TRIAL_OUT = 8 * TRIAL
MAX_BROKEN = 1000  # members; what comes after is not unpacked
MAX_TRIALS = 10_000
MORE, NONE = 0, -1
CUT = "the file ends within a gzip member"
RAW_DEFLATE = -15


class Unpacked(NamedTuple):
    """A piece of what was packed."""

    data: bytes  # at most PIECE octets
    stored: bytes  # octets of the file that were used up for it; all of them together are the file
    damage: tuple[Damage, ...]  # offsets count in the stored file


def gunzip(chunks: Iterable[bytes | memoryview]) -> Iterator[Unpacked]:
    """What a gzip file of one or more members holds, in pieces."""
    unpacker = _Unpacker()
    for step in even_pieces(chunks, STEP):
        yield from unpacker.feed(step, final=False)
    yield from unpacker.feed(b"", final=True)


class _Unpacker:
    """Where the unpacking is: at a header, in a body, at a trailer, in search of a header, or given up."""

    def __init__(self) -> None:
        self._octets, self._base = b"", 0  # of the file: some that are used up, the others, and where they begin
        self._at = self._given = 0  # how many of them are used up by now, and how many given away
        self._state: Callable[[bool], bool] = self._header  # does a bit, returns False when it needs more octets
        self._inflater, self._fresh = zlib.decompressobj(RAW_DEFLATE), True
        self._crc = self._length = self._step = 0  # of the member
        self._unpacked = self._broken = self._trials = 0  # of the file
        self._lost = Damage("", 0, "")  # why a header is searched for
        self._suspect = -1  # octet of the file where the body of the member begins that is not known to be good
        self._parts: list[bytes] = []
        self._size = 0  # of the parts
        self._damage: list[Damage] = []
        self._again = 0  # how often the last of them was told once more

    def feed(self, step: bytes, *, final: bool) -> Iterator[Unpacked]:
        """What can be unpacked with these octets of the file too; `final` = no more will come."""
        cut = max(0, self._at - HISTORY)
        self._octets = self._octets[cut:] + step
        self._base, self._at, self._given = self._base + cut, self._at - cut, self._given - cut
        while self._state(final):
            if self._size >= PIECE:
                yield self._piece()
        if final:
            self._end()
        if self._at > self._given or self._parts or self._damage:
            yield self._piece()

    def _piece(self) -> Unpacked:
        self._settle()
        data = self._parts[0] if len(self._parts) == 1 else b"".join(self._parts)
        piece = Unpacked(data, self._octets[self._given : self._at], tuple(self._damage))
        self._given = max(self._given, self._at)
        self._parts, self._size, self._damage = [], 0, []
        return piece

    def _tell(self, code: str, offset: int, message: str) -> None:
        if self._damage and self._damage[-1].code == code:
            self._again += 1
        else:
            self._settle()
            self._damage.append(Damage(code, offset, message))

    def _settle(self) -> None:
        """Count the last damage as often as it was told."""
        if self._again:
            self._damage[-1] = replace(self._damage[-1], count=1 + self._again)
            self._again = 0

    def _header(self, final: bool) -> bool:
        if self._at == len(self._octets):
            return False
        body = body_of(self._octets, self._at)
        if body == MORE:
            return False
        if body == NONE:
            self._lose("gzip-junk", "octets that are no gzip member")
            return True
        self._at, self._state, self._suspect = body, self._body, self._base + body
        self._inflater, self._fresh = zlib.decompressobj(RAW_DEFLATE), True
        self._crc = self._length = 0
        self._step = FIRST_STEP
        return True

    def _body(self, final: bool) -> bool:
        room = PIECE - self._size
        if self._unpacked + room > BUDGET_FLOOR:
            budget = max(BUDGET_FLOOR, BUDGET_RATIO * (self._base + len(self._octets)))
            room = min(room, budget - self._unpacked)
            if room <= 0:
                self._give_up("inflation-budget", f"it unpacks to more than {budget} octets, the rest is left packed")
                return True
        octets = memoryview(self._octets)[self._at : self._at + self._step]
        before = None if self._fresh else self._inflater.copy()
        try:
            data = self._inflater.decompress(octets, room)
        except zlib.error:
            self._salvage(before or zlib.decompressobj(RAW_DEFLATE), octets, room)
            return True
        self._add(data)
        if self._inflater.eof:
            self._at += len(octets) - len(self._inflater.unused_data)
            self._state = self._trailer
            return True
        used = len(octets) - len(self._inflater.unconsumed_tail)
        self._at += used
        self._fresh, self._step = False, min(2 * self._step, STEP)
        return used > 0 or len(data) > 0 or self._is_cut(final)

    def _is_cut(self, final: bool) -> bool:
        """Whether the file ends within a member, or a broken member was inflated past the end of the file."""
        if final:
            self._at = len(self._octets)
            self._lose("gzip-cut", CUT)
        return final

    def _salvage(self, inflater: zlib._Decompress, octets: memoryview, room: int) -> None:
        """Deliver what these octets hold before the one that can't be: they are halved until it stands alone."""
        at, n = 0, len(octets)
        while n > 1:
            trial = inflater.copy()
            try:
                data = trial.decompress(octets[at : at + n // 2], room)
            except zlib.error:
                n //= 2
                continue
            self._add(data)
            inflater, at, n, room = trial, at + n // 2, n - n // 2, room - len(data)
        self._at += at
        self._lose("gzip-error", "the packed octets are broken")

    def _add(self, data: bytes) -> None:
        if data:
            self._crc = zlib.crc32(data, self._crc)
            self._length += len(data)
            self._unpacked += len(data)
            self._size += len(data)
            self._parts.append(data)

    def _trailer(self, final: bool) -> bool:
        end = self._at + TRAILER.size
        if len(self._octets) < end:
            return self._is_cut(final)
        if self._octets[self._at : end] != trailer(self._crc, self._length):
            self._tell("gzip-crc", self._base + self._at, "what was unpacked does not match its CRC and length")
        else:
            self._suspect = -1
        self._at, self._state = end, self._header
        return True

    def _lose(self, code: str, message: str) -> None:
        """Look for the next member; what is wrong is told when that is found.

        A broken body is often inflated past its end, so the search goes back a little.
        """
        self._broken += 1
        if self._broken > MAX_BROKEN:
            self._give_up(code, f"{message}, and there is no end of it: the rest is left packed")
            return
        self._lost, self._state = Damage(code, self._base + self._at, message), self._search
        if self._suspect >= 0:
            self._at = max(0, self._at - HISTORY, self._suspect - self._base)

    def _give_up(self, code: str, message: str) -> None:
        self._tell(code, self._base + self._at, message)
        self._state = self._pass_by

    def _pass_by(self, final: bool) -> bool:
        self._at = len(self._octets)
        return False

    def _search(self, final: bool) -> bool:
        while (found := self._octets.find(MAGIC, self._at)) >= 0 and self._trials < MAX_TRIALS:
            self._at = found
            verdict = self._inflates(found, final)
            if verdict is None:
                return False
            if verdict:
                message = f"{self._lost.message}, the next member begins at byte {self._base + found}"
                self._tell(self._lost.code, self._lost.offset, message)
                self._state = self._header
                return True
            self._trials += 1
            self._at = found + 1
        kept = 0 if final or self._trials == MAX_TRIALS else len(MAGIC) - 1
        self._at = max(self._at, len(self._octets) - kept)
        return False

    def _inflates(self, at: int, final: bool) -> bool | None:
        """Whether the octets at a place are a member as far as TRIAL octets tell; None = more are needed."""
        body = body_of(self._octets, at)
        if body == NONE or (body == MORE and final):
            return False
        if body == MORE or (len(self._octets) < body + TRIAL + TRAILER.size and not final):
            return None
        inflater = zlib.decompressobj(RAW_DEFLATE)
        try:
            data = inflater.decompress(memoryview(self._octets)[body : body + TRIAL], TRIAL_OUT)
        except zlib.error:
            return False
        if not inflater.eof:
            return len(data) > 0
        end = body + min(TRIAL, len(self._octets) - body) - len(inflater.unused_data)
        return self._octets[end : end + TRAILER.size] == trailer(zlib.crc32(data), len(data))

    def _end(self) -> None:
        """Say what the end of the file leaves undone."""
        if self._state == self._search:
            self._tell(self._lost.code, self._lost.offset, self._lost.message)
        elif self._at < len(self._octets):
            self._tell("gzip-cut", self._base + len(self._octets), CUT)
        self._at = len(self._octets)


def trailer(crc: int, length: int) -> bytes:
    """The last octets of a member."""
    return TRAILER.pack(crc, length & 0xFFFF_FFFF)


def body_of(octets: bytes, at: int) -> int:
    """Where the body of the member at a place begins; MORE = its header is cut off, NONE = it is none."""
    head = octets[at : at + 10]
    if len(head) == 10 and head.startswith(PLAIN):
        return at + 10
    if head[:3] != MAGIC[: len(head)] or (len(head) > 3 and head[3] & 0xE0):
        return NONE
    if len(head) < 10:
        return MORE
    flags, at = head[3], at + 10
    if flags & 4:
        at += 2 + int.from_bytes(octets[at : at + 2], "little")
    for text in (8, 16):
        if flags & text:
            end = octets.find(0, at, at + TEXT)
            if end < 0:
                return MORE if len(octets) < at + TEXT else NONE
            at = end + 1
    at += flags & 2
    return at if at <= len(octets) else MORE
