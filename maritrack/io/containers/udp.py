"""From the packets of a capture to its datagrams: streams named, fragments joined, payloads in one piece."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from socket import AF_INET6, inet_ntop

import numpy as np

from maritrack.io.containers.fragments import Late, Reassembly, Series, codes
from maritrack.io.containers.packets import Packets, Payloads, Stretch, Tally, stretch, udp_bodies, udp_payloads
from maritrack.io.containers.pull import even_pieces
from maritrack.io.datagrams import Datagrams, Stream
from maritrack.types import IntArray

WINDOW = 2 << 20  # octets of a file that are added to a stretch
MAX_STREAMS = 65_536
FEW = 8  # payloads: fewer are not worth a copy in rows

Walk = Callable[[Stretch, Tally], tuple[Packets, int]]  # the packets of a stretch, and where it goes on


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """Datagrams, in any order. Rows n, parts m."""

    row: IntArray  # (n,) packet with which it was complete
    code: IntArray  # (n,) of its addresses and ports
    offset: IntArray  # (n,)
    t_ns: IntArray  # (n,)
    of: IntArray  # (m,) number of the datagram, ascending
    start: IntArray  # (m,)
    end: IntArray  # (m,)


class UdpReader:
    """Finds the UDP datagrams of a capture, stretch by stretch. Streams are appended to `streams` as they appear."""

    def __init__(self, streams: list[Stream], *, fast: bool = True) -> None:
        self._streams = streams
        self._numbers: dict[bytes, int] = {}
        self._reassembly = Reassembly(fast=fast), Reassembly(fast=fast)

    def datagrams(self, w: Stretch, p: Packets, end: int, tally: Tally) -> Datagrams:
        """The datagrams that these packets end."""
        known: dict[bytes, int] = {}
        found: list[_Found] = []
        late: list[Late] = []
        for b, reassembly in zip(udp_bodies(w, p, tally), self._reassembly, strict=True):
            bodies, whole = b, b.whole
            if len(whole) and not whole.all():
                series, more = reassembly.add(w, p, b.take(~whole), tally)
                late += more
                found.append(_of_series(series, known))
                bodies = b.take(whole)
            if len(bodies.row):
                found.append(_of_payloads(w, p, udp_payloads(w, p, bodies, tally), known))
            t_ns = int(p.t_ns[-1]) if len(p) else 0
            if len(p) or w.final:
                late += reassembly.expire(t_ns, len(p), tally, final=w.final)
        if late:
            found.append(_of_late(late, known))
        return self._joined(w, found, late, list(known), end, tally)

    def _joined(
        self, w: Stretch, found: list[_Found], late: list[Late], keys: list[bytes], end: int, tally: Tally
    ) -> Datagrams:
        of = found[0] if len(found) == 1 else _together(found)
        n = len(of.row)
        order = np.argsort(of.row, kind="stable")
        stream = self._stream(of.code[order], keys)
        if n and stream.min() < 0:
            message = f"more than {MAX_STREAMS} streams: the datagrams of those beyond are left out"
            tally.add("too-many-streams", of.offset[order[stream < 0]] - w.base, message)
            order, stream = order[stream >= 0], stream[stream >= 0]
        part, size = order, of.end - of.start
        if len(of.of) != n:
            first = np.searchsorted(of.of, np.arange(n + 1))
            size = np.add.reduceat(size, first[:-1])
            count = np.diff(first)[order]
            part = np.arange(count.sum()) + np.repeat(first[order] - np.cumsum(count) + count, count)
        data = _data(w, of.start[part], of.end[part], part - (len(of.of) - len(late)), late)
        bounds = np.concatenate([[0], np.cumsum(size[order])])
        return Datagrams(w.base + end, data, bounds, of.offset[order], of.t_ns[order], stream, tally.told())

    def _stream(self, code: IntArray, keys: list[bytes]) -> IntArray:
        """Index of the stream of each datagram, -1 = too many; new ones in order of appearance."""
        heads = code[np.append(True, code[1:] != code[:-1])[: len(code)]]
        index = np.full(len(keys), -1, dtype=np.int64)
        for one in dict.fromkeys(heads.tolist()):
            index[one] = self._number(keys[one])
        return index[code]

    def _number(self, key: bytes) -> int:
        number = self._numbers.get(key, -1)
        if number < 0 and len(self._streams) < MAX_STREAMS:
            number = self._numbers[key] = len(self._streams)
            self._streams.append(stream_of(key))
        return number


def read_capture(chunks: Iterable[bytes], walk: Walk, udp: UdpReader, window: int) -> Iterator[Datagrams]:
    """The datagrams of a file, of which `walk` finds the packets."""
    rest, base = b"", 0
    for piece in even_pieces(chunks, window):
        w, tally = stretch(base, rest, piece, final=False), Tally(base)
        p, end = walk(w, tally)
        yield udp.datagrams(w, p, end, tally)
        rest, base = w.data[end : w.size], base + end
    w, tally = stretch(base, rest, final=True), Tally(base)
    p, end = walk(w, tally)
    yield udp.datagrams(w, p, end, tally)


def stream_of(key: bytes) -> Stream:
    """The stream of two addresses and two ports."""
    width = (len(key) - 4) // 2
    ports = key[2 * width :]
    return Stream(_endpoint(key[:width], ports[:2]), _endpoint(key[width : 2 * width], ports[2:]))


def _endpoint(address: bytes, port: bytes) -> str:
    text = ".".join(map(str, address)) if len(address) == 4 else f"[{inet_ntop(AF_INET6, address)}]"
    return f"{text}:{int.from_bytes(port, 'big')}"


def _of_payloads(w: Stretch, p: Packets, found: Payloads, known: dict[bytes, int]) -> _Found:
    code = codes(found.key, known)
    return _Found(
        found.row, code, w.base + found.start, p.t_ns[found.row], np.arange(len(code)), found.start, found.end
    )


def _of_series(found: Series, known: dict[bytes, int]) -> _Found:
    return _Found(found.row, codes(found.key, known), found.offset, found.t_ns, found.of, found.start, found.end)


def _of_late(late: list[Late], known: dict[bytes, int]) -> _Found:
    """Datagrams whose octets are not in the stretch: each has a part of their size at 0."""
    code = [known.setdefault(one.key, len(known)) for one in late]
    table = np.array([(one.row, one.offset, one.t_ns, len(one.payload)) for one in late], dtype=np.int64)
    n = len(late)
    return _Found(
        table[:, 0], np.array(code, dtype=np.int64), table[:, 1], table[:, 2], np.arange(n),
        np.zeros(n, dtype=np.int64), table[:, 3],
    )  # fmt: skip


def _together(found: list[_Found]) -> _Found:
    none = np.zeros(0, dtype=np.int64)
    found = [_Found(none, none, none, none, none, none, none), *found]
    firsts = np.cumsum([0, *(len(one.row) for one in found)]).tolist()
    row, code, offset, t_ns, start, end = (
        np.concatenate([getattr(one, name) for one in found])
        for name in ("row", "code", "offset", "t_ns", "start", "end")
    )
    of = np.concatenate([one.of + first for one, first in zip(found, firsts[:-1], strict=True)])
    return _Found(row, code, offset, t_ns, of, start, end)


def _data(w: Stretch, start: IntArray, end: IntArray, number: IntArray, late: list[Late]) -> bytes:
    """The parts, joined; those whose number is not negative are of datagrams that came late."""
    n, size = len(start), int(end[0] - start[0]) if len(start) else 0
    if n >= FEW and size and not late and (end - start == size).all():
        step = int(start[1] - start[0])
        if step > 0 and (start[1:] - start[:-1] == step).all():
            rows = np.ndarray((n, size), dtype=np.uint8, buffer=w.data, offset=int(start[0]), strides=(step, 1))
            return rows.tobytes()
        every = np.ndarray((w.size - size + 1,), dtype=f"V{size}", buffer=w.data, strides=(1,))
        return every[start].tobytes()
    view = memoryview(w.data)
    parts: list[bytes | memoryview] = list(map(view.__getitem__, map(slice, start.tolist(), end.tolist())))
    for i in np.flatnonzero(number >= 0).tolist() if late else ():
        parts[i] = late[int(number[i])].payload
    return b"".join(parts)
