"""Where the records of a FINAL file are: the chain of LEN, and finding it again when it breaks.

LEN is the authority, the footer where it leads is the check. A record whose footer is broken is still believed if
LEN leads to the next record. Otherwise the chain goes on at the next record that follows a footer, or that its one
data block fills.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field

import numpy as np

from maritrack.io.cat240.framing import CAT240, HEADER

FOOTER = b"\xa5\xa5\xa5\xa5"
PLAIN, NUMBERED = 8, 12  # octets before the data blocks, without and with a sequence number
MAX_RECORD = 0xFFFF
HEAD = 1 << 16
LOOKAHEAD = 3 * HEAD  # octets after a place that is no record in which the next one is found, if there is one
JUDGED = 64  # records that tell the layout
LEAP_CS = 8_640_100  # 1/100 s of a day with a leap second
NO_TIME_CS = 0xFF_FFFF  # how this program writes that there is no time; no clock shows it


@dataclass(slots=True)
class Trouble:
    """Something wrong in a stretch, as often as it is there."""

    code: str
    at: int  # the first time
    message: str
    count: int = 0


@dataclass(slots=True)
class Found:
    """The records of a stretch of the file. Places count from its first octet."""

    starts: list[int] = field(default_factory=list)
    ends: list[int] = field(default_factory=list)
    end: int = 0  # up to here all is judged
    lost: int | None = None  # where the chain broke, if it has not been found again
    _troubles: dict[str, Trouble] = field(default_factory=dict)

    def add(self, start: int, end: int) -> None:
        self.starts.append(start)
        self.ends.append(end)

    def tell(self, code: str, at: int, message: str, *, count: int = 1) -> None:
        if code not in self._troubles:
            self._troubles[code] = Trouble(code, at, message)
        self._troubles[code].count += count

    def troubles(self) -> list[Trouble]:
        """What is wrong, each thing once, where it was first."""
        return sorted(self._troubles.values(), key=lambda one: one.at)


def layout_of(head: bytes) -> int:
    """Octets before the data blocks of each record, PLAIN or NUMBERED; 0 = the file doesn't begin like FINAL.

    Told by the data blocks: with the right layout they fill the records exactly.
    """
    votes = {layout: _filled(head, layout) for layout in (PLAIN, NUMBERED)}
    best = max((PLAIN, NUMBERED), key=lambda layout: votes[layout])
    return best if votes[best] else 0


def _filled(head: bytes, layout: int) -> int:
    """How many of the first records are filled by data blocks; 0 where the file begins with something else."""
    begins = dict.fromkeys([0, *places(head, layout, final=True)])
    whole = [at for at in begins if _is_record(head, at, layout)][:JUDGED]
    if whole and (whole[0] == 0 or head[0] != CAT240):
        return sum(_blocks_fill(head, at + layout, at + _length(head, at) - len(FOOTER)) for at in whole)
    return int(_begins_record(head, layout))


def _begins_record(head: bytes, layout: int) -> bool:
    """Whether these are the first octets of one record with one data block: all that a cut file may hold."""
    at, length = layout, _length(head, 0)
    return (
        len(head) >= at + HEADER and length > len(head) and _plausible_time(head, 0, layout) and head[at] > 0
        and _length(head, at + 1) == length - layout - len(FOOTER)
    )  # fmt: skip


def _blocks_fill(data: bytes, at: int, end: int) -> bool:
    """Whether whole data blocks, at least one, end exactly at `end`."""
    while at + HEADER < end and data[at] > 0 and (length := _length(data, at + 1)) > HEADER:
        at += length
        if at == end:
            return True
    return False


def _length(data: bytes, at: int) -> int:
    return data[at] << 8 | data[at + 1] if at + 1 < len(data) else 0


def _plausible_time(data: bytes, at: int, layout: int) -> bool:
    time_cs = int.from_bytes(data[at + layout - 3 : at + layout], "big")
    return time_cs < LEAP_CS or time_cs == NO_TIME_CS


def _is_record(data: bytes, at: int, layout: int) -> bool:
    """Whether a whole record with a time of day begins at a place."""
    length = _length(data, at)
    end = at + length
    return (
        end <= len(data) and data[end - len(FOOTER) : end] == FOOTER and length >= layout + len(FOOTER)
        and _plausible_time(data, at, layout)
    )  # fmt: skip


def places(data: bytes, layout: int, *, final: bool) -> list[int]:
    """Places where a record begins: after a footer, or filled by one data block.

    If the file goes on (not `final`), also those where one may begin that ends later.

    Only places are looked at that have room for the header of a data block.
    """
    n = len(data) - layout - HEADER + 1
    if n <= 0:
        return []
    u8 = np.frombuffer(data, dtype=np.uint8)
    u16 = u8[:-1].astype(np.uint16) << 8 | u8[1:]
    footer = (u16[:-2] == int.from_bytes(FOOTER[:2], "big")) & (u16[2:] == int.from_bytes(FOOTER[2:], "big"))
    filled = (u16[layout + 1 : layout + 1 + n] == u16[:n] - np.uint16(layout + len(FOOTER))) & (u8[layout:][:n] > 0)
    filled[len(FOOTER) :] |= footer[: n - len(FOOTER)] if n > len(FOOTER) else False
    at = np.flatnonzero(filled)
    time_cs = u8[at + layout - 3].astype(np.int64) << 16 | u16[at + layout - 2]
    length = u16[at].astype(np.int64)
    at = at[(length >= layout + len(FOOTER)) & ((time_cs < LEAP_CS) | (time_cs == NO_TIME_CS))]
    end = at + u16[at]
    open_end = end > len(data)
    closed = ~open_end & footer[np.where(open_end, 0, end - len(FOOTER))]
    return list(at[closed if final else closed | open_end].tolist())


def walk(data: bytes, layout: int, *, final: bool, lost: int | None) -> Found:
    """The records of a stretch that begins with one, or behind the place `lost` (0 or less) where the chain broke."""
    found = Found(lost=lost)
    sound: list[int] | None = None
    at, size, least = 0, len(data), layout + len(FOOTER)
    while at < size:
        if found.lost is None:
            end = at + (data[at] << 8 | data[at + 1]) if at + 1 < size else size + 1
            if end <= size and end - at >= least and data[end - 4 : end] == FOOTER:
                found.add(at, end)
                at = end
                continue
            if not final and size - at < LOOKAHEAD:
                break
            sound = places(data, layout, final=final) if sound is None else sound
            if end - at >= least and _leads_on(data, at, end, sound, layout):
                found.tell("final-footer", at, "a record that doesn't end with A5 A5 A5 A5")
                found.add(at, end)
                at = end
                continue
        sound = places(data, layout, final=final) if sound is None else sound
        at = _resume(data, at, sound, found, layout, final=final)
        if found.lost is not None:
            break
    found.end = at
    return found


def _leads_on(data: bytes, at: int, end: int, sound: list[int], layout: int) -> bool:
    """Whether LEN leads from a place to the next record or to the end of the file."""
    i = bisect_left(sound, at + 1)
    return (i == len(sound) or sound[i] >= end) and (end == len(data) or _is_record(data, end, layout))


def _resume(data: bytes, at: int, sound: list[int], found: Found, layout: int, *, final: bool) -> int:
    """Where the chain goes on after it broke at a place; if it can't be told yet, where to look on from."""
    first = at if found.lost is None else found.lost
    i = bisect_left(sound, at + 1)
    if i < len(sound) and _is_record(data, sound[i], layout):
        found.tell("final-lost", first, f"no record begins here, the next one is {sound[i] - first} octets on")
        found.lost = None
        return sound[i]
    if i < len(sound):
        found.lost = first
        return sound[i] - len(FOOTER)
    if not final:
        found.lost = first
        return max(at, len(data) - layout - HEADER - len(FOOTER) + 1)
    left = len(data) - first
    if found.lost is None and (left < layout or (_length(data, at) > left and _plausible_time(data, at, layout))):
        found.tell("final-cut", first, f"the file ends within a record, {left} octets of it are there")
    else:
        found.tell("final-lost", first, f"no record begins here, and none in the {left} octets that follow")
    found.lost = None
    return len(data)
