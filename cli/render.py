"""How answers look: tables for people, one JSON document for programs, progress on standard error."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

    from maritrack.diff import Diff, Difference
    from maritrack.reproduce.claims import Report
    from maritrack.types import Result
    from maritrack.verify import Verification


def emit_json(document: Any) -> None:
    """Exactly one JSON document on standard output; what is not a number is null."""
    print(json_text(document))


def write_json(path: Path, document: Any) -> None:
    """The same document in a file."""
    path.write_text(json_text(document) + "\n", "utf-8")


def json_text(document: Any) -> str:
    """A document as it is emitted."""
    return json.dumps(finite(document), indent=2, sort_keys=True, ensure_ascii=False)


def finite(value: Any) -> Any:
    """The value with nan and infinities as None, which JSON can say."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {str(k): finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(v) for v in value]
    return value


def note(message: str, *, quiet: bool = False) -> None:
    """A line for the person, on standard error."""
    if not quiet:
        print(message, file=sys.stderr)


def table(title: str, header: tuple[str, ...], rows: Sequence[tuple[str, ...]], *, text_columns: int = 1) -> None:
    """A small table on standard output: first the columns of text, then numbers to the right."""
    if not rows:
        return
    widths = [max(len(r[i]) for r in [header, *rows]) for i in range(len(header))]
    print(title)
    for row in [header, *rows]:
        cells = [
            c.ljust(w) if i < text_columns else c.rjust(w) for i, (c, w) in enumerate(zip(row, widths, strict=True))
        ]
        print("  " + "  ".join(cells).rstrip())


def number(value: Any) -> str:
    """A number as people read it."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < 100 else f"{value:.1f}"
    return str(value)


@contextmanager
def progress(*, quiet: bool, total_octets: int = 0, total_scans: int = 0) -> Iterator[Any]:
    """A progress line for a run: scans, tracks, milliseconds a scan, share of octets or scans, time left.

    Nothing when quiet or when standard error is not a terminal.
    """
    if quiet or not sys.stderr.isatty():
        yield None
        return
    state = {"scans": 0, "octets": 0, "drawn": 0.0}
    begun = time.monotonic()

    def tick(result: Result) -> None:
        state["scans"] += 1
        state["octets"] += sum(len(octets) for _, octets in result.frame.inputs)
        now = time.monotonic()
        if now - state["drawn"] < 0.2:
            return
        state["drawn"] = now
        spent = now - begun
        done, total = (state["scans"], total_scans) if total_scans > 0 else (state["octets"], total_octets)
        share = min(done / total, 1.0) if total > 0 else 0.0
        left = f"  {share:4.0%}  {spent * (1 - share) / share:.0f} s left" if share > 0.01 else ""
        text = (
            f"scan {int(state['scans'])}  {len(result.tracks)} tracks  {1e3 * spent / state['scans']:.0f} ms/scan{left}"
        )
        print("\r\x1b[2K" + text, end="", file=sys.stderr, flush=True)

    try:
        yield tick
    finally:
        print("\r\x1b[2K", end="", file=sys.stderr, flush=True)


@contextmanager
def steps(what: str, *, quiet: bool) -> Iterator[Any]:
    """A progress line: `tick(done, of)`, of = 0 where nobody knows. Nothing when quiet or not on a terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    begun = time.monotonic()

    def tick(done: int, of: int) -> None:
        left_s = (time.monotonic() - begun) * (of - done) / max(done, 1)
        of_all = f" of {of}  {left_s:5.0f} s left" if of else ""
        print(f"\r\x1b[2K{what} {done}{of_all}", end="", file=sys.stderr, flush=True)

    try:
        yield tick
    finally:
        print("\r\x1b[2K", end="", file=sys.stderr, flush=True)


@contextmanager
def runs(*, quiet: bool) -> Iterator[Any]:
    """A progress line of a sweep: `tick(done, failed, of)`. Nothing when quiet or not on a terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    begun: list[tuple[int, float]] = []

    def tick(done: int, failed: int, of: int) -> None:
        if not begun:  # the first call tells what was finished before
            begun.append((done, time.monotonic()))
        spent, now = time.monotonic() - begun[0][1], done - begun[0][0]
        rate = f"  {now / max(spent, 1e-9):.2g}/s  {spent * (of - done) / now:.0f} s left" if now else ""
        print(f"\r\x1b[2Kruns {done} of {of}  {failed} failed{rate}", end="", file=sys.stderr, flush=True)

    try:
        yield tick
    finally:
        print("\r\x1b[2K", end="", file=sys.stderr, flush=True)


def summary(document: Mapping[str, Any]) -> None:
    """A run's summary for people."""
    counts = document["counts"]
    kind = "offline" if document.get("offline") else "causal"
    print(
        f"{document['tracker']} ({document['preset']}), {kind}: {counts['scans']} scans, {counts['points']} points, "
        f"{counts['clusters']} clusters, {counts['track_ids_confirmed']} confirmed tracks, "
        f"{counts['track_ids_moving']} of them seen moving"
    )
    scores(document, objects=True)
    if counts["warnings"]:
        rows = [
            (code, first["message"], str(first["count"]), str(first["offset"]) if first["offset"] >= 0 else "-")
            for code, first in document["warnings"].items()
        ]
        table("warnings", ("code", "first", "count", "at byte"), rows, text_columns=2)
    for name, path in document.get("outputs", {}).items():
        print(f"{name}: {path}")


def scores(document: Mapping[str, Any], *, objects: bool) -> None:
    """Metrics, and how each object of the truth was held."""
    limits: Mapping[str, Any] = document.get("score", {})
    said = f" (c = {limits['c_m']:g} m, p = {limits['p']:g})" if limits else ""
    unit = {"gospa": " [m]", "ospa": " [m]", "ospa_localisation": " [m]", "ospa_cardinality": " [m]"}
    unit |= {"gospa_localisation": " [m^p]"}
    rows = [(name + unit.get(name, ""), number(value)) for name, value in sorted(document["metrics"].items())]
    table(f"mean per scan{said}", ("metric", "value"), [row for row in rows if row[1] != "-"])
    held = [
        (
            (o.get("name") or o["id"])[:24], str(o["frames"]), f"{o['held'] / max(o['frames'], 1):.0%}",
            f"{o['held_by_one']:.0%}", str(o["switches"]),
        )
        for o in document.get("objects", []) if objects
    ]  # fmt: skip
    within = f" within {limits['hold_m']:g} m" if limits else ""
    table(
        f"truth: share of scans with a track{within}", ("object", "scans", "any", "one and the same", "switches"), held
    )


def report(found: Report) -> None:
    """A repeated experiment: its tables, then each statement with the numbers that decide it."""
    for shown in found.tables.values():
        rows = [tuple(cell if isinstance(cell, str) else number(cell) for cell in row) for row in shown.rows]
        table(shown.title, shown.header, rows, text_columns=shown.text_columns)
    for claim in found.claims:
        print(f"{'holds' if claim.holds else 'DOES NOT HOLD'}: {claim.name}")
        told = [("ours", claim.ours), ("paper", claim.paper)]
        for whose, values in told:
            if values is not None:
                print(f"  {whose}: {_flat(values)}")
    for name, path in found.figures.items():
        print(f"{name}: {path}")


def _flat(values: Any) -> str:
    """Numbers by name in one line."""
    if isinstance(values, Mapping):
        return ", ".join(f"{key} {_flat(value)}" for key, value in values.items())
    return " ".join(map(_flat, values)) if isinstance(values, (list, tuple)) else number(values)


def view(path: Any) -> None:
    """Open a picture in the Rerun viewer, which goes on by itself."""
    import subprocess

    subprocess.Popen([sys.executable, "-m", "rerun", str(path)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def diff_document(found: Diff) -> dict[str, Any]:
    """What differs, for programs."""
    rows = [_difference(d) for d in found.differences]
    return {
        "equal": found.equal,
        "count": found.count,
        "scans": found.n_scans,
        "first": rows[0] if rows else None,
        "differences": rows,
        "metrics": {name: {"a": a, "b": b, "delta": _delta(a, b)} for name, (a, b) in found.metrics.items()},
        "manifest": [_difference(d) for d in found.manifest],
    }


def diff(found: Diff, a: str, b: str, *, markdown: bool = False) -> None:
    """What differs, for people: the first divergence on top, then the changed metrics."""
    show = markdown_table if markdown else table
    if found.equal:
        print(f"equal{f', {found.n_scans} scans' if found.n_scans else ''}")
    else:
        first = found.differences[0]
        print(f"first: {_where(first)}: {_value(first.a)} in {a}, {_value(first.b)} in {b}")
        print(f"{found.count} differences" + (f" in {found.n_scans} scans" if found.n_scans else ""))
    rows = [(name, _value(x), _value(y), _value(_delta(x, y))) for name, (x, y) in found.metrics.items()]
    show("metrics", ("metric", "a", "b", "change"), rows)
    others = [d for d in found.differences if d.where != "metrics"]
    show("differences", ("where", "a", "b"), [(_where(d), _value(d.a), _value(d.b)) for d in others])
    if found.count > len(found.differences):
        print(f"and {found.count - len(found.differences)} more (--all)")
    if found.manifest and not found.equal:
        show("runs of another", ("what", "a", "b"), [(d.what, _value(d.a), _value(d.b)) for d in found.manifest])


def verification_document(found: Verification) -> dict[str, Any]:
    """What a replay made differently, for programs."""
    return {
        "equal": found.equal,
        "count": found.count,
        "scans": found.n_scans,
        "messages": found.n_messages,
        "differences": [_difference(d) for d in found.differences],
    }


def verification(found: Verification) -> None:
    """What a replay made differently, in one line."""
    if found.equal:
        print(f"the same: {found.n_messages} messages of {found.n_scans} scans")
    else:
        first = found.differences[0]
        told = f"{_where(first)}: {_value(first.a)} archived, {_value(first.b)} replayed"
        more = f" ({found.count - 1} more)" if found.count > 1 else ""
        print(f"different: {first.a or first.b if first.where == 'archive' else told}{more}")


def markdown_table(title: str, header: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> None:
    """A table in Markdown."""
    if rows:
        print(f"\n**{title}**\n")
        for row in [header, ("---",) * len(header), *rows]:
            print("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |")


def _where(d: Difference) -> str:
    return f"{d.where} {d.what}" if d.k < 0 else f"scan {d.k}, {d.where} {d.what}"


def _difference(d: Difference) -> dict[str, Any]:
    return {"where": d.where, "scan": d.k if d.k >= 0 else None, "what": d.what, "a": d.a, "b": d.b,
            "delta": _delta(d.a, d.b)}  # fmt: skip


def _delta(a: Any, b: Any) -> float | None:
    numbers = all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in (a, b))
    return b - a if numbers else None


def _value(value: Any) -> str:
    """A value to the last digit, cut where it is long."""
    text = "-" if value is None else repr(value) if isinstance(value, float) else str(value)
    return text if len(text) <= 48 else text[:45] + "..."
