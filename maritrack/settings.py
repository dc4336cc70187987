"""Every setting of a run: frozen dataclasses nested like the line of data. `maritrack.config` loads them.

Those of trackers are in `maritrack.tracksettings`, `maritrack.intensitysettings` and `maritrack.contoursettings`,
those of radar images in `maritrack.imagesettings`.
A number that no paper gives carries `# assumed: why` in its preset.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from maritrack.centroidsettings import CentroidConfig
from maritrack.contoursettings import ContourConfig, PmbmConfig
from maritrack.errors import ConfigError
from maritrack.imagesettings import ImageConfig
from maritrack.intensitysettings import IntensityConfig
from maritrack.limits import in_unit, positive, require
from maritrack.rwmrsettings import RwmrConfig
from maritrack.tracksettings import (
    ClutterMapConfig,
    ModelConfig,
    PakfConfig,
    PhdConfig,
    SmoothConfig,
    SprtConfig,
    TrackerConfig,
)

NAN = math.nan
MOST_LATE_S = 1e6  # eleven days: what is later is of another recording


@dataclass(frozen=True, kw_only=True)
class InputConfig:
    """Where the sensor is and how its numbers are to be read."""

    sensor: str = ""  # which of several: "7-42" (SAC-SIC), "radar", "lidar"; "" = all (Autoferry: radar; radar+lidar)
    stream: str = ""  # of a capture: ADDRESS, ADDRESS:PORT or :PORT of either end; "" = all that hold CAT240
    date: str = ""  # ISO day of recordings that tell the time of day only
    lat_deg: float = NAN  # of a fixed radar
    lon_deg: float = NAN
    own_ship: str = ""  # id in the AIS reports of the ship that carries the radar; "" = the one that is marked
    step_s: float = 0.0  # scans that end within a step are of one instant, its end; 0 = each point has its beam's time
    unite: str = ""  # scans of one instant are one scan, of a sensor of this name, as of LiDARs aboard; "" = none are
    sector_deg: float = 0.0  # of a scan only the nearest point of each sector of bearing counts; 0 = all points
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
    sigma_elevation_deg: float = 0.0  # of 3-D points
    sigma_m: float = 0.0  # least noise of a point in any direction
    from_s: float = 0.0  # begin so many seconds after the first scan
    to_s: float = math.inf  # end so many seconds after the first scan
    limit: int = 0  # at most so many scans; 0 = all

    def __post_init__(self) -> None:
        require(0 <= self.from_s < self.to_s, "input.from_s must be less than input.to_s")
        require(self.limit >= 0, "input.limit must not be negative")
        require(0 <= self.scale_db <= 200, f"input.scale_db = {self.scale_db} is not within 0..200")
        require(0 <= self.step_s < math.inf, "input.step_s must not be negative, and finite")
        require(0 <= self.sector_deg <= 90, f"input.sector_deg = {self.sector_deg} is not within 0..90")
        require("/" not in self.unite, "input.unite is the name of a sensor, without a slash")
        require(self.roi_min_m < self.roi_max_m, "input.roi_min_m must be less than input.roi_max_m")
        for name, most in (("azimuth_offset_deg", 360.0), ("range_offset_m", 1e6), ("latency_s", MOST_LATE_S)):
            value = getattr(self, name)
            require(abs(value) <= most, f"input.{name} = {value} is not within -{most:g}..{most:g}")
        for name in ("beam_width_deg", "pulse_length_m", "sigma_range_m", "sigma_azimuth_deg", "sigma_m"):
            value = getattr(self, name)
            require(0 <= value < math.inf, f"input.{name} = {value} must not be negative, and finite")
        require(-90 <= self.lat_deg <= 90 or math.isnan(self.lat_deg), f"input.lat_deg = {self.lat_deg}")
        require(-180 <= self.lon_deg <= 180 or math.isnan(self.lon_deg), f"input.lon_deg = {self.lon_deg}")


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
        in_unit("detect.threshold", self.threshold)
        in_unit("detect.os_rank", self.os_rank)
        require(self.cfar_window > 0 and self.cfar_guard >= 0, "detect: cfar_window > 0 and cfar_guard >= 0")
        positive("detect.cfar_scale", self.cfar_scale)
        require(self.max_points > 0, "detect.max_points must be greater than 0")


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
        positive("subtract.pixel_m", self.pixel_m)
        positive("subtract.max_range_m", self.max_range_m)
        require(0.0 < self.learning_rate < 1.0, f"subtract.learning_rate = {self.learning_rate}: within 0..1")
        require(2 <= self.categories <= 32768, "subtract.categories is within 2..32768")
        require(0 <= self.threshold < self.categories - 1, "subtract.threshold is within 0..categories - 2")
        require(0 < self.tail_probability < 1, "subtract.tail_probability is between 0 and 1")
        require(self.half_life_scans >= 0 and self.half_life_s >= 0, "subtract: half_life must not be negative")
        require(
            self.half_life_scans == 0 or self.half_life_scans >= 0.1,
            f"subtract.half_life_scans = {self.half_life_scans}: at least 0.1, or 0 = by the learning rate",
        )
        require(not (self.half_life_scans and self.half_life_s), "subtract: half_life_scans or half_life_s, not both")
        require(self.max_pixels >= 1, "subtract.max_pixels starts at 1")


@dataclass(frozen=True, kw_only=True)
class ClusterConfig:
    """Points to clusters."""

    method: Literal[
        "polar-dbscan", "cartesian-dbscan", "single-linkage", "complete-linkage", "kmeans", "singletons"
    ] = "polar-dbscan"
    eps_m: float = 55.0  # polar, sec. III; of linkages the distance at which they are cut
    eps_cells: float = 0.0  # at least this many range cells; 0 = eps_m alone
    min_points: int = 3  # polar, sec. III
    min_count: int = 1  # clusters of fewer cells are dropped
    coarse_cell_m: float = math.inf  # cells of this depth and more are longer than boats: there ...
    coarse_min_count: int = 1  # ... clusters of fewer cells are dropped
    max_extent_m: float = math.inf  # clusters longer than this are land or arcs: dropped
    intensity_weighting: bool = True
    k_max: int = 10  # k-means: at most so many clusters
    k_index: Literal["calinski-harabasz", "davies-bouldin", "silhouette"] = "calinski-harabasz"  # dataset, sec. 3.2
    k_rule: Literal["gap", "spread"] = "gap"  # no more than gaps wider than eps_m part; or one within one_spread_m
    one_spread_m: float = 60.0  # root mean square distance from the centroid
    kmeans_seed: int = 0

    def __post_init__(self) -> None:
        require(2 <= self.k_max <= 200, "cluster.k_max is within 2..200")
        positive("cluster.one_spread_m", self.one_spread_m)
        require(0 <= self.kmeans_seed < 2**32, "cluster.kmeans_seed is within 0..2^32 - 1")
        require(0 < self.eps_m < math.inf, f"cluster.eps_m = {self.eps_m} must be greater than 0, and finite")
        counts = (self.min_points, self.min_count, self.coarse_min_count)
        require(min(counts) >= 1, "cluster: min_points, min_count and coarse_min_count start at 1")
        positive("cluster.coarse_cell_m", self.coarse_cell_m)


def parse_lags(text: str) -> dict[str, float]:
    """`210574000=37,366=2` as {"210574000": 37.0, "366": 2.0}."""
    lags = {}
    for item in filter(None, (part.strip() for part in text.split(","))):
        name, sep, value = item.partition("=")
        try:
            lags[name.strip()] = float(value)
        except ValueError:
            sep = ""
        if not sep:
            raise ConfigError(f"score.truth_lag_s: '{item}' is not ID=SECONDS")
        require(abs(lags[name.strip()]) <= MOST_LATE_S, f"score.truth_lag_s: '{item}' is not within {MOST_LATE_S:g} s")
    return lags


def parse_ids(text: str) -> tuple[str, ...]:
    """`210574000, 366` as ("210574000", "366"), each once."""
    return tuple(dict.fromkeys(filter(None, (part.strip() for part in text.split(",")))))


@dataclass(frozen=True, kw_only=True)
class ScoreConfig:
    """Metrics, and what counts as truth."""

    c_m: float = 100.0
    p: float = 2.0
    distance: Literal["position", "position-velocity"] = "position"  # of OSPA and GOSPA; the latter mixes m and m/s
    bow_share: float = 0.25  # of a ship's length, over which its outline narrows to a point, for iou
    hold_m: float = 100.0  # a truth object is held by a track within this
    moving_only: bool = False
    max_gap_moving_s: float = 30.0  # truth is interpolated over gaps up to this under way ...
    max_gap_rest_s: float = 360.0  # ... and this at rest
    truth_max_m: float = 0.0  # truth counts up to this range, in the region of interest; 0 = the radar's
    truth_lag_s: str = ""  # "MMSI=SECONDS,...": reports of that ship are late by so much
    truth_match: str = ""  # "MMSI,...": these ships of the truth alone; "" = all
    box_margin_m: float = 0.0  # boxes of vessels are wider by this all around, for fpr and npv

    @property
    def velocity(self) -> bool:
        """Whether velocities are a part of distances."""
        return self.distance == "position-velocity"

    def __post_init__(self) -> None:
        require(0 < self.c_m < math.inf, f"score.c_m = {self.c_m} must be greater than 0, and finite")
        require(1 <= self.p <= 20, "score.p is within 1..20")
        require(0 <= self.bow_share < 1, "score.bow_share is within 0..1")
        require(0 <= self.box_margin_m < math.inf, "score.box_margin_m must not be negative, and finite")
        parse_lags(self.truth_lag_s)


@dataclass(frozen=True, kw_only=True)
class OutputConfig:
    """Archive and picture."""

    archive: Literal["full", "hash"] = "full"
    archive_points: bool = True
    chunk_scans: int = 20  # a killed run keeps all but the last of these

    def __post_init__(self) -> None:
        require(self.chunk_scans >= 1, "output.chunk_scans starts at 1")


@dataclass(frozen=True, kw_only=True)
class Config:
    """All settings of a run."""

    preset: str = ""
    tracker_name: str = "jipda"
    seed: int = 0
    input: InputConfig = field(default_factory=InputConfig)
    images: ImageConfig = field(default_factory=ImageConfig)
    rwmr: RwmrConfig = field(default_factory=RwmrConfig)
    detect: DetectConfig = field(default_factory=DetectConfig)
    subtract: SubtractConfig = field(default_factory=SubtractConfig)
    cluster: ClusterConfig = field(default_factory=ClusterConfig)
    model: ModelConfig = field(default_factory=ModelConfig)
    clutter_map: ClutterMapConfig = field(default_factory=ClutterMapConfig)
    tracker: TrackerConfig = field(default_factory=TrackerConfig)
    sprt: SprtConfig = field(default_factory=SprtConfig)
    phd: PhdConfig = field(default_factory=PhdConfig)
    intensity: IntensityConfig = field(default_factory=IntensityConfig)
    smooth: SmoothConfig = field(default_factory=SmoothConfig)
    pakf: PakfConfig = field(default_factory=PakfConfig)
    centroid: CentroidConfig = field(default_factory=CentroidConfig)
    pmbm: PmbmConfig = field(default_factory=PmbmConfig)
    contour: ContourConfig = field(default_factory=ContourConfig)
    score: ScoreConfig = field(default_factory=ScoreConfig)
    output: OutputConfig = field(default_factory=OutputConfig)
