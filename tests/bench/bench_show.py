"""Wall time of `maritrack show` on a warm file of a million records, Python's start included, beside the floors.

python -m tests.bench.bench_show [--records 1000000] [--times 5] [--folder DIR]
Records have 1,024 cells of 8 bit, 2,048 spokes a turn: as raw blocks without and with zlib, and the latter as pcap
and pcapng. Up to 1.1 GB lie in the folder at a time. Floors: Python's start with the command line and numpy; reading
the file into a buffer.
"""

from __future__ import annotations

import argparse
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maritrack.io.cat240.encode import encode_video

SPOKES, CELLS, PERIOD_S = 2048, 1024, 2.5
CELL_FS = 66_712_819
SHOW = (
    "import sys\nfrom maritrack_cli.main import main\nsys.argv = ['maritrack', 'show', sys.argv[1], '--json']\nmain()"
)
START = "import maritrack_cli.main, numpy"
READ = "import sys\nb = bytearray(1 << 22)\nf = open(sys.argv[1], 'rb', buffering=0)\nwhile f.readinto(b): pass"
U8 = NDArray[np.uint8]


def turns(records: int, *, compress: bool) -> Iterator[list[bytes]]:
    """The data blocks of turn after turn: one turn's video over and over, index and time going on."""
    rng = np.random.default_rng(0)
    weak = rng.random((SPOKES, CELLS)) < 0.165 if compress else np.ones((SPOKES, CELLS), dtype=bool)
    video = np.where(weak, rng.integers(1, 128, (SPOKES, CELLS)), 0).astype(np.uint8)
    az = np.rint(np.arange(SPOKES + 1) * 65_536 / SPOKES).astype(int).tolist()
    blocks = [
        bytearray(encode_video(
            sac=7, sic=43, idx=0, start_az=az[j], end_az=az[j + 1] % 65_536, start_rg=0, cell_dur=CELL_FS,
            cells=video[j], compress=compress, tod=0,
        ))
        for j in range(SPOKES)
    ]  # fmt: skip
    for first in range(0, records, SPOKES):
        some = blocks[: records - first]
        for j, one in enumerate(some):
            one[8:12] = (first + j).to_bytes(4, "big")
            one[-3:] = int(6 * 3600 * 128 + (first + j) * PERIOD_S * 128 / SPOKES).to_bytes(3, "big")
        yield [bytes(one) for one in some]


def packet(block: bytes) -> bytes:
    """A block as a UDP datagram over IPv4 and Ethernet."""
    ip = struct.pack(">BBHHHBBH4s4s", 0x45, 0, 28 + len(block), 0, 0, 16, 17, 0, b"\x0a\0\0\5", b"\xef\0\1\2")
    return (
        bytes.fromhex("01005e000102 020000000001 0800")
        + ip
        + struct.pack(">4H", 50_000, 8600, 8 + len(block), 0)
        + block
    )


def pcap(number: int, octets: bytes) -> bytes:
    units = 1_700_000_000_000_000 + int(number * PERIOD_S * 1e6 / SPOKES)
    return struct.pack("<4I", units // 10**6, units % 10**6, len(octets), len(octets)) + octets


def pcapng(number: int, octets: bytes) -> bytes:
    units = 1_700_000_000_000_000 + int(number * PERIOD_S * 1e6 / SPOKES)
    size = 32 + len(octets) + -len(octets) % 4
    head = struct.pack("<7I", 6, size, 0, units >> 32, units & 0xFFFFFFFF, len(octets), len(octets))
    return head + octets + bytes(-len(octets) % 4) + struct.pack("<I", size)


PCAP_HEAD = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 262_144, 1)
PCAPNG_HEAD = struct.pack("<IIIHHqI", 0x0A0D0D0A, 28, 0x1A2B3C4D, 1, 0, -1, 28) + struct.pack(
    "<IIHHII", 1, 20, 1, 0, 0, 20
)
KINDS: dict[str, tuple[bool, bytes, Callable[[int, bytes], bytes] | None]] = {
    "raw": (False, b"", None), "zlib": (True, b"", None), "pcap": (True, PCAP_HEAD, pcap),
    "pcapng": (True, PCAPNG_HEAD, pcapng),
}  # fmt: skip


def write(path: Path, kind: str, records: int) -> None:
    compress, head, wrap = KINDS[kind]
    number = 0
    with path.open("wb") as file:
        file.write(head)
        for blocks in turns(records, compress=compress):
            if wrap is None:
                file.write(b"".join(blocks))
                continue
            file.write(b"".join(wrap(number + i, packet(block)) for i, block in enumerate(blocks)))
            number += len(blocks)


def best_s(code: str, path: Path, times: int) -> float:
    """The quickest of some runs of a Python process."""
    spent = []
    for _ in range(times):
        begun = time.perf_counter()
        subprocess.run([sys.executable, "-c", code, str(path)], check=True, stdout=subprocess.DEVNULL)
        spent.append(time.perf_counter() - begun)
    return min(spent)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=1_000_000)
    parser.add_argument("--times", type=int, default=5)
    parser.add_argument("--folder", type=Path, default=None)
    args = parser.parse_args()
    for kind in KINDS:
        with tempfile.TemporaryDirectory(dir=args.folder) as name:
            path = Path(name) / f"recording.{kind}"
            write(path, kind, args.records)
            show_s, start_s, read_s = (best_s(code, path, args.times) for code in (SHOW, START, READ))
            print(
                f"{kind:7} {args.records} records, {path.stat().st_size / 1e6:.0f} MB: show {show_s:.2f} s; "
                f"start {start_s:.2f} s, read {read_s:.2f} s",
                flush=True,
            )


if __name__ == "__main__":
    main()
