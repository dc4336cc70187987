"""Which tracks under way no known ship explains: false ones, and ships without AIS."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from maritrack.metrics.scores import truth_distances
from maritrack.types import CONFIRMED, FloatArray, Tracks, Truth


@dataclass(frozen=True, slots=True, eq=False)
class MovingTrack:
    """A track in the scans in which it was reported as confirmed and moving."""

    id: int
    position_m: FloatArray  # (n, 2) east-north, scan by scan
    near: int  # scans of them with a ship of the truth within the distance

    def explained(self, share: float = 0.5) -> bool:
        """Whether a ship was near in this share of its scans."""
        return self.near >= share * len(self.position_m)


def moving_tracks(scans: Iterable[tuple[Tracks, Truth | None]], *, near_m: float = 250.0) -> list[MovingTrack]:
    """Every track that was ever reported as confirmed and moving, by id. A scan without truth has no ship."""
    places: dict[int, list[FloatArray]] = {}
    near: dict[int, int] = {}
    for tracks, truth in scans:
        which = (tracks.status >= CONFIRMED) & tracks.moving
        distance_m = truth_distances(truth, tracks) if truth is not None else np.zeros((0, len(tracks)))
        close = distance_m.min(axis=0, initial=np.inf) <= near_m
        for row in np.flatnonzero(which).tolist():
            name = int(tracks.id[row])
            places.setdefault(name, []).append(tracks.position_m[row])
            near[name] = near.get(name, 0) + int(close[row])
    return [MovingTrack(name, np.stack(places[name]), near[name]) for name in sorted(places)]
