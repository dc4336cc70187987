"""Captures that are made to cost a reader as much as they can, each of a size in octets."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable, Iterator
from itertools import count, cycle

from tests.io.pcap_build import (
    Packet,
    block,
    enhanced,
    ethernet,
    extension,
    fragments4,
    interface,
    ipv4,
    ipv6,
    option,
    pcap_header,
    record,
    section,
    udp,
)

T0 = 1_700_000_000
ONE = ethernet(ipv4(udp(b"one")))


def _filled(size: int, units: Iterator[bytes], head: bytes = b"") -> bytes:
    made = bytearray(head or pcap_header())
    while len(made) < size:
        made += next(units)
    return bytes(made)


def _packets(size: int, make: Callable[[int], bytes], *, full: int = -1) -> bytes:
    """Packets that differ."""
    return _filled(size, (record(Packet(make(i), (T0 * 10**6 + i) * 1000, full)) for i in count()))


def _head(second: int, fraction: int, length: int, full: int) -> bytes:
    return struct.pack("<4I", second, fraction, length, full)


def _fragment(i: int, place: int, octets: bytes = bytes(8), *, ident: int = -1) -> bytes:
    source = struct.pack(">I", i >> 16 if ident < 0 else 1)
    ip = ipv4(octets, ident=i & 0xFFFF if ident < 0 else ident, place=place, more=True, addresses=(source, source))
    return ethernet(ip)


def _overlapping(size: int) -> bytes:
    """Fragments of one datagram with holes, then cut ones that claim all of it, each with another hole filled."""
    holes = [record(Packet(_fragment(0, at, ident=1))) for at in range(16, 65_000, 16)]
    wide = ethernet(ipv4(bytes(65_000), ident=1, place=8, more=True, addresses=(b"\0\0\0\1",) * 2))
    cut = [record(Packet(wide[:end], full=len(wide))) for end in range(42, 66, 8)]
    return _filled(size, cycle([*holes, *cut * 40]))


def _blocks(size: int, *units: bytes) -> bytes:
    return _filled(size, cycle(units), section() + interface())


def _sizes(i: int) -> bytes:
    return bytes(i % 9 == 0)


_LIE = _head(T0, 0, 1 << 30, 1 << 30)
_EMPTY = [_head(T0, i, 0, 1) for i in range(8)]
_LOW = random.Random(1).choices(range(40), k=1 << 16)
_BE_SECTION = section(order=">")
_CUT_OPTIONS = block(1, struct.pack("<HHI", 1, 0, 0) + option(2, b"") * 200_000)

KINDS: dict[str, Callable[[int], bytes]] = {
    "empty packets": lambda n: _filled(n, (_head(T0, i % 10**6, 0, 0) for i in count())),
    "zeros": lambda n: pcap_header() + bytes(n),
    "ones": lambda n: pcap_header() + b"\xff" * n,
    "random octets": lambda n: pcap_header() + random.Random(0).randbytes(n),
    "small numbers": lambda n: pcap_header() + struct.pack(f"<{1 << 16}I", *_LOW) * max(1, n >> 18),
    "small octets": lambda n: pcap_header() + bytes(_LOW) * max(1, n >> 16),
    "a break after every fourth packet": lambda n: _filled(n, cycle([*_EMPTY[:4], _LIE])),
    "a break after every packet": lambda n: _filled(n, cycle([_EMPTY[0], b"\xff" * 16])),
    "chains that are too short": lambda n: _filled(n, cycle([_head(3 * T0 // 2, i, 0, 1) for i in range(7)] + [_LIE])),
    "lengths that swallow others": lambda n: _filled(n, cycle([_head(T0, 0, 50, 50), *_EMPTY[:5]])),
    "lengths of 256 KiB": lambda n: _filled(n, cycle([_head(T0, 0, 262_144, 262_144), bytes(77)])),
    "two clocks": lambda n: _filled(n, cycle([_EMPTY[0], _head(1, 0, 0, 1)])),
    "a clock that jumps": lambda n: _filled(n, (_head(i * 10**8 % 2**31, 0, 0, 1) for i in count(1))),
    "nine sizes": lambda n: _packets(n, _sizes),
    "file headers": lambda n: _filled(n, cycle([pcap_header()])),
    "file headers and packets": lambda n: _filled(n, cycle([pcap_header(101, order=">"), _head(0, 1, 0, 1)])),
    "headers that contradict themselves": lambda n: _filled(n, cycle([_head(T0, 2**31, 1, 0) + b"x"])),
    "late years": lambda n: _filled(n, cycle([_head(0xA1B2C3D4, 1, 0, 1)])),
    "fragments that are never complete": lambda n: _packets(n, lambda i: _fragment(i, 8)),
    "first fragments alone": lambda n: _packets(n, lambda i: _fragment(i, 0)),
    "fragments far from the beginning": lambda n: _packets(n, lambda i: _fragment(i, 65_000)),
    "fragments of one datagram, backwards": lambda n: _packets(n, lambda i: _fragment(i, -8 * i % 65_000, ident=1)),
    "the same fragment": lambda n: _packets(n, lambda i: _fragment(i, 800, ident=1)),
    "first fragments of one identification": lambda n: _packets(
        n, lambda i: _fragment(i, 0, struct.pack("<Q", i), ident=1)
    ),
    "overlapping fragments": _overlapping,
    "IPv6 fragments": lambda n: _packets(
        n, lambda i: ethernet(ipv6(bytes(8), extensions=[(44, struct.pack(">BHI", 0, 9, i))]))
    ),
    "whole datagrams in fragments": lambda n: _packets(
        n, lambda i: ethernet(fragments4(udp(bytes(16)), 8, ident=i // 3)[i % 3])
    ),
    "the same with another last": lambda n: _packets(
        n, lambda i: ethernet(fragments4(udp(bytes(16), length=9 + i % 4), 8, ident=i // 3)[i % 3])
    ),
    "VLAN tags": lambda n: _packets(n, lambda _: ethernet(bytes(1), tags=[0x8100] * 12)),
    "many VLAN tags": lambda n: _packets(n, lambda _: ethernet(bytes(1), tags=[0x8100] * 10_000)),
    "lengths of headers that lie": lambda n: _packets(
        n, lambda i: ethernet(bytes([0x40 | i % 16]) + ipv4(udp(b""))[1:])
    ),
    "extension headers": lambda n: _packets(n, lambda _: ethernet(ipv6(b"", extensions=[(60, extension())] * 12))),
    "streams": lambda n: _packets(
        n, lambda i: ethernet(ipv4(udp(b""), addresses=(struct.pack(">I", i),) * 2))
    ),
    "two streams": lambda n: _packets(n, lambda i: ethernet(ipv4(udp(b"", ports=(i % 2, 1))))),
    "cut packets": lambda n: _packets(n, lambda i: ONE[: i % 45], full=99),
    "empty blocks": lambda n: _blocks(n, block(77, b"")),
    "interfaces": lambda n: _blocks(n, interface()),
    "interfaces and packets": lambda n: _blocks(n, block(1, bytes(8)), block(3, bytes(4))),
    "sections": lambda n: _blocks(n, section(), _BE_SECTION),
    "sections with packets": lambda n: _blocks(
        n, section() + block(3, bytes(4)), _BE_SECTION + block(6, bytes(20), order=">")
    ),
    "options": lambda n: _blocks(n, _CUT_OPTIONS),
    "odd resolutions": lambda n: _blocks(
        n, interface(resolution=255), *[enhanced(b"", units=2**64 - 1, number=1)] * 999
    ),
    "a resolution for each packet": lambda n: _filled(
        n, (interface(resolution=i % 256) + enhanced(b"", number=i) for i in count()), section()
    ),
    "packets of no interface": lambda n: _blocks(n, enhanced(b"", number=7)),
    "broken blocks": lambda n: _blocks(n, b"\xff\xff\xff\xff", block(4, b"")),
    "packets after broken blocks": lambda n: _blocks(n, b"\xff\xff\xff\xff", enhanced(b"")),
    "blocks of 4 MiB": lambda n: _blocks(n, struct.pack("<II", 6, 4 << 20)),
    "blocks of 1 MiB": lambda n: _blocks(n, struct.pack("<II", 6, 1 << 20), bytes(5)),
    "blocks without an end": lambda n: _blocks(n, struct.pack("<II", 6, 64)),
    "types of blocks": lambda n: _blocks(n, b"\6\0\0\0"),
    "beginnings of sections": lambda n: _blocks(n, b"\n\r\r\n\x1c\0\0\0\x4d\x3c\x2b\x1a"),
    "zeros in blocks": lambda n: section() + interface() + bytes(n),
    "random octets in blocks": lambda n: section() + random.Random(0).randbytes(n),
}  # fmt: skip
