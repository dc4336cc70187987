"""Tracks that start where AIS first tells of a ship, the "qualified" ones of dataset, sec. 3.4: confirmed at once."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from maritrack import geo
from maritrack.objects import course
from maritrack.objects.course import Courses
from maritrack.settings import Config
from maritrack.trackers import tracklist
from maritrack.trackers.tracklist import TrackList
from maritrack.types import BoolArray, Clusters, FloatArray, Scan, Truth, take

SLOW_MPS = 0.3  # below it a course says nothing
NEAR = 3.0  # standard deviations of a start within which a track has it already


def begun(
    tracks: TrackList, courses: Courses, told: tuple[str, ...], truth: Truth, scan: Scan, config: Config
) -> tuple[TrackList, Courses, tuple[str, ...]]:
    """The list with a track for each ship in sight that is told of for the first time, and all ids told so far.

    It starts at the reported place, course and speed, at the beginning of the scan. Where a track is already within
    three standard deviations of a start, none is added.
    """
    new = np.array([i for i, key in enumerate(truth.id) if key not in told], np.int64)
    new = new[geo.visible(scan, truth.position_m[new], config.input.roi_min_m, config.input.roi_max_m)]
    told = (*told, *(truth.id[i] for i in new.tolist()))
    rules = config.centroid
    if len(tracks) and len(new):
        away = truth.position_m[new][:, None, :] - tracks.density.x[None, :, :2]
        new = new[(np.hypot(away[..., 0], away[..., 1]) > NEAR * rules.start_position_m).all(axis=1)]
    if len(new) == 0:
        return tracks, courses, told
    velocity = np.nan_to_num(truth.velocity_mps[new])
    place = truth.position_m[new] + tracklist.seconds(np.array([scan.t_start_ns - truth.t_ns])) * velocity
    known = np.asarray(np.isfinite(truth.velocity_mps[new]).all(axis=1))
    start = _started(place, velocity, known, config)
    clusters = _places(place, scan)
    grown = tracklist.start(
        tracks, clusters, np.arange(len(new)), np.full(len(new), scan.t_start_ns), np.ones(len(new)), config
    )  # fmt: skip
    fresh = np.arange(len(tracks), len(grown))
    confirmed, cluster, hits = grown.confirmed.copy(), grown.cluster.copy(), grown.hits.copy()
    confirmed[fresh], cluster[fresh], hits[fresh] = True, -1, 0
    join = np.concatenate
    courses = Courses(
        join([courses.x, start.x]), join([courses.P, start.P]), join([courses.steered, start.steered])
    )  # fmt: skip
    density = replace(grown.density, x=grown.density.x.copy(), P=grown.density.P.copy())
    flat = course.cartesian(take(courses, fresh))
    density.x[fresh], density.P[fresh] = flat.x, flat.P
    return replace(grown, density=density, confirmed=confirmed, cluster=cluster, hits=hits), courses, told


def _started(place_m: FloatArray, velocity_mps: FloatArray, told: BoolArray, config: Config) -> Courses:
    """Courses of ships at places (n, 2); without a course where they hardly move, or AIS does not tell one."""
    rules, n = config.centroid, len(place_m)
    speed = np.hypot(velocity_mps[:, 0], velocity_mps[:, 1])
    steered = told & (speed > SLOW_MPS)
    x = np.column_stack([place_m, velocity_mps])
    x[steered, 2] = np.arctan2(velocity_mps[steered, 0], velocity_mps[steered, 1])
    x[steered, 3] = speed[steered]
    variance = np.full((n, 4), rules.start_position_m**2)
    still = np.where(told, rules.start_speed_mps, config.model.sigma_velocity_mps) ** 2
    variance[:, 2] = np.where(steered, math.radians(rules.start_course_deg) ** 2, still)
    variance[:, 3] = np.where(steered, rules.start_speed_mps**2, still)
    return Courses(x, variance[:, :, None] * np.eye(4), steered)


def _places(place_m: FloatArray, scan: Scan) -> Clusters:
    n, (range_m, azimuth_rad) = len(place_m), geo.en_to_polar(place_m - scan.position_m)
    none = np.zeros((n, 2, 2))
    return Clusters(
        mean_m=place_m, scatter_m2=none, count=np.ones(n, np.int64), weight_sq=np.ones(n), noise_m2=none,
        t_ns=np.full(n, scan.t_start_ns), range_m=range_m, azimuth_rad=azimuth_rad, intensity=np.zeros(n),
        label=np.zeros(0, np.int64),
    )  # fmt: skip
