"""Where the platform of a sensor is and where its bow points, at any time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maritrack.errors import ConfigError
from maritrack.geo import wrap_positive
from maritrack.types import BoolArray, FloatArray, IntArray, check_lengths


@dataclass(frozen=True, slots=True, eq=False)
class PoseTrack:
    """Positions and headings, linear in between and held at both ends.

    Make one with `fixed` or `from_reports`. Times increase strictly; headings are unwrapped, so that
    they turn the short way. Headings have times of their own: a report may lack one.
    """

    t_ns: IntArray  # (n,) n > 0
    position_m: FloatArray  # (n, 2) east-north
    heading_t_ns: IntArray  # (h,) 0 where no heading is known
    heading_rad: FloatArray  # (h,) clockwise from true north, unwrapped

    def __post_init__(self) -> None:
        check_lengths(self, len(self.t_ns), "position_m")
        check_lengths(self, len(self.heading_t_ns), "heading_rad")

    @classmethod
    def fixed(
        cls, position_m: FloatArray | tuple[float, float] = (0.0, 0.0), *, heading_rad: float = np.nan
    ) -> PoseTrack:
        """A platform that stays."""
        return cls.from_reports(
            np.zeros(1, np.int64), np.asarray(position_m, np.float64).reshape(1, 2), np.array([heading_rad])
        )

    @classmethod
    def from_reports(cls, t_ns: IntArray, position_m: FloatArray, heading_rad: FloatArray) -> PoseTrack:
        """A platform that reported positions (n, 2) and headings (n,) at times (n,), in any order.

        Of reports with the same time the last counts. Values that are not finite are left out.
        Raises ConfigError where no position is left.
        """
        t_ns, position_m = np.asarray(t_ns, np.int64), np.asarray(position_m, np.float64).reshape(-1, 2)
        placed = _last_by_time(t_ns, np.asarray(np.isfinite(position_m).all(axis=1)))
        if len(placed) == 0:
            raise ConfigError("own ship: no report with a position")
        headed = _last_by_time(t_ns, np.asarray(np.isfinite(heading_rad)))
        heading = np.unwrap(np.asarray(heading_rad, np.float64)[headed])
        return cls(t_ns[placed], position_m[placed], t_ns[headed], heading)

    @property
    def has_heading(self) -> bool:
        return len(self.heading_t_ns) > 0

    def position(self, t_ns: IntArray) -> FloatArray:
        """East-north (m, 2) at times (m,)."""
        at = _seconds(t_ns, self.t_ns[0])
        knots = _seconds(self.t_ns, self.t_ns[0])
        return np.stack([np.interp(at, knots, self.position_m[:, axis]) for axis in (0, 1)], axis=-1)

    def heading(self, t_ns: IntArray) -> FloatArray:
        """Heading (m,) in [0, 2 pi) at times (m,); nan where none is known."""
        if not self.has_heading:
            return np.full(len(t_ns), np.nan)
        start = self.heading_t_ns[0]
        return wrap_positive(np.interp(_seconds(t_ns, start), _seconds(self.heading_t_ns, start), self.heading_rad))


def _last_by_time(t_ns: IntArray, usable: BoolArray) -> IntArray:
    """Indices of usable reports in order of time, the last of each time."""
    rows = np.flatnonzero(usable)
    rows = rows[np.argsort(t_ns[rows], kind="stable")]
    return rows[np.append(np.diff(t_ns[rows]) > 0, True)] if len(rows) else rows


def _seconds(t_ns: IntArray, start_ns: np.int64) -> FloatArray:
    return np.asarray((np.asarray(t_ns, np.int64) - start_ns) * 1e-9)
