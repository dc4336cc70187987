"""Sets of points of a scan, each known by a number, and what rows are made of them: every fit is made once."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from maritrack.trackers import bernoullis
from maritrack.trackers.bernoullis import Bernoullis
from maritrack.trackers.pointmodels import PointModel, Sets
from maritrack.types import FloatArray, IntArray

MOST_ENTRIES = 200_000  # points that are fitted together, padding included


class Cells:
    """Numbered sets of points."""

    def __init__(self, z: FloatArray, R: FloatArray) -> None:
        self.z, self.R = z, R
        self.points: list[IntArray] = []
        self._number: dict[bytes, int] = {}

    def number(self, points: IntArray) -> int:
        """Of a set, ascending; the same for the same set."""
        key = points.astype(np.int64).tobytes()
        found = self._number.get(key)
        if found is None:
            found = self._number[key] = len(self.points)
            self.points.append(points)
        return found

    def sets(self, numbers: Iterable[int]) -> Sets:
        """Some of them, padded to one length."""
        some = [self.points[c] for c in numbers]
        count = np.array([len(one) for one in some], np.int64)
        width = int(count.max(initial=1))
        use = np.arange(width) < count[:, None]
        index = np.zeros(use.shape, np.int64)
        index[use] = np.concatenate(some) if some else []
        return Sets(self.z[index], self.R[index], use)

    def sizes(self, numbers: Iterable[int]) -> FloatArray:
        """Points of each."""
        return np.array([len(self.points[c]) for c in numbers], np.float64)


class Fits:
    """What rows become by cells, and how likely those were."""

    def __init__(self, model: PointModel, rows: Bernoullis, cells: Cells, sensor_m: FloatArray, headings: int) -> None:
        self.model, self.rows, self.cells, self.sensor_m, self.headings = model, rows, cells, sensor_m, headings
        self._place: dict[tuple[int, int], int] = {}
        self._made: list[Bernoullis] = []
        self._log_l: list[FloatArray] = []

    def need(self, pairs: Iterable[tuple[int, int]]) -> None:
        """Make the fits of rows and cells that are not made yet, together."""
        new = [pair for pair in dict.fromkeys(pairs) if pair not in self._place]
        new.sort(key=lambda pair: len(self.cells.points[pair[1]]))
        begin = 0
        while begin < len(new):
            end = begin + 1
            while end < len(new) and (end + 1 - begin) * len(self.cells.points[new[end][1]]) <= MOST_ENTRIES:
                end += 1
            part = new[begin:end]
            rows = bernoullis.rows(self.rows, np.array([i for i, _ in part], np.int64))
            made, log_l = self.model.fit(rows, self.cells.sets(c for _, c in part), self.sensor_m, self.headings)
            base = sum(map(len, self._log_l))
            self._place.update({pair: base + k for k, pair in enumerate(part)})
            self._made.append(made)
            self._log_l.append(log_l)
            begin = end

    def log_l(self, pairs: Iterable[tuple[int, int]]) -> FloatArray:
        """Log likelihoods of pairs that are made, m^-2 for each point."""
        self._log_l = [np.concatenate([np.zeros(0), *self._log_l])]
        return np.asarray(self._log_l[0][[self._place[pair] for pair in pairs]])

    def fitted(self, pairs: Iterable[tuple[int, int]]) -> Bernoullis:
        """Their rows."""
        place = np.array([self._place[pair] for pair in pairs], np.int64)
        if len(self._made) > 1:  # not anew at each call
            self._made = [bernoullis.join(self._made)]
        return bernoullis.rows(self._made[0] if self._made else self.rows, place)
