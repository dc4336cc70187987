"""Points as JSON or JSON Lines (`maritrack-points/1`): a source of frames, and the truth in the document.

The format is told in `io.pointdoc`. A JSON document is read as a whole and its scans sorted by time.
JSON Lines stream: the first line is the header (an object without scans), each further line a scan,
`{"truth": [...]}` or one record of truth; scans may be `WINDOW` lines out of order.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

from maritrack.errors import InputError
from maritrack.io.jsontext import list_of, naming, parse_json, table_of
from maritrack.io.pieces import Piece, frames_by_time
from maritrack.io.pointdoc import Header, fixed_origin, header_of, scan_of, truth_of
from maritrack.io.reference import Reference
from maritrack.io.source import Octets
from maritrack.settings import InputConfig
from maritrack.types import Damage, Frame, Origin

WINDOW = 64


class PointSource:
    """The scans of a document as frames in order of time; those of one sensor where the settings name it.

    `sensor_configs` are settings of single sensors, in place of those of all.
    `reference` is the truth in the document: of JSON Lines, what comes before the first scan. Raises
    InputError for a document that is none. Bad lines of JSON Lines are left out and reported (where
    strict: InputError); without any scan, in `unclaimed`.
    """

    kind = "points"

    def __init__(
        self, octets: Octets, config: InputConfig, *, strict: bool = False,
        sensor_configs: Mapping[str, InputConfig] | None = None,
    ) -> None:  # fmt: skip
        self.unclaimed: tuple[Damage, ...] = ()
        self._octets, self._config, self._strict = octets, config, strict
        with naming(octets.name):
            opened = _open(octets.chunks, config, own=sensor_configs)
            truth, leading = list(opened.truth), []
            for piece in opened.pieces:
                leading.append(replace(piece, truth=()))
                truth.extend(piece.truth)
                if piece.scan is not None:
                    break
            self.reference: Reference | None = truth_of(truth) if truth else None
        self._pieces = chain(leading, opened.pieces)
        self.origin: Origin | None = opened.header.origin or fixed_origin(config)

    def frames(self) -> Iterator[Frame]:
        """Frames from 0 on."""
        seen: dict[str, None] = {}
        self.unclaimed = yield from frames_by_time(
            (_of_run(piece, self._config.sensor, seen) for piece in self._pieces),
            channel=self._octets.channel,
            name=self._octets.name,
            window=WINDOW,
            strict=self._strict,
        )
        if self._config.sensor and seen and self._config.sensor not in seen:
            hint = "sensors in it: " + ", ".join(seen)
            raise InputError(f"{self._octets.name}: no sensor '{self._config.sensor}'", hint=hint)


def point_truth(data: bytes, *, name: str) -> tuple[Reference, Origin | None]:
    """All the truth of a document, and the origin that its positions refer to."""
    with naming(name):
        opened = _open((data,), InputConfig(), truth_only=True)
        records, damage = list(opened.truth), list[Damage]()
        for piece in opened.pieces:
            records.extend(piece.truth)
            damage.extend(piece.damage)
        return truth_of(records, damage=tuple(damage)), opened.header.origin


def point_origin(data: bytes) -> Origin | None:
    """The origin that a document names."""
    return _open((data,), InputConfig(), truth_only=True).header.origin


def split_lines(chunks: Iterable[bytes]) -> Iterator[bytes]:
    """The lines of an input, each with its end."""
    parts: list[bytes] = []
    for piece in chunks:
        begin = 0
        while (end := piece.find(b"\n", begin) + 1) > 0:
            parts.append(piece[begin:end])
            yield b"".join(parts)
            parts, begin = [], end
        parts.append(piece[begin:])
    if rest := b"".join(parts):
        yield rest


@dataclass(frozen=True, slots=True, eq=False)
class _Opened:
    """A document whose header is known."""

    header: Header
    truth: list[Any]  # records in the header or the whole document
    pieces: Iterator[Piece]


def _open(
    chunks: Iterable[bytes], config: InputConfig, *, own: Mapping[str, InputConfig] | None = None,
    truth_only: bool = False,
) -> _Opened:  # fmt: skip
    lines = split_lines(chunks)
    begin = b""
    for line in lines:
        begin += line
        if line.strip():
            break
    try:
        first = parse_json(begin)
    except InputError:  # more than a line
        first = None
    if not isinstance(first, dict) or "scans" in first:
        rest = b"".join(lines)
        begin += rest
        first = parse_json(begin) if first is None or rest.strip() else first
        header = header_of(first, config=config, own=own)
        pieces = iter(()) if truth_only else _document_pieces(first, begin, header)
    else:
        header = header_of(first, config=config, own=own)
        pieces = _line_pieces(lines, header, begin=begin, truth_only=truth_only)
    return _Opened(header, _records(first, where="truth"), pieces)


def _document_pieces(document: Mapping[str, Any], data: bytes, header: Header) -> Iterator[Piece]:
    """The scans of a JSON document, all checked before the first is delivered; the first carries the octets."""
    scans = list_of(document.get("scans", []), where="scans")
    found = [scan_of(scan, header, where=f"scans[{i}]") for i, scan in enumerate(scans)]
    order = sorted(range(len(found)), key=lambda i: found[i][0].t_ns)
    return iter([Piece(b"" if k else data, scan=found[i][0], damage=found[i][1]) for k, i in enumerate(order)])


def _line_pieces(lines: Iterator[bytes], header: Header, *, begin: bytes, truth_only: bool) -> Iterator[Piece]:
    """The header's octets, then what each line of JSON Lines holds."""
    yield Piece(begin)
    offset = len(begin)
    for number, line in enumerate(lines, start=begin.count(b"\n") + 1):
        try:
            yield _line_piece(line, header, number=number, offset=offset, truth_only=truth_only)
        except InputError as error:
            yield Piece(line, damage=(Damage("bad-line", offset, str(error)),))
        offset += len(line)


def _line_piece(line: bytes, header: Header, *, number: int, offset: int, truth_only: bool) -> Piece:
    if not line.strip():
        return Piece(line)
    where = f"line {number}"
    entry = table_of(parse_json(line, line=number, offset=offset), where=where)
    if "points" in entry:
        if truth_only:
            return Piece(line)
        scan, damage = scan_of(entry, header, where=where)
        return Piece(line, scan=scan, damage=damage)
    if "truth" in entry:
        return Piece(line, truth=tuple(_records(entry, where=f"{where}: truth")))
    if "id" in entry:
        return Piece(line, truth=(entry,))
    raise InputError(f"{where}: neither a scan nor truth")


def _of_run(piece: Piece, only: str, seen: dict[str, None]) -> Piece:
    """The piece without scans of other sensors; truth that comes after the first scan is too late."""
    damage = piece.damage
    if piece.truth:
        message = f"{len(piece.truth)} records of truth after the first scan, not used: give the file as truth"
        damage = (*damage, Damage("late-truth", -1, message, count=len(piece.truth)))
    if piece.scan is None:
        return replace(piece, truth=(), damage=damage)
    seen[piece.scan.sensor.id] = None
    return replace(piece, scan=piece.scan if only in ("", piece.scan.sensor.id) else None, truth=(), damage=damage)


def _records(table: Mapping[str, Any], *, where: str) -> list[Any]:
    return list_of(table.get("truth") or [], where=where)
