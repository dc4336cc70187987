"""A datagram of which fragments have come: what there is of it, and what is missing."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from maritrack.io.containers.packets import UDP_HEADER
from maritrack.io.datagrams import NO_TIME

MAX_DATAGRAM = 65_535
UNIT = 8  # octets that a fragment's place counts in
MISSING, THERE, CUT = b"\0", b"\1", b"\2"  # state of a unit


@dataclass(slots=True)
class Partial:
    """A datagram that waits for fragments."""

    offset: int  # octet of the file where its first payload was
    t_ns: int  # of its first fragment
    opened: int  # how many fragments had come by then
    again: bool  # a datagram with its identification was done just before
    last_ns: int = NO_TIME  # of its last fragment
    count: int = 0  # of its fragments
    total: int = -1  # octets, -1 = not known
    held: int = 0  # units that are not missing
    cut: int = MAX_DATAGRAM  # the first octet that the capture left out
    octets: bytearray = field(default_factory=bytearray)
    units: bytearray = field(default_factory=bytearray)

    @property
    def complete(self) -> bool:
        return self.total >= 0 and self.held == -(-self.total // UNIT)

    def put(self, place: int, octets: bytes, length: int, *, more: bool) -> str:
        """Put in a fragment of `length` octets of which `octets` were captured; the code of what is odd, or ""."""
        end, trouble = place + length, ""
        if self.total >= 0 and (end > self.total or (not more and end < self.total)):
            trouble, end = "fragment-overlap", min(end, self.total)
        elif not more and self.total < 0:
            if len(self.octets) > end:
                trouble = "fragment-overlap"
            else:
                self.total = end
        if end != self.total:
            end -= end % UNIT  # of a last fragment that isn't believed to be the last
        if end <= place:
            return trouble
        octets = octets[: end - place]
        first, last = place // UNIT, -(-end // UNIT)
        if len(self.units) < last:
            self.units += bytes(last - len(self.units))
        if len(self.octets) < end:
            self.octets += bytearray(end - len(self.octets))
        before = self.units[first:last]
        missing = before.count(MISSING)
        if missing == last - first:
            self.octets[place : place + len(octets)] = octets
            self.units[first:last] = _states(octets, end - place)
        elif missing:
            self._fill(place, octets, before, _states(octets, end - place))
            trouble = "fragment-overlap"
        elif not trouble:
            same = self.octets[place : place + len(octets)] == octets
            trouble = "fragment-duplicate" if same else "fragment-overlap"
        self.held += missing
        cut = place + len(octets)
        if cut < end and not before[cut // UNIT - first]:
            self.cut = min(self.cut, cut)
        return trouble

    def _fill(self, place: int, octets: bytes, before: bytearray, states: bytes) -> None:
        """Put in the units that are missing alone."""
        missing = np.frombuffer(before, dtype=np.uint8) == MISSING[0]
        first = place // UNIT
        units = np.frombuffer(self.units, dtype=np.uint8)[first : first + len(before)]
        np.copyto(units, np.frombuffer(states, dtype=np.uint8), where=missing)
        held = np.frombuffer(self.octets, dtype=np.uint8)[place : place + len(octets)]
        some = missing[: -(-len(octets) // UNIT)]
        np.copyto(held, np.frombuffer(octets, dtype=np.uint8), where=np.repeat(some, UNIT)[: len(octets)])

    def is_another(self, octets: bytes) -> bool:
        """Whether the first fragment is there, and a first fragment with these octets is of another datagram."""
        return self.units[:1] == THERE and self.octets[:UDP_HEADER] != octets[:UDP_HEADER]

    def reach(self) -> int:
        """How many octets there are up to the first that is missing."""
        if self.units[:1] == MISSING:
            return 0
        gaps = [at for at in (self.units.find(MISSING), self.units.find(CUT)) if at >= 0]
        gap = min(gaps, default=len(self.units))
        if gap < len(self.units) and self.units[gap] == CUT[0]:
            return max(gap * UNIT, self.cut if self.cut // UNIT == gap else 0)
        return min(gap * UNIT, len(self.octets))


def _states(octets: bytes, length: int) -> bytes:
    """State of the units of a fragment of which the octets were captured."""
    if len(octets) == length:
        return THERE * -(-length // UNIT)
    whole = len(octets) // UNIT
    return THERE * whole + CUT * (-(-length // UNIT) - whole)
