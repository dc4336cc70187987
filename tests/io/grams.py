"""Datagrams to be written and read back, and streams cut at any place."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from hypothesis import strategies as st

from maritrack.io.containers.writers import Encoder
from maritrack.io.datagrams import NO_TIME, Container, DatagramWriter, Stream
from maritrack.types import Damage
from tests.io.cat240_blocks import block, video

START_NS = 1_700_000_000 * 10**9


class Gram(NamedTuple):
    """A datagram."""

    payload: bytes
    t_ns: int = START_NS
    stream: Stream = Stream("10.0.0.7:5000", "239.0.1.2:8600")


class Read(NamedTuple):
    """All that a reader gave."""

    grams: list[Gram]
    offsets: list[int]
    damage: list[Damage]
    end: int

    @property
    def payloads(self) -> list[bytes]:
        return [gram.payload for gram in self.grams]

    @property
    def codes(self) -> list[str]:
        return [one.code for one in self.damage]


def read(container: Container) -> Read:
    grams: list[Gram] = []
    offsets: list[int] = []
    damage: list[Damage] = []
    end = 0
    for d in container.datagrams():
        assert len(d.bounds) == len(d) + 1
        assert d.bounds[-1] == len(d.data)
        assert d.end >= end
        end = d.end
        for i in range(len(d)):
            payload = d.data[d.bounds[i] : d.bounds[i + 1]]
            grams.append(Gram(payload, int(d.t_ns[i]), container.streams[d.stream[i]]))
        offsets += d.offset.tolist()
        damage += d.damage
    return Read(grams, offsets, damage, end)


def write(writer: Encoder | DatagramWriter, grams: Sequence[Gram]) -> None:
    for gram in grams:
        assert writer.write(gram.payload, t_ns=gram.t_ns, stream=gram.stream)


def videos(n: int, *, size: int = 16) -> list[bytes]:
    """Payloads of one data block each."""
    return [block(video(i, cells=bytes((i * k) % 251 for k in range(size)))) for i in range(n)]


def pieces(data: bytes, sizes: Sequence[int]) -> Iterator[bytes]:
    """The octets cut into pieces of these sizes, over and over."""
    at = i = 0
    while at < len(data):
        size = sizes[i % len(sizes)] if sizes else len(data)
        yield data[at : at + size]
        at, i = at + size, i + 1


STREAMS = (
    Stream("10.0.0.7:5000", "239.0.1.2:8600"), Stream("10.0.0.8:5000", "239.0.1.2:8600"),
    Stream("[fe80::1]:1", "[ff02::5]:65535"), Stream("192.168.1.255:0", "10.1.2.3:4378"),
)  # fmt: skip
cuts = st.lists(st.integers(1, 70_000), max_size=4)
payloads = st.one_of(st.binary(max_size=40), st.sampled_from(videos(5)), st.just(b"\xa5" * 9))
times = st.one_of(st.just(NO_TIME), st.integers(0, (1 << 32) * 10**9 - 1))
gram_lists = st.lists(st.builds(Gram, payloads, times, st.sampled_from(STREAMS)), max_size=25)


def peak_mb() -> int:
    """The most memory that this process ever had. ru_maxrss won't do: it begins at what the parent process had."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) // 1024


def grown_mb(program: str, *arguments: str) -> tuple[int, int]:
    """What a program of its own process printed: two numbers, the latter the MB that its memory grew by."""
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments], cwd=root, capture_output=True, text=True, check=True, timeout=300
    )
    first, grown = map(int, done.stdout.split())
    return first, grown
