"""What a run has learned of the background, as a file: a known harbour starts with its mask.

An npz file (a zip of plain arrays, nothing that runs) with a header as JSON. What is read is checked before it is
believed: sizes before anything is inflated, then types, shapes and values.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maritrack import geo
from maritrack.detect.background import Background, judged
from maritrack.errors import InputError
from maritrack.settings import SubtractConfig
from maritrack.types import Origin

FORMAT = "maritrack-background/1"
HEADER = "header.npy"
MOST_OCTETS, MOST_MODELS, MOST_HEADER = 1 << 29, 64, 1 << 16
ARRAYS = {"key": "<i8", "at": "<f8", "floor": "<f8", "count": "<i2", "weight": "<f8"}


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
        members |= {f"{i}.{name}.npy": getattr(model, name).astype(kind) for name, kind in ARRAYS.items()}
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        for name, array in members.items():
            content = io.BytesIO()
            np.lib.format.write_array(content, array, version=(1, 0), allow_pickle=False)
            file.writestr(zipfile.ZipInfo(name), content.getvalue(), zipfile.ZIP_DEFLATED)
    return buffer.getvalue()


def read_snapshot(data: bytes, rules: SubtractConfig, origin: Origin | None, *, name: str) -> dict[str, Background]:
    """The models of a snapshot by sensor, in the plane of the run's origin.

    InputError where it is no snapshot, damaged, or of another grid than the settings ask for.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as file:
            members = _members(file, name)
            header = _header(_array(members, HEADER, "|u1", 1, name), name)
            models = {
                str(told["sensor"]): _model(members, i, told, int(header["categories"]), name)
                for i, told in enumerate(header["models"])
            }
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError, OSError) as error:
        raise InputError(f"{name}: no snapshot of a background: {error}") from None
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name}: damaged snapshot of a background: {error}") from None
    if header["pixel_m"] != rules.pixel_m or header["categories"] != rules.categories:
        raise InputError(
            f"{name}: a background of {header['categories']} counts in pixels of {header['pixel_m']} m",
            hint=f"--set subtract.pixel_m={float(header['pixel_m'])} --set subtract.categories={header['categories']}",
        )
    shift = _shift(header["origin"], origin, name)
    return {
        sensor: judged(replace(m, corner_m=(m.corner_m[0] + shift[0], m.corner_m[1] + shift[1])), rules)
        for sensor, m in models.items()
    }


def _members(file: zipfile.ZipFile, name: str) -> dict[str, bytes]:
    """The files inside, inflated, none of them larger than it says."""
    infos = file.infolist()
    if len(infos) > 1 + MOST_MODELS * len(ARRAYS) or sum(info.file_size for info in infos) > MOST_OCTETS:
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
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(content)
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
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise InputError(f"{name}: no snapshot of a background in the format {FORMAT}")
    if not (math.isfinite(header["pixel_m"]) and header["pixel_m"] > 0 and 2 <= int(header["categories"]) <= 32768):
        raise ValueError("its grid")
    if not isinstance(header["models"], list) or len(header["models"]) > MOST_MODELS:
        raise ValueError("its models")
    return header


def _model(members: Mapping[str, bytes], i: int, told: dict[str, Any], categories: int, name: str) -> Background:
    """One model, checked: it is what learning gives."""
    a = {
        key: _array(members, f"{i}.{key}.npy", kind, 2 if key in ("count", "weight") else 1, name)
        for key, kind in ARRAYS.items()
    }
    now, (east, north), n = float(told["now"]), map(float, told["corner_m"]), len(a["key"])
    kept = a["count"] >= 0
    right = (
        math.isfinite(now) and now >= 0 and math.isfinite(east + north) and int(told["scans"]) >= 0
        and a["count"].shape == a["weight"].shape and a["count"].shape[1] >= 2
        and len(a["at"]) == len(a["floor"]) == len(a["count"]) == n
        and bool((np.diff(a["key"]) > 0).all() and (a["key"] >= 0).all())
        and bool(np.isfinite(a["at"]).all() and (a["at"] <= now).all())
        and bool((a["weight"] >= 0).all() and (a["floor"] >= 0).all())
        and bool((a["count"][:, 0] == 0).all() and (a["count"] >= -1).all() and (a["count"] < categories).all())
        and not bool((kept[:, 1:] & (a["count"][:, 1:] == 0)).any())
        and not bool((a["weight"] * ~kept).any())
    )  # fmt: skip
    if not right:
        raise ValueError(f"model {i} is none")
    total = a["weight"].sum(axis=1) + (categories - kept.sum(axis=1)) * a["floor"]
    if not np.allclose(total, 1.0, rtol=0.0, atol=1e-6):
        raise ValueError(f"the probabilities of model {i} do not add up to 1")
    ordered = np.sort(np.where(kept, a["count"], -1 - np.arange(kept.shape[1])), axis=1)
    if (np.diff(ordered, axis=1) == 0).any():
        raise ValueError(f"model {i} has a count twice")
    zero = np.zeros(n)
    return Background(
        a["key"].astype(np.int64), a["at"].astype(float), a["floor"].astype(float), a["count"].astype(np.int16),
        a["weight"].astype(float), zero, zero, now=now, scans=int(told["scans"]), converged=bool(told["converged"]),
        settled=bool(told["converged"]), corner_m=(east, north),
    )  # fmt: skip


def _shift(told: Any, origin: Origin | None, name: str) -> tuple[float, float]:
    """East-north of the snapshot's origin in the run's plane."""
    if (told is None) != (origin is None):
        where = "without" if told is None else "with"
        raise InputError(f"{name}: a background {where} a position on the globe, the run is the other way round")
    if told is None or origin is None:
        return 0.0, 0.0
    lat, lon = (float(x) for x in told)
    if not (abs(lat) <= 90 and abs(lon) <= 180):
        raise InputError(f"{name}: damaged snapshot of a background: its origin is off the globe")
    east, north = geo.geodetic_to_en(origin, np.array([lat]), np.array([lon]))[0].tolist()
    return east, north
