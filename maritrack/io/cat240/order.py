"""What only the order of CAT240 records tells: duplicates and time that runs backwards."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from maritrack.io.cat240.exact import TOD_PER_DAY
from maritrack.types import BoolArray, IntArray

REMEMBERED = 8  # records of a sensor among which a duplicate is looked for
WORTHWHILE = 16  # records of a sensor for which arrays pay; fewer are gone through one by one


@dataclass(slots=True)
class Memory:
    """The last records of one sensor: (idx, start_az, end_az, start_rg), and the last known time (-1 = none)."""

    recent: deque[tuple[int, int, int, int]] = field(default_factory=lambda: deque(maxlen=REMEMBERED))
    tod: int = -1


def screen(
    memories: dict[int, Memory], *, sensor: IntArray, keys: IntArray, tod: IntArray
) -> tuple[BoolArray, BoolArray]:
    """Which of n records repeat one of the last few of their sensor, and at which of the others time steps back.

    `sensor` (n,), `keys` (n, 4) with the MSG_INDEX first (-1 = absent), `tod` (n,) in 1/128 s (-1 = absent). A step
    back of more than half a day is midnight. `memories` is brought up to date.
    """
    duplicate, backwards = np.zeros(len(sensor), dtype=np.bool_), np.zeros(len(sensor), dtype=np.bool_)
    sensors = _distinct(sensor) if len(sensor) >= WORTHWHILE else sensor[:0]
    worthwhile = 0 < WORTHWHILE * len(sensors) <= len(sensor)
    todo = np.zeros(len(sensor), dtype=np.bool_) if worthwhile else ~duplicate
    for one in sensors.tolist() if worthwhile else []:
        group = np.flatnonzero(sensor == one)
        memory = memories.setdefault(one, Memory())
        if _is_orderly(memory, keys[group, 0], tod[group]):
            _remember(memory, keys[group[-REMEMBERED:]], tod[group])
        else:
            todo[group] = True
    for i in np.flatnonzero(todo).tolist():
        memory = memories.setdefault(int(sensor[i]), Memory())
        idx, start_az, end_az, start_rg = keys[i].tolist()
        duplicate[i] = idx >= 0 and (idx, start_az, end_az, start_rg) in memory.recent
        memory.recent.append((idx, start_az, end_az, start_rg))
        if tod[i] >= 0 and not duplicate[i]:
            backwards[i] = 0 < memory.tod - tod[i] <= TOD_PER_DAY // 2
            memory.tod = int(tod[i])
    return duplicate, backwards


def _distinct(sensor: IntArray) -> IntArray:
    return sensor[:1] if (sensor == sensor[0]).all() else np.unique(sensor)


def _is_orderly(memory: Memory, idx: IntArray, tod: IntArray) -> bool:
    """Whether indices only rise and times never fall, so that there is nothing to find."""
    before = np.array([key[0] for key in memory.recent], dtype=np.int64)
    times = tod[tod >= 0]
    if len(times) and times[0] < memory.tod:
        return False
    return bool((np.diff(np.concatenate([before, idx])) > 0).all() and (np.diff(times) >= 0).all())


def _remember(memory: Memory, keys: IntArray, tod: IntArray) -> None:
    memory.recent.extend((idx, start_az, end_az, start_rg) for idx, start_az, end_az, start_rg in keys.tolist())
    times = tod[tod >= 0]
    if len(times):
        memory.tod = int(times[-1])
