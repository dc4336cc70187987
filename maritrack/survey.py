"""What a CAT240 recording holds, by the headers of its records: the radars, how they turn, what is missing.

`survey` gives the document of `maritrack show --json`. Lengths are in m, times in s, angles in degrees; a number that
isn't known is None. Lists end after LISTED entries, the numbers beside them count all.

    container, gzipped  "raw", "pcap", "pcapng", "FINAL" or "MCAP"; whether it is compressed as a whole
    octets              size of the file
    from, to            first and last time, ISO 8601; without a date where only the time of day is known
    duration_s
    records, scans      of all sensors together
    sensors             [...], see below
    other_streams       [{source, destination, datagrams}] without CAT240
    summaries           [{sensor, text, count}] texts of item 030 from senders without video
    damage              [{code, sensor, count, offset, message}] what is wrong with the octets, the first of its kind
    warnings            {code: count} the same by code

Each sensor, a SAC and SIC in a stream:

    id, sac, sic, source, destination
    records, spokes     messages; spokes, after parts were put together
    first_time, last_time, duration_s, clock ("time of day", "receive time" or "none")
    scans               turns, as `maritrack process` counts them
    period_s, period_jitter_s (standard deviation of turns within half a period of it), period_spread_s (1.4826 x median
                        deviation), period_least_s, period_most_s, rotation_rpm
    spokes_per_turn, spokes_least, spokes_most, spoke_width_deg     of full turns
    cell_m, cells, range_first_m, range_m, bits, header ("femto" or "nano")     of most spokes
    range_scales        different ones
    compression ("zlib", "none" or "mixed"), compression_ratio      octets sent for one octet of cells
    lost_records, losses, loss_list [{at, offset, records}]         by MSG_INDEX
    gaps, gap_over_s, gap_list [{at, offset, seconds}]              silences longer than gap_over_s
    range_changes, range_change_list [{at, offset, old, new}]       as {cell_m, cells, range_first_m, range_m, bits}
    missing_sectors     [{from_deg, to_deg, empty_share}]           empty in more than half of the full turns
    repeated_spokes, backward_spokes, stray_azimuths, odd_ranges, clock_steps_back
    summaries           [{text, count}]
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from maritrack.geo import C_MPS
from maritrack.io.cat240.radials import Batch, Radials
from maritrack.io.containers.skim import Skim
from maritrack.io.datagrams import NO_TIME, Stream
from maritrack.io.source import Octets
from maritrack.io.times import DAY_NS, YEAR_NS, time_text
from maritrack.io.turns.counted import Grid
from maritrack.io.turns.spokes import SILENCE, TICK_NS, TURN, DayCount
from maritrack.io.turns.turnbounds import FREE_SCANS, TurnBudget
from maritrack.io.turns.turnclock import middle
from maritrack.io.turns.turncount import TurnCount
from maritrack.types import BoolArray, Damage, FloatArray, IntArray, take

Row = dict[str, Any]
LISTED = 100  # entries of a list
MISSING = 0.5  # of the turns, in which a sector is empty that is called missing
GAP_TURNS = 0.5  # a silence that is longer is a gap
MOST_SENSORS = 64
MAD_TO_SIGMA = 1.4826


def survey(octets: Octets, *, stream: str = "", quick: bool = True) -> Row:
    """What a recording holds, see above. `stream` chooses one of several; `quick` is of no influence on the answer."""
    skim, found = Skim(octets, stream=stream, quick=quick), _Found()
    for batch in skim:
        found.add(batch)
    for sensor in found.sensors.values():
        sensor.turns.finish()
    names = sensor_names(list(found.sensors), skim.streams)
    sensors = [
        _document(sensor, name, skim.streams, found) for sensor, name in zip(found.sensors.values(), names, strict=True)
    ]
    known = {f"{sac}-{sic}" for _, sac, sic in found.sensors}
    damage, times = _damage(found.damage), [found.span(sensor.turns) for sensor in found.sensors.values()]
    warnings = Counter[str]()
    for row in damage:
        warnings[row["code"]] += row["count"]
    return {
        "container": skim.container, "gzipped": skim.gzipped, "octets": max(octets.size, 0), **_times(times),
        "records": sum(row["records"] for row in sensors), "scans": sum(row["scans"] for row in sensors),
        "sensors": sensors,
        "other_streams": [{**stream._asdict(), "datagrams": n} for stream, n in skim.others()],
        "summaries": [{"sensor": who, "text": text, "count": n} for (who, text), n in found.texts.items()
                      if who not in known],
        "damage": damage, "warnings": dict(sorted(warnings.items())),
    }  # fmt: skip


def sensor_names(keys: Sequence[tuple[int, int, int]], streams: Sequence[Stream]) -> list[str]:
    """Ids of sensors (stream, SAC, SIC): "7-42", with an address behind it where another stream has the same."""
    names: list[str] = []
    for stream, sac, sic in keys:
        plain, ends = f"{sac}-{sic}", streams[stream] if stream < len(streams) else Stream()
        there = ends.destination or ends.source or stream
        choice = (plain, f"{plain}@{there}", f"{plain}@{ends.source}>{there}", f"{plain}@{stream}")
        names.append(next((one for one in choice if one not in names), choice[-1]))
    return names


@dataclass(slots=True)
class _Sensor:
    """What one sensor has shown."""

    stream: int
    sac: int
    sic: int
    turns: TurnCount
    records: int = 0
    compressed: int = 0
    packed: int = 0  # octets of cells as sent
    unpacked: int = 0
    timed: int = 0  # records with a time of day
    received: int = 0  # with a receive time

    def add(self, radials: Radials, packed: IntArray) -> None:
        self.turns.push(radials)
        self.records += len(radials)
        self.compressed += int(np.count_nonzero(radials.compressed))
        self.packed += int(packed.sum())
        self.unpacked += int((radials.n_cells * radials.bits + 7 >> 3).sum())
        self.timed += int(np.count_nonzero(radials.tod >= 0))
        self.received += int(np.count_nonzero(radials.t_ns != NO_TIME))


@dataclass(slots=True)
class _Found:
    """What the recording has shown so far."""

    sensors: dict[tuple[int, int, int], _Sensor] = field(default_factory=dict)  # in order of appearance
    damage: dict[tuple[str, str], Damage] = field(default_factory=dict)  # by code and sensor; their number in it
    texts: Counter[tuple[str, str]] = field(default_factory=Counter)
    days: list[DayCount] = field(default_factory=list)
    budget: TurnBudget = field(default_factory=TurnBudget)
    midnight_ns: int | None = None  # of the first day; None = not known

    def add(self, batch: Batch) -> None:
        for damage in batch.damage:
            self._add_damage(damage)
        for text in batch.texts:
            said = (text.sensor, text.text.decode("ascii", errors="replace"))
            if said in self.texts or len(self.texts) < LISTED:
                self.texts[said] += 1
        radials = batch.radials
        if radials is None or batch.packed is None:
            return
        if self.midnight_ns is None:
            self.midnight_ns = _first_midnight_ns(radials)
        for rows in _rows_by_sensor(radials):
            row = 0 if rows is None else int(rows[0])
            key = (int(radials.stream[row]), int(radials.sac[row]), int(radials.sic[row]))
            if key not in self.sensors and len(self.sensors) >= MOST_SENSORS:
                name, n = f"{key[1]}-{key[2]}", len(radials) if rows is None else len(rows)
                message = f"more than {MOST_SENSORS} sensors: {name} is left out"
                self._add_damage(Damage("too-many-sensors", int(radials.offset[row]), message, name, n))
                continue
            one, packed = (radials, batch.packed) if rows is None else (take(radials, rows), batch.packed[rows])
            if key not in self.sensors:
                self.days.append(DayCount(others=self.days[:]))
                turns = TurnCount(self.days[-1], free_scans=FREE_SCANS // len(self.days), budget=self.budget)
                self.sensors[key] = _Sensor(*key, turns)
            self.sensors[key].add(one, packed)

    def _add_damage(self, damage: Damage) -> None:
        key = (damage.code, damage.sensor)
        first = self.damage.get(key)
        self.damage[key] = damage if first is None else replace(first, count=first.count + damage.count)

    def at(self, t_ns: int | None) -> str | None:
        """The text of a time that counts from the first midnight."""
        return None if t_ns is None else time_text(t_ns + (self.midnight_ns or 0))

    def span(self, turns: TurnCount) -> tuple[int | None, int | None]:
        """First and last time of a sensor."""
        midnight_ns = self.midnight_ns or 0
        first_ns, last_ns = turns.first_ns, turns.last_ns
        return (
            None if first_ns is None else first_ns + midnight_ns,
            None if last_ns is None else last_ns + midnight_ns,
        )


def _rows_by_sensor(r: Radials) -> list[IntArray | None]:
    """Rows of each sensor, in order of appearance; None = all rows are of one sensor."""
    if (r.sic == r.sic[0]).all() and (r.sac == r.sac[0]).all() and (r.stream == r.stream[0]).all():
        return [None]
    key = r.stream << 16 | r.sac << 8 | r.sic
    order = np.argsort(key, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(key[order])) + 1)
    return [*sorted(groups, key=lambda rows: int(rows[0]))]


def _first_midnight_ns(r: Radials) -> int | None:
    """The midnight from which times of day count, by the first receive time that has a date; None where none has."""
    dated: BoolArray = (r.t_ns >= YEAR_NS) & (r.t_ns != NO_TIME)
    if not dated.any():
        return None
    row = int(np.argmax(dated))
    came_ns, tod = int(r.t_ns[row]), int(r.tod[row])
    tod_ns = tod * TICK_NS if tod >= 0 else came_ns % DAY_NS
    return (came_ns - tod_ns + DAY_NS // 2) // DAY_NS * DAY_NS


def _document(one: _Sensor, name: str, streams: Sequence[Stream], found: _Found) -> Row:
    turns = one.turns
    ends = streams[one.stream] if one.stream < len(streams) else Stream()
    period_s = turns.clock.periods_s()
    period = middle(period_s) if len(period_s) else None
    first_ns, last_ns = found.span(turns)
    compression = "none" if one.compressed == 0 else "zlib" if one.compressed == one.records else "mixed"
    return {
        "id": name, "sac": one.sac, "sic": one.sic, **ends._asdict(), "records": one.records, "spokes": turns.spokes,
        "first_time": None if first_ns is None else time_text(first_ns),
        "last_time": None if last_ns is None else time_text(last_ns),
        "duration_s": None if first_ns is None or last_ns is None else (last_ns - first_ns) * 1e-9,
        "clock": "time of day" if one.timed else "receive time" if one.received else "none",
        "scans": turns.scans, **_rotation(turns, period, period_s), **_grid(turns.grids.most_common(1)[0][0]),
        "header": "femto" if turns.grids.most_common(1)[0][0].setting.femto else "nano",
        "range_scales": len({grid.setting for grid in turns.grids}),
        "compression": compression,
        "compression_ratio": one.packed / one.unpacked if one.compressed and one.unpacked else None,
        "lost_records": turns.lost, "losses": turns.n_losses,
        "loss_list": [{"at": found.at(loss.t_ns), "offset": loss.offset, "records": loss.records}
                      for loss in turns.losses[:LISTED]],
        **_gaps(turns, period, found),
        "range_changes": turns.n_changes,
        "range_change_list": [
            {"at": found.at(change.t_ns), "offset": change.offset, "old": _grid(change.old), "new": _grid(change.new)}
            for change in turns.changes[:LISTED]
        ],
        "missing_sectors": [{"from_deg": lo, "to_deg": hi, "empty_share": share}
                            for lo, hi, share in turns.sectors.missing(MISSING)],
        "repeated_spokes": turns.repeated, "backward_spokes": min(turns.forward, turns.backward),
        "stray_azimuths": turns.stray, "odd_ranges": turns.odd, "clock_steps_back": turns.set_back,
        "summaries": [{"text": text, "count": n} for (who, text), n in found.texts.items()
                      if who == f"{one.sac}-{one.sic}"],
    }  # fmt: skip


def _rotation(turns: TurnCount, period: float | None, period_s: FloatArray) -> Row:
    """Period and spokes of the full turns."""
    spokes = np.array(turns.full_turns, dtype=np.int64)
    near = period_s[np.abs(period_s - (period or 0.0)) <= GAP_TURNS * (period or 0.0)]
    return {
        "period_s": period,
        "period_jitter_s": float(near.std()) if len(near) else None,
        "period_spread_s": MAD_TO_SIGMA * middle(np.abs(period_s - period)) if period else None,
        "period_least_s": float(period_s.min()) if period else None,
        "period_most_s": float(period_s.max()) if period else None,
        "rotation_rpm": 60.0 / period if period else None,
        "spokes_per_turn": int(middle(spokes)) if len(spokes) else None,
        "spokes_least": int(spokes.min()) if len(spokes) else None,
        "spokes_most": int(spokes.max()) if len(spokes) else None,
        "spoke_width_deg": turns.width * 360.0 / TURN,
    }


def _grid(grid: Grid) -> Row:
    """Where the cells of a spoke lie."""
    s = grid.setting
    cell_m = s.cell_dur * (1e-15 if s.femto else 1e-9) * C_MPS / 2
    return {
        "cell_m": cell_m, "cells": grid.n_cells, "range_first_m": s.start_rg * cell_m,
        "range_m": (s.start_rg + grid.n_cells) * cell_m, "bits": s.bits,
    }  # fmt: skip


def _gaps(turns: TurnCount, period: float | None, found: _Found) -> Row:
    """Silences that are too long. What happens in most turns is none: a blanked sector, a clock of whole seconds."""
    limit = SILENCE * TICK_NS * 1e-9 if period is None else GAP_TURNS * period
    gaps = [pause for pause in turns.pauses() if pause.ticks * TICK_NS * 1e-9 > limit]
    if period is not None and 2 * len(gaps) > max(turns.scans, 2):
        limit += period
        gaps = [pause for pause in gaps if pause.ticks * TICK_NS * 1e-9 > limit]
    return {
        "gaps": len(gaps), "gap_over_s": limit,
        "gap_list": [{"at": found.at(gap.t_ns), "offset": gap.offset, "seconds": gap.ticks * TICK_NS * 1e-9}
                     for gap in gaps[:LISTED]],
    }  # fmt: skip


def _damage(damage: dict[tuple[str, str], Damage]) -> list[Row]:
    """What is wrong with the octets, in the order in which it begins."""
    return [
        {"code": one.code, "sensor": one.sensor, "count": one.count, "offset": one.offset, "message": one.message}
        for one in sorted(damage.values(), key=lambda one: (one.offset, one.code, one.sensor))
    ]


def _times(spans: Sequence[tuple[int | None, int | None]]) -> Row:
    """The time that all sensors together cover."""
    first_ns = min((first for first, _ in spans if first is not None), default=None)
    last_ns = max((last for _, last in spans if last is not None), default=None)
    if first_ns is None or last_ns is None:
        return {"from": None, "to": None, "duration_s": None}
    return {"from": time_text(first_ns), "to": time_text(last_ns), "duration_s": (last_ns - first_ns) * 1e-9}
