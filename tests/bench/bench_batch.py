"""A recording in segments against the run in one piece: which tracks keep their ids, and what is equal behind a seam.

python -m tests.bench.bench_batch JOINED.mcap WHOLE.mcap
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from maritrack.io.archive import iter_messages, read_archive
from maritrack.io.messages import decode_tracks
from maritrack.types import CONFIRMED, Tracks, take

SAME_M = 50.0
AFTER = (1, 10, 60)  # scans behind a seam


def confirmed(path: Path) -> Iterator[tuple[int, Tracks]]:
    """The confirmed tracks of each scan."""
    for message in iter_messages(path, {"/tracks"}):
        tracks = decode_tracks(message.data)
        yield message.k, take(tracks, tracks.status >= CONFIRMED)


def partner(track: int, a: Tracks, b: Tracks) -> int:
    """Id in b of the track nearest to one of a, 0 where none is near."""
    if track not in a.id or len(b) == 0:
        return 0
    gap = np.linalg.norm(b.position_m - a.position_m[np.flatnonzero(a.id == track)[0]], axis=1)
    return int(b.id[gap.argmin()]) if gap.min() <= SAME_M else 0


def seam(scan: int, whole: dict[int, Tracks], joined: dict[int, Tracks], after: int) -> tuple[int, int, int]:
    """Tracks of the whole run alive on both sides, those that have one id in the joined run, and that very id."""
    before, behind = scan - 1, scan - 1 + after
    both = np.intersect1d(whole[before].id, whole[behind].id).tolist()
    names = [(i, *(partner(i, whole[k], joined[k]) for k in (before, behind))) for i in both]
    return len(both), sum(0 < a == b for _, a, b in names), sum(i == a == b for i, a, b in names)


def main(joined_path: Path, whole_path: Path) -> None:
    joined, whole = dict(confirmed(joined_path)), dict(confirmed(whole_path))
    told = json.loads((joined_path.parent / "summary.json").read_text())["segments"]
    print(f"{told['joined']}; {told['scans_with_overlaps']} scans worked on, {told['run_again']} segments run again")
    for s in told["seams"]:
        print(f"  seam at {s['scan']}, run on for {s['run_on']}: {s['tracks']} tracks, {s['kept']} kept, {s['ended']} "
              f"ended, {s['begun']} begun, {s['apart_m']:.2g} m apart at most; agreed: {s['agreed']}")  # fmt: skip
    seams = [s["scan"] for s in told["seams"]]
    for after in AFTER:
        n, one, same = np.sum([seam(s, whole, joined, after) for s in seams], axis=0)
        print(f"{after} scans behind: {n} tracks alive, {one} with one id ({one / n:.1%}), {same} with the same")
    since: dict[int, list[float]] = {}
    pairs: Counter[tuple[int, int]] = Counter()
    for k, tracks in whole.items():
        own = joined[k]
        gap = np.linalg.norm(tracks.position_m[:, None] - own.position_m[None], axis=2)
        nearest = gap.min(axis=1, initial=np.inf)
        name = own.id[gap.argmin(axis=1)] if len(own) else np.zeros(len(tracks), np.int64)
        pairs.update(zip(tracks.id[nearest <= 1.0].tolist(), name[nearest <= 1.0].tolist(), strict=True))
        behind = min((k - s for s in seams if k >= s), default=-1)
        row = since.setdefault(behind // 120 * 120 if behind >= 0 else -1, [0, 0, 0, 0, 0])
        same = (nearest <= 1.0) & (name == tracks.id)
        more = [len(tracks), len(own), (nearest <= 1.0).sum(), (nearest <= 0.01).sum(), same.sum()]
        row[:] = [a + float(b) for a, b in zip(row, more, strict=True)]
    n, m, close, closer, same = np.sum(list(since.values()), axis=0)
    print(f"all: {n:.0f} rows of confirmed tracks (joined {m:.0f}), not within 1 m {n - close:.0f}, not within 1 cm "
          f"{n - closer:.0f}, not within 1 m with the same id {n - same:.0f}")  # fmt: skip
    for behind, (n, m, close, closer, same) in sorted(since.items()):
        where = f"{behind:4.0f}.. scans behind a seam" if behind >= 0 else "before the first seam"
        print(f"{where}: {n:.0f} rows of confirmed tracks (joined {m:.0f}), within 1 m {close / n:.2%}, within 1 cm "
              f"{closer / n:.2%}, with the same id {same / n:.2%}")  # fmt: skip
    best: dict[int, tuple[int, int]] = {}
    for (a, b), n in pairs.items():
        best[a] = max(best.get(a, (0, 0)), (n, b))
    one = sum(n for n, _ in best.values())
    print(f"of these, rows with the one id that their track has in the joined run: {one / sum(pairs.values()):.3%}")
    metrics = [read_archive(path).summary["metrics"] for path in (joined_path, whole_path)]
    print({name: (round(metrics[0][name], 4), round(metrics[1][name], 4)) for name in metrics[1] if metrics[1][name]})


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:3]))
