"""referenceMeas.mat: where the vessels were by AIS, from structs, cells or arrays whose fields have telling names.

The names in DLR's own file are not known. What can't be told by names is told by `rwmr.reference_map`, or is no truth.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from maritrack.errors import InputError
from maritrack.io.matfile import read_mat
from maritrack.io.reference import Reference, Reports, build_reference
from maritrack.rwmrsettings import RwmrConfig, parse_map
from maritrack.types import FloatArray

MOST = 1e4  # of an angle or a speed in any unit
KNOT_MPS = 1852.0 / 3600.0
NAMES = {
    "time": r"t|time|step|k", "east": r"x|e|east(ing)?|pos_?x|x_?pos", "north": r"y|n|north(ing)?|pos_?y|y_?pos",
    "cog": r"cog|course(_over_ground)?", "sog": r"sog|speed(_over_ground)?|v",
    "heading": r"hdg|heading|true_?heading|th", "length": r"len(gth)?|l", "width": r"wid(th)?|beam|w|b",
}  # fmt: skip
UNIT = re.compile(r"[_ \[(]+(m|mps|m/s|deg|rad|kn|s)[\])]*$")


@dataclass(frozen=True, slots=True, eq=False)
class Ship:
    """The columns of one vessel by quantity."""

    name: str
    columns: Mapping[str, FloatArray]


def read_truth(data: bytes, config: RwmrConfig, *, steps: int, start_ns: int) -> tuple[Reference, list[str]]:
    """The reports of a file, and what had to be guessed. InputError with the variables found where none is told."""
    variables = read_mat(data)
    wanted = parse_map(config.reference_map)
    ships = [ship for name, value in variables.items() for ship in _ships(name, value, wanted)]
    if not ships:
        found = ", ".join(f"{name} ({_shape(value)})" for name, value in variables.items()) or "nothing"
        raise InputError(f"no positions by name in {found[:400]}", hint="rwmr.reference_map = east=NAME,north=NAME")
    said = [f"{len(ships)} vessels: {', '.join(ship.name for ship in ships)[:200]}"]
    parts = [_reports(k, ship, config, steps, start_ns, said) for k, ship in enumerate(ships)]
    reports = Reports(*(np.concatenate([getattr(p, f) for p in parts]) for f in
                        ("ship", "t_ns", "position_m", "velocity_mps", "heading_rad")))  # fmt: skip
    names = [ship.name for ship in ships]
    ids = names if len(set(names)) == len(names) else [f"{name}-{k + 1}" for k, name in enumerate(names)]
    return build_reference(
        reports, ids=ids, names=names, length_m=_size(ships, "length"), width_m=_size(ships, "width"), complete=False
    ), list(dict.fromkeys(said))


def _ships(name: str, value: Any, wanted: Mapping[str, str]) -> Iterator[Ship]:
    """The vessels in a variable: a struct, a list of them, a struct of structs, or an array by columns."""
    if isinstance(value, Mapping):
        columns = _columns(value, wanted)
        if columns is not None:
            yield from _split(name, columns)
        else:
            for inner, field in value.items():
                yield from _ships(inner, field, wanted)
    elif isinstance(value, list):
        for k, item in enumerate(value):
            yield from _ships(f"{name}-{k + 1}", item, wanted)
    elif isinstance(value, np.ndarray) and value.ndim == 2 and wanted:
        numbers = {q: int(column) for q, column in wanted.items() if column.isdecimal()}
        if {"east", "north"} <= numbers.keys() and max(numbers.values()) < value.shape[1]:
            yield Ship(name, {q: value[:, c].astype(np.float64) for q, c in numbers.items()})


def _columns(fields: Mapping[str, Any], wanted: Mapping[str, str]) -> dict[str, FloatArray] | None:
    """Fields of a struct by quantity; None where it has no positions."""
    numbers = {name: v for name, v in fields.items() if isinstance(v, int | float | np.ndarray)}
    arrays = {name: np.asarray(v, np.float64) for name, v in numbers.items() if np.ndim(v) <= 2}
    found: dict[str, FloatArray] = {}
    for quantity, pattern in NAMES.items():
        told = wanted.get(quantity, "")
        plain = {name: UNIT.sub("", name.lower()) or name.lower() for name in arrays}
        hit = told if told in arrays else next((n for n, p in plain.items() if re.fullmatch(pattern, p)), None)
        if hit is not None:
            found[quantity] = arrays[hit]
    both = next((a for n, a in arrays.items() if n.lower() in ("pos", "position", "enu", "xy") and a.ndim == 2), None)
    if both is not None and not {"east", "north"} <= found.keys() and 2 <= min(both.shape) <= 3:
        rows = both if both.shape[1] <= 3 else both.T
        found |= {"east": rows[:, 0], "north": rows[:, 1]}
    return found if {"east", "north"} <= found.keys() else None


def _split(name: str, columns: Mapping[str, FloatArray]) -> Iterator[Ship]:
    """One vessel, or one for each column where fields are steps by vessels; none where east and north differ."""
    east, north = np.atleast_1d(columns["east"]), np.atleast_1d(columns["north"])
    single = {q: np.atleast_1d(c) for q, c in columns.items() if c.ndim < 2}
    if east.ndim == north.ndim == 1:
        yield Ship(name, single)
    elif east.shape == north.shape:
        for k in range(east.shape[1]):
            own = {q: c[:, k] for q, c in columns.items() if c.shape == east.shape}
            yield Ship(f"{name}-{k + 1}", single | own)


def _reports(k: int, ship: Ship, config: RwmrConfig, steps: int, start_ns: int, said: list[str]) -> Reports:
    east, north = ship.columns["east"], ship.columns["north"]
    n = min(len(east), len(north))
    time = ship.columns.get("time")
    if time is not None and len(time) >= n:
        t_s = time[:n] / (config.rate_hz if _like_steps(time[:n], steps) else 1.0)
    else:
        t_s = np.arange(n) / config.rate_hz
        said.append("no times in the reference: its rows are steps from 0")
    good = np.isfinite(t_s) & (np.abs(np.nan_to_num(t_s, nan=np.inf)) < 9e9)
    good &= np.isfinite(east[:n]) & np.isfinite(north[:n]) & (np.hypot(east[:n], north[:n]) < 1e8)
    position = np.stack([east[:n], north[:n]], axis=-1)[good]
    t_s = t_s[good]
    heading = _angle(_padded(ship, "heading", n)[good], config, said)
    cog = _angle(_padded(ship, "cog", n)[good], config, said)
    sog = _speed(_padded(ship, "sog", n)[good], position, t_s, said)
    return Reports(
        ship=np.full(len(t_s), k), t_ns=start_ns + np.rint(t_s * 1e9).astype(np.int64), position_m=position,
        velocity_mps=np.stack([sog * np.sin(cog), sog * np.cos(cog)], axis=-1), heading_rad=heading,
    )  # fmt: skip


def _like_steps(time: FloatArray, steps: int) -> bool:
    """Whether times are numbers of steps: whole, and no more than there are."""
    finite = time[np.isfinite(time)]
    return bool(len(finite) and np.all(finite == np.rint(finite)) and finite.max() <= 2 * max(steps, len(time)))


def _padded(ship: Ship, quantity: str, n: int) -> FloatArray:
    column = ship.columns.get(quantity)
    if column is None or len(column) < n:
        return np.full(n, np.nan)
    return np.where(np.abs(column[:n]) < MOST, column[:n], np.nan)


def _angle(angle: FloatArray, config: RwmrConfig, said: list[str]) -> FloatArray:
    largest = float(np.nanmax(np.abs(angle))) if np.isfinite(angle).any() else 0.0
    degrees = config.angles == "deg" or (config.angles == "auto" and largest > 2 * math.pi + 0.01)
    if largest and config.angles == "auto":
        said.append(f"courses and headings of the reference are in {'degrees' if degrees else 'radians'}")
    return np.deg2rad(angle) if degrees else angle


def _speed(sog: FloatArray, position_m: FloatArray, t_s: FloatArray, said: list[str]) -> FloatArray:
    """Speeds in m/s: knots where these fit the way made good better."""
    if len(t_s) < 3 or not np.isfinite(sog).any():
        return sog
    step = np.diff(t_s)
    made = np.hypot(*np.diff(position_m, axis=0).T) / np.where(step > 0, step, np.nan)
    moving = np.isfinite(made) & (sog[1:] > 0.5)
    if not moving.any():
        return sog
    ratio = float(np.median(made[moving] / sog[1:][moving]))
    knots = abs(ratio - KNOT_MPS) < abs(ratio - 1.0)
    said.append(f"speeds of the reference are in {'knots' if knots else 'm/s'}: by the way made good")
    return sog * KNOT_MPS if knots else sog


def _size(ships: list[Ship], quantity: str) -> FloatArray:
    """One size for each vessel (n,), nan where it is not told or makes no sense."""
    found = []
    for ship in ships:
        column = ship.columns.get(quantity)
        finite = column[np.isfinite(column)] if column is not None else np.zeros(0)
        size = float(np.median(finite)) if len(finite) else math.nan
        found.append(size if 0 < size < 1000 else math.nan)
    return np.array(found)


def _shape(value: Any) -> str:
    if isinstance(value, Mapping):
        return "struct of " + ", ".join(list(value)[:12])
    if isinstance(value, list):
        return f"{len(value)} cells"
    return "x".join(map(str, value.shape)) if isinstance(value, np.ndarray) else type(value).__name__
