"""Where the scans of a recording are in its octets, and reading from one of them on.

That goes where a recording of one sensor may begin anywhere: data blocks as they are, pcap behind its header, FINAL. Of
what is compressed as a whole, of pcapng, MCAP and point documents all that lies before is read, and passed by; and so
of several sensors, whose turns begin where each is first heard.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np

from maritrack.errors import MaritrackError, told
from maritrack.io.containers.kinds import FINAL, PCAP, RAW, container_of, open_container
from maritrack.io.octets import HEAD, FileChunks
from maritrack.io.remote import UrlChunks, is_url
from maritrack.io.source import Octets
from maritrack.recording import Recording, open_recording
from maritrack.sweep.plan import Run
from maritrack.sweep.sources import Opened, opened
from maritrack.types import Frame, IntArray

PCAP_HEADER = 24  # octets
NO_READING = (MaritrackError, ArithmeticError, LookupError, ValueError, TypeError, OSError, MemoryError)


@dataclass(frozen=True, slots=True, eq=False)
class Index:
    """The scans of a recording."""

    t_ns: IntArray  # (n,)
    begin: IntArray  # (n,) octet where what belongs to the scan begins; 0 = all before it is to be read
    part: IntArray  # (n,) `Scan.segment`: how often the range scale has changed or the sensor was silent

    def __len__(self) -> int:
        return len(self.t_ns)


@dataclass(frozen=True, slots=True)
class Place:
    """A scan and where to read it."""

    scan: int
    octet: int  # to read from, where the scan before it begins: that one tells the times of this one's first spokes
    t_ns: int  # of the scan, which tells whether reading from there gives the same
    part: int = 0  # `Scan.segment` of the scan: reading from there counts from 0 again


def index(run: Run) -> Index | str:
    """The scans of a run's recording, which is read once; or why that failed."""
    config = run.config
    if config is None or not (config.input.from_s == 0 and math.isinf(config.input.to_s) and config.input.limit == 0):
        return "a part of a recording is not split: leave out --from, --to and --limit"
    try:
        with opened(run.source, seed=run.seed) as found:
            recording = open_recording([found.octets], [found.kind], found.side, config)
            header = _header(found.octets.head) if found.kind == "cat240" else -1
            framing = _framing(found.octets) - header if header >= 0 else 0
            times, begins, parts, sensors, at = list[int](), list[int](), list[int](), set[str](), 0
            for frame in recording.frames:
                times.append(frame.t_ns)
                begins.append(at)
                at += sum(len(octets) for _, octets in frame.inputs)
                parts.append(frame.scan.segment)
                sensors.add(frame.scan.sensor.id)
            t_ns, part = np.array(times, np.int64), np.array(parts, np.int64)
            begin = np.maximum(np.array(begins, np.int64) - framing, 0)
            return Index(t_ns, begin if header >= 0 and len(sensors) == 1 else 0 * begin, part)
    except Exception as error:  # whatever it is, it is a row once the recording is run
        return told(error)


def place_of(found: Index, scan: int) -> Place:
    """Where to read a scan; octet 0 = from the beginning."""
    return Place(scan, int(found.begin[max(scan - 1, 0)]), int(found.t_ns[scan]), int(found.part[scan]))


def positioned(run: Run, found: Opened, place: Place) -> tuple[Recording, int]:
    """The recording from a scan on, and what is to be added to offsets in it.

    Where reading from its octet does not give that scan, all of the recording is read up to it.
    """
    if place.octet > 0:
        header = _header(found.octets.head)
        try:
            recording = _recording(run, found, place.octet, found.octets.head[:header])
            first = next(islice(recording.frames, 1, None), None)
        except NO_READING:
            first = None
        if first is not None and first.t_ns == place.t_ns:
            more = place.part - first.scan.segment
            frames = (_counted(frame, more) for frame in chain([first], recording.frames))
            return replace(recording, frames=frames), place.octet - header
    recording = _recording(run, found, 0, b"")
    return replace(recording, frames=islice(recording.frames, place.scan, None)), 0


def _counted(frame: Frame, more: int) -> Frame:
    """The frame of a sensor that was silent, or changed its range scale, so many times more before it."""
    return replace(frame, scan=replace(frame.scan, segment=frame.scan.segment + more)) if more else frame


def _header(head: bytes) -> int:
    """Octets before the first that may be read from anywhere; -1 = there is none such."""
    container = container_of(head)
    if container == RAW:
        return 0 if head[:1] == b"\xf0" else -1  # neither compressed nor framed
    return {PCAP: PCAP_HEADER, FINAL: 0}.get(container, -1)


def _framing(octets: Octets) -> int:
    """Octet of the container where the first payload begins: what belongs to a scan is told by payloads."""
    return next((int(d.offset[0]) for d in open_container(octets).datagrams() if len(d)), 0)


@dataclass(frozen=True, slots=True)
class _Behind:
    """A header, and octets from farther on."""

    header: bytes
    chunks: Any

    def __iter__(self) -> Iterator[bytes]:
        if self.header:
            yield self.header
        yield from self.chunks


def _recording(run: Run, found: Opened, begin: int, header: bytes) -> Recording:
    octets, config = found.octets, run.config
    assert config is not None
    if begin > 0:
        name = run.source.name
        chunks: Any = UrlChunks(name, begin) if is_url(name) else FileChunks(Path(octets.name), begin)
        head = (header + next(iter(chunks), b"")[:HEAD])[:HEAD]
        size = octets.size - begin + len(header) if octets.size >= 0 else -1
        octets = Octets(octets.name, octets.channel, _Behind(header, chunks), head, size)
    return open_recording([octets], [found.kind], found.side, config)
