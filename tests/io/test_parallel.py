"""Several processes inflate what one does, in the same order, in bounded memory, and nothing of them stays behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import zlib
from collections.abc import Generator, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from maritrack.errors import InputError
from maritrack.io.cat240 import inflate, parallel
from maritrack.io.cat240.encode import encode_video
from maritrack.io.cat240.parallel import AtOnce, Workers
from maritrack.io.cat240.radials import Batch
from maritrack.io.cat240.reader import read_batches
from tests.io.cat240_blocks import COLUMNS, block, damage, packed_video, video
from tests.io.test_cat240_equal import damaged_recording

LINUX = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes are looked for in /proc")
ROOT = Path(__file__).resolve().parents[2]
PROGRAM = """
import os
from itertools import count, takewhile
from maritrack.io.cat240.reader import read_batches
from tests.io.test_parallel import children, recording
parent = os.getppid()
endless = (recording(2000, seed=k) for k in takewhile(lambda _: os.getppid() == parent, count()))
batches = read_batches(endless, workers=2)
next(batches)
print(*children(), flush=True)
for _ in batches:
    pass
"""


@cache
def radials_of_all_kinds(compress: bool) -> list[bytes]:
    cells = np.random.default_rng(0).integers(0, 9, (40, 600), dtype=np.uint8)
    return [
        encode_video(
            sac=1, sic=2, idx=0, start_az=i * 16, end_az=i * 16 + 16, start_rg=0, cell_dur=66_712_819, cells=cells[i],
            compress=compress, tod=500,
        )
        for i in range(40)
    ]  # fmt: skip


def recording(messages: int, *, seed: int = 0, compress: bool = True) -> bytes:
    """Radials of 600 cells; their MSG_INDEX goes on from seed to seed."""
    blocks = radials_of_all_kinds(compress)
    first = seed * messages
    return b"".join(blocks[i % 40][:8] + (first + i).to_bytes(4, "big") + blocks[i % 40][12:] for i in range(messages))


def children() -> list[int]:
    """Processes that this one has started and that live."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            state = _state(int(entry.name))
            if state is not None and state[1] == os.getpid() and state[0] != "Z":
                found.append(int(entry.name))
    return found


def _state(pid: int) -> tuple[str, int] | None:
    """State and parent of a process."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return fields[0], int(fields[1])


def all_end(pids: list[int], *, within_s: float = 120.0) -> bool:
    deadline = time.monotonic() + within_s
    while any((_state(pid) or ("Z",))[0] != "Z" for pid in pids):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


def same(one: list[Batch], other: list[Batch]) -> bool:
    """Whether batches are equal, also in how they are cut."""
    for left, right in zip(one, other, strict=True):
        assert (left.start, left.octets, left.damage) == (right.start, right.octets, right.damage)
        assert (left.radials is None) == (right.radials is None)
        if left.radials is not None and right.radials is not None:
            for name in (*COLUMNS, "bits", "cells"):
                np.testing.assert_array_equal(getattr(left.radials, name), getattr(right.radials, name))
    return True


def reading(messages: int) -> Generator[Batch, None, None]:
    """A long recording, read with two workers up to the first batch."""
    batches = read_batches((recording(2000, seed=k) for k in range(messages // 2000)), workers=2)
    assert isinstance(batches, Generator)
    next(batches)
    return batches


@pytest.mark.parametrize("workers", [2, 3])
def test_several_processes_read_what_one_does(workers: int) -> None:
    chunks = [recording(2500, seed=k) for k in range(5)]
    assert same(list(read_batches(chunks)), list(read_batches(chunks, workers=workers)))


@pytest.mark.parametrize("seed", range(2))
def test_damage_is_told_the_same(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "WORTHWHILE", 1)
    bombs = b"".join(block(packed_video(i, bytes(100_000), nbcells=400)) for i in range(20))
    wide = b"".join(block(packed_video(i, bytes(500_000 - i))) for i in range(3))
    mixed = b"".join(block(packed_video(i, bytes(i % 7 * 50))) + block(video(i + 50)) for i in range(200))
    octets = bombs + damaged_recording(seed, size=600_000) + wide + mixed
    one, other = list(read_batches([octets])), list(read_batches([octets], workers=2))
    assert same(one, other)
    assert {"zlib-error", "inflates-beyond-declared"} <= {code for code, *_ in damage(one)}


@pytest.mark.parametrize(("n", "count"), [(50_000, 64), (1, 1000), (parallel.TARGET, 3)])
def test_streams_larger_and_more_than_a_job_holds(n: int, count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "STREAMS", 100)
    monkeypatch.setattr(parallel, "WORTHWHILE", 1)
    rng = np.random.default_rng(0)
    streams = [zlib.compress(rng.bytes(min(n, 30_000)) + bytes(max(0, n - 30_000)), 1) for _ in range(count)]
    stop = np.cumsum([len(stream) for stream in streams])
    first, source = stop - [len(stream) for stream in streams], b"".join(streams)
    with Workers(2) as workers:
        found, failed = workers.start(source, first, stop, n, freely=True)()
    wanted, _ = AtOnce().start(source, first, stop, n, freely=True)()
    assert failed == []
    np.testing.assert_array_equal(found, wanted)


def test_what_was_started_first_may_be_asked_for_last() -> None:
    streams = [zlib.compress(bytes([i]) * 5000) for i in range(200)]
    stop = np.cumsum([len(stream) for stream in streams])
    first, source = stop - [len(stream) for stream in streams], b"".join(streams)
    with Workers(2) as workers:
        started = [workers.start(source, first[k:], stop[k:], 5000, freely=True) for k in range(0, 150, 10)]
        for k, finish in reversed(list(zip(range(0, 150, 10), started, strict=True))):
            assert finish()[0][:, 0].tolist() == list(range(k, 200))


def test_reading_ahead_is_bounded() -> None:
    given = 0

    def chunks() -> Iterator[bytes]:
        nonlocal given
        one = recording(2000)
        for _ in range(80):
            given += len(one)
            yield one

    ahead = [given - batch.end for batch in read_batches(chunks(), workers=2)]
    assert given > 35_000_000
    assert max(ahead) < 2 * 4 * parallel.SOURCE + (8 << 20)


@LINUX
def test_processes_start_only_for_streams_worth_it() -> None:
    for octets in (recording(3000, compress=False), recording(50)):
        batches = read_batches([octets], workers=2)
        next(batches)
        assert children() == []


@LINUX
def test_workers_import_no_large_library() -> None:
    batches = reading(40_000)
    maps = [Path(f"/proc/{pid}/maps").read_text() for pid in children()]
    batches.close()
    assert len(maps) == 2
    assert not any("numpy" in one for one in maps)


@LINUX
def test_no_process_outlives_a_reading_that_ends() -> None:
    for _ in read_batches((recording(2000, seed=k) for k in range(4)), workers=2):
        pass
    assert children() == []


@LINUX
def test_no_process_outlives_a_reading_that_is_given_up() -> None:
    batches = reading(40_000)
    assert len(children()) == 2
    batches.close()
    assert children() == []


@LINUX
def test_no_process_outlives_an_error() -> None:
    def chunks() -> Iterator[bytes]:
        yield from (recording(2000, seed=k) for k in range(4))
        raise InputError("the disk is gone")

    with pytest.raises(InputError, match="disk"):
        list(read_batches(chunks(), workers=2))
    assert children() == []
    damaged = [recording(4000), recording(4000, seed=1)[1:]]
    with pytest.raises(InputError, match="at byte"):
        list(read_batches(damaged, workers=2, strict=True))
    assert children() == []


@LINUX
@pytest.mark.parametrize("killed", [1, 2])
def test_what_killed_workers_leave_is_done_here(killed: int) -> None:
    chunks = [recording(2500, seed=k) for k in range(12)]
    batches = read_batches(chunks, workers=2)
    found = [next(batches)]
    for pid in children()[:killed]:
        os.kill(pid, signal.SIGKILL)
    found += batches
    assert same(list(read_batches(chunks)), found)
    assert children() == []


def test_without_processes_all_is_done_here(monkeypatch: pytest.MonkeyPatch) -> None:
    chunks = [recording(2500, seed=k) for k in range(3)]
    wanted = list(read_batches(chunks))
    for program in ("/nonexistent/python", "", sys.executable):
        monkeypatch.setattr(sys, "executable", program)
        monkeypatch.setattr(inflate, "__file__", "/nonexistent/inflate.py")
        assert same(wanted, list(read_batches(chunks, workers=2)))


def start(**how: Any) -> tuple[subprocess.Popen[str], list[int]]:
    """A process that reads with two workers, and these."""
    run = subprocess.Popen(
        [sys.executable, "-c", PROGRAM], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **how
    )
    assert run.stdout is not None
    pids = [int(word) for word in run.stdout.readline().split()]
    assert len(pids) == 2
    return run, pids


@LINUX
def test_an_interrupt_of_the_terminal_ends_all_with_one_message() -> None:
    run, pids = start(process_group=0)
    os.killpg(run.pid, signal.SIGINT)
    _, errors = run.communicate(timeout=300)
    assert run.returncode != 0
    assert errors.count("Traceback") == errors.count("KeyboardInterrupt") == 1
    assert all_end(pids)


@LINUX
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_no_worker_outlives_a_process_that_is_killed(how: signal.Signals) -> None:
    run, pids = start()
    run.send_signal(how)
    _, errors = run.communicate(timeout=300)
    assert all_end(pids)
    assert errors == ""


@LINUX
def test_shared_memory_has_no_name() -> None:
    before = set(os.listdir("/dev/shm"))
    batches = reading(40_000)
    assert set(os.listdir("/dev/shm")) <= before
    batches.close()
