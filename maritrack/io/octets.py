"""The octets of an input from a file, in pieces that memory can hold."""

from __future__ import annotations

import os
import select
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from stat import S_ISDIR, S_ISREG
from typing import BinaryIO

from maritrack.errors import InputError
from maritrack.io.images.pack import FolderPack, ZipPack, pack_folder, pack_zip
from maritrack.io.source import Come, Octets

CHUNK = 8 * 1024 * 1024
HEAD = 64 * 1024
PIPE = 1 << 20
ZIP = b"PK\x03\x04"


def octets_from_file(path: Path, channel: str) -> Octets:
    """A file, or a pipe that can be read once. InputError where it can't be read.

    Read, not mapped: a mapped file that shrinks meanwhile would kill the process.
    """
    try:
        status = path.stat()
        if S_ISDIR(status.st_mode):
            return _octets_from_pack(path, channel, pack_folder(path))
        if S_ISREG(status.st_mode):
            with path.open("rb") as file:
                head = file.read(HEAD)
            if head.startswith(ZIP):
                return _octets_from_pack(path, channel, pack_zip(path))
            return Octets(str(path), channel, FileChunks(path), head, status.st_size)
        stream = path.open("rb", buffering=0)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise InputError(f"{path}: {_reason(error)}") from None
    return _octets_from_pipe(stream.fileno(), str(path), channel, stream)


def _octets_from_pack(path: Path, channel: str, pack: FolderPack | ZipPack | None) -> Octets:
    """The files of a folder or a ZIP as one stream."""
    if pack is None:
        raise InputError(f"{path}: is a folder without images", hint="name the recordings in it")
    head = b""
    for piece in pack:
        head += piece[: HEAD - len(head)]
        if len(head) >= HEAD:
            break
    return Octets(str(path), channel, pack, head, pack.octets(), packed=True)


def octets_from_stdin() -> Octets:
    """Standard input, which can be read once: what has come is given on at once."""
    return _octets_from_pipe(0, "standard input", "")


def _octets_from_pipe(file: int, name: str, channel: str, owner: BinaryIO | None = None) -> Octets:
    """The octets of a file descriptor; its owner is closed at the end."""
    head = b""
    try:
        while len(head) < HEAD and (piece := os.read(file, CHUNK)):
            head += piece
    except OSError as error:
        raise InputError(f"{name}: {_reason(error)}") from None
    return Octets(name, channel, _as_it_comes(file, head, name, owner), head[:HEAD], -1)


def _as_it_comes(file: int, head: bytes, name: str, owner: BinaryIO | None) -> Iterator[bytes]:
    _widen(file)
    piece = head
    try:
        with owner or nullcontext():
            while piece:
                yield piece if _has_more(file) else Come(piece)
                piece = os.read(file, CHUNK)
    except OSError as error:
        raise InputError(f"{name}: {_reason(error)}") from None


def _has_more(file: int) -> bool:
    """Whether there is something to read at once, the end included."""
    try:
        return bool(select.select([file], [], [], 0)[0])
    except (OSError, ValueError):  # not told on this system
        return False


def _widen(file: int) -> None:
    """Let a pipe hold more, so that a quick writer is read in larger pieces."""
    try:
        import fcntl

        fcntl.fcntl(file, fcntl.F_SETPIPE_SZ, PIPE)
    except (ImportError, AttributeError, OSError):  # no pipe, or not on this system
        pass


def octets_from_bytes(data: bytes, *, name: str, channel: str) -> Octets:
    """Octets that are in memory already."""
    return Octets(name, channel, (data,) if data else (), data[:HEAD], len(data))


def whole(octets: Octets) -> bytes:
    """All octets at once, for documents that can't be read in pieces."""
    return b"".join(octets.chunks)


@dataclass(frozen=True, slots=True)
class FileChunks:
    """The pieces of a file from an octet on, read anew by each loop."""

    path: Path
    begin: int = 0

    def __iter__(self) -> Iterator[bytes]:
        try:
            with self.path.open("rb") as file:
                file.seek(self.begin)
                yield from _pieces(file)
        except OSError as error:
            raise InputError(f"{self.path}: {_reason(error)}") from None


def _pieces(file: BinaryIO) -> Iterator[bytes]:
    while piece := file.read(CHUNK):
        yield piece


def _reason(error: OSError | ValueError) -> str:
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return text[:1].lower() + text[1:]
