"""From files or an archive to frames: what kind of input it is, where its sensors are, what is true."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from maritrack import geo
from maritrack.errors import InputError, UsageError
from maritrack.imagesettings import ImageConfig
from maritrack.io import sniff
from maritrack.io.autoferry import AutoferrySource
from maritrack.io.carriers import carriers_of, fixed_origin, own_ship, platform, pose_of
from maritrack.io.cat240_source import Cat240Source
from maritrack.io.documents import read_document
from maritrack.io.fuse import in_steps, merge_sources, united
from maritrack.io.images.source import ImageSource
from maritrack.io.octets import octets_from_file, octets_from_stdin
from maritrack.io.plots import PlotSource
from maritrack.io.pointjson import PointSource
from maritrack.io.pose import PoseTrack
from maritrack.io.reference import Reference, only
from maritrack.io.rwmr.source import RwmrSource
from maritrack.io.sensors import calibrated, check_calibration, check_sensors, for_input, parse_sensors
from maritrack.io.source import Octets, Source
from maritrack.io.times import YEAR_NS
from maritrack.io.truth import document_kind, document_origin, find_truth, read_reference
from maritrack.rwmrsettings import RwmrConfig
from maritrack.settings import Config, InputConfig, parse_ids
from maritrack.types import Damage, Frame, Origin

PRESET_OF_KIND = {"cat240": "radar", "points": "points", "plots": "plots", "autoferry": "autoferry",
                  "images": "dataset", "rwmr": "dataset"}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """An input that is ready to run."""

    kinds: tuple[str, ...]
    frames: Iterator[Frame]
    origin: Origin | None
    reference: Reference | None
    side: Mapping[str, bytes]  # documents that replay needs besides the input: "truth", "own-ship", "sensors", ...
    damage: tuple[Damage, ...]  # of the side documents, one a code
    calibrated: tuple[str, ...] = ()  # what a calibration names: no input, so a sensor, if there is one of that name


def kinds_of(octets: Sequence[Octets]) -> tuple[str, ...]:
    """What each input is, by its content."""
    return tuple(sniff(o.head, o.name) for o in octets)


def open_inputs(paths: Sequence[Path]) -> list[Octets]:
    """The octets of files, pipes or standard input (-), each with its channel in the archive."""
    if not paths:
        raise UsageError("no input")
    if sum(str(path) == "-" for path in paths) > 1:
        raise UsageError("standard input can be read once only")
    first = [octets_from_stdin() if str(path) == "-" else octets_from_file(path, "") for path in paths]
    kinds = kinds_of(first)
    several = len(paths) > 1
    return [
        replace(o, channel=f"/input/{kind}-{i}" if several else f"/input/{kind}")
        for i, (o, kind) in enumerate(zip(first, kinds, strict=True))
    ]


def side_documents(
    paths: Sequence[Path],
    *,
    truth: Path | None,
    own_ship: Path | None,
    sensors: Path | None,
    no_truth: bool = False,
    calibration: Path | None = None,
    background: Path | None = None,
) -> dict[str, bytes]:
    """The documents beside the input, as octets; truth beside a recording is found by itself."""
    found = None if no_truth else truth or (find_truth(paths[0]) if len(paths) == 1 else None)
    named = {"truth": found, "own-ship": own_ship, "sensors": sensors, "calibration": calibration,
             "background": background}  # fmt: skip
    documents = {}
    for name, path in named.items():
        if path is not None:
            documents[name] = read_document(path, packed=name in ("truth", "own-ship"))
            if name == "sensors":
                check_sensors(documents[name], name=str(path))
            if name == "calibration":
                check_calibration(documents[name], name=str(path))
            kind = document_kind(documents[name], name=str(path)) if name in ("truth", "own-ship") else ""
            if kind in ("cat240", "plots"):
                raise InputError(f"{path}: a recording ({kind}), no reference positions")
    if sensors is not None or calibration is not None:  # they may name sensors by the stems of their files
        documents["names"] = "\n".join(path.stem for path in paths).encode()
    return documents


def default_preset(kinds: Sequence[str]) -> str:
    """The preset that fits the content."""
    if len(set(kinds)) > 1:
        raise UsageError(f"inputs of different kinds ({', '.join(sorted(set(kinds)))}) in one run")
    if kinds[0] not in PRESET_OF_KIND:
        raise InputError("reference positions, not a recording", hint="pass them with --truth")
    return PRESET_OF_KIND[kinds[0]]


def open_recording(
    octets: Sequence[Octets],
    kinds: Sequence[str],
    side: Mapping[str, bytes],
    config: Config,
    *,
    strict: bool = False,
    workers: int = 1,
) -> Recording:
    """Sources, poses and truth of the inputs, merged by time. Several `workers` are processes that inflate video.

    The origin is the fixed radar's position, else that of the truth document, else own ship's first position, else
    that of the first sensor that has one. The one ship that carries the radar is no truth, unless it is asked for.
    """
    settings, sensors = config.input, sensors_of(side, config.input)
    origin = fixed_origin(settings) or document_origin(side.get("truth", b""))
    carriers = carriers_of(side, (settings, *sensors.values()), origin)
    ais = None if carriers else own_ship(side, settings, origin)
    for known in (*carriers.values(), ais):
        origin = known.origin if origin is None and known is not None else origin
    origin = origin or next(filter(None, map(fixed_origin, sensors.values())), None)
    reference: Reference | None = None
    if "truth" in side:
        if kinds[0] == "autoferry" and origin is None:
            origin = AutoferrySource.origin
        reference = read_reference(side["truth"], name="truth", origin=origin, date=settings.date, rwmr=config.rwmr)
        others = tuple(i for i in reference.ids if i != settings.own_ship)
        reference = only(reference, parse_ids(config.score.truth_match) or others)
        settings = dated(settings, reference)
    sensors = sensors_of(side, settings)
    ships = {name: pose_of(document) for name, document in carriers.items()}
    place = _Place(
        settings, sensors, platform(ais, settings, origin), ships, origin, strict, workers, config.images, config.rwmr
    )
    sources = [place.source(kind, o) for kind, o in zip(kinds, octets, strict=True)]
    merged: Source = sources[0] if len(sources) == 1 else merge_sources(sources)
    if reference is None and (held := getattr(merged, "reference", None)) is not None:
        reference = only(held, parse_ids(config.score.truth_match))
    wrong = reference.damage if reference is not None else ()
    damage = tuple(replace(item, code=f"truth-{item.code}") for item in wrong)
    stepped = united(in_steps(merged.frames(), settings.step_s), settings.unite)
    frames = nonempty(windowed(stepped, settings), sources, octets)
    damage += tuple(remark for source in sources for remark in getattr(source, "remarks", ()))
    named = unclaimed(side, settings, octets, kinds)
    if not {"cat240", "points"} & set(kinds):  # an input is one sensor, whatever its scans are called
        damage += tuple(
            Damage("calibration-unused", -1, f"the calibration of {name!r} was of no use: no input has that name", name)
            for name in named
        )
        named = ()
    return Recording(tuple(kinds), frames, merged.origin or origin, reference, side, damage, named)


def sensors_of(side: Mapping[str, bytes], settings: InputConfig) -> Mapping[str, InputConfig]:
    """Settings of single sensors over those of the run, and what a calibration says of them over these."""
    texts = {name: side[name].decode("utf-8", "replace") for name in ("sensors", "calibration") if name in side}
    sensors: Mapping[str, InputConfig] = {}
    if "sensors" in texts:
        sensors = parse_sensors(texts["sensors"], name="sensors", base=settings)
    if "calibration" in texts:
        sensors = calibrated(sensors, texts["calibration"], name="calibration", base=settings)
    return sensors


def unclaimed(
    side: Mapping[str, bytes], settings: InputConfig, octets: Sequence[Octets], kinds: Sequence[str]
) -> tuple[str, ...]:
    """What a calibration names that is no input: the stem of one, or the one sensor of points."""
    if "calibration" not in side:
        return ()
    text = side["calibration"].decode("utf-8", "replace")
    names = calibrated({}, text, name="calibration", base=settings)
    claimed = {Path(one.name).stem for one in octets}
    claimed |= {settings.sensor or "radar" for kind in kinds if kind != "cat240"}
    return tuple(sorted(set(names) - claimed))


def dated(settings: InputConfig, reference: Reference) -> InputConfig:
    """Settings with the day of the first report of the truth, where nothing else tells the day."""
    if settings.date or len(reference.t_ns) == 0 or reference.t_ns.min() < YEAR_NS:
        return settings
    day = np.datetime64(int(reference.t_ns.min()), "ns").astype("datetime64[D]")
    return replace(settings, date=str(day))


def nonempty(frames: Iterator[Frame], sources: Sequence[Source], octets: Sequence[Octets]) -> Iterator[Frame]:
    """The frames; InputError where there is none, with what was wrong instead."""
    found = False
    for frame in frames:
        found = True
        yield frame
    if not found:
        wrong = [d.code for source in sources for d in getattr(source, "unclaimed", ())]
        said = f": {', '.join(dict.fromkeys(wrong))}" if wrong else ""
        raise InputError(f"{', '.join(o.name for o in octets)}: no scan in it{said}")


@dataclass(frozen=True, slots=True)
class _Place:
    """What sources need to know besides their octets."""

    settings: InputConfig
    sensors: Mapping[str, InputConfig]
    pose: PoseTrack | None
    ships: Mapping[str, PoseTrack]  # that settings name as carriers
    origin: Origin | None
    strict: bool
    workers: int
    images: ImageConfig
    rwmr: RwmrConfig

    def source(self, kind: str, octets: Octets) -> Source:
        """The source of one input."""
        stem = Path(octets.name).stem
        one = "" if kind == "cat240" else self.settings.sensor or "radar"
        settings = for_input(self.sensors, stem, base=self.settings, sensor=one)
        if kind == "cat240":
            poses = {name: pose for name, own in self.sensors.items() if (pose := self._pose(own)) is not None}
            return Cat240Source(
                octets, settings, pose=self._pose(settings), origin=self.origin, strict=self.strict,
                workers=self.workers, sensor_configs=self.sensors, sensor_poses=poses,
            )  # fmt: skip
        if kind == "points":
            return PointSource(octets, settings, strict=self.strict, sensor_configs=self.sensors)
        if kind == "autoferry":
            return AutoferrySource(octets, settings, sensors=self.sensors, strict=self.strict)
        if kind == "images":
            pose = self._pose(settings)
            return ImageSource(octets, settings, self.images, pose=pose, origin=self.origin, strict=self.strict)
        if kind == "rwmr":
            pose = self._pose(settings) if settings.own_ship or self.pose is not None else None
            return RwmrSource(octets, settings, self.rwmr, pose=pose, origin=self.origin, strict=self.strict)
        if kind == "plots":
            pose = self._pose(settings)
            return PlotSource(octets, settings, pose=pose, origin=self.origin, strict=self.strict)
        raise InputError(f"{octets.name}: {kind} is a reference, not a recording", hint="pass it with --truth")

    def _pose(self, settings: InputConfig) -> PoseTrack | None:
        """A sensor is aboard the ship that its settings name, or stands where they place it, or is on the platform."""
        if settings.own_ship:
            return self.ships[settings.own_ship]
        own, origin = fixed_origin(settings), self.origin
        if own is None or origin is None or own == origin:
            return self.pose
        at = geo.geodetic_to_en(origin, np.array([own.lat_deg]), np.array([own.lon_deg]))
        return PoseTrack.fixed((float(at[0, 0]), float(at[0, 1])))


def windowed(frames: Iterator[Frame], settings: InputConfig) -> Iterator[Frame]:
    """The frames from `from_s` to `to_s` after the first, at most `limit`, numbered from 0.

    Octets and damage of frames before the window go with its first frame, so that an archive keeps them.
    """
    first_ns, k = None, 0
    octets: tuple[tuple[str, bytes], ...] = ()
    damage: tuple[Damage, ...] = ()
    for frame in frames:
        first_ns = frame.t_ns if first_ns is None else first_ns
        since_s = (frame.t_ns - first_ns) * 1e-9
        if since_s > settings.to_s or (settings.limit and k >= settings.limit):
            return
        octets, damage = octets + frame.inputs, damage + frame.damage
        if since_s < settings.from_s:
            continue
        yield replace(frame, k=k, inputs=octets, damage=damage)
        octets, damage, k = (), (), k + 1
