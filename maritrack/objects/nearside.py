"""The hull behind what is seen of it: a radar hears the near faces of a hull, and not what lies in their shadow.

The power that comes back has a centroid on the near side, and second moments whose axes are not the keel's: under
15 degrees off end on those of the near corner lie 6 to 10 degrees off it. A hull is taken for a superellipse |2x/L|^p +
|2y/W|^p = 1, under parallel rays that send back as much in each metre across; along each ray the echo fades with a
reach of W/4, so that of a broadside all of the width tells, as it does in an evenly filled ellipse (rho = 1/4). Moments
are then W^2 times a function of L/W and of the aspect, tabulated here. Of all hulls in the table those that agree with
the moments seen, as samples of a Wishart distribution, are averaged by their posterior weights.

A hull end on hides its own length: the near corner alone is heard, and the length is what the prior makes of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from maritrack.objects import matrix2
from maritrack.tracksettings import ModelConfig
from maritrack.types import FloatArray, Tracks

VERTICES, RAYS = 64, 32
RATIOS, MOST_RATIO = 16, 16.0  # L/W, evenly in its logarithm from 1
ASPECTS = 41  # from end on to broadside, denser near end on, where moments change fast
REACHES = 4.0  # of the echo in the width of a hull
NEARNESS, NEAR_STEP = 6, 0.15  # hulls as long as so many steps of their distance, 0 = far away
USUAL_RATIO, RATIO_SPREAD = 5.0, 0.7  # assumed: ships are 2.5 to 10 times as long as wide; deviation of log L/W
UNKNOWN_DOF = 20.0  # assumed: of extents of trackers that do not say
BLOCK = 64  # tracks looked at together


@dataclass(frozen=True, slots=True, eq=False)
class NearSide:
    """k hulls of width 1 at one nearness, and what is seen of each, along the line of sight (u) and across it (v).

    The line of sight is that to the centroid of what is seen; v points clockwise.
    """

    log_ratio: FloatArray  # (k,) of length to width
    keel: FloatArray  # (k, 2) cosine and sine of twice its angle, clockwise from the line of sight
    inverse: FloatArray  # (k, 3) uu, 2 uv, vv of the inverse second moments
    log_det: FloatArray  # (k,) of the moments
    log_prior: FloatArray  # (k,)
    centroid: FloatArray  # (k, 2) from the middle of the hull


def build(power: float) -> tuple[NearSide, ...]:
    """Tables by nearness of hulls with outlines of exponent `power`: 2 = ellipses, 4 = ships, large = rectangles."""
    return tuple(_table(outline(power), nearness) for nearness in NEAR_STEP * np.arange(NEARNESS))


def outline(power: float) -> FloatArray:
    """Vertices (v, 2) along and across a hull of length and width 1."""
    turn = 2.0 * math.pi * (np.arange(VERTICES) + 0.5) / VERTICES
    around = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return np.asarray(0.5 * np.sign(around) * np.abs(around) ** (2.0 / power))


def _table(unit: FloatArray, nearness: float) -> NearSide:
    ratios, step = np.geomspace(1.0, MOST_RATIO, RATIOS), np.linspace(0.0, 1.0, ASPECTS)
    aspect = 0.5 * math.pi * (0.25 * step + 0.75 * step**2)
    looks = [seen(unit * [ratio, 1.0], aspect, ratio / max(nearness, 1e-3)) for ratio in ratios.tolist()]
    moments, centroid, keel = (np.stack(column) for column in zip(*looks, strict=True))
    moments, centroid, keel = _both_sides(moments, 1), _both_sides(centroid, 1), _both_sides(keel[..., None], 0)[..., 0]
    share = np.tile(np.gradient(np.concatenate([-aspect[:0:-1], aspect])), (RATIOS, 1))
    share[:, [0, -1]] *= 0.5  # broadside is there twice
    log_ratio = np.repeat(np.log(ratios), share.shape[1])
    prior = np.log(share.ravel()) - 0.5 * ((log_ratio - math.log(USUAL_RATIO)) / RATIO_SPREAD) ** 2
    uu, uv, vv = moments.reshape(-1, 3).T
    det = uu * vv - uv**2
    return NearSide(
        log_ratio, np.stack([np.cos(2.0 * keel.ravel()), np.sin(2.0 * keel.ravel())], axis=1),
        np.stack([vv, -2.0 * uv, uu], axis=1) / det[:, None], np.log(det), prior, centroid.reshape(-1, 2),
    )  # fmt: skip


def _both_sides(of_one: FloatArray, odd: int) -> FloatArray:
    """Values (ratio, aspect, m) for aspects on both sides; column `odd` changes its sign."""
    sign = np.where(np.arange(of_one.shape[2]) == odd, -1.0, 1.0)
    return np.concatenate([of_one[:, :0:-1] * sign, of_one], axis=1)


def seen(hull: FloatArray, aspect_rad: FloatArray, distance: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What is seen of a hull (v, 2) of width 1 under aspects (a,): moments (a, 3) uu, uv, vv about the centroid,
    centroid (a, 2) from the middle, and the angle of the keel (a,), all from the line of sight to the centroid.

    The aspect is the keel's at the middle, which is `distance` away. As much comes back in each metre across.
    """
    c, s = np.cos(aspect_rad)[:, None], np.sin(aspect_rad)[:, None]
    u, v = distance + hull[:, 0] * c - hull[:, 1] * s, hull[:, 0] * s + hull[:, 1] * c  # (a, v)
    bearing = np.arctan2(v, u)
    ray = bearing.min(axis=1)[:, None] + np.ptp(bearing, axis=1)[:, None] * (np.arange(RAYS) + 0.5) / RAYS  # (a, r)
    near, far = _chords(u, v, ray)
    depth = REACHES * (far - near)
    left = np.exp(-depth)
    back = 1.0 - left  # of the power of a ray
    first = (1.0 - left * (1.0 + depth)) / (back * REACHES)  # moments of the depth from which it comes
    second = (2.0 - left * (depth**2 + 2.0 * depth + 2.0)) / (back * REACHES**2)
    w = back * near
    w /= w.sum(axis=1, keepdims=True)
    mean_u, mean_v = (w * (near + first) * np.cos(ray)).sum(axis=1), (w * (near + first) * np.sin(ray)).sum(axis=1)
    away, turned = np.hypot(mean_u, mean_v), np.arctan2(mean_v, mean_u)
    cos, sin = np.cos(ray - turned[:, None]), np.sin(ray - turned[:, None])
    square = w * (near**2 + 2.0 * near * first + second)
    moments = [(square * cos**2).sum(axis=1) - away**2, (square * cos * sin).sum(axis=1), (square * sin**2).sum(axis=1)]
    middle = distance * np.stack([np.cos(turned), -np.sin(turned)], axis=1)
    return np.stack(moments, axis=1), np.stack([away, np.zeros_like(away)], axis=1) - middle, aspect_rad - turned


def _chords(u: FloatArray, v: FloatArray, ray: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distances (a, r) at which rays of bearings (a, r) enter and leave convex outlines (a, v)."""
    c, s = np.cos(ray)[:, :, None], np.sin(ray)[:, :, None]
    along, left = u[:, None] * c + v[:, None] * s, v[:, None] * c - u[:, None] * s  # (a, r, v)
    p, before = np.roll(left, 1, axis=2), np.roll(along, 1, axis=2)
    crosses = (p >= 0.0) != (left >= 0.0)
    at = before + (along - before) * p / np.where(crosses, p - left, 1.0)
    return np.where(crosses, at, np.inf).min(axis=2), np.where(crosses, at, -np.inf).max(axis=2)


def complete(tracks: Tracks, sensor_m: FloatArray, hulls: tuple[NearSide, ...], model: ModelConfig) -> Tracks:
    """Tracks with the extents of the hulls of which their extents are what is seen, and their middles as positions.

    `sensor_m` (2,) is where they were seen from. Points, tracks of a tracker that draws contours, and all tracks
    without `hulls` stay what they are.
    """
    rows = np.flatnonzero(matrix2.det(tracks.extent_m2) > 0.0)
    if not hulls or tracks.contour_m or len(rows) == 0:
        return tracks
    offset = tracks.position_m[rows] - sensor_m
    distance_m = np.maximum(np.hypot(offset[:, 0], offset[:, 1]), 1e-9)
    ahead = offset / distance_m[:, None]
    right = np.stack([ahead[:, 1], -ahead[:, 0]], axis=1)
    across = np.stack([ahead, right], axis=1)  # (n, 2, 2) east-north to line of sight
    S = model.rho * across @ tracks.extent_m2[rows] @ across.transpose(0, 2, 1)
    dof = np.full(len(rows), UNKNOWN_DOF) if tracks.extent_dof is None else tracks.extent_dof[rows]
    fits = _fit(hulls[0], S, dof)  # as if far away ...
    step = np.minimum(np.rint(np.exp(fits[:, 0]) / distance_m / NEAR_STEP).astype(np.int64), len(hulls) - 1)
    for k in np.unique(step[step > 0]).tolist():  # ... and then from where they are
        fits[step == k] = _fit(hulls[k], S[step == k], dof[step == k])
    half_m = np.clip(0.5 * np.exp(fits[:, :2].T), model.min_axis_m, model.max_axis_m)[:, :, None, None]
    keel = np.einsum("ni,nij->nj", np.stack([np.cos(fits[:, 2]), np.sin(fits[:, 2])], axis=1), across)
    along = keel[:, :, None] * keel[:, None, :]
    extent_m2, position_m = tracks.extent_m2.copy(), tracks.position_m.copy()
    extent_m2[rows] = half_m[0] ** 2 * along + half_m[1] ** 2 * (np.eye(2) - along)
    position_m[rows] -= np.einsum("ni,nij->nj", fits[:, 3:], across)
    return replace(tracks, extent_m2=extent_m2, position_m=position_m)


def _fit(hulls: NearSide, S: FloatArray, dof: FloatArray) -> FloatArray:
    """Logarithms of length and width, angle of the keel, centroid from the middle (n, 5), of moments S (n, 2, 2).

    With its likeliest width, W^2 = tr(M^-1 S) / 2, a hull of moments W^2 M has the log likelihood
    -dof log(tr(M^-1 S) / 2 / sqrt det(M^-1 S)).
    """
    packed, out = np.stack([S[:, 0, 0], S[:, 0, 1], S[:, 1, 1]], axis=1), np.zeros((len(S), 5))
    for at in range(0, len(S), BLOCK):
        rows = slice(at, at + BLOCK)
        log_width = 0.5 * np.log(0.5 * packed[rows] @ hulls.inverse.T)  # (n, k)
        log_p = hulls.log_prior - dof[rows, None] * (2.0 * log_width + 0.5 * hulls.log_det)
        w = np.exp(log_p - log_p.max(axis=1, keepdims=True))
        w /= w.sum(axis=1, keepdims=True)
        twice = w @ hulls.keel
        out[rows, 1] = (w * log_width).sum(axis=1)
        out[rows, 0] = out[rows, 1] + w @ hulls.log_ratio
        out[rows, 2] = 0.5 * np.arctan2(twice[:, 1], twice[:, 0])
        out[rows, 3:] = (w * np.exp(log_width)) @ hulls.centroid
    return out
