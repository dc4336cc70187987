"""Every setting of a run: frozen dataclasses nested like the line of data. `maritrack.config` loads them.

A number that no paper gives carries `# assumed: why` in its preset.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from maritrack.errors import ConfigError

NAN = math.nan


def _require(ok: bool, message: str) -> None:
    if not ok:
        raise ConfigError(message)


def _in_unit(name: str, value: float) -> None:
    _require(0.0 <= value <= 1.0, f"{name} = {value} is not within 0..1")


def _positive(name: str, value: float) -> None:
    _require(value > 0.0, f"{name} = {value} must be greater than 0")


@dataclass(frozen=True, kw_only=True)
class InputConfig:
    """Where the sensor is and how its numbers are to be read."""

    sensor: str = ""  # which of several: "7-42" (SAC-SIC), "radar", "lidar"; "" = all (Autoferry: radar)
    stream: str = ""  # of a capture: ADDRESS, ADDRESS:PORT or :PORT of either end; "" = all that hold CAT240
    date: str = ""  # ISO day of recordings that tell the time of day only
    lat_deg: float = NAN  # of a fixed radar
    lon_deg: float = NAN
    own_ship: str = ""  # id in the AIS reports of the ship that carries the radar; "" = the one that is marked
    step_s: float = 0.0  # scans that end within a step are of one instant, its end; 0 = each point has its beam's time
    stabilised: Literal["north", "head"] = "north"
    azimuth_edge: Literal["start", "centre", "end"] = "centre"  # the edge that the azimuth means
    azimuth_offset_deg: float = 0.0  # added to every azimuth
    range_offset_m: float = 0.0  # added to every range
    latency_s: float = 0.0  # points are older than their stamp by this
    roi_max_m: float = math.inf  # region of interest, range from the sensor
    roi_min_m: float = 0.0
    beam_width_deg: float = 0.0  # antenna, for the noise of a cluster; 0 = unknown, the cell counts
    pulse_length_m: float = 0.0  # c T/2; 0 = unknown, the cell counts
    scale_db: float = 0.0  # of a logarithmic video, from 0 to full scale: cells weigh their power; 0 = their amplitude
    sigma_range_m: float = 0.0  # noise of a point; 0 = from cell, beam and pulse
    sigma_azimuth_deg: float = 0.0
    sigma_m: float = 0.0  # least noise of a point in any direction
    from_s: float = 0.0  # begin so many seconds after the first scan
    to_s: float = math.inf  # end so many seconds after the first scan
    limit: int = 0  # at most so many scans; 0 = all

    def __post_init__(self) -> None:
        _require(0 <= self.from_s < self.to_s, "input.from_s must be less than input.to_s")
        _require(self.limit >= 0, "input.limit must not be negative")
        _require(0 <= self.scale_db <= 200, f"input.scale_db = {self.scale_db} is not within 0..200")
        _require(0 <= self.step_s < math.inf, "input.step_s must not be negative, and finite")
        _require(self.roi_min_m < self.roi_max_m, "input.roi_min_m must be less than input.roi_max_m")
        _require(-90 <= self.lat_deg <= 90 or math.isnan(self.lat_deg), f"input.lat_deg = {self.lat_deg}")
        _require(-180 <= self.lon_deg <= 180 or math.isnan(self.lon_deg), f"input.lon_deg = {self.lon_deg}")


@dataclass(frozen=True, kw_only=True)
class DetectConfig:
    """Video to points."""

    method: Literal["threshold", "ca-cfar", "os-cfar"] = "threshold"
    threshold: float = 0.5  # of the full scale of a cell; CFAR: least amplitude as well
    cfar_window: int = 16  # training cells on each side, along range
    cfar_guard: int = 4  # guard cells on each side
    cfar_scale: float = 3.0  # times the clutter level
    os_rank: float = 0.75  # quantile of the training cells
    max_points: int = 200_000  # a scan: the threshold rises for a scan that has more

    def __post_init__(self) -> None:
        _in_unit("detect.threshold", self.threshold)
        _in_unit("detect.os_rank", self.os_rank)
        _require(self.cfar_window > 0 and self.cfar_guard >= 0, "detect: cfar_window > 0 and cfar_guard >= 0")
        _positive("detect.cfar_scale", self.cfar_scale)
        _require(self.max_points > 0, "detect.max_points must be greater than 0")


@dataclass(frozen=True, kw_only=True)
class SubtractConfig:
    """Background out of the points."""

    method: Literal["none", "abs"] = "none"
    pixel_m: float = 50.0  # of the grid in east-north
    learning_rate: float = 0.9  # a of eq. 8, a scan: the larger the slower; abs, Table III
    half_life_scans: float = 0.0  # in its place: half of what was learned is forgotten; 0 = by the learning rate
    half_life_s: float = 0.0
    categories: int = 256  # v: counts from 0 to v - 1, more count as v - 1; abs, Table III
    threshold: int = 5  # background has more points in a pixel; abs, Table III
    decision: Literal["map", "tail"] = "map"  # the likeliest count exceeds it, or the probability of more than it
    tail_probability: float = 0.5  # ... this share
    start: Literal["uniform", "empty"] = "uniform"  # all counts alike, or an empty sea
    spare: Literal["none", "moving"] = "none"  # what lies under a track under way is neither learned nor taken
    masks: Literal["sensor", "joint"] = "sensor"  # one model for each sensor, or one for all
    track_from: Literal["converged", "start"] = "start"  # cases 1 and 2 of abs, Table II
    max_range_m: float = math.inf  # farther out nothing is learned nor taken away
    max_pixels: int = 1_000_000  # that ever had a point; beyond, those nearest to empty are forgotten

    def __post_init__(self) -> None:
        _positive("subtract.pixel_m", self.pixel_m)
        _positive("subtract.max_range_m", self.max_range_m)
        _require(0.0 < self.learning_rate < 1.0, f"subtract.learning_rate = {self.learning_rate}: within 0..1")
        _require(2 <= self.categories <= 32768, "subtract.categories is within 2..32768")
        _require(0 <= self.threshold < self.categories - 1, "subtract.threshold is within 0..categories - 2")
        _require(0 < self.tail_probability < 1, "subtract.tail_probability is between 0 and 1")
        _require(self.half_life_scans >= 0 and self.half_life_s >= 0, "subtract: half_life must not be negative")
        _require(not (self.half_life_scans and self.half_life_s), "subtract: half_life_scans or half_life_s, not both")
        _require(self.max_pixels >= 1, "subtract.max_pixels starts at 1")


@dataclass(frozen=True, kw_only=True)
class ClusterConfig:
    """Points to clusters."""

    method: Literal["polar-dbscan", "cartesian-dbscan", "singletons"] = "polar-dbscan"
    eps_m: float = 55.0  # polar, sec. III
    eps_cells: float = 0.0  # at least this many range cells; 0 = eps_m alone
    min_points: int = 3  # polar, sec. III
    min_count: int = 1  # clusters of fewer cells are dropped
    coarse_cell_m: float = math.inf  # cells of this depth and more are longer than boats: there ...
    coarse_min_count: int = 1  # ... clusters of fewer cells are dropped
    max_extent_m: float = math.inf  # clusters longer than this are land or arcs: dropped
    intensity_weighting: bool = True

    def __post_init__(self) -> None:
        _require(0 < self.eps_m < math.inf, f"cluster.eps_m = {self.eps_m} must be greater than 0, and finite")
        counts = (self.min_points, self.min_count, self.coarse_min_count)
        _require(min(counts) >= 1, "cluster: min_points, min_count and coarse_min_count start at 1")
        _positive("cluster.coarse_cell_m", self.coarse_cell_m)


@dataclass(frozen=True, kw_only=True)
class ModelConfig:
    """What trackers share: detection, clutter, motion, extent."""

    extent: Literal["random-matrix", "point"] = "random-matrix"
    p_detect: float = 0.8  # polar, sec. II
    p_survive: float = 0.99  # per second
    p_gate: float = 0.99
    clutter_density_per_m2: float = 1e-4  # clusters per m^2 and scan; polar, sec. II
    clutter: Literal["fixed", "estimated"] = "fixed"
    accel_psd_m2ps3: float = 0.1  # q of the constant-velocity model
    sigma_velocity_mps: float = 10.0  # of a new track, each axis
    max_speed_mps: float = 40.0  # a track that is faster is dropped
    rho: float = 0.25  # scatter of a point = rho X + R
    extent_time_constant_s: float = 30.0
    alpha_birth: float = 4.0
    alpha_max: float = 60.0
    shape: Literal["predictive", "plugin", "none"] = "predictive"
    shape_n_max: int = 10  # 0 = no limit, the paper's reading
    cluster_size: Literal["effective", "count"] = "effective"  # n of eq. 10 and 11: 1 / sum of squared weights, or n_k
    centroid_n_max: int = 20  # points that share in the centroid's noise; 0 = no limit
    centroid_sigma_m: float = 0.0  # bias of a centroid that no averaging removes
    min_axis_m: float = 2.0
    max_axis_m: float = 250.0

    def __post_init__(self) -> None:
        for name in ("p_detect", "p_survive", "p_gate"):
            _in_unit(f"model.{name}", getattr(self, name))
        _require(self.p_gate < 1.0, "model.p_gate must be less than 1")
        _positive("model.clutter_density_per_m2", self.clutter_density_per_m2)
        _positive("model.rho", self.rho)
        _require(self.accel_psd_m2ps3 >= 0, "model.accel_psd_m2ps3 must not be negative")
        _positive("model.extent_time_constant_s", self.extent_time_constant_s)
        _positive("model.p_gate", self.p_gate)
        _require(0 < self.min_axis_m < self.max_axis_m, "model: 0 < min_axis_m < max_axis_m")
        _require(self.alpha_max > 2, "model.alpha_max must be greater than 2")
        _positive("model.max_speed_mps", self.max_speed_mps)
        _require(self.alpha_birth > 2, "model.alpha_birth must be greater than 2")


@dataclass(frozen=True, kw_only=True)
class ClutterMapConfig:
    """Where clusters come that no track takes: a density for each place, added to `model.clutter`."""

    method: Literal["none", "cells"] = "none"
    cell_m: float = 100.0  # of the grid in east-north
    memory_s: float = 120.0  # time constant
    least_rate: float = 0.2  # clusters a scan, in a cell and its neighbours, that what passes may leave: no clutter
    counts: Literal["untaken", "not-moving"] = "untaken"  # clusters of no track, or of no track under way
    max_cells: int = 100_000  # beyond, those of the lowest rate are forgotten

    def __post_init__(self) -> None:
        _positive("clutter_map.cell_m", self.cell_m)
        _positive("clutter_map.memory_s", self.memory_s)
        _require(self.least_rate >= 0, "clutter_map.least_rate must not be negative")
        _require(self.max_cells >= 1, "clutter_map.max_cells starts at 1")


@dataclass(frozen=True, kw_only=True)
class TrackerConfig:
    """Start, confirm, judge and end tracks."""

    birth_existence: float = 0.6  # polar, sec. II; 0 = P_D b / (lambda + P_D b)
    birth_density_per_m2: float = 1e-6
    confirm_existence: float = 0.99
    confirm_hits: int = 3  # scans with an association weight above one half
    delete_existence: float = 0.05
    delete_misses: int = 10  # in a row
    delete_sigma_m: float = 500.0  # position less certain than this
    delete_alpha: float = 0.0  # extent with no more degrees of freedom, in a scan without a hit; 0 = none
    delete_axis_m: float = math.inf  # longer semi-axis of the extent above this; model.max_axis_m holds it below that
    stationary_s: float = 300.0  # a confirmed track that the background has taken is kept for so long
    covered_detect: float = 0.5  # ... and seen with no less than this share of p_detect, as it may leave at any time
    coast_misses: int = 1  # misses in a row after which a confirmed track is called coasted
    duplicate_distance_m: float = 0.0  # tracks nearer than this ...
    duplicate_speed_mps: float = 2.0  # ... and in velocity than this are one; 0 m = none
    part_distance2: float = 0.0  # new tracks as near the middle of another's hull are parts of it; 0 = none
    moving_chi2: float = 9.0  # v' P^-1 v
    moving_speed_mps: float = 0.5
    moving_displacement_m: float = 15.0  # way made good within about the time constant
    moving_lengths: float = 0.0  # ... and so many lengths of the object
    moving_length_max_m: float = math.inf  # what is longer is a shore
    moving_time_constant_s: float = 30.0
    moving_unsteadiness: float = 0.2  # velocity and velocity made good may differ by this share for that
    moving_hits: int = 0
    max_tracks: int = 5000  # no new ones beyond
    exact_limit: int = 12  # joint association is exact up to this many tracks or clusters a group
    assign_by: Literal["likeliest", "nearest"] = "likeliest"  # cost of hard assignment: with existence or without
    pairs_per_track: int = 0  # clusters a track may choose from, the cheapest ones; 0 = all in its gate

    def __post_init__(self) -> None:
        for name in ("birth_existence", "confirm_existence", "delete_existence"):
            _in_unit(f"tracker.{name}", getattr(self, name))
        _require(self.stationary_s >= 0, "tracker.stationary_s must not be negative")
        _in_unit("tracker.covered_detect", self.covered_detect)
        _positive("tracker.moving_unsteadiness", self.moving_unsteadiness)
        _positive("tracker.moving_time_constant_s", self.moving_time_constant_s)
        _require(self.confirm_hits >= 1, "tracker.confirm_hits starts at 1")
        _require(self.max_tracks >= 1, "tracker.max_tracks starts at 1")
        _require(1 <= self.exact_limit <= 16, "tracker.exact_limit is within 1..16")
        _require(self.pairs_per_track >= 0, "tracker.pairs_per_track must not be negative")
        _positive("tracker.delete_axis_m", self.delete_axis_m)


@dataclass(frozen=True, kw_only=True)
class SprtConfig:
    """The sequential probability ratio test; it confirms and deletes in place of the existence limits of `tracker`."""

    p_false_alarm: float = 0.01  # a false cluster in a gate; polar, sec. II; 0 = from clutter density and gate area
    alpha: float = 1e-3  # a false track is confirmed
    beta: float = 0.05  # a true track is deleted
    start_ratio: float = 0.0  # log-likelihood ratio of a new track; its first cluster is no hit
    existence_max: float = 0.999  # cap, or an old track would never end; not below the limit that confirms
    assignment: Literal["greedy", "optimal"] = "greedy"
    assign_by_shape: bool = False  # a hull takes the cluster that looks like it, not a speck of clutter that is nearer

    def __post_init__(self) -> None:
        _require(0.0 <= self.p_false_alarm < 1.0, f"sprt.p_false_alarm = {self.p_false_alarm} is not between 0 and 1")
        for name in ("alpha", "beta", "existence_max"):
            value = getattr(self, name)
            _require(0.0 < value < 1.0, f"sprt.{name} = {value} is not between 0 and 1")
        low, high = math.log(self.beta / (1.0 - self.alpha)), math.log((1.0 - self.beta) / self.alpha)
        _require(
            low < self.start_ratio < high, f"sprt.start_ratio is between {low:.3g} (delete) and {high:.3g} (confirm)"
        )


@dataclass(frozen=True, kw_only=True)
class PhdConfig:
    """The mixture of the PHD filter; it starts, keeps, reports and ends its components by weight alone."""

    p_survive_scan: float = 0.95  # polar, sec. II, a scan that moves the clock; 0 = model.p_survive, a second
    birth_weight: float = 0.05  # polar, sec. II: "small"; 0 = P_D b / (lambda + P_D b), as tracker.birth_existence
    prune_weight: float = 1e-3
    merge_distance2: float = 4.0  # squared Mahalanobis distance of the states, with the heavier one's covariance
    merge_extent: Literal["gauss-wasserstein", "kl"] = "gauss-wasserstein"  # how alike extents must be
    merge_eps_share: float = 0.25  # Gauss-Wasserstein distance below this share of cluster.eps_m
    merge_kl: float = 25.0  # symmetrised divergence below this
    unite_distance2: float = 0.0  # as near the middle of another's hull, and moving with it: a part of it; 0 = none
    max_components: int = 5000  # the heaviest stay
    extract_weight: float = 0.5  # heavier ones are confirmed ...
    extract_hits: int = 1  # ... after so many scans with a cluster
    hold_scans: int = 0  # misses in a row for which one that was confirmed is shown, and scored, as coasted

    def __post_init__(self) -> None:
        _in_unit("phd.p_survive_scan", self.p_survive_scan)
        _require(0.0 <= self.birth_weight < 1.0, f"phd.birth_weight = {self.birth_weight} is not between 0 and 1")
        _require(0.0 < self.prune_weight < 1.0, f"phd.prune_weight = {self.prune_weight} is not between 0 and 1")
        _require(
            self.birth_weight == 0.0 or self.prune_weight <= self.birth_weight,
            "phd.prune_weight must not be above phd.birth_weight",
        )
        for name in ("merge_distance2", "unite_distance2"):
            _require(getattr(self, name) >= 0, f"phd.{name} must not be negative")
        _require(self.extract_hits >= 1, "phd.extract_hits starts at 1")
        _positive("phd.merge_eps_share", self.merge_eps_share)
        _positive("phd.merge_kl", self.merge_kl)
        _require(self.max_components >= 1, "phd.max_components starts at 1")
        _positive("phd.extract_weight", self.extract_weight)
        _require(self.hold_scans >= 0, "phd.hold_scans must not be negative")


@dataclass(frozen=True, kw_only=True)
class SmoothConfig:
    """What `maritrack smooth` takes for true and for under way, told by the whole life of a track."""

    min_hits: int = 10  # fewer are clutter, even where the tracker confirmed them
    moving_speed_mps: float = 0.5  # median, or it lies at rest for more than half of its life
    moving_displacement_m: float = 30.0  # greatest distance between two of its places ...
    moving_lengths: float = 1.0  # ... and so many of its own lengths: an echo wanders over what it comes from
    moving_length_max_m: float = math.inf  # what is longer is a shore

    def __post_init__(self) -> None:
        _require(self.min_hits >= 1, "smooth.min_hits starts at 1")
        for name in ("moving_speed_mps", "moving_displacement_m", "moving_lengths"):
            _require(getattr(self, name) >= 0, f"smooth.{name} must not be negative")
        _positive("smooth.moving_length_max_m", self.moving_length_max_m)


@dataclass(frozen=True, kw_only=True)
class PakfConfig:
    """Orientation and semi-axes of `pakf-jpda`, and its M-of-N rule; the abs paper gives none of these numbers."""

    sigma_angle_deg: float = 2.0  # random walk of the orientation in a second
    sigma_axis_m: float = 0.3  # random walk of each semi-axis in a second
    angle_floor_deg: float = 3.0  # least noise of a measured orientation
    round_ratio: float = 0.8  # eigenvalues that are nearer than this have no orientation
    course_sigma_deg: float = 0.0  # the hull points along its course within this; 0 = may point anywhere
    course_min_mps: float = 1.0  # ... above this speed
    confirm_hits: int = 3  # M hits ...
    confirm_scans: int = 5  # ... within N steps confirm a track
    tentative_misses: int = 5  # steps in a row that end a track that is not confirmed
    confirmed_misses: int = 15  # ... and one that is

    def __post_init__(self) -> None:
        for name in ("sigma_angle_deg", "sigma_axis_m", "course_sigma_deg", "course_min_mps"):
            _require(getattr(self, name) >= 0.0, f"pakf.{name} must not be negative")
        _positive("pakf.angle_floor_deg", self.angle_floor_deg)
        _require(0.0 < self.round_ratio < 1.0, f"pakf.round_ratio = {self.round_ratio} is not between 0 and 1")
        _require(1 <= self.confirm_hits <= self.confirm_scans <= 60, "pakf: 1 <= confirm_hits <= confirm_scans <= 60")
        _require(1 <= self.tentative_misses <= self.confirmed_misses, "pakf: 1 <= tentative_misses <= confirmed_misses")


@dataclass(frozen=True, kw_only=True)
class ScoreConfig:
    """Metrics, and what counts as truth."""

    c_m: float = 100.0
    p: float = 2.0
    hold_m: float = 100.0  # a truth object is held by a track within this
    moving_only: bool = False
    max_gap_moving_s: float = 30.0  # truth is interpolated over gaps up to this under way ...
    max_gap_rest_s: float = 360.0  # ... and this at rest
    truth_max_m: float = 0.0  # truth counts up to this range; 0 = that of the radar
    truth_lag_s: str = ""  # "MMSI=SECONDS,...": reports of that ship are late by so much
    box_margin_m: float = 0.0  # boxes of vessels are wider by this all around, for fpr and npv

    def __post_init__(self) -> None:
        _require(0 < self.c_m < math.inf, f"score.c_m = {self.c_m} must be greater than 0, and finite")
        _require(1 <= self.p <= 20, "score.p is within 1..20")
        _require(0 <= self.box_margin_m < math.inf, "score.box_margin_m must not be negative, and finite")


@dataclass(frozen=True, kw_only=True)
class OutputConfig:
    """Archive and picture."""

    archive: Literal["full", "hash"] = "full"
    archive_points: bool = True
    chunk_scans: int = 20  # a killed run keeps all but the last of these

    def __post_init__(self) -> None:
        _require(self.chunk_scans >= 1, "output.chunk_scans starts at 1")


@dataclass(frozen=True, kw_only=True)
class Config:
    """All settings of a run."""

    preset: str = ""
    tracker_name: str = "jipda"
    seed: int = 0
    input: InputConfig = field(default_factory=InputConfig)
    detect: DetectConfig = field(default_factory=DetectConfig)
    subtract: SubtractConfig = field(default_factory=SubtractConfig)
    cluster: ClusterConfig = field(default_factory=ClusterConfig)
    model: ModelConfig = field(default_factory=ModelConfig)
    clutter_map: ClutterMapConfig = field(default_factory=ClutterMapConfig)
    tracker: TrackerConfig = field(default_factory=TrackerConfig)
    sprt: SprtConfig = field(default_factory=SprtConfig)
    phd: PhdConfig = field(default_factory=PhdConfig)
    smooth: SmoothConfig = field(default_factory=SmoothConfig)
    pakf: PakfConfig = field(default_factory=PakfConfig)
    score: ScoreConfig = field(default_factory=ScoreConfig)
    output: OutputConfig = field(default_factory=OutputConfig)
