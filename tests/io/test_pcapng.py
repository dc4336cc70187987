"""pcapng files: sections, interfaces, resolutions of time, and what is done where they are damaged."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.io.containers.pcap import PcapReader
from maritrack.io.containers.pcapng import PcapngReader
from maritrack.io.datagrams import NO_TIME
from tests.io.pcap_build import (
    T0_NS,
    Packet,
    block,
    enhanced,
    ethernet,
    fragments4,
    framed,
    interface,
    ipv4,
    ipv6,
    obsolete,
    option,
    pcap,
    pcapng,
    read,
    section,
    simple,
    udp,
)
from tests.io.tshark import udp_of

ORDERS = pytest.mark.parametrize("order", "<>")
NUMBERS = [struct.pack(">I", i) + bytes((i + j) % 255 + 1 for j in range(20 + i)) for i in range(30)]
FRAMES = [ethernet(ipv4(udp(one))) for one in NUMBERS]
ONE = ethernet(ipv4(udp(b"one")))


@ORDERS
def test_the_same_packets_give_the_same_as_in_pcap(order: str) -> None:
    packets = [Packet(octets, T0_NS + 1_234_567_000 * i) for i, octets in enumerate(FRAMES)]
    found, other = read(PcapngReader, pcapng(packets, order=order)), read(PcapReader, pcap(packets))
    assert (found.payloads, found.times, found.streams) == (other.payloads, other.times, other.streams)
    assert found.payloads == NUMBERS and found.damage == []


@ORDERS
def test_all_kinds_of_packet_blocks_are_read(order: str) -> None:
    data = section(order=order) + interface(order=order)
    data += simple(FRAMES[0], order=order) + obsolete(FRAMES[1], order=order) + enhanced(FRAMES[2], order=order)
    found = read(PcapngReader, data)
    assert found.payloads == NUMBERS[:3] and found.damage == []
    assert found.times == [NO_TIME, T0_NS, T0_NS]
    assert found.offsets == [data.index(one) for one in NUMBERS[:3]]


def test_a_simple_packet_is_cut_by_the_snaplen_of_the_first_interface() -> None:
    frame = ethernet(ipv4(udp(bytes(range(1, 100)))))
    data = section() + interface(snaplen=60) + interface(snaplen=0) + simple(frame[:60], full=len(frame))
    found = read(PcapngReader, data)
    assert found.payloads == [bytes(range(1, 19))] and found.codes == [("snaplen-cut", 1)]


@ORDERS
def test_interfaces_have_their_own_links_and_times(order: str) -> None:
    data = section(order=order) + interface(order=order) + interface(101, order=order, resolution=9)
    data += enhanced(FRAMES[0], order=order)
    data += enhanced(framed(101, ipv4(udp(NUMBERS[1]))), units=T0_NS + 7, number=1, order=order)
    data += interface(113, order=order, resolution=0, offset_s=-5)
    data += obsolete(framed(113, ipv6(udp(NUMBERS[2]))), units=T0_NS // 10**9, number=2, order=order)
    found = read(PcapngReader, data)
    assert found.payloads == NUMBERS[:3] and found.damage == []
    assert found.times == [T0_NS, T0_NS + 7, T0_NS - 5 * 10**9]


def test_a_section_forgets_the_interfaces_of_the_one_before() -> None:
    data = section() + interface(101) + enhanced(framed(101, ipv4(udp(NUMBERS[0]))))
    data += section(order=">") + interface(order=">") + enhanced(FRAMES[1], order=">")
    data += section() + interface(276) + enhanced(framed(276, ipv4(udp(NUMBERS[2]))))
    for window in (64, 300, 1 << 20):
        found = read(PcapngReader, data, window=window)
        assert found.payloads == NUMBERS[:3] and found.damage == []


@pytest.mark.parametrize("resolution", [*range(22), 127, *range(128, 200), 255])
def test_any_resolution_is_exact_to_a_nanosecond(resolution: int) -> None:
    per_s = 2 ** (resolution - 128) if resolution >= 128 else 10**resolution
    for t_ns in (T0_NS + 123_456_789, 5, 86_399_999_999_999):
        units = min(t_ns * per_s // 10**9, 2**64 - 1)
        found = read(PcapngReader, section() + interface(resolution=resolution) + enhanced(ONE, units=units))
        assert found.times == [units * 10**9 // per_s] and found.damage == []


@given(st.integers(0, 2**64 - 1), st.integers(0, 255), st.integers(-(2**63), 2**63 - 1))
@settings(derandomize=True, deadline=None, max_examples=150)
def test_times_are_those_of_whole_numbers(units: int, resolution: int, offset_s: int) -> None:
    per_s = 2 ** (resolution - 128) if resolution >= 128 else 10**resolution
    found = read(
        PcapngReader, section() + interface(resolution=resolution, offset_s=offset_s) + enhanced(ONE, units=units)
    )
    second, rest = divmod(units, per_s)
    t_ns = (second + offset_s) * 10**9 + rest * 10**9 // per_s
    if abs(t_ns) < 9 * 10**18:
        assert abs(found.times[0] - t_ns) <= (1 if resolution > 128 + 34 else 0)
    elif abs(t_ns) >= 2**63:
        assert found.times == [NO_TIME] and found.codes == [("packet-time", 1)]
    assert found.payloads == [b"one"]


def test_blocks_that_are_no_packets_are_passed_over() -> None:
    others = b"".join(block(kind, bytes(range(size))) for size, kind in enumerate([4, 5, 9, 10, 0xBAD, 0x40000BAD, 77]))
    found = read(PcapngReader, section(options=option(4, b"maker")) + interface() + others + enhanced(ONE) + others)
    assert found.payloads == [b"one"] and found.damage == []


LYING_OPTIONS = {
    "longer than the block": struct.pack("<HH", 9, 60_000),
    "a resolution of no octets": struct.pack("<HH", 9, 0),
    "an offset of 4 octets": struct.pack("<HHI", 14, 4, 77),
    "many empty ones": struct.pack("<HH", 2, 0) * 100,
    "cut": b"\2\0",
}


@pytest.mark.parametrize("options", LYING_OPTIONS.values(), ids=LYING_OPTIONS)
def test_options_that_lie_change_nothing(options: bytes) -> None:
    data = section(options=options) + block(1, struct.pack("<HHI", 1, 0, 0) + options) + enhanced(ONE)
    found = read(PcapngReader, data)
    assert found.payloads == [b"one"] and found.times == [T0_NS] and found.damage == []


def test_a_packet_of_an_unknown_interface_is_read_as_one_of_the_first() -> None:
    data = section() + interface(101) + enhanced(ipv4(udp(b"one")), number=3) + section() + enhanced(ONE)
    found = read(PcapngReader, data)
    assert found.payloads == [b"one", b"one"] and found.codes == [("no-interface", 2)]


def test_a_packet_longer_than_its_block_is_cut_to_it() -> None:
    frame = FRAMES[0] + bytes(-len(FRAMES[0]) % 4)
    found = read(PcapngReader, section() + interface() + enhanced(frame, held=500) + enhanced(ONE))
    assert found.payloads == [NUMBERS[0], b"one"] and found.codes == [("packet-length", 1)]


@pytest.mark.parametrize("kind", [2, 3, 6, 1])
@pytest.mark.parametrize("size", [0, 4, 8])
def test_blocks_too_short_for_what_they_are_give_nothing(kind: int, size: int) -> None:
    found = read(PcapngReader, section() + interface() + block(kind, b"\xff" * size) + enhanced(ONE))
    assert found.payloads == [b"one"]


def test_a_file_cut_anywhere_delivers_what_is_there() -> None:
    head = section() + interface()
    blocks = [enhanced(octets) for octets in FRAMES[:3]]
    data = head + b"".join(blocks)
    ends = [len(head)]
    for one in blocks:
        ends.append(ends[-1] + len(one))
    for cut in range(len(head), len(data)):
        found = read(PcapngReader, data[:cut])
        whole = sum(cut >= end for end in ends[1:])
        begun = cut - ends[whole] - 28 - 42  # octets of the cut one's payload
        expected = [*NUMBERS[:whole], *([NUMBERS[whole][:begun]] if begun >= 0 and cut != ends[whole] else [])]
        assert found.payloads == expected
        assert found.codes == ([] if cut == ends[whole] else [("pcap-cut", 1)])
    for cut in range(1, len(head)):
        assert read(PcapngReader, data[:cut]).payloads == []


@ORDERS
@pytest.mark.parametrize("length", [0, 4, 8, 33, 36, 100, 4000, 1 << 22, 0xFFFFFFFC, 0xFFFFFFFF])
@pytest.mark.parametrize("window", [1 << 21, 200])
def test_a_length_that_cannot_be_costs_one_packet(order: str, length: int, window: int) -> None:
    blocks = [enhanced(octets, order=order) for octets in FRAMES]
    head = section(order=order) + interface(order=order)
    place = len(head) + sum(map(len, blocks[:10]))
    data = bytearray(head + b"".join(blocks))
    data[place + 4 : place + 8] = struct.pack(order + "I", length)
    found = read(PcapngReader, bytes(data), window=window)
    assert found.payloads == NUMBERS[:10] + NUMBERS[11:]
    assert found.codes == [("pcap-lost", 1)] and found.damage[0].offset == place


@pytest.mark.parametrize(
    "junk", [b"\0" * 5000, b"\xff" * 777, b"\6\0\0\0" * 1000, bytes(range(256)) * 40, b"\n\r\r\n" * 99]
)
@pytest.mark.parametrize("window", [1 << 21, 1 << 10])
def test_octets_that_are_no_blocks_are_gone_over(junk: bytes, window: int) -> None:
    head, tail = pcapng(FRAMES[:10]), b"".join(enhanced(octets) for octets in FRAMES[10:])
    found = read(PcapngReader, head + junk + tail, window=window)
    assert found.payloads == NUMBERS and found.codes == [("pcap-lost", 1)]
    assert found.damage[0].offset == len(head)


@ORDERS
@pytest.mark.parametrize("window", [1 << 21, 3000])
def test_without_its_first_blocks_a_file_is_read_as_ethernet(order: str, window: int) -> None:
    whole = pcapng(FRAMES, order=order)
    found = read(PcapngReader, whole[len(section()) + 1 :], window=window)
    assert found.payloads == NUMBERS and found.codes == [("no-interface", 30), ("pcap-lost", 1)]


def test_more_interfaces_than_anyone_has_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("maritrack.io.containers.pcapng.MAX_INTERFACES", 2)
    data = section() + interface() * 3 + enhanced(ONE, number=1) + enhanced(ONE, number=2)
    assert read(PcapngReader, data).codes == [("no-interface", 1), ("too-many-interfaces", 1)]


@given(st.lists(st.integers(0, 3000), max_size=40), st.integers(17, 3000))
@settings(derandomize=True, deadline=None, max_examples=60)
def test_cuts_and_windows_change_nothing(cuts: list[int], window: int) -> None:
    data = bytearray(pcapng(FRAMES[:15]) + section(order=">") + interface(order=">"))
    data += b"".join(enhanced(octets, order=">") for octets in FRAMES[15:])
    data[900:903] = b"\xff\xff\xff"
    whole = read(PcapngReader, bytes(data))
    assert read(PcapngReader, bytes(data), cuts) == whole
    small = read(PcapngReader, bytes(data), window=window)
    assert small[:4] == whole[:4] and small.codes == whole.codes


@given(st.data())
@settings(derandomize=True, deadline=None, max_examples=120)
def test_a_few_wrong_octets_cost_a_few_packets(data: st.DataObject) -> None:
    head = len(section() + interface())
    octets = bytearray(pcapng([FRAMES[0][:58] + struct.pack(">I", i) + bytes(4) for i in range(60)]))
    size, hit = (len(octets) - head) // 60, set()
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(head, len(octets) - 1))
        octets[at] = data.draw(st.integers(0, 255))
        hit.add((at - head) // size)
    found = read(PcapngReader, bytes(octets))
    got = {int.from_bytes(payload[16:20], "big") for payload in found.payloads}
    assert set(range(60)) - got <= hit


@given(st.binary(max_size=3000), st.lists(st.integers(0, 3000), max_size=4))
@settings(derandomize=True, deadline=None, max_examples=100)
def test_any_octets_can_be_read(octets: bytes, cuts: list[int]) -> None:
    for head in (b"", section(), section(order=">") + interface(order=">")):
        data = head + octets
        assert read(PcapngReader, data, [min(cut, len(data)) for cut in cuts]) == read(PcapngReader, data)


def test_tshark_reads_the_same(tmp_path: Path) -> None:
    parts = fragments4(udp(NUMBERS[4] * 60), 800)
    for order in "<>":
        data = section(order=order, options=option(4, b"maker", order=order)) + interface(order=order)
        data += interface(101, order=order, resolution=9) + interface(276, order=order, resolution=0x94, offset_s=1000)
        data += enhanced(FRAMES[0], order=order) + obsolete(FRAMES[1], order=order)
        data += enhanced(framed(101, ipv6(udp(NUMBERS[2]))), units=T0_NS + 7, number=1, order=order)
        data += enhanced(framed(276, ipv4(udp(NUMBERS[3]))), units=(T0_NS // 10**9 << 20) + 77, number=2, order=order)
        data += b"".join(enhanced(ethernet(ip), order=order) for ip in (parts[1], parts[0], parts[2]))
        data += section() + interface(101) + enhanced(framed(101, ipv4(udp(NUMBERS[5]))))
        found, expected = read(PcapngReader, data), udp_of(data, tmp_path)
        assert [(*stream, one) for stream, one in zip(found.streams, found.payloads, strict=True)] == [
            one[1:] for one in expected
        ]
        assert [f"{t_ns // 10**9}.{t_ns % 10**9:09d}" for t_ns in found.times] == [one[0] for one in expected]
        assert found.damage == []
