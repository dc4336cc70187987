"""Captures built octet by octet, for tests."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

from maritrack.io.datagrams import Datagrams
from maritrack.types import Damage

T0_NS = 1_700_000_000 * 10**9
MAC = bytes.fromhex("01005e000102 020000000001")
A, B, GROUP = b"\x0a\0\0\1", b"\x0a\0\0\2", b"\xef\0\1\2"
A6, GROUP6 = bytes.fromhex("fe80" + 13 * "00" + "01"), bytes.fromhex("ff02" + 13 * "00" + "05")


class Packet(NamedTuple):
    """A packet as a file has it."""

    octets: bytes
    t_ns: int = T0_NS
    full: int = -1  # octets on the wire, -1 = all were captured


def udp(payload: bytes, *, ports: tuple[int, int] = (4000, 8600), length: int = -1) -> bytes:
    return struct.pack(">4H", *ports, 8 + len(payload) if length < 0 else length, 0x1234) + payload


def ipv4(body: bytes, *, addresses: tuple[bytes, bytes] = (A, GROUP), options: bytes = b"", protocol: int = 17,
         ident: int = 0, place: int = 0, more: bool = False, length: int = -1) -> bytes:  # fmt: skip
    head = 20 + len(options)
    total = head + len(body) if length < 0 else length
    flags = place // 8 | more << 13
    start = struct.pack(">BBHHHBBH", 0x40 | head // 4, 0, total, ident, flags, 64, protocol, 0)
    return start + addresses[0] + addresses[1] + options + body


def ipv6(body: bytes, *, addresses: tuple[bytes, bytes] = (A6, GROUP6), extensions: Sequence[tuple[int, bytes]] = (),
         protocol: int = 17, length: int = -1) -> bytes:  # fmt: skip
    """Extensions: the number of each, and its octets from the second on (of the fragment header too)."""
    kinds = [*(kind for kind, _ in extensions), protocol]
    inner = b"".join(bytes([kinds[i + 1]]) + octets for i, (_, octets) in enumerate(extensions)) + body
    size = len(inner) if length < 0 else length
    return struct.pack(">IHBB", 6 << 28, size, kinds[0], 64) + addresses[0] + addresses[1] + inner


def extension(units: int = 0) -> bytes:
    """A hop-by-hop, routing or destination header of 8 (units + 1) octets, without its first."""
    return bytes([units]) + bytes(8 * units + 6)


def fragment_header(ident: int, place: int, *, more: bool) -> bytes:
    return struct.pack(">BHI", 0, place | more, ident)


def cut_up(body: bytes, size: int) -> list[tuple[int, bytes, bool]]:
    """Place, octets, and whether more follow, of fragments of `size` octets."""
    return [(at, body[at : at + size], at + size < len(body)) for at in range(0, len(body), size)]


def fragments4(body: bytes, size: int, *, ident: int = 7, **how: object) -> list[bytes]:
    return [ipv4(part, ident=ident, place=at, more=more, **how) for at, part, more in cut_up(body, size)]  # type: ignore[arg-type]


def fragments6(body: bytes, size: int, *, ident: int = 7) -> list[bytes]:
    return [
        ipv6(part, extensions=[(44, fragment_header(ident, at, more=more))]) for at, part, more in cut_up(body, size)
    ]


def ethernet(ip: bytes, *, tags: Sequence[int] = (), ethertype: int = -1, padded: int = 0) -> bytes:
    kind = (0x86DD if ip[0] >> 4 == 6 else 0x0800) if ethertype < 0 else ethertype
    inner = b"".join(struct.pack(">HH", tag, 0x2005) for tag in tags) + struct.pack(">H", kind) + ip
    return (MAC + inner).ljust(padded, b"\xee")


def framed(link: int, ip: bytes) -> bytes:
    """An IP packet in the frame of a link type."""
    six = ip[0] >> 4 == 6
    kind = struct.pack(">H", 0x86DD if six else 0x0800)
    if link == 113:
        return struct.pack(">HHHQ", 0, 1, 6, 0) + kind + ip
    if link == 276:
        return kind + struct.pack(">HIHBBQ", 0, 2, 1, 0, 6, 0) + ip
    if link in (0, 108):
        return struct.pack("<I" if link == 0 else ">I", 30 if six else 2) + ip
    return ethernet(ip) if link == 1 else ip


LINKS = (1, 113, 276, 0, 108, 12, 14, 101, 228, 229)


def pcap_header(link: int = 1, *, order: str = "<", magic: int = 0xA1B2C3D4) -> bytes:
    return struct.pack(order + "IHHiIII", magic, 2, 4, 0, 0, 65_535, link)


def record(packet: Packet, *, order: str = "<", magic: int = 0xA1B2C3D4) -> bytes:
    octets, t_ns, full = packet
    second, rest_ns = divmod(t_ns, 10**9)
    fraction = rest_ns if magic == 0xA1B23C4D else rest_ns // 1000
    more = struct.pack(order + "IHBB", 3, 0x800, 0, 0) if magic == 0xA1B2CD34 else b""
    return struct.pack(order + "4I", second, fraction, len(octets), max(full, len(octets))) + more + octets


def pcap(packets: Iterable[Packet | bytes], link: int = 1, *, order: str = "<", magic: int = 0xA1B2C3D4) -> bytes:
    """A pcap file; packets without a time come a millisecond apart."""
    records = (record(packet, order=order, magic=magic) for packet in timed(packets))
    return pcap_header(link, order=order, magic=magic) + b"".join(records)


def timed(packets: Iterable[Packet | bytes]) -> list[Packet]:
    return [p if isinstance(p, Packet) else Packet(p, T0_NS + i * 10**6) for i, p in enumerate(packets)]


def block(kind: int, body: bytes, *, order: str = "<") -> bytes:
    body += bytes(-len(body) % 4)
    length = struct.pack(order + "I", 12 + len(body))
    return struct.pack(order + "I", kind) + length + body + length


def option(code: int, value: bytes, *, order: str = "<") -> bytes:
    return struct.pack(order + "HH", code, len(value)) + value + bytes(-len(value) % 4)


def section(*, order: str = "<", options: bytes = b"") -> bytes:
    return block(0x0A0D0D0A, struct.pack(order + "IHHq", 0x1A2B3C4D, 1, 0, -1) + options, order=order)


def interface(
    link: int = 1, *, order: str = "<", snaplen: int = 0, resolution: int = -1, offset_s: int | None = None
) -> bytes:
    options = option(2, b"eth0", order=order)
    options += option(9, bytes([resolution]), order=order) if resolution >= 0 else b""
    options += option(14, struct.pack(order + "q", offset_s), order=order) if offset_s is not None else b""
    return block(1, struct.pack(order + "HHI", link, 0, snaplen) + options + option(0, b"", order=order), order=order)


def enhanced(octets: bytes, *, units: int = T0_NS // 1000, number: int = 0, full: int = -1, order: str = "<",
             held: int = -1) -> bytes:  # fmt: skip
    head = struct.pack(
        order + "5I", number, units >> 32, units & 0xFFFFFFFF, len(octets) if held < 0 else held,
        max(full, len(octets)),
    )  # fmt: skip
    return block(6, head + octets, order=order)


def simple(octets: bytes, *, full: int = -1, order: str = "<") -> bytes:
    return block(3, struct.pack(order + "I", max(full, len(octets))) + octets, order=order)


def obsolete(octets: bytes, *, units: int = T0_NS // 1000, number: int = 0, full: int = -1, order: str = "<") -> bytes:
    head = struct.pack(
        order + "HH4I", number, 9, units >> 32, units & 0xFFFFFFFF, len(octets), max(full, len(octets))
    )  # fmt: skip
    return block(2, head + octets, order=order)


def pcapng(packets: Iterable[Packet | bytes], link: int = 1, *, order: str = "<") -> bytes:
    """A pcapng file of one section and interface, in microseconds."""
    blocks = (enhanced(p.octets, units=p.t_ns // 1000, full=p.full, order=order) for p in timed(packets))
    return section(order=order) + interface(link, order=order) + b"".join(blocks)


class Read(NamedTuple):
    """All that a reader delivers."""

    payloads: list[bytes]
    offsets: list[int]
    times: list[int]
    streams: list[tuple[str, str]]  # of each datagram
    damage: list[Damage]
    ends: list[int]

    @property
    def codes(self) -> list[tuple[str, int]]:
        """Codes of damage with how often in all, by name."""
        counts: dict[str, int] = {}
        for one in self.damage:
            counts[one.code] = counts.get(one.code, 0) + one.count
        return sorted(counts.items())


def read(reader: object, data: bytes, cuts: Iterable[int] = (), **how: object) -> Read:
    """What a reader class delivers of a file that is cut into chunks."""
    places = [0, *sorted(cuts), len(data)]
    chunks = [data[a:b] for a, b in pairwise(places)]
    one = reader(chunks, **how)  # type: ignore[operator]
    found = Read([], [], [], [], [], [])
    for d in one.datagrams():
        assert isinstance(d, Datagrams)
        bounds = d.bounds.tolist()
        assert bounds[0] == 0 and bounds[-1] == len(d.data) and type(d.data) is bytes
        found.payloads.extend(d.data[a:b] for a, b in pairwise(bounds))
        found.offsets.extend(d.offset.tolist())
        found.times.extend(d.t_ns.tolist())
        found.streams.extend(tuple(one.streams[i]) for i in d.stream.tolist())
        found.damage.extend(d.damage)
        found.ends.append(d.end)
    assert found.ends == sorted(found.ends) and found.ends[-1] == len(data)
    return found
