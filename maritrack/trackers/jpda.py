"""Joint probabilistic data association of centroids: `jpda`, and with the dispersion of the echoes `ec-jpda`.

The dataset paper, sec. 3.3: an extended Kalman filter of course and speed, centroids of clusters as measurements. In
`ec-jpda` the gate and the weights count how far apart the echoes of the scan before were; `jpda` is the same with that
dispersion zero. Tracks start at the first words of AIS or at clusters.

A centroid says nothing of size: where the echoes of a vessel and of the quay beside her are one cluster, its centroid
pulls her track along the quay, and she is lost there. In the open, at anchor, a track is held as by any tracker.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from maritrack.associate.marginals import existence_update, log_missed_weight, sparse_marginals
from maritrack.cluster.stage import sensor_noise
from maritrack.objects import course, giw, matrix2
from maritrack.objects.converted import converted
from maritrack.objects.course import Courses
from maritrack.objects.dispersion import bodies, dispersion, paired
from maritrack.objects.giw import Pairs
from maritrack.settings import Config
from maritrack.trackers import firstwords, steps, tracklist
from maritrack.trackers.steps import Info, Outcome, Sight
from maritrack.trackers.tracklist import TrackList
from maritrack.types import Clusters, FloatArray, Points, Scan, Tracks, Truth, take

P_GATE_MISSED = 1.0  # of eq. 11, whose missed weight is 1 - P_D


@dataclass(frozen=True, slots=True, eq=False)
class Following:
    """The state: tracks with their course and the dispersion of their echoes, row by row."""

    tracks: TrackList  # its densities are those of `courses` with Cartesian velocities
    courses: Courses
    dispersion_m2: FloatArray  # (t, 2, 2)
    told: tuple[str, ...] = ()  # ids of AIS that have started a track


@dataclass(frozen=True, slots=True)
class Jpda:
    """Settings; the state is a Following."""

    config: Config

    def init(self) -> Following:
        """No tracks."""
        return Following(tracklist.empty(), course.empty(), np.zeros((0, 2, 2)))

    def started(self, state: Following, truth: Truth, scan: Scan) -> Following:
        """The state with a track for each ship that AIS tells for the first time.

        With the start at clusters AIS starts none.
        """
        config = rules_of(self.config)
        if config.centroid.start == "clusters":
            return state
        tracks, courses, told = firstwords.begun(state.tracks, state.courses, state.told, truth, scan, config)
        fresh = np.zeros((len(tracks) - len(state.tracks), 2, 2))
        return Following(tracks, courses, np.concatenate([state.dispersion_m2, fresh]), told)

    def update(self, state: Following, scan: Scan, points: Points, clusters: Clusters) -> tuple[Following, Info]:
        """Predict, gate centroids and then points, associate all tracks with all centroids, update, keep the list.

        Reading: dataset sec. 3.3.2 the dispersion of this scan is for the next one.   Eq: dataset-8, dataset-12
        """
        config = rules_of(self.config)
        model, rules = config.model, config.centroid
        there, known = steps.waiting(state.tracks, scan, config)
        state = _rows(replace(state, tracks=there), known)
        z_m, R = measured(clusters, scan, points, config)
        tracks, courses, back = moved(state, scan, points, config)
        limit = steps.gate_limit(model.p_gate)
        pairs, dt_s = paired(tracks.density, state.dispersion_m2, tracks.t_ns, z_m, R, clusters, limit, rules)
        sight = seen(tracks, pairs, dt_s, back, scan, config)
        beta, beta0, existence, given, given0, inexact = associated(sight, clusters, scan, config)
        nu_pairs = gains(pairs, courses, clusters, R, state.dispersion_m2, config)
        after = giw.update(course.as_points(courses.x, courses.P), clusters, nu_pairs, given, given0, model)
        courses = course.settled(Courses(after.x, after.P, courses.steered), rules)
        gated = state.dispersion_m2, pairs, dt_s, tracks.density, points, clusters, limit, rules
        if rules.dispersion == "body":
            passed_s = tracklist.seconds(tracks.t_ns - state.tracks.t_ns)
            spread = bodies(*gated, R=R, weight=given, passed_s=passed_s)
        else:
            spread = dispersion(*gated) * (rules.dispersion == "adaptive")
        hit = beta0 < 0.5
        outcome = Outcome(
            density=course.cartesian(courses),
            existence=existence,
            hit=hit,
            cluster=steps.most_likely(pairs.i, pairs.j, beta, hit, len(tracks)),
            unexplained=np.asarray(1.0 - np.bincount(pairs.j, beta, len(clusters)), np.float64),
            n_inexact=inexact,
        )
        kept, info = steps.carry_on(state.tracks, sight, outcome, scan, points, clusters, config)
        return _joined(sight.tracks, courses, spread, kept, state.told, config), info

    def estimate(self, state: Following) -> Tracks:
        """Tracks at their own times; their extent is the ellipse that evenly filled has the dispersion."""
        return tracklist.estimate(state.tracks, self.config.tracker)


def jpda(config: Config) -> Jpda:
    """The standard one: no dispersion, neither in the gate nor in the weights."""
    return Jpda(replace(config, centroid=replace(config.centroid, dispersion="none")))


@lru_cache(maxsize=4)
def rules_of(config: Config) -> Config:
    """The configuration as these trackers read it: points, and of tracks that exist for sure no probability."""
    rules, sure = config.tracker, config.centroid.existence == "certain"
    if sure:
        rules = replace(rules, birth_existence=1.0, delete_existence=0.0)
    if config.centroid.start == "reference":
        rules = replace(rules, birth_from="none")
    model = replace(config.model, extent="point", centroid_n_max=1)
    return replace(config, tracker=rules, model=replace(model, p_survive=1.0) if sure else model)


def measured(clusters: Clusters, scan: Scan, points: Points, config: Config) -> tuple[FloatArray, FloatArray]:
    """Centroids (c, 2) and the noise (c, 2, 2) of a measurement there; the input's own covariances go first."""
    told = points.cov_m2 is not None or points.noise is not None
    if told or config.centroid.noise == "linear":
        return clusters.mean_m, clusters.noise_m2
    sigma_range_m, sigma_azimuth_rad, sigma_m = sensor_noise(scan, config.input)
    offset_m, R = converted(
        clusters.range_m, clusters.azimuth_rad, sigma_range_m=sigma_range_m, sigma_azimuth_rad=sigma_azimuth_rad
    )
    return offset_m + scan.position_m, R + sigma_m**2 * np.eye(2)


def moved(state: Following, scan: Scan, points: Points, config: Config) -> tuple[TrackList, Courses, bool]:
    """Tracks when the beam of this scan passes them; whether a clock stepped back."""
    tracks, back = steps.predict(state.tracks, scan, points, config)
    dt_s = tracklist.seconds(tracks.t_ns - state.tracks.t_ns)
    courses = course.predict(state.courses, dt_s, config.model, config.centroid)
    return replace(tracks, density=course.cartesian(courses)), courses, back


def seen(tracks: TrackList, pairs: Pairs, dt_s: FloatArray, back: bool, scan: Scan, config: Config) -> Sight:
    """What `steps.look` says of a scan, with these pairs."""
    chance, share, own = steps.chances(tracks, scan, config)
    return Sight(tracks, chance, pairs, dt_s, back, 0, share, own)


def associated(
    sight: Sight, clusters: Clusters, scan: Scan, config: Config
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, int]:
    """Marginals of pairs (k,) and of missed (t,), existence (t,), both marginals given it, and inexact groups.

    Deviates: dataset-9 the default counts clutter once, by its density lambda: W_ij = P_D N(z; zhat, S) / lambda.
    `centroid.clutter` = "density-and-volume" also multiplies by the volume V of the gate, as eq. 9 and 10 have it, and
    clutter is then rarer by 1 / (lambda V). Missed is 1 - P_D.   Eq: dataset-9, dataset-10, dataset-11
    """
    pairs, n, r = sight.pairs, len(sight.tracks), sight.tracks.existence
    sure = config.centroid.existence == "certain"
    r = np.ones(n) if sure else r
    lam = steps.clutter_density(sight.tracks, clusters, scan, config)
    with np.errstate(divide="ignore"):  # a track out of sight has weight 0
        log_w = np.log(sight.p_detect * r)[pairs.i] + giw.log_centroid(pairs) - np.log(lam)[pairs.j]
    if config.centroid.clutter == "density-and-volume":
        limit = steps.gate_limit(config.model.p_gate)
        log_w = log_w + math.log(math.pi * limit) + 0.5 * np.log(matrix2.det(pairs.S))
    log_w0 = log_missed_weight(r, p_detect=sight.p_detect, p_gate=P_GATE_MISSED)
    beta, beta0, inexact = sparse_marginals(
        pairs.i, pairs.j, log_w, log_w0, n, len(clusters), exact_limit=config.tracker.exact_limit,
        murty=config.tracker.hypotheses if config.tracker.beyond_limit == "murty" else 0,
    )  # fmt: skip
    if sure:
        return beta, beta0, r, beta, beta0, inexact
    existence, given, given0 = existence_update(
        pairs.i, beta, beta0, r, p_detect=sight.p_detect, p_gate=P_GATE_MISSED
    )  # fmt: skip
    return beta, beta0, existence, given, given0, inexact


def gains(
    pairs: Pairs, courses: Courses, clusters: Clusters, R: FloatArray, spread_m2: FloatArray, config: Config
) -> Pairs:
    """The pairs with the covariance by which the filter updates.

    Reading: dataset sec. 3.3.3 "standard EKF equations" leaves open what they take for noise: the dispersion over the
    number of points, as of the mean of so many (the default), all of eq. 4, or R alone. A wide gate lets in centroids
    that answers of a racon pull away, and a gain that takes them at their word follows: all of eq. 4 holds best there,
    and lags in turns.
    """
    i, j, rules = pairs.i, pairs.j, config.centroid
    S = courses.P[i][:, :2, :2] + R[j]
    if rules.gain == "dispersion":
        S = S + spread_m2[i]
    elif rules.gain == "mean":
        S = S + spread_m2[i] / clusters.count[j][:, None, None]
    return replace(pairs, PHt=courses.P[i][:, :, :2], S=S, S_inv=matrix2.inverse(S))


def _rows(state: Following, which: np.ndarray) -> Following:
    return replace(
        state, tracks=tracklist.select(state.tracks, which), courses=take(state.courses, which),
        dispersion_m2=state.dispersion_m2[which],
    )  # fmt: skip


def _joined(
    before: TrackList, courses: Courses, spread_m2: FloatArray, kept: TrackList, told: tuple[str, ...], config: Config
) -> Following:
    """The kept list with the courses of its rows. New ones, and those that the background holds, have none yet."""
    old = np.isin(kept.id, before.id)
    row = np.searchsorted(before.id, kept.id[old])
    x, P, steered = kept.density.x.copy(), kept.density.P.copy(), np.zeros(len(kept), bool)
    mine = np.flatnonzero(old)
    free = kept.held_s[mine] == 0
    mine, row_free = mine[free], row[free]
    x[mine], P[mine], steered[mine] = courses.x[row_free], courses.P[row_free], courses.steered[row_free]
    spread = np.zeros((len(kept), 2, 2))
    spread[old] = spread_m2[row]
    density = replace(kept.density, X=spread / config.model.rho)
    return Following(replace(kept, density=density), Courses(x, P, steered), spread, told)
