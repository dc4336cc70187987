"""Settings of trackers: what they share, what each has of its own, and what hindsight takes for true.

Part of the tree in `maritrack.settings`. A number that no paper gives carries `# assumed: why` in its preset.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from maritrack.limits import in_unit, positive, require


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
    outline_power: float = 0.0  # p of hulls |2x/L|^p + |2y/W|^p = 1 behind what is seen; 0 = what is seen

    def __post_init__(self) -> None:
        for name in ("p_detect", "p_survive", "p_gate"):
            in_unit(f"model.{name}", getattr(self, name))
        require(self.p_gate < 1.0, "model.p_gate must be less than 1")
        positive("model.clutter_density_per_m2", self.clutter_density_per_m2)
        positive("model.rho", self.rho)
        require(self.accel_psd_m2ps3 >= 0, "model.accel_psd_m2ps3 must not be negative")
        positive("model.extent_time_constant_s", self.extent_time_constant_s)
        positive("model.p_gate", self.p_gate)
        require(0 < self.min_axis_m < self.max_axis_m, "model: 0 < min_axis_m < max_axis_m")
        power = self.outline_power
        require(power == 0.0 or 1.5 <= power <= 50.0, f"model.outline_power = {power} is neither 0 nor within 1.5..50")
        require(self.alpha_max > 2, "model.alpha_max must be greater than 2")
        positive("model.max_speed_mps", self.max_speed_mps)
        positive("model.sigma_velocity_mps", self.sigma_velocity_mps)
        require(self.shape_n_max >= 0, "model.shape_n_max must not be negative; 0 = no limit")
        require(self.centroid_n_max >= 0, "model.centroid_n_max must not be negative; 0 = no limit")
        require(self.alpha_birth > 2, "model.alpha_birth must be greater than 2")


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
        positive("clutter_map.cell_m", self.cell_m)
        positive("clutter_map.memory_s", self.memory_s)
        require(self.least_rate >= 0, "clutter_map.least_rate must not be negative")
        require(self.max_cells >= 1, "clutter_map.max_cells starts at 1")


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
    beyond_limit: Literal["loopy", "murty"] = "loopy"  # jipda, beyond it: belief propagation or the likeliest events
    hypotheses: int = 200  # ... of which so many
    birth_from: Literal["unexplained", "ungated", "none"] = (
        "unexplained"  # clusters that tracks take by half or less, or don't gate; or no cluster
    )
    hull: Literal["none", "cluster"] = (
        "none"  # a track draws the hull of its likeliest cluster; until the next it keeps it
    )
    assign_by: Literal["likeliest", "nearest"] = "likeliest"  # cost of hard assignment: with existence or without
    pairs_per_track: int = 0  # clusters a track may choose from, the cheapest ones; 0 = all in its gate

    def __post_init__(self) -> None:
        for name in ("birth_existence", "confirm_existence", "delete_existence"):
            in_unit(f"tracker.{name}", getattr(self, name))
        require(self.stationary_s >= 0, "tracker.stationary_s must not be negative")
        in_unit("tracker.covered_detect", self.covered_detect)
        positive("tracker.moving_unsteadiness", self.moving_unsteadiness)
        positive("tracker.moving_time_constant_s", self.moving_time_constant_s)
        require(self.confirm_hits >= 1, "tracker.confirm_hits starts at 1")
        require(self.max_tracks >= 1, "tracker.max_tracks starts at 1")
        require(1 <= self.exact_limit <= 16, "tracker.exact_limit is within 1..16")
        require(self.hypotheses >= 1, "tracker.hypotheses starts at 1")
        require(self.pairs_per_track >= 0, "tracker.pairs_per_track must not be negative")
        positive("tracker.delete_axis_m", self.delete_axis_m)


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
        require(0.0 <= self.p_false_alarm < 1.0, f"sprt.p_false_alarm = {self.p_false_alarm} is not between 0 and 1")
        for name in ("alpha", "beta", "existence_max"):
            value = getattr(self, name)
            require(0.0 < value < 1.0, f"sprt.{name} = {value} is not between 0 and 1")
        low, high = math.log(self.beta / (1.0 - self.alpha)), math.log((1.0 - self.beta) / self.alpha)
        require(
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
        in_unit("phd.p_survive_scan", self.p_survive_scan)
        require(0.0 <= self.birth_weight < 1.0, f"phd.birth_weight = {self.birth_weight} is not between 0 and 1")
        require(0.0 < self.prune_weight < 1.0, f"phd.prune_weight = {self.prune_weight} is not between 0 and 1")
        require(
            self.birth_weight == 0.0 or self.prune_weight <= self.birth_weight,
            "phd.prune_weight must not be above phd.birth_weight",
        )
        for name in ("merge_distance2", "unite_distance2"):
            require(getattr(self, name) >= 0, f"phd.{name} must not be negative")
        require(self.extract_hits >= 1, "phd.extract_hits starts at 1")
        positive("phd.merge_eps_share", self.merge_eps_share)
        positive("phd.merge_kl", self.merge_kl)
        require(self.max_components >= 1, "phd.max_components starts at 1")
        positive("phd.extract_weight", self.extract_weight)
        require(self.hold_scans >= 0, "phd.hold_scans must not be negative")


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
            require(getattr(self, name) >= 0.0, f"pakf.{name} must not be negative")
        positive("pakf.angle_floor_deg", self.angle_floor_deg)
        require(0.0 < self.round_ratio < 1.0, f"pakf.round_ratio = {self.round_ratio} is not between 0 and 1")
        require(1 <= self.confirm_hits <= self.confirm_scans <= 60, "pakf: 1 <= confirm_hits <= confirm_scans <= 60")
        require(1 <= self.tentative_misses <= self.confirmed_misses, "pakf: 1 <= tentative_misses <= confirmed_misses")


@dataclass(frozen=True, kw_only=True)
class SmoothConfig:
    """What `maritrack smooth` takes for true and for under way, told by the whole life of a track."""

    min_hits: int = 10  # fewer are clutter, even where the tracker confirmed them
    moving_speed_mps: float = 0.5  # median, or it lies at rest for more than half of its life
    moving_displacement_m: float = 30.0  # greatest distance between two of its places ...
    moving_lengths: float = 1.0  # ... and so many of its own lengths: an echo wanders over what it comes from
    moving_length_max_m: float = math.inf  # what is longer is a shore

    def __post_init__(self) -> None:
        require(self.min_hits >= 1, "smooth.min_hits starts at 1")
        for name in ("moving_speed_mps", "moving_displacement_m", "moving_lengths"):
            require(getattr(self, name) >= 0, f"smooth.{name} must not be negative")
        positive("smooth.moving_length_max_m", self.moving_length_max_m)
