"""Write datagrams as a pcap capture: nanoseconds, little-endian, Ethernet, IPv4 or IPv6, UDP with correct checksums."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv6Address, ip_address
from typing import BinaryIO

from maritrack.io.datagrams import NO_TIME, Stream

MAGIC_NS = 0xA1B2_3C4D
SNAPLEN, ETHERNET = 262_144, 1
LARGEST = 65_507  # octets of a payload
TTL, UDP = 64, 17
DONT_FRAGMENT = 0x4000
PORT = 8600
FILE_HEAD = struct.Struct("<IHHiIII")
PACKET_HEAD = struct.Struct("<IIII")
V4 = struct.Struct(">14s2BHHHBBH4s4sHHHH")
V6 = struct.Struct(">14sIHBB16s16sHHHH")
NS = 10**9

Address = IPv4Address | IPv6Address


class PcapWriter:
    """Writes a capture to an open file, each datagram as one unfragmented packet.

    Stream("192.0.2.1:8600", "239.0.1.2:8600") gives the addresses, "[address]:port" those of IPv6. What isn't such
    an address becomes 239.0.1.2:8600 as destination and 192.0.2.1:8600 as source, and for further streams without
    addresses 192.0.2.2:8600 and so on, so that they stay apart (IPv6: ff0e::240 and 2001:db8::1).

    A pcap packet always has a time: a datagram with NO_TIME gets that of the one before, the first ones get 0.
    Doesn't fit: a payload of more than 65,507 octets, a time before 1970 or after 2106.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._routes: dict[Stream, _Route] = {}
        self._nameless = 0  # streams whose source is no address
        self._last_ns = 0
        file.write(FILE_HEAD.pack(MAGIC_NS, 2, 4, 0, 0, SNAPLEN, ETHERNET))

    def write(self, payload: bytes, *, t_ns: int, stream: Stream) -> bool:
        if t_ns == NO_TIME:
            t_ns = self._last_ns
        seconds, nanoseconds = divmod(t_ns, NS)
        if len(payload) > LARGEST or not 0 <= seconds < 1 << 32:
            return False
        route = self._routes.get(stream) or self._route(stream)
        head = _packet_head(route, payload)
        size = len(head) + len(payload)
        self._file.write(PACKET_HEAD.pack(seconds, nanoseconds, size, size) + head + payload)
        self._last_ns = t_ns
        return True

    def flush(self) -> None:
        self._file.flush()

    def finish(self) -> None:
        """Nothing: a capture ends where the file does."""

    def _route(self, stream: Stream) -> _Route:
        source, destination = _endpoint(stream.source), _endpoint(stream.destination)
        if source is None:
            source = self._made_up(six=destination is not None and destination[0].version == 6)
        if destination is None or destination[0].version != source[0].version:
            destination = (ip_address("239.0.1.2" if source[0].version == 4 else "ff0e::240"), PORT)
        route = _route(source, destination)
        self._routes[stream] = route
        return route

    def _made_up(self, *, six: bool) -> tuple[Address, int]:
        """A source for a stream that has none: 254 addresses, then another port."""
        port, i = divmod(self._nameless, 254)
        self._nameless += 1
        base = int(ip_address("2001:db8::1" if six else "192.0.2.1"))
        return (IPv6Address(base + i) if six else IPv4Address(base + i)), (PORT + port) % 65_536


@dataclass(frozen=True, slots=True)
class _Route:
    """What all packets of a stream share."""

    ethernet: bytes
    source: bytes
    destination: bytes
    ports: tuple[int, int]
    ip_sum: int  # of the fixed fields of the IPv4 header
    udp_sum: int  # of addresses, protocol and ports


def _route(source: tuple[Address, int], destination: tuple[Address, int]) -> _Route:
    addresses = source[0].packed, destination[0].packed
    kind = 0x0800 if source[0].version == 4 else 0x86DD
    ends = int.from_bytes(addresses[0] + addresses[1], "big") % 0xFFFF
    return _Route(
        _mac(destination[0]) + _mac(source[0]) + kind.to_bytes(2, "big"), *addresses, (source[1], destination[1]),
        ip_sum=0x4500 + DONT_FRAGMENT + (TTL << 8 | UDP) + ends, udp_sum=ends + UDP + source[1] + destination[1],
    )  # fmt: skip


def _packet_head(route: _Route, payload: bytes) -> bytes:
    """Ethernet, IP and UDP headers.

    The checksum is a sum in ones' complement, that is modulo 65535, and 2^16 is 1 modulo 65535: so the payload can
    be taken as one large number.
    """
    length = 8 + len(payload)
    number = int.from_bytes(payload, "big") << 8 * (length & 1)
    udp_sum = 0xFFFF - (route.udp_sum + 2 * length + number) % 0xFFFF  # never 0, which would mean that there is none
    if len(route.source) == 4:
        ip_sum = -(route.ip_sum + 20 + length) % 0xFFFF
        return V4.pack(
            route.ethernet, 0x45, 0, 20 + length, 0, DONT_FRAGMENT, TTL, UDP, ip_sum, route.source, route.destination,
            *route.ports, length, udp_sum,
        )  # fmt: skip
    return V6.pack(
        route.ethernet, 6 << 28, length, UDP, TTL, route.source, route.destination, *route.ports, length, udp_sum
    )


def _endpoint(text: str) -> tuple[Address, int] | None:
    """Address and port of "address:port" or "[address]:port"; None where it isn't that."""
    host, colon, port = text.rpartition(":")
    if not colon or not (port.isascii() and port.isdecimal()) or len(port) > 5 or int(port) > 0xFFFF:
        return None
    try:
        six = host.startswith("[") and host.endswith("]")
        return (IPv6Address(host[1:-1]) if six else IPv4Address(host)), int(port)
    except ValueError:
        return None


def _mac(address: Address) -> bytes:
    """The Ethernet address of a group as the standards have it, of a host a made-up local one."""
    low = address.packed[-4:]
    if isinstance(address, IPv6Address):
        return (b"\x33\x33" if address.is_multicast else b"\x02\x06") + low
    return b"\x01\x00\x5e" + bytes((low[1] & 0x7F,)) + low[2:] if address.is_multicast else b"\x02\x04" + low
