"""Work over processes: the same answers whatever the number of workers."""

from __future__ import annotations

import pytest

from maritrack.fanout import cores, fan_out


def square(x: int) -> int:
    if x < 0:
        raise ValueError(f"{x} is negative")
    return x * x


@pytest.mark.parametrize("workers", [1, 2])
def test_each_item_gets_its_own_answer(workers: int) -> None:
    assert dict(fan_out(square, [3, 1, 2], workers=workers)) == {0: 9, 1: 1, 2: 4}


def test_progress_counts_up_to_all() -> None:
    seen: list[tuple[int, int]] = []
    list(fan_out(square, [1, 2], tick=lambda done, of: seen.append((done, of))))
    assert seen == [(1, 2), (2, 2)]


def test_an_error_reaches_the_caller() -> None:
    with pytest.raises(ValueError, match="-1 is negative"):
        list(fan_out(square, [1, -1], workers=2))


def test_nothing_to_do_is_nothing_done() -> None:
    assert list(fan_out(square, [], workers=2)) == []


def test_there_is_a_core_to_work_on() -> None:
    assert cores() >= 1
