"""Many independent pieces of work over processes: what studies, Monte Carlo runs and sweeps share.

Results do not depend on the number of workers: a piece of work knows its own seed, and nothing else is shared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

Item = TypeVar("Item")
Answer = TypeVar("Answer")
Tick = Callable[[int, int], None]  # pieces done, of how many


def fan_out(
    work: Callable[[Item], Answer], items: Sequence[Item], *, workers: int = 1, tick: Tick | None = None
) -> Iterator[tuple[int, Answer]]:
    """Number and answer of each item, as they come; with one worker in this process and in order.

    `work` must be a function of a module, or a partial of one. Each process uses one thread of linear algebra.
    """
    if workers <= 1 or len(items) <= 1:
        answers: Iterator[tuple[int, Answer]] = (_one(work, i, item) for i, item in enumerate(items))
    else:
        from joblib import Parallel, delayed

        pool = Parallel(n_jobs=min(workers, len(items)), return_as="generator_unordered", inner_max_num_threads=1)
        answers = pool(delayed(_one)(work, i, item) for i, item in enumerate(items))
    for done, answer in enumerate(answers, 1):
        if tick is not None:
            tick(done, len(items))
        yield answer


def cores() -> int:
    """Cores that this process may use, limits of its container included."""
    from joblib import cpu_count

    return int(cpu_count())


def _one(work: Callable[[Item], Answer], number: int, item: Item) -> tuple[int, Answer]:
    return number, work(item)
