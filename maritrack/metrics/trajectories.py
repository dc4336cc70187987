"""From states scan by scan to trajectories, as T-GOSPA takes them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from maritrack.types import BoolArray, FloatArray, Tracks, Truth

States = tuple[tuple[int | str, ...], FloatArray]  # ids (n,), each once, and positions (n, 2)


def trajectories(scans: Sequence[States]) -> FloatArray:
    """Positions (ids, scans, 2) in the order of the ids, nan in scans that do not have one."""
    ids = sorted({name for names, _ in scans for name in names})
    row = {name: i for i, name in enumerate(ids)}
    positions = np.full((len(ids), len(scans), 2), np.nan)
    for k, (names, at) in enumerate(scans):
        positions[[row[name] for name in names], k] = at
    return positions


def truth_states(truth: Truth) -> States:
    """The objects of one scan."""
    return truth.id, truth.position_m


def track_states(tracks: Tracks, which: BoolArray, t_ns: int) -> States:
    """Tracks `which` (t,) of one scan, each moved by its own velocity from its own time to t_ns."""
    since_s = (t_ns - tracks.t_ns[which]) * 1e-9
    return tuple(tracks.id[which].tolist()), tracks.position_m[which] + since_s[:, None] * tracks.velocity_mps[which]
