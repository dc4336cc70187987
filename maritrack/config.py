"""Settings from TOML, strictly, and back.

Order, later wins: default of the dataclass < preset < `--config FILE` < `--set key=value` < named
option. The resolved text (`to_toml`) goes into each archive and into the run's id.
"""

from __future__ import annotations

import difflib
import math
import reprlib
import tomllib
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Literal

from maritrack.errors import ConfigError
from maritrack.settings import Config

SHOWN = reprlib.Repr()  # of a value in a message: not all of it where it is long or deep
SHOWN.maxstring = SHOWN.maxother = 80


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


def toml_table(text: str) -> dict[str, Any]:
    """A TOML text as a table. TOMLDecodeError where it is none, nests too deeply, or has a number without end."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise tomllib.TOMLDecodeError("nests too deeply") from None
    except tomllib.TOMLDecodeError:
        raise
    except ValueError:  # an integer of thousands of digits
        raise tomllib.TOMLDecodeError("a number of too many digits") from None


def parse_set(assignment: str) -> dict[str, Any]:
    """`model.p_detect=0.9` as a nested table. A bare word is a string."""
    key, sep, text = assignment.partition("=")
    if not sep or not key.strip():
        raise ConfigError(f"--set {assignment}: write KEY=VALUE, as in model.p_detect=0.9")
    try:
        value = toml_table(f"v = {text}")["v"]
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
        config: Config = build(Config, toml_table(text), "")
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"archived configuration: {error}") from None
    return config


def read_toml(file: Path) -> dict[str, Any]:
    """A TOML file, `extends = "preset"` laid under it."""
    try:
        table = toml_table(file.read_text("utf-8"))
    except OSError as error:
        raise ConfigError(f"{file}: {error.strerror or error}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{file}: {error}") from None
    parent = table.pop("extends", "")
    if not isinstance(parent, str):
        raise ConfigError(f"{file}: 'extends' = {SHOWN.repr(parent)} is no name of a preset")
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
            raise ConfigError(f"'{name}' is a table, not {SHOWN.repr(value)}")
        return build(hint, value, f"{name}.")
    if typing.get_origin(hint) is Literal:
        options = typing.get_args(hint)
        if value not in options:
            raise ConfigError(f"'{name}' = {SHOWN.repr(value)}: one of {', '.join(map(str, options))}")
        return value
    if isinstance(hint, types.GenericAlias) or typing.get_origin(hint) is tuple:
        inner = typing.get_args(hint)[0]
        if not isinstance(value, list):
            raise ConfigError(f"'{name}' is a list, not {SHOWN.repr(value)}")
        return tuple(_convert(inner, item, name) for item in value)
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        try:
            value = float(value)
        except OverflowError:
            raise ConfigError(f"'{name}' = {SHOWN.repr(value)} is too large a number") from None
    if not isinstance(value, hint) or (hint is int and isinstance(value, bool)):
        raise ConfigError(f"'{name}' = {SHOWN.repr(value)} is not of type {hint.__name__}")
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
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_toml_value, value)) + "]"
    if is_dataclass(value):
        return "{ " + ", ".join(f"{f.name} = {_toml_value(getattr(value, f.name))}" for f in fields(value)) + " }"
    return str(value)


def _nearest(word: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(word, known, n=1)
    return f", did you mean '{near[0]}'?" if near else ""
