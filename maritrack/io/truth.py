"""Reference positions from whatever holds them, and where they lie beside a recording."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from maritrack.errors import InputError
from maritrack.io import sniff
from maritrack.io.ais import read_ais
from maritrack.io.aismat import MAT5, holds_ais
from maritrack.io.autoferry import ORIGIN, autoferry_truth, holds_autoferry
from maritrack.io.jsontext import naming
from maritrack.io.octets import HEAD
from maritrack.io.pointjson import point_origin, point_truth
from maritrack.io.reference import Reference, moved_to
from maritrack.io.rwmr.truth import read_truth
from maritrack.io.times import day_start_ns
from maritrack.rwmrsettings import RwmrConfig
from maritrack.types import Damage, Origin

OWN_PLACE = re.compile(rb"\$[A-Z]{2}(?:RMC|GGA),")


def read_reference(
    data: bytes, *, name: str, origin: Origin | None, date: str = "", own_ship: str | None = None,
    rwmr: RwmrConfig | None = None,
) -> Reference:  # fmt: skip
    """The truth of a points document, Autoferry ground truth (JSON or .mat) or AIS of any form, by its content.

    Positions are in the plane of `origin`; where it is None, in that of the document (AIS: about its own
    ship, else its first report). `date` is for AIS times of day. InputError for what holds no truth. What
    referenceMeas.mat says, read by `rwmr`, is in the plane of its folder, whatever the origin.
    """
    kind = document_kind(data, name=name)
    if kind == "points":
        reference, own_origin = point_truth(data, name=name)
        return moved_to(reference, old=own_origin, new=origin)
    if kind in ("autoferry", "autoferry-truth"):
        return moved_to(autoferry_truth(data, name=name), old=ORIGIN, new=origin)
    if kind == "ais":
        return read_ais(data, name=name, date=date, origin=origin, own_ship=own_ship).reference
    if kind == "rwmr-truth":
        with naming(name):
            start_ns = day_start_ns(date, name=name)
            reference, said = read_truth(data, rwmr or RwmrConfig(), steps=0, start_ns=start_ns)
        return replace(reference, damage=tuple(Damage("guess", -1, text) for text in said))
    raise InputError(
        f"{name}: no reference positions",
        hint="truth is AIS (sentences, CSV or .mat), points JSON, Autoferry ground truth or referenceMeas.mat",
    )


def document_kind(data: bytes, *, name: str, own: bool = False) -> str:
    """The kind of a document of reference positions, as `sniff` tells it, but of .mat files by what they hold.

    `own`: a log of AIS sentences in which the ship's own instruments tell its place is "nmea".
    """
    kind = sniff(data[:HEAD], name)
    if kind == "autoferry" and data.startswith(MAT5) and not holds_autoferry(data):
        return "ais" if holds_ais(data) else "rwmr-truth"
    if own and kind == "ais" and OWN_PLACE.search(data[:HEAD]):
        return "nmea"
    return kind


def document_origin(data: bytes) -> Origin | None:
    """The origin that a document of truth refers its positions to; None where it has none or is no such document."""
    try:
        kind = document_kind(data, name="truth")
        if kind == "points":
            return point_origin(data)
    except InputError:  # `read_reference` will say what is wrong
        return None
    return ORIGIN if kind in ("autoferry", "autoferry-truth") else None


def find_truth(path: Path) -> Path | None:
    """The truth that lies beside a recording, None where there is none.

    REC.truth.json, with or without the ending of REC; of Autoferry `X_groundTruth.json` beside
    `X_detections.json` or `X.mat`.
    """
    beside = (path.with_name(name) for name in truth_names(path.name))
    return next((file for file in beside if file.is_file()), None)


def truth_names(name: str) -> tuple[str, ...]:
    """What truth beside a recording of this name may be called, the first that is there counts."""
    path = Path(name)
    stem = path.stem
    candidates = [f"{name}.truth.json", f"{stem}.truth.json", f"{Path(stem).stem}.truth.json"]
    if path.suffix == ".gz":
        stem = Path(stem).stem
    candidates.append(f"{stem.removesuffix('_detections')}_groundTruth.json")
    return tuple(candidate for candidate in dict.fromkeys(candidates) if candidate != name)
