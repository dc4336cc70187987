"""What a run of a sweep reads: a recording by path or URL with the documents beside it, or a scene to be simulated."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from glob import glob
from pathlib import Path

from maritrack.errors import InputError, UsageError
from maritrack.io.documents import read_document, unpacked
from maritrack.io.images.pack import SIDE_NAMES, pack_folder
from maritrack.io.octets import octets_from_file
from maritrack.io.remote import exists, is_url, matching, octets_from_url, read_url, size_of, token_of
from maritrack.io.source import Octets
from maritrack.io.truth import document_kind, truth_names
from maritrack.recording import PRESET_OF_KIND, kinds_of, side_documents
from maritrack.simulate.campaign import Campaign
from maritrack.simulate.campaignwriter import simulate_campaign
from maritrack.simulate.lidarscene import LidarScene, simulate_lidar
from maritrack.simulate.pointscene import PointScene, simulate_points
from maritrack.simulate.record import simulate
from maritrack.simulate.scenes import Scene, load_any, scene_names


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """An input as it is asked for. Paths and URLs are those that the workers see."""

    name: str  # path or URL of a recording; name or path of a scene
    scene: bool = False
    scans: int = 0  # of a scene; 0 = as many as it has
    truth: str = ""  # "" = what lies beside the recording
    own_ship: str = ""
    folder: str = ""  # that relative paths are of; "" = where the process stands, as all on one machine do


@dataclass(frozen=True, slots=True)
class Known:
    """What an input turned out to be."""

    kind: str
    sha256: str  # of a scene: of what it shows, without the noise
    side: Mapping[str, str]  # SHA-256 of the documents beside it, by name
    error: str = ""  # why it can't be read
    stamp: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Opened:
    """An input that is ready to be read."""

    octets: Octets
    kind: str
    side: Mapping[str, bytes]


def named(
    names: Sequence[str], *, scans: int = 0, truth: Sequence[str] = (), own_ship: Sequence[str] = (), folder: str = ""
) -> tuple[Source, ...]:
    """The inputs of these names; `truth` and `own_ship` are none or one for each. A scene is a name or a .toml file."""
    for option, given in (("--truth", truth), ("--own-ship", own_ship)):
        if given and len(given) != len(names):
            raise UsageError(f"{len(given)} {option} for {len(names)} inputs", hint="one for each, in their order")
    if "-" in names:
        raise UsageError("a sweep reads its inputs more than once: no standard input")
    known = scene_names()
    scenes = [name.endswith(".toml") or (name in known and not Path(name).exists()) for name in names]
    if scans and not all(scenes):
        other = names[scenes.index(False)]
        hint = f"--limit is of recordings; scenes: {', '.join(known)}"
        raise UsageError(f"--scans is of scenes, {other} is none", hint=hint)
    return tuple(
        Source(
            name=name, scene=scene, scans=scans, truth=truth[i] if truth else "",
            own_ship=own_ship[i] if own_ship else "", folder=folder,
        )
        for i, (name, scene) in enumerate(zip(names, scenes, strict=True))
    )  # fmt: skip


def recordings(places: Sequence[str]) -> tuple[list[str], list[str]]:
    """Recordings in folders, of patterns (`radar/*.cat240`, of URLs as well) and by name; and files that are none.

    What lies in a folder is told by content; truth that lies beside a recording is no recording, and a folder of the
    DLR data set or of pictures alone is one. UsageError where a place holds none.
    """
    found: list[str] = []
    others: list[str] = []
    for place in places:
        if is_url(place):
            names = matching(place) if "*" in place else [place]
        elif Path(place).is_dir():
            names, left = _inside(Path(place))
            others += left
        else:
            names = [place] if Path(place).exists() or not set(place) & set("*?[") else sorted(glob(place))
        if not names:
            raise UsageError(f"{place}: no recording there")
        found += names
    return list(dict.fromkeys(found)), others


def _inside(folder: Path) -> tuple[list[str], list[str]]:
    """Recordings in a folder, folders that are one among them, or the folder itself; and files that are none."""
    pack, entries = pack_folder(folder), sorted(folder.iterdir())
    if pack is not None and any(name.lower() in SIDE_NAMES[:2] for name in pack.names):
        return [str(folder)], []
    files = [str(path) for path in entries if path.is_file()]
    beside = {str(Path(file).with_name(name)) for file in files for name in truth_names(Path(file).name)}
    beside |= {file for file in files if Path(file).name.lower() in SIDE_NAMES}
    found = [file for file in files if file not in beside and _is_recording(file)]
    found += [str(path) for path in entries if path.is_dir() and pack_folder(path) is not None]
    if pack is not None and not found:
        return [str(folder)], []
    return sorted(found), [file for file in files if file not in found]


def _is_recording(name: str) -> bool:
    try:
        return kinds_of([octets_from_file(Path(name), "")])[0] in PRESET_OF_KIND
    except InputError:
        return False


def _placed(source: Source) -> Source:
    """The source with paths that do not depend on where the process stands; names of scenes stay."""

    def at(name: str, *, scene: bool = False) -> str:
        path = Path(source.folder, name)
        return name if not name or is_url(name) or (scene and not path.exists()) else str(path)

    if not source.folder:
        return source
    name = at(source.name, scene=source.scene)
    return replace(source, name=name, truth=at(source.truth), own_ship=at(source.own_ship), folder="")


def octets_in(source: Source) -> int:
    """Size of a recording, -1 where nobody tells it."""
    try:
        return size_of(source.name) if is_url(source.name) else Path(source.name).stat().st_size
    except (OSError, InputError):
        return -1


def examine(source: Source) -> Known:
    """Kind and digests of an input; it is read once, in pieces. InputError where it can't be read."""
    source = _placed(source)
    stamped = stamp(source)  # before it is read: what changes meanwhile is found
    if source.scene:
        scene = load_any(source.name)
        shown = f"{scene!r} {source.scans}"
        return Known(
            "cat240" if isinstance(scene, Scene) else "points",
            hashlib.sha256(shown.encode()).hexdigest(), {}, stamp=stamped,
        )  # fmt: skip
    if not is_url(source.name) and (path := Path(source.name)).exists() and not (path.is_file() or path.is_dir()):
        raise InputError(f"{path}: no file, and a sweep reads its inputs once for each run")
    with opened(source, seed=0) as found:
        digest = hashlib.sha256()
        for piece in found.octets.chunks:
            digest.update(piece)
        side = {name: hashlib.sha256(octets).hexdigest() for name, octets in found.side.items()}
        return Known(found.kind, digest.hexdigest(), side, stamp=stamped)


def stamp(source: Source) -> str:
    """What changes when an input does, told without reading it: sizes and times of its files. InputError if it is gone.

    Documents beside it are not in it, nor is a scene that comes with the package.
    """
    source = _placed(source)
    path = Path(source.name)
    if is_url(source.name):
        return token_of(source.name)
    if source.scene and not path.exists():
        return ""
    try:
        states = [(str(file), file.stat()) for file in (sorted(path.rglob("*")) if path.is_dir() else [path])]
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{error.filename or path}: {reason[:1].lower()}{reason[1:]}") from None
    told = [(name, state.st_size, state.st_mtime_ns) for name, state in states]
    return hashlib.sha256(repr(told).encode()).hexdigest()


@contextmanager
def opened(source: Source, *, seed: int) -> Iterator[Opened]:
    """The input with what lies beside it; a scene is simulated with the noise of the seed, and gone afterwards."""
    source = _placed(source)
    if source.scene:
        with tempfile.TemporaryDirectory(prefix="maritrack-") as folder:
            yield _opened(Source(name=str(_simulated(source, Path(folder), seed=seed))))
        return
    yield _opened(source)


def _simulated(source: Source, folder: Path, *, seed: int) -> Path:
    """The file of a scene: radar video, or points with the truth in them."""
    scans, scene, path = source.scans or None, load_any(source.name), folder / "scene.json"
    if isinstance(scene, PointScene):
        simulate_points(scene, path, seed=seed, scans=scans)
    elif isinstance(scene, LidarScene):
        simulate_lidar(scene, path, seed=seed, scans=scans)
    elif isinstance(scene, Campaign):
        simulate_campaign(scene, path, seed=seed, scans=scans, ais=False)
    elif scene.others:
        raise InputError(f"{source.name}: a scene of several radars", hint="simulate it, and sweep over these")
    else:
        path = folder / "scene.cat240"
        simulate(scene, path, seed=seed, scans=scans, ais=False, labels=False)
    return path


def _opened(source: Source) -> Opened:
    octets = octets_from_url(source.name, "") if is_url(source.name) else octets_from_file(Path(source.name), "")
    (kind,) = kinds_of([octets])
    channelled = Octets(octets.name, f"/input/{kind}", octets.chunks, octets.head, octets.size)
    return Opened(channelled, kind, _side(source))


def _side(source: Source) -> dict[str, bytes]:
    """Documents beside the input, from wherever they are."""
    if not any(map(is_url, (source.name, source.truth, source.own_ship))):
        truth, own_ship = (Path(name) if name else None for name in (source.truth, source.own_ship))
        return side_documents([Path(source.name)], truth=truth, own_ship=own_ship, sensors=None)
    names = {"truth": source.truth or _truth_beside(source.name), "own-ship": source.own_ship}
    side = {name: _document(place) for name, place in names.items() if place}
    for name, octets in side.items():
        if document_kind(octets, name=name) in ("cat240", "plots"):
            raise InputError(f"{names[name]}: a recording, no reference positions")
    return side


def _truth_beside(name: str) -> str:
    folder, _, last = name.rpartition("/")
    places = (f"{folder}/{candidate}" for candidate in truth_names(last))
    return next((place for place in places if (exists(place) if is_url(place) else Path(place).is_file())), "")


def _document(place: str) -> bytes:
    if is_url(place):
        return unpacked(read_url(place), name=place)
    return read_document(Path(place))
