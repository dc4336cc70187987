"""A CAT240 recording to be converted: a file, standard input, or the input of an archived run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from maritrack.errors import InputError, UsageError
from maritrack.io import ARCHIVE, sniff
from maritrack.io.archive import iter_inputs, read_archive
from maritrack.io.containers.kinds import MCAP_MAGIC
from maritrack.io.octets import HEAD, octets_from_file, octets_from_stdin
from maritrack.io.source import Octets
from maritrack.types import Damage

INPUT = "/input/"


@dataclass(frozen=True, slots=True)
class Recorded:
    """The octets of a recording, and which of its streams is wanted ("" = all)."""

    octets: Octets
    stream: str = ""
    damage: list[Damage] = field(default_factory=list)  # of the archive; known when the octets have been read


def open_recorded(path: Path, *, stream: str = "") -> Recorded:
    """A recording, "-" for standard input; of an archive of a run its input.

    An archive with several inputs needs one of their channels as `stream`. InputError where it is no radar video.
    """
    octets = octets_from_stdin() if str(path) == "-" else octets_from_file(path, "")
    if octets.head.startswith(MCAP_MAGIC) and ARCHIVE in octets.head:
        if octets.size < 0:
            raise InputError(f"{octets.name}: an archive of a run", hint="save it to a file first")
        recorded = _archived(path, stream)
    elif stream.startswith(INPUT):
        raise UsageError(f"{octets.name}: not an archive of a run, it has no {stream}")
    else:
        recorded = Recorded(octets, stream)
    kind = sniff(recorded.octets.head, recorded.octets.name)
    if kind != "cat240":
        raise InputError(f"{recorded.octets.name}: {kind}, no radar video", hint="CAT240 is converted")
    return recorded


@dataclass(frozen=True, slots=True)
class _Chunks:
    """The pieces of an input in an archive, read anew by each loop."""

    path: Path
    channel: str
    damage: list[Damage]

    def __iter__(self) -> Iterator[bytes]:
        return iter_inputs(self.path, self.channel, on_damage=self._note)

    def _note(self, damage: Damage) -> None:
        if damage not in self.damage:
            self.damage.append(damage)


def _archived(path: Path, stream: str) -> Recorded:
    archive = read_archive(path)
    channels = archive.inputs
    if not archive.full:
        raise InputError(f"{path}: only the digest of the recording is archived", hint="convert the recording itself")
    if stream.startswith(INPUT):
        if stream not in channels:
            raise UsageError(f"{path}: no {stream}; it has {', '.join(channels)}")
        channels, stream = (stream,), ""
    if len(channels) != 1:
        raise UsageError(f"{path}: {len(channels)} recordings", hint=f"choose: --stream {' or '.join(channels)}")
    chunks, head = _Chunks(path, channels[0], []), b""
    for chunk in chunks:
        head += chunk[: HEAD - len(head)]
        if len(head) >= HEAD:
            break
    octets = Octets(f"{path}{channels[0]}", channels[0], chunks, head, -1)
    return Recorded(octets, stream, chunks.damage)
