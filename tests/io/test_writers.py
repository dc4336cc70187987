"""Recordings are written under a name that tells what they are, and are whole or not there."""

from __future__ import annotations

import gzip
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest

from maritrack.errors import InputError, UsageError
from maritrack.io.containers import writers
from maritrack.io.containers.final import FinalReader, looks_final
from maritrack.io.containers.gunzip import gunzip
from maritrack.io.containers.mcap_datagrams import McapReader
from maritrack.io.containers.writers import open_writer
from maritrack.io.datagrams import Container
from tests.io.grams import START_NS, STREAMS, Gram, read, videos, write

GRAMS = [Gram(payload, START_NS + i * 10**7, STREAMS[i % 2]) for i, payload in enumerate(videos(200))]
NAMES = {
    "x.cat240": "raw", "x.ast": "raw", "x.asterix": "raw", "x.raw": "raw", "x.BIN": "raw", "x.pcap": "pcap",
    "x.cap": "pcap", "10.0.0.1.pcap": "pcap", "x.final": "final", "x.astfin": "final", "x.mcap": "mcap",
    "x.final.pcap": "pcap",
}  # fmt: skip


def kind_of(octets: bytes) -> str:
    if octets.startswith(b"\x4d\x3c\xb2\xa1"):
        return "pcap"
    if octets.startswith(b"\x89MCAP0\r\n"):
        return "mcap"
    return "final" if looks_final(octets) else "raw"


@pytest.mark.parametrize("packed", [False, True], ids=["plain", "gzip"])
@pytest.mark.parametrize("name", NAMES)
def test_the_name_tells_the_kind(name: str, packed: bool, tmp_path: Path) -> None:
    path = tmp_path / (name + ".gz" * packed)
    writer = open_writer(path)
    write(writer, GRAMS)
    writer.close()
    octets = gzip.decompress(path.read_bytes()) if packed else path.read_bytes()
    assert kind_of(octets) == NAMES[name]
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize("kind", ["raw", "pcap", "final", "mcap"])
def test_the_kind_may_be_told_whatever_the_name(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "recording.mcap.gz"
    writer = open_writer(path, kind=kind)
    write(writer, GRAMS)
    writer.close()
    assert kind_of(gzip.decompress(path.read_bytes())) == kind


@pytest.mark.parametrize("name", ["x", "x.gz", "x.txt", "x.pcapng", ".pcap", "pcap"])
def test_a_name_of_no_kind_is_a_usage_error_that_lists_the_kinds(name: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="what kind") as error:
        open_writer(tmp_path / name)
    assert all(suffix in error.value.hint for suffix in (".cat240", ".pcap", ".final", ".mcap", ".gz"))
    assert os.listdir(tmp_path) == []


def test_a_kind_that_is_none_is_a_usage_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError):
        open_writer(tmp_path / "x.pcap", kind="tape")


@pytest.mark.parametrize("name", ["x.cat240.gz", "x.pcap.gz", "x.final.gz", "x.mcap.gz", "x.mcap"])
def test_equal_datagrams_make_equal_files(name: str, tmp_path: Path) -> None:
    made = []
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        writer = open_writer(tmp_path / folder / name)
        write(writer, GRAMS)
        writer.close()
        made.append((tmp_path / folder / name).read_bytes())
    assert made[0] == made[1]
    assert not name.endswith(".gz") or made[0][:10] == b"\x1f\x8b\x08" + bytes(5) + made[0][8:10]


def test_raw_is_the_payloads(tmp_path: Path) -> None:
    writer = open_writer(tmp_path / "x.raw")
    write(writer, GRAMS)
    writer.close()
    assert (tmp_path / "x.raw").read_bytes() == b"".join(gram.payload for gram in GRAMS)


READERS: dict[str, Callable[[Iterable[bytes]], Container]] = {"final": FinalReader, "mcap": McapReader}


@pytest.mark.parametrize("name", ["x.final", "x.mcap", "x.final.gz", "x.mcap.gz"])
def test_what_is_flushed_can_be_read_and_what_is_aborted_stays_readable(name: str, tmp_path: Path) -> None:
    path, partial = tmp_path / name, tmp_path / (name + ".partial")
    path.write_bytes(b"the recording before")

    def payloads() -> list[bytes]:
        octets = partial.read_bytes()
        unpacked = b"".join(piece.data for piece in gunzip([octets])) if name.endswith(".gz") else octets
        return read(READERS[name.split(".")[1]]([unpacked])).payloads

    writer = open_writer(path)
    write(writer, GRAMS[:100])
    writer.flush()
    assert payloads() == [gram.payload for gram in GRAMS[:100]]
    write(writer, GRAMS[100:])
    writer.abort()
    assert payloads() == [gram.payload for gram in GRAMS]
    writer.abort()
    writer.close()
    assert path.read_bytes() == b"the recording before"


KILLED = """
import os, signal, sys
from pathlib import Path
from maritrack.io.containers.writers import open_writer
from tests.io.grams import write
from tests.io.test_writers import GRAMS
writer = open_writer(Path(sys.argv[1]))
write(writer, GRAMS[:150])
writer.flush()
write(writer, GRAMS[150:])
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize("name", ["x.final", "x.mcap"])
def test_a_killed_recording_keeps_what_was_flushed(name: str, tmp_path: Path) -> None:
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run(
        [sys.executable, "-c", KILLED, str(tmp_path / name)], cwd=root, check=False,
        env=os.environ | {"PYTHONPATH": str(root)},
    )  # fmt: skip
    assert done.returncode == -signal.SIGKILL
    got = read(READERS[name[2:]]([(tmp_path / f"{name}.partial").read_bytes()]))
    assert got.payloads == [gram.payload for gram in GRAMS[:150]]
    writer = open_writer(tmp_path / name)  # it is in nobody's way
    write(writer, GRAMS[:3])
    writer.close()
    assert os.listdir(tmp_path) == [name] and read(READERS[name[2:]]([(tmp_path / name).read_bytes()])).payloads == [
        gram.payload for gram in GRAMS[:3]
    ]


@pytest.mark.parametrize("name", ["x.raw", "x.mcap", "x.pcap.gz"])
def test_one_at_a_time_writes_a_file(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    for end in ("close", "abort"):
        first = open_writer(path)
        write(first, GRAMS[:100])
        with pytest.raises(InputError, match=f"{path}: another process is writing it"):
            open_writer(path)
        write(first, GRAMS[100:])
        getattr(first, end)()
    whole = path.read_bytes()
    assert (tmp_path / f"{name}.partial").read_bytes() == whole  # of the one that was aborted
    second = open_writer(path)
    write(second, GRAMS)
    second.close()
    assert path.read_bytes() == whole and os.listdir(tmp_path) == [name]


def test_a_file_that_got_its_name_meanwhile_is_not_written_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, lock = tmp_path / "x.raw", writers._lock
    first = open_writer(path)
    write(first, GRAMS)

    def late(file: Any) -> None:
        """The other one ends between the opening and the locking."""
        first.close()
        lock(file)

    monkeypatch.setattr(writers, "_lock", late)
    second = open_writer(path)
    write(second, GRAMS[:2])
    second.flush()
    assert path.read_bytes() == b"".join(gram.payload for gram in GRAMS)
    second.close()
    assert path.read_bytes() == b"".join(gram.payload for gram in GRAMS[:2]) and os.listdir(tmp_path) == ["x.raw"]


@pytest.mark.parametrize("name", ["x.pcap", "x.mcap", "x.cat240.gz"])
def test_where_nothing_can_be_written_the_error_names_the_file(name: str, tmp_path: Path) -> None:
    path = tmp_path / "nowhere" / name
    with pytest.raises(InputError, match=rf"{path}: can't be written: no such file"):
        open_writer(path)
    (tmp_path / name).mkdir()
    with pytest.raises(InputError, match=rf"{tmp_path / name}: can't be written: is a folder"):
        open_writer(tmp_path / name)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("name", ["x.raw", "x.pcap", "x.final", "x.mcap", "x.raw.gz", "x.mcap.gz"])
def test_a_full_disk_is_an_error_that_names_the_file_and_gives_no_recording(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    (tmp_path / f"{name}.partial").symlink_to("/dev/full")
    writer = open_writer(path)
    with pytest.raises(InputError, match=rf"{path}: can't be written: no space"):
        for _ in range(2000):
            write(writer, GRAMS)
            writer.flush()
    writer.abort()
    with pytest.raises(InputError, match="no space"):
        second = open_writer(path)
        write(second, GRAMS)
        second.close()
    assert not path.exists()
