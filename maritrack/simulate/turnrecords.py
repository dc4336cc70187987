"""A turn of a simulated radar as the octets of CAT240 records, one a spoke."""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray

from maritrack.geo import C_MPS, TWO_PI
from maritrack.io.cat240.encode import VIDEO_ITEMS, encode_video, smallest_item
from maritrack.simulate.antenna import RadarSettings
from maritrack.simulate.vessels import Course
from maritrack.types import IntArray

DAY_TICKS = 86400 * 128  # of the time of day
LEVEL = 6  # of deflate
IDX_AT, AZIMUTH_AT, COUNT_AT, BODY_AT = 8, 12, 26, 32  # in a block of one record with items 010, 000, 020, 041, ...


def encode_turn(
    radar: RadarSettings, video: NDArray[np.uint8], k: int, *, start_s: float, bow: Course | None = None
) -> bytes:
    """The records of turn k: femto header, zlib, time of day rounded to 1/128 s, MSG_INDEX from 0.

    Azimuths count from North, or from the bow of the vessel whose course is given. Records of one length have one
    layout: they are one record, filled in for all at once.
    """
    turned = np.arange(radar.spokes + 1.0) / radar.spokes
    if bow is not None:
        turned -= bow.at(radar.turn_s * (k + turned)).heading_rad / TWO_PI
    borders = np.rint(65536.0 * turned).astype(int) % 65536
    ticks = np.rint((start_s % 86400.0 + radar.times_s(k)) * 128.0).astype(int) % DAY_TICKS
    idx = (k * radar.spokes + np.arange(radar.spokes)) % 2**32
    cell_fs = round(2.0 * radar.cell_m / C_MPS * 1e15)

    def record(j: int) -> bytes:
        return encode_video(
            sac=radar.sac,
            sic=radar.sic,
            idx=int(idx[j]),
            start_az=int(borders[j]),
            end_az=int(borders[j + 1]),
            start_rg=radar.first_cell,
            cell_dur=cell_fs,
            cells=video[j],
            compress=True,
            tod=int(ticks[j]),
        )

    bodies = _compressed(video)
    size = np.array([_padded_octets(body) for body in bodies])
    records: dict[int, bytes] = {}
    for octets_in in np.unique(size).tolist():
        alike = np.flatnonzero(size == octets_in)
        rows = np.repeat(np.frombuffer(record(int(alike[0])), dtype=np.uint8)[None], len(alike), axis=0)
        rows[:, IDX_AT : IDX_AT + 4] = _big_endian(idx[alike], 4)
        rows[:, AZIMUTH_AT : AZIMUTH_AT + 2] = _big_endian(borders[alike], 2)
        rows[:, AZIMUTH_AT + 2 : AZIMUTH_AT + 4] = _big_endian(borders[alike + 1], 2)
        rows[:, COUNT_AT : COUNT_AT + 2] = _big_endian(np.array([len(bodies[j]) for j in alike]), 2)
        cells = b"".join(bodies[j].ljust(octets_in, b"\0") for j in alike)
        rows[:, BODY_AT : BODY_AT + octets_in] = np.frombuffer(cells, np.uint8).reshape(len(alike), octets_in)
        rows[:, -3:] = _big_endian(ticks[alike], 3)
        octets, length = rows.tobytes(), rows.shape[1]
        records |= {int(j): octets[i * length : (i + 1) * length] for i, j in enumerate(alike)}
    return b"".join(records[j] for j in range(radar.spokes))


def _compressed(video: NDArray[np.uint8]) -> list[bytes]:
    """The cells of each spoke, deflated as `encode_video` does; spokes without echo are all the same."""
    nothing = zlib.compress(bytes(video.shape[1]), LEVEL)
    heard = np.asarray(video.any(axis=1)).tolist()
    return [zlib.compress(row.tobytes(), LEVEL) if any_ else nothing for row, any_ in zip(video, heard, strict=True)]


def _padded_octets(body: bytes) -> int:
    """Octets of the item that holds so many."""
    unit = VIDEO_ITEMS[smallest_item(len(body))].octets
    return -(-len(body) // unit) * unit


def _big_endian(values: IntArray, octets: int) -> NDArray[np.uint8]:
    """Integers (n,) as octets (n, octets)."""
    return np.ascontiguousarray(values, dtype=">u4").view(np.uint8).reshape(-1, 4)[:, 4 - octets :]
