"""The octets of an input from a file, in pieces that memory can hold."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from stat import S_ISDIR, S_ISREG
from typing import BinaryIO

from maritrack.errors import InputError
from maritrack.io.source import Octets

CHUNK = 8 * 1024 * 1024
HEAD = 64 * 1024


def octets_from_file(path: Path, channel: str) -> Octets:
    """A file, or a pipe that can be read once. InputError where it can't be read.

    Read, not mapped: a mapped file that shrinks meanwhile would kill the process.
    """
    try:
        status = path.stat()
        if S_ISDIR(status.st_mode):
            raise InputError(f"{path}: is a folder", hint="name the recordings in it")
        if S_ISREG(status.st_mode):
            with path.open("rb") as file:
                head = file.read(HEAD)
            return Octets(str(path), channel, FileChunks(path), head, status.st_size)
        stream = path.open("rb")
        head = stream.read(HEAD)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise InputError(f"{path}: {_reason(error)}") from None
    return Octets(str(path), channel, _rest(head, stream, path), head, -1)


def octets_from_stdin() -> Octets:
    """Standard input, which can be read once: what has come is given on at once."""
    head = b""
    try:
        while len(head) < HEAD and (piece := os.read(0, CHUNK)):
            head += piece
    except OSError as error:
        raise InputError(f"standard input: {_reason(error)}") from None
    return Octets("standard input", "", _stdin(head), head[:HEAD], -1)


def _stdin(head: bytes) -> Iterator[bytes]:
    piece = head
    while piece:
        yield piece
        piece = os.read(0, CHUNK)


def octets_from_bytes(data: bytes, *, name: str, channel: str) -> Octets:
    """Octets that are in memory already."""
    return Octets(name, channel, (data,) if data else (), data[:HEAD], len(data))


def whole(octets: Octets) -> bytes:
    """All octets at once, for documents that can't be read in pieces."""
    return b"".join(octets.chunks)


@dataclass(frozen=True, slots=True)
class FileChunks:
    """The pieces of a file, read anew by each loop."""

    path: Path

    def __iter__(self) -> Iterator[bytes]:
        try:
            with self.path.open("rb") as file:
                yield from _pieces(file)
        except OSError as error:
            raise InputError(f"{self.path}: {_reason(error)}") from None


def _pieces(file: BinaryIO) -> Iterator[bytes]:
    while piece := file.read(CHUNK):
        yield piece


def _rest(head: bytes, stream: BinaryIO, path: Path) -> Iterable[bytes]:
    """A pipe from its beginning."""
    try:
        with stream:
            if head:
                yield head
            yield from _pieces(stream)
    except OSError as error:
        raise InputError(f"{path}: {_reason(error)}") from None


def _reason(error: OSError | ValueError) -> str:
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return text[:1].lower() + text[1:]
