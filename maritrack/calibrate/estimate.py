"""`calibrate` as people ask for it: recordings and a truth in, offsets of sensors and lags of ships out."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from maritrack import retrospect
from maritrack.calibrate.fit import LATE_S, LATE_SIGMAS, Fit, first_guess, fit
from maritrack.calibrate.pieces import whole_ships
from maritrack.calibrate.search import LEAST_SCANS, Span, search
from maritrack.calibrate.sightings import BIAS_SHARE, Radar, Sightings, Way, as_seen, sightings_of, ways_of
from maritrack.chain import build_chain, process
from maritrack.errors import UsageError
from maritrack.io.reference import Reference, Reports, build_reference
from maritrack.io.sensors import for_input
from maritrack.io.source import Octets
from maritrack.objects import matrix2
from maritrack.recording import Recording, open_recording, sensors_of
from maritrack.settings import Config, InputConfig
from maritrack.types import BoolArray, Frame

MAX_GAP_TRACK_S = 10.0  # between two rows of a track of the radar that stands for the truth
BIAS_TRACK_M = 5.0  # at least, between the echoes of a ship in two radars
LEAST_HITS, LEAST_HIT_SHARE, MOST_UNSTEADY = 15, 0.6, 0.15  # of a track that stands for a ship; spread of its speed
LEAST_SHIPS = 3  # that a calibration between radars rests on


@dataclass(frozen=True, slots=True)
class SensorResult:
    """A sensor's settings as they should be, with standard deviations."""

    key: str  # in a file of sensors
    azimuth_offset_deg: float
    azimuth_sigma_deg: float
    range_offset_m: float
    range_sigma_m: float
    latency_s: float
    latency_sigma_s: float
    ships: int
    associations: int
    rms_m: float  # of residuals


@dataclass(frozen=True, slots=True)
class ShipResult:
    """How late the reports of a ship are."""

    id: str
    name: str
    lag_s: float
    lag_sigma_s: float
    late: bool  # significantly: it goes into the file
    associations: int


@dataclass(frozen=True, slots=True)
class Calibration:
    """What came out."""

    against: str  # "truth", or the sensor whose tracks stood for it
    sensors: tuple[SensorResult, ...]
    ships: tuple[ShipResult, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _One:
    """A sensor of an input, ready to compare."""

    key: str
    sightings: Sightings
    settings: InputConfig
    given: str  # the key that its settings are given under, "" = under none


def calibrate(
    octets: Sequence[Octets], kinds: Sequence[str], side: Mapping[str, bytes], config: Config, span: Span
) -> Calibration:
    """Offsets of all sensors against the truth; without one, of all others against the tracks of the first.

    UsageError where there is too little to tell them.
    """
    if len(octets) == 1 or "truth" in side:
        return _against_truth(octets, kinds, side, config, span)
    return _against_first(octets, kinds, side, config, span)


def _against_truth(
    octets: Sequence[Octets], kinds: Sequence[str], side: Mapping[str, bytes], config: Config, span: Span
) -> Calibration:
    sensors: list[_One] = []
    reference: Reference | None = None
    for one, kind in zip(octets, kinds, strict=True):
        recording = open_recording([one], [kind], side, config)
        if recording.reference is None:
            raise UsageError(f"{one.name}: no truth to compare with", hint="pass AIS with --truth, or a second radar")
        reference = reference or recording.reference
        sensors += _sensors(recording.frames, one, kind, side, config)
    assert reference is not None
    known = partial(ways_of, reference, max_gap_s=config.score.max_gap_moving_s, bias_m={})
    return _told("truth", _named(sensors, octets), known, span, lags=True)


def _against_first(
    octets: Sequence[Octets], kinds: Sequence[str], side: Mapping[str, bytes], config: Config, span: Span
) -> Calibration:
    first = open_recording(octets[:1], kinds[:1], side, config)
    reference, bias_m, radar = tracks_as_truth(first, config)
    sensors: list[_One] = []
    for one, kind in zip(octets[1:], kinds[1:], strict=True):
        frames = open_recording([one], [kind], side, config).frames
        sensors += _sensors(frames, one, kind, side, config)
    known = partial(ways_of, reference, max_gap_s=MAX_GAP_TRACK_S, bias_m=bias_m, radar=radar)
    return _told(Path(octets[0].name).stem, _named(sensors, octets), known, span, lags=False)


def tracks_as_truth(recording: Recording, config: Config) -> tuple[Reference, dict[str, float], Radar]:
    """The tracks of a recording that move, in hindsight, as ships with reports, how far off their echoes may lie, and
    where the radar was that saw them.

    They are made of all points, as the clusters are that they are compared with: a background that follows a hull
    eats its stern, and the map does not know a ship that is slow. Instead they have to be long-lived and steady.
    """
    rules = replace(
        config, subtract=replace(config.subtract, method="none"), clutter_map=replace(config.clutter_map, method="none")
    )
    chain = build_chain(rules)
    state, rows, pose_ns, pose_m = chain.init(), [], [], []
    for frame in recording.frames:
        state, result = process(chain, state, frame)
        rows.append((frame.k, result.tracks))
        pose_ns.append((frame.scan.t_ns + frame.scan.t_start_ns) // 2)
        pose_m.append(frame.scan.position_m)
    history = retrospect.hindsight(retrospect.gather(rows), rules)
    under_way = history.rows(history.tracks.moving)
    moving = whole_ships(under_way.rows(steady(under_way))).tracks
    ids, ship = np.unique(moving.id, return_inverse=True)
    unknown = np.full(len(ids), math.nan)
    reports = Reports(ship, moving.t_ns, moving.position_m, moving.velocity_mps, np.full(len(moving), math.nan))
    names = [f"T{i}" for i in ids.tolist()]
    half_m = np.sqrt(np.maximum(matrix2.eigen(moving.extent_m2)[0][:, 0], 0.0))
    length_m = [2.0 * float(np.median(half_m[ship == i])) for i in range(len(ids))]
    bias_m = {name: max(BIAS_SHARE * length, BIAS_TRACK_M) for name, length in zip(names, length_m, strict=True)}
    told = build_reference(reports, ids=names, names=names, length_m=unknown, width_m=unknown, complete=False)
    order = np.argsort(pose_ns, kind="stable")
    return told, bias_m, Radar(np.array(pose_ns, np.int64)[order], np.array(pose_m).reshape(-1, 2)[order])


def steady(history: retrospect.History) -> BoolArray:
    """Rows (m,) of tracks that live long, are hit in most scans and keep their speed: ships, not what flickers.

    For most of their lives (median deviation from the median): a ship may get under way or go to her berth, and the
    echo of a long hull slides from bow to stern as it passes.
    """
    tracks = history.tracks
    _, first, group, n = np.unique(tracks.id, return_index=True, return_inverse=True, return_counts=True)
    hit = np.bincount(group, tracks.cluster >= 0)
    speed_mps = np.hypot(tracks.velocity_mps[:, 0], tracks.velocity_mps[:, 1])
    typical = retrospect.median(speed_mps, first, group)
    spread = 1.4826 * retrospect.median(np.abs(speed_mps - typical[group]), first, group)
    good = (hit >= LEAST_HITS) & (hit >= LEAST_HIT_SHARE * n) & (spread <= MOST_UNSTEADY * typical)
    return np.asarray(good[group])


def _sensors(frames: Iterable[Frame], one: Octets, kind: str, side: Mapping[str, bytes], config: Config) -> list[_One]:
    """The sensors of an input, with the settings that they were read with."""
    given = sensors_of(side, config.input)
    seen = sightings_of(frames, config)
    stem = Path(one.name).stem
    if kind != "cat240" and len(seen) > 1:
        raise UsageError(f"{one.name}: {len(seen)} sensors in one document", hint="choose one with --sensor")
    found = []
    for sensor, sightings in seen.items():
        base = for_input(given, stem, base=config.input, sensor=sensor)
        settings = given.get(sensor, base)
        under = next((name for name in (sensor, stem) if name in given), "")
        found.append(_One(f"{stem}\n{sensor}", sightings, settings, under))
    return found


def _named(sensors: Sequence[_One], octets: Sequence[Octets]) -> list[_One]:
    """Each under the key that a file of sensors has for it: its id, or the input's stem where several share the id.

    Under the key that its settings are given under, if they are, so that a calibration is laid over them.
    """
    ids = [one.key.partition("\n")[2] for one in sensors]
    named = []
    for one, id_ in zip(sensors, ids, strict=True):
        alone = ids.count(id_) == 1 and (len(octets) == 1 or len(set(ids)) > 1)
        key = id_ if alone else one.key.partition("\n")[0]
        named.append(replace(one, key=one.given or key))
    return named


def _told(
    against: str, sensors: Sequence[_One], known: Callable[[int], list[Way]], span: Span, *, lags: bool
) -> Calibration:
    """What comes out for each sensor against the ways that are known, in seconds since a time."""
    results, lag_rows = [], []
    for one in sensors:
        ways = [as_seen(way, one.sightings) for way in known(one.sightings.start_ns)]
        found, which = fitted(one.key, one.sightings, ways, span, lags=lags)
        results.append(_sensor_result(one, found, which))
        lag_rows += [(way, found, i) for i, way in enumerate(which)] if lags else []
    return Calibration(against, tuple(results), _ship_results(lag_rows))


def fitted(name: str, sightings: Sightings, ways: list[Way], span: Span, *, lags: bool) -> tuple[Fit, tuple[Way, ...]]:
    """The fit of one sensor and the ships that it rests on. UsageError where they are too few."""
    start = search(sightings, ways, span)
    if start.n_candidates == 0:
        raise UsageError(
            f"{name}: no ship of the truth is under way within {sightings.reach_m:.0f} m of it for "
            f"{LEAST_SCANS} scans", hint="another day, place or clock?",
        )  # fmt: skip
    if not start.ways:
        raise UsageError(
            f"{name}: none of {start.n_candidates} ships under way is seen often enough at any one offset",
            hint="search wider with --search-azimuth, --search-range and --search-time",
        )
    found = fit(sightings, start.ways, first_guess(start.azimuth_rad, start.range_m, np.array(start.late_s)), lags=lags)
    if int(found.used.sum()) < LEAST_SCANS:
        raise UsageError(f"{name}: {int(found.used.sum())} associations with ships under way are too few")
    ships = int((found.used >= LEAST_SCANS).sum())
    if any(way.seen_from_m is not None for way in start.ways) and ships < LEAST_SHIPS:
        raise UsageError(
            f"{name}: not enough ships: {ships} under way that both radars see, {LEAST_SHIPS} are needed",
            hint="a longer recording, or AIS with --truth",
        )
    return found, start.ways


def _sensor_result(one: _One, found: Fit, ways: tuple[Way, ...]) -> SensorResult:
    """The settings that the sensor was read with and what is to be added."""
    return SensorResult(
        key=one.key,
        azimuth_offset_deg=one.settings.azimuth_offset_deg + math.degrees(found.value[0]),
        azimuth_sigma_deg=math.degrees(found.sigma(0)),
        range_offset_m=one.settings.range_offset_m + float(found.value[1]), range_sigma_m=found.sigma(1),
        latency_s=one.settings.latency_s + float(found.value[2]), latency_sigma_s=found.sigma(2),
        ships=int((found.used > 0).sum()), associations=int(found.used.sum()), rms_m=found.rms_m,
    )  # fmt: skip


def _ship_results(rows: Sequence[tuple[Way, Fit, int]]) -> tuple[ShipResult, ...]:
    """The lag of each ship: the mean of what the sensors say, by their variances."""
    by_id: dict[str, list[tuple[Way, Fit, int]]] = {}
    for row in rows:
        by_id.setdefault(row[0].id, []).append(row)
    ships = []
    for id_, told in sorted(by_id.items()):
        weight = np.array([1.0 / (found.lag_sigma_s[i] ** 2) for _, found, i in told])
        lag = float(weight @ np.array([found.shift_s[i] + found.value[2] for _, found, i in told]) / weight.sum())
        sigma = float(1.0 / math.sqrt(weight.sum()))
        late = abs(lag) > LATE_S and abs(lag) > LATE_SIGMAS * sigma
        used = sum(int(found.used[i]) for _, found, i in told)
        ships.append(ShipResult(id_, told[0][0].name, lag, sigma, late, used))
    return tuple(ships)
