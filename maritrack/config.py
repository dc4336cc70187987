"""Every setting of a run: frozen dataclasses nested like the line of data, and a strict TOML loader.

Order, later wins: default of the dataclass < preset < `--config FILE` < `--set key=value` < named
option. The resolved text (`to_toml`) goes into each archive and into the run's id. A number that no
paper gives carries `# assumed: why` in its preset.
"""

from __future__ import annotations

import difflib
import math
import tomllib
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Literal

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
    date: str = ""  # ISO day of recordings that tell the time of day only
    lat_deg: float = NAN  # of a fixed radar
    lon_deg: float = NAN
    stabilised: Literal["north", "head"] = "north"
    azimuth_edge: Literal["start", "centre", "end"] = "centre"  # the edge that the azimuth means
    azimuth_offset_deg: float = 0.0  # added to every azimuth
    range_offset_m: float = 0.0  # added to every range
    latency_s: float = 0.0  # points are older than their stamp by this
    roi_max_m: float = math.inf  # region of interest, range from the sensor
    roi_min_m: float = 0.0
    beam_width_deg: float = 0.0  # antenna, for the noise of a cluster; 0 = unknown, the cell counts
    pulse_length_m: float = 0.0  # c T/2; 0 = unknown, the cell counts
    sigma_range_m: float = 0.0  # noise of a point; 0 = from cell, beam and pulse
    sigma_azimuth_deg: float = 0.0
    sigma_m: float = 0.0  # least noise of a point in any direction
    from_s: float = 0.0  # begin so many seconds after the first scan
    to_s: float = math.inf  # end so many seconds after the first scan
    limit: int = 0  # at most so many scans; 0 = all

    def __post_init__(self) -> None:
        _require(0 <= self.from_s < self.to_s, "input.from_s must be less than input.to_s")
        _require(self.limit >= 0, "input.limit must not be negative")
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
class ClusterConfig:
    """Points to clusters."""

    method: Literal["polar-dbscan", "cartesian-dbscan", "singletons"] = "polar-dbscan"
    eps_m: float = 55.0  # polar, sec. III
    eps_cells: float = 0.0  # at least this many range cells; 0 = eps_m alone
    min_points: int = 3  # polar, sec. III
    min_count: int = 1  # clusters of fewer cells are dropped
    max_extent_m: float = math.inf  # clusters longer than this are land or arcs: dropped
    intensity_weighting: bool = True

    def __post_init__(self) -> None:
        _require(0 < self.eps_m < math.inf, f"cluster.eps_m = {self.eps_m} must be greater than 0, and finite")
        _require(self.min_points >= 1 and self.min_count >= 1, "cluster: min_points and min_count start at 1")


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
class TrackerConfig:
    """Start, confirm, judge and end tracks."""

    birth_existence: float = 0.6  # polar, sec. II; 0 = P_D b / (lambda + P_D b)
    birth_density_per_m2: float = 1e-6
    confirm_existence: float = 0.99
    confirm_hits: int = 3  # scans with an association weight above one half
    delete_existence: float = 0.05
    delete_misses: int = 10  # in a row
    delete_sigma_m: float = 500.0  # position less certain than this
    coast_misses: int = 1  # misses in a row after which a confirmed track is called coasted
    duplicate_distance_m: float = 0.0  # tracks nearer than this ...
    duplicate_speed_mps: float = 2.0  # ... and in velocity than this are one; 0 m = none
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

    def __post_init__(self) -> None:
        for name in ("birth_existence", "confirm_existence", "delete_existence"):
            _in_unit(f"tracker.{name}", getattr(self, name))
        _positive("tracker.moving_unsteadiness", self.moving_unsteadiness)
        _positive("tracker.moving_time_constant_s", self.moving_time_constant_s)
        _require(self.confirm_hits >= 1, "tracker.confirm_hits starts at 1")
        _require(self.max_tracks >= 1, "tracker.max_tracks starts at 1")
        _require(1 <= self.exact_limit <= 16, "tracker.exact_limit is within 1..16")


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

    def __post_init__(self) -> None:
        _require(0 < self.c_m < math.inf, f"score.c_m = {self.c_m} must be greater than 0, and finite")
        _require(1 <= self.p <= 20, "score.p is within 1..20")


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
    cluster: ClusterConfig = field(default_factory=ClusterConfig)
    model: ModelConfig = field(default_factory=ModelConfig)
    tracker: TrackerConfig = field(default_factory=TrackerConfig)
    score: ScoreConfig = field(default_factory=ScoreConfig)
    output: OutputConfig = field(default_factory=OutputConfig)


def preset_names() -> tuple[str, ...]:
    """Names of the presets that come with the package."""
    folder = resources.files("maritrack.presets")
    return tuple(sorted(p.name[: -len(".toml")] for p in folder.iterdir() if p.name.endswith(".toml")))


def preset_table(name: str) -> dict[str, Any]:
    """The table of a preset, `extends` (one level or more) already laid under it."""
    known = preset_names()
    if name not in known:
        raise ConfigError(f"no preset '{name}'{_nearest(name, known)}", hint="presets: " + ", ".join(known))
    table = tomllib.loads(resources.files("maritrack.presets").joinpath(f"{name}.toml").read_text("utf-8"))
    parent = table.pop("extends", None)
    return merge(preset_table(parent), table) if parent else table


def merge(lower: Mapping[str, Any], upper: Mapping[str, Any]) -> dict[str, Any]:
    """`upper` laid over `lower`, table by table."""
    merged = dict(lower)
    for key, value in upper.items():
        old = merged.get(key)
        merged[key] = merge(old, value) if isinstance(old, Mapping) and isinstance(value, Mapping) else value
    return merged


def parse_set(assignment: str) -> dict[str, Any]:
    """`model.p_detect=0.9` as a nested table. A bare word is a string."""
    key, sep, text = assignment.partition("=")
    if not sep or not key.strip():
        raise ConfigError(f"--set {assignment}: write KEY=VALUE, as in model.p_detect=0.9")
    try:
        value = tomllib.loads(f"v = {text}")["v"]
    except tomllib.TOMLDecodeError:
        value = text.strip()
    table: Any = value
    for part in reversed(key.strip().split(".")):
        table = {part: table}
    return dict(table)


def load_config(
    *, preset: str, file: Path | None = None, sets: Sequence[str] = (), over: Mapping[str, Any] | None = None
) -> Config:
    """The resolved configuration. `over` holds what named options say, as a nested table."""
    table = preset_table(preset) if preset else {}
    if file is not None:
        over_file = read_toml(file)
        try:
            build(Config, over_file, "")
        except ConfigError as error:
            raise ConfigError(f"{file}: {error}", error.hint) from None
        table = merge(table, over_file)
    for assignment in sets:
        table = merge(table, parse_set(assignment))
    table = merge(table, over or {})
    resolved: Config = build(Config, merge(table, {"preset": preset or "none"}), "")
    return resolved


def config_from_toml(text: str) -> Config:
    """The configuration that `to_toml` wrote."""
    try:
        config: Config = build(Config, tomllib.loads(text), "")
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"archived configuration: {error}") from None
    return config


def read_toml(file: Path) -> dict[str, Any]:
    """A TOML file, `extends = "preset"` laid under it."""
    try:
        table = tomllib.loads(file.read_text("utf-8"))
    except OSError as error:
        raise ConfigError(f"{file}: {error.strerror or error}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{file}: {error}") from None
    parent = table.pop("extends", None)
    return merge(preset_table(parent), table) if parent else table


def build(kind: Any, table: Mapping[str, Any], where: str) -> Any:
    """A frozen dataclass from a table; unknown keys and wrong types are errors that name the key."""
    hints = typing.get_type_hints(kind)
    known = {f.name: f for f in fields(kind)}
    values: dict[str, Any] = {}
    for key, value in table.items():
        name = f"{where}{key}"
        if key not in known:
            raise ConfigError(f"unknown key '{name}'{_nearest(key, tuple(known))}")
        values[key] = _convert(hints[key], value, name)
    missing = [n for n, f in known.items() if n not in values and f.default is MISSING and f.default_factory is MISSING]
    if missing:
        raise ConfigError(f"missing key '{where}{missing[0]}'")
    return kind(**values)


def _convert(hint: Any, value: Any, name: str) -> Any:
    if is_dataclass(hint):
        if not isinstance(value, Mapping):
            raise ConfigError(f"'{name}' is a table, not {value!r}")
        return build(hint, value, f"{name}.")
    if typing.get_origin(hint) is Literal:
        options = typing.get_args(hint)
        if value not in options:
            raise ConfigError(f"'{name}' = {value!r}: one of {', '.join(map(str, options))}")
        return value
    if isinstance(hint, types.GenericAlias) or typing.get_origin(hint) is tuple:
        inner = typing.get_args(hint)[0]
        if not isinstance(value, list):
            raise ConfigError(f"'{name}' is a list, not {value!r}")
        return tuple(_convert(inner, item, name) for item in value)
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if not isinstance(value, hint) or (hint is int and isinstance(value, bool)):
        raise ConfigError(f"'{name}' = {value!r} is not of type {hint.__name__}")
    return value


def to_toml(config: Any) -> str:
    """Every setting in a fixed order, as TOML that `config_from_toml` reads back."""
    plain, tables = [], []
    for f in fields(config):
        value = getattr(config, f.name)
        if is_dataclass(value):
            tables.append(f"\n[{f.name}]\n" + to_toml(value))
        else:
            plain.append(f"{f.name} = {_toml_value(value)}\n")
    return "".join(plain + tables)


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else ("nan" if math.isnan(value) else f"{value}")
    if isinstance(value, str):
        escaped = "".join(c if c.isprintable() and c not in '"\\' else f"\\U{ord(c):08x}" for c in value)
        return f'"{escaped}"'
    return str(value)


def _nearest(word: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(word, known, n=1)
    return f", did you mean '{near[0]}'?" if near else ""
