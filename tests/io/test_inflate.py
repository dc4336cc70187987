"""Streams inflate to the same octets and fail the same, with libdeflate and without it, freely and bounded."""

from __future__ import annotations

import ast
import sys
import tracemalloc
import zlib
from collections.abc import Iterator
from itertools import accumulate
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.io.cat240 import inflate as module
from maritrack.io.cat240.inflate import inflate
from tests.io.cat240_blocks import block, damage, packed_video, read, rows, video
from tests.io.test_cat240_equal import damaged_recording

WAYS = [False, True] if module.LIBDEFLATE else [False]
MARK = 0xA5
EASY = settings(derandomize=True, deadline=None, max_examples=200)


@pytest.fixture(params=WAYS, ids=["zlib", "libdeflate"][: len(WAYS)])
def _way(request: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(module, "LIBDEFLATE", request.param)
    yield


def inflated(streams: list[bytes], n: int, *, freely: bool) -> tuple[list[bytes], list[int]]:
    """What comes out of streams that lie one behind the other, with a foreign octet between them."""
    stop = list(accumulate(len(stream) + 1 for stream in streams))
    first = [end - len(stream) - 1 for end, stream in zip(stop, streams, strict=True)]
    target = bytearray([MARK]) * (n * len(streams))
    source = memoryview(b"".join(stream + b"\x78" for stream in streams))
    failed = inflate(source, first, [end - 1 for end in stop], memoryview(target), freely=freely)
    return [bytes(target[i * n : i * n + n]) for i in range(len(streams))], failed


def expected(stream: bytes, n: int) -> bytes | None:
    """By zlib alone, one stream at a time: its n octets, None where it has to fail."""
    found = zlib.decompressobj()
    try:
        octets = found.decompress(stream, n + 1)
    except zlib.error:
        return None
    return octets if found.eof and len(octets) == n else None


@st.composite
def a_stream(draw: st.DrawFn, n: int) -> bytes:
    """A stream of n octets, or one with something wrong."""
    octets = draw(st.binary(min_size=n, max_size=n))
    level, window = draw(st.sampled_from([0, 1, 6, 9])), draw(st.sampled_from([9, 15]))
    if draw(st.booleans()):
        octets = octets[:1] * n
    more = {"long": octets + b"\0", "short": octets[:-1], "bomb": octets + bytes(300_000)}
    kind = draw(st.sampled_from(["good", "good", "good", "cut", "trailing", "changed", "bare", "empty", *more]))
    packer = zlib.compressobj(level, wbits=-15 if kind == "bare" else window)
    stream = packer.compress(more.get(kind, octets)) + packer.flush()
    if kind == "cut":
        return stream[: draw(st.integers(0, len(stream) - 1))]
    if kind == "changed":
        at = draw(st.integers(0, len(stream) - 1))
        return stream[:at] + bytes((stream[at] ^ draw(st.integers(1, 255)),)) + stream[at + 1 :]
    return {"trailing": stream + b"xyz", "empty": b""}.get(kind, stream)


@given(st.integers(1, 40).flatmap(lambda n: st.tuples(st.just(n), st.lists(a_stream(n), max_size=8))), st.booleans())
@EASY
def test_streams_give_what_zlib_gives_one_by_one(made: tuple[int, list[bytes]], freely: bool) -> None:
    n, streams = made
    wanted = [expected(stream, n) for stream in streams]
    for way in WAYS:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(module, "LIBDEFLATE", way)
            found, failed = inflated(streams, n, freely=freely)
        assert failed == [i for i, octets in enumerate(wanted) if octets is None]
        assert [found[i] for i in range(len(found)) if i not in failed] == [one for one in wanted if one is not None]


@pytest.mark.usefixtures("_way")
@pytest.mark.parametrize("freely", [False, True])
def test_one_bad_stream_costs_no_other(freely: bool) -> None:
    cells = [bytes([i]) * 1000 for i in range(100)]
    streams = [zlib.compress(one) for one in cells]
    for i in (0, 40, 41, 99):
        streams[i] = streams[i][:-1] + bytes([streams[i][-1] ^ 1])
    found, failed = inflated(streams, 1000, freely=freely)
    assert failed == [0, 40, 41, 99]
    assert [found[i] for i in range(100) if i not in failed] == [cells[i] for i in range(100) if i not in failed]


@pytest.mark.usefixtures("_way")
def test_bombs_take_little_memory() -> None:
    bombs = [zlib.compress(bytes(50_000_000))] * 20
    tracemalloc.start()
    _, failed = inflated(bombs, 16, freely=False)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert failed == list(range(20))
    assert peak < 3 * sum(map(len, bombs)) + 100_000


def test_only_the_first_stream_that_fails_may_grow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LIBDEFLATE", False)
    bombs = [zlib.compress(bytes(10_000_000))] * 20
    tracemalloc.start()
    _, failed = inflated(bombs, 16, freely=True)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert failed == list(range(20))
    assert peak < 25_000_000


@pytest.mark.skipif(len(WAYS) < 2, reason="the wheel `deflate` is not installed")
@pytest.mark.parametrize("seed", range(2))
def test_a_damaged_recording_reads_the_same_without_libdeflate(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    bombs = b"".join(block(packed_video(i, bytes(100_000), nbcells=400)) for i in range(20))
    short = b"".join(block(packed_video(i, bytes(300), nbcells=400)) + block(video(i + 50)) for i in range(20))
    octets = bombs + damaged_recording(seed, size=400_000) + short
    fast = read(octets)
    monkeypatch.setattr(module, "LIBDEFLATE", False)
    exact = read(octets)
    assert rows(fast) == rows(exact)
    assert damage(fast) == damage(exact)
    assert {"zlib-error", "inflates-beyond-declared", "cells-short"} <= {one[0] for one in damage(exact)}


def test_the_program_of_the_workers_imports_the_standard_library_and_libdeflate_alone() -> None:
    tree = ast.parse(Path(module.__file__).read_text())
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
    names = {name for node in imports for name in _names(node)}
    assert names - set(sys.stdlib_module_names) == {"deflate"}


def _names(node: ast.Import | ast.ImportFrom) -> list[str]:
    if isinstance(node, ast.ImportFrom):
        return [(node.module or "").split(".")[0]]
    return [alias.name.split(".")[0] for alias in node.names]
