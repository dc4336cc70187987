"""Read ASTERIX category 240 (radar video, edition 1.3) from any stream of octets.

The authority is the chain of LEN; a record that can't be read costs the rest of its data block, never the file.
Blocks of the usual make are read many at a time, all others by `maritrack.io.cat240.exact`; both ways deliver the
same. Nothing that is wrong is passed over in silence: it comes as Damage with a code and a place.

Memory: a window of the input of at most 8 MiB, a batch of at most 12288 radials and 32 MiB of cells (one radial:
524288 cells) with its octets, and 1 kB for each of the at most 65536 sensors. Time grows with the length of the input.
Cells that inflate to more than 256 times the input so far (and 4 MiB) are dropped.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from maritrack.errors import InputError
from maritrack.io.cat240.cells import (
    Cells,
    Rows,
    cell_type,
    join_rows,
    keep_memory,
    keys_of,
    start_cells,
    take_rows,
)
from maritrack.io.cat240.cutting import charge, ends_of, split
from maritrack.io.cat240.exact import Summary, Video
from maritrack.io.cat240.exactcells import Sent, exact_cells
from maritrack.io.cat240.framing import Window, pieces, window
from maritrack.io.cat240.items import Trouble
from maritrack.io.cat240.order import Memory, screen
from maritrack.io.cat240.parallel import Inflater, ahead, inflater
from maritrack.io.cat240.radials import Batch, Radials, Text, as_radials, summed
from maritrack.io.cat240.scan import Chain, Found, scan
from maritrack.types import BoolArray, Damage, IntArray

DOUBT = 1 << 20  # octets of cells of a batch whose inflation failed: those of the next one are not tried many at a time


class Part(NamedTuple):
    """A stretch of the input: a Batch before its damage is summed up, with the records that were read exactly."""

    start: int
    octets: bytes | memoryview
    span: int  # octets that it stands for
    radials: Radials | None
    damage: list[Damage]
    videos: list[Video]  # of `radials`, where all were read exactly
    summaries: list[Summary]
    window_base: int  # octet of the input that the places in `videos` and `summaries` count from
    packed: IntArray | None  # (n,) octets of the cells of each radial, as sent


class _Stretch(NamedTuple):
    """A stretch of a window that makes a part; places count from the start of the window."""

    w: Window
    start: int
    end: int
    rows: Rows
    affordable: BoolArray
    usual: IntArray  # index of the rows whose cells are under way
    cells: Callable[[], tuple[Cells, BoolArray]] | None  # theirs, and which of them failed
    videos: list[Video]  # that rows refer to
    damage: list[Damage]
    summaries: list[Summary]


@dataclass(slots=True)
class _State:
    """What the reader carries along the input."""

    chain: Chain
    cells: bool  # are wanted
    inflater: Inflater
    stream_of: Callable[[IntArray], IntArray] | None  # of octets of the input, None = there is one stream
    inflated: int = 0  # cells
    trusting: bool = True  # no stream has inflated to more than it declared
    doubtful: bool = False  # so much failed in the last batch that each stream is to be inflated once alone
    sensors: dict[int, Memory] = field(default_factory=dict)


def read_batches(
    chunks: Iterable[bytes | memoryview],
    *,
    strict: bool = False,
    name: str = "input",
    fast: bool = True,
    cells: bool = True,
    stream_of: Callable[[IntArray], IntArray] | None = None,
    start: int = 0,
    memories: dict[int, Memory] | None = None,
    workers: int = 1,
) -> Iterator[Batch]:
    """The radials of a CAT240 stream, cut into `chunks` anywhere, in batches whose octets add up to the input.

    Radials that repeat one of the last records of their sensor are left out. With `strict` the first damage raises
    InputError, which calls the input `name`. `fast=False` reads every record the exact way, with the same result.
    Without `cells` there are headers alone: `n_cells` as declared, and what is wrong with cells isn't seen.
    `stream_of` tells the stream of each of some octets of the input, where it is joined from several.
    With several `workers` as many processes inflate, and the input is read some batches ahead; the result is the same.
    To go on in the middle: `start` is the first octet, at which a data block should begin, and `memories` are of the
    records before it.
    """
    parts = read_parts(
        chunks, fast=fast, cells=cells, stream_of=stream_of, start=start, memories=memories, workers=workers
    )
    for part in parts:
        damage = summed(part.damage)
        if strict and damage:
            refuse(damage[0], name)
        texts = tuple(text_of(summary, part.window_base) for summary in part.summaries)
        yield Batch(part.start, part.octets, part.radials, damage, part.span, texts, part.packed)


def text_of(summary: Summary, base: int) -> Text:
    """What a summary says; its place counts from octet `base` of the input."""
    sensor = "" if summary.sac is None else f"{summary.sac}-{summary.sic}"
    return Text(base + summary.at, sensor, summary.text)


def refuse(damage: Damage, name: str) -> NoReturn:
    """What `strict` does at the first damage."""
    raise InputError(f"{name}: {damage.message} at byte {damage.offset} ({damage.code})")


def file_chunks(path: str | Path, *, size: int = 4 << 20) -> Iterator[bytes]:
    """The octets of a file (or pipe) in pieces of `size`. InputError where it can't be read.

    Not a memory map: reading is as fast, works on pipes, and a file that is cut meanwhile can't kill the process.
    """
    try:
        with open(path, "rb", buffering=0) as file:
            while chunk := file.read(size):
                yield chunk
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error


def read_parts(
    chunks: Iterable[bytes | memoryview],
    *,
    fast: bool,
    cells: bool = True,
    stream_of: Callable[[IntArray], IntArray] | None = None,
    start: int = 0,
    memories: dict[int, Memory] | None = None,
    workers: int = 1,
) -> Iterator[Part]:
    """What `read_batches` and `dump_records` are made of."""
    keep_memory()
    with inflater(workers) as one:
        state = _State(Chain(fast), cells, one, stream_of, sensors={} if memories is None else memories)
        for stretch in ahead(_stretches(chunks, start, state), one):
            yield _part(stretch, state)


def _stretches(chunks: Iterable[bytes | memoryview], base: int, state: _State) -> Iterator[_Stretch]:
    """The input from octet `base` on, cut into what makes a part each; the inflation of their cells is under way."""
    rest = b""
    for piece in pieces(chunks):
        w = window(base, b"".join((rest, piece)), final=False)
        end = 0
        for stretch in _stretches_of(w, state):
            end = stretch.end
            yield stretch
        rest, base = w.data[end:], base + end
    yield from _stretches_of(window(base, rest, final=True), state)


def _stretches_of(w: Window, state: _State) -> Iterator[_Stretch]:
    at = 0
    while (found := scan(w, at, state.chain)).end > at:
        yield from _cut(w, at, found, state)
        at = found.end


def _cut(w: Window, start: int, found: Found, state: _State) -> Iterator[_Stretch]:
    """The stretches that make up the window from `start` on, as far as it was scanned."""
    rows = join_rows(found.rows)
    affordable, state.inflated = charge(rows, w.base, state.inflated)
    damage = sorted(found.damage, key=lambda one: one.offset)
    bounds = split(rows)
    ends = ends_of(rows, bounds, start, found.end)
    damage_upto = [bisect_left(damage, w.base + end, key=lambda one: one.offset) for end in ends[:-1]]
    summaries_upto = [bisect_left(found.summaries, end, key=lambda one: one.at) for end in ends[:-1]]
    cuts = zip(
        pairwise(bounds), pairwise([start, *ends]), pairwise([0, *damage_upto, len(damage)]),
        pairwise([0, *summaries_upto, len(found.summaries)]), strict=True,
    )  # fmt: skip
    for (first, last), (begin, end), (told, upto), (said, until) in cuts:
        here, can = rows[first:last], affordable[first:last]
        once = here["compressed"] > 0 if state.doubtful else np.zeros(len(here), dtype=np.bool_)
        index = np.flatnonzero((here["record"] < 0) & can & ~once)
        usual = here if len(index) == len(here) else take_rows(here, index)
        cells = start_cells(w, usual, state.inflater, trusting=state.trusting) if state.cells and len(usual) else None
        summaries = found.summaries[said:until]
        yield _Stretch(w, begin, end, here, can, index, cells, found.videos, damage[told:upto], summaries)


def _part(one: _Stretch, state: _State) -> Part:
    """What a stretch gives."""
    radials, troubles, videos, packed = _radials(one, state)
    damage = sorted([*one.damage, *troubles], key=lambda one: one.offset)
    octets = memoryview(one.w.data)[one.start : one.end] if state.cells else memoryview(b"")
    base, span = one.w.base, one.end - one.start
    return Part(base + one.start, octets, span, radials, damage, videos, one.summaries, base, packed)


def _radials(one: _Stretch, state: _State) -> tuple[Radials | None, list[Damage], list[Video], IntArray | None]:
    """The radials of rows, what was wrong with them, their exact records if all have one, and
    the octets of their cells.
    """
    w, rows, videos = one.w, one.rows, one.videos
    if len(rows) == 0:
        return None, [], [], None
    if state.cells:
        cells, n_cells, troubles = _cells(one, state)
    else:
        cells, n_cells = np.zeros((len(rows), 0), dtype=np.uint8), rows["n_cells"].copy()
        records = ((i, videos[rows["record"][i]]) for i in np.flatnonzero(rows["record"] >= 0).tolist())
        troubles = {i: list(record.troubles) for i, record in records if record.troubles}
    index = np.flatnonzero(n_cells >= 0)
    kept = rows if len(index) == len(rows) else take_rows(rows, index)
    sensor = kept["sac"] << 8 | kept["sic"]
    stream = np.zeros(len(kept), dtype=np.int64) if state.stream_of is None else state.stream_of(w.base + kept["block"])
    duplicate, backwards = screen(state.sensors, sensor=stream << 16 | sensor, keys=keys_of(kept), tod=kept["tod"])
    for i in index[duplicate].tolist():
        troubles[i] = [("duplicate", f"message {rows['idx'][i]} was there before")]
    for i in index[backwards].tolist():
        troubles.setdefault(i, []).append(("tod-backwards", f"time of day steps back at message {rows['idx'][i]}"))
    damage = [
        Damage(code, w.base + int(rows["at"][i]), message, f"{rows['sac'][i]}-{rows['sic'][i]}")
        for i in sorted(troubles)
        for code, message in troubles[i]
    ]
    if duplicate.any():
        index = index[~duplicate]
        kept, stream = take_rows(rows, index), stream[~duplicate]
    if len(index) == 0:
        return None, damage, [], None
    exact = [] if state.chain.fast else [videos[i] for i in rows["record"][index].tolist()]
    return (
        as_radials(w, kept, cells if len(index) == len(rows) else cells[index], n_cells[index], stream),
        damage,
        exact,
        np.ascontiguousarray(kept["octets"]),
    )


def _cells(one: _Stretch, state: _State) -> tuple[Cells, IntArray, dict[int, list[Trouble]]]:
    """Cells (n, most), how many each row has (-1 = the row is dropped), and the troubles of row i."""
    w, rows, affordable, videos = one.w, one.rows, one.affordable, one.videos
    n_cells = rows["n_cells"].copy()
    troubles: dict[int, list[Trouble]] = {}
    usual = np.zeros(len(rows), dtype=np.bool_)
    some, failed = one.cells() if one.cells is not None else (np.zeros((0, 0), dtype=np.uint8), usual[:0])
    usual[one.usual] = ~failed
    if len(one.usual) == len(rows):
        cells = some
    else:
        cells = np.zeros((len(rows), int(n_cells.max())), dtype=cell_type(int(rows["bits"].max())))
        cells[one.usual, : some.shape[1]] = some
    cells[one.usual[failed]] = 0
    lost, odd = 0, np.flatnonzero(~usual)
    octets = (rows["compressed"] * n_cells * rows["bits"])[odd] >> 3  # of cells, inflated
    for i, index, room in zip(odd.tolist(), rows["record"][odd].tolist(), octets.tolist(), strict=True):
        if not affordable[i]:
            n_cells[i], troubles[i] = -1, [("inflation-budget", "the input inflates to too many cells")]
            continue
        record = videos[index] if index >= 0 else None
        found, trouble = exact_cells(w.data, Sent.usual(rows[i]) if record is None else Sent.of(record))
        told = [] if trouble is None else [trouble]
        state.trusting &= trouble is None or trouble[0] != "inflates-beyond-declared"
        lost += room if told else 0
        if found is None:
            n_cells[i], troubles[i] = -1, told
            continue
        n_cells[i], cells[i, : len(found)] = len(found), found
        before = () if record is None else record.troubles
        if told or before:
            troubles[i] = [*before, *told]
    state.doubtful = lost > DOUBT
    return cells, n_cells, troubles
