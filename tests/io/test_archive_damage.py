"""After a crash all but the last scans are there, and no damaged octet is ever believed."""

from __future__ import annotations

import os
import signal
import struct
import subprocess
import sys
import tracemalloc
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import zstandard

from maritrack.errors import InputError
from maritrack.io.archive import FORMAT, ArchivedScan, iter_results, read_archive
from maritrack.types import Damage
from tests import runs

N_SCANS = 7
CHUNK_SCANS = 3


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return runs.archive(
        tmp_path_factory.mktemp("archive") / "run.mcap", [runs.result(k) for k in range(N_SCANS)],
        side={"truth": b"<truth>", "own-ship": b""}, chunk_scans=CHUNK_SCANS,
    )  # fmt: skip


def recovered(path: Path) -> tuple[list[ArchivedScan], list[Damage]]:
    lost: list[Damage] = []
    return list(iter_results(path, on_damage=lost.append)), lost


def assert_true_scans(scans: Sequence[ArchivedScan]) -> None:
    assert [runs.unlike(scan, runs.result(scan.k)) for scan in scans] == [[]] * len(scans)


KILLED = """
import os, signal, sys
from pathlib import Path
from maritrack.sinks.mcap import McapSink
from tests import runs
sink = McapSink(Path(sys.argv[1]))
sink.open(runs.MANIFEST)
for k in range(47):
    sink.write(runs.result(k))
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_killed_run_keeps_all_but_the_scans_of_the_last_chunk(tmp_path: Path) -> None:
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-c", KILLED, str(tmp_path / "run.mcap")], cwd=root, check=False,
        env=os.environ | {"PYTHONPATH": str(root)},
    )  # fmt: skip
    assert done.returncode == -signal.SIGKILL
    scans, lost = recovered(tmp_path / "run.mcap.partial")
    assert [scan.k for scan in scans] == list(range(40))
    assert_true_scans(scans)
    assert [damage.code for damage in lost] == ["archive-truncated"]
    assert read_archive(tmp_path / "run.mcap.partial").manifest.seed == 3


def chunks_of(octets: bytes) -> list[tuple[int, int]]:
    """Begin and end of each chunk record."""
    found, at = [], 8
    while octets[at] != 2:  # the footer
        end = at + 9 + struct.unpack_from("<Q", octets, at + 1)[0]
        found += [(at, end)] * (octets[at] == 6)
        at = end
    return found


def test_a_file_cut_anywhere_gives_the_scans_of_its_whole_chunks(written: Path, tmp_path: Path) -> None:
    octets, path = written.read_bytes(), tmp_path / "cut.mcap"
    chunks = chunks_of(octets)
    assert len(chunks) == 3
    for size in np.random.default_rng(1).integers(9, len(octets), 60).tolist():
        path.write_bytes(octets[:size])
        scans, lost = recovered(path)
        assert len(scans) == min(CHUNK_SCANS * sum(end <= size for _, end in chunks), N_SCANS)
        assert_true_scans(scans)
        assert "archive-truncated" in [damage.code for damage in lost]


def test_a_changed_octet_is_always_noticed_and_never_believed(written: Path, tmp_path: Path) -> None:
    octets, path = written.read_bytes(), tmp_path / "changed.mcap"
    rng = np.random.default_rng(2)
    for at in rng.integers(8, len(octets), 150).tolist():
        path.write_bytes(octets[:at] + bytes([octets[at] ^ (1 << int(rng.integers(8)))]) + octets[at + 1 :])
        scans, lost = recovered(path)
        assert lost, f"the change of octet {at} was not noticed"
        assert_true_scans(scans)
        assert len(scans) >= N_SCANS - 2 * CHUNK_SCANS
        with pytest.raises(InputError):
            list(iter_results(path))


@pytest.mark.parametrize("chunk", [0, 1])
@pytest.mark.parametrize("place", [1, 9 + 30, 9 + 36, 60], ids=["length", "compression", "data-length", "data"])
def test_a_spoiled_chunk_costs_its_own_scans_only(written: Path, tmp_path: Path, chunk: int, place: int) -> None:
    octets, path = bytearray(written.read_bytes()), tmp_path / "spoiled.mcap"
    octets[chunks_of(bytes(octets))[chunk][0] + place] ^= 0x55
    path.write_bytes(octets)
    scans, lost = recovered(path)
    lost_scans = range(chunk * CHUNK_SCANS, (chunk + 1) * CHUNK_SCANS)
    assert [scan.k for scan in scans] == [k for k in range(N_SCANS) if k not in lost_scans]
    assert lost[0].code in ("archive-chunk", "archive-record")


@pytest.mark.parametrize("what", ["zeros", "random", "records", "truncated-magic"])
def test_octets_that_are_no_archive_are_an_input_error(tmp_path: Path, what: str) -> None:
    rng, magic = np.random.default_rng(3), b"\x89MCAP0\r\n"
    octets = {
        "zeros": magic + bytes(100_000), "random": magic + rng.bytes(100_000), "truncated-magic": magic[:5],
        "records": magic + (b"\x0c" + struct.pack("<Q", 0)) * 10_000,
    }[what]  # fmt: skip
    path = tmp_path / "x.mcap"
    path.write_bytes(octets)
    with pytest.raises(InputError, match=r"x\.mcap"):
        read_archive(path)
    with pytest.raises(InputError, match=r"x\.mcap"):
        list(iter_results(path))


def test_a_missing_file_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_archive(tmp_path / "none.mcap")
    with pytest.raises(InputError, match="directory"):
        read_archive(tmp_path)


def record(opcode: int, content: bytes, *, length: int | None = None) -> bytes:
    return bytes([opcode]) + struct.pack("<Q", len(content) if length is None else length) + content


def chunk_record(data: bytes, *, size: int | None = None, packed: bytes | None = None) -> bytes:
    packed = zstandard.compress(data) if packed is None else packed
    head = struct.pack("<QQQI", 0, 0, len(data) if size is None else size, zlib.crc32(data))
    return record(6, head + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(packed)) + packed)


def message_record(channel: int, data: bytes, *, length: int | None = None) -> bytes:
    return record(5, struct.pack("<HIQQ", channel, 0, 0, 0) + data, length=length)


SCAN_CHANNEL = record(4, struct.pack("<HH", 1, 0) + struct.pack("<I", 5) + b"/scan" + bytes(8))
HOSTILE = {
    "record longer than the file": record(5, b"", length=2**63),
    "attachment longer than the file": record(9, b"", length=2**62),
    "chunk that promises a terabyte": chunk_record(b"x", size=2**40),
    "zstd frame that promises more than the chunk": chunk_record(b"x", size=1, packed=zstandard.compress(bytes(10**8))),
    "chunk of noise": chunk_record(b"x", packed=b"\x28\xb5\x2f\xfd" + bytes(range(200))),
    "chunk without data": chunk_record(b"x", packed=b""),
    "message longer than its chunk": chunk_record(SCAN_CHANNEL + message_record(1, b"", length=2**63)),
    "message shorter than its head": chunk_record(SCAN_CHANNEL + record(5, b"\x01\x00")),
    "message on no channel": chunk_record(message_record(7, b"x")),
    "message that is no scan": chunk_record(SCAN_CHANNEL + message_record(1, b"\xff\xff\xff")),
    "channel with a name of four gigabytes": chunk_record(record(4, struct.pack("<HHI", 1, 0, 2**32 - 1))),
    "channel with a name that is no text": chunk_record(record(4, struct.pack("<HHI", 1, 0, 2) + b"\xff\xff")),
    "metadata that are no table": record(12, struct.pack("<I", 2**31) + b"x"),
    "attachment with a wrong CRC": record(9, bytes(40)),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_record_is_damage_and_costs_no_memory(written: Path, tmp_path: Path, name: str) -> None:
    octets, path = written.read_bytes(), tmp_path / "hostile.mcap"
    path.write_bytes(octets[:8] + HOSTILE[name] + octets[8:])
    tracemalloc.start()
    scans, lost = recovered(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert lost
    assert peak < 30e6
    assert_true_scans(scans)
    assert len(scans) >= N_SCANS - CHUNK_SCANS


def test_no_end_of_damage_is_an_input_error(tmp_path: Path) -> None:
    path = tmp_path / "many.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + chunk_record(b"x", packed=b"noise") * 2000)
    with pytest.raises(InputError):
        recovered(path)


def test_a_changed_manifest_is_noticed_without_reading_the_scans(written: Path, tmp_path: Path) -> None:
    path = tmp_path / "changed.mcap"
    path.write_bytes(written.read_bytes().replace(b"jipda", b"jipdb"))
    read = read_archive(path)
    assert ([damage.code for damage in read.damage], read.complete) == (["archive-manifest"], False)


@pytest.mark.parametrize("value", [b"[" * 100_000, b"{}", b'"x"', b"[1]", b"nan"], ids=len)
def test_a_manifest_that_makes_no_sense_is_an_input_error(tmp_path: Path, value: bytes) -> None:
    def table(name: str, rows: dict[str, bytes]) -> bytes:
        inner = b"".join(text(k.encode()) + text(v) for k, v in rows.items())
        return record(12, text(name.encode()) + struct.pack("<I", len(inner)) + inner)

    def text(octets: bytes) -> bytes:
        return struct.pack("<I", len(octets)) + octets

    run = dict.fromkeys(
        ["run_id", "tracker", "preset", "code_sha256", "seed", "input_kind", "input_sha256", "versions", "origin"],
        value,
    )
    path = tmp_path / "x.mcap"
    head = table("maritrack.archive", {"format": FORMAT.encode()})
    path.write_bytes(b"\x89MCAP0\r\n" + head + table("maritrack.run", run))
    with pytest.raises(InputError, match="manifest"):
        read_archive(path)


def test_a_spoiled_table_of_channels_is_damage(written: Path, tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    octets = written.read_bytes()[: chunks_of(written.read_bytes())[-1][1]]
    assert octets.count(b"/scan\x01\0\0\x002") == 1
    path.write_bytes(octets.replace(b"/scan\x01\0\0\x002", b"/scan\x01\0\0\0x"))
    assert {damage.code for damage in read_archive(path).damage} == {"archive-record", "archive-truncated"}
    scans, lost = recovered(path)
    assert (len(scans), lost[0].code) == (N_SCANS, "archive-record")
