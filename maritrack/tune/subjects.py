"""Recordings whose objects are known, scan by scan: by labelled cells, by given labels, or by reference positions."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from maritrack.chain import build_chain, detect
from maritrack.cluster.stage import plane
from maritrack.errors import InputError, UsageError
from maritrack.io.truth import find_truth
from maritrack.recording import kinds_of, open_inputs, open_recording, side_documents
from maritrack.run import with_truth
from maritrack.settings import Config
from maritrack.simulate.labels import labels_path, read_owners
from maritrack.tune.labelling import CellLabels, GivenLabels, HullLabels, Labelling
from maritrack.types import FloatArray, Frame, IntArray

DOMAINS = ("polar-dbscan", "cartesian-dbscan")


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """A recording, and what tells its objects: labelled cells, or a document of reference positions."""

    path: Path
    cells: Path | None
    truth: Path | None
    own_ship: Path | None = None


@dataclass(frozen=True, slots=True, eq=False)
class LabelledScan:
    """What a scan gives to the study."""

    planes: tuple[tuple[FloatArray, float], ...]  # points (n, 2) and period of each domain
    truth: IntArray  # (n,)


def subject(path: Path, *, truth: Path | None, own_ship: Path | None = None, positions: bool = False) -> Subject:
    """What tells the objects of a recording.

    Labelled cells where `truth` is a table of them, or one lies beside the recording and `truth` is the simulator's
    own; with `positions` never. Else the document `truth`, or the one beside the recording.
    """
    if truth is not None and _is_parquet(truth):
        return Subject(path=path, cells=truth, truth=None, own_ship=own_ship)
    beside, cells = find_truth(path), labels_path(path)
    own = truth is None or (beside is not None and truth.exists() and truth.samefile(beside))
    if not positions and own and cells.is_file():
        return Subject(path=path, cells=cells, truth=truth, own_ship=own_ship)
    return Subject(path=path, cells=None, truth=truth or beside, own_ship=own_ship)


def subjects(
    paths: Sequence[Path], *, truth: Sequence[Path] = (), own_ship: Sequence[Path] = (), positions: bool = False
) -> list[Subject]:
    """The recordings; `truth` and `own_ship` are none or one for each."""
    for name, given in (("--truth", truth), ("--own-ship", own_ship)):
        if given and len(given) != len(paths):
            raise UsageError(f"{len(given)} {name} for {len(paths)} recordings", hint="one for each, in their order")
    if any(str(path) == "-" for path in paths):
        raise UsageError("a study reads files, no standard input")
    return [
        subject(
            path, truth=truth[i] if truth else None, own_ship=own_ship[i] if own_ship else None, positions=positions
        )
        for i, path in enumerate(paths)
    ]


def _is_parquet(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(4) == b"PAR1"
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None


def labelled_scans(
    of: Subject, config: Config, *, margin_m: float, radius_m: float, moving_only: bool = False
) -> tuple[Iterator[LabelledScan], Labelling]:
    """The scans of a recording with the objects of their points, and how these are known."""
    octets = open_inputs([of.path])
    kinds = kinds_of(octets)
    if kinds[0] in ("autoferry", "plots"):
        raise UsageError(f"{of.path}: {kinds[0]}: a row is an object already, there is nothing to cluster")
    side = side_documents([of.path], truth=of.truth, own_ship=of.own_ship, sensors=None, no_truth=of.truth is None)
    whole = replace(config, input=replace(config.input, from_s=0.0, to_s=np.inf, limit=0))  # turns count from the first
    recording = open_recording(octets, kinds, side, whole)
    everywhere = replace(
        config, input=replace(config.input, roi_min_m=0.0, roi_max_m=np.inf)
    )  # hulls on the border too
    frames = with_truth(recording.frames, recording.reference, build_chain(everywhere))
    settings = config.input
    labelling: Labelling = HullLabels(
        margin_m=margin_m, radius_m=radius_m, beam_rad=float(np.radians(settings.beam_width_deg)),
        pulse_m=settings.pulse_length_m, moving_only=moving_only,
    )  # fmt: skip
    if of.cells is not None:
        labelling = CellLabels(read_owners(of.cells), of.cells, float(np.radians(settings.azimuth_offset_deg)))
    elif kinds[0] == "points":
        first = next(frames)
        frames = itertools.chain([first], frames)
        if first.scan.points is not None and first.scan.points.truth_label is not None:
            labelling = GivenLabels()
    if moving_only and not isinstance(labelling, HullLabels):
        raise UsageError(f"{of.path}: --moving is for labels by positions", hint="--positions")
    if config.score.truth_match and not isinstance(labelling, HullLabels):
        raise UsageError(f"{of.path}: --truth-match is for labels by positions", hint="--positions")
    if isinstance(labelling, HullLabels) and recording.reference is None:
        raise UsageError(f"{of.path}: no labelled cells and no truth beside it", hint="pass it with --truth")
    return _labelled(_windowed(frames, config), config, labelling), labelling


def _windowed(frames: Iterable[Frame], config: Config) -> Iterator[tuple[int, Frame]]:
    """The turns within the window of the settings, each with its number in the whole recording."""
    settings, first_ns, n = config.input, None, 0
    for k, frame in enumerate(frames):
        first_ns = frame.t_ns if first_ns is None else first_ns
        since_s = (frame.t_ns - first_ns) * 1e-9
        if since_s > settings.to_s or (settings.limit and n >= settings.limit):
            return
        if since_s >= settings.from_s:
            n += 1
            yield k, frame


def _labelled(frames: Iterable[tuple[int, Frame]], config: Config, labelling: Labelling) -> Iterator[LabelledScan]:
    for k, frame in frames:
        points = detect(frame.scan, config)
        planes = tuple(plane(points, frame.scan, domain) for domain in DOMAINS)
        yield LabelledScan(planes, labelling.label(k, frame, points))
