"""What UDP a series of packets holds, found out one packet and one octet at a time: slow, and plain."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from ipaddress import ip_address

TAGS = (0x8100, 0x88A8, 0x9100, 0x9200, 0x9300)
FAMILIES = {2: 4, 10: 6, 23: 6, 24: 6, 28: 6, 30: 6}


@dataclass
class Waiting:
    first: int  # packet
    again: bool
    octets: dict[int, int] = field(default_factory=dict)
    claimed: set[int] = field(default_factory=set)  # places that fragments cover, captured or not
    total: int | None = None
    packets: int = 0


@dataclass
class Oracle:
    """Datagrams in the order of their completion: payload, source, destination, packet that ended it."""

    found: list[tuple[bytes, str, str, int]] = field(default_factory=list)
    waiting: dict[tuple[bytes, bytes, int], Waiting] = field(default_factory=dict)
    done: list[tuple[bytes, bytes, int]] = field(default_factory=list)

    def deliver(self, addresses: tuple[bytes, bytes], body: bytes, total: int, packet: int, least: int = 0) -> None:
        """`body` is what there is of a UDP datagram of `total` octets."""
        if len(body) < 8 + least:
            return
        length = int.from_bytes(body[4:6], "big")
        if not 8 <= length <= total:
            length = total
        ends = []
        for address, port in zip(addresses, (body[0:2], body[2:4]), strict=True):
            text = str(ip_address(address))
            ends.append(f"{text if len(address) == 4 else f'[{text}]'}:{int.from_bytes(port, 'big')}")
        self.found.append((body[8:length], ends[0], ends[1], packet))

    def packet(self, number: int, link: int, octets: bytes, full: int) -> None:
        ip = network(link, octets)
        if ip is None or link_says(link, octets) < 0:
            return
        left = full - (len(octets) - len(ip))
        if len(ip) >= 20 and ip[0] >> 4 == 4 and link_says(link, octets) != 6:
            self.ipv4(number, ip, left)
        elif len(ip) >= 40 and ip[0] >> 4 == 6 and link_says(link, octets) != 4:
            self.ipv6(number, ip, left)

    def ipv4(self, number: int, ip: bytes, left: int) -> None:
        head, total = (ip[0] & 15) * 4, int.from_bytes(ip[2:4], "big") or left
        if head < 20 or head > len(ip) or total < head or ip[9] != 17:
            return
        flags = int.from_bytes(ip[6:8], "big")
        addresses = ip[12:16], ip[16:20]
        self.body(number, addresses, ip[head:total], total - head, flags % 8192 * 8, bool(flags & 0x2000),
                  int.from_bytes(ip[4:6], "big"))  # fmt: skip

    def ipv6(self, number: int, ip: bytes, left: int) -> None:
        size = int.from_bytes(ip[4:6], "big")
        total = 40 + size if size else left
        kind, at, place, more, ident = ip[6], 40, 0, False, 0
        for _ in range(8):
            if kind not in (0, 43, 44, 51, 60, 135, 139, 140):
                break
            if at + 8 > len(ip):
                return
            if kind == 44:
                flags = int.from_bytes(ip[at + 2 : at + 4], "big")
                place, more, ident = flags & 0xFFF8, bool(flags & 1), int.from_bytes(ip[at + 4 : at + 8], "big")
                kind, at = ip[at], at + 8
                if place or more:
                    break
            else:
                length = (ip[at + 1] + 2) * 4 if kind == 51 else (ip[at + 1] + 1) * 8
                kind, at = ip[at], at + length
        if kind == 17:
            addresses = ip[8:24], ip[24:40]
            self.body(number, addresses, ip[at:total] if total > at else b"", total - at, place, more, ident)

    def body(self, number: int, addresses: tuple[bytes, bytes], octets: bytes, length: int, place: int, more: bool,
             ident: int) -> None:  # fmt: skip
        if place == 0 and not more:
            if length >= 8:
                self.deliver(addresses, octets, length, number)
            return
        if length <= 0 or place + length > 65_535 or (more and length % 8):
            return
        self.fragment((*addresses, ident), number, octets, length, place, more)

    def fragment(self, key: tuple[bytes, bytes, int], number: int, octets: bytes, length: int, place: int,
                 more: bool) -> None:  # fmt: skip
        one = self.waiting.get(key)
        if one and place == 0 and all(i in one.octets for i in range(8)):
            before = bytes(one.octets[i] for i in range(8))
            if before != octets[:8]:
                self.end(key, number)
                one = None
        if one is None:
            one = self.waiting[key] = Waiting(number, key in self.done[-64:])
        one.packets += 1
        end = place + length
        if one.total is not None:
            end = min(end, one.total)
        elif not more and max(one.claimed, default=-1) < end:
            one.total = end
        if end != one.total:
            end -= end % 8
        taken = {i // 8 for i in one.claimed}
        for i in range(place, end):
            if i // 8 not in taken:
                one.claimed.add(i)
                if i - place < len(octets):
                    one.octets[i] = octets[i - place]
        if one.total is not None and {i // 8 for i in one.claimed} == {i // 8 for i in range(one.total)}:
            del self.waiting[key]
            self.done = [*(old for old in self.done if old != key), key]
            self.deliver(key[:2], self.contiguous(one), one.total, number)

    def contiguous(self, one: Waiting) -> bytes:
        octets = bytearray()
        while len(octets) in one.octets:
            octets.append(one.octets[len(octets)])
        return bytes(octets)

    def end(self, key: tuple[bytes, bytes, int], number: int) -> None:
        one = self.waiting.pop(key)
        if not one.again:
            body = self.contiguous(one)
            self.deliver(key[:2], body, one.total if one.total is not None else 65_535, number, least=1)

    def close(self, number: int) -> None:
        for key in list(self.waiting):
            self.end(key, number)


def network(link: int, octets: bytes) -> bytes | None:
    """From the IP header on; None where there is none."""
    if link in (12, 14, 101, 228, 229):
        return octets
    if link in (0, 108):
        return octets[4:] if len(octets) >= 4 else None
    at, kind = {1: (14, 12), 113: (16, 14), 276: (20, 0)}[link]
    for _ in range(9):
        ethertype = int.from_bytes(octets[kind : kind + 2], "big")
        if len(octets) < at or ethertype not in TAGS:
            break
        kind, at = at + 2, at + 4
    return octets[at:] if len(octets) >= at and ethertype in (0x0800, 0x86DD) else None


def link_says(link: int, octets: bytes) -> int:
    """Version of IP that the frame speaks of, 0 = none."""
    if link in (12, 14, 101, 228, 229):
        return 0
    if link in (0, 108):
        for order in ("little", "big"):
            family = int.from_bytes(octets[:4], order)  # type: ignore[arg-type]
            if family in FAMILIES:
                return FAMILIES[family]
        return -1
    at, kind = {1: (14, 12), 113: (16, 14), 276: (20, 0)}[link]
    ethertype = octets[kind : kind + 2]
    while int.from_bytes(ethertype, "big") in TAGS:
        ethertype, at = octets[at + 2 : at + 4], at + 4
    return 4 if ethertype == b"\x08\0" else 6


def oracle(packets: Iterable[tuple[int, bytes, int]]) -> list[tuple[bytes, str, str, int]]:
    """The datagrams of packets (link type, octets, octets on the wire)."""
    one, n = Oracle(), 0
    for n, (link, octets, full) in enumerate(packets, 1):
        one.packet(n - 1, link, octets, max(full, len(octets)))
    one.close(n)
    return one.found
