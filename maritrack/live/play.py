"""Send the datagrams of a recording at the pace at which they came."""

from __future__ import annotations

import errno
import socket
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from maritrack.io.datagrams import Datagrams
from maritrack.live.pace import Pace
from maritrack.live.sockets import UDP_MOST, SocketAddress
from maritrack.types import Damage

SLICE_NS = 100_000_000  # of a pause, after which one looks again
LATE_NS = 1_000_000_000  # what is later isn't made up for: the computer slept, or is too slow
LOOK_NS = 10_000_000  # of a pause, in which there is time to look
BETWEEN_LOOKS = 64  # datagrams
PART = 1024  # datagrams whose times are looked at in one go, so that the sending never waits for long
FULL = (errno.ENOBUFS, errno.EAGAIN)
FULL_REST_S = 0.001
FULL_TRIES = 2000


class Clock(NamedTuple):
    """What tells the time and what lets it pass."""

    now_ns: Callable[[], int] = time.monotonic_ns
    sleep_s: Callable[[float], None] = time.sleep


@dataclass(slots=True)
class Sent:
    """What was sent so far."""

    datagrams: int = 0
    octets: int = 0
    too_large: int = 0  # for a UDP datagram, and left out
    waited: int = 0  # times that the system had no room
    lag_ns: int = 0  # behind schedule, of the last datagram
    most_lag_ns: int = 0
    slipped_ns: int = 0  # by which the schedule was put off because it was missed
    recorded_ns: int = 0  # of the recording
    seconds: float = 0.0
    passes: int = 0  # whole ones
    damage: dict[str, int] = field(default_factory=dict)  # of the recording, by code


class Player:
    """Sends datagrams one after the other, each when it is due.

    The schedule is absolute: what is late is made up for, so that nothing drifts. `speed` 0 sends as fast as it can.
    """

    def __init__(
        self,
        sock: socket.socket,
        to: SocketAddress,
        pace: Pace,
        *,
        speed: float,
        stopped: Callable[[], bool],
        tick: Callable[[Sent], None] = lambda _: None,
        clock: Clock = Clock(),  # noqa: B008 (a constant)
    ) -> None:
        self.sent = Sent()
        self._sock, self._to, self._pace, self._speed = sock, to, pace, speed
        self._stopped, self._tick, self._clock = stopped, tick, clock
        self._most = UDP_MOST[sock.family]
        self._begun_ns: int | None = None  # when the first datagram was sent
        self._start_ns = 0  # the same, put off by what was missed

    def play(self, found: Iterable[Datagrams]) -> bool:
        """Send all of them. False where it was stopped."""
        for d in found:
            for one in d.damage:
                self.note(one)
            if not all(self._play(part) for part in _parts(d)):
                return False
        self.sent.passes += 1
        return True

    def note(self, damage: Damage) -> None:
        """Count what was wrong with the recording."""
        self.sent.damage[damage.code] = self.sent.damage.get(damage.code, 0) + damage.count

    def _play(self, d: Datagrams) -> bool:
        due = self._pace.due(d).tolist() if self._speed else [0] * len(d)
        if self._begun_ns is None:
            self._begun_ns = self._start_ns = self._clock.now_ns()
        view, bounds, sent = memoryview(d.data), d.bounds.tolist(), self.sent
        for i, at_ns in enumerate(due):
            if not self._wait(at_ns) or (i % BETWEEN_LOOKS == 0 and self._look()):
                return False
            self._send(view[bounds[i] : bounds[i + 1]])
            sent.recorded_ns = at_ns
        self._look()
        return True

    def _wait(self, at_ns: int) -> bool:
        """Until a time of the recording is due. False where it was stopped meanwhile."""
        if not self._speed:
            return True
        due = self._start_ns + int(at_ns / self._speed)
        while (left := due - self._clock.now_ns()) > 0:
            if left > LOOK_NS and self._look():
                return False
            self._clock.sleep_s(min(left, SLICE_NS) / 1e9)
        self.sent.lag_ns = -left
        self.sent.most_lag_ns = max(self.sent.most_lag_ns, -left)
        if -left > LATE_NS:
            self._start_ns -= left
            self.sent.slipped_ns -= left
        return True

    def _look(self) -> bool:
        """Tell how far it is; whether to stop."""
        assert self._begun_ns is not None
        self.sent.seconds = (self._clock.now_ns() - self._begun_ns) / 1e9
        self._tick(self.sent)
        return self._stopped()

    def _send(self, payload: memoryview) -> None:
        if len(payload) > self._most:
            self.sent.too_large += 1
            return
        for _ in range(FULL_TRIES):
            try:
                self._sock.sendto(payload, self._to)
            except OSError as error:
                if error.errno == errno.EMSGSIZE:
                    self.sent.too_large += 1
                    return
                if error.errno not in FULL:
                    raise
                self.sent.waited += 1
                self._clock.sleep_s(FULL_REST_S)
                continue
            self.sent.datagrams += 1
            self.sent.octets += len(payload)
            return
        raise OSError(errno.ENOBUFS, "no room to send for seconds")


def _parts(d: Datagrams) -> Iterator[Datagrams]:
    """A few datagrams at a time."""
    for i in range(0, len(d), PART):
        some = slice(i, i + PART)
        yield Datagrams(d.end, d.data, d.bounds[i : i + PART + 1], d.offset[some], d.t_ns[some], d.stream[some])
