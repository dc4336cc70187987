"""What only the order of CAT240 records tells: duplicates and time that runs backwards."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from maritrack.io.cat240.exact import TOD_PER_DAY
from maritrack.types import BoolArray, IntArray

REMEMBERED = 8  # records of a sensor among which a duplicate is looked for


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
    n = len(sensor)
    if n == 0:
        return np.zeros(0, dtype=np.bool_), np.zeros(0, dtype=np.bool_)
    present = [(one, memories.setdefault(one, Memory())) for one in _distinct(sensor).tolist()]
    if len(present) == 1 and _is_orderly(present[0][1], keys[:, 0], tod):
        none = np.zeros(n, dtype=np.bool_)
        _remember(present, sensor[-REMEMBERED:], keys[-REMEMBERED:], tod[-REMEMBERED:], none[-REMEMBERED:])
        return none, none.copy()
    before = [memory for _, memory in present if memory.recent]
    sizes = np.array([len(memory.recent) for memory in before], dtype=np.int64)
    old = int(sizes.sum())
    keys = np.concatenate([np.array([key for memory in before for key in memory.recent]).reshape(-1, 4), keys])
    tod = np.concatenate([np.full(old, -1), tod])
    tod[np.cumsum(sizes) - 1] = [memory.tod for memory in before]
    numbers = np.array([one for one, memory in present if memory.recent], dtype=np.int64)
    sensor = np.concatenate([np.repeat(numbers, sizes), sensor])
    order = np.argsort(sensor, kind="stable") if len(present) > 1 else np.arange(len(sensor))
    sensor, keys, tod, new = sensor[order], keys[order], tod[order], order >= old
    duplicate = _repeated(sensor, keys) & new
    backwards = _set_back(sensor, tod, duplicate) & new
    _remember(present, sensor, keys, tod, duplicate)
    back = np.empty(len(order), dtype=np.int64)
    back[order] = np.arange(len(order))
    return duplicate[back[old:]], backwards[back[old:]]


def _distinct(sensor: IntArray) -> IntArray:
    return sensor[:1] if (sensor == sensor[0]).all() else np.unique(sensor)


def _is_orderly(memory: Memory, idx: IntArray, tod: IntArray) -> bool:
    """Whether indices only rise and times are all known and never fall: quickly seen, and there is nothing to find."""
    if len(idx) < REMEMBERED or tod[0] < max(memory.tod, 0) or not (tod[1:] >= tod[:-1]).all():
        return False
    before = max((key[0] for key in memory.recent), default=-1)
    return bool(idx[0] > before and (idx[1:] > idx[:-1]).all())


def _repeated(sensor: IntArray, keys: IntArray) -> BoolArray:
    """Which records (n,), in order by sensor, repeat one of the REMEMBERED before them."""
    found, idx = np.zeros(len(sensor), dtype=np.bool_), np.ascontiguousarray(keys[:, 0])
    for lag in range(1, REMEMBERED + 1):
        alike = lag + np.flatnonzero((idx[lag:] == idx[:-lag]) & (idx[lag:] >= 0))
        alike = alike[(sensor[alike] == sensor[alike - lag]) & (keys[alike] == keys[alike - lag]).all(axis=1)]
        found[alike] = True
    return found


def _set_back(sensor: IntArray, tod: IntArray, duplicate: BoolArray) -> BoolArray:
    """At which records (n,), in order by sensor, the time is before the last one known."""
    found, known = np.zeros(len(sensor), dtype=np.bool_), np.flatnonzero((tod >= 0) & ~duplicate)
    step = tod[known[:-1]] - tod[known[1:]]
    found[known[1:]] = (step > 0) & (step <= TOD_PER_DAY // 2) & (sensor[known[:-1]] == sensor[known[1:]])
    return found


def _remember(
    present: list[tuple[int, Memory]], sensor: IntArray, keys: IntArray, tod: IntArray, duplicate: BoolArray
) -> None:
    """Keep the last records of each sensor and its last known time; records are in order by sensor."""
    ends = np.searchsorted(sensor, [one for one, _ in present], side="right").tolist()
    known = np.flatnonzero((tod >= 0) & ~duplicate)
    last = np.searchsorted(known, ends) - 1
    for (one, memory), end, i in zip(present, ends, last.tolist(), strict=True):
        begin = max(end - REMEMBERED, 0)
        some = keys[begin:end][sensor[begin:end] == one]
        memory.recent = deque(map(tuple, some.tolist()), maxlen=REMEMBERED)
        if i >= 0 and sensor[known[i]] == one:
            memory.tod = int(tod[known[i]])
