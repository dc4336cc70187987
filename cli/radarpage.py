"""A recording of radar video as a page for people; the document is that of `maritrack.survey`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from . import render

Row = dict[str, Any]
SHOWN = 10  # entries of a list
NONE = "none"


def tell(document: Row) -> None:
    """Print the page."""
    packed = ", gzip" if document["gzipped"] else ""
    print(f"{document['path']}: {document['container']}{packed}, {_octets(document['octets'])}")
    print(f"{_span(document['from'], document['to'], document['duration_s'])}: {document['scans']} scans, "
          f"{document['records']} records")  # fmt: skip
    if document["truth"] is not None:
        print(f"truth of {document['truth']} objects lies beside it")
    for sensor in document["sensors"]:
        lines = list(_sensor(sensor))
        width = max(len(name) for name, _ in lines)
        print(f"\nsensor {sensor['id']}")
        for name, text in lines:
            print(f"  {name.ljust(width)}  {text}")
    for sensor in document["sensors"]:
        _lists(sensor)
    streams = [(f"{row['source']} -> {row['destination']}", str(row["datagrams"])) for row in document["other_streams"]]
    _table("streams without radar video", ("stream", "datagrams"), streams)
    _table("texts of senders without video", ("sensor", "text", "count"), [
        (row["sensor"] or "-", _line(row["text"]), str(row["count"])) for row in document["summaries"]
    ], text_columns=2)  # fmt: skip
    _table("damage", ("code", "sensor", "the first", "at byte", "count"), [
        (row["code"], row["sensor"] or "-", row["message"], str(row["offset"]), str(row["count"]))
        for row in document["damage"]
    ], text_columns=3)  # fmt: skip


def _sensor(s: Row) -> Iterator[tuple[str, str]]:
    """Name and text of each line about a sensor."""
    if s["source"] or s["destination"]:
        yield "stream", f"{s['source'] or '?'} -> {s['destination'] or '?'}"
    yield "SAC/SIC", f"{s['sac']}/{s['sic']}"
    clock = "" if s["clock"] == "none" else f", by {s['clock']}"
    yield "time", _span(s["first_time"], s["last_time"], s["duration_s"]) + clock
    yield "turns", f"{s['scans']}"
    if s["period_s"] is not None:
        yield (
            "period",
            (
                f"{s['period_s']:.4f} s ({s['rotation_rpm']:.2f} rpm), {s['period_least_s']:.4f} to "
                f"{s['period_most_s']:.4f} s"
            ),
        )
        yield "jitter", f"{_ms(s['period_jitter_s'])} standard deviation, {_ms(s['period_spread_s'])} without outliers"
    yield "records", f"{s['records']}" if s["records"] == s["spokes"] else f"{s['records']} of {s['spokes']} spokes"
    if s["spokes_per_turn"] is not None:
        width = f", {s['spoke_width_deg']:.3g} deg wide" if s["spoke_width_deg"] else ""
        yield "spokes", f"{s['spokes_per_turn']} a turn ({s['spokes_least']} to {s['spokes_most']}){width}"
    yield "range", _range(s)
    yield "cells", f"{s['cells']} of {_metres(s['cell_m'])}, {s['bits']} bit, {s['header']} header"
    ratio = "" if s["compression_ratio"] is None else f", {s['compression_ratio']:.3f} of the cells"
    yield "compression", s["compression"] + ratio
    yield "range scale", _times(s["range_changes"], "change", "never changes")
    lost = f"{s['lost_records']} records, {_times(s['losses'], 'time', '')}" if s["losses"] else NONE
    yield "lost", lost
    yield "gaps", f"{s['gaps'] or NONE} longer than {s['gap_over_s']:.2f} s"
    sectors = [f"{row['from_deg']:.1f}-{row['to_deg']:.1f} deg" for row in s["missing_sectors"]]
    more = f" and {len(sectors) - SHOWN} more" if len(sectors) > SHOWN else ""
    yield "no video in", (", ".join(sectors[:SHOWN]) + more) if sectors else "no sector"
    odd = [(s[key], text) for key, text in (
        ("repeated_spokes", "repeated"), ("backward_spokes", "backward"), ("stray_azimuths", "of stray azimuth"),
        ("odd_ranges", "of odd range"), ("clock_steps_back", "set the clock back"),
    )]  # fmt: skip
    yield "odd spokes", ", ".join(f"{n} {text}" for n, text in odd if n) or NONE
    for row in s["summaries"][:SHOWN]:
        yield "summary", f"{_line(row['text'])} ({row['count']} x)"


def _lists(s: Row) -> None:
    """What a sensor has a list of."""
    _table(f"gaps of {s['id']}", ("after", "seconds", "at byte"), [
        (row["at"] or "-", f"{row['seconds']:.3f}", str(row["offset"])) for row in s["gap_list"]
    ], of=s["gaps"])  # fmt: skip
    _table(f"lost records of {s['id']}", ("before", "records", "at byte"), [
        (row["at"] or "-", str(row["records"]), str(row["offset"])) for row in s["loss_list"]
    ], of=s["losses"])  # fmt: skip
    _table(f"range scales of {s['id']}", ("from", "old", "new", "at byte"), [
        (row["at"] or "-", _scale(row["old"]), _scale(row["new"]), str(row["offset"]))
        for row in s["range_change_list"]
    ], text_columns=3, of=s["range_changes"])  # fmt: skip


def _table(
    title: str, header: tuple[str, ...], rows: Sequence[tuple[str, ...]], *, text_columns: int = 1, of: int = 0
) -> None:
    """The first rows as a table, behind an empty line."""
    if rows:
        more = f" (the first {SHOWN} of {max(of, len(rows))})" if max(of, len(rows)) > SHOWN else ""
        print()
        render.table(title + more, header, rows[:SHOWN], text_columns=text_columns)


def _span(first: str | None, last: str | None, seconds: float | None) -> str:
    if first is None or last is None or seconds is None:
        return "time unknown"
    whole = round(seconds)
    parts = [f"{whole // 3600} h"] * (whole >= 3600) + [f"{whole // 60 % 60} min"] * (whole >= 60)
    return f"{first} to {last} ({' '.join([*parts, f'{whole % 60} s'])})"


def _range(row: Row) -> str:
    return f"{_metres(row['range_first_m'])} to {_metres(row['range_m'])}"


def _scale(row: Row) -> str:
    return f"{_range(row)}, {row['cells']} x {_metres(row['cell_m'])}, {row['bits']} bit"


def _metres(length_m: float) -> str:
    if length_m >= 10_000:
        return f"{length_m / 1000:.2f} km"
    return f"{length_m:.0f} m" if length_m >= 100 or length_m == 0 else f"{length_m:.3f} m"


def _ms(time_s: float | None) -> str:
    return "?" if time_s is None else f"{1000 * time_s:.1f} ms"


def _octets(n: int) -> str:
    for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if n >= size:
            return f"{n / size:.3g} {unit}"
    return f"{n} octets"


def _times(n: int, what: str, never: str) -> str:
    return f"{n} {what}{'s' if n != 1 else ''}" if n else never


def _line(text: str) -> str:
    """A text that can't drive a terminal, in one line."""
    return "".join(c if c.isprintable() else "\ufffd" for c in text)
