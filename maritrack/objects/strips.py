"""Objects and clusters that can be near each other, strip by strip, so that a large scene isn't asked pair by pair."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from maritrack.types import FloatArray, IntArray

STRIP = 64  # objects looked at together


def strips(
    position_m: FloatArray, reach_m: FloatArray, centre_m: FloatArray, *, most_pairs: int
) -> Iterator[tuple[IntArray, IntArray]]:
    """Indices of some objects, and of the clusters that any of them may reach; each object comes once.

    Objects at `position_m` (n, 2) reach `reach_m` (n,), clusters are at `centre_m` (c, 2). Strips run from west to
    east, and a strip with its clusters has at most `most_pairs` pairs, or one object.
    """
    by_east, clusters = np.argsort(position_m[:, 0], kind="stable"), np.argsort(centre_m[:, 0], kind="stable")
    east_m = centre_m[clusters, 0]
    at = 0
    while at < len(by_east):
        n = STRIP
        while True:
            rows = by_east[at : at + n]
            low = np.searchsorted(east_m, (position_m[rows, 0] - reach_m[rows]).min(), side="left")
            high = np.searchsorted(east_m, (position_m[rows, 0] + reach_m[rows]).max(), side="right")
            if n == 1 or len(rows) * int(high - low) <= most_pairs:
                break
            n = max(n // 4, 1)
        at += len(rows)
        found = clusters[low:high]
        south_m, north_m = (position_m[rows, 1] - reach_m[rows]).min(), (position_m[rows, 1] + reach_m[rows]).max()
        inside = (centre_m[found, 1] >= south_m) & (centre_m[found, 1] <= north_m)
        yield rows, np.sort(found[inside])
