"""Radials made by hand: a turning antenna, and ways to spoil what it sends."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from maritrack.io.cat240.radials import Batch, Radials
from maritrack.io.datagrams import NO_TIME
from maritrack.io.turns.assemble import Assembler
from maritrack.io.turns.turn import Cut, Turn
from maritrack.types import IntArray, take

TURN = 65_536
CELL_FS = 66_712_819  # 10 m
OCTETS = 50  # each made-up record


def radials(
    start_az: Sequence[int] | IntArray,
    *,
    width: int = 0,
    tod: Sequence[int] | IntArray | None = None,
    idx: Sequence[int] | IntArray | None = None,
    n_cells: int = 4,
    **columns: Any,
) -> Radials:
    """Radials at these START azimuths; cell 0 of each is its number from 1 on, so that it can be found again."""
    az = np.asarray(start_az, np.int64) % TURN
    n = len(az)
    number = np.arange(n)
    cells = np.zeros((n, n_cells), np.uint16)
    if n_cells:
        cells[:, 0] = number + 1
    values: dict[str, Any] = {
        "offset": number * OCTETS,
        "sac": np.full(n, 7),
        "sic": np.full(n, 42),
        "idx": number if idx is None else np.asarray(idx, np.int64),
        "start_az": az,
        "end_az": (az + width) % TURN,
        "start_rg": np.zeros(n, np.int64),
        "cell_dur": np.full(n, CELL_FS),
        "femto": np.ones(n, bool),
        "cell_m": np.full(n, 10.0),
        "compressed": np.zeros(n, bool),
        "tod": np.full(n, -1) if tod is None else np.asarray(tod, np.int64),
        "t_ns": np.full(n, NO_TIME),
        "stream": np.zeros(n, np.int64),
        "n_cells": np.full(n, n_cells),
        "bits": np.full(n, 16),
        "cells": cells,
    }
    return Radials(**{**values, **columns})


def spin(
    turns: float, *, per_turn: int = 64, begin: int = 0, period_s: float = 2.5, tod: int = 1000, **more: Any
) -> Radials:
    """An antenna that turns evenly, its azimuths the START of each spoke."""
    number = np.arange(round(turns * per_turn))
    az = begin + number * TURN // per_turn
    clock = tod + np.floor(number * period_s * 128 / per_turn).astype(np.int64)
    return radials(az, **{"width": TURN // per_turn, "tod": clock % (86_400 * 128), **more})


def batches(of: Radials, cuts: Sequence[int] = ()) -> Iterator[Batch]:
    """The radials in several batches, `cuts` being row numbers; each record has its own octets."""
    edges = [0, *sorted(cuts), len(of)]
    for lo, hi in pairwise(edges):
        rows = np.arange(lo, hi)
        yield Batch(lo * OCTETS, octets(lo, hi), take(of, rows) if hi > lo else None)


def octets(lo: int, hi: int) -> bytes:
    """Made-up octets of records lo..hi, all different."""
    return b"".join(f"{i:>{OCTETS}}".encode() for i in range(lo, hi))


def cuts_of(of: Radials, at: Sequence[int] = (), *, sensor: str = "") -> list[Cut]:
    """All ends of turns, the radials pushed in batches that begin at rows `at`."""
    assembler = Assembler(sensor=sensor)
    found: list[Cut] = []
    for batch in batches(of, at):
        if batch.radials is not None:
            found += assembler.push(batch.radials)
    return [*found, *assembler.finish()]


def turns_of(of: Radials, at: Sequence[int] = ()) -> list[Turn]:
    """The turns that become scans."""
    return [cut.turn for cut in cuts_of(of, at) if cut.turn is not None]


def numbers(turn: Turn) -> list[int]:
    """Which of the radials made by hand are in the turn."""
    return [int(cell) - 1 for cell in turn.cells[:, 0]]


def codes(cuts: Iterable[Cut]) -> list[str]:
    """What was noticed, in order."""
    return [damage.code for cut in cuts for damage in cut.damage]
