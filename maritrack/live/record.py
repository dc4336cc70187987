"""Receive radar video and write it into a container until told to stop."""

from __future__ import annotations

import math
import socket
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from maritrack.io.cat240.framing import CAT240
from maritrack.io.containers.select import is_blocks
from maritrack.io.datagrams import NO_TIME, DatagramWriter, Stream
from maritrack.live.batches import Batch, Key
from maritrack.live.heads import read_head, sensor_name
from maritrack.live.receiver import Receiver
from maritrack.live.sockets import dropped

FLUSH_S = 1.0
WAIT_S = 0.1
SWITCH_S = 0.0005  # how long the writing may keep the receiver from its next call
MANY_KEYS = 4096
CAT240_FIRST = bytes((CAT240,))
MANY_STREAMS = 256  # that the summary tells apart
DURATION, SIZE, STOPPED = "duration", "size", "stopped"


@dataclass(slots=True)
class Tally:
    """What was received so far."""

    datagrams: int = 0  # written
    octets: int = 0  # of their payloads
    lost: int | None = None  # dropped by the kernel; None = it doesn't tell
    unfit: int = 0  # not written: the container can't hold them
    other: int = 0  # written, without CAT240
    waiting: int = 0  # octets of memory not yet written
    first_ns: int = NO_TIME  # receive times
    last_ns: int = NO_TIME
    ended: str = ""  # why
    seconds: float = 0.0
    sensors: dict[str, int] = field(default_factory=dict)  # datagrams by SAC-SIC of the first record
    streams: dict[Stream, int] = field(default_factory=dict)  # datagrams


def record(
    sock: socket.socket,
    writer: DatagramWriter,
    tally: Tally,
    *,
    stopped: Callable[[], bool],
    duration_s: float | None = None,
    max_octets: int | None = None,
    blocks_only: bool = False,
    ready: Callable[[], None] = lambda: None,
    tick: Callable[[Tally], None] = lambda _: None,
    clock: Callable[[], float] = time.monotonic,
) -> None:
    """Write what comes to the socket until `stopped`, or for a time, or up to so many octets of payload.

    `blocks_only` for a raw recording, in which anything else than data blocks would hide those beside it. `ready`
    is called once it listens, `tick` some times a second or more. The writer stays open. OSError where the network
    fails, InputError where the disk does; the tally tells how far it came.
    """
    into = _Into(writer, tally, max_octets=max_octets, blocks_only=blocks_only)
    begun = flushed = clock()
    with _quick_switches(), Receiver(sock).running() as receiver:
        ready()
        for batch in receiver.batches(WAIT_S):
            if batch is not None and not into.write(batch):
                tally.ended = SIZE
                break
            now = clock()
            tally.seconds, tally.lost, tally.waiting = now - begun, dropped(sock), receiver.waiting
            if not tally.ended and (stopped() or (duration_s is not None and now - begun >= duration_s)):
                tally.ended = STOPPED if stopped() else DURATION
                receiver.end()
            if now - flushed >= FLUSH_S:
                writer.flush()
                flushed = now
            tick(tally)
    tally.lost = dropped(sock)


class _Into:
    """Writes batches, and counts."""

    def __init__(self, writer: DatagramWriter, tally: Tally, *, max_octets: int | None, blocks_only: bool) -> None:
        self._writer, self._tally, self._blocks_only = writer, tally, blocks_only
        self._room: float = math.inf if max_octets is None else max_octets
        self._streams: dict[Key, Stream] = {}
        self._sensors: dict[bytes, str] = {}  # by what a payload begins with

    def write(self, batch: Batch) -> bool:
        """False where the next datagram would be too much."""
        if len(self._streams) > MANY_KEYS:
            self._streams.clear()
        payloads: list[bytes] = []  # of those written
        keys: list[Key] = []
        times: list[int] = []
        full, write, streams, plain = False, self._writer.write, self._streams, not self._blocks_only
        for payload, (t_ns, key) in zip(batch.payloads, batch.notes(), strict=True):
            if full := len(payload) > self._room:
                break
            stream = streams.get(key) or streams.setdefault(key, batch.stream(key))
            if (plain or is_blocks(payload)) and write(payload, t_ns=t_ns, stream=stream):
                self._room -= len(payload)
                payloads.append(payload)
                keys.append(key)
                times.append(t_ns)
            else:
                self._tally.unfit += 1
        if payloads:
            self._count(payloads, keys, times)
        return not full

    def _count(self, payloads: list[bytes], keys: list[Key], times: list[int]) -> None:
        tally = self._tally
        tally.datagrams += len(payloads)
        tally.octets += sum(map(len, payloads))
        tally.first_ns = times[0] if tally.first_ns == NO_TIME else tally.first_ns
        tally.last_ns = times[-1]
        for key, n in Counter(keys).items():
            stream = self._streams[key]
            if stream not in tally.streams and len(tally.streams) >= MANY_STREAMS:
                stream = Stream("others", "")
            tally.streams[stream] = tally.streams.get(stream, 0) + n
        for name, n in self._names(payloads).items():
            tally.sensors[name] = tally.sensors.get(name, 0) + n
        tally.other += tally.sensors.pop("", 0)

    def _names(self, payloads: list[bytes]) -> dict[str, int]:
        """Datagrams by the sensor of their first CAT240 record, "" where they have none."""
        if len(self._sensors) > MANY_KEYS:
            self._sensors.clear()
        heads = [payload[3:8] if payload[:1] == CAT240_FIRST else payload for payload in payloads]
        counts: dict[str, int] = {}
        for head, n in Counter(heads).items():
            name = self._sensors.get(head)
            if name is None:
                payload = payloads[heads.index(head)]
                sensor = read_head(payload, 0, len(payload)).sensor
                name = sensor_name(sensor) if sensor >= 0 else ""
                if head is not payload:
                    self._sensors[head] = name
            counts[name] = counts.get(name, 0) + n
        return counts


@contextmanager
def _quick_switches() -> Iterator[None]:
    """The receiver needn't wait for long when it has the next call to make."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before)
