"""pcap files: all their variants, however they are cut, and what is done where they are damaged."""

from __future__ import annotations

import random
import struct
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.io.containers.pcap import PcapReader
from tests.io.pcap_build import (
    T0_NS,
    A,
    B,
    Packet,
    ethernet,
    extension,
    fragments4,
    fragments6,
    framed,
    ipv4,
    ipv6,
    pcap,
    pcap_header,
    read,
    record,
    udp,
)
from tests.io.tshark import udp_of

ORDERS = pytest.mark.parametrize("order", "<>")
MAGICS = pytest.mark.parametrize("magic", [0xA1B2C3D4, 0xA1B23C4D, 0xA1B2CD34], ids=["us", "ns", "long"])


def datagram(i: int, size: int = 40) -> bytes:
    """An Ethernet frame whose payload tells its number."""
    return ethernet(ipv4(udp(payload(i, size))))


def payload(i: int, size: int = 40) -> bytes:
    return struct.pack(">I", i) + bytes((i + j) % 255 + 1 for j in range(size - 4))


FRAMES = [datagram(i, 30 + i) for i in range(30)]
PAYLOADS = [payload(i, 30 + i) for i in range(30)]


@ORDERS
@MAGICS
def test_every_variant_is_read(order: str, magic: int) -> None:
    packets = [Packet(octets, T0_NS + 1_234_567_891 * i) for i, octets in enumerate(FRAMES)]
    found = read(PcapReader, pcap(packets, order=order, magic=magic))
    assert found.payloads == PAYLOADS and found.damage == []
    unit = 1 if magic == 0xA1B23C4D else 1000
    assert found.times == [p.t_ns // unit * unit for p in packets]


def test_seconds_have_no_sign() -> None:
    late = [Packet(octets, 4_294_967_295 * 10**9 + 5000) for octets in FRAMES]
    found = read(PcapReader, pcap(late))
    assert found.payloads == PAYLOADS and set(found.times) == {4_294_967_295 * 10**9 + 5000}


def test_offsets_are_the_places_of_the_payloads() -> None:
    data = pcap(FRAMES)
    assert read(PcapReader, data).offsets == [data.index(one) for one in PAYLOADS]


def test_a_link_type_with_the_length_of_a_checksum_is_read() -> None:
    octets = [one + b"\1\2\3\4" for one in FRAMES]
    assert read(PcapReader, pcap(octets, 1 | 0x5000_0000)).payloads == PAYLOADS


@pytest.mark.parametrize("packets", [[], [b""], [b"", b""]])
def test_a_file_without_datagrams_gives_none(packets: list[bytes]) -> None:
    found = read(PcapReader, pcap([Packet(one) for one in packets]))
    assert found.payloads == []


@given(st.lists(st.integers(0, 2000), max_size=40), st.integers(17, 3000))
@settings(derandomize=True, deadline=None, max_examples=60)
def test_cuts_and_windows_change_nothing(cuts: list[int], window: int) -> None:
    data = bytearray(pcap(FRAMES))
    data[900:903] = b"\xff\xff\xff"
    whole = read(PcapReader, bytes(data))
    assert read(PcapReader, bytes(data), cuts) == whole
    small = read(PcapReader, bytes(data), window=window)
    assert small[:4] == whole[:4] and small.codes == whole.codes


def test_octet_by_octet_is_the_same() -> None:
    data = pcap(FRAMES)
    assert read(PcapReader, data, range(len(data))) == read(PcapReader, data)


@pytest.mark.parametrize("cut", range(0, 24))
def test_a_file_that_ends_in_its_header_is_damage(cut: int) -> None:
    assert read(PcapReader, pcap(FRAMES)[:cut]).codes == [("pcap-cut", 1)]


def test_a_file_cut_anywhere_delivers_what_is_there() -> None:
    starts = [24]
    for octets in FRAMES[:4]:
        starts.append(starts[-1] + 16 + len(octets))
    data = pcap(FRAMES[:4])
    for cut in range(25, len(data)):
        found = read(PcapReader, data[:cut])
        whole = sum(cut >= end for end in starts[1:])
        begun = cut - starts[whole] - 58  # octets of the cut one's payload
        expected = [*PAYLOADS[:whole], *([PAYLOADS[whole][:begun]] if begun >= 0 and cut != starts[whole] else [])]
        assert found.payloads == expected
        assert found.codes == ([] if cut == starts[whole] else [("pcap-cut", 1)])


def lengths_of(data: bytearray, number: int) -> int:
    """Place of the length of a record of FRAMES."""
    return 24 + sum(16 + len(octets) for octets in FRAMES[:number]) + 8


@pytest.mark.parametrize("length", [0xFFFFFFFF, 262_145, 0x10000])
def test_a_length_that_cannot_be_costs_one_packet(length: int) -> None:
    data = bytearray(pcap(FRAMES))
    place = lengths_of(data, 10)
    data[place : place + 4] = struct.pack("<I", length)
    found = read(PcapReader, bytes(data))
    assert [p for p in PAYLOADS if p in found.payloads] == [p for p in PAYLOADS if p != PAYLOADS[10]]
    assert found.codes == [("pcap-lost", 1)]
    assert found.damage[0].offset == place - 8


@pytest.mark.parametrize("more", [-20, -4, -1, 1, 4, 16, 17, 60, 89, 500])
def test_a_length_that_is_wrong_costs_little(more: int) -> None:
    data = bytearray(pcap(FRAMES))
    place = lengths_of(data, 10)
    for at in (place, place + 4):
        data[at : at + 4] = struct.pack("<I", len(FRAMES[10]) + more)
    found = read(PcapReader, bytes(data))
    assert set(PAYLOADS) - set(found.payloads) <= {PAYLOADS[10]}
    assert "pcap-lost" in dict(found.codes)


def test_a_wrong_length_of_the_last_packets_swallows_nothing() -> None:
    data = bytearray(pcap(FRAMES))
    place = lengths_of(data, 26)
    for at in (place, place + 4):
        data[at : at + 4] = struct.pack("<I", 100_000)
    found = read(PcapReader, bytes(data))
    assert found.payloads == PAYLOADS and found.codes == [("pcap-lost", 1)]


@pytest.mark.parametrize("junk", [b"\0" * 5000, b"\xff" * 777, b"\1\0\0\0" * 1000, bytes(range(256)) * 40])
@pytest.mark.parametrize("window", [1 << 21, 1 << 12])
def test_octets_that_are_no_packets_are_gone_over(junk: bytes, window: int) -> None:
    data = pcap(FRAMES)
    place = lengths_of(bytearray(data), 10) - 8
    found = read(PcapReader, data[:place] + junk + data[place:], window=window)
    assert found.payloads == PAYLOADS and found.codes == [("pcap-lost", 1)]
    assert found.damage[0].offset == place and f" {len(junk)} octets on" in found.damage[0].message


def test_a_file_that_was_never_filled_to_its_end_is_damage_there() -> None:
    data = pcap(FRAMES)
    found = read(PcapReader, data + bytes(100_000))
    assert found.payloads == PAYLOADS and found.codes == [("pcap-lost", 1)]
    assert found.damage[0].offset == len(data)


def test_after_a_jump_of_the_clock_and_a_break_the_file_goes_on() -> None:
    late = b"".join(record(Packet(octets, T0_NS // 10)) for octets in FRAMES)
    found = read(PcapReader, pcap(FRAMES) + b"junk" * 9 + late)
    assert found.payloads == PAYLOADS * 2 and found.codes == [("pcap-lost", 1)]


def test_files_one_behind_the_other_are_one() -> None:
    others = [framed(101, ipv4(udp(one, ports=(1, 2)))) for one in PAYLOADS]
    data = pcap(FRAMES) + pcap(others, 101, order=">", magic=0xA1B23C4D) + pcap(FRAMES)
    for window in (1 << 21, 700):
        found = read(PcapReader, data, window=window)
        assert found.payloads == PAYLOADS * 3 and found.damage == []
        assert found.times == [T0_NS + i * 10**6 for i in range(30)] * 3


def test_headers_that_contradict_themselves_all_over_are_believed() -> None:
    records = [struct.pack("<4I", 1_700_000_000, 999_999_999, len(one), 0) + one for one in FRAMES]
    found = read(PcapReader, pcap_header() + b"".join(records))
    assert found.payloads == PAYLOADS and found.damage == []


def test_one_header_that_contradicts_itself_is_not_believed() -> None:
    first = struct.pack("<4I", 1_700_000_000, 999_999_999, len(FRAMES[0]), len(FRAMES[0])) + FRAMES[0]
    found = read(PcapReader, pcap_header() + first + pcap(FRAMES[1:])[24:])
    assert found.payloads == PAYLOADS[1:] and found.codes == [("pcap-lost", 1)]


def test_without_a_header_the_usual_one_is_assumed() -> None:
    found = read(PcapReader, b"\xd4\xc3\xb2\xa0" + pcap(FRAMES)[4:])
    assert found.payloads == PAYLOADS and found.codes == [("pcap-header", 1), ("pcap-lost", 1)]


@given(st.data())
@settings(derandomize=True, deadline=None, max_examples=120)
def test_a_few_wrong_octets_cost_a_few_packets(data: st.DataObject) -> None:
    frames = [datagram(i) for i in range(60)]
    octets = bytearray(pcap(frames))
    hit = set()
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(24, len(octets) - 1))
        octets[at] = data.draw(st.integers(0, 255))
        hit.add((at - 24) // (16 + len(frames[0])))
    found = read(PcapReader, bytes(octets))
    missing = {i for i in range(60) if payload(i) not in found.payloads}
    assert all(min(abs(i - one) for one in hit) <= 3 for i in missing)  # fewer than 4 in a row are no chain


@given(st.binary(max_size=3000), st.lists(st.integers(0, 3000), max_size=4))
@settings(derandomize=True, deadline=None, max_examples=100)
def test_any_octets_can_be_read(octets: bytes, cuts: list[int]) -> None:
    for head in (b"", pcap_header(), pcap_header(101, order=">")):
        data = head + octets
        assert read(PcapReader, data, [min(cut, len(data)) for cut in cuts]) == read(PcapReader, data)


def test_tshark_reads_the_same(tmp_path: Path) -> None:
    ips = [ipv4(udp(payload(1)), options=bytes(8)), ipv6(udp(payload(2)), extensions=[(0, extension())]),
           *fragments4(udp(payload(3, 3000)), 1480), *fragments6(udp(payload(4, 2000)), 1000),
           *reversed(fragments4(udp(payload(5, 3000)), 800, ident=9, addresses=(B, A))),
           *(ip for ip in fragments4(udp(payload(6, 900)), 400, ident=10) for _ in range(1))]  # fmt: skip
    for link in (1, 113, 276, 0, 101, 229):
        of_link = [ip for ip in ips if link != 229 or ip[0] >> 4 == 6]
        packets = [ethernet(ip, tags=[0x88A8, 0x8100], padded=64) if link == 1 else framed(link, ip) for ip in of_link]
        magic = 0xA1B23C4D if link % 2 else 0xA1B2C3D4
        data = pcap([Packet(one, T0_NS + 1001 * i) for i, one in enumerate(packets)], link, magic=magic)
        found, expected = read(PcapReader, data), udp_of(data, tmp_path)
        assert [(*stream, one) for stream, one in zip(found.streams, found.payloads, strict=True)] == [
            one[1:] for one in expected
        ]
        assert [f"{t_ns // 10**9}.{t_ns % 10**9:09d}" for t_ns in found.times] == [one[0] for one in expected]


def test_tshark_reads_the_same_of_fragments_in_any_order(tmp_path: Path) -> None:
    ips = [ip for i in range(40) for ip in fragments4(udp(payload(i, 100 + 90 * i)), 400, ident=i)]
    ips = [
        ip for at in range(0, len(ips), 20) for ip in random.Random(at).sample(ips[at : at + 20], len(ips[at:][:20]))
    ]
    data = pcap([ethernet(ip) for ip in ips])
    found, expected = read(PcapReader, data), udp_of(data, tmp_path)
    assert found.payloads == [one[3] for one in expected] and len(found.payloads) == 40
