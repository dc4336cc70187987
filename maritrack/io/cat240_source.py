"""Frames from CAT240 radar video: a frame per rotation, with the octets that it came from."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from maritrack.errors import ConfigError, InputError
from maritrack.io.cat240.radials import Batch, Radials
from maritrack.io.containers.capture import open_cat240
from maritrack.io.containers.ledger import Ledger
from maritrack.io.datagrams import NO_TIME, Stream
from maritrack.io.pose import PoseTrack
from maritrack.io.source import Octets
from maritrack.io.times import DAY_NS, YEAR_NS, day_start_ns
from maritrack.io.turns.assemble import Assembler
from maritrack.io.turns.scans import scan_of
from maritrack.io.turns.spokes import TICK_NS
from maritrack.io.turns.turn import Cut
from maritrack.settings import InputConfig
from maritrack.types import Damage, Frame, Origin, Scan

MAX_WAITING = 1 << 30  # octets that may pass without a scan
MAX_TOLD = 1000  # damage of one kind that is told one by one before the next frame; the rest is added to the last
STRICT = ("lost-records", "odd-range", "stray-azimuth", "clock-back", "too-many-sensors")  # --strict refuses these


class Cat240Source:
    """A CAT240 recording in any container as frames, one per scan, in the order in which scans end.

    `pose` is where the platform is (None: at 0, 0), `sensor_configs` and `sensor_poses` say otherwise for
    single sensors ("7-42"). The last frame carries the octets and the damage up to the end of the input;
    a recording without a scan leaves its damage in `unclaimed`. Memory: a turn per sensor and a batch.
    Raises ConfigError for head-up video without a heading, InputError where strict or where the sensor
    asked for is not there.
    """

    kind = "cat240"

    def __init__(
        self,
        octets: Octets,
        config: InputConfig,
        *,
        pose: PoseTrack | None = None,
        origin: Origin | None = None,
        strict: bool = False,
        workers: int = 1,
        sensor_configs: Mapping[str, InputConfig] | None = None,
        sensor_poses: Mapping[str, PoseTrack] | None = None,
    ) -> None:
        self.origin = origin
        self.unclaimed: tuple[Damage, ...] = ()
        self._midnight_ns: int | None = None  # of the first day, by the receive times; None = not known yet
        self._octets, self._config, self._strict, self._workers = octets, config, strict, workers
        self._pose = pose if pose is not None else PoseTrack.fixed()
        self._configs, self._poses = dict(sensor_configs or {}), dict(sensor_poses or {})
        for name in self._configs:
            self._place(name)
        if not self._poses:
            self._place("")

    def frames(self) -> Iterator[Frame]:
        """Frames from 0 on."""
        recording = open_cat240(self._octets, strict=self._strict, stream=self._config.stream, workers=self._workers)
        return self.frames_of(recording.batches(), streams=recording.streams)

    def frames_of(self, batches: Iterable[Batch], *, streams: Sequence[Stream] = ()) -> Iterator[Frame]:
        """Frames of batches that were read already, out of these streams.

        A frame is held back until it is certain that another one follows, so that the last one can
        carry what comes after it.
        """
        assembler = Assembler(sensor=self._config.sensor, streams=streams)
        builder = _FrameBuilder(self._octets.channel)
        held: Frame | None = None
        for batch in batches:
            builder.add(batch)
            if self._midnight_ns is None and batch.radials is not None:
                self._midnight_ns = first_midnight_ns(batch.radials)
            for cut in assembler.push(batch.radials) if batch.radials is not None and len(batch.radials) else ():
                frame = builder.frame(cut, self._scan(cut))
                if frame is not None and held is not None:
                    yield held
                held = frame or held
            if held is not None and assembler.sure:
                yield held
                held = None
            self._check_waiting(builder.ledger.size)
        for cut in assembler.finish():
            frame = builder.frame(cut, self._scan(cut))
            if frame is not None and held is not None:
                yield held
            held = frame or held
        self._check_sensor(assembler.seen)
        if held is not None:
            yield builder.last(held)
        else:
            self.unclaimed = builder.damage_left()

    def _scan(self, cut: Cut) -> Scan | None:
        for damage in cut.damage:
            if self._strict and damage.code in STRICT:
                raise InputError(f"{self._octets.name}: at byte {damage.offset}: {damage.code}: {damage.message}")
        if cut.turn is None:
            return None
        config, pose = self._place(cut.turn.sensor)
        midnight_ns = day_start_ns(config.date, name=self._octets.name) if config.date else self._midnight_ns or 0
        return scan_of(cut.turn, config, pose, midnight_ns=midnight_ns)

    def _place(self, sensor: str) -> tuple[InputConfig, PoseTrack]:
        config, pose = self._configs.get(sensor, self._config), self._poses.get(sensor, self._pose)
        if config.stabilised == "head" and not pose.has_heading:
            which = f"sensor {sensor}" if sensor else "input"
            raise ConfigError(
                f"{which}: stabilised = 'head' needs the heading of the ship",
                hint="give the reports of the own ship, or stabilised = 'north'",
            )
        return config, pose

    def _check_waiting(self, size: int) -> None:
        if size > MAX_WAITING:
            raise InputError(f"{self._octets.name}: no scan within {size} octets", hint="is it the right sensor?")

    def _check_sensor(self, seen: Mapping[str, None]) -> None:
        wanted = self._config.sensor
        if wanted and seen and wanted not in seen:
            raise InputError(f"{self._octets.name}: no sensor '{wanted}'", hint="sensors in it: " + ", ".join(seen))


class _FrameBuilder:
    """Scans with their number, their octets and the damage noticed since the last one."""

    def __init__(self, channel: str) -> None:
        self.ledger = Ledger()
        self._channel = channel
        self._k = 0
        self._reader_damage = _Told()
        self._damage = _Told()

    def add(self, batch: Batch) -> None:
        self.ledger.add(batch.octets, batch.span)
        self._reader_damage.add(batch.damage)

    def frame(self, cut: Cut, scan: Scan | None) -> Frame | None:
        """The frame of a scan; what a cut without a scan tells goes to the next frame."""
        self._damage.add(cut.damage)
        if scan is None:
            return None
        damage = _in_place(self._damage.take() + self._reader_damage.take(before=cut.offset))
        octets = self.ledger.cut(cut.offset)
        self._k += 1
        return Frame(k=self._k - 1, scan=scan, inputs=((self._channel, octets),) if octets else (), damage=damage)

    def last(self, frame: Frame) -> Frame:
        """The last frame with all that came after it."""
        octets = b"".join(octets for _, octets in frame.inputs) + self.ledger.rest()
        inputs = ((self._channel, octets),) if octets else ()
        return replace(frame, inputs=inputs, damage=_in_place([*frame.damage, *self.damage_left()]))

    def damage_left(self) -> tuple[Damage, ...]:
        return _in_place(self._damage.take() + self._reader_damage.take())


class _Told:
    """Damage to be told with the next frame, in bounded memory: each time in the order of places, what can be told."""

    def __init__(self) -> None:
        self._all: list[Damage] = []
        self._told: Counter[tuple[str, str]] = Counter()
        self._latest: dict[tuple[str, str], int] = {}  # place in `_all`, counted from the first ever
        self._gone = 0  # that were in `_all`

    def add(self, damage: Iterable[Damage]) -> None:
        for one in damage:
            kind = (one.code, one.sensor)
            if self._told[kind] >= MAX_TOLD:
                latest = self._latest[kind] - self._gone
                self._all[latest] = replace(self._all[latest], count=self._all[latest].count + one.count)
                continue
            self._told[kind] += 1
            self._latest[kind] = self._gone + len(self._all)
            self._all.append(one)

    def take(self, *, before: int | None = None) -> list[Damage]:
        """What there is, or what lies before an octet (then all was added in the order of places)."""
        n = len(self._all) if before is None else bisect_left(self._all, before, key=lambda one: one.offset)
        taken = self._all[:n]
        del self._all[:n]
        self._gone += n
        self._told.subtract((one.code, one.sensor) for one in taken)
        return taken


def first_midnight_ns(radials: Radials) -> int | None:
    """The midnight from which times of day count, by the first receive time that has a date; None where none has."""
    dated = np.flatnonzero((radials.t_ns >= YEAR_NS) & (radials.t_ns != NO_TIME))
    if len(dated) == 0:
        return None
    came_ns, tod = int(radials.t_ns[dated[0]]), int(radials.tod[dated[0]])
    tod_ns = tod * TICK_NS if tod >= 0 else came_ns % DAY_NS
    return (came_ns - tod_ns + DAY_NS // 2) // DAY_NS * DAY_NS


def _in_place(damage: list[Damage]) -> tuple[Damage, ...]:
    return tuple(sorted(damage, key=lambda d: d.offset))
