"""A thread that does nothing but take datagrams from a socket, so that nothing is lost while others work."""

from __future__ import annotations

import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import Empty, SimpleQueue

from maritrack.live.batches import MANY, Batch, taker
from maritrack.live.sockets import granted_octets

MOST_WAITING = 256 << 20  # octets; beyond it the kernel keeps what comes, and counts what it drops
OVERHEAD = 400  # octets of memory for each datagram besides its payload
REST_S = 0.001  # for more to come, so that a call is worth its while
ROOM_OF_REST = 4 << 20  # octets that the kernel has to hold for that; with less the rest is shorter
FULL_REST_S = 0.005


class Receiver:
    """Datagrams of a socket, held until they are asked for.

    `end` takes what has come so far and then stops.
    """

    def __init__(
        self, sock: socket.socket, *, most_waiting: int = MOST_WAITING, wall_ns: Callable[[], int] = time.time_ns
    ) -> None:
        self._taker = taker(sock, wall_ns=wall_ns)
        self._most_waiting = most_waiting
        self._rest_s = REST_S * min(granted_octets(sock) / ROOM_OF_REST, 1.0)
        self._queue: SimpleQueue[tuple[Batch, int] | OSError | None] = SimpleQueue()
        self._ending = threading.Event()
        self._given = self._taken = 0  # octets; each is changed by one thread alone
        self._thread = threading.Thread(target=self._run, name="receiver", daemon=True)

    @property
    def waiting(self) -> int:
        """Octets of memory that wait to be asked for."""
        return self._given - self._taken

    def batches(self, wait_s: float) -> Iterator[Batch | None]:
        """What came, None where nothing came for a while; ends after `end`. OSError where the network fails."""
        while True:
            try:
                found = self._queue.get(timeout=wait_s)
            except Empty:
                yield None
                continue
            if found is None:
                return
            if isinstance(found, OSError):
                raise found
            batch, size = found
            self._taken += size
            yield batch

    def end(self) -> None:
        """Take no more than what has come."""
        self._ending.set()

    @contextmanager
    def running(self) -> Iterator[Receiver]:
        """While the thread runs."""
        self._thread.start()
        try:
            yield self
        finally:
            self.end()
            self._thread.join()

    def _run(self) -> None:
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())  # they are for the main thread
        try:
            while not self._ending.is_set():
                n = self._pass_on(self._taker.take(wait=True))
                if 0 < n < MANY:
                    time.sleep(self._rest_s)
                while self.waiting > self._most_waiting and not self._ending.is_set():
                    time.sleep(FULL_REST_S)
            while self._pass_on(self._taker.take(wait=False)) == MANY:
                pass
            self._queue.put(None)
        except OSError as error:
            self._queue.put(error)

    def _pass_on(self, batch: Batch | None) -> int:
        if batch is None:
            return 0
        size = sum(map(len, batch.payloads)) + OVERHEAD * len(batch.payloads)
        self._given += size
        self._queue.put((batch, size))
        return len(batch.payloads)
