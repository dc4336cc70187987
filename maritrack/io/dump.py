"""CAT240 records as plain dictionaries, in file order: for people, JSON Lines and CSV.

Integers are as sent; an item that was not sent is a key that is not there.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from maritrack.io.cat240.exact import TOD_PER_DAY, Summary, Video
from maritrack.io.cat240.reader import Part, read_parts
from maritrack.io.containers.kinds import RAW, Opened
from maritrack.io.containers.places import Places, payloads
from maritrack.io.datagrams import NO_TIME, Stream
from maritrack.io.source import Octets
from maritrack.types import Damage

Row = dict[str, Any]

CSV_FIELDS = (
    "offset", "type", "sac", "sic", "idx", "header", "start_az", "end_az", "start_az_deg", "end_az_deg", "span_raw",
    "centre_az_deg", "start_rg", "cell_dur", "cell_m", "range_first_cell_m", "range_last_cell_m", "compressed", "res",
    "bits", "nbvb", "nbcells", "block", "rep", "tod", "tod_s", "summary", "re_hex", "sp_hex", "cells", "warning",
    "count", "message", "received_s", "stream",
)  # fmt: skip
FULL_TURN = 65_536


def dump_records(chunks: Iterable[bytes | memoryview], *, cells: bool = False, name: str = "input") -> Iterator[Row]:
    """One dictionary for each record of a CAT240 stream, video and summary, and one for each problem, in its place.

    A record has `offset` (octet of the input where it starts) and what it holds; `cells` adds the cells delivered.
    A problem is {"warning": code, "offset", "message"}, with "count" where it stands for several blocks in a row; a
    radial that is dropped shows only as its problem. `name` is what messages call the input.
    """
    for part in read_parts(chunks, fast=False):
        yield from _rows_of(part, cells=cells, name=name)


def dump_recording(octets: Octets, *, cells: bool = False, stream: str = "") -> Iterator[Row]:
    """The same of a recording in any container.

    Offsets count in the container, unpacked. A record out of datagrams has `received_s` (UNIX, or of the day) and
    `stream` ("source > destination") where the container tells them.
    """
    opened = Opened(octets, stream=stream)
    if opened.name == RAW:
        for row in dump_records(opened.chunks(), cells=cells, name=octets.name):
            yield from (_damage_row(one, octets.name) for one in opened.damage())
            yield row
        yield from (_damage_row(one, octets.name) for one in opened.damage())
        return
    places = Places()
    joined = payloads(opened, places, name=octets.name)
    for part in read_parts(joined, fast=False, stream_of=places.stream_of):
        yield from (_damage_row(one, octets.name) for one in places.told())
        for row in _rows_of(part, cells=cells, name=octets.name):
            offset = np.array([row["offset"]])
            at = places.rows(offset)
            row["offset"] = int(places.back(offset, at)[0])
            yield row if "warning" in row else row | _received(opened.streams, places, int(at[0]))
        places.forget(part.start + part.span)
    yield from (_damage_row(one, octets.name) for one in places.told())


def _received(streams: Sequence[Stream], places: Places, row: int) -> Row:
    """When and from whom a record came, as far as it is known."""
    t_ns, ends = int(places.t_ns[row]), streams[int(places.stream[row])]
    told: Row = {} if t_ns == NO_TIME else {"received_s": t_ns / 1e9}
    return told | ({"stream": f"{ends.source} > {ends.destination}"} if any(ends) else {})


def _rows_of(part: Part, *, cells: bool, name: str) -> Iterator[Row]:
    places = [
        *((video.at + part.window_base, 0, i) for i, video in enumerate(part.videos)),
        *((summary.at + part.window_base, 1, i) for i, summary in enumerate(part.summaries)),
        *((damage.offset, 2, i) for i, damage in enumerate(part.damage)),
    ]
    for offset, kind, i in sorted(places):
        if kind == 0:
            yield _video_row(part, i, offset, cells=cells)
        elif kind == 1:
            yield _summary_row(part.summaries[i], offset)
        else:
            yield _damage_row(part.damage[i], name)


def _damage_row(damage: Damage, name: str) -> Row:
    message = f"{name}: {damage.message}" if damage.code == "not-asterix" else damage.message
    row: Row = {"warning": damage.code, "offset": damage.offset, "message": message}
    return row if damage.count == 1 else {**row, "count": damage.count}


def _video_row(part: Part, i: int, offset: int, *, cells: bool) -> Row:
    record, radials = part.videos[i], part.radials
    assert radials is not None  # there are as many videos as radials
    span, n = (record.end_az - record.start_az) % FULL_TURN, int(radials.n_cells[i])
    cell_m = float(radials.cell_m[i])
    row: Row = {
        "type": 2, "sac": record.sac, "sic": record.sic, "idx": record.idx,
        "header": "femto" if record.femto else "nano", "start_az": record.start_az, "end_az": record.end_az,
        "start_az_deg": record.start_az * 360 / FULL_TURN, "end_az_deg": record.end_az * 360 / FULL_TURN,
        "span_raw": span, "centre_az_deg": (record.start_az + span / 2) % FULL_TURN * 360 / FULL_TURN,
        "start_rg": record.start_rg, "cell_dur": record.cell_dur, "cell_m": cell_m,
        "range_first_cell_m": record.start_rg * cell_m,
        "range_last_cell_m": (record.start_rg + max(n - 1, 0)) * cell_m,
        "compressed": record.compressed, "res": record.res, "bits": record.bits, "nbvb": record.nbvb,
        "nbcells": record.nbcells, "block": record.item, "rep": record.rep,
    }  # fmt: skip
    if cells:
        row["cells"] = radials.cells[i, :n].tolist()
    return _with_tail(row, record, record.text, offset)


def _summary_row(record: Summary, offset: int) -> Row:
    return _with_tail({"type": 1, "sac": record.sac, "sic": record.sic}, record, record.text, offset)


def _with_tail(row: Row, record: Video | Summary, text: bytes | None, offset: int) -> Row:
    """The row with what any record may have, without the items that it has not."""
    row["summary"] = None if text is None else _printable(text)
    row["tod"] = record.tod
    row["tod_s"] = None if record.tod is None or record.tod >= TOD_PER_DAY else record.tod / 128
    row["re_hex"] = None if record.re is None else record.re.hex()
    row["sp_hex"] = None if record.sp is None else record.sp.hex()
    return {**{key: value for key, value in row.items() if value is not None}, "offset": offset}


def _printable(text: bytes) -> str:
    """ASCII text that can't drive a terminal: other octets become U+FFFD."""
    shown = text.decode("ascii", errors="replace")
    return "".join(c if (c >= " " and c != "\x7f") or c in "\t\n\r" else "\ufffd" for c in shown)
