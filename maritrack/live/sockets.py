"""UDP sockets for radar video: joined to a multicast group or not, with a large buffer, with the kernel's notes."""

from __future__ import annotations

import errno
import ipaddress
import socket
import struct
import sys
from contextlib import suppress
from typing import NamedTuple

from maritrack.errors import InputError, UsageError

LINUX = sys.platform == "linux"
SO_RCVBUFFORCE, SO_TIMESTAMPNS, SO_MEMINFO = 33, 35, 55  # Linux; the module socket has no names for them
IP_PKTINFO, IP_MULTICAST_ALL = 8, 49
MEMINFO = struct.Struct("@9I")  # the last is the number of dropped datagrams
RECEIVE_BUFFER = 32 << 20  # octets asked of the kernel, which counts 64 KiB of them as about 40 datagrams of 1,400
SEND_BUFFER = 4 << 20
UDP_MOST = {socket.AF_INET: 65_507, socket.AF_INET6: 65_527}  # octets of payload that a datagram can have

Address = ipaddress.IPv4Address | ipaddress.IPv6Address
SocketAddress = tuple[str, int] | tuple[str, int, int, int]


class Interface(NamedTuple):
    """A network interface as it was named: by its address, by its name (with its number), or not at all."""

    address: Address | None = None
    name: str = ""
    number: int = 0


def receiving_socket(*, port: int, group: str = "", interface: str = "") -> socket.socket:
    """A socket bound to a port, and to a multicast group where there is one.

    `interface` is an address or a name. UsageError for what can't be an address, InputError where the system refuses.
    """
    place = _interface(interface)
    joined = _group(group) if group else None
    family = _family(joined or place.address)
    _check(place, family, multicast=joined is not None)
    sock = socket.socket(family, socket.SOCK_DGRAM)
    try:
        _enlarge(sock)
        _ask_for_notes(sock)
        if joined is not None:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # other programs may listen to the group too
            sock.bind(_bound(joined, port, place.number))
            _join(sock, joined, place)
        else:
            _bind_to(sock, place)
            sock.bind((str(place.address) if place.address else "", port))
    except OSError as error:
        sock.close()
        raise refused(endpoint(group or str(place.address or "port"), port), error) from None
    return sock


def sending_socket(to: str, *, interface: str = "", ttl: int | None = None) -> tuple[socket.socket, SocketAddress]:
    """A socket to send from and the address of "HOST:PORT" ("[ADDRESS]:PORT" for IPv6)."""
    place = _interface(interface)
    family, address = resolved(to)
    multicast = ipaddress.ip_address(address[0].partition("%")[0]).is_multicast
    _check(place, family, multicast=multicast)
    sock = socket.socket(family, socket.SOCK_DGRAM)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        _limit_hops(sock, ttl, multicast=multicast)
        if not multicast:
            _bind_to(sock, place)
        elif interface:
            _send_through(sock, place)
        if place.address and not multicast:
            sock.bind((str(place.address), 0))
    except OSError as error:
        sock.close()
        raise refused(to, error) from None
    return sock, address


def resolved(to: str) -> tuple[socket.AddressFamily, SocketAddress]:
    """Family and address of "HOST:PORT". UsageError where it is none."""
    host, _, port = to.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65_536:
        raise UsageError(f"'{to}': write HOST:PORT, as in 239.0.1.2:8600 or [ff02::1]:8600")
    try:
        found = socket.getaddrinfo(host.removeprefix("[").removesuffix("]"), int(port), type=socket.SOCK_DGRAM)
    except (OSError, UnicodeError) as error:
        raise UsageError(f"'{to}': {getattr(error, 'strerror', None) or error}") from None
    family, _, _, _, address = min(found, key=lambda one: one[0] != socket.AF_INET)  # as receivers listen
    return family, address  # type: ignore[return-value]


def endpoint(address: str, port: int) -> str:
    """An address and a port as people write them."""
    return f"[{address}]:{port}" if ":" in address else f"{address}:{port}"


def granted_octets(sock: socket.socket) -> int:
    """The receive buffer that the kernel gave."""
    return sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)


def dropped(sock: socket.socket) -> int | None:
    """Datagrams that the kernel dropped at this socket so far; None where it doesn't tell."""
    if not LINUX:
        return None
    try:
        told: int = MEMINFO.unpack(sock.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, MEMINFO.size))[-1]
    except (OSError, struct.error):  # before Linux 4.12
        return None
    return told


def interfaces() -> str:
    """The names of this machine's interfaces, for messages."""
    return ", ".join(name for _, name in socket.if_nameindex())


def _interface(text: str) -> Interface:
    if not text:
        return Interface()
    try:
        return Interface(address=ipaddress.ip_address(text))
    except ValueError:
        pass
    try:
        return Interface(name=text, number=socket.if_nametoindex(text))
    except (OSError, ValueError):
        raise UsageError(
            f"interface '{text}': neither an address nor an interface", hint=f"there are {interfaces()}"
        ) from None


def _group(text: str) -> Address:
    try:
        group = ipaddress.ip_address(text)
    except ValueError:
        raise UsageError(f"group '{text}': not an address", hint="as in 239.0.1.2 or ff02::1") from None
    if not group.is_multicast:
        raise UsageError(f"group {text}: not a multicast address", hint="leave --group away for unicast")
    return group


def _family(address: Address | None) -> socket.AddressFamily:
    return socket.AF_INET6 if address is not None and address.version == 6 else socket.AF_INET


def _check(place: Interface, family: socket.AddressFamily, *, multicast: bool) -> None:
    """UsageError where the interface isn't named as this family of addresses has it."""
    if place.address is not None and (_family(place.address) != family or (multicast and family == socket.AF_INET6)):
        raise UsageError(
            f"interface {place.address}: name it, or give its address of the same family",
            hint=f"there are {interfaces()}",
        )
    if place.name and not LINUX and (not multicast or family == socket.AF_INET):
        raise UsageError(f"interface '{place.name}': here it takes its address")


def _enlarge(sock: socket.socket) -> None:
    """A receive buffer as large as wanted where that is permitted, else as large as anyone may have."""
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
    if LINUX:
        with suppress(OSError):
            sock.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, RECEIVE_BUFFER)


def _ask_for_notes(sock: socket.socket) -> None:
    """Let the kernel say when each datagram came, and what it was addressed to."""
    if not LINUX:
        return
    sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    if sock.family == socket.AF_INET6:
        sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_RECVPKTINFO, 1)
    else:
        sock.setsockopt(socket.IPPROTO_IP, IP_PKTINFO, 1)
        sock.setsockopt(socket.IPPROTO_IP, IP_MULTICAST_ALL, 0)  # not the groups that other programs joined


def _bound(group: Address, port: int, number: int) -> SocketAddress:
    """Bound to the group nothing else comes; Windows wants its own address."""
    host = "" if sys.platform == "win32" else str(group)
    return (host, port, 0, number) if group.version == 6 else (host, port)


def _join(sock: socket.socket, group: Address, place: Interface) -> None:
    if group.version == 6:
        wish = group.packed + struct.pack("@I", place.number)
        sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_JOIN_GROUP, wish)
    else:
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group.packed + _place4(place))


def _place4(place: Interface) -> bytes:
    """The interface as IPv4 options want it: address and number, other systems than Linux the address alone."""
    address = place.address.packed if place.address is not None else bytes(4)
    return address + struct.pack("@i", place.number) if LINUX else address


def _bind_to(sock: socket.socket, place: Interface) -> None:
    """Only what goes through an interface that was named."""
    if place.name:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, place.name.encode())


def _send_through(sock: socket.socket, place: Interface) -> None:
    if sock.family == socket.AF_INET6:
        sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_MULTICAST_IF, place.number)
    else:
        head = bytes(4) if LINUX else b""  # where Linux has the group when joining
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, head + _place4(place))


def _limit_hops(sock: socket.socket, ttl: int | None, *, multicast: bool) -> None:
    if ttl is None:
        return
    if sock.family == socket.AF_INET6:
        option = socket.IPV6_MULTICAST_HOPS if multicast else socket.IPV6_UNICAST_HOPS
        sock.setsockopt(socket.IPPROTO_IPV6, option, ttl)
    else:
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL if multicast else socket.IP_TTL, ttl)


HINTS = {
    errno.EADDRINUSE: "another program listens on this port",
    errno.EACCES: "ports below 1024 and some interfaces need privileges",
    errno.EADDRNOTAVAIL: "--interface takes an address of this machine",
    errno.ENODEV: "name the interface with --interface",
    errno.ENETUNREACH: "no way there: name the interface with --interface",
}


def refused(where: str, error: OSError) -> InputError:
    """An error of the network in the words of this program."""
    reason = error.strerror or str(error)
    return InputError(f"{where}: {reason[:1].lower()}{reason[1:]}", hint=HINTS.get(error.errno or 0, ""))
