"""Datagrams in fragments: out of order, missing, overlapping, twice, and never complete."""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.io.containers import fragments
from maritrack.io.containers.pcap import PcapReader
from maritrack.io.containers.pcapng import PcapngReader
from tests.io.pcap_build import (
    T0_NS,
    B,
    Packet,
    Read,
    cut_up,
    ethernet,
    fragments4,
    fragments6,
    interface,
    ipv4,
    pcap,
    read,
    section,
    simple,
    udp,
)

PAYLOAD = bytes(i * 7 % 251 for i in range(100))
BODY = udp(PAYLOAD)  # 108 octets
FAMILIES = pytest.mark.parametrize("cut", [fragments4, fragments6], ids=["IPv4", "IPv6"])
BOTH = pytest.mark.parametrize("fast", [True, False], ids=["fast", "one by one"])
Cut = Callable[..., list[bytes]]


def found(*ips: bytes, fast: bool = True) -> Read:
    return read(PcapReader, pcap([ethernet(ip) for ip in ips]), fast=fast)


def at_times(*packets: tuple[float, bytes]) -> Read:
    """What is found of IP packets at times in seconds."""
    return read(PcapReader, pcap([Packet(ethernet(ip), T0_NS + round(s * 10**9)) for s, ip in packets]))


def part(octets: bytes, place: int, *, more: bool = True, ident: int = 7) -> bytes:
    return ipv4(octets, ident=ident, place=place, more=more)


@FAMILIES
@BOTH
def test_fragments_in_order_make_the_datagram(cut: Cut, fast: bool) -> None:
    one = found(*cut(BODY, 24), fast=fast)
    assert one.payloads == [PAYLOAD] and one.damage == []


@FAMILIES
@BOTH
@pytest.mark.parametrize("seed", range(4))
def test_fragments_in_any_order_make_the_datagram(cut: Cut, fast: bool, seed: int) -> None:
    parts = cut(BODY, 16)
    random.Random(seed).shuffle(parts)
    one = found(*parts, fast=fast)
    assert one.payloads == [PAYLOAD] and one.damage == []


@BOTH
def test_time_is_that_of_the_last_fragment_and_offset_that_of_the_first_that_came(fast: bool) -> None:
    parts = [ethernet(ip) for ip in fragments4(BODY, 40)]
    for order in ([0, 1, 2], [1, 2, 0], [2, 1, 0]):
        data = pcap([parts[i] for i in order])
        one = read(PcapReader, data, fast=fast)
        first = PAYLOAD[:8] if order[0] == 0 else BODY[40 * order[0] :][:8]
        assert one.times == [T0_NS + 2 * 10**6] and one.offsets == [data.index(first)]


@BOTH
def test_datagrams_that_interleave_are_kept_apart(fast: bool) -> None:
    bodies = [udp(bytes([i]) * 50, ports=(i, 1)) for i in range(5)]
    rows = [fragments4(body, 24, ident=i // 2, addresses=(B, bytes([i, 0, 0, 1]))) for i, body in enumerate(bodies)]
    one = found(*(ip for column in zip(*rows, strict=True) for ip in column), fast=fast)
    assert one.payloads == [bytes([i]) * 50 for i in range(5)] and one.damage == []
    assert [source for source, _ in one.streams] == [f"10.0.0.2:{i}" for i in range(5)]


@BOTH
def test_a_sender_may_use_one_identification_for_all(fast: bool) -> None:
    bodies = [udp(bytes([i]) * 50) for i in range(5)]
    one = found(*(ip for body in bodies for ip in fragments4(body, 24)), fast=fast)
    assert one.payloads == [bytes([i]) * 50 for i in range(5)] and one.damage == []


@FAMILIES
@BOTH
def test_fragments_that_come_twice_make_one_datagram(cut: Cut, fast: bool) -> None:
    one = found(*(ip for ip in cut(BODY, 40) for _ in range(2)), fast=fast)
    assert one.payloads == [PAYLOAD] and one.codes == [("fragment-duplicate", 3)]


@BOTH
def test_what_is_there_up_to_the_first_hole_is_delivered(fast: bool) -> None:
    parts = fragments4(BODY, 24)
    one = found(*parts[:2], *parts[3:], fast=fast)
    assert one.payloads == [PAYLOAD[:40]] and one.codes == [("fragment-missing", 1)]


@BOTH
def test_without_the_last_fragment_the_others_are_delivered(fast: bool) -> None:
    one = found(*fragments4(BODY, 24)[:-1], fast=fast)
    assert one.payloads == [PAYLOAD[:88]] and one.codes == [("fragment-missing", 1)]


@BOTH
def test_without_the_first_fragment_nothing_is_delivered(fast: bool) -> None:
    one = found(*fragments4(BODY, 24)[1:], fast=fast)
    assert one.payloads == [] and one.codes == [("fragment-missing", 1)]


@BOTH
def test_octets_that_came_first_stay_where_fragments_overlap(fast: bool) -> None:
    first, last = part(BODY[:64], 0), part(b"\xaa" * 40 + BODY[96:], 56, more=False)
    one = found(first, last, fast=fast)
    assert one.codes == [("fragment-overlap", 1)]
    assert one.payloads == [PAYLOAD[:56] + b"\xaa" * 32 + PAYLOAD[88:]]
    one = found(last, first, fast=fast)
    assert one.payloads == [PAYLOAD[:48] + b"\xaa" * 40 + PAYLOAD[88:]]


def test_a_fragment_with_other_octets_in_the_same_place_changes_nothing() -> None:
    one = found(part(BODY[:64], 0), part(b"\xaa" * 24, 40), part(BODY[64:], 64, more=False))
    assert one.payloads == [PAYLOAD] and one.codes == [("fragment-overlap", 1)]


def test_an_overlap_fills_holes_on_both_sides() -> None:
    one = found(part(BODY[:16], 0), part(BODY[40:48], 40), part(BODY[8:64], 8), part(BODY[64:], 64, more=False))
    assert one.payloads == [PAYLOAD] and one.codes == [("fragment-overlap", 1)]


def test_the_end_that_was_told_first_stays() -> None:
    parts = cut_up(BODY, 40)
    one = found(part(BODY[80:], 80, more=False), part(bytes(80), 80), part(bytes(8), 96, more=False),
                part(bytes(8), 200), *(part(octets, at) for at, octets, more in parts if more))  # fmt: skip
    assert one.payloads == [PAYLOAD] and one.codes == [("fragment-overlap", 3)]


def test_an_end_before_what_is_there_is_not_believed() -> None:
    one = found(part(BODY[:64], 0), part(BODY[40:56], 40, more=False), part(BODY[64:], 64, more=False))
    assert one.payloads == [PAYLOAD] and one.codes == [("fragment-overlap", 1)]


def test_a_last_fragment_that_is_not_believed_invents_no_octets() -> None:
    one = found(part(BODY[80:], 80, more=False), part(b"z", 8, more=False), part(BODY[:80], 0))
    assert one.payloads == [PAYLOAD] and one.codes == [("fragment-overlap", 1)]


def test_a_first_fragment_with_another_udp_header_begins_a_new_datagram() -> None:
    other = udp(b"z" * 100, ports=(5, 6))
    one = found(*fragments4(BODY, 40)[:2], *fragments4(other, 40))
    assert one.payloads == [PAYLOAD[:72], b"z" * 100] and one.codes == [("fragment-missing", 1)]


def test_octets_beyond_the_udp_length_are_trimmed() -> None:
    one = found(*fragments4(udp(PAYLOAD, length=28), 24))
    assert one.payloads == [PAYLOAD[:20]] and one.damage == []


def test_a_udp_length_beyond_the_fragments_is_damage() -> None:
    one = found(*fragments4(udp(PAYLOAD, length=500), 24))
    assert one.payloads == [PAYLOAD] and one.codes == [("udp-length", 1)]


@pytest.mark.parametrize(
    "bad", [part(bytes(20), 24), part(b"", 24), part(bytes(16), 65_528), part(bytes(9), 65_528, more=False)]
)
def test_a_fragment_that_cannot_be_is_left_out(bad: bytes) -> None:
    first, *others = fragments4(BODY, 24)
    one = found(first, bad, *others)
    assert one.payloads == [PAYLOAD] and one.codes == [("bad-packet", 1)]


def test_the_largest_datagram_fits() -> None:
    payload = bytes(i % 253 for i in range(65_507))
    parts = fragments4(udp(payload), 1480)
    assert found(*parts).payloads == found(*reversed(parts)).payloads == [payload]


def test_padding_behind_fragments_is_trimmed() -> None:
    data = pcap([ethernet(ip, padded=64) for ip in fragments4(BODY, 8)])
    assert read(PcapReader, data).payloads == read(PcapReader, data, fast=False).payloads == [PAYLOAD]


def test_a_cut_fragment_ends_what_is_delivered() -> None:
    parts = [ethernet(ip) for ip in fragments4(BODY, 40)]
    cut = [Packet(octets[:50], full=len(octets)) for octets in parts]
    one = read(PcapReader, pcap([parts[0], cut[1], parts[2]]))
    assert one.payloads == [PAYLOAD[: 32 + 16]] and one.codes == [("snaplen-cut", 1)]
    one = read(PcapReader, pcap(cut))
    assert one.payloads == [PAYLOAD[:8]] and one.codes == [("snaplen-cut", 3)]


def test_the_whole_fragment_may_come_in_before_the_cut_one() -> None:
    parts = [ethernet(ip) for ip in fragments4(BODY, 40)]
    one = read(PcapReader, pcap([parts[1], Packet(parts[1][:50], full=74), *parts[0::2]]))
    assert one.payloads == [PAYLOAD] and one.codes == [("fragment-duplicate", 1), ("snaplen-cut", 1)]


def test_a_datagram_does_not_wait_for_ever() -> None:
    first, second, third = fragments4(BODY, 40)
    one = at_times((0, first), (1, second), (20, ipv4(udp(b"later"))), (21, third))
    assert one.payloads == [b"later", PAYLOAD[:72]]
    assert one.codes == [("fragment-missing", 2)]
    assert at_times((0, first), (2, second), (4.9, third)).payloads == [PAYLOAD]
    assert at_times((4.9, first), (2, second), (0, third)).payloads == [PAYLOAD]


@BOTH
def test_fragments_of_an_earlier_datagram_do_not_end_a_later_one(fast: bool) -> None:
    parts = fragments4(BODY, 40)
    packets = [Packet(ethernet(ip), T0_NS + s * 10**9) for s, ip in zip((0, 1, 100), parts, strict=True)]
    one = read(PcapReader, pcap(packets), fast=fast)
    assert one.payloads == [PAYLOAD[:72]] and one.codes == [("fragment-missing", 2)]


@BOTH
@pytest.mark.parametrize(("last_s", "payload", "missing"), [(4.9, PAYLOAD, 0), (5.1, PAYLOAD[:72], 2)])
def test_fragments_in_order_belong_together_for_five_seconds(
    fast: bool, last_s: float, payload: bytes, missing: int
) -> None:
    """In one stretch of the file: packets that follow."""
    ips = [*fragments4(BODY, 40), *[ipv4(udp(b"next"))] * 3]
    packets = [Packet(ethernet(ip), T0_NS + round(s * 10**9)) for s, ip in zip((0, 1, *[last_s] * 4), ips, strict=True)]
    one = read(PcapReader, pcap(packets), fast=fast)
    assert one.payloads == [payload, *[b"next"] * 3] and dict(one.codes).get("fragment-missing", 0) == missing


def test_without_times_the_fragments_since_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fragments, "MAX_AGE", 10)
    first, second, third = fragments4(BODY, 40)
    others = [part(bytes(8), 8 * (i + 1), ident=9) for i in range(12)]
    blocks = [simple(ethernet(ip)) for ip in (first, second, *others, third)]
    one = read(PcapngReader, section() + interface() + b"".join(blocks), fast=False)
    assert one.payloads == [PAYLOAD[:72]]


def test_no_more_datagrams_wait_than_memory_allows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fragments, "MAX_WAITING", 3)
    heads = [part(bytes(4) + b"\0\xff" + bytes([i]) * 10, 0, ident=i) for i in range(5)]
    one = found(*heads, part(bytes([4]) * 239, 16, ident=4, more=False))
    assert [payload[2:8] for payload in one.payloads] == [bytes([i]) * 6 for i in (0, 1, 4, 2, 3)]
    assert one.codes == [("fragment-missing", 4)]


def test_no_more_octets_wait_than_memory_allows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fragments, "MAX_OCTETS", 200_000)
    far = [part(bytes(8), 60_000, ident=i) for i in range(10)]
    reader = PcapReader([pcap([ethernet(ip) for ip in far])])
    assert sum(one.count for d in reader.datagrams() for one in d.damage) == 10


@st.composite
def series(draw: st.DrawFn) -> list[tuple[int, bytes, bool, int]]:
    """Fragments of a few datagrams, of which some overlap with other octets: place, octets, more, identification."""
    made = []
    for ident in range(draw(st.integers(1, 3))):
        body = udp(bytes([ident]) * draw(st.integers(20, 120)))
        parts = cut_up(body, 8 * draw(st.integers(1, 4)))
        for _ in range(draw(st.integers(0, 3))):
            at = 8 * draw(st.integers(0, 12))
            octets, more = draw(st.binary(min_size=8, max_size=8)) * draw(st.integers(1, 4)), draw(st.booleans())
            parts.append((at, octets if more else octets[draw(st.integers(0, 7)) :], more))
        made += [(*one, ident) for one in (draw(st.permutations(parts)) if draw(st.booleans()) else parts)]
    return draw(st.permutations(made)) if draw(st.booleans()) else made


@given(series())
@settings(derandomize=True, deadline=None, max_examples=150)
def test_no_octet_is_invented(parts: list[tuple[int, bytes, bool, int]]) -> None:
    one = found(*(part(octets, at, more=more, ident=ident) for at, octets, more, ident in parts))
    told = {code for code, _ in one.codes}
    assert len(one.payloads) <= len(parts)
    for payload in one.payloads:
        for i, octet in enumerate(payload, 8):
            assert any(at <= i < at + len(octets) and octets[i - at] == octet for at, octets, _, _ in parts)
    assert told <= {"fragment-missing", "fragment-overlap", "fragment-duplicate", "udp-length", "bad-packet"}


@given(series(), st.lists(st.integers(0, 3000), max_size=5), st.integers(30, 400))
@settings(derandomize=True, deadline=None, max_examples=150)
def test_cuts_and_windows_change_nothing(
    parts: list[tuple[int, bytes, bool, int]], cuts: list[int], window: int
) -> None:
    data = pcap([ethernet(part(octets, at, more=more, ident=ident)) for at, octets, more, ident in parts])
    whole = read(PcapReader, data)
    assert read(PcapReader, data, [min(cut, len(data)) for cut in cuts]) == whole
    assert read(PcapReader, data, fast=False)[:5] == whole[:5]
    small = read(PcapReader, data, window=window)
    assert small[:4] == whole[:4] and small.codes == whole.codes
