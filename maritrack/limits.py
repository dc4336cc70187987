"""Checks that settings share: each says which key is wrong, and what it may be."""

from __future__ import annotations

from maritrack.errors import ConfigError


def require(ok: bool, message: str) -> None:
    """ConfigError with this message, unless it is so."""
    if not ok:
        raise ConfigError(message)


def in_unit(name: str, value: float) -> None:
    """ConfigError unless 0 <= value <= 1."""
    require(0.0 <= value <= 1.0, f"{name} = {value} is not within 0..1")


def positive(name: str, value: float) -> None:
    """ConfigError unless value > 0."""
    require(value > 0.0, f"{name} = {value} must be greater than 0")
