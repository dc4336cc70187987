"""What the rest of the program knows of an input: an iterator of frames."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

from maritrack.types import Frame, Origin


class Source(Protocol):
    """A recording that can be read once, from its beginning to its end."""

    @property
    def kind(self) -> str: ...

    @property
    def origin(self) -> Origin | None: ...

    def frames(self) -> Iterator[Frame]: ...


class Come(bytes):
    """A piece of a pipe, after which nothing more has come yet: it is worth a look before there is more."""


@dataclass(frozen=True, slots=True)
class Octets:
    """The octets of one input, from a file or from an archive, and the name that messages call it."""

    name: str  # for messages
    channel: str  # topic in the archive
    chunks: Iterable[bytes]
    head: bytes  # the first octets, to tell what it is (at least 64 KiB where there are as many)
    size: int  # -1 = unknown
    packed: bool = False  # files of a folder or a ZIP as one stream, made anew by each loop; size is that of the files
