"""Settings of the Poisson multi-Bernoulli trackers `gp-pmbm` and `giw-pmbm`, and of the contours of the former."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from maritrack.limits import in_unit, positive, require


@dataclass(frozen=True, kw_only=True)
class ContourConfig:
    """A star-convex hull whose radius is a Gaussian process of the angle, and how points on it are measured."""

    angles: int = 9  # basis angles; extended, sec. 4.2
    sigma_f_m: float = 0.5  # of the radius, periodic part; extended, sec. 4.2
    sigma_r_m: float = 0.5  # of the radius as a whole; extended, sec. 4.2
    sigma_n_m: float = 0.001  # jitter of the basis; extended, sec. 4.2
    length_scale_rad: float = math.pi / 4  # extended, sec. 4.2
    forget_per_s: float = 0.01  # towards the prior; extended, sec. 4.2
    length_m: float = 6.0  # of the prior's mean outline; 0 = none, as Wahlstroem and Oezkan
    width_m: float = 3.0
    corner: float = 2.0  # of that outline: 2 = an ellipse, larger = nearer to a rectangle
    sigma_point_m: float = 0.3  # noise of a point; extended, sec. 4.2
    sigma_turn_rps2: float = 0.1  # of the turn rate, in a second; extended, sec. 4.2
    iterations: int = 50  # most of the iterated filter; extended, sec. 4.2
    tolerance: float = 1e-3  # m and rad at which it has converged
    start: Literal["robust", "predicted"] = "robust"  # where it begins: also beside the points, or as predicted
    headings: int = 4  # that a new hull tries
    density: Literal["implicit", "perimeter"] = "perimeter"  # of a point along the hull: of its noise, or all round
    most_points: int = 40  # of one hull that its shape is updated with, spread over its bearings; 0 = all

    def __post_init__(self) -> None:
        require(5 <= self.angles <= 60, "contour.angles is within 5..60")
        for name in ("sigma_f_m", "sigma_r_m", "sigma_n_m", "length_scale_rad", "sigma_point_m", "tolerance"):
            positive(f"contour.{name}", getattr(self, name))
        require(self.forget_per_s >= 0 and self.sigma_turn_rps2 >= 0, "contour: no number is negative")
        require(0 <= self.width_m <= self.length_m < math.inf, "contour: 0 <= width_m <= length_m")
        require((self.width_m > 0) == (self.length_m > 0), "contour: length_m and width_m, or neither")
        require(1.0 <= self.corner <= 20.0, "contour.corner is within 1..20")
        require(1 <= self.iterations <= 1000, "contour.iterations is within 1..1000")
        require(1 <= self.headings <= 36, "contour.headings is within 1..36")
        require(self.most_points >= 0, "contour.most_points must not be negative; 0 = all")


@dataclass(frozen=True, kw_only=True)
class PmbmConfig:
    """Hypotheses, what a measurement is, how many points an object gives, where objects appear."""

    measurement: Literal["clusters", "points"] = "clusters"  # an object gives one cluster at most, or points
    hypotheses: Literal["mixture", "merged"] = "mixture"  # or one alone, the mixture's moments (track oriented)
    association: Literal["stochastic", "murty"] = "stochastic"  # of points; clusters are always assigned by Murty
    most_hypotheses: int = 100  # of a group of tracks
    most_in_scan: int = 2000  # ... and of all groups of a scan together: each has as many, one at least
    most_children: int = 20  # associations of a hypothesis; extended, sec. 3.1 names none
    prune_hypothesis: float = 0.01  # share of the likeliest; extended, sec. 4.2
    merge_distance2: float = 0.0  # rows of a track whose states are as near, by the likelier one's covariance, are one
    prune_existence: float = 0.01  # extended, sec. 4.2
    prune_poisson: float = 0.01  # extended, sec. 4.2
    most_poisson: int = 500  # components
    recycle: bool = False  # rows that are pruned join the undetected, those that prune_poisson, a smaller limit, leaves
    extract_existence: float = 0.5  # extended, sec. 4.2
    p_survive_scan: float = 0.0  # in a scan that moves the clock; 0 = model.p_survive, a second
    group_limit: int = 40  # tracks and clusters of a larger group are merged, their shares by belief propagation
    most_searched: int = 2  # hypotheses of a group whose associations of points are searched; others have whole cells
    iterations: int = 50  # of the stochastic optimisation, for each point
    sample_moves: int = 40  # at most so many changes of one association
    partition_eps_m: tuple[float, ...] = (1.0, 2.0, 4.0)  # distances that cut points into cells, beside the clusters
    rate_shape: float = 20.0  # points of a new object: gamma, shape ...
    rate_scale: float = 2.0  # ... and inverse scale; their ratio is the mean
    rate_window: float = 20.0  # scans; extended, sec. 4.2
    birth: Literal["uniform", "ring"] = "uniform"  # tracker.birth_density_per_m2 everywhere, or on a circle
    birth_weight: float = 0.1  # ring: objects expected in a scan
    birth_radius_m: float = 100.0  # ring; extended, sec. 4.1
    birth_components: int = 16  # on the circle, and a quarter as many within
    birth_sigma_m: float = 20.0  # extended, sec. 4.2
    birth_sigma_mps: float = 3.0  # extended, sec. 4.2

    def __post_init__(self) -> None:
        for name in ("prune_hypothesis", "prune_existence", "prune_poisson", "extract_existence", "p_survive_scan"):
            in_unit(f"pmbm.{name}", getattr(self, name))
        counts = (
            "most_hypotheses",
            "most_children",
            "most_poisson",
            "group_limit",
            "birth_components",
            "most_searched",
        )
        for name in counts:
            require(getattr(self, name) >= 1, f"pmbm.{name} starts at 1")
        require(self.iterations >= 0 and self.sample_moves >= 0, "pmbm: iterations must not be negative")
        require(all(0 < eps < math.inf for eps in self.partition_eps_m), "pmbm.partition_eps_m: greater than 0, finite")
        require(self.merge_distance2 >= 0, "pmbm.merge_distance2 must not be negative; 0 = none")
        require(self.rate_window > 1.0, "pmbm.rate_window is greater than 1")
        for name in ("rate_shape", "rate_scale", "birth_weight", "birth_radius_m", "birth_sigma_m", "birth_sigma_mps"):
            positive(f"pmbm.{name}", getattr(self, name))
