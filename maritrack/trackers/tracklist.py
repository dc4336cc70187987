"""The state of trackers that keep a list of tracks, and the steps they share: coverage, births, ends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from maritrack import geo
from maritrack.objects import giw, matrix2, reduction
from maritrack.objects.giw import Giw
from maritrack.settings import Config
from maritrack.trackers.clutter import Clutter
from maritrack.trackers.cluttermap import ClutterMap
from maritrack.tracksettings import TrackerConfig
from maritrack.types import (
    COASTED,
    CONFIRMED,
    STATIONARY,
    TENTATIVE,
    BoolArray,
    Clusters,
    FloatArray,
    IntArray,
    Points,
    Scan,
    Tracks,
    take,
)

NOTHING, MISS, HIT = range(3)


@dataclass(frozen=True, slots=True, eq=False)
class TrackList:
    """All that survives from one scan to the next. Rows are tracks, ordered by id."""

    density: Giw
    t_ns: IntArray  # (t,) the time of the density
    existence: FloatArray  # (t,)
    id: IntArray  # (t,)
    hits: IntArray  # (t,) steps (`count`) with an association weight above one half
    misses: IntArray  # (t,) steps in a row without
    confirmed: BoolArray  # (t,)
    lag_m: FloatArray  # (t, 2) position that follows with the time constant of the judgement of motion
    moving: BoolArray  # (t,) judged to be under way
    settled: FloatArray  # (t,) 0..1, how much of the time constant has passed
    cluster: IntArray  # (t,) cluster of the last scan with the largest weight, -1 = missed
    told: IntArray  # (t,) of this step so far: NOTHING, MISS or HIT
    held_s: FloatArray  # (t,) time since the background has covered a confirmed track; 0 = it doesn't
    next_id: int = 1
    clutter: Mapping[str, Clutter] = field(default_factory=dict)  # by sensor
    clutter_map: Mapping[str, ClutterMap] = field(default_factory=dict)  # by sensor
    heard: tuple[str, ...] = ()  # sensors of this step so far
    hulls: Mapping[int, FloatArray] = field(default_factory=dict)  # by id (v, 2), from the track's place

    def __len__(self) -> int:
        return len(self.id)


def seconds(span_ns: IntArray) -> FloatArray:
    """Spans of nanoseconds in seconds."""
    return span_ns.astype(np.float64) * 1e-9


def empty() -> TrackList:
    """No track yet."""
    none = np.zeros(0, np.int64)
    return TrackList(
        Giw(np.zeros((0, 4)), np.zeros((0, 4, 4)), np.zeros((0, 2, 2)), np.zeros(0)),
        none, np.zeros(0), none, none, none, np.zeros(0, bool), np.zeros((0, 2)), np.zeros(0, bool), np.zeros(0), none,
        none, np.zeros(0),
    )  # fmt: skip


def select(tracks: TrackList, index: IntArray | BoolArray) -> TrackList:
    """The tracks `index`, in that order."""
    d = tracks.density
    return replace(
        tracks, density=Giw(d.x[index], d.P[index], d.X[index], d.alpha[index]), t_ns=tracks.t_ns[index],
        existence=tracks.existence[index], id=tracks.id[index], hits=tracks.hits[index], misses=tracks.misses[index],
        confirmed=tracks.confirmed[index], lag_m=tracks.lag_m[index], moving=tracks.moving[index],
        settled=tracks.settled[index], cluster=tracks.cluster[index], told=tracks.told[index],
        held_s=tracks.held_s[index],
    )  # fmt: skip


def count(tracks: TrackList, hit: BoolArray, sensor: str) -> TrackList:
    """The list with one more scan of a sensor, in which `hit` (t,) were seen: hits and misses count once a step.

    A step is a run of scans in which no sensor comes twice: with one sensor a scan, with several of one period a turn
    of all of them in any order; beside a slow sensor the steps, and so `tracker.delete_misses`, are the fast one's,
    wherever it looks. A track that any sensor sees has a hit in that step.
    """
    again = sensor in tracks.heard
    before = np.zeros_like(tracks.told) if again else tracks.told
    first_hit, first_miss = hit & (before < HIT), ~hit & (before == NOTHING)
    return replace(
        tracks,
        heard=(sensor,) if again else (*tracks.heard, sensor),
        told=np.where(hit, HIT, np.maximum(before, MISS)),
        hits=tracks.hits + first_hit,
        misses=np.where(hit, 0, tracks.misses + first_miss),
    )


def beam_time(scan: Scan, points: Points, position_m: FloatArray) -> IntArray:
    """When the beam passes each position (n, 2) in this scan, int64 ns (n,).

    From the spokes of the video; without video from the azimuth of the first point and the length of the
    turn; where all points have one time, that time.
    """
    offset = position_m - scan.position_m
    azimuth = np.arctan2(offset[:, 0], offset[:, 1])
    video = scan.video
    if video is not None and len(video.azimuth_rad) > 1:
        steps = geo.wrap(np.diff(video.azimuth_rad))
        sense = -1.0 if np.median(steps) < 0 else 1.0  # some antennas turn counter-clockwise
        unwrapped = np.concatenate([[0.0], np.cumsum(sense * steps)])
        forward = np.maximum.accumulate(unwrapped)  # a repeated or backward spoke doesn't turn time back
        turned = geo.wrap_positive(sense * (azimuth - video.azimuth_rad[0]))
        since_ns = np.interp(turned, forward, (video.t_ns - video.t_ns[0]).astype(np.float64))
        return np.asarray(video.t_ns[0] + np.rint(since_ns).astype(np.int64))
    duration_ns = scan.t_ns - scan.t_start_ns
    if duration_ns <= 0 or len(points) == 0 or np.ptp(points.t_ns) == 0:
        return np.full(len(position_m), scan.t_ns, np.int64)
    first = int(np.argmin(points.t_ns))
    turned = geo.wrap_positive(azimuth - points.azimuth_rad[first]) / geo.TWO_PI
    since_ns = np.rint(turned * duration_ns).astype(np.int64) + points.t_ns[first] - scan.t_start_ns
    return np.asarray(scan.t_start_ns + since_ns % duration_ns)


def birth_existence(config: Config, clutter_density: FloatArray) -> FloatArray:
    """Existence of new tracks (n,): given, or P_D b / (lambda + P_D b) from the birth density b."""
    if config.tracker.birth_existence > 0:
        return np.full(len(clutter_density), config.tracker.birth_existence)
    born = config.model.p_detect * config.tracker.birth_density_per_m2
    return np.asarray(born / (clutter_density + born))


def room_for(tracks: TrackList, clusters: Clusters, free: IntArray, rules: TrackerConfig) -> tuple[IntArray, int]:
    """The clusters `free` that may start a track, the larger ones first served, and how many may not."""
    room = max(rules.max_tracks - len(tracks), 0)
    if len(free) <= room:
        return free, 0
    largest = np.lexsort((free, -clusters.intensity[free], -clusters.count[free]))[:room]
    return np.sort(free[largest]), len(free) - room


def start(
    tracks: TrackList, clusters: Clusters, free: IntArray, t_ns: IntArray, r0: FloatArray, config: Config
) -> TrackList:
    """The list with new tracks at the clusters `free` with existence r0, moved on to their times t_ns."""
    if len(free) == 0:
        return tracks
    t_ns = np.maximum(t_ns, clusters.t_ns[free])
    new = giw.birth(Clusters(**_rows(clusters, free)), config.model)
    new = giw.predict(new, seconds(t_ns - clusters.t_ns[free]), config.model)
    n, d = len(free), tracks.density
    join = np.concatenate
    return replace(
        tracks,
        density=Giw(join([d.x, new.x]), join([d.P, new.P]), join([d.X, new.X]), join([d.alpha, new.alpha])),
        t_ns=join([tracks.t_ns, t_ns]),
        existence=join([tracks.existence, r0]),
        id=join([tracks.id, tracks.next_id + np.arange(n)]),
        hits=join([tracks.hits, np.ones(n, np.int64)]),
        misses=join([tracks.misses, np.zeros(n, np.int64)]),
        confirmed=join([tracks.confirmed, np.zeros(n, bool)]),
        lag_m=join([tracks.lag_m, clusters.mean_m[free]]),
        moving=join([tracks.moving, np.zeros(n, bool)]),
        settled=join([tracks.settled, np.zeros(n)]),
        cluster=join([tracks.cluster, free]),
        told=join([tracks.told, np.full(n, HIT)]),
        held_s=join([tracks.held_s, np.zeros(n)]),
        next_id=tracks.next_id + n,
    )


def _rows(clusters: Clusters, index: IntArray) -> dict[str, np.ndarray]:
    names = ("mean_m", "scatter_m2", "count", "weight_sq", "noise_m2", "t_ns", "range_m", "azimuth_rad", "intensity")
    return {name: getattr(clusters, name)[index] for name in names} | {"label": np.zeros(0, np.int64)}


def known(tracks: TrackList, t_ns: int, config: Config) -> BoolArray:
    """Tracks (t,) whose place will still be known to `tracker.delete_sigma_m` at an instant, when nothing was seen.

    After a gap the others would take anything in a gate of kilometres for themselves, and be certain again. Far
    away a new track is less certain than that by its one cluster: for it the time since may add as much.
    """
    dt_s, limit2 = np.maximum(seconds(t_ns - tracks.t_ns), 0.0), config.tracker.delete_sigma_m**2
    P = giw.predicted_centroid(tracks.density, np.arange(len(tracks)), dt_s)
    sigma2 = np.maximum(P[:, 0, 0], P[:, 1, 1]) + config.model.accel_psd_m2ps3 * dt_s**3 / 3
    now2 = np.maximum(tracks.density.P[:, 0, 0], tracks.density.P[:, 1, 1])
    return np.asarray(sigma2 <= limit2 + np.where(now2 > limit2, now2, 0.0))


def manage(tracks: TrackList, config: Config) -> TrackList:
    """Confirm, end and unite tracks.

    A track ends when its existence, its misses in a row, its position, its speed or its extent say so; one that
    is not confirmed and lies on an older one is the same object.
    """
    rules, model, d = config.tracker, config.model, tracks.density
    confirmed = tracks.confirmed | ((tracks.existence >= rules.confirm_existence) & (tracks.hits >= rules.confirm_hits))
    sigma2 = np.maximum(d.P[:, 0, 0], d.P[:, 1, 1])
    alive = (
        (tracks.existence >= rules.delete_existence)
        & (tracks.misses <= rules.delete_misses)
        & ((sigma2 <= rules.delete_sigma_m**2) | (tracks.held_s > 0))
        & (np.hypot(d.x[:, 2], d.x[:, 3]) <= model.max_speed_mps)
        & (tracks.held_s <= rules.stationary_s)
    )
    if model.extent == "random-matrix":
        half_m2 = matrix2.eigen(d.X)[0][:, 0]
        alive &= (half_m2 <= rules.delete_axis_m**2) & ((tracks.misses == 0) | (d.alpha > rules.delete_alpha))
    tracks = replace(tracks, confirmed=confirmed)
    if rules.duplicate_distance_m > 0:
        alive &= ~duplicates(tracks, rules)
    if rules.part_distance2 > 0:
        alive &= ~parts(tracks, rules.part_distance2, model.rho)
    return tracks if alive.all() else select(tracks, alive)


def duplicates(tracks: TrackList, rules: TrackerConfig) -> BoolArray:
    """Tracks (t,) that are another one over again: near in position and in velocity to one that has lasted better.

    That is one that is confirmed, then the one with more hits, then the older one. A quay that was tracked once, and
    that a ship takes along as she passes, is older than she is, but nobody has seen it since.
    """
    x = tracks.density.x
    pairs = cKDTree(x[:, :2]).query_pairs(rules.duplicate_distance_m, output_type="ndarray") if len(x) > 1 else None
    double = np.zeros(len(x), bool)
    if pairs is None or len(pairs) == 0:
        return double
    same = np.hypot(*(x[pairs[:, 0], 2:] - x[pairs[:, 1], 2:]).T) <= rules.duplicate_speed_mps
    place = np.empty(len(x), np.int64)
    place[np.lexsort((tracks.id, -tracks.hits, ~tracks.confirmed))] = np.arange(len(x))
    a, b = pairs[same].T
    double[np.where(place[a] < place[b], b, a)] = True
    return double


def parts(tracks: TrackList, distance2: float, rho: float) -> BoolArray:
    """Tracks (t,) not yet confirmed that are a part of one that is: in its hull, moving with it as far as one can tell.

    A hull that breaks into several clusters stays one track; two tracks that are confirmed never end each other.
    """
    order = np.lexsort((tracks.id, ~tracks.confirmed))
    ranked = take(tracks.density, order)
    i, j = reduction.near_pairs(ranked, distance2, hull=rho * ranked.X)
    whole = tracks.confirmed[order]
    part = np.zeros(len(tracks), bool)
    part[order[j[whole[i] & ~whole[j]]]] = True
    return part


def follow(tracks: TrackList, dt_s: FloatArray, rules: TrackerConfig) -> TrackList:
    """The list with its lagging positions moved on by dt_s (t,), and what moves judged anew."""
    tau_s = rules.moving_time_constant_s
    share, x = -np.expm1(-dt_s / tau_s), tracks.density.x
    behind = tracks.lag_m - (x[:, :2] - dt_s[:, None] * x[:, 2:])  # of where the track was
    followed = replace(
        tracks,
        lag_m=x[:, :2] - (tau_s * share)[:, None] * x[:, 2:] + (1.0 - share)[:, None] * behind,
        settled=tracks.settled + share * (1.0 - tracks.settled),
    )
    return replace(followed, moving=moving(followed, rules))


def moving(tracks: TrackList, rules: TrackerConfig) -> BoolArray:
    """Whether each track (t,) is under way: velocity beyond its uncertainty, speed, way made good.

    Way made good is the distance to a position that follows with a time constant: v tau at a steady v, and
    little for an echo that jumps to and fro within its own length. It must exceed a distance and a share of
    the length; more lengths where velocity and velocity made good disagree, as they do on a shore that
    flickers. Small boats may turn as they like. A track that was moving stays so at half of each limit.
    """
    ease = np.where(tracks.moving, 0.5, 1.0)
    d = tracks.density
    v, gone = d.x[:, 2:], d.x[:, :2] - tracks.lag_m
    made_good = gone / np.maximum(rules.moving_time_constant_s * tracks.settled, 1e-3)[:, None]
    speed, speed_made_good = np.hypot(v[:, 0], v[:, 1]), np.hypot(made_good[:, 0], made_good[:, 1])
    unsteady = np.hypot(*(v - made_good).T) / np.maximum(np.maximum(speed, speed_made_good), 1e-9)
    length_m = 2.0 * np.sqrt(np.maximum(matrix2.eigen(d.X)[0][:, 0], 0.0))
    lengths = rules.moving_lengths * np.maximum(1.0, unsteady / rules.moving_unsteadiness)
    return np.asarray(
        (matrix2.form(matrix2.inverse(d.P[:, 2:, 2:]), v) > ease * rules.moving_chi2)
        & (np.hypot(gone[:, 0], gone[:, 1]) > ease * (rules.moving_displacement_m + lengths * length_m))
        & (speed > ease * rules.moving_speed_mps)
        & (length_m <= rules.moving_length_max_m)
        & (tracks.hits >= rules.moving_hits)
    )


def estimate(tracks: TrackList, rules: TrackerConfig) -> Tracks:
    """What the list says to the outside."""
    d = tracks.density
    seen = np.where(tracks.misses >= rules.coast_misses, COASTED, CONFIRMED)
    status = np.where(tracks.confirmed, np.where(tracks.held_s > 0, STATIONARY, seen), TENTATIVE)
    return Tracks(
        id=tracks.id, t_ns=tracks.t_ns, position_m=d.x[:, :2].copy(), velocity_mps=d.x[:, 2:].copy(), cov=d.P,
        extent_m2=d.X, existence=tracks.existence, status=status.astype(np.int64), moving=tracks.moving,
        cluster=tracks.cluster, extent_dof=d.alpha,
        contour_m=tuple(tracks.hulls[i] + x for i, x in zip(tracks.id.tolist(), d.x[:, :2], strict=True))
        if tracks.hulls else (),
    )  # fmt: skip
