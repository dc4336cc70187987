"""Ships as AIS tells them: where each is said to be at any time, how well that is known, and where it can't be true."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maritrack.io.ais import Implausible
from maritrack.io.reference import JUMP_MPS, REST_M, REST_MPS, Reference
from maritrack.types import BoolArray, FloatArray

GNSS_M = 10.0  # standard deviation of a position that AIS tells
CLOCK_S = 1.0  # ... and of its time, which is of whole seconds and of a radio's making
HULL_SHARE, HULL_M = 0.25, 25.0  # the echo lies so far from the middle: a share of the length, or this where unknown
STEP_M, STEP_MPS2 = 60.0, 0.3  # a step off the way that was told is implausible beyond the first, plus this t^2 / 2


@dataclass(frozen=True, slots=True, eq=False)
class Ship:
    """The reports of one ship."""

    id: str
    name: str
    length_m: float  # nan where unknown
    width_m: float
    t_s: FloatArray  # (m,) increasing
    position_m: FloatArray  # (m, 2) east-north
    velocity_mps: FloatArray  # (m, 2) as told, nan where not
    max_gap_moving_s: float  # reports are bridged over this under way ...
    max_gap_rest_s: float  # ... and over this at rest
    lag_s: float = 0.0  # its reports are late by so much

    @property
    def half_m(self) -> float:
        """Half the length, a boat's where nothing tells it."""
        return self.length_m / 2 if self.length_m > 0 else HULL_M

    @property
    def hull_m(self) -> float:
        """Standard deviation of where on it the echo lies."""
        return max(HULL_SHARE * self.length_m, 3.0) if self.length_m > 0 else HULL_M

    def at(self, t_s: FloatArray, *, lag_s: float | None = None) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Position and velocity (n, 2) at times (n,), and whether the reports tell them."""
        ask = t_s + (self.lag_s if lag_s is None else lag_s)
        if len(self.t_s) < 2:
            n = len(ask)
            return np.full((n, 2), np.nan), np.full((n, 2), np.nan), np.zeros(n, bool)
        b = np.clip(np.searchsorted(self.t_s, ask, side="right"), 1, len(self.t_s) - 1)
        a = b - 1
        dt_s = self.t_s[b] - self.t_s[a]
        way = self.position_m[b] - self.position_m[a]
        far = np.hypot(*way.T)
        rest = (far < REST_M) | (far < REST_MPS * dt_s)
        known = (ask >= self.t_s[0]) & (ask <= self.t_s[-1]) & (far <= JUMP_MPS * np.maximum(dt_s, 1.0))
        known &= dt_s <= np.where(rest, self.max_gap_rest_s, self.max_gap_moving_s)
        velocity = way / dt_s[:, None]
        return self.position_m[a] + (ask - self.t_s[a])[:, None] * velocity, velocity, known


def ships_of(reference: Reference, start_ns: int, *, max_gap_moving_s: float, max_gap_rest_s: float) -> list[Ship]:
    """The ships by id, in seconds since a time."""
    ships = []
    for i, (first, last) in enumerate(zip(reference.start[:-1].tolist(), reference.start[1:].tolist(), strict=True)):
        rows = slice(first, last)
        ships.append(
            Ship(
                reference.ids[i], reference.names[i], float(reference.length_m[i]), float(reference.width_m[i]),
                np.asarray((reference.t_ns[rows] - start_ns) * 1e-9, float), reference.position_m[rows],
                reference.velocity_mps[rows],
                max_gap_moving_s, max_gap_rest_s,
            )
        )  # fmt: skip
    return ships


def comes_near(ship: Ship, sensor_m: FloatArray, reach_m: float) -> bool:
    """Whether a report lies within the reach of the box that the sensor (k, 2) was in."""
    low, high = sensor_m.min(axis=0) - reach_m, sensor_m.max(axis=0) + reach_m
    return bool(((ship.position_m >= low) & (ship.position_m <= high)).all(axis=1).any())


@dataclass(frozen=True, slots=True)
class Jump:
    """A step of AIS that no ship makes."""

    id: str
    t_ns: int  # of the report after it
    position_m: tuple[float, float]  # of that report
    off_m: float  # from where its ship would have been
    what: str  # "single" = it came back at once; "step" = it stayed


def jumps(ships: list[Ship], implausible: Implausible, start_ns: int) -> list[Jump]:
    """Single wild reports, and steps off the way that course and speed over ground tell, by time.

    Beyond a gap a ship may have turned: what counts as a step grows with the square of the time.
    """
    found = []
    by_id = {ship.id: ship for ship in ships}
    for id_, t_ns, at in zip(implausible.id, implausible.t_ns.tolist(), implausible.position_m, strict=True):
        off_m = float("nan")
        if id_ in by_id and len(by_id[id_].t_s) > 1:
            ship = by_id[id_]
            near = int(np.argmin(np.abs(ship.t_s - (t_ns - start_ns) * 1e-9)))
            off_m = float(np.hypot(*(at - ship.position_m[near])))
        found.append(Jump(id_, t_ns, (float(at[0]), float(at[1])), off_m, "single"))
    for ship in ships:
        steps = steps_m(ship)
        for i in np.flatnonzero(steps > 0).tolist():
            at = ship.position_m[i + 1]
            t_ns = start_ns + round(float(ship.t_s[i + 1]) * 1e9)
            found.append(Jump(ship.id, t_ns, (float(at[0]), float(at[1])), float(steps[i]), "step"))
    return sorted(found, key=lambda jump: (jump.t_ns, jump.id))


def steps_m(ship: Ship) -> FloatArray:
    """How far each report (m - 1,) after the first is off the way from the one before; 0 where it may be true."""
    dt_s = np.diff(ship.t_s)
    way = np.diff(ship.position_m, axis=0)
    told = (ship.velocity_mps[:-1] + ship.velocity_mps[1:]) / 2
    off_m = np.hypot(*(way - told * dt_s[:, None]).T)
    without = np.hypot(*way.T) - JUMP_MPS * np.maximum(dt_s, 1.0)
    speed = np.hypot(*np.nan_to_num(told).T)
    allowed = STEP_M + speed * 2 * CLOCK_S + STEP_MPS2 * dt_s**2 / 2
    return np.where(np.isfinite(off_m), np.where(off_m > allowed, off_m, 0.0), np.maximum(without, 0.0))
