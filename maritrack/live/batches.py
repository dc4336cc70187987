"""Datagrams taken from a socket: many with one call of the kernel where it is Linux, else one by one.

A call for each datagram has to win the interpreter's lock back each time, which takes milliseconds while another
thread works: too long at thousands a second. A call for many does so once.
"""

from __future__ import annotations

import ctypes
import errno
import os
import socket
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, NamedTuple, Protocol

import numpy as np

from maritrack.io.datagrams import NO_TIME, Stream
from maritrack.live.sockets import IP_PKTINFO, LINUX, SO_TIMESTAMPNS, endpoint

MANY = 256  # datagrams a call
SLOT = 65_536  # octets for each: more than the largest
WAIT_S = 0.1  # for the first datagram
NAME, CONTROL = 28, 128  # octets for the sender's address and for the kernel's notes
MSG_WAITFORONE = 0x10000
NOTE = struct.Struct("@Nii")  # length with this head, level, kind
NOTE_ALIGN = struct.calcsize("@N")
SECONDS = {16: struct.Struct("@qq"), 8: struct.Struct("@ii")}
TO_IPV4 = struct.Struct("@i4s4s")  # interface, local address, address that the datagram was sent to
USUAL = struct.Struct("@Nii qq Nii i4s4s")  # the notes of IPv4 as they nearly always come
USUAL_HEADS = (32, socket.SOL_SOCKET, SO_TIMESTAMPNS, socket.IPPROTO_IP, IP_PKTINFO)

Key = tuple[Any, ...]  # of a stream: sender and destination as the system gave them


class Batch(Protocol):
    """Datagrams in the order in which they came."""

    @property
    def payloads(self) -> list[bytes]: ...

    def notes(self) -> Iterator[tuple[int, Key]]:
        """Receive time (UNIX, ns) and stream of each."""

    def stream(self, key: Key) -> Stream: ...


class Taker(Protocol):
    """Takes what has come to a socket."""

    def take(self, *, wait: bool) -> Batch | None:
        """Waits at most WAIT_S for the first datagram; None where none came."""


def taker(sock: socket.socket, *, wall_ns: Callable[[], int] = time.time_ns) -> Taker:
    """The best way of this system to take datagrams from a socket. `wall_ns` is asked where the kernel has no time."""
    call = getattr(ctypes.CDLL(None, use_errno=True), "recvmmsg", None) if LINUX else None
    return OneByOne(sock, wall_ns=wall_ns) if call is None else ManyAtOnce(sock, call, wall_ns=wall_ns)


class PlainBatch(NamedTuple):
    """Datagrams with what is known without the kernel's notes."""

    payloads: list[bytes]
    came_ns: list[int]
    senders: list[Any]
    bound: tuple[str, int]

    def notes(self) -> Iterator[tuple[int, Key]]:
        for t_ns, sender in zip(self.came_ns, self.senders, strict=True):
            yield t_ns, sender[:2]

    def stream(self, key: Key) -> Stream:
        return Stream(endpoint(*key), endpoint(*self.bound))


class OneByOne:
    """A call for each datagram: on any system."""

    def __init__(self, sock: socket.socket, *, wall_ns: Callable[[], int]) -> None:
        self._sock, self._wall_ns = sock, wall_ns
        self._bound: tuple[str, int] = sock.getsockname()[:2]

    def take(self, *, wait: bool) -> PlainBatch | None:
        batch = PlainBatch([], [], [], self._bound)
        self._sock.settimeout(WAIT_S if wait else 0.0)
        with suppress(TimeoutError, BlockingIOError, InterruptedError):
            while len(batch.payloads) < MANY:
                payload, sender = self._sock.recvfrom(SLOT)
                batch.came_ns.append(self._wall_ns())
                batch.payloads.append(payload)
                batch.senders.append(sender)
                self._sock.settimeout(0.0)
        return batch if batch.payloads else None


class _Piece(ctypes.Structure):
    _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))


class _Header(ctypes.Structure):
    """struct msghdr."""

    _fields_ = (
        ("name", ctypes.c_void_p),
        ("name_length", ctypes.c_uint32),
        ("pieces", ctypes.c_void_p),
        ("n_pieces", ctypes.c_size_t),
        ("control", ctypes.c_void_p),
        ("control_length", ctypes.c_size_t),
        ("flags", ctypes.c_int),
    )


class _Message(ctypes.Structure):
    """struct mmsghdr: what recvmmsg fills for one datagram."""

    _fields_ = (("header", _Header), ("octets", ctypes.c_uint))


class ManyBatch(NamedTuple):
    """Datagrams with the kernel's notes as they came."""

    payloads: list[bytes]
    came_ns: int  # for those without a time of the kernel
    names: bytes  # NAME octets for each
    control: bytes  # CONTROL octets for each
    port: int

    def notes(self) -> Iterator[tuple[int, Key]]:
        for i in range(len(self.payloads)):
            t_ns, to = _read_notes(self.control, i * CONTROL, (i + 1) * CONTROL)
            yield self.came_ns if t_ns == NO_TIME else t_ns, (self.names[i * NAME : (i + 1) * NAME], to)

    def stream(self, key: Key) -> Stream:
        name, to = key
        (family,) = struct.unpack_from("@H", name)
        (port,) = struct.unpack_from(">H", name, 2)
        sender = name[8:24] if family == socket.AF_INET6 else name[4:8]
        return Stream(endpoint(_text(sender), port), endpoint(_text(to), self.port) if to else "")


class ManyAtOnce:
    """Up to MANY datagrams with one call of recvmmsg, without the interpreter's lock."""

    def __init__(self, sock: socket.socket, call: Callable[..., int], *, wall_ns: Callable[[], int]) -> None:
        self._sock, self._call, self._wall_ns = sock, call, wall_ns
        sock.settimeout(None)
        micros = int(WAIT_S * 1e6)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("@ll", *divmod(micros, 1_000_000)))
        self._port: int = sock.getsockname()[1]
        self._data = np.empty(MANY * SLOT, dtype=np.uint8)  # memory only where something was received
        self._names = np.zeros(MANY * NAME, dtype=np.uint8)
        self._control = np.zeros(MANY * CONTROL, dtype=np.uint8)
        self._pieces = (_Piece * MANY)()
        memory = bytearray(MANY * ctypes.sizeof(_Message))
        self._messages = (_Message * MANY).from_buffer(memory)
        for i in range(MANY):
            self._pieces[i] = _Piece(self._data.ctypes.data + i * SLOT, SLOT)
            self._messages[i].header = _Header(
                name=self._names.ctypes.data + i * NAME, name_length=NAME,
                pieces=ctypes.addressof(self._pieces[i]), n_pieces=1,
                control=self._control.ctypes.data + i * CONTROL, control_length=CONTROL,
            )  # fmt: skip
        self._heads, self._fresh = memoryview(memory), bytes(memory)
        self._octets = np.ndarray(
            (MANY,), np.uint32, memory, offset=_Message.octets.offset, strides=(ctypes.sizeof(_Message),)
        )
        self._view = self._data.data

    def take(self, *, wait: bool) -> ManyBatch | None:
        self._heads[:] = self._fresh  # lengths that the kernel changed
        self._control[:] = 0
        flags = MSG_WAITFORONE if wait else socket.MSG_DONTWAIT
        n = self._call(self._sock.fileno(), self._messages, MANY, flags, None)
        if n < 0:
            number = ctypes.get_errno()
            if number in (errno.EAGAIN, errno.EWOULDBLOCK, errno.EINTR):
                return None
            raise OSError(number, os.strerror(number))
        came_ns, view = self._wall_ns(), self._view
        payloads = [bytes(view[i * SLOT : i * SLOT + size]) for i, size in enumerate(self._octets[:n].tolist())]
        names, control = self._names[: n * NAME].tobytes(), self._control[: n * CONTROL].tobytes()
        return ManyBatch(payloads, came_ns, names, control, self._port)


def _read_notes(control: bytes, at: int, end: int) -> tuple[int, bytes]:
    """Receive time (NO_TIME where there is none) and the address that the datagram was sent to ("" = not told)."""
    length, level, kind, seconds, nanos, _, other_level, other_kind, _, _, to = USUAL.unpack_from(control, at)
    if (length, level, kind, other_level, other_kind) == USUAL_HEADS:
        return seconds * 1_000_000_000 + nanos, to
    t_ns, to = NO_TIME, b""
    while at + NOTE.size <= end:
        length, level, kind = NOTE.unpack_from(control, at)
        if length < NOTE.size:  # no more
            break
        body = at + NOTE.size
        if level == socket.SOL_SOCKET and kind == SO_TIMESTAMPNS and length - NOTE.size in SECONDS:
            seconds, nanos = SECONDS[length - NOTE.size].unpack_from(control, body)
            t_ns = seconds * 1_000_000_000 + nanos
        elif level == socket.IPPROTO_IP and kind == IP_PKTINFO:
            to = TO_IPV4.unpack_from(control, body)[2]
        elif level == socket.IPPROTO_IPV6 and kind == socket.IPV6_PKTINFO:
            to = control[body : body + 16]
        at += -(-length // NOTE_ALIGN) * NOTE_ALIGN
    return t_ns, to


def _text(address: bytes) -> str:
    return socket.inet_ntop(socket.AF_INET6 if len(address) == 16 else socket.AF_INET, address)
