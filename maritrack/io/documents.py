"""Documents beside a recording (truth, own ship) as octets, unpacked where they are compressed."""

from __future__ import annotations

import io
import zipfile
import zlib
from pathlib import Path

from maritrack.errors import BROKEN_ZIP, InputError

GZIP, ZIP = b"\x1f\x8b", b"PK\x03\x04"
MOST = 1 << 30  # octets of an unpacked document
STEP = 1 << 20


def read_document(path: Path, *, packed: bool = True) -> bytes:
    """The octets of a file, out of gzip or a ZIP of one file where it may be `packed`. InputError if unreadable."""
    try:
        return unpacked(path.read_bytes(), name=str(path)) if packed else path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None


def unpacked(data: bytes, *, name: str, most: int = MOST) -> bytes:
    """The document in gzip (also several members) or in a ZIP that holds one file; another document as it is."""
    if data.startswith(GZIP):
        return _gunzipped(data, name, most)
    return _unzipped(data, name, most) if data.startswith(ZIP) else data


def _gunzipped(data: bytes, name: str, most: int) -> bytes:
    parts: list[bytes] = []
    size, rest = 0, memoryview(data)
    try:
        while rest and bytes(rest[:2]) == GZIP:
            inflater = zlib.decompressobj(31)
            while not inflater.eof:
                part = inflater.decompress(rest, STEP)
                rest = memoryview(inflater.unconsumed_tail or inflater.unused_data)
                if not part and not rest and not inflater.eof:
                    raise InputError(f"{name}: compressed with gzip, and cut off")
                parts.append(part)
                size = _checked(size + len(part), name, most)
    except zlib.error as error:
        raise InputError(f"{name}: compressed with gzip, but it can't be unpacked: {error}") from None
    return b"".join(parts)


def _unzipped(data: bytes, name: str, most: int) -> bytes:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            files = [info for info in archive.infolist() if not info.is_dir()]
            if len(files) != 1:
                raise InputError(f"{name}: a ZIP of {len(files)} files", hint="unpack the one that is meant")
            parts, size = [], 0
            with archive.open(files[0]) as file:
                while part := file.read(STEP):
                    parts.append(part)
                    size = _checked(size + len(part), name, most)
    except (*BROKEN_ZIP, ValueError) as error:
        raise InputError(f"{name}: a ZIP that can't be unpacked: {error}") from None
    return b"".join(parts)


def _checked(size: int, name: str, most: int) -> int:
    if size > most:
        raise InputError(f"{name}: more than {most >> 20} MiB when unpacked", hint="cut it to the hours that matter")
    return size
