"""Settings of the trackers that carry an intensity: `gm-phd`, `smc-phd` and `engm-phd`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from maritrack.limits import in_unit, positive, require


@dataclass(frozen=True, kw_only=True)
class BirthConfig:
    """A Gaussian of a birth mixture: as many numbers in each list as space has dimensions."""

    mean_m: tuple[float, ...]
    mean_mps: tuple[float, ...]
    sigma_m: tuple[float, ...]
    sigma_mps: tuple[float, ...]
    weight: float  # objects expected in a scan

    def __post_init__(self) -> None:
        axes = len(self.mean_m)
        lists = (self.mean_mps, self.sigma_m, self.sigma_mps)
        require(axes in (2, 3) and all(len(one) == axes for one in lists), "intensity.births: lists of 2 or 3 numbers")
        require(min(*self.sigma_m, *self.sigma_mps) > 0, "intensity.births: sigmas are greater than 0")
        positive("intensity.births.weight", self.weight)


@dataclass(frozen=True, kw_only=True)
class IntensityConfig:
    """What is measured, where objects are born, how many components there are, how they are reduced."""

    measurement: Literal["clusters", "range-azimuth", "range-azimuth-elevation"] = "clusters"
    cluster_spread: float = 0.0  # share of a cluster's own covariance in the noise of its centroid
    clutter_space: Literal["jacobian", "cartesian"] = "jacobian"  # clutter per volume of the measurements, or of space
    clutter_density_per_m3: float = 1e-9  # of range-azimuth-elevation; in the plane that of `model` counts
    gate: Literal["ellipse", "none"] = "ellipse"  # of model.p_gate
    p_survive_scan: float = 0.99  # in a scan that moves the clock
    sigma_process: float = 0.0  # m and m/s of white noise on each state in each scan, beside model.accel_psd_m2ps3
    components: int = 250  # most of gm-phd; particles of the others (global), or most groups of them (local)
    bandwidth: Literal["global", "local"] = "local"  # one kernel for all particles, or one for those of each object
    shrink: bool = True  # engm-phd: kernels leave the covariance of the particles as it is, not wider
    group_particles: int = 100  # local: of each object
    birth: Literal["clusters", "mixture"] = "clusters"  # at clusters that nothing explains, or from `births`
    birth_weight: float = 0.0  # of a cluster; 0 = P_D b / (lambda + P_D b), b = tracker.birth_density_per_m2
    births: tuple[BirthConfig, ...] = ()
    birth_draws: int = 0  # so many means are drawn from `births` in each scan; 0 = its Gaussians as they are
    prune_weight: float = 1e-5
    merge_distance2: float = 4.0  # squared Mahalanobis distance, with the heavier one's covariance
    merge_spread: bool = True  # the covariance of merged components counts how far apart their means are
    extract_weight: float = 0.5  # heavier ones are reported ...
    copies: bool = False  # gm-phd: a component is reported as often as its weight rounds to; else once
    extract_hits: int = 1  # ... after so many scans with a measurement
    hold_scans: int = 0  # scans for which one that was reported is still shown, and scored, as coasted

    def __post_init__(self) -> None:
        in_unit("intensity.p_survive_scan", self.p_survive_scan)
        positive("intensity.clutter_density_per_m3", self.clutter_density_per_m3)
        require(self.cluster_spread >= 0, "intensity.cluster_spread must not be negative")
        require(self.sigma_process >= 0, "intensity.sigma_process must not be negative")
        require(self.components >= 1, "intensity.components starts at 1")
        require(self.group_particles >= 10, "intensity.group_particles starts at 10: fewer have no covariance")
        require(0 <= self.birth_weight < 1, f"intensity.birth_weight = {self.birth_weight} is not between 0 and 1")
        require(self.birth_draws >= 0, "intensity.birth_draws must not be negative")
        require(0 < self.prune_weight < 1, f"intensity.prune_weight = {self.prune_weight} is not between 0 and 1")
        require(self.merge_distance2 >= 0, "intensity.merge_distance2 must not be negative")
        positive("intensity.extract_weight", self.extract_weight)
        require(self.extract_hits >= 0, "intensity.extract_hits must not be negative")
        require(self.hold_scans >= 0, "intensity.hold_scans must not be negative")
        require(self.birth != "mixture" or len(self.births) > 0, "intensity.birth = mixture needs intensity.births")
        axes = 3 if self.measurement == "range-azimuth-elevation" else 2
        require(
            all(len(one.mean_m) == axes for one in self.births),
            f"intensity.births: lists of {axes} numbers, as intensity.measurement = {self.measurement} has",
        )
        require(
            axes == 2 or self.birth == "mixture" or self.birth_weight > 0,
            "intensity.birth_weight must be given in 3-D: tracker.birth_density_per_m2 is one of the plane",
        )
