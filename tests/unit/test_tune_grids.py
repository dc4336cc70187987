"""Grids as people write them."""

from __future__ import annotations

from typing import Any

import pytest

from maritrack.errors import UsageError
from maritrack.tune.grids import combinations, nested, parse_axis, parse_counts, parse_numbers


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("20:100:20", (20.0, 40.0, 60.0, 80.0, 100.0)),
        ("0.1:0.5:0.1", (0.1, 0.2, 0.3, 0.4, 0.5)),  # as written, not 0.30000000000000004
        ("1:3", (1.0, 2.0, 3.0)),
        ("1:3.9", (1.0, 2.0, 3.0)),
        ("55", (55.0,)),
        ("60,20,60", (20.0, 60.0)),
    ],
)
def test_numbers_are_ranges_or_lists(text: str, values: tuple[float, ...]) -> None:
    assert parse_numbers(text, name="--eps") == values


@pytest.mark.parametrize("text", ["", "a", "1:2:0", "2:1", "1:2:3:4", "nan", "1:inf", "inf", "0:1:1e-9", "1,,2"])
def test_wrong_numbers_are_told_with_the_option(text: str) -> None:
    with pytest.raises(UsageError, match="--eps"):
        parse_numbers(text, name="--eps")


@pytest.mark.parametrize("text", ["0:3", "1.5", "-1"])
def test_counts_are_whole_and_begin_at_one(text: str) -> None:
    with pytest.raises(UsageError, match="whole numbers"):
        parse_counts(text, name="--min-points")


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("k=0.7,0.8", (0.7, 0.8)),
        ("k=4,6", (4, 6)),
        ("k=0:1:0.5", (0.0, 0.5, 1.0)),
        ("k=2:4", (2, 3, 4)),
        ("k=jipda,ipda", ("jipda", "ipda")),
        ('k="a=1,b=2","c"', ("a=1,b=2", "c")),
        ("k=true,false", (True, False)),
        ("k = 1", (1,)),
    ],
)
def test_an_axis_is_a_key_and_values(text: str, values: tuple[Any, ...]) -> None:
    key, found = parse_axis(text)
    assert key == "k"
    assert [(type(v), v) for v in found] == [(type(v), v) for v in values]


@pytest.mark.parametrize("text", ["k", "k=", "=1", "k=1,1", ""])
def test_a_wrong_axis_is_told(text: str) -> None:
    with pytest.raises(UsageError, match="--grid"):
        parse_axis(text)


def test_combinations_are_all_of_them_the_last_key_fastest() -> None:
    found = combinations({"a.x": (1, 2), "a.y": ("u", "v")})
    assert found == [{"a.x": i, "a.y": j} for i in (1, 2) for j in ("u", "v")]
    assert nested(found[1] | {"b": 3}) == {"a": {"x": 1, "y": "v"}, "b": 3}
    with pytest.raises(UsageError, match="combinations"):
        combinations({"a": range(200), "b": range(200)})
