"""Duplicates and time that steps back, against the definition, record by record."""

from __future__ import annotations

from collections import deque

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.io.cat240.exact import TOD_PER_DAY
from maritrack.io.cat240.order import REMEMBERED, Memory, screen

Record = tuple[int, int, int, int]  # sensor, MSG_INDEX, azimuth, time of day
RECORDS = st.tuples(
    st.integers(0, 2), st.integers(-1, 12), st.integers(0, 1),
    st.sampled_from([-1, 0, 1, 2, TOD_PER_DAY // 2 - 1, TOD_PER_DAY // 2, TOD_PER_DAY // 2 + 1, TOD_PER_DAY - 1]),
)  # fmt: skip


def by_definition(records: list[Record]) -> tuple[list[bool], list[bool]]:
    recent = {sensor: deque[tuple[int, int]](maxlen=REMEMBERED) for sensor in range(3)}
    last, duplicate, backwards = dict.fromkeys(range(3), -1), [], []
    for sensor, idx, az, tod in records:
        duplicate.append(idx >= 0 and (idx, az) in recent[sensor])
        recent[sensor].append((idx, az))
        counts = tod >= 0 and not duplicate[-1]
        backwards.append(counts and 0 < last[sensor] - tod <= TOD_PER_DAY // 2)
        last[sensor] = tod if counts else last[sensor]
    return duplicate, backwards


@given(st.lists(RECORDS, max_size=60), st.lists(st.integers(0, 60), max_size=5))
@settings(derandomize=True, deadline=None, max_examples=300)
def test_records_are_screened_as_defined_wherever_they_are_cut(records: list[Record], cuts: list[int]) -> None:
    memories: dict[int, Memory] = {}
    duplicate, backwards = list[bool](), list[bool]()
    for some in np.split(np.array(records, dtype=np.int64).reshape(-1, 4), sorted(min(c, len(records)) for c in cuts)):
        sensor, idx, az, tod = some.T
        keys = np.stack([idx, az, az + 1, np.zeros_like(az)], axis=1)
        repeats, steps = screen(memories, sensor=sensor, keys=keys, tod=tod)
        duplicate += repeats.tolist()
        backwards += steps.tolist()
    assert (duplicate, backwards) == by_definition(records)
