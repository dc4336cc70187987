"""When each image was taken: from a table, from numbers or times in the names, or from their order."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

import numpy as np

from maritrack.errors import InputError
from maritrack.imagesettings import ImageConfig
from maritrack.io.csvtable import find, read_table, times_s
from maritrack.io.times import MAX_S, day_start_ns, iso_to_s, seconds_to_ns

NAME = ("name", "file", "filename", "image", "frame", "step")
MOMENT = re.compile(  # 20160112T134512.250, 2016-01-12_13-45-12
    r"(?<![0-9])((?:19|20)[0-9]{2})[-_.]?([01][0-9])[-_.]?([0-3][0-9])[T _-]?"
    r"([0-2][0-9])[-_.:]?([0-5][0-9])[-_.:]?([0-5][0-9])(?:[.,_-]?([0-9]{1,6}))?(?![0-9])"
)
EPOCH = re.compile(r"(?<![0-9])([0-9]{10})(?:[._]([0-9]{1,6})|([0-9]{3})|([0-9]{6}))?(?![0-9])")
STEP = re.compile(r"([0-9]{1,9})(?=[^0-9]*\Z)")


@dataclass(slots=True)
class Clock:
    """Times of images in the order in which they come. The first tells what names mean."""

    config: ImageConfig
    date: str = ""
    table_ns: dict[str, int] = field(default_factory=dict)  # by name, of a table
    _how: str = ""
    _count: int = 0

    def time_ns(self, name: str) -> int | None:
        """The time of an image, None where it has none as the others have."""
        k, self._count = self._count, self._count + 1
        stem = stem_of(name)
        if self.table_ns:
            keys = (name.rpartition("/")[2].lower(), stem.lower(), str(int(stem)) if stem.isdecimal() else "")
            return next((self.table_ns[key] for key in keys if key in self.table_ns), None)
        self._how = self._how or self._kind(stem)
        if self._how == "stamps":
            moment_s = stamp_s(stem)
            return None if math.isnan(moment_s) else int(seconds_to_ns(np.array([moment_s]))[0])
        step = step_of(stem) if self._how == "steps" else k
        if step is None or step / self.config.rate_hz >= MAX_S:
            return None
        return day_start_ns(self.date, name=name) + round(step / self.config.rate_hz * 1e9)

    def _kind(self, stem: str) -> str:
        if self.config.times != "auto":
            return self.config.times
        if not math.isnan(stamp_s(stem)):
            return "stamps"
        return "steps" if step_of(stem) is not None else "rate"

    def learn(self, data: bytes, name: str) -> None:
        """Take in a table of names (or steps) and times. InputError where it is none."""
        table = read_table(data, name=name)
        column = find(table, NAME)
        if column is None:
            raise InputError(f"{name}: no column of names", hint="columns: name, time_s")
        time_s, of_day = times_s(table)
        if len(time_s) == 0 or not np.isfinite(time_s).any():
            raise InputError(f"{name}: no times", hint="columns: name, time_s")
        usable = np.isfinite(time_s) & (np.abs(np.nan_to_num(time_s, nan=np.inf)) < MAX_S)
        t_ns = seconds_to_ns(np.where(usable, time_s, 0.0)) + (day_start_ns(self.date, name=name) if of_day else 0)
        for text, t, ok in zip(table.columns[column], t_ns.tolist(), usable.tolist(), strict=True):
            if ok:
                self.table_ns[text.strip().rpartition("/")[2].lower()] = t


def stem_of(name: str) -> str:
    """The name of a file without folders and ending."""
    return name.rpartition("/")[2].rpartition(".")[0] or name.rpartition("/")[2]


def stamp_s(stem: str) -> float:
    """Seconds since 1970 that a name tells, as a date with a time of day or as a number; nan where it tells none."""
    if match := MOMENT.search(stem):
        y, mo, d, h, mi, s, part = match.groups()
        return iso_to_s(f"{y}-{mo}-{d}T{h}:{mi}:{s}") + (int(part) / 10 ** len(part) if part else 0.0)
    if match := EPOCH.search(stem):
        whole, *parts = match.groups()
        part = next((p for p in parts if p), "")
        return int(whole) + (int(part) / 10 ** len(part) if part else 0.0)
    return math.nan


def step_of(stem: str) -> int | None:
    """The last number in a name."""
    match = STEP.search(stem)
    return int(match[1]) if match else None
