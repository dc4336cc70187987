"""`--sensors FILE.toml`: how each of several sensors is to be read.

A table per sensor id or per input stem, with the keys of `[input]`, laid over the `[input]` of the run:

    [sensors."7-42"]
    lat_deg = 50.74
    lon_deg = -1.09
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path

from maritrack.config import build
from maritrack.errors import ConfigError
from maritrack.settings import InputConfig


def load_sensors(path: Path, *, base: InputConfig) -> Mapping[str, InputConfig]:
    """Settings of each sensor of a TOML file; ConfigError names the file and the key."""
    try:
        text = path.read_text("utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: {error}") from None
    return parse_sensors(text, name=str(path), base=base)


def parse_sensors(text: str, *, name: str, base: InputConfig) -> Mapping[str, InputConfig]:
    """Settings of each sensor of a TOML text, in its order; `name` is what messages call it."""
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{name}: {error}") from None
    tables = document.pop("sensors", None)
    if document:
        raise ConfigError(f"{name}: unknown key '{next(iter(document))}'", hint='write [sensors."7-42"]')
    if not isinstance(tables, dict) or not all(isinstance(table, dict) for table in tables.values()):
        raise ConfigError(f"{name}: no table of sensors", hint='write [sensors."7-42"]')
    try:
        return {sensor: _laid_over(base, table, f"sensors.{sensor}.") for sensor, table in tables.items()}
    except ConfigError as error:
        raise ConfigError(f"{name}: {error}", error.hint) from None


def _laid_over(base: InputConfig, table: Mapping[str, object], where: str) -> InputConfig:
    values = {f.name: getattr(base, f.name) for f in fields(base)}
    built: InputConfig = build(InputConfig, {**values, **table}, where)
    return built


def for_input(sensors: Mapping[str, InputConfig], stem: str, *, base: InputConfig) -> InputConfig:
    """Settings of an input as a whole: those under its stem, else those of the run."""
    return sensors.get(stem, base)
