"""Inputs by URL (`s3://bucket/rec.cat240`, `memory://rec.cat240`): octets from an object store, through fsspec."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
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
    with _store(url) as (system, path), system.open(path, "rb") as file:
        head = file.read(HEAD)
    return Octets(url, channel, UrlChunks(url), head, size_of(url))


def read_url(url: str) -> bytes:
    """A document under a URL, all of it."""
    return b"".join(UrlChunks(url))


def exists(url: str) -> bool:
    """Whether something lies under a URL."""
    with _store(url) as (system, path):
        return bool(system.isfile(path))


def matching(pattern: str) -> list[str]:
    """URLs that match a pattern, in order."""
    protocol, _, place = pattern.partition("://")
    root = "/" if place.startswith("/") else ""  # file:///data/*, but s3://bucket/*
    with _store(pattern) as (system, path):
        names = sorted(map(str, system.glob(path)))
    return [name if is_url(name) else f"{protocol}://{root}{name.lstrip('/')}" for name in names]


def size_of(url: str) -> int:
    """Octets under a URL, -1 where the store doesn't tell."""
    with _store(url) as (system, path):
        size = system.info(path).get("size")
    return -1 if size is None else int(size)


def token_of(url: str) -> str:
    """What the store says of the object, which changes when the object does: its ETag, size, time."""
    with _store(url) as (system, path):
        return str(system.ukey(path))


@dataclass(frozen=True, slots=True)
class UrlChunks:
    """The pieces of what lies under a URL, from an octet on, read anew by each loop."""

    url: str
    begin: int = 0

    def __iter__(self) -> Iterator[bytes]:
        with _store(self.url) as (system, path), system.open(path, "rb") as file:
            file.seek(self.begin)
            while piece := file.read(CHUNK):
                yield piece


@contextmanager
def _store(url: str) -> Iterator[tuple[Any, str]]:
    """The store and the path in it, open until its files are read. InputError where it refuses."""
    try:
        from fsspec.core import url_to_fs
    except ImportError:
        raise UsageError(f"{url}: URLs need fsspec", hint="pip install 'maritrack[dask]'") from None
    try:
        system, path = url_to_fs(url)
    except (ValueError, ImportError) as error:  # a protocol that nobody knows, or whose library is not installed
        raise UsageError(f"{url}: {error}") from None
    except OSError as error:
        raise InputError(f"{url}: {error.strerror or error}") from None
    try:
        yield system, str(path)
    except FileNotFoundError:
        raise InputError(f"{url}: no such object") from None
    except OSError as error:
        raise InputError(f"{url}: {error.strerror or error}") from None
