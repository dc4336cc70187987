"""Datagrams out of IP fragments, in whatever order they come, and as much of those as came in part.

Fragments that come in order are put together many at a time, all others one by one, with the same result.

Where fragments overlap, the octets that came first stay. A sender that repeats itself sends the same, so octets
that differ are from another datagram, with the same identification by chance or by malice, and what was begun first
is not spoilt by it. But a first fragment with another UDP header is certainly of another datagram: it ends the one
that waits. Wireshark and Linux differ here: the one lets lower places win, the other drops the datagram.

A datagram waits for its fragments for MAX_AGE_NS or MAX_AGE fragments (a sender at full speed uses an identification
again after some seconds), and as long as no more than MAX_WAITING others or MAX_OCTETS do.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from maritrack.io.containers.packets import UDP_HEADER, Bodies, Packets, Stretch, Tally, U8Array, tell_short
from maritrack.io.containers.partial import MAX_DATAGRAM, UNIT, Partial
from maritrack.io.datagrams import NO_TIME
from maritrack.types import BoolArray, IntArray

MAX_AGE_NS = 5 * 10**9
MAX_AGE = 65_536  # fragments: an identification can't come again before twice as many
MAX_WAITING = 4096
MAX_OCTETS = 16 << 20
RECENT, RECENT_NS = 64, 10**9  # datagrams done of which fragments may come again
OVERHEAD = 512  # octets that a waiting datagram costs besides its own

Key = tuple[bytes, int]  # addresses, identification


class Late(NamedTuple):
    """A datagram that was put together one fragment at a time."""

    row: int  # of the packet that ended it
    payload: bytes
    key: bytes  # addresses and ports
    offset: int
    t_ns: int


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """Datagrams whose fragments came in order. Rows n, fragments m."""

    row: IntArray  # (n,) of the last packet
    offset: IntArray  # (n,) octet of the file
    t_ns: IntArray  # (n,)
    key: U8Array  # (n, 12) or (n, 36)
    of: IntArray  # (m,) number of the datagram, ascending
    start: IntArray  # (m,) what each fragment has of the payload
    end: IntArray  # (m,)


class Reassembly:
    """Waits for the fragments of the datagrams of one family of addresses. With `fast` False all go one by one."""

    def __init__(self, *, fast: bool = True) -> None:
        self._fast = fast
        self._waiting: OrderedDict[Key, Partial] = OrderedDict()  # the one that was opened first is first
        self._recent: OrderedDict[Key, tuple[int, int]] = (
            OrderedDict()
        )  # done: time, and how many fragments had come by then
        self._octets = 0  # of all that wait
        self._count = 0  # fragments that have come

    def add(self, w: Stretch, p: Packets, b: Bodies, tally: Tally) -> tuple[Series, list[Late]]:
        """The datagrams that these fragments end."""
        length = b.stop - b.at
        bad = (length <= 0) | (b.place + length > MAX_DATAGRAM) | (b.more & (length % UNIT != 0))
        if bad.any():
            tally.add("bad-packet", b.at[bad], "an IP fragment that can't be")
            b = b.take(~bad)
        cut = b.stop > p.end[b.row]
        if cut.any():
            tell_short(p, b.row[cut], tally)
        order, starts = self._whole(w, p, b, cut)
        single = np.ones(len(b.row), dtype=np.bool_)
        single[order] = False
        late = self._one_by_one(w, p, b, np.flatnonzero(single), tally)
        series = _series(w, p, b, order, starts)
        if len(starts):
            self._remember(p, b, np.maximum.reduceat(order, starts))
        self._count += len(b.row)
        return series, late

    def expire(self, t_ns: int, row: int, tally: Tally, *, final: bool = False) -> list[Late]:
        """End what has waited too long at a time, or all that waits."""
        late: list[Late] = []
        while self._waiting:
            key, partial = next(iter(self._waiting.items()))
            if not final and not _too_old(partial.t_ns, partial.opened, t_ns, self._count):
                break
            late += self._end(key, row, tally)
        return late

    def _whole(self, w: Stretch, p: Packets, b: Bodies, cut: BoolArray) -> tuple[IntArray, IntArray]:
        """The fragments of datagrams of which all are here, one datagram after the other, and their starts.

        Either those of an identification came in order, of one datagram after the other, or they are of one alone.
        """
        order = starts = np.zeros(0, dtype=np.int64)
        if len(b.row) == 0 or not self._fast:
            return order, starts
        pairs: dict[bytes, int] = {}
        series = codes(b.addresses, pairs) << 32 | b.ident
        waiting = [pairs[addresses] << 32 | ident for addresses, ident in self._waiting if addresses in pairs]
        left = np.flatnonzero(~np.isin(series, waiting)) if waiting else np.arange(len(series))
        for keys in ((series,), (b.place, series)):
            if len(left) == 0:
                break
            tried = left[np.lexsort([key[left] for key in keys])]
            rows, begin = _runs(w, p, b, tried, series, cut)
            order, starts = np.concatenate([order, rows]), np.concatenate([starts, begin + len(order)])
            left = np.setdiff1d(left, rows, assume_unique=True)
        return order, starts

    def _one_by_one(self, w: Stretch, p: Packets, b: Bodies, rows: IntArray, tally: Tally) -> list[Late]:
        late: list[Late] = []
        packet = b.row[rows]
        table = zip(
            rows.tolist(), packet.tolist(), b.at[rows].tolist(), np.minimum(b.stop[rows], p.end[packet]).tolist(),
            (b.stop - b.at)[rows].tolist(), b.place[rows].tolist(), b.more[rows].tolist(), b.ident[rows].tolist(),
            p.t_ns[packet].tolist(), strict=True,
        )  # fmt: skip
        addresses, width = b.addresses.tobytes(), b.addresses.shape[1]
        base, before, waiting = w.base, self._count, self._waiting
        for i, row, at, end, length, place, more, ident, t_ns in table:
            self._count = before + i
            if waiting:
                oldest = next(iter(waiting.values()))
                if _too_old(oldest.t_ns, oldest.opened, t_ns, self._count):
                    late += self.expire(t_ns, row, tally)
            key = (addresses[i * width : (i + 1) * width], ident)
            partial, octets = waiting.get(key), w.data[at:end]
            if partial is not None and (
                (place == 0 and partial.is_another(octets)) or _too_old(partial.t_ns, partial.opened, t_ns, self._count)
            ):
                late += self._end(key, row, tally)
                partial = None
            if partial is None:
                partial = self._open(key, base + at + (UDP_HEADER if place == 0 else 0), t_ns)
            size = len(partial.octets)
            trouble = partial.put(place, octets, length, more=more)
            self._octets += len(partial.octets) - size
            partial.last_ns, partial.count = t_ns, partial.count + 1
            if trouble:
                tally.add_one(trouble, at, TROUBLES[trouble])
            if partial.complete:
                late += self._done(key, row, tally)
            while self._octets > MAX_OCTETS or len(waiting) > MAX_WAITING:
                late += self._end(next(iter(waiting)), row, tally)
        self._count = before
        return late

    def _open(self, key: Key, offset: int, t_ns: int) -> Partial:
        done = self._recent.get(key)
        again = done is not None and not _too_old(*done, t_ns, self._count, RECENT_NS)
        partial = self._waiting[key] = Partial(offset, t_ns, self._count, again)
        self._octets += OVERHEAD
        return partial

    def _take(self, key: Key) -> Partial:
        partial = self._waiting.pop(key)
        self._octets -= OVERHEAD + len(partial.octets)
        return partial

    def _done(self, key: Key, row: int, tally: Tally) -> list[Late]:
        partial = self._take(key)
        self._note(key, partial.last_ns, self._count)
        return _payload(partial, key, row, tally, least=0)

    def _end(self, key: Key, row: int, tally: Tally) -> list[Late]:
        """End a datagram that is not complete: what there is up to the first hole, if it begins at the beginning."""
        partial = self._take(key)
        place = partial.offset - tally.base
        if partial.again:
            tally.add_one("fragment-duplicate", place, TROUBLES["fragment-duplicate"], count=partial.count)
            return []
        tally.add_one("fragment-missing", place, "fragments of a datagram are missing")
        return _payload(partial, key, row, tally, least=1)

    def _remember(self, p: Packets, b: Bodies, last: IntArray) -> None:
        """Note the last of the datagrams done, given their last fragments."""
        for i in np.sort(last)[-RECENT:].tolist():
            key = b.addresses[i].tobytes(), int(b.ident[i])
            self._note(key, int(p.t_ns[b.row[i]]), self._count + i)

    def _note(self, key: Key, t_ns: int, count: int) -> None:
        self._recent[key] = t_ns, count
        self._recent.move_to_end(key)
        if len(self._recent) > RECENT:
            self._recent.popitem(last=False)


TROUBLES = {
    "fragment-overlap": "IP fragments overlap: the octets that came first stay",
    "fragment-duplicate": "an IP fragment came again",
}


def codes(rows: U8Array, known: dict[bytes, int]) -> IntArray:
    """The number of each row (its width is a multiple of 4) among those that are known, which become more."""
    n, width = rows.shape
    words = np.ascontiguousarray(rows).view(np.uint32)
    new = np.ones(n, dtype=np.bool_)
    new[1:] = words[1:, 0] != words[:-1, 0]
    for i in range(1, words.shape[1]):
        new[1:] |= words[1:, i] != words[:-1, i]
    heads = np.flatnonzero(new)
    octets = words[heads].tobytes()
    numbers = [known.setdefault(octets[at : at + width], len(known)) for at in range(0, len(octets), width)]
    return np.repeat(np.array(numbers, dtype=np.int64), np.diff(heads, append=n))


def _runs(
    w: Stretch, p: Packets, b: Bodies, order: IntArray, series: IntArray, cut: BoolArray
) -> tuple[IntArray, IntArray]:
    """Those of the fragments, ordered by series, whose series are nothing but whole datagrams; and their starts."""
    key, place, more = series[order], b.place[order], b.more[order]
    end = place + b.stop[order] - b.at[order]
    new = np.append(True, key[1:] != key[:-1])
    before = np.append(False, more[:-1]) & ~new  # the datagram of the fragment before is not at its end
    begins = ~before & (place == 0) & more
    good = begins | (before & (place == np.append(0, end[:-1])))
    good &= ~cut[order] & ~(more & np.append(new[1:], True))
    clean, group = np.logical_and.reduceat(good, np.flatnonzero(new)), np.cumsum(new) - 1
    while clean.any():  # twice at most
        rows = np.flatnonzero(clean[group])
        starts = np.flatnonzero(begins[rows])
        odd = _odd(w, p, b, order[rows], starts)
        if not odd.any():
            return order[rows], starts
        clean[group[rows[starts[odd]]]] = False
    return order[:0], order[:0]


def _series(w: Stretch, p: Packets, b: Bodies, order: IntArray, starts: IntArray) -> Series:
    """The datagrams of fragments that are ordered by their places."""
    head = order[starts]
    came_first = np.minimum.reduceat(order, starts) if len(starts) else head
    came_last = np.maximum.reduceat(order, starts) if len(starts) else head
    begin, row = b.at[order], b.row[came_last]
    begin[starts] += UDP_HEADER
    key = np.concatenate([b.addresses[head], w.rows(b.at[head], 4)], axis=1)
    of = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(order)))
    offset = w.base + b.at[came_first] + np.where(b.place[came_first] == 0, UDP_HEADER, 0)
    return Series(row, offset, p.t_ns[row], key, of, begin, b.stop[order])


def _odd(w: Stretch, p: Packets, b: Bodies, order: IntArray, starts: IntArray) -> BoolArray:
    """Which of these datagrams have another UDP length than their fragments, or took too long."""
    last = order[np.append(starts[1:], len(order)) - 1]
    odd: BoolArray = w.u16(b.at[order[starts]] + 4) != b.place[last] + b.stop[last] - b.at[last]
    t_ns = p.t_ns[b.row[order]]
    early, late = np.minimum.reduceat(t_ns, starts), np.maximum.reduceat(t_ns, starts)
    odd |= (early != NO_TIME) & (late - early > MAX_AGE_NS)
    return odd


def _payload(partial: Partial, key: Key, row: int, tally: Tally, *, least: int) -> list[Late]:
    """What there is of a datagram, if that is at least so many octets."""
    header, reach = partial.octets, partial.reach()
    if reach < UDP_HEADER + least:
        return []
    length = header[4] << 8 | header[5]
    if length < UDP_HEADER or 0 <= partial.total < length:
        tally.add_one("udp-length", partial.offset - tally.base, "a UDP length that can't be: the IP packet's is taken")
        length = reach
    payload = bytes(header[UDP_HEADER : min(reach, length)])
    return [Late(row, payload, key[0] + bytes(header[:4]), partial.offset, partial.last_ns)]


def _too_old(since_ns: int, since: int, t_ns: int, count: int, most_ns: int = MAX_AGE_NS) -> bool:
    if count - since > MAX_AGE:
        return True
    return NO_TIME not in (since_ns, t_ns) and abs(t_ns - since_ns) > most_ns
