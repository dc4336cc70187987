"""A recording that is copied only if nothing is wrong with it: read as a run reads it, cells and scans too."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from maritrack.io.cat240.radials import Batch, Radials
from maritrack.io.cat240.reader import read_batches, refuse
from maritrack.io.cat240_source import STRICT
from maritrack.io.containers.kinds import Opened
from maritrack.io.containers.places import Places
from maritrack.io.containers.select import whole_blocks
from maritrack.io.datagrams import Datagrams
from maritrack.io.turns.assemble import Assembler
from maritrack.io.turns.turn import Cut


def checked(opened: Opened, *, name: str, sensor: str = "") -> Iterator[Datagrams]:
    """The datagrams of a recording, read along the way. InputError, calling it `name`, at the first damage.

    Damage is what a strict run refuses: of the container, of records and of their cells, and, of `sensor` ("SAC-SIC",
    "" = all), of scans.
    """
    places, waiting = Places(), list[Datagrams]()
    assembler = Assembler(sensor=sensor, streams=opened.streams)
    for batch in read_batches(_payloads(opened, places, waiting), name=name, stream_of=places.stream_of):
        _check(batch, places, name)
        if batch.radials is not None:
            _check_scans(assembler.push(_in_place(batch.radials, places)), name)
        places.forget(batch.end)
        yield from waiting
        waiting.clear()
    for damage in places.told():
        refuse(damage, name)
    _check_scans(assembler.finish(), name)
    yield from waiting


def _payloads(opened: Opened, places: Places, waiting: list[Datagrams]) -> Iterator[bytes]:
    """The whole data blocks of datagrams, which are put aside."""
    for d in opened.datagrams():
        whole = whole_blocks(d)
        places.add(whole)
        waiting.append(d)
        if whole.data:
            yield whole.data


def _check(batch: Batch, places: Places, name: str) -> None:
    told = sorted([*places.told(), *places.damage_back(batch.damage)], key=lambda one: one.offset)
    if told:
        refuse(told[0], name)


def _check_scans(cuts: Iterator[Cut], name: str) -> None:
    for cut in cuts:
        for damage in cut.damage:
            if damage.code in STRICT:
                refuse(damage, name)


def _in_place(radials: Radials, places: Places) -> Radials:
    """Radials with their places and times in the container."""
    row = places.rows(radials.offset)
    return replace(radials, offset=places.back(radials.offset, row), t_ns=places.t_ns[row])
