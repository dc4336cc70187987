"""Many independent pieces of work: what studies, Monte Carlo runs, sweeps and campaigns share.

In this process, over processes (joblib), or over a cluster (distributed). Results do not depend on which, nor on the
number of workers: a piece of work knows its own seed, nothing else is shared, and each has one thread of linear
algebra.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from itertools import islice
from typing import Any, TypeVar

from maritrack.errors import UsageError

Item = TypeVar("Item")
Answer = TypeVar("Answer")
Tick = Callable[[int, int], None]  # pieces done, of how many
Lost = Callable[[Item], Answer]  # the answer for a piece that ends its process
ON = "what is finished stays: the same command goes on where it was"
CONNECT_S = 20  # to wait for a scheduler
AHEAD = 4  # pieces that a thread of a cluster has waiting: neither idle, nor all of a sweep in the scheduler's memory


def fan_out(
    work: Callable[[Item], Answer],
    items: Sequence[Item],
    *,
    workers: int = 1,
    scheduler: str = "",
    tick: Tick | None = None,
    lost: Lost[Item, Answer] | None = None,
) -> Iterator[tuple[int, Answer]]:
    """Number and answer of each item, as they come; with one worker in this process and in order.

    `work` must be a function of a module, or a partial of one. With a `scheduler` ("tcp://host:8786") the workers are
    those of its cluster; pieces of workers that die are given to others. A piece that kills its process again and
    again gets the answer `lost`; without that, it is an error.
    """
    if scheduler and items:
        answers = _over_cluster(work, items, scheduler, lost)
    elif workers <= 1 or len(items) <= (lost is None):
        answers = (_one(work, i, item) for i, item in enumerate(items))
    else:
        answers = _over_processes(work, items, workers, lost)
    for done, answer in enumerate(answers, 1):
        if tick is not None:
            tick(done, len(items))
        yield answer


def cores() -> int:
    """Cores that this process may use, limits of its container included."""
    from joblib import cpu_count

    return int(cpu_count())


def _one(work: Callable[[Item], Answer], number: int, item: Item) -> tuple[int, Answer]:
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):  # sums of linear algebra depend on how many threads share them
        return number, work(item)


def _over_processes(
    work: Callable[[Item], Answer], items: Sequence[Item], workers: int, lost: Lost[Item, Answer] | None
) -> Iterator[tuple[int, Answer]]:
    """Pieces over processes. When one dies all of the pool do: what is left goes to a new pool.

    Where not one piece comes through before that, those which began are tried alone, and who kills its process is told.
    """
    left = list(range(len(items)))
    while left:
        done: set[int] = set()
        try:
            for answer in _pool(work, items, left, workers):
                done.add(answer[0])
                yield answer
        except BrokenProcessPool:
            if lost is None:
                raise
        left = [i for i in left if i not in done]
        if left and not done and lost is not None:
            suspects, left = left[: 2 * workers], left[2 * workers :]
            for i in suspects:
                try:
                    yield from _pool(work, items, [i], 2)
                except BrokenProcessPool:
                    yield i, lost(items[i])


def _pool(
    work: Callable[[Item], Answer], items: Sequence[Item], numbers: Sequence[int], workers: int
) -> Iterable[tuple[int, Answer]]:
    from joblib import Parallel, delayed

    pool = Parallel(n_jobs=workers, return_as="generator_unordered", inner_max_num_threads=1)
    answers: Iterable[tuple[int, Answer]] = pool(delayed(_one)(work, i, items[i]) for i in numbers)
    return answers


def _over_cluster(
    work: Callable[[Item], Answer], items: Sequence[Item], scheduler: str, lost: Lost[Item, Answer] | None
) -> Iterator[tuple[int, Answer]]:
    """Pieces over the workers of a cluster. Only items and answers pass through this process."""
    try:
        from distributed import Client, KilledWorker, as_completed
        from distributed.comm import resolve_address
    except ImportError:
        raise UsageError("--scheduler needs distributed", hint="pip install 'maritrack[dask]'") from None
    try:
        resolve_address(scheduler)  # a client that is given nonsense waits for a minute before it ends
        client: Any = Client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise UsageError(f"--scheduler {scheduler}: {error}", hint="as in tcp://127.0.0.1:8786") from None
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # what it has to say is told below
    with client:
        number: dict[str, int] = {}
        send = partial(_send, client, work, number)
        waiting = iter(enumerate(items))
        ahead = AHEAD * max(sum(client.nthreads().values()), 1)
        pending = as_completed([send(*item) for item in islice(waiting, ahead)], loop=client.loop)
        suspects: list[int] = []  # of a worker that dies, those that waited there are accused with the one that ran
        for future in pending:
            i = number.pop(future.key)
            for item in islice(waiting, 1):
                pending.add(send(*item))
            try:
                answer = _answer(future, scheduler)
            except KilledWorker:
                if lost is None:
                    raise
                suspects.append(i)
            else:
                yield answer
        for i in suspects:  # each alone: now it is told who kills its worker
            try:
                yield _answer(send(i, items[i]), scheduler)
            except KilledWorker:
                if lost is None:
                    raise
                yield i, lost(items[i])


def _answer(future: Any, scheduler: str) -> Any:
    """The answer of a cluster, which may forget it then. UsageError where the cluster is gone."""
    from distributed import CancelledError

    try:
        return future.result()
    except CancelledError:  # by nobody here
        raise UsageError(f"--scheduler {scheduler}: the connection to it was lost", hint=ON) from None
    finally:
        future.release()


def _send(client: Any, work: Callable[[Item], Answer], number: dict[str, int], i: int, item: Item) -> Any:
    future = client.submit(_one, work, i, item, pure=False)
    number[future.key] = i
    return future
