"""A capture that is written is read the same, by a parser of a few lines and by tshark."""

from __future__ import annotations

import io
import shutil
import struct
import subprocess
from collections.abc import Sequence
from ipaddress import ip_address
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.io.containers.pcap_writer import PcapWriter
from maritrack.io.datagrams import NO_TIME, Stream
from tests.io.grams import START_NS, STREAMS, Gram, gram_lists, videos, write

HEAD = bytes.fromhex("4d3cb2a1 0200 0400 00000000 00000000 00000400 01000000")


def written(grams: Sequence[Gram]) -> bytes:
    file = io.BytesIO()
    write(PcapWriter(file), grams)
    return file.getvalue()


def ones_sum(octets: bytes) -> int:
    """Sum of 16-bit words in ones' complement, word by word."""
    total = 0
    for (word,) in struct.iter_unpack(">H", octets + bytes(len(octets) % 2)):
        total += word
        total = (total & 0xFFFF) + (total >> 16)
    return total


def parsed(octets: bytes) -> list[Gram]:
    """The datagrams of a capture, every field of which is checked."""
    assert octets[:24] == HEAD
    grams, at = [], 24
    while at < len(octets):
        seconds, nanoseconds, size, wire = struct.unpack_from("<IIII", octets, at)
        frame, at = octets[at + 16 : at + 16 + size], at + 16 + size
        assert size == wire == len(frame)
        assert nanoseconds < 10**9
        kind, packet = frame[12:14].hex(), frame[14:]
        if kind == "0800":
            assert packet[:2] == b"\x45\0"
            assert packet[6:10] == b"\x40\0\x40\x11"
            assert int.from_bytes(packet[2:4], "big") == len(packet)
            assert ones_sum(packet[:20]) == 0xFFFF
            ends, udp = (packet[12:16], packet[16:20]), packet[20:]
        else:
            assert kind == "86dd"
            assert packet[:4] == b"\x60\0\0\0"
            assert packet[6:8] == b"\x11\x40"
            assert int.from_bytes(packet[4:6], "big") == len(packet) - 40
            ends, udp = (packet[8:24], packet[24:40]), packet[40:]
        ports = struct.unpack_from(">HH", udp)
        assert int.from_bytes(udp[4:6], "big") == len(udp)
        assert udp[6:8] != b"\0\0"
        assert ones_sum(ends[0] + ends[1] + b"\0\x11" + udp[4:6] + udp) == 0xFFFF
        texts = (f"[{ip}]" if ip.version == 6 else str(ip) for ip in map(ip_address, ends))
        grams.append(
            Gram(
                udp[8:], seconds * 10**9 + nanoseconds, Stream(*(f"{t}:{p}" for t, p in zip(texts, ports, strict=True)))
            )
        )
    return grams


@settings(derandomize=True, deadline=None, max_examples=150)
@given(gram_lists)
def test_what_is_written_is_read(grams: list[Gram]) -> None:
    expected, last_ns = [], 0
    for gram in grams:
        last_ns = last_ns if gram.t_ns == NO_TIME else gram.t_ns
        expected.append(gram._replace(t_ns=last_ns))
    assert parsed(written(grams)) == expected


@settings(derandomize=True, deadline=None, max_examples=300)
@given(st.binary(max_size=9), st.integers(0, 65_535), st.sampled_from(["10.0.0.7", "255.255.255.255"]))
def test_checksums_are_right_also_where_they_come_near_zero(payload: bytes, port: int, address: str) -> None:
    for tail in (b"", b"\xff\xff", b"\0"):
        grams = [Gram(payload + tail, stream=Stream(f"{address}:{port}", f"0.0.0.0:{port}"))]
        assert parsed(written(grams)) == grams


def test_a_checksum_of_zero_is_sent_as_all_ones() -> None:
    stream = STREAMS[0]
    checksums = []
    for word in range(65_536):
        frame = written([Gram(word.to_bytes(2, "big"), stream=stream)])[40:]
        checksums.append(frame[40:42])
    assert len(set(checksums)) == 65_535
    assert checksums.count(b"\xff\xff") == 1
    assert b"\0\0" not in checksums


@pytest.mark.parametrize("stream", [STREAMS[0], STREAMS[2]], ids=["IPv4", "IPv6"])
def test_the_largest_payload_is_one_packet_and_a_larger_one_is_refused(stream: Stream) -> None:
    largest = bytes(range(256)) * 255 + bytes(227)
    assert len(largest) == 65_507
    assert parsed(written([Gram(largest, stream=stream)])) == [Gram(largest, stream=stream)]
    file = io.BytesIO()
    assert not PcapWriter(file).write(largest + b"x", t_ns=START_NS, stream=stream)
    assert file.getvalue() == HEAD


def test_times_that_a_capture_has_no_room_for_are_refused() -> None:
    file = io.BytesIO()
    writer = PcapWriter(file)
    assert not writer.write(b"", t_ns=-1, stream=STREAMS[0])
    assert not writer.write(b"", t_ns=(1 << 32) * 10**9, stream=STREAMS[0])
    assert file.getvalue() == HEAD


def test_streams_without_addresses_get_some_and_stay_apart() -> None:
    streams = {
        Stream(): ("192.0.2.1:8600", "239.0.1.2:8600"),
        Stream("board-1-line-2"): ("192.0.2.2:8600", "239.0.1.2:8600"),
        Stream("10.0.0.7:5000"): ("10.0.0.7:5000", "239.0.1.2:8600"),
        Stream("", "239.9.9.9:1"): ("192.0.2.3:8600", "239.9.9.9:1"),
        Stream("", "[ff02::1]:7"): ("[2001:db8::4]:8600", "[ff02::1]:7"),
        Stream("[fe80::1]:5", "239.9.9.9:1"): ("[fe80::1]:5", "[ff0e::240]:8600"),
        Stream("10.0.0.7:65536", "/radar"): ("192.0.2.5:8600", "239.0.1.2:8600"),
        Stream("10.0.0.7:5", "10.0.0.7"): ("10.0.0.7:5", "239.0.1.2:8600"),
    }
    got = parsed(written([Gram(b"x", stream=stream) for stream in streams]))
    assert [gram.stream for gram in got] == [Stream(*ends) for ends in streams.values()]


def test_hundreds_of_streams_without_addresses_stay_apart() -> None:
    got = parsed(written([Gram(b"", stream=Stream(str(i))) for i in range(600)]))
    assert len({gram.stream for gram in got}) == 600


def test_groups_have_their_ethernet_addresses() -> None:
    frames = [written([Gram(b"", stream=stream)])[40:52] for stream in STREAMS]
    assert [frame[:6].hex(":") for frame in frames] == [
        "01:00:5e:00:01:02", "01:00:5e:00:01:02", "33:33:00:00:00:05", "02:04:0a:01:02:03",
    ]  # fmt: skip


@pytest.mark.skipif(shutil.which("tshark") is None, reason="needs tshark")
def test_tshark_reads_what_is_written(tmp_path: Path) -> None:
    payloads = [*videos(20), b"", b"x", bytes(range(256)) * 255 + bytes(227)]
    grams = [Gram(p, START_NS + 123_456_789 * i, STREAMS[i % 4]) for i, p in enumerate(payloads)]
    file = tmp_path / "x.pcap"
    file.write_bytes(written(grams))
    fields = (
        "frame.time_epoch", "ip.src", "ip.dst", "ipv6.src", "ipv6.dst", "udp.srcport", "udp.dstport", "udp.payload",
        "ip.checksum.status", "udp.checksum.status", "_ws.malformed",
    )  # fmt: skip
    done = subprocess.run(
        ["tshark", "-r", str(file), "-T", "fields", *(arg for field in fields for arg in ("-e", field)),
         "-o", "ip.check_checksum:TRUE", "-o", "udp.check_checksum:TRUE", "--disable-protocol", "asterix"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    rows = [line.split("\t") for line in done.stdout.splitlines()]
    assert len(rows) == len(grams)
    for row, gram in zip(rows, grams, strict=True):
        time, *ends, source_port, destination_port, payload, ip_good, udp_good, malformed = row
        seconds, nanoseconds = time.split(".")
        source, destination = (f"[{ends[i + 2]}]" if ends[i + 2] else ends[i] for i in (0, 1))
        got = Stream(f"{source}:{source_port}", f"{destination}:{destination_port}")
        assert Gram(bytes.fromhex(payload), int(seconds) * 10**9 + int(nanoseconds), got) == gram
        assert (ip_good, udp_good, malformed) == ("" if ends[2] else "1", "1", "")
