"""What a run has learned of the background, as a file: a known harbour starts with its mask.

An npz file (a zip of plain arrays, nothing that runs) with a header as JSON. What is read is checked before it is
believed: sizes before anything is inflated, then types, shapes and values.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maritrack import geo
from maritrack.detect.background import Background, judged
from maritrack.detect.pairs import BITS, Pairs
from maritrack.errors import BROKEN_ZIP, InputError
from maritrack.settings import SubtractConfig
from maritrack.types import Origin

FORMAT, SLOTTED = "maritrack-background/2", "maritrack-background/1"
HEADER = "header.npy"
MOST_OCTETS, MOST_MODELS, MOST_HEADER = 1 << 29, 64, 1 << 16
SLACK = 1e-6  # of probabilities
FARTHEST_M = 1e7  # from the origin, of the corner of a grid
ROWS = {"key": "<i8", "late": "<f8", "base": "<f8", "rest": "<f8"}
PAIRS = {"name": "<i8", "level": "<f8"}
SLOTS = {"key": ("<i8", 1), "at": ("<f8", 1), "floor": ("<f8", 1), "count": ("<i2", 2), "weight": ("<f8", 2)}


def snapshot_octets(models: Mapping[str, Background], rules: SubtractConfig, origin: Origin | None) -> bytes:
    """The models by sensor as the octets of a snapshot; equal models give equal octets."""
    header = {
        "format": FORMAT, "pixel_m": rules.pixel_m, "categories": rules.categories,
        "origin": None if origin is None else [origin.lat_deg, origin.lon_deg],
        "models": [
            {"sensor": name, "corner_m": list(m.corner_m), "now": m.now, "scans": m.scans, "converged": m.converged}
            for name, m in sorted(models.items())
        ],
    }  # fmt: skip
    text = np.frombuffer(json.dumps(header, sort_keys=True).encode(), np.uint8)
    members: dict[str, NDArray[Any]] = {HEADER: text}
    for i, (_, model) in enumerate(sorted(models.items())):
        members |= {f"{i}.{name}.npy": getattr(model, name).astype(kind) for name, kind in ROWS.items()}
        members |= {f"{i}.{name}.npy": getattr(model.pairs, name).astype(kind) for name, kind in PAIRS.items()}
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        for name, array in members.items():
            content = io.BytesIO()
            np.lib.format.write_array(content, array, version=(1, 0), allow_pickle=False)
            file.writestr(zipfile.ZipInfo(name), content.getvalue(), zipfile.ZIP_DEFLATED)
    return buffer.getvalue()


def read_snapshot(data: bytes, rules: SubtractConfig, origin: Origin | None, *, name: str) -> dict[str, Background]:
    """The models of a snapshot by sensor, in the plane of the run's origin.

    One of the format before this one, in which each row has its counts in slots, is read as well. InputError where it
    is no snapshot, damaged, or of another grid than the settings ask for.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as file:
            members = _members(file, name)
            header = _header(_array(members, HEADER, "|u1", 1, name), name)
            model = _model if header["format"] == FORMAT else _slotted
            models = {
                str(told["sensor"]): model(members, i, told, header["categories"], name)
                for i, told in enumerate(header["models"])
            }
            place = _place(header["origin"])
    except BROKEN_ZIP as error:
        raise InputError(f"{name}: no snapshot of a background: {error}") from None
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name}: damaged snapshot of a background: {error}") from None
    if header["pixel_m"] != rules.pixel_m or header["categories"] != rules.categories:
        raise InputError(
            f"{name}: a background of {header['categories']} counts in pixels of {header['pixel_m']} m",
            hint=f"--set subtract.pixel_m={float(header['pixel_m'])} --set subtract.categories={header['categories']}",
        )
    shift = _shift(place, origin, name)
    return {
        sensor: judged(replace(m, corner_m=(m.corner_m[0] + shift[0], m.corner_m[1] + shift[1])), rules)
        for sensor, m in models.items()
    }


def _members(file: zipfile.ZipFile, name: str) -> dict[str, bytes]:
    """The files inside, inflated, none of them larger than it says."""
    infos = file.infolist()
    if len(infos) > 1 + MOST_MODELS * (len(ROWS) + len(PAIRS)) or sum(info.file_size for info in infos) > MOST_OCTETS:
        raise InputError(f"{name}: a snapshot that inflates to more than {MOST_OCTETS >> 20} MB")
    members = {}
    for info in infos:
        with file.open(info) as member:
            members[info.filename] = member.read(info.file_size)
    return members


def _array(members: Mapping[str, bytes], member: str, kind: str, ndim: int, name: str) -> NDArray[Any]:
    """A member as an array of this type and number of axes."""
    if member not in members:
        raise InputError(f"{name}: no snapshot of a background: it lacks {member.removesuffix('.npy')}")
    content = io.BytesIO(members[member])
    if np.lib.format.read_magic(content) != (1, 0):
        raise ValueError(f"{member} is of another version")
    try:
        shape, fortran, dtype = np.lib.format.read_array_header_1_0(content)
    except ValueError:  # its words are many, and of Python
        raise ValueError(f"the head of {member} can't be read") from None
    body = content.read()
    if dtype != np.dtype(kind) or fortran or len(shape) != ndim or math.prod(shape) * dtype.itemsize != len(body):
        raise ValueError(f"{member} is not an array of {kind} with {ndim} axes")
    return np.frombuffer(body, dtype).reshape(shape)


def _header(text: NDArray[Any], name: str) -> dict[str, Any]:
    if len(text) > MOST_HEADER:
        raise ValueError("its header is too long")
    try:
        header = json.loads(text.tobytes())
    except RecursionError:
        raise ValueError("its header nests too deeply") from None
    if not isinstance(header, dict) or header.get("format") not in (FORMAT, SLOTTED):
        raise InputError(f"{name}: no snapshot of a background in the format {FORMAT}")
    pixel_m, categories = header["pixel_m"], header["categories"]
    if type(categories) is not int or not (math.isfinite(pixel_m) and pixel_m > 0 and 2 <= categories <= 32768):
        raise ValueError("its grid")
    if not isinstance(header["models"], list) or len(header["models"]) > MOST_MODELS:
        raise ValueError("its models")
    if not header["models"]:
        raise InputError(f"{name}: a snapshot of a background without a model of any sensor")
    return header


def _model(members: Mapping[str, bytes], i: int, told: dict[str, Any], categories: int, name: str) -> Background:
    """One model, checked: it is what learning gives."""
    a = {x: _array(members, f"{i}.{x}.npy", kind, 1, name) for x, kind in (ROWS | PAIRS).items()}
    bare, n = _bare(told, a["key"], i), len(a["key"])
    pairs = Pairs(a["name"].astype(np.int64), a["level"].astype(float))
    right = (
        len(a["late"]) == len(a["base"]) == len(a["rest"]) == n and len(pairs) == len(pairs.level)
        and bool((a["late"] >= 0).all() and (a["late"] <= bare.now).all())
        and bool((a["rest"] >= 0).all() and (a["rest"] <= 1 + SLACK).all())
        and bool((pairs.name >= 0).all() and (np.diff(pairs.name) > 0).all() and (pairs.row < n).all())
        and bool((pairs.count > 0).all() and (pairs.count < categories).all())
        and not bool(np.isnan(a["base"]).any() or np.isnan(pairs.level).any())
    )  # fmt: skip
    if not right:
        raise ValueError(f"model {i} is none")
    late, base, rest = (a[x].astype(float) for x in ("late", "base", "rest"))
    return _summed(replace(bare, late=late, base=base, rest=rest, pairs=pairs), categories, i)


def _slotted(members: Mapping[str, bytes], i: int, told: dict[str, Any], categories: int, name: str) -> Background:
    """One model of the format before: psi as of the time `at`, of the counts that a slot has and of each other one."""
    key, at, floor, count, weight = (
        _array(members, f"{i}.{x}.npy", kind, ndim, name) for x, (kind, ndim) in SLOTS.items()
    )
    bare, kept = _bare(told, key, i), count >= 0
    right = (
        len(at) == len(floor) == len(count) == len(key) and count.shape == weight.shape and count.shape[1] >= 2
        and bool(np.isfinite(at).all() and (at <= bare.now).all())
        and bool((weight >= 0).all() and (weight <= 1 + SLACK).all())
        and bool((floor >= 0).all() and (floor <= 1).all()) and not bool((weight * ~kept).any())
        and bool((count[:, 0] == 0).all() and (count >= -1).all() and (count < categories).all())
        and not bool((kept[:, 1:] & (count[:, 1:] == 0)).any())
    )  # fmt: skip
    if not right:
        raise ValueError(f"model {i} is none")
    row, slot = np.nonzero(kept[:, 1:])
    psi, pair = weight[row, slot + 1], (row << BITS) | count[row, slot + 1]
    order = np.argsort(pair)
    if (np.diff(pair[order]) == 0).any():
        raise ValueError(f"model {i} has a count twice")
    free = categories - kept.sum(axis=1)
    rest = weight[:, 1:].sum(axis=1) + free * floor
    if not np.allclose(rest + weight[:, 0], 1.0, rtol=0.0, atol=SLACK):
        raise ValueError(f"the probabilities of model {i} do not add up to 1")
    with np.errstate(divide="ignore"):
        base, level = np.log(floor) + at, np.log(psi) + at[row]
    model = replace(bare, base=base, rest=np.exp(at - bare.now) * rest, pairs=Pairs(pair[order], level[order]))
    return _summed(model, categories, i)


def _bare(told: dict[str, Any], key: NDArray[Any], i: int) -> Background:
    """A model with what the header tells, and with rows that know nothing."""
    now, (east, north), scans, zero = (
        float(told["now"]),
        map(float, told["corner_m"]),
        int(told["scans"]),
        np.zeros(len(key)),
    )
    right = math.isfinite(now) and now >= 0 and abs(east) <= FARTHEST_M and abs(north) <= FARTHEST_M and scans >= 0
    if not right or not bool((np.diff(key) > 0).all() and (key >= 0).all()):
        raise ValueError(f"model {i} is none")
    converged = told["converged"]
    if type(converged) is not bool:
        raise ValueError(f"model {i} is none")
    return Background(
        key.astype(np.int64), zero, zero, zero, zero, zero, zero, zero.astype(np.int16), zero,
        now=now, scans=scans, converged=converged, settled=converged, corner_m=(east, north),
    )  # fmt: skip


def _summed(model: Background, categories: int, i: int) -> Background:
    """The model, if the probabilities of its rows add up."""
    time, n = model.now - model.late, len(model)
    free = categories - 1 - np.bincount(model.pairs.row, minlength=n)
    likely = np.minimum(model.pairs.level - time[model.pairs.row], 1.0)  # no overflow of what is wrong anyway
    total = np.bincount(model.pairs.row, np.exp(likely), n) + free * np.exp(np.minimum(model.base - time, 1.0))
    if not np.allclose(total, model.rest, rtol=0.0, atol=SLACK):
        raise ValueError(f"the probabilities of model {i} do not add up to 1")
    return model


def _place(told: Any) -> Origin | None:
    """The origin that the header tells."""
    if told is None:
        return None
    if not (isinstance(told, list) and len(told) == 2 and all(type(x) in (int, float) for x in told)):
        raise ValueError("its origin is no latitude and longitude")
    lat, lon = map(float, told)
    if not (abs(lat) <= 90 and abs(lon) <= 180):
        raise ValueError("its origin is off the globe")
    return Origin(lat, lon)


def _shift(told: Origin | None, origin: Origin | None, name: str) -> tuple[float, float]:
    """East-north of the snapshot's origin in the run's plane."""
    if (told is None) != (origin is None):
        where = "without" if told is None else "with"
        raise InputError(f"{name}: a background {where} a position on the globe, the run is the other way round")
    if told is None or origin is None:
        return 0.0, 0.0
    east, north = geo.geodetic_to_en(origin, np.array([told.lat_deg]), np.array([told.lon_deg]))[0].tolist()
    return east, north
