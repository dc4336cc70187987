"""Inflate on several cores: worker processes that share memory with this one, and a reader that sets out ahead.

A worker runs `inflate.py` beside this file and nothing else: neither the program of the user nor a large library is
imported. Shared memory has no name, and orders come in through a pipe, so that nothing stays behind however this
process ends; signals of the terminal don't reach the workers. What a worker doesn't do, because it can't be started or
was killed, is done here.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from importlib.util import find_spec
from mmap import mmap
from pathlib import Path
from typing import BinaryIO, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from maritrack.io.cat240 import inflate as program
from maritrack.io.cat240.inflate import DONE, ORDER, inflate
from maritrack.types import IntArray

STREAMS = 4096  # in a job
SOURCE, TARGET = 1 << 20, 2 << 20  # octets that go in and come out; no radial has more
PLACES = 16 * STREAMS
SLOT = PLACES + SOURCE + TARGET
SLOTS = 4  # for each worker, with some 10 ms of work in each
WORTHWHILE = 1 << 17  # octets that come out, from which on workers are asked
AHEAD = 8  # stretches of the input, at most

Inflated = tuple[NDArray[np.uint8], list[int]]  # (m, n), and which of the m failed
T = TypeVar("T")


class Inflater(Protocol):
    """Inflates streams as `maritrack.io.cat240.inflate.inflate` does, at the latest when they are asked for."""

    def start(self, source: bytes, first: IntArray, stop: IntArray, n: int, *, freely: bool) -> Callable[[], Inflated]:
        """Set out for the n octets of each of the streams source[first:stop], whose places rise; call it for them."""

    def has_room(self) -> bool:
        """Whether more can be started before the first is asked for."""


class AtOnce:
    """Inflates here, when it is asked for."""

    def start(self, source: bytes, first: IntArray, stop: IntArray, n: int, *, freely: bool) -> Callable[[], Inflated]:
        return partial(_inflate_here, source, first, stop, n, freely=freely)

    def has_room(self) -> bool:
        return False


def inflater(workers: int) -> AbstractContextManager[Inflater]:
    """What inflates on so many cores; on one: here."""
    return Workers(workers) if workers > 1 else nullcontext(AtOnce())


def ahead(stretches: Iterable[T], inflater: Inflater) -> Iterator[T]:
    """The same stretches, taken as far ahead as the inflater has room for what they start."""
    waiting = deque[T]()
    for one in stretches:
        waiting.append(one)
        while waiting and (len(waiting) > AHEAD or not inflater.has_room()):
            yield waiting.popleft()
    while waiting:
        yield waiting.popleft()


def _inflate_here(source: bytes, first: IntArray, stop: IntArray, n: int, *, freely: bool) -> Inflated:
    out = np.empty((len(first), n), dtype=np.uint8)
    failed = inflate(memoryview(source), first.tolist(), stop.tolist(), out.data.cast("B"), freely=freely)
    return out, failed


@dataclass(slots=True, eq=False)
class _Task:
    """Streams that are wanted together."""

    source: bytes
    first: IntArray  # (m,)
    stop: IntArray  # (m,)
    out: NDArray[np.uint8]  # (m, n)
    freely: bool
    failed: list[int] = field(default_factory=list)
    jobs: int = 0  # that it waits for

    def take(self, begin: int, end: int, inflated: Inflated) -> None:
        self.out[begin:end] = inflated[0]
        self.failed += [begin + i for i in inflated[1]]
        self.jobs -= 1

    def inflate_here(self, begin: int, end: int) -> Inflated:
        n = self.out.shape[1]
        return _inflate_here(self.source, self.first[begin:end], self.stop[begin:end], n, freely=self.freely)


class _Worker:
    """A process that answers orders in their order, until it is dead."""

    def __init__(self, command: list[str], shared: int) -> None:
        self.alive = True
        self.jobs = 0  # that it has not answered
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0, pass_fds=(shared,), process_group=0
        )

    def tell(self, order: bytes) -> None:
        self.jobs += 1
        stdin = self._process.stdin
        try:
            if stdin is not None:
                stdin.write(order)
        except OSError:
            self.alive = False

    def answer(self) -> int | None:
        """How many streams of the next order failed; None = it is dead."""
        self.jobs -= 1
        stdout = self._process.stdout
        answer = stdout.read(DONE.size) if self.alive and stdout is not None else b""
        self.alive = len(answer) == DONE.size
        return int(DONE.unpack(answer)[0]) if self.alive else None

    def end(self) -> None:
        self.alive = False
        self._process.kill()
        with self._process:  # closes the pipes and waits
            pass


class _Job(NamedTuple):
    """A part of a task, in a slot of the shared memory."""

    task: _Task
    begin: int
    end: int
    slot: int
    worker: _Worker


class Workers:
    """Inflates in `n` processes, which start with the first streams that are worth it.

    Memory: 12 MiB for each worker, and what was started and not yet asked for.
    """

    def __init__(self, n: int) -> None:
        self._n = n
        self._tried = False
        self._workers: list[_Worker] = []
        self._slots = np.zeros((0, SLOT), dtype=np.uint8)  # the shared memory: places, source and target
        self._free: list[int] = []  # slots
        self._jobs = deque[_Job]()  # not yet answered, in the order in which they were started

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(self, source: bytes, first: IntArray, stop: IntArray, n: int, *, freely: bool) -> Callable[[], Inflated]:
        if n * len(first) < WORTHWHILE or n > TARGET or not self._are_there():
            return partial(_inflate_here, source, first, stop, n, freely=freely)
        task = _Task(source, first, stop, np.empty((len(first), n), dtype=np.uint8), freely)
        for begin, end in _cuts(first, stop, n):
            if not self._free:
                self._settle()
            self._submit(task, begin, end)
        return partial(self._finish, task)

    def has_room(self) -> bool:
        return len(self._free) > 0

    def close(self) -> None:
        """End the processes, whatever they are at."""
        for worker in self._workers:
            worker.end()
        self._workers, self._free, self._slots = [], [], self._slots[:0].copy()
        self._jobs.clear()

    def _are_there(self) -> bool:
        """Whether a worker lives; the first time they are started."""
        if not self._tried:
            self._tried = True
            try:
                self._launch()
            except OSError:  # neither memory nor processes to be had: then without
                self.close()
        return any(worker.alive for worker in self._workers)

    def _launch(self) -> None:
        if sys.platform == "win32" or not sys.executable:
            return
        size = self._n * SLOTS * SLOT
        with _nameless_file() as file:
            file.truncate(size)
            self._slots = np.frombuffer(mmap(file.fileno(), size), dtype=np.uint8).reshape(-1, SLOT)
            command = [sys.executable, "-I", "-S", program.__file__, str(file.fileno()), str(size), *_folders()]
            for _ in range(self._n):
                self._workers.append(_Worker(command, file.fileno()))
        self._free = list(range(len(self._slots)))

    def _submit(self, task: _Task, begin: int, end: int) -> None:
        """Put a part of a task into a free slot and tell the worker that has least to do."""
        slot, streams, n = self._free.pop(), end - begin, task.out.shape[1]
        octets = np.frombuffer(task.source, dtype=np.uint8)[task.first[begin] : task.stop[end - 1]]
        places, source, _ = _parts(self._slots[slot])
        places[:streams] = task.first[begin:end] - task.first[begin]
        places[streams : 2 * streams] = task.stop[begin:end] - task.first[begin]
        source[: len(octets)] = octets
        worker = min(self._workers, key=lambda one: (not one.alive, one.jobs))
        at = slot * SLOT
        worker.tell(ORDER.pack(at, at + PLACES, len(octets), at + PLACES + SOURCE, streams, n, task.freely))
        self._jobs.append(_Job(task, begin, end, slot, worker))
        task.jobs += 1

    def _settle(self) -> None:
        """Wait for the answer to the first job and take it over."""
        job = self._jobs.popleft()
        task, n = job.task, job.task.out.shape[1]
        failed = job.worker.answer()
        if failed is None:
            task.take(job.begin, job.end, task.inflate_here(job.begin, job.end))
        else:
            places, _, target = _parts(self._slots[job.slot])
            out = target[: (job.end - job.begin) * n].reshape(-1, n)
            task.take(job.begin, job.end, (out, places[:failed].tolist()))
        self._free.append(job.slot)

    def _finish(self, task: _Task) -> Inflated:
        while task.jobs:
            self._settle()
        return task.out, task.failed


def _parts(slot: NDArray[np.uint8]) -> tuple[IntArray, NDArray[np.uint8], NDArray[np.uint8]]:
    """Places, source and target."""
    return slot[:PLACES].view(np.int64), slot[PLACES : PLACES + SOURCE], slot[PLACES + SOURCE :]


def _cuts(first: IntArray, stop: IntArray, n: int) -> Iterator[tuple[int, int]]:
    """Parts of streams that fit into a job."""
    begin, most = 0, min(STREAMS, TARGET // n)
    while begin < len(first):
        end = int(np.searchsorted(stop, first[begin] + SOURCE, side="right"))
        end = min(end, begin + most)
        yield begin, end
        begin = end


def _folders() -> list[str]:
    """Where libdeflate is found, if it is used."""
    found = find_spec("deflate") if program.LIBDEFLATE else None
    return [str(Path(found.origin).parents[1])] if found is not None and found.origin is not None else []


def _nameless_file() -> BinaryIO:
    """A file of which nothing stays behind, in memory where that can be had."""
    if sys.platform == "linux":
        return os.fdopen(os.memfd_create("maritrack"), "w+b")
    return tempfile.TemporaryFile()
