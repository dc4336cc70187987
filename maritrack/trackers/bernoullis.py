"""Rows of a multi-Bernoulli mixture: objects that may exist, each with a density, as arrays side by side.

A row is what one track is under some hypotheses; several rows may have the same label. Where objects are hulls their
state is beside the track list, which then has the ellipse of it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from maritrack.objects.giw import Giw, segment_sums
from maritrack.trackers import tracklist
from maritrack.trackers.tracklist import TrackList
from maritrack.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Bernoullis:
    """Bernoulli components, or Poisson ones, whose `tracks.existence` is the number of objects expected."""

    tracks: TrackList  # `id` is the label
    rate: FloatArray  # (n, 2) gamma density of the number of points
    x: FloatArray  # (n, s) state of the hull; s = 0 where the track list says all
    P: FloatArray  # (n, s, s)

    def __len__(self) -> int:
        return len(self.tracks)


def nothing(states: int) -> Bernoullis:
    """No component, of hulls with so many states."""
    return Bernoullis(
        tracklist.empty(), np.zeros((0, 2)), np.zeros((0, states)), np.zeros((0, states, states))
    )  # fmt: skip


def rows(b: Bernoullis, index: IntArray | BoolArray) -> Bernoullis:
    """The components `index`, in that order."""
    return Bernoullis(tracklist.select(b.tracks, index), b.rate[index], b.x[index], b.P[index])


def join(parts: list[Bernoullis]) -> Bernoullis:
    """All components of all; what belongs to the list as a whole is that of the first."""
    first = parts[0].tracks
    arrays: dict[str, Any] = {
        f.name: np.concatenate([getattr(part.tracks, f.name) for part in parts])
        for f in fields(first)
        if isinstance(getattr(first, f.name), np.ndarray)
    }
    densities = [part.tracks.density for part in parts]
    density = Giw(*(np.concatenate([getattr(d, name) for d in densities]) for name in ("x", "P", "X", "alpha")))
    both = np.concatenate
    return Bernoullis(
        replace(first, density=density, **arrays),
        both([p.rate for p in parts]), both([p.x for p in parts]), both([p.P for p in parts]),
    )  # fmt: skip


def blend(b: Bernoullis, into: IntArray, row: IntArray, weight: FloatArray, lead: IntArray) -> Bernoullis:
    """Components of the moments of mixtures: part k is row[k] of b with weight[k], in mixture into[k], ordered.

    The weights count given that the object exists: each row's own existence takes part. Existence is the mixture's;
    all that is no density is that of the row `lead` (m,).
    """
    n = len(lead)
    r = weight * b.tracks.existence[row]
    total = np.bincount(into, r, n)
    share = (r / np.where(total > 0.0, total, 1.0)[into])[:, None]
    d = b.tracks.density
    out = rows(b, lead)
    x, P = _moments(d.x[lead], d.x[row], d.P[row], into, share)
    flat = np.concatenate([d.X[row].reshape(-1, 4), d.alpha[row, None], b.rate[row]], axis=1)
    sums = segment_sums(into, flat * share, n)
    hull_x, hull_P = (b.x[lead], b.P[lead]) if b.x.shape[1] == 0 else _moments(
        b.x[lead], b.x[row], b.P[row], into, share
    )  # fmt: skip
    density = Giw(x, P, sums[:, :4].reshape(n, 2, 2), sums[:, 4])
    tracks = replace(out.tracks, density=density, existence=np.minimum(total, 1.0))
    return Bernoullis(tracks, sums[:, 5:], hull_x, hull_P)


def _moments(
    at: FloatArray, x: FloatArray, P: FloatArray, into: IntArray, share: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of each mixture, with `at` (m, s) somewhere near."""
    n, s = at.shape
    gap = x - at[into]
    second = (P + gap[:, :, None] * gap[:, None, :]).reshape(len(x), s * s)
    sums = segment_sums(into, np.concatenate([gap, second], axis=1) * share, n)
    mean = sums[:, :s]
    cov = sums[:, s:].reshape(n, s, s) - mean[:, :, None] * mean[:, None, :]
    return at + mean, (cov + cov.transpose(0, 2, 1)) / 2
