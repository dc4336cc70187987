"""Scenes: what floats where before which radar, as TOML files that come with the package."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from datetime import datetime
from importlib import resources
from pathlib import Path
from typing import Any

from maritrack.config import build, toml_table
from maritrack.errors import ConfigError
from maritrack.simulate.antenna import RadarSettings
from maritrack.simulate.campaign import Campaign
from maritrack.simulate.lidarscene import LidarScene
from maritrack.simulate.pointscene import PointScene
from maritrack.simulate.scenery import Land, Sea
from maritrack.simulate.vessels import Vessel

LAND_ID = "land"  # in labels


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Everything that a simulated recording shows. Metres east and north of the origin."""

    title: str
    start: datetime  # of the first spoke
    lat_deg: float
    lon_deg: float
    scans: int
    radar: RadarSettings
    others: tuple[RadarSettings, ...] = ()  # further radars of the same world
    sea: Sea = field(default_factory=Sea)
    land: tuple[Land, ...] = ()
    vessel: tuple[Vessel, ...] = ()

    def __post_init__(self) -> None:
        if self.start.tzinfo is None:
            raise ConfigError(f"start = {self.start} has no time zone: write 2026-05-12T06:30:00Z")
        if self.scans < 1:
            raise ConfigError("scans starts at 1")
        if not (-90 <= self.lat_deg <= 90 and -180 <= self.lon_deg <= 180):
            raise ConfigError(f"no such place: lat_deg = {self.lat_deg}, lon_deg = {self.lon_deg}")
        ids = [v.id for v in self.vessel]
        twice = sorted({i for i in ids if ids.count(i) > 1})
        if twice:
            raise ConfigError(f"two vessels are called '{twice[0]}'")
        if LAND_ID in ids:
            raise ConfigError(f"no vessel is called '{LAND_ID}': labels call land so")
        names = [radar.name for radar in self.radars]
        if self.others and ("" in names or len(set(names)) < len(names)):
            raise ConfigError("several radars have names, each its own")
        if len({(radar.sac, radar.sic) for radar in self.radars}) < len(names):
            raise ConfigError("several radars differ in sac and sic")
        for radar in self.radars:
            if radar.aboard and radar.aboard not in ids:
                raise ConfigError(f"radar '{radar.name}' is aboard '{radar.aboard}', which is no vessel of the scene")

    @property
    def radars(self) -> tuple[RadarSettings, ...]:
        """All radars, each with a recording of its own."""
        return (self.radar, *self.others)

    @property
    def start_s(self) -> float:
        """UNIX seconds of the first spoke."""
        return self.start.timestamp()


def scene_names() -> tuple[str, ...]:
    """Names of the scenes that come with the package."""
    folder = resources.files("maritrack.scenes")
    return tuple(sorted(p.name[: -len(".toml")] for p in folder.iterdir() if p.name.endswith(".toml")))


def load_scene(name_or_path: str | Path) -> Scene:
    """A scene of radars by name, or one from a TOML file. Raises ConfigError, which names the key."""
    scene = load_any(name_or_path)
    if not isinstance(scene, Scene):
        raise ConfigError(f"{name_or_path}: a scene of points, without radar video")
    return scene


def load_any(name_or_path: str | Path) -> Scene | PointScene | LidarScene | Campaign:
    """A scene of any kind: with a radar and vessels, with a lidar and boats, with a display, or
    points of objects without any."""
    name = str(name_or_path)
    known = scene_names()
    if name in known:
        text = resources.files("maritrack.scenes").joinpath(f"{name}.toml").read_text("utf-8")
    elif isinstance(name_or_path, Path) or name.endswith(".toml"):
        text = _read(Path(name_or_path))
    else:
        raise ConfigError(f"no scene '{name}'", hint="scenes: " + ", ".join(known) + "; or a path to a .toml file")
    try:
        table = toml_table(text)
        if "objects" in table:
            points: PointScene = build(PointScene, table, "")
            return points
        if "lidar" in table:
            seen: LidarScene = build(LidarScene, table, "")
            for boat in seen.boat:
                boat.course()
            return seen
        if "display" in table:
            shown: Campaign = build(Campaign, table, "")
            for vessel in shown.vessel:
                vessel.course()
            return shown
        scene: Scene = build(Scene, _first_apart(table), "")
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{name}: {error}") from None
    except ConfigError as error:
        raise ConfigError(f"{name}: {error}", hint=error.hint) from None
    for vessel in scene.vessel:
        vessel.course()  # turns that do not fit are told here, not after the first scan
    return scene


def _first_apart(table: dict[str, Any]) -> dict[str, Any]:
    """The table of a scene in which several `[[radar]]` are the first one and the others."""
    radars = table.get("radar")
    if isinstance(radars, list) and radars:
        return {**table, "radar": radars[0], "others": radars[1:]}
    return table


def _read(path: Path) -> str:
    try:
        return path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: {error}") from None
