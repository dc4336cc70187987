"""Settings of the trackers of centroids, `jpda` and `ec-jpda`; the dataset paper gives none of these numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from maritrack.limits import positive, require


@dataclass(frozen=True, kw_only=True)
class CentroidConfig:
    """Course and speed of vessels, gates, the dispersion of their echoes, and where tracks come from."""

    start: Literal["clusters", "reference", "both"] = "clusters"  # what nobody explains, or the first word of AIS
    existence: Literal["certain", "integrated"] = "certain"  # JPDA, or JIPDA's probability that confirms and ends
    noise: Literal["converted", "linear"] = "converted"  # of a measurement: Lerro and Bar-Shalom, or first order
    gate_sigmas: float = 5.0  # of the rectangle that comes before the ellipse
    dispersion: Literal["body", "adaptive", "none"] = "body"  # ec-jpda alone: less noise and by weights; or eq. 5
    dispersion_memory_s: float = 10.0  # of a body; 0 = the last scan alone
    dispersion_decay: float = 0.9  # what is left of `adaptive` after a scan without two echoes; 1 = it stays
    gain: Literal["mean", "dispersion", "noise"] = "mean"  # the update sees R + S_D / points; all of eq. 4; or R alone
    clutter: Literal["density", "density-and-volume"] = "density"  # lambda; or lambda and V of eq. 9 and 10 both
    sigma_position_m: float = 0.5  # random walk of the place in a second
    sigma_course_deg: float = 2.0  # ... of the course
    sigma_speed_mps: float = 0.2  # ... of the speed
    start_position_m: float = 20.0  # standard deviations of a track that AIS starts
    start_course_deg: float = 10.0
    start_speed_mps: float = 1.0
    course_chi2: float = 9.0  # v' P^-1 v from which a new track has a course; until then its velocity is Cartesian

    def __post_init__(self) -> None:
        positive("centroid.gate_sigmas", self.gate_sigmas)
        require(0.0 <= self.dispersion_decay <= 1.0, "centroid.dispersion_decay is within 0..1")
        for name in ("dispersion_memory_s", "sigma_position_m", "sigma_course_deg", "sigma_speed_mps", "course_chi2"):
            require(getattr(self, name) >= 0.0, f"centroid.{name} must not be negative")
        for name in ("start_position_m", "start_course_deg", "start_speed_mps"):
            positive(f"centroid.{name}", getattr(self, name))
