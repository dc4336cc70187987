"""A segment run on behind its end, until the next one tells the same: so a joined run is that of one piece.

What a tracker has seen long ago has no end by itself. A ship whose track is under way is spared by the background, and
stays under way; the same ship met anew may be taken by the background in each pixel, and never be judged under way.
So no overlap is long enough for all, and what a segment knows at its beginning is not guessed but looked at: the
segment before goes on, with all that it knows, until both tell the same for a while. Up to there what it tells counts,
from there on the next one. Where that does not come before the next one's end, all of that is run again, and what
follows goes on from there: the result is that of one piece in any case.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from maritrack.chain import Chain, ChainState, process
from maritrack.io.archive import Stored, iter_messages
from maritrack.io.messages import decode_tracks, encode_clusters
from maritrack.trackers import Told
from maritrack.types import Frame, Result, Tracks

AGREED = 48  # scans in a row in which both tell the same: two minutes of a ship's radar
NEAR_M, NEAR_EXISTENCE = 0.01, 0.01  # what is the same


def alike(a: Tracks, b: Tracks) -> bool:
    """Whether two trackers tell the same of a scan, but for the numbers of the tracks.

    As many tracks, tentative ones included, each with one of the other at its place, of the same status, that moves
    or does not as this one, and is as likely to exist.
    """
    if len(a) != len(b) or len(a) == 0:
        return len(a) == len(b)
    gap_m, of = cKDTree(b.position_m).query(a.position_m)
    return bool(
        gap_m.max() <= NEAR_M and len(np.unique(of)) == len(of) and (a.status == b.status[of]).all()
        and (a.moving == b.moving[of]).all() and np.abs(a.existence - b.existence[of]).max() <= NEAR_EXISTENCE
    )  # fmt: skip


@dataclass(slots=True)
class Keeper:
    """The steps of a run whose memory is kept; it may begin with one, and be compared with another run's archive."""

    state: ChainState | None = None  # before the next scan
    other: Iterator[list[Stored]] | None = None  # scans of the run that it is compared with
    begin: int = 0  # scans before it do not count, and are not scored
    agreed: int = 0  # scans in a row that tell the same
    end: int = 0  # the scan after the last

    def step(self, chain: Chain, state: ChainState, frame: Frame) -> tuple[ChainState, Result]:
        """As `process`."""
        if frame.k < self.begin and not isinstance(chain.tracker, Told):
            frame = replace(frame, truth=None)
        self.state, result = process(chain, state if self.state is None else self.state, frame)
        self.end = frame.k + 1
        if self.other is not None:
            self.agreed = self.agreed + 1 if _same(result, next(self.other, [])) else 0
        return self.state, result

    def until(self, frames: Iterator[Frame], end: int, end_ns: float) -> Iterator[Frame]:
        """The frames before the scan `end` and the time `end_ns`, and none when both have told the same for long
        enough."""
        for frame in frames:
            if frame.k >= end or frame.t_ns >= end_ns or self.agreed >= AGREED:
                return
            yield frame


def told_by(archive: Path, first: int) -> Iterator[list[Stored]]:
    """Clusters and tracks of each scan of an archive from `first` on."""
    parts: list[Stored] = []
    for message in iter_messages(archive, {"/clusters", "/tracks"}):
        if message.k < first:
            continue
        if parts and message.k != parts[0].k:
            yield parts
            parts = []
        parts.append(message)
    if parts:
        yield parts


def _same(result: Result, parts: list[Stored]) -> bool:
    """The same tracks, and the same clusters to the bit: so the backgrounds took the same points away."""
    data = {part.topic: part.data for part in parts if part.k == result.frame.k}
    if "/clusters" not in data or data["/clusters"] != encode_clusters(result.clusters):
        return False
    return alike(result.tracks, decode_tracks(data["/tracks"]))
