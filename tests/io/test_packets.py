"""UDP out of packets of all kinds of links, against a reader that goes octet by octet."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.io.containers.pcap import PcapReader
from maritrack.io.datagrams import Stream
from tests.io.pcap_build import (
    A6,
    GROUP6,
    LINKS,
    A,
    B,
    Packet,
    ethernet,
    extension,
    fragment_header,
    fragments4,
    fragments6,
    framed,
    ipv4,
    ipv6,
    pcap,
    read,
    udp,
)
from tests.io.pcap_oracle import oracle

PAYLOAD = bytes(range(1, 41))


def payloads(*packets: bytes | Packet, link: int = 1) -> list[bytes]:
    found = read(PcapReader, pcap(packets, link))
    assert found.damage == []
    return found.payloads


def codes(*packets: bytes | Packet, link: int = 1) -> list[tuple[str, int]]:
    return read(PcapReader, pcap(packets, link)).codes


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("ip", [ipv4(udp(PAYLOAD)), ipv6(udp(PAYLOAD))], ids=["IPv4", "IPv6"])
def test_every_link_type_gives_the_payload(link: int, ip: bytes) -> None:
    assert payloads(framed(link, ip), link=link) == [PAYLOAD]


@pytest.mark.parametrize("family", [24, 28, 30, 10, 23])
@pytest.mark.parametrize("order", "<>")
def test_loopback_knows_the_families_of_all_systems(family: int, order: str) -> None:
    head = struct.pack(order + "I", family)
    assert payloads(head + ipv6(udp(PAYLOAD)), link=0) == payloads(head + ipv6(udp(PAYLOAD)), link=108) == [PAYLOAD]


def test_loopback_of_another_family_is_passed_over() -> None:
    assert payloads(b"\7\0\0\0" + ipv4(udp(PAYLOAD)), b"\0\2\0\0" + ipv4(udp(PAYLOAD)), link=0) == []


@pytest.mark.parametrize("tags", [(0x8100,), (0x88A8, 0x8100), (0x9100, 0x9200, 0x9300, 0x8100), (0x8100,) * 8])
def test_vlan_tags_nest(tags: tuple[int, ...]) -> None:
    assert payloads(ethernet(ipv4(udp(PAYLOAD)), tags=tags)) == [PAYLOAD]
    assert payloads(ethernet(ipv6(udp(PAYLOAD)), tags=tags)) == [PAYLOAD]


def test_more_vlan_tags_than_anyone_uses_are_damage() -> None:
    assert codes(ethernet(ipv4(udp(PAYLOAD)), tags=(0x8100,) * 9)) == [("bad-packet", 1)]


def test_a_frame_that_ends_in_its_tags_is_damage() -> None:
    whole = ethernet(ipv4(udp(PAYLOAD)), tags=(0x8100,) * 3)
    assert codes(Packet(whole[:20], full=len(whole)), Packet(whole[:20])) == [("packet-short", 1), ("snaplen-cut", 1)]


def test_the_addresses_and_ports_make_the_stream_in_order_of_appearance() -> None:
    data = pcap([
        ethernet(ipv4(udp(b"1"))), ethernet(ipv6(udp(b"2", ports=(1, 65_535)))),
        ethernet(ipv4(udp(b"3"), addresses=(B, A))), ethernet(ipv4(udp(b"4"))),
    ])  # fmt: skip
    reader = PcapReader([data])
    assert [number for d in reader.datagrams() for number in d.stream.tolist()] == [0, 1, 2, 0]
    assert reader.streams == [
        Stream("10.0.0.1:4000", "239.0.1.2:8600"), Stream("[fe80::1]:1", "[ff02::5]:65535"),
        Stream("10.0.0.2:4000", "10.0.0.1:8600"),
    ]  # fmt: skip


def test_the_offset_is_where_the_payload_begins() -> None:
    data = pcap([ethernet(ipv4(udp(PAYLOAD), options=bytes(8)), tags=[0x8100])])
    assert read(PcapReader, data).offsets == [data.index(PAYLOAD)]


def test_padding_of_short_frames_is_trimmed() -> None:
    assert payloads(ethernet(ipv4(udp(b"ab")), padded=64), ethernet(ipv4(udp(b"")), padded=64)) == [b"ab", b""]


def test_octets_beyond_the_udp_length_are_trimmed() -> None:
    assert payloads(ethernet(ipv4(udp(PAYLOAD, length=13)))) == [PAYLOAD[:5]]


@pytest.mark.parametrize("length", [0, 7, 49, 65_535])
def test_a_udp_length_that_cannot_be_gives_way_to_that_of_ip(length: int) -> None:
    data = pcap([ethernet(ipv4(udp(PAYLOAD, length=length)))])
    found = read(PcapReader, data)
    assert found.payloads == [PAYLOAD] and found.codes == [("udp-length", 1)]


def test_an_ip_length_left_to_the_card_is_that_of_the_frame() -> None:
    assert payloads(ethernet(ipv4(udp(PAYLOAD), length=0))) == [PAYLOAD]
    assert payloads(ethernet(ipv6(udp(PAYLOAD), length=0))) == [PAYLOAD]


@pytest.mark.parametrize("octets", [0, 4, 40])
def test_ipv4_options_are_gone_over(octets: int) -> None:
    assert payloads(ethernet(ipv4(udp(PAYLOAD), options=bytes(octets)))) == [PAYLOAD]


def test_ipv6_extension_headers_are_gone_over() -> None:
    extensions = [(0, extension()), (43, extension(2)), (60, extension(31)), (51, b"\4" + bytes(22)),
                  (135, extension()), (44, fragment_header(9, 0, more=False)), (60, extension())]  # fmt: skip
    assert payloads(ethernet(ipv6(udp(PAYLOAD), extensions=extensions))) == [PAYLOAD]


def test_more_extension_headers_than_anyone_uses_are_damage() -> None:
    assert codes(ethernet(ipv6(udp(PAYLOAD), extensions=[(60, extension())] * 9))) == [("bad-packet", 1)]


def test_extension_headers_that_reach_beyond_the_packet_are_damage() -> None:
    beyond = (60, b"\xff" + bytes(6))
    assert codes(ethernet(ipv6(b"", extensions=[beyond]))) == [("bad-packet", 1)]
    assert codes(ethernet(ipv6(b"", extensions=[beyond, beyond]))) == [("packet-short", 1)]


def test_what_is_no_udp_is_passed_over_in_silence() -> None:
    assert payloads(
        ethernet(ipv4(b"tcp" * 9, protocol=6)), ethernet(b"\0" * 28, ethertype=0x0806),
        ethernet(ipv6(b"icmp" * 9, protocol=58)), ethernet(b"B" * 40, ethertype=38), ethernet(ipv4(udp(b"yes"))),
    ) == [b"yes"]  # fmt: skip


LIES = {
    "version 5": b"\x55" + ipv4(udp(PAYLOAD))[1:],
    "a header of 16 octets": b"\x44" + ipv4(udp(PAYLOAD))[1:],
    "a length of 19": ipv4(udp(PAYLOAD), length=19),
    "a length shorter than the options": ipv4(udp(PAYLOAD), options=bytes(20), length=39),
    "no room for UDP": ipv4(udp(b""), length=27),
}


@pytest.mark.parametrize("ip", LIES.values(), ids=LIES)
def test_a_header_that_lies_costs_its_packet_alone(ip: bytes) -> None:
    found = read(PcapReader, pcap([ethernet(ip, ethertype=0x0800), ethernet(ipv4(udp(b"next")))]))
    assert found.payloads == [b"next"] and found.codes == [("bad-packet", 1)]


def test_a_header_longer_than_the_frame_is_damage() -> None:
    assert codes(ethernet(b"\x4f" + ipv4(udp(b""))[1:])) == [("bad-packet", 1)]  # 60 octets, but a length of 28
    assert codes(ethernet(b"\x4f" + ipv4(udp(b""), length=80)[1:])) == [("packet-short", 1)]


def test_what_the_capture_cut_is_delivered_as_far_as_it_goes() -> None:
    whole = ethernet(ipv4(udp(PAYLOAD)))
    found = read(PcapReader, pcap([Packet(whole[:-30], full=len(whole)), Packet(whole[:-30]), Packet(whole)]))
    assert found.payloads == [PAYLOAD[:10], PAYLOAD[:10], PAYLOAD]
    assert found.codes == [("packet-short", 1), ("snaplen-cut", 1)]


@pytest.mark.parametrize("held", range(0, 42))
def test_a_cut_in_the_headers_leaves_nothing_but_damage(held: int) -> None:
    whole = ethernet(ipv4(udp(PAYLOAD)))
    found = read(PcapReader, pcap([Packet(whole[:held], full=len(whole))]))
    assert found.payloads == [] and found.codes == [("snaplen-cut", 1)]


def test_a_cut_tcp_packet_is_no_damage() -> None:
    whole = ethernet(ipv4(b"tcp" * 99, protocol=6))
    assert payloads(Packet(whole[:30], full=len(whole)), Packet(whole[:60], full=len(whole))) == []


def test_packets_of_an_unknown_link_are_counted() -> None:
    assert codes(b"radio" * 9, b"radio" * 9, link=127) == [("unknown-link", 2)]


@st.composite
def packets(draw: st.DrawFn) -> tuple[int, list[Packet]]:
    """Packets of one link type: good ones, fragments out of order and twice, cut ones and spoilt ones."""
    link = draw(st.sampled_from(LINKS))
    ips: list[bytes] = []
    for i in range(draw(st.integers(1, 6))):
        body = udp(bytes([i]) * draw(st.integers(0, 70)), ports=(i % 3, 8600))
        body += draw(st.binary(max_size=3))  # what is beyond the UDP length
        kind = draw(st.integers(0, 5))
        if kind == 0:
            ips.append(ipv4(body, options=bytes(4 * draw(st.integers(0, 10)))))
        elif kind == 1:
            numbers = draw(st.lists(st.sampled_from([0, 43, 60, 51]), max_size=3))
            ips.append(ipv6(body, extensions=[(n, extension()) for n in numbers]))
        elif kind == 2:
            ips.append(ipv4(body, protocol=6))
        else:
            cut = fragments6 if kind == 3 else fragments4
            parts = cut(body, 8 * draw(st.integers(1, 5)), ident=draw(st.integers(0, 2)))
            if draw(st.booleans()):
                parts = draw(st.lists(st.sampled_from(parts), max_size=2 * len(parts)))
            ips += parts
    if draw(st.booleans()):
        ips = draw(st.permutations(ips))
    return link, [_spoil(draw, framed(link, ip) if draw(st.booleans()) or link != 1 else
                         ethernet(ip, tags=[0x8100] * draw(st.integers(0, 9)), padded=60)) for ip in ips]  # fmt: skip


def _spoil(draw: st.DrawFn, octets: bytes) -> Packet:
    spoilt, full = bytearray(octets), len(octets)
    for _ in range(draw(st.sampled_from([0, 0, 0, 1, 2]))):
        spoilt[draw(st.integers(0, min(79, full - 1)))] = draw(st.integers(0, 255))
    if draw(st.integers(0, 5)) == 0:
        spoilt = spoilt[: draw(st.integers(0, full))]
    return Packet(bytes(spoilt), full=full)


@given(packets(), st.integers(64, 4096))
@settings(derandomize=True, deadline=None, max_examples=150)
def test_what_is_found_is_what_a_plain_reader_finds(many: tuple[int, list[Packet]], window: int) -> None:
    link, sent = many
    data = pcap([Packet(p.octets, full=p.full) for p in sent], link)
    expected = [found[:3] for found in oracle((link, p.octets, p.full) for p in sent)]
    for how in ({}, {"fast": False}, {"window": window}, {"window": window, "fast": False}):
        found = read(PcapReader, data, **how)
        delivered = [(payload, *stream) for payload, stream in zip(found.payloads, found.streams, strict=True)]
        assert sorted(delivered) == sorted(expected)


@given(packets(), st.integers(64, 4096))
@settings(derandomize=True, deadline=None, max_examples=80)
def test_many_at_a_time_and_one_by_one_are_the_same(many: tuple[int, list[Packet]], window: int) -> None:
    link, sent = many
    data = pcap([Packet(p.octets, full=p.full) for p in sent], link)
    fast, slow = read(PcapReader, data), read(PcapReader, data, fast=False)
    assert fast[:5] == slow[:5]
    assert read(PcapReader, data, window=window)[:4] == fast[:4]


def test_mapped_addresses_stay_ipv6() -> None:
    mapped = bytes(10) + b"\xff\xff" + A
    data = pcap([ethernet(ipv6(udp(b"x"), addresses=(mapped, GROUP6))), ethernet(ipv6(udp(b"y"), addresses=(A6, A6)))])
    assert [source for source, _ in read(PcapReader, data).streams] == ["[::ffff:10.0.0.1]:4000", "[fe80::1]:4000"]
