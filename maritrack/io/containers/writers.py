"""A recording to be written, by its name: raw data blocks, a capture, FINAL or MCAP, and gzip on top."""

from __future__ import annotations

import gzip
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, Protocol, cast

from maritrack.errors import InputError, UsageError
from maritrack.io.containers.final import FinalWriter
from maritrack.io.containers.pcap_writer import PcapWriter
from maritrack.io.containers.select import is_blocks
from maritrack.io.datagrams import DatagramWriter, Stream

KINDS = {
    "raw": (".cat240", ".ast", ".asterix", ".raw", ".bin"),
    "pcap": (".pcap", ".cap"),
    "final": (".final", ".astfin"),
    "mcap": (".mcap",),
}  # fmt: skip
BUFFER = 1 << 20
GZIP_LEVEL = 6


class Encoder(Protocol):
    """Writes a container to an open file."""

    def write(self, payload: bytes, *, t_ns: int, stream: Stream) -> bool: ...

    def flush(self) -> None: ...

    def finish(self) -> None: ...


class RawWriter:
    """Writes payloads one behind the other to an open file. Times and streams are not written.

    Only whole data blocks fit: the rest of a block that is cut off would take the ones behind it for its own octets.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def write(self, payload: bytes, *, t_ns: int, stream: Stream) -> bool:
        if not is_blocks(payload):
            return False
        self._file.write(payload)
        return True

    def flush(self) -> None:
        self._file.flush()

    def finish(self) -> None:
        """Nothing: a raw recording ends where the file does."""


class FileWriter:
    """Writes PATH.partial, which `close` gives its name. InputError, naming the file, where it can't be written.

    After `abort`, as after a kill, PATH.partial stays and can be read: after `abort` all of it, after a kill what was
    written before the last `flush`. PATH is only touched by `close`. One process at a time writes it: InputError for
    others; a process that is gone holds nothing.
    """

    def __init__(self, path: Path, encoder: Callable[[BinaryIO], Encoder], *, gzipped: bool = False) -> None:
        self._path, self._partial = path, path.with_name(path.name + ".partial")
        with self._named():
            if path.is_dir():
                raise IsADirectoryError("is a folder")
            file = _opened_alone(self._partial, path)
            self._held = os.dup(file.fileno())  # until the file has its name
            self._files = [file]
            if gzipped:
                packed = gzip.GzipFile(
                    filename="", mode="wb", compresslevel=GZIP_LEVEL, fileobj=self._files[0], mtime=0
                )
                self._files.insert(0, cast(BinaryIO, packed))
            self._encoder = encoder(self._files[0])
        self._open = True

    def write(self, payload: bytes, *, t_ns: int, stream: Stream) -> bool:
        try:
            return self._encoder.write(payload, t_ns=t_ns, stream=stream)
        except OSError as error:
            raise self._error(error) from None

    def flush(self) -> None:
        with self._named():
            self._encoder.flush()
            for file in self._files:
                file.flush()

    def close(self) -> None:
        if self._open:
            with self._named():
                try:
                    self._end()
                    os.replace(self._partial, self._path)
                finally:
                    self._let_go()

    def abort(self) -> None:
        """End the file but leave it PATH.partial. Never raises for a full disk; once is enough."""
        with suppress(OSError):
            self._end()
        self._let_go()

    def _end(self) -> None:
        if self._open:
            self._open = False
            try:
                self._encoder.finish()
            finally:
                self._close_files()

    def _close_files(self) -> None:
        """All of them, also where one can't be ended properly."""
        *rest, last = self._files
        try:
            for file in rest:
                file.close()
        finally:
            last.close()

    def _let_go(self) -> None:
        if self._held >= 0:
            os.close(self._held)
            self._held = -1

    @contextmanager
    def _named(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise self._error(error) from None

    def _error(self, error: OSError) -> InputError:
        reason = error.strerror or str(error)
        return InputError(f"{self._path}: can't be written: {reason[:1].lower()}{reason[1:]}")


def _opened_alone(partial: Path, path: Path) -> BinaryIO:
    """The file, emptied and locked for this process; the lock ends with the last descriptor of it."""
    while True:
        file = os.fdopen(os.open(partial, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666), "wb", BUFFER)
        try:
            _lock(file)
            if partial.exists() and os.path.samestat(os.fstat(file.fileno()), partial.stat()):
                with suppress(OSError):  # what has no length needs no emptying
                    file.truncate(0)
                return file
        except BlockingIOError:
            file.close()
            raise InputError(f"{path}: another process is writing it", hint="choose another name") from None
        file.close()  # the process that wrote it has just given it its name


def _lock(file: BinaryIO) -> None:
    """BlockingIOError where another process holds it."""
    try:
        import fcntl
    except ImportError:  # not on this system: no lock
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:  # not on this file system
        return


def open_writer(path: Path, *, kind: str = "") -> DatagramWriter:
    """A recording of the kind "raw", "pcap", "final" or "mcap"; without it by the name of the file.

    A name that ends in .gz is compressed, whatever the kind. UsageError where the kind isn't known.
    """
    names = [suffix.lower() for suffix in path.suffixes[-2:]]
    gzipped = names[-1:] == [".gz"]
    name = (names[:-1] if gzipped else names)[-1:]
    kind = kind or next((one for one, all_names in KINDS.items() if name and name[0] in all_names), "")
    if kind not in KINDS:
        known = ", ".join(suffix for all_names in KINDS.values() for suffix in all_names)
        raise UsageError(
            f"{path}: what kind of recording is this to be?", f"end its name in one of {known}, or these with .gz"
        )
    return FileWriter(path, ENCODERS[kind], gzipped=gzipped)


def _mcap(file: BinaryIO) -> Encoder:
    from maritrack.io.containers.mcap_writer import McapWriter

    return McapWriter(file)


ENCODERS: dict[str, Callable[[BinaryIO], Encoder]] = {
    "raw": RawWriter, "pcap": PcapWriter, "final": FinalWriter, "mcap": _mcap,
}  # fmt: skip
