"""CAT240 data blocks put together item by item, right or wrong, and what readers make of them."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from maritrack.io.cat240.radials import Batch, Radials
from maritrack.io.cat240.reader import read_batches

ORDER = ("010", "000", "020", "030", "040", "041", "048", "", "049", "050", "051", "052", "140", "RE", "SP")
SIZES = {"050": 4, "051": 64, "052": 256}
COLUMNS = (
    "offset", "sac", "sic", "idx", "start_az", "end_az", "start_rg", "cell_dur", "femto", "cell_m", "compressed",
    "tod", "n_cells",
)  # fmt: skip


def record(items: dict[str, bytes]) -> bytes:
    """One record of these items (name -> octets), with the FSPEC that they need."""
    bits = [name in items for name in ORDER]
    bits[7] = any(bits[8:])
    octets = np.packbits(np.array([*bits, False], dtype=np.uint8)).tobytes()
    return octets[: 1 + bits[7]] + b"".join(items[name] for name in ORDER if name in items)


def block(*records: bytes, length: int | None = None) -> bytes:
    """A data block, with a LEN that may lie."""
    body = b"".join(records)
    return struct.pack(">BH", 240, len(body) + 3 if length is None else length) + body


def video_items(
    idx: int = 1,
    *,
    cells: bytes = bytes(range(16)),
    nbvb: int | None = None,
    nbcells: int | None = None,
    res: int = 4,
    compressed: bool = False,
    azimuth: tuple[int, int] = (0, 16),
    tod: int | None = 500,
    video: str = "050",
    sac_sic: tuple[int, int] = (1, 2),
) -> dict[str, bytes]:
    """Items of a video record: `cells` are the octets of the block as sent."""
    rep = -(-len(cells) // SIZES[video])
    nbvb = len(cells) if nbvb is None else nbvb
    items = {
        "010": bytes(sac_sic), "000": b"\2", "020": struct.pack(">I", idx),
        "041": struct.pack(">HHII", *azimuth, 0, 66_712_819), "048": bytes((0x80 * compressed, res)),
        "049": struct.pack(">HI", nbvb, len(cells) if nbcells is None else nbcells)[:2]
        + struct.pack(">I", len(cells) if nbcells is None else nbcells)[1:],
        video: bytes((rep,)) + cells.ljust(rep * SIZES[video], b"\0"),
    }  # fmt: skip
    return items if tod is None else {**items, "140": tod.to_bytes(3, "big")}


def video(idx: int = 1, *, without: Sequence[str] = (), items: dict[str, bytes] | None = None, **how: Any) -> bytes:
    """A video record with items left out or put in."""
    whole = {**video_items(idx, **how), **(items or {})}
    return record({name: octets for name, octets in whole.items() if name not in without})


def packed_video(idx: int, cells: bytes, *, nbcells: int | None = None, **how: Any) -> bytes:
    """A video record with zlib-compressed cells, in the item that holds them."""
    stream = zlib.compress(cells)
    kind = next(name for name, most in (("050", 1020), ("051", 16_320), ("052", 65_024)) if len(stream) <= most)
    many = len(cells) if nbcells is None else nbcells
    return video(idx, cells=stream, nbcells=many, compressed=True, video=kind, **how)


SENTINEL = block(video(999, cells=bytes(8), tod=999, azimuth=(32_000, 32_016)))


def read(data: bytes, *, fast: bool = True, chunk: int = 0) -> list[Batch]:
    chunks = [data[i : i + chunk] for i in range(0, len(data), chunk)] if chunk else [data]
    return list(read_batches(chunks, fast=fast))


def codes(batches: Sequence[Batch]) -> list[str]:
    return [one.code for batch in batches for one in batch.damage]


def indices(batches: Sequence[Batch]) -> list[int]:
    return [idx for of in radials(batches) for idx in of.idx.tolist()]


def radials(batches: Sequence[Batch]) -> list[Radials]:
    return [batch.radials for batch in batches if batch.radials is not None]


def rows(batches: Sequence[Batch]) -> list[tuple[Any, ...]]:
    """Everything about every radial, however it was cut into batches."""
    found = []
    for of in radials(batches):
        columns = [getattr(of, name).tolist() for name in COLUMNS]
        for i, values in enumerate(zip(*columns, strict=True)):
            n = int(of.n_cells[i])
            found.append((*values, int(of.bits[i]), of.cells[i, :n].tolist()))
            assert not of.cells[i, n:].any()
    return found


def damage(batches: Sequence[Batch]) -> list[tuple[Any, ...]]:
    """Everything that was wrong, however it was cut into batches."""
    found: list[tuple[Any, ...]] = []
    for batch in batches:
        for one in batch.damage:
            if found and found[-1][:2] == (one.code, one.sensor):
                found[-1] = (*found[-1][:4], found[-1][4] + one.count)
            else:
                found.append((one.code, one.sensor, one.offset, one.message, one.count))
    return found
