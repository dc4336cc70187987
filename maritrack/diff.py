"""What differs between two runs: archives, run folders or summaries.

Archives are compared frame by frame, with a summary on either side only metrics and counts are.
Timings and outputs never count. The manifest is told but does not count: it says why runs differ.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np

from maritrack.errors import UsageError
from maritrack.io.archive import ArchivedScan, iter_results
from maritrack.sides import Side, flat, side_of
from maritrack.tolerances import Tolerance, Tolerances
from maritrack.types import Damage

S = TypeVar("S")
LIMIT = 100  # differences that are kept; all are counted
FRAME_PARTS = ("scan", "truth", "points", "clusters", "tracks", "scores", "archive")
SUMMARY_PARTS = ("metrics", "counts")


class Difference(NamedTuple):
    """One thing that is not the same."""

    where: str  # "scan", "truth", "points", "clusters", "tracks", "scores", "metrics", "counts", "archive"
    k: int  # scan, -1 = of the whole run
    what: str  # "position_m[17]", "track 3: velocity_mps", "gospa", "count"
    a: Any
    b: Any


@dataclass(frozen=True, slots=True, eq=False)
class Diff:
    """All that differs: frames first, in their order, then damage, metrics and counts."""

    differences: tuple[Difference, ...]  # the first of them
    count: int  # of all
    metrics: Mapping[str, tuple[Any, Any]]  # changed ones
    manifest: tuple[Difference, ...]  # for information
    n_scans: int  # compared
    parts: Mapping[str, Part]  # all that was compared: "tracks", "metrics.gospa", "counts.scans", ...

    @property
    def equal(self) -> bool:
        return self.count == 0


class Part(NamedTuple):
    """Something that was compared: a metric, a count, or a part of the frames."""

    n: int = 0  # differences
    first: Difference | None = None


def diff(
    a: Path,
    b: Path,
    *,
    rtol: float = 0.0,
    atol: float = 0.0,
    tolerances: Tolerances | None = None,
    only: Literal["metrics", "tracks"] | None = None,
    limit: int = LIMIT,
) -> Diff:
    """Compare two runs, `tolerances` in place of rtol and atol. InputError where one can't be read."""
    tolerance, sides = tolerances or Tolerances(Tolerance(rtol, atol)), (side_of(a), side_of(b))
    metrics = _changed(sides, "metrics", tolerance) if only != "tracks" else {}
    counts = _changed(sides, "counts", tolerance) if only is None else {}
    found = itertools.chain(
        _frames(sides, tolerance, only=only),
        (Difference("metrics", -1, name, *pair) for name, pair in metrics.items()),
        (Difference("counts", -1, name, *pair) for name, pair in counts.items()),
    )
    kept: list[Difference] = []
    parts = dict.fromkeys(_compared(sides, only), Part())
    for difference in found:
        kept += [difference] if len(kept) < limit else []
        name = f"{difference.where}.{difference.what}" if difference.where in SUMMARY_PARTS else difference.where
        part = parts.get(name, Part())
        parts[name] = Part(part.n + 1, part.first or difference)
    manifests = (sides[0].manifest, sides[1].manifest)
    both = all(manifests)  # a summary has none
    return Diff(
        differences=tuple(kept), count=sum(part.n for part in parts.values()), metrics=metrics,
        manifest=tuple(
            Difference("manifest", -1, name, *pair)
            for name, pair in (_table_changes("manifest", *manifests, tolerance) if both else {}).items()
        ),
        n_scans=min(side.n_scans for side in sides) if only != "metrics" else 0, parts=parts,
    )  # fmt: skip


def _compared(sides: tuple[Side, Side], only: str | None) -> Iterator[str]:
    """All that is compared, whether it differs or not."""
    if only != "metrics" and all(side.archive is not None for side in sides):
        yield from FRAME_PARTS if only is None else ("tracks",)
    for part in SUMMARY_PARTS if only is None else ("metrics",) if only == "metrics" else ():
        names = {name for side in sides for name in flat(side.summary.get(part))}
        yield from (f"{part}.{name}" for name in sorted(names))


def compare_scans(
    a: ArchivedScan, b: ArchivedScan, tolerance: Tolerances, *, tracks_only: bool
) -> Iterator[Difference]:
    """What differs in one frame, in the order in which it came about."""
    if not tracks_only:
        yield from _columns("scan", a.k, _scan_table(a), _scan_table(b), tolerance)
        yield from _rows("truth", a.k, a.truth, b.truth, tolerance)
        yield from _rows("points", a.k, a.points, b.points, tolerance)
        yield from _columns("points", a.k, {"keep": a.keep}, {"keep": b.keep}, tolerance)
        yield from _rows("clusters", a.k, a.clusters, b.clusters, tolerance)
    yield from _rows("tracks", a.k, a.tracks, b.tracks, tolerance)
    changes = {} if tracks_only else _table_changes("scores", a.scores, b.scores, tolerance)
    yield from (Difference("scores", a.k, name, *pair) for name, pair in changes.items())


def _frames(sides: tuple[Side, Side], tolerance: Tolerances, *, only: str | None) -> Iterator[Difference]:
    """What differs frame by frame, then what could not be read."""
    a, b = sides[0].archive, sides[1].archive
    if only == "metrics" or (only is None and (a is None or b is None)):
        return
    if a is None or b is None:
        raise UsageError("a summary has no tracks: compare two archives or run folders")
    lost: tuple[list[Damage], list[Damage]] = ([], [])
    scans = [iter_results(path, on_damage=damage.append) for path, damage in zip((a, b), lost, strict=True)]
    for x, y in paired(scans[0], scans[1], lambda scan: scan.k):
        if x is None or y is None:
            yield Difference("scan", (x or y).k, "present", x is not None, y is not None)  # type: ignore[union-attr]
        else:
            yield from compare_scans(x, y, tolerance, tracks_only=only == "tracks")
    yield from (Difference("archive", -1, "damage", damage.message, None) for damage in lost[0])
    yield from (Difference("archive", -1, "damage", None, damage.message) for damage in lost[1])


def paired(a: Iterator[S], b: Iterator[S], k: Callable[[S], int]) -> Iterator[tuple[S | None, S | None]]:
    """Items of the same scan number side by side, None where one side has no such scan."""
    x, y = next(a, None), next(b, None)
    while x is not None or y is not None:
        if y is None or (x is not None and k(x) < k(y)):
            yield x, None
            x = next(a, None)
        elif x is None or k(y) < k(x):
            yield None, y
            y = next(b, None)
        else:
            yield x, y
            x, y = next(a, None), next(b, None)


def _rows(where: str, k: int, a: Any, b: Any, tolerance: Tolerances) -> Iterator[Difference]:
    """Two values of rows: how many, then field by field; tracks and truth are matched by id."""
    if a is None or b is None:
        if a is not b:
            yield Difference(where, k, "present", a is not None, b is not None)
        return
    if len(a) != len(b):
        yield Difference(where, k, "count", len(a), len(b))
    if where not in ("tracks", "truth"):
        if len(a) == len(b):
            yield from _columns(where, k, _table(a), _table(b), tolerance)
        return
    rows_a, rows_b = (dict(zip(np.asarray(v.id).tolist(), range(len(v)), strict=True)) for v in (a, b))
    yield from (Difference(where, k, f"id {i}", "present", None) for i in rows_a if i not in rows_b)
    yield from (Difference(where, k, f"id {i}", None, "present") for i in rows_b if i not in rows_a)
    common = [i for i in rows_a if i in rows_b]
    first = _table(a, np.array([rows_a[i] for i in common], np.int64))
    second = _table(b, np.array([rows_b[i] for i in common], np.int64))
    yield from _columns(where, k, first, second, tolerance, ids=common)


def _table(value: Any, index: Any = None) -> dict[str, Any]:
    """Arrays of a value by name, reduced to the rows of the index; a tuple becomes an array of objects."""
    table: dict[str, Any] = {}
    for f in fields(value):
        column = getattr(value, f.name)
        if isinstance(column, tuple):
            objects = np.empty(len(column), object)
            for i, item in enumerate(column):  # not objects[:] = column, which makes equal contours one array
                objects[i] = item
            column = objects
        table[f.name] = (
            column[index] if index is not None and isinstance(column, np.ndarray) and len(column) else column
        )
    return table


def _columns(
    where: str, k: int, a: Mapping[str, Any], b: Mapping[str, Any], tolerances: Tolerances, *, ids: Sequence[Any] = ()
) -> Iterator[Difference]:
    """The first row of each column that differs."""
    for name, x in a.items():
        y, tolerance = b[name], tolerances.of(where, name)
        if not isinstance(x, np.ndarray) or not isinstance(y, np.ndarray):
            if isinstance(x, np.ndarray) or isinstance(y, np.ndarray) or not _same(x, y, tolerance):
                yield Difference(where, k, name, _told(x), _told(y))
        elif x.shape != y.shape:
            yield Difference(where, k, f"{name} shape", x.shape, y.shape)
        else:
            differs = ~_close(x, y, tolerance).reshape(len(x), math.prod(x.shape[1:])).all(axis=1)
            if differs.any():
                row = int(differs.argmax())
                what = f"id {ids[row]}: {name}" if ids else f"{name}[{row}]"
                yield Difference(where, k, what, _told(x[row]), _told(y[row]))


def _close(x: Any, y: Any, tolerance: Tolerance) -> Any:
    """Where two arrays are the same; nan is nan."""
    if x.dtype == object:
        return np.array([_same_items(u, v, tolerance) for u, v in zip(x, y, strict=True)], bool)
    same = np.asarray(x == y)
    if x.dtype.kind != "f":
        return same
    same |= np.isnan(x) & np.isnan(y)
    finite = np.isfinite(x) & np.isfinite(y) & ~same
    u, v = x[finite], y[finite]
    with np.errstate(over="ignore", under="ignore"):
        same[finite] = np.abs(u - v) <= tolerance.atol + tolerance.rtol * np.maximum(np.abs(u), np.abs(v))
    return same


def _same_items(u: Any, v: Any, tolerance: Tolerance) -> bool:
    """Whether two names or two contours are the same."""
    if isinstance(u, np.ndarray):
        return u.shape == v.shape and bool(_close(u, v, tolerance).all())
    return bool(u == v)


def _told(value: Any) -> Any:
    """The value in plain Python."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _changed(sides: tuple[Side, Side], part: str, tolerances: Tolerances) -> dict[str, tuple[Any, Any]]:
    """Changed entries of a part of the summaries, None where one side has none."""
    a, b = (flat(side.summary.get(part)) for side in sides)
    return _table_changes(part, a, b, tolerances)


def _table_changes(
    part: str, a: Mapping[str, Any], b: Mapping[str, Any], tolerances: Tolerances
) -> dict[str, tuple[Any, Any]]:
    names = sorted({*a, *b})
    return {n: (a.get(n), b.get(n)) for n in names if not _same(a.get(n), b.get(n), tolerances.of(part, n))}


def _same(a: Any, b: Any, tolerance: Tolerance) -> bool:
    """Whether two entries are the same; None stands for nan, as in JSON."""
    x, y = (math.nan if v is None else v for v in (a, b))
    numbers = isinstance(x, float | int) and isinstance(y, float | int)
    if numbers and (tolerance.whole or isinstance(x, float) or isinstance(y, float)):
        return bool(_close(np.array([x], float), np.array([y], float), tolerance)[0])
    return bool(x == y)


def _scan_table(archived: ArchivedScan) -> dict[str, Any]:
    scan = archived.scan
    table = _table(scan) | _table(scan.sensor)
    return table | {"n_spokes": archived.n_spokes, "sensor": scan.sensor.id}
