"""Which track of the segment before a seam is which of the segment behind it, and what all of them are called.

Both segments have tracked the scans of the overlap; over its last ones, tracks of the same object are at the same
places. What is alive in both gets one id. Tracks that are born behind the seam are numbered on, so that the ids are
those of the run in one piece, as long as both segments tell the same tracks at the seam.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from maritrack.io.archive import iter_messages
from maritrack.io.messages import decode_tracks
from maritrack.sweep.segments import Segment, paths, read_report
from maritrack.types import CONFIRMED, FloatArray, Tracks

COMPARED = 10  # last scans of the overlap in which tracks are compared
SAME_M = 30.0  # tracks of the same object are nearer, in the mean of these


@dataclass(frozen=True, slots=True)
class Tail:
    """What a segment says of its tracks about a seam: of its last scans, or of the last of its overlap."""

    by_scan: Mapping[int, Tracks]
    top: int  # highest id up to the seam


@dataclass(frozen=True, slots=True)
class Seam:
    """How the tracks of two segments go together."""

    scan: int  # first behind the seam
    pairs: Mapping[int, int]  # id behind -> id before, of tracks alive in both
    confirmed: frozenset[int]  # before
    before: int  # confirmed tracks alive in the last scan before the seam, by the segment before
    joined: int  # of these, those with a partner
    ended: int  # confirmed, without a partner behind
    begun: int  # confirmed in the segment behind, without a partner before
    apart_m: float  # greatest distance of the partners that are confirmed, in the last scan


@dataclass(frozen=True, slots=True)
class Names:
    """Ids of a segment in the whole run."""

    known: Mapping[int, int]  # of tracks that are alive at its beginning
    held: frozenset[int]  # in the whole run, of those that were confirmed before: they stay so
    top: int  # higher ids are of tracks born behind the seam ...
    shift: int  # ... and get so much more

    def of(self, local: int) -> int:
        """The id in the whole run; 0 for a track that ended before the segment counts."""
        return local + self.shift if local > self.top else self.known.get(local, 0)


@dataclass(frozen=True, slots=True)
class Piece:
    """Scans of an archive that count, in the order of the recording."""

    archive: Path
    begin: int
    end: int
    goes_on: bool  # with the memory, and so the ids, of the piece before
    agreed: bool = True  # the piece before told the same up to the seam


def pieces_of(folder: Path, segments: Sequence[Segment]) -> list[Piece]:
    """What counts of segments that have been run, and run on: the segment before until it tells the same."""
    result = [Piece(paths(folder, segments[0].number).archive, segments[0].begin, segments[0].end, False)]
    for segment in segments[1:]:
        report = read_report(folder, segment.number, on=True)
        end, agreed = (segment.begin, False) if report is None else (int(report["end"]), bool(report["agreed"]))
        if end > segment.begin:
            result.append(Piece(paths(folder, segment.number, on=True).archive, segment.begin, end, True))
        if end < segment.end:
            result.append(Piece(paths(folder, segment.number).archive, end, segment.end, False, agreed))
    return result


def tails(archive: Path, seam: int) -> Tail:
    """The tracks of an archive in the last scans before a seam."""
    by_scan: dict[int, Tracks] = {}
    top = 0
    for message in iter_messages(archive, {"/tracks"}):
        if message.k >= seam:
            break
        tracks = decode_tracks(message.data)
        top = max(top, int(tracks.id.max(initial=0)))
        if message.k >= seam - COMPARED:
            by_scan[message.k] = tracks
    return Tail(by_scan, top)


def match(before: Tail, behind: Tail, seam: int) -> Seam:
    """The tracks alive in the last scan of both sides, those that were at the same places paired."""
    empty = np.zeros(0, np.int64)
    last = [tail.by_scan.get(seam - 1) for tail in (before, behind)]
    ids = [tracks.id if tracks is not None else empty for tracks in last]
    held = [tracks.id[tracks.status >= CONFIRMED] if tracks is not None else empty for tracks in last]
    gap_m = mean_gaps(before.by_scan, behind.by_scan, ids[0].tolist(), ids[1].tolist())
    near = gap_m <= SAME_M
    worth = np.where(near, 2.0 * SAME_M * (min(gap_m.shape, default=0) + 1.0) - np.where(near, gap_m, 0.0), 0.0)
    pairs = {int(ids[1][j]): int(ids[0][i]) for i, j in zip(*linear_sum_assignment(worth, maximize=True), strict=True)
             if near[i, j]}  # fmt: skip
    joined = set(pairs.values())
    return Seam(
        scan=seam, pairs=pairs, confirmed=frozenset(held[0].tolist()), before=len(held[0]),
        joined=sum(i in joined for i in held[0].tolist()), ended=sum(i not in joined for i in held[0].tolist()),
        begun=sum(j not in pairs for j in held[1].tolist()), apart_m=_apart(last[0], last[1], pairs),
    )  # fmt: skip


def mean_gaps(
    a: Mapping[int, Tracks], b: Mapping[int, Tracks], ids_a: Sequence[int], ids_b: Sequence[int]
) -> FloatArray:
    """Mean distance (n, m) of two tracks over the scans that have both, inf where there is none."""
    total, count = np.zeros((2, len(ids_a), len(ids_b)))
    for k in sorted(a.keys() & b.keys()):
        rows, cols = (_places(tracks, ids) for tracks, ids in ((a[k], ids_a), (b[k], ids_b)))
        gap = np.linalg.norm(rows[:, None] - cols[None], axis=2)
        both = np.isfinite(gap)
        total += np.where(both, gap, 0.0)
        count += both
    return np.where(count > 0, total / np.maximum(count, 1.0), np.inf)


def _places(tracks: Tracks, ids: Sequence[int]) -> FloatArray:
    """Positions (n, 2) of these tracks, nan where they are not there."""
    at = {i: row for row, i in enumerate(tracks.id.tolist())}
    places = np.full((len(ids), 2), np.nan)
    for row, i in enumerate(ids):
        if i in at:
            places[row] = tracks.position_m[at[i]]
    return places


def _apart(a: Tracks | None, b: Tracks | None, pairs: Mapping[int, int]) -> float:
    if a is None or b is None or not pairs:
        return 0.0
    held = set(a.id[a.status >= CONFIRMED].tolist())
    chosen = [(j, i) for j, i in pairs.items() if i in held]
    gaps = np.linalg.norm(_places(a, [i for _, i in chosen]) - _places(b, [j for j, _ in chosen]), axis=1)
    return float(gaps.max(initial=0.0))


def seams(pieces: Sequence[Piece]) -> tuple[list[Seam], list[Names]]:
    """All seams of a run, and what the ids of each piece become.

    A track that only the segment behind a seam knows gets a number beyond all others, so that it shifts none of them,
    and keeps it over the seams that follow.
    """
    found: list[tuple[Seam, int, int] | None] = []  # with what Names tells of ids behind it; None where one goes on
    reached, own_top, shift = 0, 0, 0  # highest id that the piece before has given, with what it goes on from
    for a, b in itertools.pairwise(pieces):
        before = tails(a.archive, b.begin)
        reached = max(before.top, own_top, reached)
        if b.goes_on:
            found.append(None)
            continue
        behind = tails(b.archive, b.begin)
        own_top, shift, reached = behind.top, reached + shift - behind.top, behind.top
        found.append((match(before, behind, b.begin), own_top, shift))
    last = tails(pieces[-1].archive, pieces[-1].end)
    names = _names(pieces, found, max(last.top, own_top, reached) + shift)
    return [one[0] for one in found if one is not None], names


def _names(pieces: Sequence[Piece], found: Sequence[tuple[Seam, int, int] | None], top: int) -> list[Names]:
    """The names of all pieces; strangers, alive behind a seam and unknown before it, are called from `top` on."""
    names = [Names({}, frozenset(), 0, 0)]
    for piece, one in zip(pieces[1:], found, strict=True):
        before = names[-1]
        if one is None:
            names.append(before)
            continue
        seam, own_top, shift = one
        known = {j: before.of(i) for j, i in seam.pairs.items()}
        for local in _alive_from(piece.archive, piece.begin):
            if local <= own_top and local not in known:
                top += 1
                known[local] = top
        held = {known[j] for j, i in seam.pairs.items() if i in seam.confirmed or known[j] in before.held}
        names.append(Names(known, frozenset(held), own_top, shift))
    return names


def _alive_from(archive: Path, scan: int) -> list[int]:
    """Ids of the tracks in the first scan behind a seam."""
    for message in iter_messages(archive, {"/tracks"}):
        if message.k >= scan:
            return [int(i) for i in decode_tracks(message.data).id.tolist()]
    return []


def kept(seams_: Iterable[Seam]) -> tuple[int, int]:
    """Confirmed tracks alive at all seams, and those that have kept their ids."""
    listed = list(seams_)
    return sum(seam.before for seam in listed), sum(seam.joined for seam in listed)
