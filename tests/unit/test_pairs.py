"""The table of pairs against a dictionary."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.detect.pairs import BITS, NO_PAIRS, Pairs, found, level_of, observed, of_rows, with_rows


def told(pairs: Pairs) -> dict[tuple[int, int], float]:
    """The table as a dictionary of levels by (row, count)."""
    assert (np.diff(pairs.name) > 0).all()
    return dict(zip(zip(pairs.row.tolist(), pairs.count.tolist(), strict=True), pairs.level.tolist(), strict=True))


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_a_table_is_a_dictionary_of_levels_by_row_and_count(data: st.DataObject) -> None:
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    rows: list[str] = []  # a name for each
    levels: dict[tuple[str, int], float] = {}
    pairs, most = NO_PAIRS, data.draw(st.sampled_from([3, (1 << BITS) - 1]))
    for step in range(data.draw(st.integers(1, 12))):
        place = np.sort(rng.integers(0, len(rows) + 1, rng.integers(0, 4)))
        for k, at in enumerate(place.tolist()):
            rows.insert(at + k, f"{step}-{k}")
        pairs = with_rows(pairs, place)
        hit = np.flatnonzero(rng.random(len(rows)) < 0.5)
        count, level = rng.integers(1, most + 1, len(hit)), rng.normal(size=len(hit))
        name = (hit << BITS) | count
        at, has = found(pairs.name, name)
        wanted = [(rows[r], c) for r, c in zip(hit.tolist(), count.tolist(), strict=True)]
        assert level_of(pairs, at, has, np.full(len(hit), -9.0)).tolist() == [levels.get(x, -9.0) for x in wanted]
        pairs = observed(pairs, name, at, has, level)
        levels |= dict(zip(wanted, level.tolist(), strict=True))
        assert told(pairs) == {(rows.index(row), c): x for (row, c), x in levels.items()}
    some = rng.permutation(len(rows))[: len(rows) // 2]
    renamed = {rows[old]: new for new, old in enumerate(some.tolist())}
    expected = {(renamed[row], c): x for (row, c), x in levels.items() if row in renamed}
    assert told(of_rows(pairs, some)) == expected
