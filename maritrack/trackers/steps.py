"""The steps of a scan that trackers with a list of tracks share: look, weigh, carry on.

Between them each tracker decides in its own way which cluster belongs to which track.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from maritrack import geo
from maritrack.associate.hard import best_per_track
from maritrack.cluster.stage import cylinder_radius_m
from maritrack.objects import giw, matrix2
from maritrack.objects.gate import gate
from maritrack.objects.giw import Giw
from maritrack.settings import Config
from maritrack.trackers import hulls, stationary, tracklist
from maritrack.trackers.clutter import clutter_at, learn_clutter
from maritrack.trackers.cluttermap import learn_map, map_density
from maritrack.trackers.tracklist import TrackList
from maritrack.types import BoolArray, Clusters, FloatArray, IntArray, Points, Scan, take


@dataclass(frozen=True, slots=True)
class Info:
    """What is worth knowing about one update."""

    n_inexact: int = 0  # groups beyond the exact limit
    clock_back: bool = False
    n_cut: int = 0  # pairs in the gate that were not considered
    n_left_out: int = 0  # clusters that started no track because there were too many tracks


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """Tracks when the beam passes them, and the clusters in their gates."""

    tracks: TrackList
    p_detect: FloatArray  # (t,) 0 = this scan did not look there
    pairs: giw.Pairs
    dt_s: FloatArray  # (k,) from the track's time to the cluster's
    clock_back: bool
    n_cut: int
    covered: FloatArray  # (t,) share of each track that the background of any sensor hides
    own: FloatArray  # (t,) ... and that of this one: of what it hides there are fragments at most


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What a tracker has decided."""

    density: Giw
    existence: FloatArray  # (t,)
    hit: BoolArray  # (t,) associated with a weight above one half
    cluster: IntArray  # (t,) with the largest weight, -1 = missed
    unexplained: FloatArray  # (c,) share of each cluster that no track took
    n_inexact: int = 0


def still_known(state: TrackList, scan: Scan, config: Config) -> TrackList:
    """The tracks whose place is known well enough to look for them in this scan; the others end before it.

    Combined pruning by kinematic uncertainty (polar, sec. II), on the predicted state: after the update one hit
    has made it small again. What is held in the background lies where it lay, for its stated time.
    """
    state, known = waiting(state, scan, config)
    return state if known.all() else tracklist.select(state, known)


def waiting(state: TrackList, scan: Scan, config: Config) -> tuple[TrackList, BoolArray]:
    """The list before a scan, what is held lying where it lay, and which of it (t,) is still known."""
    known = tracklist.known(state, middle_ns(scan), config)
    state = stationary.waiting(state, ~known, scan.t_start_ns)
    return state, (known | (state.held_s > 0)) & (state.held_s <= config.tracker.stationary_s)


def middle_ns(scan: Scan) -> int:
    """The time in the middle of a scan."""
    return (scan.t_ns + scan.t_start_ns) // 2


def look(state: TrackList, scan: Scan, points: Points, clusters: Clusters, config: Config) -> Sight:
    """Predict every track to the beam's time and pair it with the clusters in its gate.

    `tracker.pairs_per_track` keeps the best of them alone.
    """
    model, most = config.model, config.tracker.pairs_per_track
    tracks, clock_back = predict(state, scan, points, config)
    d, (chance, share, own) = tracks.density, chances(tracks, scan, config)
    i, j, dt_s, cut = gate(d, clusters, tracks.t_ns, gate_limit(model.p_gate), model)
    pairs = giw.pair_up(d, clusters, i, j, dt_s, model)
    sight = Sight(tracks, chance, pairs, dt_s, clock_back, cut, share, own)
    return keep(sight, best_per_track(i, gate_cost(sight, config), most)) if most > 0 else sight


def chances(tracks: TrackList, scan: Scan, config: Config) -> tuple[FloatArray, FloatArray, FloatArray]:
    """P_D of each track (t,), 0 where this scan does not look, the share of it that any background hides, or its own.

    P_D is less by what the background of this sensor hides. What is held and not looked at is hidden as a whole.
    """
    seen = geo.visible(scan, tracks.density.x[:, :2], config.input.roi_min_m, config.input.roi_max_m)
    own = stationary.covered(tracks, scan, config)
    less = np.maximum(1.0 - own, np.where(own > 0, config.tracker.covered_detect, 1.0))
    share = np.where(seen | (tracks.held_s == 0), stationary.hidden(tracks, scan, config), 1.0)
    return np.where(seen, config.model.p_detect * less, 0.0), share, own


def keep(sight: Sight, which: BoolArray) -> Sight:
    """Only the pairs `which` (k,)."""
    return replace(sight, pairs=take(sight.pairs, which), dt_s=sight.dt_s[which])


def predict(state: TrackList, scan: Scan, points: Points, config: Config) -> tuple[TrackList, bool]:
    """Tracks at the time when the beam of this scan passes them; whether a clock stepped back.

    A scan that is older than a track doesn't move it.
    """
    ahead = np.maximum(tracklist.seconds(middle_ns(scan) - state.t_ns), 0.0)
    rough = state.density.x[:, :2] + ahead[:, None] * state.density.x[:, 2:]
    t_ns = tracklist.beam_time(scan, points, rough)
    dt = tracklist.seconds(t_ns - state.t_ns)
    back = bool((dt < 0).any())
    dt = np.maximum(dt, 0.0)
    existence = state.existence * config.model.p_survive**dt
    density = giw.predict(state.density, dt, config.model)
    return replace(state, density=density, t_ns=np.maximum(t_ns, state.t_ns), existence=existence), back


def gate_limit(p_gate: float) -> float:
    """Squared Mahalanobis distance that holds p_gate of a Gaussian of two dimensions."""
    return -2.0 * math.log1p(-p_gate)


def gate_cost(sight: Sight, config: Config) -> FloatArray:
    """Cost of pairs (k,) for hard assignment: nu' S^-1 nu + log |S|, S the covariance of the gate (full extent).

    Up to a constant it is -2 log of the Gaussian, so that a track that knows little is not nearest to everything.
    With `tracker.assign_by` = "likeliest" the Gaussian counts times the track's existence, so that what is hardly
    a track takes nothing from one that is.
    """
    pairs, tracks = sight.pairs, sight.tracks
    S = giw.predicted_centroid(tracks.density, pairs.i, sight.dt_s) + pairs.Y
    S += config.model.centroid_sigma_m**2 * np.eye(2)
    cost = matrix2.form(matrix2.inverse(S), pairs.nu) + np.log(matrix2.det(S))
    if config.tracker.assign_by == "likeliest":
        cost -= 2.0 * np.log(np.maximum(tracks.existence, np.finfo(np.float64).tiny))[pairs.i]
    return np.asarray(cost)


def log_shape(sight: Sight, clusters: Clusters, scan: Scan, points: Points, config: Config) -> FloatArray:
    """Log likelihood ratio of the shapes of pairs (k,), object against clutter."""
    eps_m = max(config.cluster.eps_m, config.cluster.eps_cells * scan.sensor.range_res_m)
    polar = config.cluster.method == "polar-dbscan"
    V0 = giw.clutter_scatter(clusters, scan.position_m, eps_m, cylinder_radius_m(points, scan) if polar else 0.0)
    return giw.log_shape_ratio(sight.tracks.density, clusters, sight.pairs, V0, config.model)


def log_weights(
    sight: Sight, clusters: Clusters, scan: Scan, points: Points, detected: FloatArray, config: Config
) -> FloatArray:
    """log of detected N / lambda * shape of pairs (k,); `detected` (t,) is P_D, or P_D r.

    P_D P_G (r) times the normalised likelihood of eq. 9, in which 1/P_G cancels.   Eq: polar-9
    """
    tracks, pairs = sight.tracks, sight.pairs
    lam = clutter_density(tracks, clusters, scan, config)
    shape = log_shape(sight, clusters, scan, points, config)
    with np.errstate(divide="ignore"):  # a track out of sight has weight 0, its log is -inf
        log_detected = np.log(detected)[pairs.i]
    return np.asarray(log_detected + giw.log_centroid(pairs) - np.log(lam)[pairs.j] + shape)


def clutter_of_tracks(sight: Sight, scan: Scan, config: Config) -> FloatArray:
    """Clutter density (t,) where the tracks are, per m^2."""
    at, n = sight.tracks.density.x[:, :2], len(sight.tracks)
    range_m, azimuth_rad = geo.en_to_polar(at - scan.position_m)
    none, shapes, whole = np.zeros(n), np.zeros((n, 2, 2)), np.zeros(n, np.int64)
    places = Clusters(
        mean_m=at, scatter_m2=shapes, count=whole, weight_sq=none, noise_m2=shapes, t_ns=sight.tracks.t_ns,
        range_m=range_m, azimuth_rad=azimuth_rad, intensity=none, label=whole[:0],
    )  # fmt: skip
    return clutter_density(sight.tracks, places, scan, config)


def clutter_density(tracks: TrackList, clusters: Clusters, scan: Scan, config: Config) -> FloatArray:
    """Clutter density (c,) at clusters, per m^2 and scan: that of the model, and what the map adds there."""
    sensor = scan.sensor.id
    density = clutter_at(tracks.clutter.get(sensor), clusters, config)
    return np.asarray(density + map_density(tracks.clutter_map.get(sensor), clusters.mean_m, config.clutter_map))


def with_clutter(
    tracks: TrackList, clusters: Clusters, unexplained: FloatArray, scan: Scan, config: Config
) -> TrackList:
    """The list with the clutter of one more scan; `unexplained` (c,) is the share of clusters that no track took."""
    sensor, untaken = scan.sensor.id, unexplained
    clutter = learn_clutter(tracks.clutter.get(sensor), clusters, unexplained, scan, config)
    if clutter is not None:
        tracks = replace(tracks, clutter={**tracks.clutter, sensor: clutter})
    if config.clutter_map.counts == "not-moving":
        untaken = np.ones(len(clusters))
        untaken[tracks.cluster[tracks.moving & (tracks.cluster >= 0)]] = 0.0
    clutter_map = learn_map(tracks.clutter_map.get(sensor), clusters, untaken, scan, config.clutter_map)
    if clutter_map is not None:
        tracks = replace(tracks, clutter_map={**tracks.clutter_map, sensor: clutter_map})
    return tracks


def carry_on(
    state: TrackList, sight: Sight, outcome: Outcome, scan: Scan, points: Points, clusters: Clusters, config: Config
) -> tuple[TrackList, Info]:
    """The list after the decisions: judge motion, learn the clutter, end tracks and start new ones."""
    hit, sensor, unexplained = outcome.hit, scan.sensor.id, outcome.unexplained
    tracks = tracklist.count(sight.tracks, hit, sensor)  # out of sight is a miss: what nobody sees coasts and ends
    tracks = replace(tracks, density=outcome.density, existence=outcome.existence, cluster=outcome.cluster)
    tracks = stationary.hold_covered(tracks, state, hit, sight.covered, scan, config.tracker)
    tracks = tracklist.follow(tracks, tracklist.seconds(tracks.t_ns - state.t_ns), config.tracker)
    tracks = with_clutter(tracks, clusters, unexplained, scan, config)
    tracks = tracklist.manage(tracks, config)
    new = unexplained > 0.5
    if config.tracker.birth_from == "ungated":
        new[sight.pairs.j] = False
    elif config.tracker.birth_from == "none":
        new[:] = False
    free, left_out = tracklist.room_for(tracks, clusters, np.flatnonzero(new), config.tracker)
    r0 = tracklist.birth_existence(config, clutter_density(tracks, clusters, scan, config)[free])
    t_ns = tracklist.beam_time(scan, points, clusters.mean_m[free])
    tracks = tracklist.start(tracks, clusters, free, t_ns, r0, config)
    if config.tracker.hull == "cluster":
        tracks = replace(tracks, hulls=hulls.followed(tracks, points, clusters))
    return tracks, Info(outcome.n_inexact, sight.clock_back, sight.n_cut, left_out)


def most_likely(i: IntArray, j: IntArray, beta: FloatArray, hit: BoolArray, n: int) -> IntArray:
    """Cluster of the largest weight of each track (n,), -1 where the track was missed."""
    best = np.full(n, -1, np.int64)
    order = np.lexsort((beta, i))
    best[i[order]] = j[order]  # the last one written, the largest weight, stays
    return np.where(hit, best, -1)
