"""Work over processes: the same answers whatever the number of workers."""

from __future__ import annotations

import os

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from maritrack.errors import UsageError
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


def fatal(x: int) -> int:
    """Ends its process for 3, as a crash in a library or the kernel's answer to too much memory would."""
    if x == 3:
        os._exit(9)
    return x * x


def test_a_piece_that_kills_its_process_costs_itself_only() -> None:
    answers = dict(fan_out(fatal, [3, 1, 2, 4, 5, 6], workers=2, lost=lambda x: -x))
    assert answers == {0: -3, 1: 1, 2: 4, 3: 16, 4: 25, 5: 36}


def threads(_: int) -> list[int]:
    np.linalg.inv(np.eye(3))
    return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]


@pytest.mark.parametrize("workers", [1, 2])
def test_linear_algebra_has_one_thread_a_piece(workers: int) -> None:
    with threadpool_limits(2):
        told = dict(fan_out(threads, [0, 1], workers=workers))
    assert all(n == 1 for pools in told.values() for n in pools) and told[0]


def test_a_scheduler_that_is_not_there_is_told_in_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("maritrack.fanout.CONNECT_S", 1)
    for address in ("tcp://127.0.0.1:1", "nonsense", "http://127.0.0.1:1"):
        with pytest.raises(UsageError, match=f"--scheduler {address}: "):
            list(fan_out(square, [1], scheduler=address))
