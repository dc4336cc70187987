"""A folder or a ZIP archive as one stream of octets: a TAR with its files in a fixed order.

An input of the program is a stream that an archive can hold and give back. Files are sorted by name, numbers in names
by their value, tables (CSV) first; times and owners are left out. So a folder and a ZIP of the same files are the same
input. What can't be read, is too large or is no image is there by its name and the reason, without its octets.
"""

from __future__ import annotations

import io
import re
import tarfile
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from stat import S_ISREG

from maritrack.errors import BROKEN_ZIP, InputError

IMAGE_MAGIC = (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"II*\x00", b"MM\x00*")
SIDE_NAMES = ("polarmeas.json", "cartesianmeas.json", "referencemeas.mat")  # of the DLR data set
REASON = "MARITRACK.left_out"  # PAX header of files whose octets are left out
MOST_OCTETS = 64 << 20  # of a file
MOST_FILES = 1_000_000
MOST_DIRECTORY = 32 << 20  # octets of a ZIP's central directory
MOST_UNPACKED, MOST_RATIO = 1 << 30, 200  # of a ZIP as a whole: what is beyond both is left out
UNREADABLE = (*BROKEN_ZIP, ValueError)


@dataclass(frozen=True, slots=True)
class FolderPack:
    """The TAR of the files of a folder, made anew by each loop."""

    path: Path
    names: tuple[str, ...]  # in the order of the TAR

    def octets(self) -> int:
        """Octets of the files, for the progress of a run."""
        return sum((self.path / name).stat().st_size for name in self.names)

    def __iter__(self) -> Iterator[bytes]:
        for name in self.names:
            yield from _entry(name, *_checked(name, self._read))
        yield bytes(2 * tarfile.BLOCKSIZE)

    def _read(self, name: str) -> bytes:
        with (self.path / name).open("rb") as file:
            head = file.read(64)
            return head + file.read(MOST_OCTETS + 1 - len(head)) if wanted(name, head) else head


@dataclass(frozen=True, slots=True)
class ZipPack:
    """The TAR of the files of a ZIP archive, made anew by each loop."""

    path: Path
    names: tuple[str, ...]
    size: int  # octets of the ZIP

    def octets(self) -> int:
        """Octets of the ZIP, for the progress of a run."""
        return self.size

    def __iter__(self) -> Iterator[bytes]:
        unpacked = 0
        most = max(MOST_UNPACKED, MOST_RATIO * self.size)
        try:
            with zipfile.ZipFile(self.path) as archive:
                for name in self.names:
                    if unpacked > most:
                        yield from _entry(name, b"", "bomb")
                        continue
                    data, reason = _checked(name, partial(_member, archive))
                    unpacked += MOST_OCTETS if reason == "too-large" else len(data)
                    yield from _entry(name, data, reason)
        except UNREADABLE as error:
            raise InputError(f"{self.path}: {error}") from None
        yield bytes(2 * tarfile.BLOCKSIZE)


def pack_folder(path: Path) -> FolderPack | None:
    """The files right in a folder, or its subfolder radarImages where it has no image; None where there are none.

    A folder with a document of the DLR data set is that: its documents without its images.
    """
    names = _listed(path)
    side = [name for name in names if name.lower() in SIDE_NAMES]
    if any(name.lower() in SIDE_NAMES[:2] for name in side):
        return FolderPack(path, tuple(sorted(side, key=str.lower)))
    for folder in (path, path / "radarImages"):
        found = names if folder is path else _listed(folder)
        if any(_starts_like_image(folder / name) for name in found):
            return FolderPack(folder, in_order(found))
    return None


def pack_zip(path: Path) -> ZipPack:
    """The files in a ZIP archive. InputError where its directory can't be read."""
    try:
        size = path.stat().st_size
        _check_directory(path, size)
        with zipfile.ZipFile(path) as archive:
            names = [name for name in archive.namelist() if name and not name.endswith("/")]
    except UNREADABLE as error:
        raise InputError(f"{path}: a ZIP archive that can't be read: {error}") from None
    names = list(dict.fromkeys(names))
    side = [n for n in names if n.lower().rpartition("/")[2] in SIDE_NAMES]
    if any(not n.lower().endswith(".mat") for n in side):
        return ZipPack(path, tuple(sorted(side, key=str.lower)), size)
    return ZipPack(path, in_order(names), size)


def in_order(names: list[str]) -> tuple[str, ...]:
    """Names of files with tables first, numbers by value: 9.png before 10.png."""
    return tuple(sorted(names, key=lambda name: (not name.lower().endswith(".csv"), natural(name))))


def natural(name: str) -> tuple[tuple[tuple[int, int, str], ...], str]:
    """A key that sorts the numbers within names by value."""
    parts = re.findall(r"[0-9]{1,40}|[^0-9]+", name.lower())
    return tuple((0, int(part), "") if part[0] in "0123456789" else (1, 0, part) for part in parts), name


def wanted(name: str, head: bytes) -> bool:
    """Whether a file that begins so is read: an image, a table or a document of the DLR data set."""
    lower = name.lower()
    return head.startswith(IMAGE_MAGIC) or lower.endswith(".csv") or lower.rpartition("/")[2] in SIDE_NAMES


def first_member(head: bytes) -> str:
    """Name of the first file in the head of a TAR, "" where it is none."""
    at = 0
    while at + 512 <= len(head) and head[at + 257 : at + 262] == b"ustar":
        kind, size = head[at + 156 : at + 157], head[at + 124 : at + 136].strip(b"\0 ")
        if kind in (b"0", b"\0"):
            return head[at : at + 100].partition(b"\0")[0].decode("utf-8", "replace")
        if not re.fullmatch(rb"[0-7]{1,11}", size):
            return ""
        at += 512 + -(-int(size, 8) // 512) * 512
    return ""


def _listed(path: Path) -> list[str]:
    try:
        names = [entry.name for entry in path.iterdir() if _is_file(entry)]
    except OSError:
        return []
    if len(names) > MOST_FILES:
        raise InputError(f"{path}: {len(names)} files, at most {MOST_FILES} are read")
    return [name for name in names if not name.startswith(".")]


def _is_file(path: Path) -> bool:
    try:
        return S_ISREG(path.stat().st_mode)
    except OSError:  # a link to nothing
        return False


def _starts_like_image(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(8).startswith(IMAGE_MAGIC)
    except OSError:
        return False


def _member(archive: zipfile.ZipFile, name: str) -> bytes:
    info = archive.getinfo(name)
    with archive.open(info) as file:
        head = file.read(64)
        if not wanted(name, head):
            return head
        return head + (file.read(MOST_OCTETS + 1 - len(head)))


def _checked(name: str, read: Callable[[str], bytes]) -> tuple[bytes, str]:
    """The octets of a file, or none and the reason why."""
    try:
        data = read(name)
    except UNREADABLE:
        return b"", "unreadable"
    if not wanted(name, data):
        return b"", "no-image"
    return (b"", "too-large") if len(data) > MOST_OCTETS else (data, "")


def _entry(name: str, data: bytes, reason: str) -> Iterator[bytes]:
    clean = name.encode("utf-8", "replace").decode("utf-8")
    info = tarfile.TarInfo(clean)
    info.size, info.mode = len(data), 0o644
    if reason:
        info.pax_headers = {REASON: reason}
    yield info.tobuf(tarfile.PAX_FORMAT, "utf-8", "replace")
    yield data
    yield bytes(-len(data) % tarfile.BLOCKSIZE)


def _check_directory(path: Path, size: int) -> None:
    """InputError where the central directory of a ZIP claims to be larger than memory should hold."""
    with path.open("rb") as file:
        file.seek(max(0, size - 65_557))
        tail = file.read()
        at = tail.rfind(b"PK\x05\x06")
        claimed = int.from_bytes(tail[at + 12 : at + 16], "little") if at >= 0 else 0
        if claimed == 0xFFFFFFFF and at >= 20:
            file.seek(int.from_bytes(tail[at - 12 : at - 4], "little"))
            claimed = int.from_bytes(file.read(56)[40:48], "little")
    if claimed > MOST_DIRECTORY:
        raise InputError(f"{path}: a ZIP archive with a directory of {claimed} octets, more than {MOST_DIRECTORY}")


class ChunkFile(io.RawIOBase):
    """Pieces of octets as a file that can be read once; what has been handed out is kept until `taken`."""

    def __init__(self, chunks: Iterator[bytes]) -> None:
        self._chunks, self._rest, self._given = chunks, memoryview(b""), bytearray()

    def read(self, size: int = -1) -> bytes:
        """Up to `size` octets; fewer at the end only."""
        parts, left = [], size
        while left:
            if not self._rest:
                more = next(self._chunks, None)
                if more is None:
                    break
                self._rest = memoryview(more)  # or each read of a little would copy all that is left
                continue
            part = self._rest if left < 0 else self._rest[:left]
            self._rest = self._rest[len(part) :]
            parts.append(part)
            left -= len(part) if left > 0 else 0
        data = b"".join(parts)
        self._given += data
        return data

    def taken(self) -> bytes:
        """What was read since the last call."""
        data = bytes(self._given)
        self._given.clear()
        return data
