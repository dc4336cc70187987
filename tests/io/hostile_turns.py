"""Inputs whose radials are sound one by one, and made to cost as much as they can where turns are put together."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.io.cat240_blocks import block, packed_video, video
from tests.io.hostile import Octets, counted, filled

UNIT = block(video(7, cells=bytes(4), tod=500))
BARE = block(video(7, cells=b"", tod=500))  # 32 octets
UNTIMED = block(video(7, cells=b"", tod=None))
SENSOR, IDX, START, END, START_RG, CELL_DUR, RES = 5, 8, 12, 14, 16, 20, 25  # places in these
SPIN = [(IDX, ">u4", lambda i: i), (START, ">u2", lambda i: i * 32), (END, ">u2", lambda i: i * 32 + 32)]


def _hashed(i: np.ndarray) -> np.ndarray:
    """Numbers without order."""
    return (i * 2_654_435_761 + 12_345) >> 7 & 0xFFFF_FFFF


def _spinning(unit: bytes, *fields: Octets) -> Callable[[int], bytes]:
    """Spokes of one sensor that turns, in which some fields are functions of the number of the spoke."""
    return lambda size: counted(size, unit, *SPIN, *fields)


def _tod(unit: bytes, values: Callable[[np.ndarray], np.ndarray]) -> Octets:
    """Field of the two lower octets of the time, which is the end of the block."""
    return len(unit) - 2, ">u2", values


def _wide(size: int, wide: int, *, cells: int, res: int, each: int, step: int = 32) -> bytes:
    """A few wide radials of zeros, then many of one cell."""
    octets = cells << res - 1 >> 3
    units = [
        packed_video(
            i, bytes(octets), nbcells=cells, items={"048": bytes((128, res))}, azimuth=_azimuth(i, step), tod=500
        )
        if i % each < wide
        else video(i, cells=bytes(4), res=res, nbcells=32 >> res - 1, azimuth=_azimuth(i, step), tod=500)
        for i in range(each * 64)
    ]
    return filled(size, *map(block, units))


def _azimuth(i: int, step: int) -> tuple[int, int]:
    return i * step % 65_536, (i + 1) * step % 65_536


TURNS: dict[str, Callable[[int], bytes]] = {
    "spokes without cells": _spinning(BARE),
    "spokes of four octets": _spinning(UNIT),
    "spokes without a time": _spinning(UNTIMED),
    # sensors
    "two sensors in turn": _spinning(UNIT, (SENSOR + 1, "u1", lambda i: i % 2)),
    "sixty sensors in turn": _spinning(UNIT, (SENSOR + 1, "u1", lambda i: i % 60)),
    "sixty sensors without order": _spinning(UNIT, (SENSOR + 1, "u1", lambda i: _hashed(i) % 60)),
    "sensors without order": _spinning(UNIT, (SENSOR, ">u2", lambda i: _hashed(i) % 65_536)),
    "sixty sensors, another resolution each time": _spinning(
        UNIT, (SENSOR + 1, "u1", lambda i: i % 60), (RES, "u1", lambda i: 1 + i % 6)
    ),
    # range scales
    "another depth of cells each time": _spinning(UNIT, (CELL_DUR, ">u4", lambda i: 1_000_000 + i)),
    "another depth of cells every second time": _spinning(UNIT, (CELL_DUR, ">u4", lambda i: 1_000_000 + i // 2)),
    "another depth of cells every third time": _spinning(UNIT, (CELL_DUR, ">u4", lambda i: 1_000_000 + i // 3)),
    "two depths of cells in turn": _spinning(UNIT, (CELL_DUR, ">u4", lambda i: 1_000_000 + i % 2)),
    "two depths of cells, two each": _spinning(UNIT, (CELL_DUR, ">u4", lambda i: 1_000_000 + i // 2 % 2)),
    "another first cell every second time": _spinning(UNIT, (START_RG, ">u4", lambda i: i // 2 * 7)),
    "another resolution every second time": _spinning(UNIT, (RES, "u1", lambda i: 1 + i // 2 % 6)),
    "another resolution every fiftieth time": _spinning(UNIT, (RES, "u1", lambda i: 1 + i // 50 % 6)),
    "sound and odd resolutions without order": _spinning(UNIT, (RES, "u1", lambda i: _hashed(i) % 8)),
    # azimuths
    "azimuths without order": _spinning(UNIT, (START, ">u2", _hashed), (END, ">u2", lambda i: _hashed(i) + 32)),
    "a turn every second spoke": _spinning(
        UNIT, (START, ">u2", lambda i: i * 32_767), (END, ">u2", lambda i: i * 32_767 + 9)
    ),
    "a turn every ninth spoke": _spinning(
        UNIT, (START, ">u2", lambda i: i * 8_000), (END, ">u2", lambda i: i * 8_000 + 9)
    ),
    "azimuths that go to and fro": _spinning(UNIT, (START, ">u2", lambda i: i % 2 * 4_000)),
    "azimuths that go back by a quarter": _spinning(UNIT, (START, ">u2", lambda i: i * 16_384 - i % 5 * 16_000)),
    "the same azimuth": _spinning(UNIT, (START, ">u2", lambda i: i * 0), (END, ">u2", lambda i: i * 0)),
    # times
    "a silence before each spoke": _spinning(UNIT, _tod(UNIT, lambda i: i * 1_500)),
    "a silence before every second spoke": _spinning(UNIT, _tod(UNIT, lambda i: i // 2 * 1_500)),
    "a silence before every hundredth spoke": _spinning(UNIT, _tod(UNIT, lambda i: i // 100 * 1_500)),
    "times without order": _spinning(UNIT, _tod(UNIT, _hashed)),
    "days": _spinning(UNIT, (len(UNIT) - 3, "u1", lambda i: i % 2 * 167)),
    # indices
    "a gap before each index": _spinning(UNIT, (IDX, ">u4", lambda i: 2 * i)),
    "indices without order": _spinning(UNIT, (IDX, ">u4", _hashed)),
    "indices that fall": _spinning(UNIT, (IDX, ">u4", lambda i: 2**31 - i)),
    # parts of radials
    "one radial without an end": lambda n: counted(
        n, UNIT, (IDX, ">u4", lambda i: i), (START_RG, ">u4", lambda i: 4 * i)
    ),
    "radials of two parts": lambda n: counted(
        n, UNIT, (IDX, ">u4", lambda i: i), (START_RG, ">u4", lambda i: i % 2 * 4),
        (START, ">u2", lambda i: i // 2 * 32),
    ),
    "radials of many parts, another number each": lambda n: counted(
        n, UNIT, (IDX, ">u4", lambda i: i), (START, ">u2", lambda i: np.sqrt(i).astype(np.int64) * 32),
        (START_RG, ">u4", lambda i: (i - np.sqrt(i).astype(np.int64) ** 2) * 4),
    ),
    # cells
    "more cells declared than sent": _spinning(block(video(7, cells=bytes(4), nbcells=524_288, tod=500))),
    "one wide radial in fifty": lambda n: _wide(n, 1, cells=524_288, res=4, each=50),
    "two wide radials in three": lambda n: _wide(n, 2, cells=524_288, res=4, each=3),
    "two wide radials in a hundred": lambda n: _wide(n, 2, cells=524_288, res=4, each=100),
    "one wide radial in two": lambda n: _wide(n, 1, cells=524_288, res=4, each=2),
    "one wide radial in fifty, 32 bit": lambda n: _wide(n, 1, cells=524_288, res=6, each=50),
    "one wide radial in a turn of nine": lambda n: _wide(n, 1, cells=100_000, res=4, each=9, step=8_000),
    "two wide radials in a turn of nine": lambda n: _wide(n, 2, cells=50_000, res=4, each=9, step=8_000),
    "wide radials, 8 bit": lambda n: _wide(n, 1, cells=524_288, res=4, each=1),
    "wide radials, 32 bit": lambda n: _wide(n, 1, cells=524_288, res=6, each=1),
    "wide radials, 1 bit": lambda n: _wide(n, 1, cells=524_288, res=1, each=1),
    "wide radials, 4 bit": lambda n: _wide(n, 1, cells=524_288, res=3, each=1),
    "radials of 8192 cells, 8 bit": lambda n: _wide(n, 1, cells=8_192, res=4, each=1),
    "radials of 8192 cells, 32 bit": lambda n: _wide(n, 1, cells=8_192, res=6, each=1),
    "radials of 8192 cells, 32 bit, a turn every ninth": lambda n: _wide(n, 1, cells=8_192, res=6, each=1, step=8_000),
}  # fmt: skip
