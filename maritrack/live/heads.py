"""What the first CAT240 record of a datagram says of its sensor, its direction and its time, and no more."""

from __future__ import annotations

from typing import NamedTuple

from maritrack.io.cat240.framing import CAT240, HEADER
from maritrack.io.containers.select import BLOCKS_LOOKED_AT, holds_cat240

# Bit of FSPEC, octets, and octets for each repetition where the item begins with their number.
BEFORE_TIME = (
    (0x8000, 2, 0), (0x4000, 1, 0), (0x2000, 4, 0), (0x1000, 1, 1), (0x0800, 12, 0), (0x0400, 12, 0), (0x0200, 2, 0),
    (0x0080, 5, 0), (0x0040, 1, 4), (0x0020, 1, 64), (0x0010, 1, 256),
)  # fmt: skip
AZIMUTH_BITS, TIME_BIT, MORE = 0x0C00, 0x0008, 0x0100


class Head(NamedTuple):
    """The beginning of a record; -1 where it isn't told."""

    sensor: int  # SAC << 8 | SIC
    azimuth: int  # START_AZ
    tod: int  # 1/128 s


NO_HEAD = Head(-1, -1, -1)


def sensor_name(sensor: int) -> str:
    """SAC-SIC as the rest of the program writes it."""
    return f"{sensor >> 8}-{sensor & 0xFF}"


def read_head(data: bytes, begin: int, end: int) -> Head:
    """The head of the first CAT240 record of the datagram at `begin`; NO_HEAD where it has none."""
    if not holds_cat240(data, begin, end):
        return NO_HEAD
    at = begin
    for _ in range(BLOCKS_LOOKED_AT):
        if data[at] == CAT240:
            break
        at += data[at + 1] << 8 | data[at + 2]
    at += HEADER
    fspec = data[at] << 8
    at += 1
    if fspec & MORE:
        fspec |= data[at]
        at += 1
    sensor, azimuth = data[at] << 8 | data[at + 1], -1
    for bit, octets, each in BEFORE_TIME:
        if fspec & bit and at + octets <= end:
            if bit & AZIMUTH_BITS and azimuth < 0:
                azimuth = data[at] << 8 | data[at + 1]
            at += octets + each * data[at]
    known = fspec & TIME_BIT and at + 3 <= end
    return Head(sensor, azimuth, int.from_bytes(data[at : at + 3], "big") if known else -1)
