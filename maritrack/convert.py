"""A CAT240 recording from one container into another: all of it or a part, its cells compressed or not, lossless.

Datagrams go over as they are; what can't be recoded or filtered for sure stays as it is and is counted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from maritrack.errors import InputError, UsageError
from maritrack.io.cat240.reader import refuse
from maritrack.io.cat240.recordwalk import sensor_name
from maritrack.io.checked import checked
from maritrack.io.containers.kinds import RAW, Opened, open_container
from maritrack.io.containers.select import subset, whole_blocks
from maritrack.io.datagrams import Datagrams, DatagramWriter, Stream
from maritrack.io.rewrite.datablocks import part_of
from maritrack.io.rewrite.datagram_times import Bound, Clock, Span, as_text, parse_window, resolve
from maritrack.io.rewrite.recode import Budget, Coding, data_blocks
from maritrack.io.rewrite.recode_rows import recode_datagrams
from maritrack.io.rewrite.sensor_filter import of_sensor
from maritrack.io.source import Octets
from maritrack.io.times import day_start_ns
from maritrack.types import Damage

OUTSIDE, OTHERS, TOO_LARGE, INCOMPLETE = "outside-time", "other-sensor", "too-large", "incomplete"
LEFT_OUT = (OUTSIDE, OTHERS, TOO_LARGE, INCOMPLETE)  # why datagrams or, the latter two, data blocks are left out
UNFIT = (TOO_LARGE, INCOMPLETE)  # for what is written to

MOST, MOST_OCTETS = 65_536, 8 << 20  # datagrams and their octets at a time

Progress = Callable[[int], None]  # octets of the input read so far


@dataclass(slots=True)
class Warned:
    """What was wrong so many times, and where first."""

    first: Damage
    count: int = 0
    sensors: dict[str, int] = field(default_factory=dict)


@dataclass(slots=True)
class Counts:
    """What a conversion read, changed and wrote."""

    container: str
    gzipped: bool
    octets_in: int = 0  # as stored
    datagrams_in: int = 0  # with CAT240, of the streams asked for
    datagrams_out: int = 0
    payload_in: int = 0  # octets of these datagrams
    payload_out: int = 0
    recoded: int = 0  # records
    cut: int = 0  # records of other sensors
    dropped: dict[str, int] = field(default_factory=lambda: dict.fromkeys(LEFT_OUT, 0))
    first_ns: int | None = None  # written
    last_ns: int | None = None
    warnings: dict[str, Warned] = field(default_factory=dict)

    def warn(self, damage: Damage) -> None:
        warned = self.warnings.setdefault(damage.code, Warned(damage))
        warned.count += damage.count
        if damage.sensor:
            warned.sensors[damage.sensor] = warned.sensors.get(damage.sensor, 0) + damage.count

    def document(self) -> dict[str, Any]:
        """The same for programs."""
        times = {"first": self.first_ns, "last": self.last_ns}
        return {
            "container": self.container, "gzipped": self.gzipped, "octets_in": self.octets_in,
            "datagrams_in": self.datagrams_in, "datagrams_out": self.datagrams_out, "payload_in": self.payload_in,
            "payload_out": self.payload_out, "records_recoded": self.recoded, "records_cut": self.cut,
            "datagrams_dropped": dict(self.dropped),
            **{f"{name}_ns": t_ns for name, t_ns in times.items()},
            **{name: None if t_ns is None else as_text(t_ns) for name, t_ns in times.items()},
            "warnings": {
                code: {"count": warned.count, "offset": warned.first.offset, "message": warned.first.message,
                       "sensors": dict(sorted(warned.sensors.items()))}
                for code, warned in sorted(self.warnings.items())
            },
        }  # fmt: skip


def convert(
    octets: Octets,
    writer: DatagramWriter,
    *,
    compress: bool | None = None,
    level: int = 6,
    time_window: str = "",
    sensor: str = "",
    stream: str = "",
    date: str = "",
    strict: bool = False,
    progress: Progress | None = None,
) -> Counts:
    """Write the datagrams of a recording that hold CAT240.

    `compress` True or False recodes the cells of each video record (zlib at `level`), None leaves them. Only what
    lies in `time_window` (see `parse_window`, `resolve`), is of `sensor` ("SAC-SIC") and of `stream` (see `Selection`)
    is written. `date` is the day of a recording that tells times of day only. With `strict` the first damage
    of the recording (see `checked`), or of what is recoded, raises InputError. The writer is neither closed nor
    aborted.
    """
    wanted = _Wanted(
        coding=None if compress is None else Coding(compress, level), sensor=parse_sensor(sensor) if sensor else None,
        window=parse_window(time_window) if time_window else None, strict=strict,
    )  # fmt: skip
    clock = Clock(day_start_ns(date, name="--date"))
    opened = open_container(octets, stream=stream)
    if stream and opened.name == RAW:
        raise UsageError(f"{octets.name}: data blocks as they are, no streams to choose '{stream}' from")
    job = _Job(octets.name, wanted, writer, opened.streams, Counts(opened.name, opened.gzipped))
    for d in checked(opened, name=octets.name, sensor=sensor) if strict else opened.datagrams():
        job.take(d, clock)
        job.counts.octets_in = opened.stored
        if progress is not None:
            progress(opened.stored)
    job.check(opened, stream)
    return job.counts


def parse_sensor(text: str) -> int:
    """SAC << 8 | SIC of "SAC-SIC"."""
    sac, dash, sic = text.partition("-")
    if not (dash and sac.isdecimal() and sic.isdecimal() and int(sac) < 256 and int(sic) < 256):
        raise UsageError(f"sensor '{text}': write SAC-SIC, two numbers up to 255, as in 7-42")
    return int(sac) << 8 | int(sic)


@dataclass(frozen=True, slots=True)
class _Wanted:
    """What is to be written, and how."""

    coding: Coding | None
    sensor: int | None
    window: tuple[Bound, Bound] | None
    strict: bool


@dataclass(slots=True)
class _Job:
    """A conversion at work."""

    name: str
    wanted: _Wanted
    writer: DatagramWriter
    streams: list[Stream]
    counts: Counts
    span: Span | None = None
    begun_ns: int | None = None  # the first datagram of all
    ended_ns: int = 0
    end: int = 0  # octets of the container that were read
    budget: Budget = field(default_factory=Budget)
    sources: set[int] = field(default_factory=set)

    def take(self, d: Datagrams, clock: Clock) -> None:
        """Write what is wanted of the next datagrams."""
        self._tell(d.damage)
        self.budget.earn(max(0, d.end - self.end))
        self.end = max(self.end, d.end)
        cuts = np.flatnonzero(np.diff(np.maximum(np.arange(len(d)) // MOST, d.bounds[:-1] // MOST_OCTETS))) + 1
        for first, last in pairwise([0, *cuts.tolist(), len(d)]):
            if last > first:
                self._take(part_of(d, first, last), clock)

    def _take(self, d: Datagrams, clock: Clock) -> None:
        self.counts.datagrams_in += len(d)
        self.counts.payload_in += len(d.data)
        d = self._of_sensor(self._in_window(replace(d, t_ns=clock.times(d))))
        at = 0
        for payloads in self._recoded(d):
            self._write(d, at, payloads)
            at += len(payloads)

    def check(self, opened: Opened, stream: str) -> None:
        """InputError where there was nothing to write."""
        counts = self.counts
        if counts.datagrams_in == 0:
            raise InputError(f"{self.name}: {_nothing(opened, stream)}")
        if counts.datagrams_out or counts.dropped[TOO_LARGE]:
            return
        if counts.dropped[INCOMPLETE]:
            raise InputError(f"{self.name}: not one data block is whole", hint=".pcap and .mcap hold parts of them")
        assert self.begun_ns is not None
        if counts.dropped[OTHERS]:
            assert self.wanted.sensor is not None
            others = ", ".join(sensor_name(source) for source in sorted(self.sources)[:8])
            sensor = sensor_name(self.wanted.sensor)
            raise InputError(f"{self.name}: no record of sensor {sensor}" + (f"; it has {others}" if others else ""))
        lasts = f"from {as_text(self.begun_ns)} to {as_text(self.ended_ns)}"
        raise InputError(f"{self.name}: nothing in this window of time, the recording lasts {lasts}")

    def _tell(self, damage: Iterable[Damage]) -> None:
        for one in damage:
            if self.wanted.strict:
                refuse(one, self.name)
            self.counts.warn(one)

    def _in_window(self, d: Datagrams) -> Datagrams:
        if self.begun_ns is None:
            self.begun_ns = self.ended_ns = int(d.t_ns[0])
            if self.wanted.window is not None:
                self.span = resolve(self.wanted.window, self.begun_ns, name=self.name)
        self.ended_ns = max(self.ended_ns, int(d.t_ns.max()))
        if self.span is None:
            return d
        inside = (d.t_ns >= self.span.first) & (d.t_ns < self.span.end)
        self.counts.dropped[OUTSIDE] += len(d) - int(inside.sum())
        return d if inside.all() else subset(d, inside)

    def _of_sensor(self, d: Datagrams) -> Datagrams:
        if self.wanted.sensor is None or len(d) == 0:
            return d
        d = whole_blocks(replace(d, damage=()))  # of the rest nobody knows whose it is
        self._tell(d.damage)
        ours = of_sensor(d, self.wanted.sensor)
        self.sources |= ours.sources
        self.counts.cut += ours.cut
        self.counts.dropped[OTHERS] += len(d) - len(ours.datagrams)
        return ours.datagrams

    def _recoded(self, d: Datagrams) -> Iterator[list[bytes]]:
        if len(d) == 0:
            return
        if self.wanted.coding is None:
            yield [d.data[first:last] for first, last in pairwise(d.bounds.tolist())]
            return
        for some in recode_datagrams(d, self.wanted.coding, self.budget):
            self._tell(some.kept)
            self.counts.recoded += some.changed
            yield some.payloads

    def _write(self, d: Datagrams, at: int, payloads: list[bytes]) -> None:
        """Write the datagrams from the index `at` on, with these payloads."""
        here = slice(at, at + len(payloads))
        write, streams, counts = self.writer.write, self.streams, self.counts
        lost, size = 0, sum(map(len, payloads))
        t_ns = d.t_ns[here]
        for i, (payload, t, stream) in enumerate(zip(payloads, t_ns.tolist(), d.stream[here].tolist(), strict=True)):
            if not write(payload, t_ns=t, stream=streams[stream]):
                lost += 1
                size -= len(payload)
                self._write_parts(part_of(d, at + i, at + i + 1), payload, streams[stream])
        counts.datagrams_out += len(payloads) - lost
        counts.payload_out += size
        first, last = int(t_ns.min()), int(t_ns.max())
        counts.first_ns = first if counts.first_ns is None else min(counts.first_ns, first)
        counts.last_ns = last if counts.last_ns is None else max(counts.last_ns, last)

    def _write_parts(self, one: Datagrams, payload: bytes, stream: Stream) -> None:
        """Write a datagram that the container can't hold, with this payload, as one data block after the other."""
        t_ns = int(one.t_ns[0])
        whole = whole_blocks(replace(one, data=payload, bounds=np.array([0, len(payload)]), damage=()))
        self.counts.dropped[INCOMPLETE] += len(whole.damage)
        self._tell(whole.damage)
        for (first, last), offset in zip(pairwise(whole.bounds.tolist()), whole.offset.tolist(), strict=True):
            at = offset
            for block in data_blocks(whole.data[first:last]):
                if self.writer.write(block, t_ns=t_ns, stream=stream):
                    self.counts.datagrams_out += 1
                    self.counts.payload_out += len(block)
                else:
                    self.counts.dropped[TOO_LARGE] += 1
                    message = f"a data block of {len(block)} octets is too large to be written"
                    self._tell([Damage(TOO_LARGE, at, message)])
                at += len(block)


def _nothing(opened: Opened, stream: str) -> str:
    if not opened.stored:
        return "empty"
    if not stream:
        return "no CAT240 in it"
    names = sorted({end for i in opened.selection.holding() for end in opened.streams[i] if end})
    return f"no CAT240 of {stream}" + (f"; it has {', '.join(names[:8])}" if names else "")
