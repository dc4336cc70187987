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
from typing import Any

from maritrack.config import build, toml_table
from maritrack.errors import ConfigError
from maritrack.settings import InputConfig, parse_lags

CALIBRATED = ("azimuth_offset_deg", "range_offset_m", "latency_s")


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
    document = _document(text, name=name)
    tables = document.pop("sensors", None)
    if document:
        raise ConfigError(f"{name}: unknown key '{next(iter(document))}'", hint='write [sensors."7-42"]')
    if not isinstance(tables, dict) or not all(isinstance(table, dict) for table in tables.values()):
        raise ConfigError(f"{name}: no table of sensors", hint='write [sensors."7-42"]')
    try:
        return {sensor: _laid_over(base, table, f"sensors.{sensor}.") for sensor, table in tables.items()}
    except ConfigError as error:
        raise ConfigError(f"{name}: {error}", error.hint) from None


def calibrated(
    sensors: Mapping[str, InputConfig], text: str, *, name: str, base: InputConfig
) -> Mapping[str, InputConfig]:
    """The sensors with what `maritrack calibrate` found of them laid over: its file is one of sensors, and has more."""
    tables = _document(text, name=name)
    tables.pop("score", None)
    if set(tables) - {"sensors"}:
        raise ConfigError(f"{name}: unknown key '{min(set(tables) - {'sensors'})}'", hint="maritrack calibrate -o FILE")
    found = tables.get("sensors", {})
    if not isinstance(found, dict) or not all(isinstance(table, dict) for table in found.values()):
        raise ConfigError(f"{name}: no table of sensors", hint='write [sensors."7-42"]')
    if wrong := [key for table in found.values() for key in table if key not in CALIBRATED]:
        raise ConfigError(f"{name}: '{wrong[0]}' is no result of a calibration", hint="pass it with --sensors")
    try:
        over = {
            key: _laid_over(sensors.get(key, base), table, f"sensors.{key}.") for key, table in found.items()
        }  # fmt: skip
    except ConfigError as error:
        raise ConfigError(f"{name}: {error}", error.hint) from None
    return {**sensors, **over}


def check_sensors(octets: bytes, *, name: str) -> None:
    """ConfigError unless the octets are a document of sensors; `name` is what the message calls it."""
    parse_sensors(_text(octets, name=name), name=name, base=InputConfig())


def check_calibration(octets: bytes, *, name: str) -> str:
    """`score.truth_lag_s` of a calibration, "" where it has none; ConfigError where the octets are none."""
    text = _text(octets, name=name)
    calibrated({}, text, name=name, base=InputConfig())
    return lags_of(text, name=name)


def _text(octets: bytes, *, name: str) -> str:
    """The octets as a TOML text that says something."""
    try:
        text = octets.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{name}: not a text, at byte {error.start}", hint="a TOML file is asked for") from None
    if not _document(text, name=name):
        raise ConfigError(f"{name}: says nothing", hint='write [sensors."7-42"]')
    return text


def lags_of(text: str, *, name: str) -> str:
    """`score.truth_lag_s` of a calibration, "" where it has none."""
    score = _document(text, name=name).get("score", {})
    lags = score.get("truth_lag_s", "") if isinstance(score, dict) else None
    if not isinstance(lags, str) or set(score) - {"truth_lag_s"}:
        raise ConfigError(f"{name}: of [score] a calibration has truth_lag_s alone", hint="maritrack calibrate -o FILE")
    try:
        parse_lags(lags)
    except ConfigError as error:
        raise ConfigError(f"{name}: {error}") from None
    return lags


def _document(text: str, *, name: str) -> dict[str, Any]:
    try:
        return toml_table(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{name}: {error}") from None


def _laid_over(base: InputConfig, table: Mapping[str, object], where: str) -> InputConfig:
    values = {f.name: getattr(base, f.name) for f in fields(base)}
    built: InputConfig = build(InputConfig, {**values, **table}, where)
    return built


def for_input(sensors: Mapping[str, InputConfig], stem: str, *, base: InputConfig, sensor: str = "") -> InputConfig:
    """Settings of an input as a whole: those under its stem, else under the name of its one sensor, else the run's."""
    return sensors.get(stem, sensors.get(sensor, base))
