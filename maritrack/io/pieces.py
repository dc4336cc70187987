"""From stretches of an input, in the order of reading, to frames in the order of time."""

from __future__ import annotations

import heapq
from collections.abc import Generator, Iterable
from dataclasses import dataclass
from typing import Any

from maritrack.errors import InputError
from maritrack.types import Damage, Frame, Scan


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A stretch of the input and what was found in it."""

    octets: bytes = b""
    scan: Scan | None = None
    damage: tuple[Damage, ...] = ()
    truth: tuple[Any, ...] = ()  # records


def frames_by_time(
    pieces: Iterable[Piece], *, channel: str, name: str, window: int, strict: bool = False
) -> Generator[Frame, None, tuple[Damage, ...]]:
    """A frame per scan, sorted by time (stable) as far as scans are at most `window` scans out of place.

    A frame carries what was read since the one before it, the last frame all the rest. A scan that comes
    too late is dropped and reported. Returns the damage that no frame could carry, because there is none.
    """
    waiting: list[tuple[int, int, Scan]] = []
    octets: list[bytes] = []
    damage: list[Damage] = []
    sent, last_ns = 0, -(2**63)

    def frame() -> Frame:
        nonlocal sent, last_ns
        last_ns, _, scan = heapq.heappop(waiting)
        data = b"".join(octets)
        sent += 1
        made = Frame(k=sent - 1, scan=scan, inputs=((channel, data),) if data else (), damage=tuple(damage))
        octets.clear()
        damage.clear()
        return made

    for i, piece in enumerate(pieces):
        octets.append(piece.octets)
        damage.extend(piece.damage)
        if piece.scan is not None and piece.scan.t_ns < last_ns:
            late_s = (last_ns - piece.scan.t_ns) / 1e9
            damage.append(Damage("late-scan", -1, f"a scan {late_s:g} s older than one that is done, left out"))
        elif piece.scan is not None:
            heapq.heappush(waiting, (piece.scan.t_ns, i, piece.scan))
        if strict and damage:
            raise InputError(f"{name}: {damage[0].code}: {damage[0].message}")
        while len(waiting) > window:
            yield frame()
    while waiting:
        yield frame()
    return tuple(damage)
