"""Inputs by URL (`s3://bucket/rec.cat240`, `memory://rec.cat240`): octets from an object store, through fsspec."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from maritrack.errors import InputError, UsageError
from maritrack.io.octets import CHUNK, HEAD
from maritrack.io.source import Octets


def is_url(name: str) -> bool:
    """Whether a name is a URL, and not a path."""
    return "://" in name


def octets_from_url(url: str, channel: str) -> Octets:
    """What lies under a URL, in pieces that memory can hold. InputError where it can't be read."""
    with _opened(url) as file:
        head = file.read(HEAD)
    return Octets(url, channel, UrlChunks(url), head, size_of(url))


def read_url(url: str) -> bytes:
    """A document under a URL, all of it."""
    return b"".join(UrlChunks(url))


def exists(url: str) -> bool:
    """Whether something lies under a URL."""
    system, path = _place(url)
    try:
        return bool(system.isfile(path))
    except OSError as error:
        raise InputError(f"{url}: {error.strerror or error}") from None


def matching(pattern: str) -> list[str]:
    """URLs that match a pattern, in order."""
    system, path = _place(pattern)
    protocol = pattern.partition("://")[0]
    try:
        names = system.glob(path)
    except OSError as error:
        raise InputError(f"{pattern}: {error.strerror or error}") from None
    return sorted(f"{protocol}://{str(name).lstrip('/')}" for name in names)


def size_of(url: str) -> int:
    """Octets under a URL, -1 where the store doesn't tell."""
    system, path = _place(url)
    try:
        size = system.info(path).get("size")
    except OSError as error:
        raise InputError(f"{url}: {error.strerror or error}") from None
    return -1 if size is None else int(size)


def token_of(url: str) -> str:
    """What the store says of the object, which changes when the object does: its ETag, size, time."""
    system, path = _place(url)
    try:
        return str(system.ukey(path))
    except OSError as error:
        raise InputError(f"{url}: {error.strerror or error}") from None


@dataclass(frozen=True, slots=True)
class UrlChunks:
    """The pieces of what lies under a URL, from an octet on, read anew by each loop."""

    url: str
    begin: int = 0

    def __iter__(self) -> Iterator[bytes]:
        try:
            with _opened(self.url) as file:
                file.seek(self.begin)
                while piece := file.read(CHUNK):
                    yield piece
        except OSError as error:
            raise InputError(f"{self.url}: {error.strerror or error}") from None


def _opened(url: str) -> Any:
    system, path = _place(url)
    try:
        return system.open(path, "rb")
    except OSError as error:
        raise InputError(f"{url}: {error.strerror or 'no such object'}") from None


def _place(url: str) -> tuple[Any, str]:
    """The store and the path in it."""
    try:
        from fsspec.core import url_to_fs
    except ImportError:
        raise UsageError(f"{url}: URLs need fsspec", hint="pip install 'maritrack[dask]'") from None
    try:
        system, path = url_to_fs(url)
    except (ValueError, ImportError) as error:  # a protocol that nobody knows, or whose library is not installed
        raise UsageError(f"{url}: {error}") from None
    return system, str(path)
