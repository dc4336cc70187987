"""Captures that are made to hurt: read to their end, whatever the cuts, in little memory."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from maritrack.io.containers.pcap import PcapReader
from maritrack.io.containers.pcapng import PcapngReader
from tests.io.pcap_build import read
from tests.io.pcap_hostile import KINDS

PROGRAM = """
import resource, sys
from maritrack.io.containers.pcap import PcapReader
from maritrack.io.containers.pcapng import PcapngReader
from tests.io.pcap_hostile import KINDS

for kind in sys.argv[1:]:
    data = KINDS[kind](10_000_000)
    reader = PcapngReader if data[:4] == b"\\n\\r\\r\\n" else PcapReader
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for d in reader([data]).datagrams():
        end = d.end
    print(end == len(data), (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024)
"""
HEAVY = ("empty packets", "streams", "fragments far from the beginning", "interfaces and packets", "blocks of 4 MiB")
LIMIT_MB = 100


@pytest.mark.parametrize("kind", KINDS)
def test_a_hostile_file_is_read_to_its_end_whatever_the_cuts(kind: str) -> None:
    data = KINDS[kind](50_000)
    reader = PcapngReader if data[:4] == b"\n\r\r\n" else PcapReader
    whole = read(reader, data)
    assert whole == read(reader, data, range(0, len(data), 777))
    assert len(whole.damage) <= 20
    small = read(reader, data, window=4096)
    assert small.payloads == whole.payloads and small.times == whole.times


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="ru_maxrss is counted in kB on Linux only")
@pytest.mark.parametrize("kind", HEAVY)
def test_hostile_files_take_little_memory(kind: str) -> None:
    root = Path(__file__).resolve().parents[2]
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM, kind], cwd=root, capture_output=True, text=True, check=True, timeout=300
    )
    ended, grown_mb = run.stdout.split()
    assert ended == "True"
    assert int(grown_mb) < LIMIT_MB
