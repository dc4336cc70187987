"""What tshark reads in a file; tests that ask it skip, visibly, where it isn't installed."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

FIELDS = ("frame.time_epoch", "ip.src", "ipv6.src", "udp.srcport", "ip.dst", "ipv6.dst", "udp.dstport", "udp.payload")


def udp_of(data: bytes, folder: Path) -> list[tuple[str, str, str, bytes]]:
    """Time, source, destination and payload of the UDP datagrams of a capture, in order."""
    program = shutil.which("tshark")
    if program is None:
        pytest.skip("needs tshark")
    path = folder / "capture"
    path.write_bytes(data)
    fields = [part for name in FIELDS for part in ("-e", name)]
    options = ["-o", "ip.defragment:TRUE", "-o", "ip.check_checksum:FALSE", "-o", "udp.check_checksum:FALSE"]
    run = subprocess.run(
        [program, "-n", "-r", str(path), "-T", "fields", *options, *fields, "-Y", "udp.payload"],
        capture_output=True, text=True, check=True, timeout=120,
    )  # fmt: skip
    found = []
    for line in run.stdout.splitlines():
        time, src4, src6, source, dst4, dst6, destination, payload = line.split("\t")
        ends = [f"{four or f'[{six}]'}:{port}" for four, six, port in ((src4, src6, source), (dst4, dst6, destination))]
        found.append((time, ends[0], ends[1], bytes.fromhex(payload)))
    return found
