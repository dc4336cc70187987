"""The exceptions that maritrack raises: one root, one class per audience."""

from __future__ import annotations

import zipfile
import zlib

# What reading a damaged ZIP raises; RuntimeError where it is encrypted, or packed in a way that is not known.
BROKEN_ZIP = (zipfile.BadZipFile, zlib.error, RuntimeError, EOFError, OSError)


class MaritrackError(Exception):
    """Root of all errors that maritrack raises on purpose.

    `hint` is a second line for the person at the keyboard, empty where there is none.
    """

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint


class UsageError(MaritrackError):
    """The call makes no sense: unknown name, options that exclude each other."""


class ConfigError(MaritrackError):
    """A preset, a configuration file or a `--set` is wrong."""


class InputError(MaritrackError):
    """A file can't be read as what it claims to be. Names the file and the place."""


class NumericalError(MaritrackError):
    """A filter left the numbers it can stand for. Names the track and the scan."""


class ReplayMismatch(MaritrackError):
    """An archive can't be replayed by this version or by this configuration."""


def told(error: BaseException) -> str:
    """An error in one line; what we did not raise on purpose with its type."""
    text = " ".join(str(error).split())
    return text if isinstance(error, MaritrackError) else f"{type(error).__name__}: {text}"
